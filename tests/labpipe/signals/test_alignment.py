import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings, strategies as st

from labpipe.errors import InputError
from labpipe.signals import interpolated_at, lag, timed_from_event


def record(time, values):
    return xr.DataArray(values, {"time": time}, dims="time", name="displacement", attrs={"units": "m"})


def motion(time):
    """A drop-like motion: flat, fall, decaying bounces."""
    s = np.clip(time - 0.05, 0, None)
    return np.exp(-8 * s) * np.abs(np.cos(40 * s)) * 1e-3


@settings(max_examples=8, deadline=None)
@given(shift=st.floats(-0.06, 0.06), gain=st.floats(0.3, 3.0), rate=st.sampled_from([5e3, 8e3]))
def test_lag_between_two_rates_scales_and_zeros(shift, gain, rate):
    a = np.arange(0.0, 0.5, 1 / 10e3)
    b = np.arange(-0.02, 0.45, 1 / rate)
    smooth_kinks = 2e-6  # the kinks of |cos| keep a spline from being exact
    found = lag(record(a, motion(a)), record(b, gain * motion(b - shift) + 5e-4), 0.1)
    assert found.lag == pytest.approx(shift, abs=smooth_kinks + 4 * found.u_lag)
    assert abs(found.lag - shift) < 0.1 / rate
    assert found.gain == pytest.approx(gain, rel=2e-3)
    assert found.correlation > 0.999


@pytest.mark.slow
def test_uncertainty_of_the_lag_is_calibrated():
    random = np.random.default_rng(0)
    time = np.arange(0.0, 0.5, 1e-3)
    z = []
    for _ in range(50):
        first = np.sin(30 * time) + 0.05 * random.standard_normal(time.size)
        second = np.sin(30 * (time - 0.0123)) + 0.01 * random.standard_normal(time.size)
        found = lag(record(time, first), record(time, second), 0.05)
        z.append((found.lag - 0.0123) / found.u_lag)
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.35


def test_reversed_direction_has_a_negative_gain():
    time = np.arange(0.0, 0.5, 1e-4)
    found = lag(record(time, motion(time)), record(time, -motion(time - 0.01)), 0.02)
    assert found.gain == pytest.approx(-1.0, rel=1e-3)
    assert found.lag == pytest.approx(0.01, abs=1e-6)


def test_gaps_are_bridged():
    time = np.arange(0.0, 0.5, 1e-4)
    first = motion(time)
    first[1000:1010] = np.nan
    found = lag(record(time, first), record(time, motion(time - 0.01)), 0.02)
    assert found.lag == pytest.approx(0.01, abs=1e-6)


def test_time_counts_from_the_event():
    time = np.arange(5.0)
    shifted = timed_from_event(record(time, time), 2.5)
    np.testing.assert_array_equal(shifted["time"], time - 2.5)
    assert shifted.attrs["units"] == "m"
    with pytest.raises(InputError, match="was not found"):
        timed_from_event(record(time, time), np.nan)


def test_values_outside_the_record_are_unknown():
    found = interpolated_at(record(np.arange(3.0), np.array([0.0, 2.0, 4.0])), np.array([-1.0, 0.5, 3.0]))
    np.testing.assert_array_equal(found, [np.nan, 1.0, np.nan])


@pytest.mark.parametrize(
    ("second", "largest", "message"),
    [
        (record(np.arange(5.0), np.arange(5.0)), None, "12 readings"),
        (record(np.arange(50.0), np.zeros(50)), None, "is constant"),
        (record(np.arange(50.0) + 1e3, np.sin(np.arange(50.0))), 5.0, "do not overlap"),
    ],
)
def test_records_without_a_lag_are_refused(second, largest, message):
    first = record(np.arange(50.0), np.sin(np.arange(50.0)))
    with pytest.raises(InputError, match=message):
        lag(first, second, largest)

"""Laser displacement: exact inverse of what the sensor does, honest uncertainties, right time."""

import json
import math
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calibration import laser
from instruments import keyence
from labpipe.errors import CalibrationError, InputError
from labpipe.units import Quantity
from tests.calibration.records import made
from tests.faults import seeds

DAY = datetime(2024, 5, 14)


def record(inclination="12.00 ± 0.05 deg", scale="1.0010 ± 0.0002", **values):
    return made("laser", "LK-G5001", DAY.date(), {"inclination": inclination, "scale": scale, **values})


def drop(n=2000, rest=600, seed=1, noise=1e-6):
    """A rest, then a fall of 7 mm and a rest there; 20 kHz."""
    time = np.arange(n) * 50e-6
    fall = np.clip(time - rest * 50e-6, 0, None)
    return -np.minimum(0.5 * 9.81 * fall**2, 7e-3), np.random.default_rng(seed).normal(0, noise, n)


def shown_by_sensor(moved, known, zero=2.5e-3, direction=1):
    """Readings in m of a motion: the inverse of ``displacement``."""
    values = known.values
    return zero + direction * moved * math.cos(values.inclination.value) / values.scale.value


def readings_of(moved, noise, known, zero=2.5e-3, direction=1, **options):
    shown = shown_by_sensor(moved, known, zero, direction) + noise
    return seeds.keyence_readings(shown, DAY, **options)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.floats(0.1, 60), st.floats(0.9, 1.1), st.sampled_from([1, -1]), st.floats(-5e-3, 5e-3), st.integers(0, 99))
def test_calibrating_what_the_sensor_shows_gives_the_motion_back(angle, gain, direction, zero, seed):
    known = record(f"{angle:.6f} ± 0.01 deg", f"{gain:.6f} ± 0.001")
    moved = np.random.default_rng(seed).normal(0, 2e-3, 30)
    shown = shown_by_sensor(moved, known, zero, direction)
    made = seeds.keyence_readings(shown, DAY)
    made["out1"] = made.out1.copy(data=shown)  # without the rounding of the display
    result = laser.displacement(made, known, zero=zero, direction=direction)
    np.testing.assert_allclose(result.displacement.values, moved, rtol=1e-12, atol=1e-17)
    np.testing.assert_allclose(result.displacement_raw.values, direction * (shown - zero), rtol=1e-12, atol=1e-17)


def test_quiet_beginning_is_the_zero():
    known = record()
    moved, noise = drop()
    result = laser.displacement(readings_of(moved, noise, known, direction=-1), known, direction=-1)
    assert float(result.zero) == pytest.approx(2.5e-3, abs=4 * float(result.u_zero))
    assert abs(result.displacement.values - moved).max() < 6e-6
    assert float(result.displacement[-1]) < -6.9e-3
    window = json.loads(result.attrs["zero_window"])
    assert window["start"] == 0.0
    assert 0.02 < window["stop"] < 0.0305  # motion begins at 30 ms


def test_budget_adds_up_and_is_plain():
    known = record(linearity="0 ± 0.5 um")
    moved, noise = drop()
    result = laser.displacement(readings_of(moved, noise, known), known)
    expected = 1e-6 * 1.001 / math.cos(math.radians(12))  # the noise along the motion
    np.testing.assert_allclose(result.u_displacement.values, expected, rtol=0.08)
    rows = json.loads(result.attrs["budget"])
    assert [row["source"] for row in rows][:2] == ["gain", "inclination"]
    assert sum(row["share"] for row in rows) == pytest.approx(1.0)
    total = math.sqrt(sum(row["contribution"] ** 2 for row in rows))
    assert total == pytest.approx(result.attrs["u_largest"])
    assert all(row["contribution"] >= 0 for row in rows)
    assert {row["kind"] for row in rows} == {"random", "systematic"}


@pytest.mark.slow
def test_zero_and_displacement_are_covered_by_their_uncertainty():
    known = record()
    inside = []
    for seed in range(400):
        moved, noise = drop(n=700, seed=seed)
        result = laser.displacement(readings_of(moved, noise, known), known)
        inside.append(abs(float(result.zero) - 2.5e-3) < 1.96 * float(result.u_zero))
    assert 0.92 < np.mean(inside) < 0.98


def test_window_and_number_may_give_the_zero_and_motion_gives_none():
    known = record()
    moved, noise = drop()
    made = readings_of(moved, noise, known)
    by_window = laser.displacement(made, known, zero=(0.0, 0.02))
    assert float(by_window.zero) == pytest.approx(2.5e-3, abs=3e-7)
    by_number = laser.displacement(made, known, zero=Quantity(2.5e-3, 1e-6, "m"))
    assert (float(by_number.zero), float(by_number.u_zero)) == (2.5e-3, 1e-6)
    with pytest.raises(CalibrationError, match="holds 0 valid samples"):
        laser.displacement(made, known, zero=(5.0, 6.0))
    # noise that readings share widens the zero
    smooth = np.convolve(noise, np.ones(8) / 8, mode="same")
    one, eight = (
        laser.displacement(readings_of(moved, smooth, known, averaging=n), known, zero=(0.0, 0.02)) for n in (1, 8)
    )
    assert float(eight.u_zero) == pytest.approx(math.sqrt(8) * float(one.u_zero), rel=1e-6, abs=0.0)
    falling = -1e-3 * np.arange(500) * 50e-6 / 0.01
    with pytest.raises(CalibrationError, match="begins in motion"):
        laser.displacement(readings_of(falling, noise[:500], known), known)


def test_invalid_readings_stay_nan_and_say_so():
    known = record(measuring_range="4 mm")
    moved, noise = drop()
    made = readings_of(moved, noise, known)
    states = made.status1.values.copy()
    states[700:710] = keyence.Status.ALARM
    made["status1"] = made.status1.copy(data=states)
    result = laser.displacement(made, known)
    beyond = np.flatnonzero(np.abs(made.out1.values) > 4e-3)
    assert beyond.size
    np.testing.assert_array_equal(np.flatnonzero(~result.valid.values), [*range(700, 710), *beyond])
    assert np.isnan(result.displacement.values[~result.valid.values]).all()
    assert np.isnan(result.u_displacement.values[~result.valid.values]).all()
    assert np.isfinite(result.displacement.values[result.valid.values]).all()


def test_time_is_free_of_the_delay_of_the_moving_average():
    known = record(time_base="1e-4 ± 1e-6")
    moved, noise = drop()
    made = readings_of(moved, noise, known, averaging=5)
    result = laser.displacement(made, known)
    base = json.loads(result.attrs["time_base"])
    assert base["delay"] == pytest.approx(2 * 50e-6 * 1.0001, rel=1e-12)
    assert base["u_relative"] == pytest.approx(1e-6, rel=1e-3)
    assert base["is_calibrated"] is True
    expected = made.time.values * 1.0001 - base["delay"]
    np.testing.assert_allclose(result.time.values, expected, rtol=1e-12, atol=1e-15)


def test_volts_need_and_use_the_scale_of_the_record():
    made = seeds.keyence_readings(np.linspace(0, 2, 50), DAY, unit_text="V")
    with pytest.raises(CalibrationError, match="volt_scale"):
        laser.displacement(made, record(), zero=0.0)
    known = record("60 ± 0.1 deg", "1 ± 0.0001", volt_scale="0.5 ± 0.0005 mm/V")
    result = laser.displacement(made, known, zero=0.0)
    assert float(result.displacement[-1]) == pytest.approx(2e-3)
    assert float(result.displacement_raw[-1]) == pytest.approx(1e-3)
    assert float(result.u_gain) == pytest.approx(math.hypot(0.5e-6, 0.5e-3 * 1e-4), rel=1e-6, abs=0.0)
    # a zero in millimetres is the voltage that shows it
    result = laser.displacement(made, known, zero=Quantity(0.25e-3, 1e-6, "m"))
    assert (float(result.zero), float(result.u_zero)) == pytest.approx((0.5, 2e-3))
    assert float(result.displacement[-1]) == pytest.approx(1.5e-3)


@pytest.mark.parametrize("degrees", [6.0, 45.0])
def test_inclination_from_a_drop_of_known_height(degrees):
    height = Quantity(7e-3, 2e-6, "m")
    travel = Quantity(7e-3 * math.cos(math.radians(degrees)), 1e-6, "m")
    found = laser.inclination_from_drop(travel, height)
    assert math.degrees(found.value) == pytest.approx(degrees, rel=1e-9)
    generator = np.random.default_rng(0)
    cosine = generator.normal(travel.value, travel.u, 20_000) / generator.normal(7e-3, 2e-6, 20_000)
    spread = np.arccos(np.minimum(cosine, 1.0)).std()
    assert found.u == pytest.approx(spread, rel=0.03)


def test_an_inclination_near_zero_is_bounded_and_a_longer_travel_refused():
    height = Quantity(7e-3, 1e-6, "m")
    found = laser.inclination_from_drop(Quantity(7.001e-3, 1e-6, "m"), height)
    assert (found.value, found.u) == (0.0, pytest.approx(math.sqrt(2 * math.sqrt(2) * 1e-6 / 7e-3), rel=0.01))
    for travel, error, words in ((7.1e-3, CalibrationError, "longer than"), (-7e-3, InputError, "two positive")):
        with pytest.raises(error, match=words):
            laser.inclination_from_drop(Quantity(travel, 1e-6, "m"), height)

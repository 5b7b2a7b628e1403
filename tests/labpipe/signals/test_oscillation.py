from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.signal import lfilter

import instruments
from labpipe.errors import InputError
from labpipe.signals import active_window, common_fit, fit_sinusoid, hysteresis_loops

MACH1 = Path(__file__).parents[3] / "../shared/samples/mach1/dynamic_5_sinusoid_blocks.txt"
NOMINAL = (0.1, 0.2, 0.5, 1.0, 2.0)  # Hz, of its blocks


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@settings(max_examples=40, deadline=None)
@given(
    frequency=st.floats(0.3, 20.0),
    amplitude=st.floats(1e-6, 1e3),
    phase=st.floats(-3.0, 3.0),
    offset=st.floats(-1e3, 1e3),
    drift=st.floats(-1.0, 1.0),
)
def test_noise_free_sinusoid_is_recovered(frequency, amplitude, phase, offset, drift):
    time = np.arange(0.0, 10.0, 0.01)
    signal = amplitude * np.sin(2 * np.pi * frequency * time + phase)
    fit = fit_sinusoid(time, signal + amplitude * (offset + drift * time))
    assert fit.frequency == pytest.approx(frequency, rel=1e-6)
    assert fit.amplitude == pytest.approx(amplitude, rel=1e-5)
    expected = phase + 2 * np.pi * frequency * fit.reference_time
    assert np.angle(np.exp(1j * (fit.phase - expected))) == pytest.approx(0.0, abs=1e-4)
    assert fit.trend[1] == pytest.approx(amplitude * drift, abs=1e-5 * amplitude)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_uncertainties_hold_for_residuals_with_memory(memory):
    # Measured 1.00-1.10.
    random = np.random.default_rng(0)
    z = []
    for _ in range(80):
        time = np.arange(2000) * 0.01
        noise = 0.05 * lfilter([1], [1, -memory], random.standard_normal(2200))[200:]
        fit = fit_sinusoid(time, np.sin(2 * np.pi * 0.73 * time + 0.4) + 3 + 0.1 * time + noise)
        phase = 2 * np.pi * 0.73 * fit.reference_time + 0.4
        z.append(
            [
                (fit.frequency - 0.73) / fit.u_frequency,
                (fit.amplitude - 1) / fit.u_amplitude,
                np.angle(np.exp(1j * (fit.phase - phase))) / fit.u_phase,
            ]
        )
    spread = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all((spread > 0.75) & (spread < 1.3)), spread


@pytest.mark.parametrize("lag", [0.0, 0.02, 0.5])
def test_stiffness_and_lag_of_a_lossy_solid_behind_a_filter(lag):
    random = np.random.default_rng(0)
    time = np.arange(0.0, 20.0, 0.01)
    angle = 2 * np.pi * 0.5 * time
    position = 1e-4 * np.sin(angle) + 1e-8 * random.standard_normal(2000)
    force = 1.8 * np.sin(angle + lag - 0.3) + 5 - 0.1 * np.log1p(time / 5) + 1e-3 * random.standard_normal(2000)
    fit = common_fit(time, position, force, response=lambda f: 0.9 * np.exp(-0.6j * f))
    assert fit.phase_lag == pytest.approx(lag, abs=4 * fit.u_phase_lag)
    assert fit.u_phase_lag < 1e-3
    assert fit.storage_stiffness == pytest.approx(2e4 * np.cos(lag), rel=1e-3)
    assert fit.loss_stiffness == pytest.approx(2e4 * np.sin(lag), abs=20)


def test_damped_vibration_and_its_uncertainties():
    random = np.random.default_rng(0)
    time = np.arange(1500) / 20e3
    damped = 300 * np.sqrt(1 - 0.03**2)
    ring = 1e-5 * np.exp(-0.03 * 2 * np.pi * 300 * time) * np.sin(2 * np.pi * damped * time + 1)
    z = []
    for _ in range(60):
        fit = fit_sinusoid(time, ring + 2e-6 + 1e-6 * random.standard_normal(1500), is_damped=True)
        z.append(
            [
                (fit.frequency - damped) / fit.u_frequency,
                (fit.damping_ratio - 0.03) / fit.u_damping_ratio,
                (fit.amplitude - 1e-5) / fit.u_amplitude,
                (fit.phase - 1.0) / fit.u_phase,
            ]
        )
    spread = np.sqrt(np.mean(np.square(z), axis=0))
    assert np.all((spread > 0.7) & (spread < 1.35)), spread
    assert fit.natural_frequency == pytest.approx(300, rel=5e-3)


@pytest.mark.parametrize(
    ("time", "signal", "message"),
    [
        (np.arange(100.0), np.zeros(100), "does not vary"),
        (np.arange(4.0), np.arange(4.0), "6 readings"),
        (np.arange(100.0), np.zeros(99), "one-dimensional, of one shape"),
        (np.ones(50), np.arange(50.0), "must increase"),
    ],
)
def test_bad_signals_are_refused(time, signal, message):
    with pytest.raises(InputError, match=message):
        fit_sinusoid(time, signal)
    with pytest.raises(InputError, match=message):
        fit_sinusoid(time, signal, is_damped=True)


@pytest.mark.parametrize("frequency", [0.005, 60.0, -1.0])
def test_frequencies_that_the_record_cannot_hold_are_refused(frequency):
    time = np.arange(0.0, 10.0, 0.01)
    with pytest.raises(InputError, match="at least one cycle"):
        fit_sinusoid(time, np.sin(time), frequency)


@pytest.mark.parametrize("n_per_cycle", [9, 25, 500])
def test_loop_area_is_that_of_the_ellipse_at_any_phase_sampling_and_drift(n_per_cycle):
    time = np.arange(0.0, 12.3, 1 / n_per_cycle)
    angle = 2 * np.pi * time + 0.7
    found = hysteresis_loops(time, 1e-4 * np.sin(angle), 2 * np.sin(angle + 0.2) - 0.05 * time + 20, 1.0)
    np.testing.assert_allclose(found.mean(), np.pi * 2e-4 * np.sin(0.2), rtol=5e-3 if n_per_cycle == 9 else 1e-3)
    assert found.size == 12


def test_no_motion_and_too_few_cycles_are_refused():
    time = np.arange(0.0, 10.0, 0.01)
    with pytest.raises(InputError, match="no motion"):
        active_window(time, np.zeros(1000))
    with pytest.raises(InputError, match="cycles of motion"):
        active_window(time, np.sin(2 * np.pi * 0.12 * time))
    with pytest.raises(InputError, match="whole cycle"):
        hysteresis_loops(time, np.sin(time), np.sin(time), 0.05)
    with pytest.raises(InputError, match="unread samples"):
        hysteresis_loops(time, np.full(1000, np.nan), np.sin(time), 1.0)


@pytest.mark.skipif(not MACH1.exists(), reason="the shared sample files are not beside the checkout")
def test_real_frequencies_and_amplitudes_differ_from_the_header():
    # Counted by hand: frequency 0.16, 0.11, 0.28, 0.48, 0.84 % below, amplitude 0.6-3.6 % above.
    below, above = [], []
    readings = instruments.read(MACH1)
    for number, nominal in enumerate(NOMINAL):
        block = readings.isel(sample=readings["block"].values == number)
        time, position, force = (block[name].values for name in ("time", "position_z", "force_z"))
        window = active_window(time, position)
        begin, end = window.start + 1 / window.frequency, window.end - 1 / window.frequency
        part = (time >= begin) & (time <= end)
        fit = common_fit(time[part], position[part], force[part])
        below.append(100 * (1 - fit.position.frequency / nominal))
        above.append(100 * (1e3 * fit.position.amplitude / 0.0469 - 1))
        found = hysteresis_loops(time, position, force, fit.position.frequency, start=begin, end=end)
        assert found.size in (17, 18)
        ellipse = np.pi * fit.position.amplitude * fit.force.amplitude * np.sin(fit.phase_lag)
        assert float(np.median(found)) == pytest.approx(ellipse, rel=0.01)
        assert fit.u_phase_lag < np.radians(0.02)
    np.testing.assert_allclose(below, [0.16, 0.11, 0.28, 0.48, 0.84], atol=0.06)
    assert above[0] == pytest.approx(0.6, abs=0.05)
    assert above[-1] == pytest.approx(3.6, abs=0.1)
    assert rms(np.diff(above)) < 1.5

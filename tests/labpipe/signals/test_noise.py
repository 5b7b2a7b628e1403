import numpy as np
import pytest

from labpipe.signals._noise import difference_sigma, estimate_noise, quantisation_step


@pytest.fixture
def white():
    return np.random.default_rng(0).standard_normal(25_000)


@pytest.mark.parametrize("n_averaged", [2, 4, 8])
def test_moving_average_is_seen_through(white, n_averaged):
    noise = np.convolve(white, np.full(n_averaged, 1 / n_averaged), "valid")
    found = estimate_noise(noise)
    assert found.sigma == pytest.approx(1.0, rel=0.2)
    assert found.block >= n_averaged // 2


def test_readings_that_hardly_change_have_no_noise_at_any_offset():
    assert difference_sigma(np.repeat([0.37, 0.11, 0.37, 0.54], 50)) == 0.0


def test_motion_is_not_noise(white):
    wave = 100 * np.sin(2 * np.pi * 0.03 * np.arange(25_000))
    found = estimate_noise(wave + white)
    assert found.block == 1
    assert found.sigma == pytest.approx(1.0, rel=0.03)


def test_uneven_times(white):
    time = np.sort(np.random.default_rng(1).random(25_000))
    found = estimate_noise(np.sin(20 * time) + 1e-3 * white, time)
    assert found.sigma == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize("step", [1e-8, 1e-7, 1e-3])
def test_step_is_found_about_any_offset(white, step):
    values = np.round(white[:2000] * 3) * step + 0.37 * step
    assert quantisation_step(values) == pytest.approx(step, rel=1e-6, abs=0.0)


def test_continuous_values_have_no_step(white):
    assert quantisation_step(white) == 0.0
    assert quantisation_step(np.arange(50.0)) == 0.0
    assert quantisation_step(np.zeros(50)) == 0.0

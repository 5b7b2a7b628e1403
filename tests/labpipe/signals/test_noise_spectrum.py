"""Colour of the noise: found in what is free of motion, and carried into the fits."""

import numpy as np
import pytest

from labpipe.signals._noise_spectrum import u_of_rate
from labpipe.signals._smoothing_spline import smooth

_INTERVAL = 5e-5


def flicker(rng: np.random.Generator, count: int, sigma: float, corner: float) -> np.ndarray:
    """Return noise whose power is that of white noise of ``sigma`` times 1 + corner / f."""
    frequency = np.maximum(np.fft.rfftfreq(count, _INTERVAL), 1.0 / (count * _INTERVAL))
    waves = np.fft.rfft(rng.standard_normal(count)) * np.sqrt(1.0 + corner / frequency)
    return sigma * np.fft.irfft(waves, count)


@pytest.mark.parametrize(("corner", "hum"), [(0.0, 0.0), (200.0, 0.0), (1000.0, 0.0), (0.0, 0.5), (200.0, 0.5)])
def test_rate_of_a_spline_is_uncertain_by_noise_of_any_spectrum(corner, hum):
    """At rest and in flight; the spline itself takes all noise for white."""
    time, z = np.arange(4096) * _INTERVAL, []
    fallen = -4.9e6 * np.maximum(time - 0.1, 0.0) ** 2
    for seed in range(12):
        noise = flicker(np.random.default_rng(seed), 4 * time.size, 1.0, corner)[: time.size]
        values = fallen + noise + hum * np.sin(2 * np.pi * 50.0 * time + seed)
        (_, rate), (u_level, u_rate) = smooth(time, values, 1.0, 1)[:2]
        u = u_of_rate(values, 1.0, u_level, (rate, u_rate))
        off = (rate + 9.8e6 * np.maximum(time - 0.1, 0.0)) / u
        z.append(off[np.abs(time - 0.1) > 2e-3])
    z = np.concatenate(z)
    assert np.mean(np.abs(z) < 1.96) > 0.92
    assert np.sqrt(np.mean(z**2)) > 0.6

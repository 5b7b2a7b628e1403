"""Colour of the noise: found in what is free of motion, and carried into the fits."""

import numpy as np
import pytest

from labpipe.signals._hum import Stretch
from labpipe.signals._noise_spectrum import (
    Colour,
    coloured_covariance,
    corner_in_flight,
    estimate_corner,
    velocity_factor,
)
from tests.rounding import rounding

_INTERVAL = 5e-5


def flicker(rng: np.random.Generator, count: int, sigma: float, corner: float) -> np.ndarray:
    """Return noise whose power is that of white noise of ``sigma`` times 1 + corner / f."""
    frequency = np.maximum(np.fft.rfftfreq(count, _INTERVAL), 1.0 / (count * _INTERVAL))
    waves = np.fft.rfft(rng.standard_normal(count)) * np.sqrt(1.0 + corner / frequency)
    return sigma * np.fft.irfft(waves, count)


@pytest.mark.parametrize("corner", [200.0, 1000.0])
def test_the_corner_of_flicker_noise_is_found(corner):
    noise = [flicker(np.random.default_rng(i), 8192, 1.0, corner) for i in range(12)]
    found = [estimate_corner(one, np.full(8192, 1e-4), _INTERVAL) for one in noise]
    assert np.median(found) == pytest.approx(corner, rel=0.25)
    # A spline that follows everything slow leaves nothing to see.
    assert estimate_corner(noise[0], np.full(8192, 0.9), _INTERVAL) == 0.0


def test_white_noise_has_no_colour():
    found = [
        estimate_corner(np.random.default_rng(i).standard_normal(8192), np.full(8192, 1e-3), _INTERVAL)
        for i in range(20)
    ]
    assert np.count_nonzero(found) <= 1


def test_the_normal_matrix_is_that_of_the_noise():
    rng, corner, count = np.random.default_rng(0), 300.0, 512
    design = np.stack([np.ones(count), np.linspace(-1, 1, count), np.linspace(-1, 1, count) ** 2], axis=1)
    time = np.arange(count) * _INTERVAL
    white, coloured = (coloured_covariance(design, np.eye(3), time, Colour(c), 1.0) for c in (0.0, corner))
    np.testing.assert_allclose(white, design.T @ design, rtol=rounding(count))
    # Drawn over four times the length, so that the noise does not repeat.
    drawn = np.array([design[:, 1:].T @ flicker(rng, 4 * count, 1.0, corner)[:count] for _ in range(1500)])
    expected = np.diag(coloured)[1:]
    # A slope is insensitive to what is slower than the record, the mean of a square is not.
    assert drawn[:, 0].var() == pytest.approx(expected[0], rel=0.25)
    assert drawn[:, 1].var() > 1.5 * np.sum(design[:, 2] ** 2)


def test_a_smoother_velocity_suffers_more_from_colour():
    factor = velocity_factor(np.array([1e-3, 1e-2, 1e-1]), _INTERVAL, 300.0)
    assert np.all(np.diff(factor) < 0)
    assert np.all(velocity_factor(np.array([1e-3, 1.0]), _INTERVAL, 0.0) == 1.0)


def test_flights_tell_the_corner_that_a_spline_hides():
    sizes, found = (400, 700, 600, 500), {0.0: [], 250.0: []}
    time = np.arange(sum(sizes)) * _INTERVAL
    ends = np.cumsum(sizes).tolist()
    flights = [Stretch(slice(b - n, b), 2) for n, b in zip(sizes, ends, strict=True)]
    for corner, each in found.items():
        for i in range(20):
            noise = flicker(np.random.default_rng(i), 4 * time.size, 1.0, corner)[: time.size]
            fallen = -4.9 * time**2 * 1e6
            each.append(corner_in_flight(time, fallen + noise, 1.0, flights, -1.0))
    assert np.count_nonzero(found[0.0]) <= 4
    assert np.median(found[250.0]) == pytest.approx(250.0, rel=0.2)
    # half as large again at most, where 2200 readings tell it
    assert np.std(np.log(found[250.0])) < np.log(1.5)
    assert corner_in_flight(time, time, 1.0, [], 7.0) == 7.0

"""Spectrum of a sensor's noise: how much stronger it is at low frequencies than between neighbouring samples.

Neighbouring samples determine the white part of the noise. Drift and flicker change little from sample to
sample, but they pass every fit over many samples. They show in the residuals of a fit: of a smoothing spline at all
frequencies above those that it follows, of a parabola through a flight at nearly all. The power is described by one
number more, ``1 + corner / f`` times that of the white part: a flicker noise is exactly so, and other noise counts as
the flicker that is as strong.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from labpipe.arrays import Floats
from labpipe.signals._hum import Hum, Stretch

_SIZES = (1024, 256)  # samples of the stretches of a spline's residuals, the longest first
_LOW_SHARE = 8  # share of the lowest frequencies that are compared
_CORNERS = np.concatenate([[0.0], np.geomspace(1e-4, 0.5, 100)])  # in units of the sampling rate
_CERTAIN = 2.0  # gain in log likelihood below which the noise is called white

# Of a spline that penalises the fourth derivative, response 1 / (1 + (f / cutoff)^8): the integral of
# f over that of f^2 times the cutoff, and the integral of the response over the cutoff.
_PASSED = float(np.sin(3 * np.pi / 8) / np.sin(np.pi / 4))
_WIDTH = float(np.pi / 8 / np.sin(np.pi / 8))


class Colour(NamedTuple):
    """The part of noise that is not white.

    ``corner`` [Hz]: Below which it is more than twice as strong. ``hum``: Of the mains, taken out of the record
    already: its remainder is noise.
    """

    corner: float = 0.0
    hum: Hum | None = None


WHITE = Colour()


def estimate_corner(residual: Floats, share: Floats, interval: float) -> float:
    """Find the frequency below which the noise is more than twice as strong as its white part.

    ``residual`` (n,) is that of a smoothing spline through samples in their order, ``interval`` [s] apart, over the
    standard deviation of the white part, and ``share`` (n,) the variance of the spline over that of a sample. The
    frequency [Hz] is 0 for white noise, and where the spline follows everything that is slow.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> estimate_corner(rng.standard_normal(4000), np.full(4000, 1e-3), 1e-4)
    0.0
    """
    cost, used = np.zeros(len(_CORNERS)), np.zeros(residual.size, bool)
    for size in _SIZES:
        part, term = slice(residual.size // size * size), np.arange(size // _LOW_SHARE)
        blocks, taken = residual[part].reshape(-1, size), used[part].reshape(-1, size)
        # from 1.5 cutoffs on the spline takes less than a tenth of the power; larger residuals are motion
        lowest = np.maximum(1.5 / _WIDTH * size * np.max(share[part].reshape(-1, size), axis=1, initial=0.0), 5.0)
        fits = (np.mean(blocks**2, axis=1) < 9.0) & (lowest < term[-1]) & ~taken[:, 0]
        if fits.any():
            taken[fits] = True
            kept = term > lowest[fits, None]
            power = fft.dct(blocks[fits], norm="ortho", axis=1)[:, term] ** 2
            cost += _cost(np.sum(power, axis=0, where=kept)[6:], kept.sum(axis=0)[6:], term[6:] / (2.0 * size))
    return _likeliest(cost, interval)


def corner_in_flight(
    time: Floats, values: Floats, sigma: float, stretches: Sequence[Stretch], otherwise: float
) -> float:
    """Find the same frequency where a body flies, of all noise that is faster than a flight lasts.

    ``sigma`` is the standard deviation of the white part of ``values`` (n,); ``stretches`` that follow a parabola are
    used. ``otherwise`` [Hz] is returned where no flight has enough readings.
    """
    cost, count = np.zeros(len(_CORNERS)), 0
    for part, degree in stretches:
        n = part.stop - part.start
        term = np.arange(degree + 1, n // _LOW_SHARE)
        if degree >= 2 and len(term) >= 4:
            basis = np.linalg.qr(np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, n), degree))[0]
            left = (values[part] - basis @ (basis.T @ values[part])) / sigma
            cost += _cost(fft.dct(left, norm="ortho")[term] ** 2, np.ones(len(term)), term / (2.0 * n))
            count += 1
    return _likeliest(cost, float(np.median(np.diff(time)))) if count else otherwise


def _cost(power: Floats, count: Floats, frequency: Floats) -> Floats:
    """Return minus the log likelihood (corner,) of summed powers of a cosine transform, by frequency per sample.

    The terms are independent (within 3 % of the variance of a flicker noise).
    """
    expected = 1.0 + _CORNERS[:, None] / frequency
    return np.asarray(0.5 * (np.log(expected) @ count + (1.0 / expected) @ power))


def _likeliest(cost: Floats, interval: float) -> float:
    best = int(np.argmin(cost))
    return float(_CORNERS[best] / interval) if cost[0] - cost[best] > _CERTAIN else 0.0


def coloured_covariance(design: Floats, inverse: NDArray[Any], time: Floats, colour: Colour, sigma: float) -> Floats:
    """Return the covariance (p, p) of a least-squares fit to readings with a white noise of 1.

    ``design`` (n or more, p): derivative of the model by its parameters; rows beyond the times are ties, no readings:
    the noise of each is 1 and of its own; ``inverse`` (p, p): of ``J' J``, all rows taken; ``time`` (n,) [s]: even;
    ``colour``; ``sigma``: standard deviation of the white part, in the unit of the hum.
    """
    read, ties = design[: len(time)], design[len(time) :]
    middle = read.T @ read
    if colour.corner > 0.0:
        # Below the inverse of twice the length the power grows no further.
        size, interval = 2 * len(read), float(np.median(np.diff(time)))
        waves = np.fft.rfft(read, size, axis=0)
        frequency = np.maximum(np.fft.rfftfreq(size, interval), 1.0 / (size * interval))
        weight = np.full(len(frequency), 2.0)
        weight[[0, -1]] = 1.0
        power = weight * (1.0 + colour.corner / frequency) / size
        middle = np.real(waves.conj().T @ (power[:, None] * waves))
    middle = middle + ties.T @ ties
    if colour.hum is not None:
        moved = read.T @ colour.hum.modes(time) / sigma
        middle = middle + moved @ moved.T
    return np.asarray(inverse @ middle @ inverse, float)


def coloured_power(count: int, interval: float, corner: float) -> float:
    """Return the mean power of the residuals of a fit to ``count`` samples, over that of the white part."""
    frequency = np.fft.rfftfreq(count, interval)[2:]
    return 1.0 + corner * float(np.mean(1.0 / frequency)) if len(frequency) else 1.0


def velocity_factor(share: Floats, interval: float, corner: float) -> Any:
    """Return by how much colour enlarges the uncertainty of a spline's velocity.

    ``share`` (n,): variance of the spline over that of a sample, if the noise were white: parameters per sample;
    ``interval`` [s]: between samples; ``corner`` [Hz]. Returns the factors (n,).
    """
    if corner == 0.0:
        return np.ones_like(share)
    cutoff = np.maximum(share, 1e-12) / (2.0 * _WIDTH * interval)
    return np.sqrt(1.0 + _PASSED * corner / cutoff)

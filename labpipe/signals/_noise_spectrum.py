"""Colour of a sensor's noise: how much stronger it is at low frequencies than between neighbours.

Neighbouring samples tell the white part of the noise. Drift and hum change little from sample to
sample, but they pass every fit over many samples. What a smoothing spline leaves of a record holds
the noise at all frequencies above those that the spline follows, which are few where the body rests,
flies or creeps. Where it is known to fly, a parabola leaves the slower ones too, and tells far more. The
power is described by one number more, ``1 + corner / f`` times that of the white part: a flicker
noise is exactly so, and other noise counts as the flicker that is as strong.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from labpipe.arrays import Floats
from labpipe.signals._hum import Hum, Stretch

_SIZES = (1024, 512, 256, 128)
"""Samples of a stretch, the longest that fit first."""

_FITTING = 3.0
"""Root mean square over the white part's that what is left of a stretch keeps to if the spline follows it."""

_FOLLOWED = 1.5
"""Multiple of the spline's cutoff from which on it takes less than a tenth of the noise's power."""

_LEAST, _LOW_SHARE = 2, 8
"""Lowest frequency that is compared, in inverse lengths, and the share of the lowest ones that are."""

_CORNERS = np.concatenate([[0.0], np.geomspace(1e-4, 0.5, 200)])  # in units of the sampling rate
_CERTAIN = 2.0
"""Gain in log likelihood below which the noise is called white."""

_PARABOLA, _FEWEST_TERMS = 2, 4  # degree of a flight, and terms of its cosine transform that are worth to be seen

# Of a spline that penalises the fourth derivative, response 1 / (1 + (f / cutoff)^8): the integral of
# f over that of f^2 times the cutoff, and the integral of the response over the cutoff.
_PASSED = float(np.sin(3 * np.pi / 8) / np.sin(np.pi / 4))
_WIDTH = float(np.pi / 8 / np.sin(np.pi / 8))


class Colour(NamedTuple):
    """What noise has besides its white part.

    ``corner`` [Hz]: Below which it is more than twice as strong. ``hum``: Of the mains, taken out of the record
    already: what is left of it is noise.
    """

    corner: float = 0.0
    hum: Hum | None = None


WHITE = Colour()


def estimate_corner(residual: Floats, share: Floats, interval: float) -> float:
    """Find the frequency below which the noise is more than twice as strong as its white part.

    ``residual`` (n,) is what a smoothing spline leaves of samples in their order, ``interval`` [s] apart, over the
    standard deviation of the white part, and ``share`` (n,) the variance of the spline over that of a sample. The
    frequency [Hz] is 0 for white noise, and where the spline follows everything that is slow.

    Notes
    -----
    Whittle's likelihood of the periodograms of stretches, each from a multiple of the spline's own
    cutoff on.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> estimate_corner(rng.standard_normal(4000), np.full(4000, 1e-3), 1e-4)
    0.0
    """
    cost = np.zeros(len(_CORNERS))
    is_used = np.zeros(len(residual), bool)
    for size in _SIZES:
        bins = slice(_LEAST + 1, size // (2 * _LOW_SHARE))
        every = np.fft.rfftfreq(size)[bins]
        half, count = size // 2, len(residual) // (size // 2)
        pieces = slice(count * half), (count, half)
        square = np.sum(residual[pieces[0]].reshape(pieces[1]) ** 2, axis=1)
        most = np.max(share[pieces[0]].reshape(pieces[1]), axis=1, initial=0.0)
        used = np.max(is_used[pieces[0]].reshape(pieces[1]), axis=1, initial=False)
        lowest = _FOLLOWED * np.maximum(most[:-1], most[1:]) / (2.0 * _WIDTH)
        fits = (square[:-1] + square[1:] < _FITTING**2 * size) & (lowest < every[-1]) & ~(used[:-1] | used[1:])
        chosen: list[int] = []
        for place in np.flatnonzero(fits).tolist():
            if not chosen or place > chosen[-1] + 1:  # stretches begin half a length apart
                chosen.append(place)
        if chosen:
            where = half * np.array(chosen)[:, None] + np.arange(size)
            is_used[where] = True
            kept = every > lowest[chosen, None]
            power = np.abs(np.fft.rfft(residual[where], axis=1)[:, bins]) ** 2 / size
            expected = 1.0 + _CORNERS[:, None] / every
            cost += np.log(expected) @ kept.sum(axis=0) + (1.0 / expected) @ np.sum(power, axis=0, where=kept)
    return _likeliest(cost, interval)


def corner_in_flight(
    time: Floats, values: Floats, sigma: float, stretches: Sequence[Stretch], otherwise: float
) -> float:
    """Find the same frequency where a body flies, of all noise that is faster than a flight lasts.

    ``sigma`` is the standard deviation of the white part of ``values`` (n,); ``stretches`` that follow a parabola are
    used. ``otherwise`` [Hz] is returned where no flight has enough readings.

    Notes
    -----
    Likelihood of the cosine transforms of what parabolas leave, whose terms are independent (within 3 %
    of the variance of a flicker noise) from one more than the parabola's degree on.
    """
    interval = float(np.median(np.diff(time)))
    cost, count = np.zeros(len(_CORNERS)), 0
    for part, degree in stretches:
        n = part.stop - part.start
        every = np.arange(degree + 1, n // _LOW_SHARE) / (2.0 * n)
        if degree < _PARABOLA or len(every) < _FEWEST_TERMS:
            continue
        basis = np.linalg.qr(np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, n), degree))[0]
        left = values[part] - basis @ (basis.T @ values[part])
        power = (fft.dct(left, norm="ortho")[degree + 1 : n // _LOW_SHARE] / sigma) ** 2
        expected = 1.0 + _CORNERS[:, None] / every
        cost += 0.5 * (np.log(expected).sum(axis=1) + (1.0 / expected) @ power)
        count += len(every)
    return _likeliest(cost, interval) if count else otherwise


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
    """Return the mean power of what a fit leaves of ``count`` samples, over that of the white part."""
    frequency = np.fft.rfftfreq(count, interval)[_LEAST:]
    return 1.0 + corner * float(np.mean(1.0 / frequency)) if len(frequency) else 1.0


def velocity_factor(share: Floats, interval: float, corner: float) -> Any:
    """Return by how much colour enlarges the uncertainty of a spline's velocity.

    ``share`` (n,): variance of the spline over that of a sample, if the noise were white: parameters per sample;
    ``interval`` [s]: between samples; ``corner`` [Hz]. Returns the factors (n,).
    """
    cutoff = np.maximum(share, 1e-12) / (2.0 * _WIDTH * interval)
    return np.sqrt(1.0 + _PASSED * corner / cutoff)

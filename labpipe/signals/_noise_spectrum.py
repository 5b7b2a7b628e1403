"""Colour of a sensor's noise: how much stronger it is at low frequencies than between neighbours.

Neighbouring samples show the white part of the noise. Drift and flicker change little from sample to
sample, but they pass every fit over many samples. Where a body is known to fly, the noise that a parabola
leaves shows them. The power is described by one number more, ``1 + corner / f`` times that of the white
part: a flicker noise is exactly so, and other noise counts as the flicker that is as strong.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from labpipe.arrays import Floats
from labpipe.signals._hum import Hum, Stretch

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
    """The coloured part of a noise.

    ``corner`` [Hz]: Below which it is more than twice as strong. ``hum``: Of the mains, taken out of the record
    already: its remainder is noise.
    """

    corner: float = 0.0
    hum: Hum | None = None


WHITE = Colour()


def corner_in_flight(time: Floats, values: Floats, sigma: float, stretches: Sequence[Stretch]) -> float:
    """Find the frequency below which the noise is more than twice as strong as its white part, where a body flies.

    ``sigma`` is the standard deviation of the white part of ``values`` (n,); ``stretches`` that follow a parabola are
    used, and show all noise that is faster than they last. The frequency [Hz] is 0 for white noise, and where no
    flight has enough readings.

    Notes
    -----
    Likelihood of the cosine transforms of the residuals of parabolas, whose terms are independent (within 3 %
    of the variance of a flicker noise) from one more than the parabola's degree on.
    """
    cost = np.zeros(len(_CORNERS))
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
    best, interval = int(np.argmin(cost)), float(np.median(np.diff(time)))
    return float(_CORNERS[best] / interval) if cost[0] - cost[best] > _CERTAIN else 0.0


def coloured_covariance(design: Floats, inverse: NDArray[Any], time: Floats, colour: Colour, sigma: float) -> Floats:
    """Return the covariance (p, p) of a least-squares fit to readings with a white noise of 1.

    ``design`` (n or more, p): derivative of the model by its parameters; rows beyond the times are ties, no readings:
    the noise of each is 1 and of its own; ``inverse`` (p, p): of ``J' J``, all rows taken; ``time`` (n,) [s]: even;
    ``colour``; ``sigma``: standard deviation of the white part, in the unit of the hum.
    """
    read, ties = design[: len(time)], design[len(time) :]
    middle = _normal(read, float(np.median(np.diff(time))), colour.corner) + ties.T @ ties
    if colour.hum is not None:
        moved = read.T @ colour.hum.modes(time) / sigma
        middle = middle + moved @ moved.T
    return np.asarray(inverse @ middle @ inverse, float)


def _normal(design: Floats, interval: float, corner: float) -> Floats:
    """Return ``J' C J``, C the covariance of the noise: ``J' J`` where it is white.

    Below the inverse of twice the length the power grows no further.
    """
    if corner <= 0.0:
        return design.T @ design
    size = 2 * len(design)
    waves = np.fft.rfft(design, size, axis=0)
    frequency = np.maximum(np.fft.rfftfreq(size, interval), 1.0 / (size * interval))
    weight = np.full(len(frequency), 2.0)
    weight[[0, -1]] = 1.0
    power = weight * (1.0 + corner / frequency) / size
    return cast("Floats", np.real(waves.conj().T @ (power[:, None] * waves)))


def coloured_power(count: int, interval: float, corner: float) -> float:
    """Return the mean power of the residuals of ``count`` samples, over that of the white part."""
    frequency = np.fft.rfftfreq(count, interval)[_LEAST:]
    return 1.0 + corner * float(np.mean(1.0 / frequency)) if len(frequency) else 1.0


def velocity_factor(share: Floats, interval: float, corner: float) -> Any:
    """Return by how much colour enlarges the uncertainty of a spline's velocity.

    ``share`` (n,): variance of the spline over that of a sample, if the noise were white: parameters per sample;
    ``interval`` [s]: between samples; ``corner`` [Hz]. Returns the factors (n,).
    """
    cutoff = np.maximum(share, 1e-12) / (2.0 * _WIDTH * interval)
    return np.sqrt(1.0 + _PASSED * corner / cutoff)

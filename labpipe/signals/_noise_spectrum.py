"""Spectrum of a sensor's noise: how much stronger it is at low frequencies than between neighbouring samples.

Neighbouring samples determine the white part of the noise. Drift, flicker and hum change little from sample to sample,
but they pass every fit over many samples. They show where a body flies or rests: in the residuals of a parabola, whose
power is ``1 + corner / f`` times that of the white part (a flicker noise is exactly so), and in the rate of a spline,
which has to be a straight line there.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from labpipe.arrays import Floats
from labpipe.signals._hum import Hum, Stretch

# Orthonormal parabolas over stretches of these numbers of samples, the longest of which are tried first.
_PARABOLAS = [np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, size), 3, increasing=True))[0] for size in (512, 256)]
_FOLLOWS = 2.0  # mean square of the residuals, in units of the white noise, below which a stretch follows it
_LOW_SHARE = 8  # share of the lowest frequencies that are compared
_CORNERS = np.concatenate([[0.0], np.geomspace(1e-4, 0.5, 100)])  # in units of the sampling rate
_CERTAIN = 2.0  # gain in log likelihood below which the noise is called white


class Colour(NamedTuple):
    """Noise that is not white: more than twice as strong below a corner [Hz]; the remainder of a hum taken out."""

    corner: float = 0.0
    hum: Hum | None = None


WHITE = Colour()


def u_of_rate(values: Floats, sigma: float, u_level: Floats, rate: tuple[Floats, Floats]) -> Floats:
    """Return the standard uncertainty (n,) of a spline's rate, that by noise that is not white included.

    ``values`` (n,) have a white noise of ``sigma``; ``u_level`` is that of the spline by that noise, ``rate`` its rate
    with u. In stretches that follow a parabola the rate is a straight line but for noise: the median of its
    variance about one, beyond that by white noise, is added everywhere, and in proportion where the spline passes
    higher frequencies. Nothing is added where no stretch follows a parabola.
    """
    is_new = np.ones(values.size, bool)
    beyond, passed = [np.zeros(0)], [np.zeros(0)]
    for basis in _PARABOLAS:
        size = len(basis)
        part = slice(values.size // size * size)
        y, v, u, level, new = (each[part].reshape(-1, size) for each in (values, *rate, u_level, is_new))
        rows = np.flatnonzero(new[:, 0])
        rows = rows[_about(y[rows], basis) < _FOLLOWS * sigma**2]
        new[rows] = False
        # the parameters of the spline, of which a line takes two
        parameters = np.maximum(np.sum((level[rows] / sigma) ** 2, axis=1), 1.0)
        free = np.maximum(parameters - 2.0, 1.0) / parameters
        beyond.append(_about(v[rows], basis[:, :2]) / free - np.mean(u[rows] ** 2, axis=1))
        passed.append(parameters / size)
    variances = np.concatenate(beyond)
    if not variances.size or (usual := float(np.median(variances))) <= 0.0:
        return rate[1]
    share = u_level**2 / (sigma**2 * float(np.median(np.concatenate(passed))))
    return np.asarray(np.sqrt(rate[1] ** 2 + usual * np.maximum(share, 1.0) ** 2))


def _about(stretches: Floats, basis: Floats) -> Floats:
    """Return the mean square of each stretch (stretch, n) about its polynomial of a basis (n, term)."""
    left = stretches - stretches[:, :1]
    left -= left @ basis @ basis.T
    return np.asarray(np.einsum("ij,ij->i", left, left) / len(basis))


def corner_in_flight(time: Floats, values: Floats, sigma: float, stretches: Sequence[Stretch]) -> float:
    """Find the frequency [Hz] below which the noise is more than twice as strong as its white part.

    ``sigma`` is the standard deviation of the white part of ``values`` (n,); ``stretches`` that follow a parabola are
    used, and all noise that is faster than they last. 0 is white noise, and where no stretch has enough readings.
    """
    cost = np.zeros(len(_CORNERS))
    for part, degree in stretches:
        n = part.stop - part.start
        term = np.arange(degree + 1, n // _LOW_SHARE)
        if degree >= 2 and len(term) >= 4:
            basis = np.linalg.qr(np.polynomial.polynomial.polyvander(np.linspace(-1.0, 1.0, n), degree))[0]
            left = (values[part] - basis @ (basis.T @ values[part])) / sigma
            # The terms of a cosine transform are independent (within 3 % of the variance of a flicker noise).
            power, expected = fft.dct(left, norm="ortho")[term] ** 2, 1.0 + _CORNERS[:, None] * (2.0 * n / term)
            cost += 0.5 * np.sum(np.log(expected) + power / expected, axis=1)
    best = int(np.argmin(cost))
    return float(_CORNERS[best] / np.median(np.diff(time))) if cost[0] - cost[best] > _CERTAIN else 0.0


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

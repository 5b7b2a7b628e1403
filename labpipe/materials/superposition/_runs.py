"""Runs of alike errors: how many neighbouring readings of a sweep are worth one.

Noise that lasts from one reading to the next, and a misfit of the model, bend whole sweeps; every one
then counts for less than its number of points. A fit that follows them leaves residuals that look more
independent, and smaller, than the errors are.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz

from labpipe.arrays import Floats
from labpipe.materials.superposition._joint_fit import Points

# Correlations of next neighbours that are tried; they are not taken to be more alike than the last:
# a sweep still holds two statements. Residuals count to this many standard deviations.
_CORRELATIONS, _CLIPPED = (0.0, 0.2, 0.4, 0.6, 0.8), 3.0


class Runs(NamedTuple):
    """How alike the errors of neighbouring readings are.

    ``length`` tells how many readings are worth one, ``correlation`` is that of next neighbours, and
    ``size`` the variance of the errors over that of independent ones which leave the same residuals.
    """

    length: float
    correlation: float
    size: float


def runs_in(residual: Floats, parts: Sequence[tuple[Floats, Floats]], sweeps: Sequence[NDArray[np.intp]]) -> Runs:
    """Return how alike the errors are that leave the residuals of a fit.

    The correlation of next neighbours is the one for which this fit would leave residuals as correlated
    as they are (a first-order autoregressive process), and the size of the errors goes with it.

    ``residual`` (2 point,): In units of the noise. ``parts``: G and C of the influence, the sum of G C Gᵀ, of the
    readings on the fit. ``sweeps``: Places of the readings of every sweep (:func:`sweeps_of`).
    """
    followed = np.hstack([columns @ _root(inverse) for columns, inverse in parts])
    here, after = (np.concatenate([sweep[part] for sweep in sweeps]) for part in (slice(-1), slice(1, None)))
    left = np.clip(residual, -_CLIPPED, _CLIPPED)
    observed = float(left[here] @ left[after]) / max(float(left @ left), np.finfo(float).tiny)
    expected, freedom = np.empty(len(_CORRELATIONS)), np.empty(len(_CORRELATIONS))
    for number, r in enumerate(_CORRELATIONS):
        spread = correlated(followed, sweeps, r)
        back = followed @ (followed.T @ spread) - spread
        freedom[number] = left.size + np.sum(followed * (back - spread))
        expected[number] = r * here.size + np.sum(followed[here] * back[after] - spread[here] * followed[after])
    expected /= freedom
    r = float(np.interp(observed, expected, _CORRELATIONS))
    r *= r**2 / (r**2 + 1.0 / here.size)  # what so few pairs would show by chance
    size = float(freedom[0] / np.interp(r, _CORRELATIONS, freedom))
    return Runs((1.0 + r) / (1.0 - r) * size, r, size)


def correlated(columns: Floats, sweeps: Sequence[NDArray[np.intp]], r: float) -> Floats:
    """Return R B of columns B (2 point, column), R the correlation of readings in sweeps."""
    found = np.empty_like(columns)
    for sweep in sweeps:
        found[sweep] = toeplitz(r ** np.arange(sweep.size)) @ columns[sweep]
    return found


def sweeps_of(points: Points) -> list[NDArray[np.intp]]:
    """Return the places of every sweep among storage and loss, in the order of frequency."""
    order = np.lexsort((points.omega, points.isotherm))
    sweeps = np.split(order, np.flatnonzero(np.diff(points.isotherm[order])) + 1)
    return [sweep + first for first in (0, points.omega.size) for sweep in sweeps]


def _root(matrix: Floats) -> Floats:
    size, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(size, 0.0)))

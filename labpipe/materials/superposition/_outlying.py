"""Readings that lie far off their own sweep: a contact lost for a cycle, a digit lost in a table.

A factor of ten in one reading is three hundred times the noise. Weakened by the fit it would still
have had its say before: in first shifts, in noise levels, in the choice of laws. So it is looked
for where it shows without any shift, in its own sweep; of a sweep of three or four readings, which
do not tell the wrong one, on the master curve of all.
"""

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.materials.spectrum import compress, make_grid, maxwell_shapes, solve
from labpipe.materials.superposition._joint_fit import Points

# A reading is suspected when it is off the parabola through its neighbours by this much of ln E, and
# by this many times what others are; and left out when one spectrum through the rest of its sweep says so too.
_FAR, _SCATTERS = 0.3, 8.0
# On the curve only those count that are off by more than half of the worst, which may have moved its
# sweep; so many readings at most.
_NEXT_TO_WORST, _MOST_OF_ALL, _FEW = 0.5, 0.04, 2
#: Readings from which a sweep tells by itself which of them is wrong.
LEAST_POINTS = 5
# Neighbours on either side, and the share of a sweep that may be left out.
_SIDE, _MOST_SHARE = 3, 0.25
# Smoothing of the spectrum of one sweep whose readings are taken to be known to this.
_NOISE, _STRENGTH = 0.05, 1e-3
# Keeps a parabola through repeats of one frequency defined.
_RIDGE = 1e-9


def outlying(points: Points) -> Flags:
    """Tell which readings lie far off their own sweep, in storage or in loss.

    Returns
    -------
    array of bool (point,)
    """
    found = np.zeros(points.omega.size, dtype=bool)
    rows = [np.flatnonzero(points.isotherm == k) for k in range(points.count)]
    rows = [row[np.argsort(points.omega[row], kind="stable")] for row in rows if row.size >= LEAST_POINTS]
    if not rows:
        return found
    columns = (points.storage, points.loss)
    off = [[_off_neighbours(points.omega[row], values[row]) for row in rows] for values in columns]
    usual = [float(np.median(np.abs(np.concatenate(part)))) for part in off]
    for k, row in enumerate(rows):
        kept = np.ones((2, row.size), dtype=bool)
        for which, values in enumerate(columns):
            left = off[which][k]
            while True:
                worst = int(np.argmax(np.abs(left)))
                limit = max(_FAR / 2.0, _SCATTERS * usual[which])
                if abs(left[worst]) <= limit or np.sum(~kept[which]) >= _MOST_SHARE * row.size:
                    break
                at = np.flatnonzero(kept[which])
                kept[which, at[worst]] = False
                left = _off_neighbours(points.omega[row][kept[which]], values[row][kept[which]])
        if not kept.all():
            found[row[_confirmed(points, row, kept)]] = True
    return found


def off_the_curve(points: Points, predicted: Floats) -> Flags:
    """Tell which single readings lie far off a master curve that all the others follow.

    ``points``; ``predicted`` (2 point,) [Pa]: storage and loss of the master curve. Returns the readings, none where
    they are many: then the curve is wrong, or not only readings are.
    """
    measured = np.concatenate([points.storage, points.loss])
    off = np.abs(np.log(measured / np.maximum(predicted, np.finfo(float).tiny))).reshape(2, -1)
    limit = np.maximum(_FAR, _SCATTERS * np.median(off, axis=1))
    off = np.max(np.where(off > limit[:, None], off, 0.0), axis=0)
    far = off > _NEXT_TO_WORST * float(np.max(off))
    left = np.bincount(points.isotherm, ~far, minlength=points.count)
    is_many = np.count_nonzero(far) > max(_MOST_OF_ALL * off.size, _FEW)
    return np.zeros_like(far) if is_many or np.any(left[points.isotherm[far]] < 1) else far


def _off_neighbours(omega: Floats, values: Floats) -> Floats:
    """Return how far ln E is off the parabola through its neighbours, in units of that of one reading."""
    x, y = np.log(omega), np.log(values)
    count = x.size
    width = min(2 * _SIDE + 1, count)
    first = np.clip(np.arange(count) - _SIDE, 0, count - width)
    near = first[:, None] + np.arange(width)
    near = near[near != np.arange(count)[:, None]].reshape(count, width - 1)
    away = x[near] - x[:, None]
    reach = np.max(np.abs(away), axis=1)
    powers = (away / np.maximum(reach, np.finfo(float).tiny)[:, None])[..., None] ** np.arange(3)
    normal = powers.transpose(0, 2, 1) @ powers + _RIDGE * np.eye(3)
    # The value of the parabola at the reading itself, as weights of its neighbours.
    weights = (powers @ np.linalg.solve(normal, np.eye(3)[:, :1]))[..., 0]
    return np.asarray((y - np.sum(weights * y[near], axis=1)) / np.sqrt(1.0 + np.sum(weights**2, axis=1)))


def _confirmed(points: Points, row: NDArray[np.intp], kept: Flags) -> Flags:
    """Ask one spectrum through the rest of the sweep, both moduli, whether the suspects are off it."""
    x = np.log(points.omega[row])
    measured = np.concatenate([points.storage[row], points.loss[row]])
    used = kept.ravel()
    both = kept.all(axis=0)
    grid = make_grid(x[both], points.storage[row][both], points.loss[row][both])
    up, down = maxwell_shapes(x, grid.ln_time)
    design = (
        np.vstack([np.column_stack([up, np.ones(row.size)]), np.column_stack([down, np.zeros(row.size)])]) * grid.scale
    )
    weight = 1.0 / (_NOISE * measured[used])
    solution = solve(*compress(design[used] * weight[:, None], measured[used] * weight), grid.penalty, _STRENGTH)
    off = np.abs(np.log(measured / np.maximum(design @ solution.coefficient, np.finfo(float).tiny)))
    return np.asarray(np.any((~kept) & (off.reshape(2, -1) > _FAR), axis=0))

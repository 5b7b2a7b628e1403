"""Single readings far off their own sweep: a contact lost for a cycle, a digit lost in a table.

A factor of ten in one reading is three hundred times the noise. Weakened by the fit it would still
have had its say before: in first shifts, in noise levels, in the choice of laws. So it is looked
for where it shows without any shift, in its own sweep.
"""

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.materials.spectrum import compress, make_grid, maxwell_shapes, solve
from labpipe.materials.superposition._joint_fit import Points

# A reading is suspected when it is off the parabola through its neighbours by half of this (of ln E), and
# by this many times the median of others; it is left out when one spectrum through the rest of its sweep
# is as far from it as well.
_FAR, _SCATTERS = 0.3, 8.0
# Readings from which a sweep can show which of them is wrong, the share of it that may be left out, and
# neighbours on either side.
_LEAST_POINTS, _MOST_SHARE, _SIDE = 5, 0.25, 3
# Smoothing of the spectrum of one sweep whose readings are taken to be known to this.
_NOISE, _STRENGTH = 0.05, 1e-3


def outliers(points: Points) -> Flags:
    """Return the readings (point,) far off their own sweep, in storage or in loss."""
    found = np.zeros(points.omega.size, dtype=bool)
    rows = [np.flatnonzero(points.isotherm == k) for k in range(points.count)]
    rows = [row[np.argsort(points.omega[row], kind="stable")] for row in rows if row.size >= _LEAST_POINTS]
    if not rows:
        return found
    columns = (points.storage, points.loss)
    off = [[_off_neighbours(points.omega[row], values[row]) for row in rows] for values in columns]
    limits = [max(_FAR / 2.0, _SCATTERS * float(np.median(np.abs(np.concatenate(part))))) for part in off]
    for k, row in enumerate(rows):
        kept = np.ones((2, row.size), dtype=bool)
        for which, values in enumerate(columns):
            left = off[which][k]
            while np.sum(~kept[which]) < _MOST_SHARE * row.size:
                worst = int(np.argmax(np.abs(left)))
                if abs(left[worst]) <= limits[which]:
                    break
                kept[which, np.flatnonzero(kept[which])[worst]] = False
                left = _off_neighbours(points.omega[row][kept[which]], values[row][kept[which]])
        if kept.all():
            continue
        # One spectrum through the rest of the sweep, both moduli, has to be far from the suspects too.
        x, both = np.log(points.omega[row]), kept.all(axis=0)
        measured = np.concatenate([points.storage[row], points.loss[row]])
        grid = make_grid(x[both], points.storage[row][both], points.loss[row][both])
        up, down = maxwell_shapes(x, grid.ln_time)
        constant = np.ones((row.size, 1))
        design = np.vstack([np.hstack([up, constant]), np.hstack([down, 0.0 * constant])]) * grid.scale
        used = kept.ravel()
        weight = 1.0 / (_NOISE * measured[used])
        solution = solve(*compress(design[used] * weight[:, None], measured[used] * weight), grid.penalty, _STRENGTH)
        far = np.abs(np.log(measured / np.maximum(design @ solution.coefficient, np.finfo(float).tiny)))
        found[row[np.any(~kept & (far.reshape(2, -1) > _FAR), axis=0)]] = True
    return found


def _off_neighbours(omega: Floats, values: Floats) -> Floats:
    """Return the distance of ln E from the parabola through its neighbours, in units of that of one reading."""
    x, y = np.log(omega), np.log(values)
    count = x.size
    width = min(2 * _SIDE + 1, count)
    first = np.clip(np.arange(count) - _SIDE, 0, count - width)
    near = first[:, None] + np.arange(width)
    near = near[near != np.arange(count)[:, None]].reshape(count, width - 1)
    away = x[near] - x[:, None]
    reach = np.max(np.abs(away), axis=1)
    powers = (away / np.maximum(reach, np.finfo(float).tiny)[:, None])[..., None] ** np.arange(3)
    normal = powers.transpose(0, 2, 1) @ powers + 1e-9 * np.eye(3)  # defined for repeats of one frequency too
    # The value of the parabola at the reading itself, as weights of its neighbours.
    weights = (powers @ np.linalg.solve(normal, np.eye(3)[:, :1]))[..., 0]
    return np.asarray((y - np.sum(weights * y[near], axis=1)) / np.sqrt(1.0 + np.sum(weights**2, axis=1)))

"""Sweeps with far more readings than a smooth curve needs: means of neighbouring readings.

Every term of a relaxation is wider than a decade, so that readings a twentieth of a decade apart
say the same with another error; their mean says it once, with less. The geometric mean over such a
window is the modulus in its middle to 0.0005 of it (a power law keeps it exactly), and half the
square of the relative noise below it: 0.0002 at a noise of 2 %.
"""

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials.superposition._joint_fit import Points

# Readings from which the work is worth saving, and means that a decade keeps.
_MOST, _PER_DECADE = 1500, 20


def means_of(points: Points) -> Points:
    """Return means of neighbouring readings where there are very many, else the readings themselves."""
    if points.omega.size <= _MOST:
        return points
    groups = np.empty(points.omega.size, dtype=int)
    count = 0
    for k in range(points.count):
        mask = np.flatnonzero(points.isotherm == k)
        mask = mask[np.argsort(points.omega[mask], kind="stable")]
        decades = float(np.log10(points.omega[mask[-1]] / points.omega[mask[0]]))
        parts = min(max(int(np.ceil(decades * _PER_DECADE)), 1), mask.size)
        groups[mask] = count + np.arange(mask.size) * parts // mask.size
        count += parts
    readings = np.bincount(groups).astype(float)

    def mean(values: Floats) -> Floats:
        return np.exp(np.bincount(groups, np.log(values)) / readings)

    isotherm = np.empty(count, dtype=np.intp)
    isotherm[groups] = points.isotherm
    return Points(mean(points.omega), isotherm, mean(points.storage), mean(points.loss), points.count, readings)

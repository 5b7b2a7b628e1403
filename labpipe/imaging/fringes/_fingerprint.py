"""How what a fit leaves goes around the rings: which errors of the model it can come from.

Blur, harmonics, phase, scale, a second colour and a flat change the light with the distance from the centre
alone, so that they explain only what all of a ring has in common; astigmatism, coma and stray light do not.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._ring_fit import RingFit, ring_around
from labpipe.imaging.fringes._ring_sums import NONE_FREE, ring_cells
from labpipe.imaging.fringes._view import View

#: Rings of cells below which they do not follow the fringes.
_LEAST_BINS = 24
#: Relative size of what keeps a ring of which little is seen from telling more than it holds.
_RIDGE = 1e-9


def round_share(images: Sequence[NDArray[np.generic]], fits: Sequence[RingFit], view: View) -> float:
    """Share of the squared errors of the model that functions of the distance alone would explain.

    Parameters
    ----------
    images : sequence of arrays (row, column)
        Grey levels.
    fits : sequence of RingFit
        Fits of them.
    view : View
        The view they were made with.

    Returns
    -------
    float
        An upper bound, but for chance; 1 where no errors of the model are seen, NaN where a ring is too small to tell.
        Measured: 0.89 and more where one of those things was wrong, 0.17 and less beside astigmatism, coma, a
        ghost and uneven light.

    Notes
    -----
    The fit leaves nothing along its own slopes. On whole rings those by the centre and the slopes of the light
    are orthogonal to all functions of the distance; where a part of a ring is not seen they are not, and count as
    if they were free.
    """
    explained = total = 0.0
    for image, fit in zip(images, fits, strict=True):
        ring = ring_around(image, fit.parameters, view.optics, view.settings, view.levels)
        if ring is None:
            return 1.0
        cells = ring_cells(ring, fit.parameters, NONE_FREE, view.optics)
        if len(cells.counts) < _LEAST_BINS:
            return math.nan
        total += max(fit.residual**2 - fit.noise**2, 0.0) * float(cells.counts.sum())
        explained += _explained(cells.sums, cells.counts, fit.noise)
    return explained / total if total > 0.0 else 1.0


def _explained(sums: Floats, counts: Floats, noise: float) -> float:
    """Sum of squares, beyond noise, that functions of the distance explain."""
    sectors = counts.shape[1]
    angles = 2.0 * np.pi * np.arange(sectors) / sectors
    seen = counts.sum(axis=1) > 0.0
    is_whole = (counts[seen] > 0.0).all(axis=1)
    waves = np.stack([np.ones(sectors), np.cos(angles), np.sin(angles)])
    total = 0.0
    for rows, base in ((is_whole, waves[:1]), (~is_whole, waves)):
        right = sums[seen][rows] @ base.T
        normal = np.einsum("bs,ps,qs->bpq", counts[seen][rows], base, base) + _RIDGE * np.eye(len(base))
        total += float((right * np.linalg.solve(normal, right[:, :, None])[:, :, 0]).sum())
        total -= noise**2 * len(base) * int(rows.sum())
    return total

"""Texture along the weakest direction of a subset: a straight edge has none, however sharp it is."""

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.dic._subsets import Subsets

#: Squared slopes along the weakest direction over those across it, below which a subset may hold edges only.
_ANISOTROPIC = 0.1
#: Pixels at nearly the same place across the edges whose slopes are averaged.
_ALIKE = 9


def slopes_of_edges(subsets: Subsets) -> Floats:
    """Squared slopes along the weakest direction that the pixels of straight edges feign.

    Parameters
    ----------
    subsets : Subsets
        The reference.

    Returns
    -------
    array (point,) [grey²/px²]
        Sum over the subset; 0 where the texture is no edge.

    Notes
    -----
    The image of straight edges depends on the place across them only. So does the slope along them which pixels
    and interpolation show of it: pixels at the same place across have the same. The slope that
    all of them share is of the edge; differences are texture (or noise).
    """
    result = np.zeros(len(subsets))
    xx, yy, xy = subsets.normal[:, 0, 0], subsets.normal[:, 3, 3], subsets.normal[:, 0, 3]
    middle, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    for n in np.flatnonzero(middle - apart < _ANISOTROPIC * (middle + apart)):
        half, place, pitch = subsets.layout[n, 2:].tolist()
        width = 2 * half + 1
        _, gx, gy, counts = subsets.packed[:, place : place + width * pitch].reshape(4, width, pitch)[..., :width]
        i, j = np.mgrid[-half : half + 1, -half : half + 1]
        cosine, sine = np.cos(angle[n]), np.sin(angle[n])
        inside = counts > 0
        order = np.argsort((cosine * j + sine * i)[inside])
        along = (cosine * gy - sine * gx)[inside][order].astype(float)
        sums = np.cumsum(np.concatenate([[0.0], along]))
        last = np.minimum(np.arange(len(along)) + _ALIKE // 2 + 1, len(along))
        first = np.maximum(np.arange(len(along)) - _ALIKE // 2, 0)
        left = along - (sums[last] - sums[first]) / (last - first)
        texture = float(left @ left) * _ALIKE / (_ALIKE - 1)
        result[n] = max(0.0, float(along @ along) - texture)
    return result

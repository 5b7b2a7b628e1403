"""Texture along the weakest direction of a subset: a straight edge has none, however sharp it is."""

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.dic._subsets import Subsets

#: Squared slopes along the weakest direction over those across it, below which a subset may hold edges only.
_ANISOTROPIC = 0.1
#: Width (px) of the steps across the edges in which their slopes are compared.
_STEP = 0.25


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
    and interpolation show of it: pixels at the same place across have the same. The covariance of the two halves of
    the subset, at the same places across, is of the edge; texture and noise of the halves are independent.
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
        step = np.floor((cosine * j + sine * i)[inside] / _STEP).astype(int)
        step -= step.min(initial=0)
        along = (cosine * gy - sine * gx)[inside]
        is_left = (cosine * i - sine * j)[inside] < 0
        size = step.max(initial=0) + 1
        (left, right), (left_count, right_count) = (
            [np.bincount(step[part], weights[part], size) for part in (is_left, ~is_left)]
            for weights in (along, np.ones_like(along))
        )
        both = (left_count > 0) & (right_count > 0)
        means = left[both] / left_count[both] * right[both] / right_count[both]
        result[n] = max(0.0, float(means @ (left_count + right_count)[both]))
    return result

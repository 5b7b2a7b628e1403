"""Rows of a frame that hold the row before once more: a transfer lost them, and something filled them in."""

import numpy as np
from numpy.typing import NDArray

#: Share of the rows above which the whole film is of another making, and rows below which chance may do it.
_MOST, _FEWEST = 0.4, 2
#: Columns that are compared first, and share of the pixels that are like those before them in rows that
#: chance may repeat.
_FIRST, _ALIKE = 64, 0.8


def fill_lost_rows(image: NDArray[np.generic]) -> int:
    """Interpolate, in place, the rows that repeat the row before.

    Noise makes no two rows alike, so that rows which are, pixel for pixel, were not seen by the camera.

    ``image`` (row, column): Grey levels. Returns: How many rows were interpolated, by a cubic through two rows above
    and two below.
    """
    like = (image[1:, :_FIRST] == image[:-1, :_FIRST]).all(axis=1)
    if like.sum() < _FEWEST:
        return 0
    same = image[1:] == image[:-1]
    share = same.mean(axis=1)
    is_flat = (image[1:] == image[1:, :1]).all(axis=1)
    lost = 1 + np.flatnonzero((share == 1.0) & ~is_flat)
    if not _FEWEST <= len(lost) <= _MOST * len(image) or np.median(share) > _ALIKE:
        return 0
    sound = np.setdiff1d(np.arange(len(image)), lost)
    after = np.clip(np.searchsorted(sound, lost), 2, len(sound) - 2)
    near = sound[after[:, None] + np.arange(-2, 2)]
    weight = np.ones(near.shape)
    for k in range(4):
        for other in range(4):
            if other != k:
                weight[:, k] *= (lost - near[:, other]) / (near[:, k] - near[:, other])
    found = np.einsum("rk,rkc->rc", weight, image[near].astype(float))
    if image.dtype.kind in "iu":
        whole = np.iinfo(str(image.dtype))
        found = np.clip(np.rint(found), whole.min, whole.max)
    image[lost] = found
    return len(lost)

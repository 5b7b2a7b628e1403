"""The colour filter of a camera over images that are given as grey."""

import numpy as np

from labpipe.arrays import Floats

#: Difference from which on pixels lie under a filter: fixed patterns of grey cameras are below a hundredth.
MOSAIC = 0.05
#: Part of an image (px) in which rows and columns are compared, and how many there must be.
_TILE, _FEWEST_TILES = 16, 4
#: Standard error of a median over the median distance from it, times the root of the number; and errors that tell.
_ERROR_OF_MEDIAN, _SURE = 1.86, 10.0


def mosaic_of(image: Floats) -> float:
    """Return how far the four pixels of each square of two by two differ in most parts of an image, over their mean.

    ``image`` (row, column): grey levels above black.
    """
    rows, columns = (size // _TILE for size in image.shape)
    if rows * columns < _FEWEST_TILES:
        return 0.0
    tiles = image[: rows * _TILE, : columns * _TILE].reshape(rows, _TILE // 2, 2, columns, _TILE // 2, 2)
    means = tiles.mean(axis=(1, 4)).transpose(0, 2, 1, 3).reshape(-1, 4)
    light = means.mean(axis=1)
    # a part without light has no brightness to compare
    seen = light > 0.5 * max(float(np.quantile(light, 0.9)), 0.0)
    if np.count_nonzero(seen) < _FEWEST_TILES:
        return 0.0
    relative = means[seen] / light[seen, np.newaxis]
    middle = np.median(relative, axis=0)
    # a pattern that is finer than a pixel differs from place to place
    error = _ERROR_OF_MEDIAN * np.median(np.abs(relative - middle)) / np.sqrt(len(relative))
    return float(np.ptp(middle)) if np.ptp(middle) > _SURE * error else 0.0

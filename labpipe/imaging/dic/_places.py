"""What follows from where points stand: their nearest others, and pieces of a frame spread over their subsets."""

import numpy as np

from labpipe.arrays import Floats, Integers
from labpipe.imaging.films import PIECE

#: Pieces of a frame whose rows are compared, and pixels of the subsets for each of them.
_FEWEST_PIECES, _MOST_PIECES, _PIXELS_PER_PIECE = 4, 24, 40_000


def spread_pieces(places: Floats, half: Integers) -> tuple[Integers, Floats]:
    """Points of pieces spread over the subsets, and their first columns and rows (piece, 2) [px].

    As many as cost little beside the subsets themselves; wide subsets hold several.
    """
    side = np.maximum((2 * half + 1) // PIECE, 1)
    most = int(np.clip((2.0 * half + 1.0) @ (2.0 * half + 1.0) / _PIXELS_PER_PIECE, _FEWEST_PIECES, _MOST_PIECES))
    points = np.repeat(np.arange(len(half)), side**2)
    own = np.arange(len(points)) - np.repeat(np.cumsum(side**2) - side**2, side**2)
    steps = np.stack([own % side[points], own // side[points]], axis=1) - 0.5 * side[points][:, None]
    corners = places[points] + PIECE * steps
    chosen = np.unique(np.linspace(0, len(points) - 1, most).round().astype(int)) if len(points) else points
    return points[chosen], corners[chosen]


def powers(places: Floats, count: int = 6) -> Floats:
    """Columns (..., count) of a surface over places (..., 2): 1, x, y, x², x y and y², as many as asked for."""
    x, y = places[..., 0], places[..., 1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y][:count], axis=-1)


def nearest(places: Floats, others: Floats, count: int) -> Integers:
    """Find for every place its nearest others, shape (place, count).

    Parameters
    ----------
    places, others : arrays (place, 2) and (other, 2) [px]
    count : int
        At most the number of others.
    """
    from scipy.spatial import cKDTree

    if not len(places):
        return np.zeros((0, count), np.int64)
    found = cKDTree(others).query(places, k=range(1, count + 1))[1]
    return np.asarray(found, np.int64)

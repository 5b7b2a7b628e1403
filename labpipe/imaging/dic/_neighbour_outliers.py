"""Disagreement of a point with its neighbours: the normalised median test.

References
----------
J. Westerweel, F. Scarano, Exp. Fluids 39 (2005) 1096-1100, https://doi.org/10.1007/s00348-005-0016-6
"""

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.compilation import njit

#: Neighbours of a point, as many as around a place of a square grid.
NEIGHBOURS = 8
#: Scatter that is always allowed (px) and the threshold of the normalised residual, both of the reference.
_ALLOWED, _THRESHOLD = 0.1, 2.0
#: Strain between neighbours that their own motions may miss, within which they still support each other.
_STRAIN = 0.02


def nearest(places: Floats, others: Floats, count: int) -> Integers:
    """Numbers (place, count) of the nearest of the others for every place, both (..., 2) [px]."""
    from scipy.spatial import cKDTree

    found = cKDTree(others).query(places, k=range(1, count + 1))[1]
    return np.asarray(found, np.int64)


def carried(motion: Floats, offset: Floats) -> Floats:
    """Displacement (..., 2) in px that motions (..., 6) give at offsets (..., 2) from their centre."""
    x, y = offset[..., 0], offset[..., 1]
    return np.stack(
        [
            motion[..., 0] + motion[..., 1] * x + motion[..., 2] * y,
            motion[..., 3] + motion[..., 4] * x + motion[..., 5] * y,
        ],
        axis=-1,
    )


def _median(values: Floats) -> Floats:
    """Median along the second axis of what is finite; NaN of nothing."""
    if not values.shape[1]:
        return np.full((len(values), *values.shape[2:]), np.nan)
    ordered, count = np.sort(values, axis=1), np.isfinite(values).sum(axis=1, keepdims=True)
    middle = [np.take_along_axis(ordered, np.maximum(k, 0), axis=1)[:, 0] for k in ((count - 1) // 2, count // 2)]
    return np.where(count[:, 0] > 0, 0.5 * (middle[0] + middle[1]), np.nan)


@njit(cache=True, nogil=True)
def _contradicted(motion: Floats, trusted: Flags, near: Integers, offset: Floats, allowed: float) -> Flags:
    """Trusted points with three trusted neighbours, one of which leads farther from them than allowed (px)."""
    result = np.zeros(len(motion), np.bool_)
    for n in range(len(motion)):
        votes, apart = 0, 0.0
        for k in range(near.shape[1]):
            p = motion[near[n, k]]
            if trusted[near[n, k]]:
                votes += 1
                x, y = offset[n, k, 0], offset[n, k, 1]
                apart = max(apart, abs(p[0] + p[1] * x + p[2] * y - motion[n, 0]))
                apart = max(apart, abs(p[3] + p[4] * x + p[5] * y - motion[n, 3]))
        result[n] = trusted[n] and votes >= 3 and apart > allowed
    return result


class Neighbourhood:
    """Nearest neighbours of every point and what they make of its displacement.

    Parameters
    ----------
    places : array (point, 2) [px]
        Points in the reference.
    """

    def __init__(self, places: Floats) -> None:
        count = min(NEIGHBOURS, len(places) - 1)
        self._near = np.zeros((len(places), 0), np.int64)
        if count > 0:
            self._near = np.ascontiguousarray(nearest(places, places, count + 1)[:, 1:])
        self._offset = places[:, None] - places[self._near]

    def votes(self, motion: Floats, trusted: Flags) -> Floats:
        """Displacements (point, neighbour, 2) [px] that neighbours carry to each point; NaN of those not trusted."""
        votes = carried(motion[self._near], self._offset)
        votes[~trusted[self._near]] = np.nan
        return votes

    def unsupported(self, motion: Floats, trusted: Flags) -> Flags:
        """Points that not one trusted neighbour supports, though there are neighbours to do so."""
        if not self._near.shape[1]:
            return np.zeros(len(motion), bool)
        return ~self._supported(self.votes(motion, trusted), motion)

    def outliers(self, motion: Floats, trusted: Flags) -> tuple[Flags, Floats]:
        """Trusted points that fail the normalised median test, and the median (failed, 2) [px] of their neighbours.

        A point that some neighbour supports does not fail: it may lie on another body than most of them.

        Parameters
        ----------
        motion : array (point, 6)
            Motion of each point.
        trusted : bool array (point,)
            Points that were found; three neighbours of these are needed for a test.
        """
        # one that differs by less than the threshold from all its neighbours differs so from their median
        fails = _contradicted(motion, trusted, self._near, self._offset, _THRESHOLD * _ALLOWED)
        chosen = np.flatnonzero(fails)
        if not len(chosen):
            return fails, np.zeros((0, 2))
        votes = self.votes(motion, trusted)[chosen]
        median = _median(votes)
        residual = np.abs(motion[chosen][:, [0, 3]] - median) / (_ALLOWED + _median(np.abs(votes - median[:, None])))
        fails[chosen] = (residual > _THRESHOLD).any(axis=1) & ~self._supported(votes, motion[chosen], chosen)
        return fails, median[fails[chosen]]

    def _supported(self, votes: Floats, motion: Floats, chosen: Integers | slice = slice(None)) -> Flags:
        """Points with a neighbour whose motion leads where they were found."""
        apart = np.hypot(*np.moveaxis(votes - motion[:, None, [0, 3]], -1, 0))
        allowed = _THRESHOLD * _ALLOWED + _STRAIN * np.hypot(*np.moveaxis(self._offset[chosen], -1, 0))
        return np.asarray((apart <= allowed).any(axis=1))

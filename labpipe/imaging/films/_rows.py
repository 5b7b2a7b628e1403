"""Rows of two instants in one frame, and rows that repeat others.

An interlaced camera records odd and even rows one after the other. What moves has then two places in
one frame: a correlation finds a place in between, and an edge has teeth like a comb. The distance
between the two places follows from the slopes of the image. A film that was made from one of the two
fields alone holds every second row twice, or as the mean of its neighbours.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32
from labpipe.compilation import compiled

#: Width (px) of the pieces of a frame that are looked at.
PIECE = 32
#: Squares that a distance of the fields explains, over those that it leaves, per pixel: of one instant
#: pieces of photographs, random fields and Perlin noise showed 40 at most, with 0.2 px 50 to 1,000.
_CLEAR = 60.0
#: Least distance (px) of the fields, and the ratio of the squared differences of neighbouring rows and
#: of those two apart from which what moved by more than its features shows in both.
_LEAST_APART, _TEETH = 0.05, 1.3
#: Share of the pieces, and pieces, that show it.
_SHARE, _FEWEST = 0.1, 2
#: Pieces whose distances are compared with their scatter, and by how many standard errors they differ
#: from 0 together; then the least distance (px).
_TOGETHER, _SIGNIFICANT, _LEAST_TOGETHER = 8, 10.0, 0.02
#: The same along the motion, in all frames of a film together.
_SIGNIFICANT_ALONG = 6.0
#: Standard error of a median over the median distance from it, times the root of the number; share of
#: the slopes that keeps the distance along an edge finite.
_ERROR_OF_MEDIAN, _RIDGE = 1.86, 1e-3
#: Logarithm of the ratio of squared differences of rows, by parity, from which rows are repeated.
_REPEATED, _MEAN_OF_OTHERS = 1.5, 1.2
#: Squared grey levels that rounding leaves, and below which a piece shows nothing.
_ROUNDING, _LEAST_SHOWN = 0.1, 2.0
#: Share of the moving frames that must show two instants before the film is interlaced.
_MOST_FRAMES = 0.5
#: Steps (px) from frame to frame from which a frame moves so that its fields must differ, and from
#: which they may.
_MOVING, _CREEPING = 0.5, 0.04


@dataclass(frozen=True)
class RowsSeen:
    """What the rows of a film show.

    Attributes
    ----------
    is_combed : bool array (frame,)
        The frame shows two instants. In a film whose still frame has edges sharper than the pixels only
        teeth count, rows that differ more from their neighbours than from the next but one: the steps of
        such edges look like small distances, in random directions.
    apart : array (frame,) [px]
        Distance of what odd and even rows show, 0 where they show the same.
    is_repeated : bool
        Every second row repeats its neighbour or is the mean of both.
    distances : list of arrays (piece, 2) [px]
        Distance of the fields in every piece of every frame.
    is_sharp : bool
        The still frame has edges sharper than the pixels.
    """

    is_combed: Flags
    apart: Floats
    is_repeated: bool
    distances: list[Floats]
    is_sharp: bool

    def are_outwards(self, frame: int, directions: Floats) -> bool:
        """Tell whether the fields of a frame are apart along directions (piece, 2), or against all of them."""
        return _differ_from_zero((self.distances[frame] * directions).sum(axis=1), _SIGNIFICANT_ALONG)

    def is_interlaced(self, step: Floats) -> bool:
        """Tell whether the film is interlaced.

        Parameters
        ----------
        step : array (frame, 2) [px]
            Motion from frame to frame; NaN where it is not known.

        Notes
        -----
        Most frames that move show two instants then; or, where the motion is too slow or the edges are
        too sharp for that, the fields are apart along the motion in all of them together, beyond what
        the still frame shows, whose own error all of them share.
        """
        length = np.hypot(*step.T)
        if self.is_combed.sum() >= max(1.0, _MOST_FRAMES * np.count_nonzero(length > _MOVING)):
            return True
        chosen = np.flatnonzero((length > _CREEPING) & (self.is_sharp | (length < _MOVING)))
        still, shared = np.zeros(2), 0.0
        if self.is_sharp:
            still = np.median(self.distances[0], axis=0)
            shared = max(map(_error_of_median, self.distances[0].T))
        along = [(self.distances[k] - still) @ (step[k] / length[k]) for k in chosen]
        return _differ_from_zero(np.concatenate(along), _SIGNIFICANT_ALONG, shared) if along else False


def is_inside(corners: NDArray[np.int64], shape: tuple[int, int]) -> Flags:
    """Tell which pieces (piece, 2), by first column and row, lie in an image of rows and columns."""
    rows, columns = shape
    return np.asarray((corners >= 0).all(axis=1) & (corners[:, 0] <= columns - PIECE) & (corners[:, 1] <= rows - PIECE))


def pieces_of(image: NDArray[np.generic], corners: NDArray[np.int64]) -> Floats32:
    """Copy the square pieces (piece, row, column) of an image that lie inside it.

    Parameters
    ----------
    image : array (row, column)
        Grey levels.
    corners : integer array (piece, 2) [px]
        Column and row of the first pixel of each; the rows of all of them even, or odd.
    """
    rows, columns = image.shape
    inside = is_inside(corners, (rows, columns))
    found = np.empty((int(inside.sum()), PIECE, PIECE), np.float32)
    for piece, (x, y) in zip(found, corners[inside], strict=True):
        piece[:] = image[y : y + PIECE, x : x + PIECE]
    return found


@compiled(nogil=True, fastmath={"reassoc", "contract", "nsz"})
def row_sums(pieces: Floats32) -> Floats:
    """Sum (piece, 12) over square pieces of a frame.

    Products of the slopes along x and y, of each with the alternating residual of a row against its
    neighbours, squares of that residual on rows of both parities, and squared differences of rows: next
    to each other from rows of both parities, and two apart; last, of some rows, squared differences of
    columns next to each other from columns of both parities.

    Parameters
    ----------
    pieces : array (piece, row, column)
        Grey levels.
    """
    count, rows, columns = pieces.shape
    sums = np.zeros((count, 12))
    # a bare number would turn every product into one of double width
    half, quarter, eighth = np.float32(0.5), np.float32(0.25), np.float32(0.125)
    for n in range(count):
        piece = pieces[n]
        for i in range(1, rows - 1):
            above, own, below = piece[i - 1], piece[i], piece[i + 1]
            odd = i % 2
            xx = xy = yy = xr = yr = rr = near = far = np.float32(0.0)
            for k in range(np.uint64(columns - 2)):
                j = k + np.uint64(1)
                before, after = k, k + np.uint64(2)
                residual = own[j] - half * (above[j] + below[j])
                across = eighth * (above[after] - above[before] + below[after] - below[before])
                across += quarter * (own[after] - own[before])
                down = half * (below[j] - above[j])
                xx += across * across
                xy += across * down
                yy += down * down
                xr += across * residual
                yr += down * residual
                rr += residual * residual
                near += (below[j] - own[j]) ** 2
                far += (below[j] - above[j]) ** 2
            sign = 1.0 if odd else -1.0
            sums[n, 0] += xx
            sums[n, 1] += xy
            sums[n, 2] += yy
            sums[n, 3] += sign * xr
            sums[n, 4] += sign * yr
            sums[n, 5 + odd] += rr
            sums[n, 7 + odd] += near
            sums[n, 9] += far
        for i in range(0, rows, 4):
            for m in range(columns - 1):
                sums[n, 10 + m % 2] += float((piece[i, m + 1] - piece[i, m]) ** 2)
    return sums


def read_rows(sums: list[Floats], *, is_first_still: bool) -> RowsSeen:
    """Tell what the rows of a film show.

    Parameters
    ----------
    sums : list of arrays (piece, 12)
        One for every frame, from :func:`row_sums`.
    is_first_still : bool
        Nothing moves in the first frame, so that what looks like a distance there is the steps of edges.
    """
    combed, apart = np.zeros(len(sums), bool), np.zeros(len(sums))
    repeated, distances = [], []
    is_sharp = False
    for k, one in enumerate(sums):
        distance, explained = _distance(one)
        distances.append(distance)
        is_shifted, has_teeth = _shows(one, distance, explained)
        if k == 0 and is_first_still:
            is_sharp = bool(is_shifted.any()) and not _are_enough(has_teeth)
        combed[k], apart[k] = _apart(distance, has_teeth if is_sharp else is_shifted | has_teeth, is_sharp=is_sharp)
        ratio = _parity(one)
        if ratio is not None:
            repeated.append(ratio)
    is_repeated = len(repeated) > 0 and bool(np.mean(repeated) > 1.0 - _SHARE)
    return RowsSeen(combed, apart, is_repeated, distances, is_sharp)


def _distance(sums: Floats) -> tuple[Floats, Floats]:
    """Distance (piece, 2) in px of the fields, and the squares (piece,) that it explains."""
    xx, xy, yy, xr, yr = sums[:, :5].T
    ridge = _RIDGE * (xx + yy) + 1e-9
    xx, yy = xx + ridge, yy + ridge
    determinant = xx * yy - xy**2
    dx, dy = (yy * xr - xy * yr) / determinant, (xx * yr - xy * xr) / determinant
    return np.stack([dx, dy], axis=1), dx * xr + dy * yr


def _shows(sums: Floats, distance: Floats, explained: Floats) -> tuple[Flags, Flags]:
    """Which pieces of a frame look shifted from row to row, and which have teeth."""
    pixels = float((PIECE - 2) ** 2)
    left = np.maximum((sums[:, 5] + sums[:, 6] - explained) / pixels, _ROUNDING)
    near, far = sums[:, 7] + sums[:, 8], sums[:, 9]
    is_shifted = (explained / left > _CLEAR) & (np.hypot(*distance.T) > _LEAST_APART)
    return np.asarray(is_shifted), np.asarray((near > _TEETH * far) & (near > _LEAST_SHOWN * pixels))


def _are_enough(shows: Flags) -> bool:
    """Tell whether so many pieces of a frame show something that the frame does."""
    return bool(len(shows)) and bool(shows.sum() >= min(_FEWEST, len(shows)) and shows.mean() >= _SHARE)


def _apart(distance: Floats, shows: Flags, *, is_sharp: bool) -> tuple[bool, float]:
    """Whether pieces of a frame show two instants, and how far (px) they are apart."""
    if _are_enough(shows):
        return True, float(np.median(np.hypot(*distance[shows].T)))
    if not is_sharp and any(_differ_from_zero(values) for values in distance.T):
        return True, float(np.hypot(*np.median(distance, axis=0)))
    return False, 0.0


def _differ_from_zero(values: Floats, significant: float = _SIGNIFICANT, shared: float = 0.0) -> bool:
    """Tell whether distances of pieces (px) have a common part beyond their scatter and a shared error."""
    if len(values) < _TOGETHER:
        return False
    error = math.hypot(_error_of_median(values), shared)
    return abs(float(np.median(values))) > max(_LEAST_TOGETHER, significant * error)


def _error_of_median(values: Floats) -> float:
    """Return the standard error of the median of distances (px)."""
    return _ERROR_OF_MEDIAN * float(np.median(np.abs(values - np.median(values)))) / math.sqrt(len(values))


def _parity(sums: Floats) -> bool | None:
    """Whether rows of one parity repeat the others, or are their means; None where nothing shows.

    Where columns repeat as well the image was magnified, or shows blocks, and its rows are right.
    """
    pixels = 0.5 * float((PIECE - 2) ** 2)
    bend, step, beside = (sums[:, k : k + 2] / pixels + _ROUNDING for k in (5, 7, 10))
    shown = step.max(axis=1) > _LEAST_SHOWN
    if not shown.any():
        return None
    by_step, by_bend, by_column = (np.median(np.log(pair[shown, 0] / pair[shown, 1])) for pair in (step, bend, beside))
    return bool((abs(by_step) > _REPEATED or abs(by_bend) > _MEAN_OF_OTHERS) and abs(by_column) < _REPEATED)

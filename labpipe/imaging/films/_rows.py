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
#: which they may; least and largest distance of the fields over that step: half of it, or all of it where
#: they are of two frames.
_MOVING, _CREEPING = 0.5, 0.04
_SHARES = (0.25, 1.3)
#: Rows of a piece that must show that rows repeat: a single edge along them lies between two of them. And
#: logarithm of the squared differences of columns over those of rows that repeat: of a sound film both
#: show its noise.
_ROWS, _BELOW_COLUMNS = 4.0, 0.8


@dataclass(frozen=True)
class RowsSeen:
    """What the rows of a film show.

    ``is_combed``: The frame shows two instants. In a film whose still frame has edges sharper than the pixels only
    teeth count, rows that differ more from their neighbours than from the next but one: the steps of such edges look
    like small distances, in random directions. Where the motion is known, only a distance along it counts that is
    some share of it. ``apart`` (frame,) [px]: Distance of what odd and even rows show, 0 where they show the same.
    ``is_repeated``: Every second row repeats its neighbour or is the mean of both. ``distances`` [px]: Distance of
    the fields in every piece of every frame. ``is_sharp``: The still frame has edges sharper than the pixels.
    ``still`` (2,) [px]: Distance in the still frame, median of the pieces; 0 where none is known to be still.
    ``order`` (frame,): -1 or 1 for frames whose fields are apart against the motion, or along it; 0 where nothing
    tells.
    """

    is_combed: Flags
    apart: Floats
    is_repeated: bool
    distances: list[Floats]
    is_sharp: bool
    still: Floats
    order: Floats

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
        Most frames that move show two instants then, in one order; or the fields are apart along the motion
        in all of them together, by a share of it and beyond what the still frame shows, whose own error all
        of them share.
        """
        length = np.hypot(*step.T)
        by_teeth = np.count_nonzero(self.is_combed & (self.order == 0.0))
        in_order = max(np.count_nonzero(self.is_combed & (self.order == sign)) for sign in (-1.0, 1.0))
        if by_teeth + in_order >= max(1.0, _MOST_FRAMES * np.count_nonzero(length > _MOVING)):
            return True
        chosen = np.flatnonzero((length > _CREEPING) & [len(one) > 0 for one in self.distances])
        if not len(chosen):
            return False
        shared = max(map(_error_of_median, self.distances[0].T)) if self.is_sharp else 0.0
        directions = [np.tile(step[k] / length[k], (len(self.distances[k]), 1)) for k in chosen]
        direction, distance = np.concatenate(directions), np.concatenate([self.distances[k] for k in chosen])
        lengths = np.concatenate([np.full(len(one), length[k]) for one, k in zip(directions, chosen, strict=True)])
        # Steps of edges may stay with the pixels, or move with the specimen.
        signs = set()
        for origin in (self.still, np.zeros(2)):
            along = ((distance - origin) * direction).sum(axis=1)
            share = float(np.median(along / lengths))
            is_share = _SHARES[0] < abs(share) < _SHARES[1]
            signs.add(np.sign(share) if is_share and _differ_from_zero(along, _SIGNIFICANT_ALONG, shared) else 0.0)
        return len(signs) == 1 and 0.0 not in signs


def is_inside(corners: NDArray[np.int64], shape: tuple[int, int]) -> Flags:
    """Tell which pieces (piece, 2), by first column and row, lie in an image of rows and columns."""
    rows, columns = shape
    return np.asarray((corners >= 0).all(axis=1) & (corners[:, 0] <= columns - PIECE) & (corners[:, 1] <= rows - PIECE))


def pieces_of(image: NDArray[np.generic], corners: NDArray[np.int64]) -> Floats32:
    """Copy the square pieces (piece, row, column) of an image that lie inside it.

    ``image`` (row, column): Grey levels. ``corners`` [px]: Column and row of the first pixel of each; the rows of all
    of them even, or odd.
    """
    rows, columns = image.shape
    inside = is_inside(corners, (rows, columns))
    found = np.empty((int(inside.sum()), PIECE, PIECE), np.float32)
    for piece, (x, y) in zip(found, corners[inside], strict=True):
        piece[:] = image[y : y + PIECE, x : x + PIECE]
    return found


@compiled(nogil=True, fastmath={"reassoc", "contract", "nsz"})
def row_sums(pieces: Floats32) -> Floats:
    """Sum (piece, 16) over square pieces of a frame.

    Products of the slopes along x and y, of each with the alternating residual of a row against its
    neighbours, squares of that residual on rows of both parities, and squared differences of rows: next
    to each other from rows of both parities, and two apart; of some rows, squared differences of columns
    next to each other from columns of both parities; last, squares of what single rows add to the squared
    residuals and to the squared differences, of both parities.

    Parameters
    ----------
    pieces : array (piece, row, column)
        Grey levels.
    """
    count, rows, columns = pieces.shape
    sums = np.zeros((count, 16))
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
            sums[n, 12 + odd] += rr * rr
            sums[n, 14 + odd] += near * near
        for i in range(0, rows, 4):
            for m in range(columns - 1):
                sums[n, 10 + m % 2] += float((piece[i, m + 1] - piece[i, m]) ** 2)
    return sums


def read_rows(sums: list[Floats], *, is_first_still: bool, steps: Floats | None = None) -> RowsSeen:
    """Tell what the rows of a film show.

    ``sums``: One for every frame, from :func:`row_sums`. ``is_first_still``: Nothing moves in the first frame, so
    that what looks like a distance there is the steps of edges. ``steps`` (frame, 2): Motion from frame to frame; NaN
    where it is not known.
    """
    combed, (apart, order) = np.zeros(len(sums), bool), np.zeros((2, len(sums)))
    frame = np.repeat(np.arange(len(sums)), [len(one) for one in sums])
    pieces = np.concatenate(sums)
    every = _see(pieces, None if steps is None else steps[frame])
    seen = [every.of(frame == k) for k in range(len(sums))]
    distances = [one.distance for one in seen]
    is_sharp = False
    if is_first_still:
        is_sharp = bool(_see(sums[0], None).is_shifted.any()) and not _are_enough(seen[0].has_teeth)
    for k, one in enumerate(seen):
        step = None if steps is None else steps[k]
        shows = one.has_teeth if is_sharp else one.has_teeth | one.shifted_alike(step)
        if _are_enough(shows):
            combed[k], apart[k] = True, float(np.median(np.hypot(*one.distance[shows].T)))
        elif not is_sharp and any(_differ_from_zero(values) for values in one.along):
            combed[k], apart[k] = True, float(np.hypot(*np.median(one.distance, axis=0)))
        if combed[k] and step is not None and not _are_enough(one.has_teeth):
            order[k] = np.sign(np.median(one.along))
    tells, repeats = _repeat(pieces, frame, len(sums))
    # one field's rows are the same throughout; of a scene with edges along the rows any
    is_repeated = bool(tells.any()) and any(np.mean(repeats[tells] == way) > 1.0 - _SHARE for way in (-1.0, 1.0))
    still = np.median(distances[0], axis=0) if is_first_still and len(distances[0]) else np.zeros(2)
    return RowsSeen(combed, apart, is_repeated, distances, is_sharp, still, order)


@dataclass(frozen=True)
class _FieldsSeen:
    """Distance of the fields (piece, 2) [px], that along x and y or along the motion, and what shows it."""

    distance: Floats
    along: list[Floats]
    is_shifted: Flags
    has_teeth: Flags

    def of(self, chosen: Flags) -> "_FieldsSeen":
        """Return the same of some pieces."""
        along = [values[chosen] for values in self.along]
        return _FieldsSeen(self.distance[chosen], along, self.is_shifted[chosen], self.has_teeth[chosen])

    def shifted_alike(self, step: Floats | None) -> Flags:
        """Which pieces are shifted; along a known motion (2,) only where it is a share of it in the middle of all."""
        if step is None or not self.is_shifted.any():
            return self.is_shifted
        middle = float(np.median(self.along[0]))
        is_share = _SHARES[0] * np.hypot(*step) < abs(middle) < _SHARES[1] * np.hypot(*step)
        return self.is_shifted & (self.along[0] * middle > 0.0) & bool(is_share)


def _see(sums: Floats, step: Floats | None) -> _FieldsSeen:
    """See how the fields are apart in pieces, by a share of their steps (piece, 2) where these are given."""
    xx, xy, yy, xr, yr = sums[:, :5].T
    ridge = _RIDGE * (xx + yy) + 1e-9
    xx, yy = xx + ridge, yy + ridge
    determinant = xx * yy - xy**2
    dx, dy = (yy * xr - xy * yr) / determinant, (xx * yr - xy * xr) / determinant
    distance = np.stack([dx, dy], axis=1)
    explained, along, is_apart = dx * xr + dy * yr, [dx, dy], np.hypot(dx, dy) > _LEAST_APART
    if step is not None:
        length = np.hypot(*step.T)
        x, y = (step / np.where(length > _CREEPING, length, np.nan)[:, None]).T
        shown = (x * xr + y * yr) / (x * x * xx + 2.0 * x * y * xy + y * y * yy)
        explained, along = (x * xr + y * yr) * shown, [shown]
        size = np.abs(shown)
        is_apart = (size > _LEAST_APART) & (size > _SHARES[0] * length) & (size < _SHARES[1] * length)
    pixels = float((PIECE - 2) ** 2)
    left = np.maximum((sums[:, 5] + sums[:, 6] - explained) / pixels, _ROUNDING)
    near, far = sums[:, 7] + sums[:, 8], sums[:, 9]
    has_teeth = np.asarray((near > _TEETH * far) & (near > _LEAST_SHOWN * pixels))
    return _FieldsSeen(distance, along, np.asarray((explained / left > _CLEAR) & is_apart), has_teeth)


def _are_enough(shows: Flags) -> bool:
    """Tell whether so many pieces of a frame show something that the frame does."""
    return bool(len(shows)) and bool(shows.sum() >= min(_FEWEST, len(shows)) and shows.mean() >= _SHARE)


def _differ_from_zero(values: Floats, significant: float = _SIGNIFICANT, shared: float = 0.0) -> bool:
    """Tell whether distances of pieces (px) have a common part beyond their scatter and a shared error."""
    if len(values) < _TOGETHER:
        return False
    middle = abs(float(np.median(values)))
    return middle > _LEAST_TOGETHER and middle > significant * math.hypot(_error_of_median(values), shared)


def _error_of_median(values: Floats) -> float:
    """Return the standard error of the median of distances (px)."""
    return _ERROR_OF_MEDIAN * float(np.median(np.abs(values - np.median(values)))) / math.sqrt(len(values))


def _repeat(sums: Floats, frame: NDArray[np.int64], count: int) -> tuple[Flags, Floats]:
    """Which frames show how rows differ, and in which rows repeat the others, or are their means: even (1), odd (-1).

    Many rows must show it: edges along the rows lie between some two of them. Where columns repeat as well
    the image was magnified, or shows blocks, and its rows are right.
    """
    pixels = 0.5 * float((PIECE - 2) ** 2)
    bend, step, beside = (sums[:, k : k + 2] / pixels + _ROUNDING for k in (5, 7, 10))
    tells, repeats = np.zeros(count, bool), np.zeros(count)
    for pair, squares, least in ((step, sums[:, 14:16], _REPEATED), (bend, sums[:, 12:14], _MEAN_OF_OTHERS)):
        loud = pair.max(axis=1) - _ROUNDING
        shown = (step.max(axis=1) > _LEAST_SHOWN) & ((loud * pixels) ** 2 > _ROWS * squares.max(axis=1))
        beyond = shown & (np.abs(np.log(pair[:, 0] / pair[:, 1])) > least)
        number, of_them = (np.bincount(frame[chosen], minlength=count) for chosen in (shown, beyond))
        tells |= number > 0
        # a median lies beyond where half of the pieces do
        for k in np.flatnonzero((2 * of_them >= number) & (number > 0)).tolist():
            own = shown & (frame == k)
            quiet = beside[frame == k].min() / np.median(pair[own].min(axis=1))
            ratio = _middle_ratio(pair[own])
            if abs(ratio) > least and abs(_middle_ratio(beside[own])) < _REPEATED and math.log(quiet) > _BELOW_COLUMNS:
                repeats[k] = -np.sign(ratio)
    return tells, repeats


def _middle_ratio(pair: Floats) -> float:
    """Median of the logarithms of ratios of pairs (piece, 2)."""
    return float(np.median(np.log(pair[:, 0] / pair[:, 1])))

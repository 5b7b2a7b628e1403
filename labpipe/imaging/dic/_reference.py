"""The reference of image correlation: the mean of the frames before anything moves."""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats32
from labpipe.errors import InputError
from labpipe.frames import FrameSource
from labpipe.imaging.dic._film_window import smooth
from labpipe.imaging.dic._growth import NO_GROWTH, Growth
from labpipe.imaging.dic._inputs import LEAST_SUBSET
from labpipe.imaging.dic._motion_uncertainty import NoiseModel
from labpipe.imaging.dic._pattern import Pattern, Patterns, make_pattern, sums_over
from labpipe.imaging.dic._periodic import find_repeats
from labpipe.imaging.dic._seeding import Pyramid, make_pyramid
from labpipe.imaging.dic._subsets import Images, Subsets

#: Share of pixels at black or white from which a subset counts as saturated.
_SATURATED_SHARE = 0.5
#: A weak pattern (standard deviation below this share of the grey range) that does not resemble
#: itself one pixel further may be noise.
_WEAK_CONTRAST = 0.03
_NOISE_LIKENESS = 0.2
#: Best standard deviation of the motion (px) that rounding to whole levels must allow.
_WORST_RESOLUTION = 0.1
_ROUNDING = 1.0 / np.sqrt(12.0)
#: Steps (column, row) along which the image is compared with itself.
_STEPS = ((1, 0), (0, 1), *((i, sign * k) for i, k in ((1, 1), (2, 1), (1, 2)) for sign in (1, -1)))
#: Median of the size of third differences of white noise of deviation 1.
_MEDIAN_OF_CHANGES = 20.0**0.5 * 0.6745
#: Relative variance of the variance of white noise that this median tells, times the pixels.
_SPREAD_OF_CHANGES = 12.0
#: Points whose differences are put in order at once; bounds the work arrays to some 10 MB.
_BLOCK = 1024
#: Share of the range of an image of real numbers that counts as its rounding.
_FINEST = 1e-6
#: Reach (px) of the mirrored image in the slopes at the border of the frame.
_FRAME_BORDER = 3


class Status(IntEnum):
    """Why a point of a frame has a value or none."""

    OK = 0
    OUTSIDE = 1  # the subset is not wholly inside the frame
    SATURATED = 2  # too many pixels at the black or white level in the reference
    TEXTURELESS = 3  # nothing but noise or misfit, or edges in one direction only
    FRAME_DAMAGED = 4  # the file says so, or the frame holds NaN
    LOST = 5  # no place in the frame correlates well enough, or several do as well as each other
    OUTVOTED = 6  # its neighbours agree on another place
    COVERED = 7  # the mask leaves too few of its pixels
    INTERLACED = 8  # the rows of the frame show two instants, or repeat each other


@dataclass(frozen=True)
class Reference:
    """What every frame is compared with.

    Attributes
    ----------
    pattern : Pattern
        What frames of the same blur are matched with: subsets of the usable points only.
    patterns : Patterns
        The same for frames of another blur.
    usable : integer array
        Their numbers among all points.
    offset : array (usable, 2) [px]
        From the subset's centre pixel to the point.
    status : array (point,)
        :class:`Status` of every point in the reference itself.
    pyramid : Pyramid
        For seeds.
    mean : array (row, column)
        Mean of the static frames, not blurred.
    period : array (usable,) [px]
        Shortest displacement in which the pattern matches itself; infinite where it does not.
    is_faint : bool array (usable,)
        What may be noise alone, which only frames tell that show it again.
    rounding : float [grey²]
        Variance of a pixel from rounding.
    """

    pattern: Pattern
    patterns: Patterns
    usable: NDArray[np.int64]
    offset: NDArray[np.float64]
    status: NDArray[np.int8]
    pyramid: Pyramid
    mean: NDArray[np.float64]
    period: NDArray[np.float64]
    is_faint: NDArray[np.bool_]
    rounding: float

    @property
    def subsets(self) -> Subsets:
        """Subsets of the usable points."""
        return self.pattern.subsets

    @property
    def images(self) -> Images:
        """The reference itself."""
        return self.pattern.images

    @property
    def noise(self) -> NoiseModel:
        """How noise shows in frames of the same blur."""
        return self.pattern.noise

    def own_noise(self, point: int, static: NDArray[np.float64]) -> tuple[float, float]:
        """Variance of a pixel around a usable point in one frame without any misfit, and how well it is known.

        ``static``: (static frame,) [grey²], as its residual in the static frames shows it.

        Returns ``variance``: float [grey²]; ``spread``: float [1], relative variance of that, times the
        number of pixels.

        Notes
        -----
        A single static frame is the reference itself and shows none. Then third differences of the
        image tell it, by steps that lead along the weakest direction: along an edge or the lines of a
        grating, noise is all that changes. Their median leaves out what else there is.
        """
        shown = static[np.isfinite(static) & (static > 0.0)]
        if len(shown):
            return float(shown.mean()), 2.0 / len(shown)
        return max((float(self._changes[point]) / _MEDIAN_OF_CHANGES) ** 2, self.rounding), _SPREAD_OF_CHANGES

    @cached_property
    def _changes(self) -> NDArray[np.float64]:
        """Median (usable,) [grey] of the size of third differences along the step nearest to the weakest direction."""
        image = self.mean if self.images.inside is None else np.where(self.images.inside == 0.0, np.nan, self.mean)
        result = np.zeros(len(self.subsets))
        weakest = np.array([self.weakest_slopes(n) for n in range(len(self.subsets))])
        away = [np.abs(right * np.sin(weakest) - down * np.cos(weakest)) for right, down in _STEPS]
        nearest = np.argmin(away, axis=0)
        for k, half in np.unique(np.stack([nearest, self.subsets.half], axis=1), axis=0).tolist():
            right, down = _STEPS[k]
            change = np.abs(_third_difference(image[:, ::-1] if down < 0 else image, (right, abs(down))))
            alike = np.flatnonzero((nearest == k) & (self.subsets.half == half))
            size = max(2 * half + 1 - 3 * abs(down), 1), max(2 * half + 1 - 3 * right, 1)
            windows = np.lib.stride_tricks.sliding_window_view(change, size)
            first = image.shape[1] - 1 - self.subsets.x if down < 0 else self.subsets.x
            for some in np.array_split(alike, math.ceil(len(alike) / _BLOCK)):
                seen = windows[self.subsets.y[some] - half, first[some] - half].reshape(len(some), -1)
                is_seen = np.isfinite(seen)
                whole, partly = is_seen.all(axis=1), is_seen.any(axis=1)
                result[some[whole]] = np.median(seen[whole], axis=1)
                result[some[partly & ~whole]] = np.nanmedian(seen[partly & ~whole], axis=1)
        return result

    @cached_property
    def sharp(self) -> tuple[NDArray[np.float64], float]:
        """See :func:`near_half`."""
        return near_half(self)

    @cached_property
    def sharp_sums(self) -> tuple[NDArray[np.float64], float]:
        """Sums (usable,) of these squares, and the variance of noise in each."""
        squares, of_noise = self.sharp
        return self.sums(squares), of_noise

    @cached_property
    def sharper(self) -> tuple[NDArray[np.float64], float]:
        """The same of twice the order."""
        return near_half(self, 8)

    @cached_property
    def most_noise(self) -> NDArray[np.float64]:
        """Variance (usable,) [grey²] of a pixel of one frame at most, of white noise, as nearest to half a wave."""
        sharper, of_noise = self.sharper
        return np.maximum(self.sums(sharper) / (of_noise * self.subsets.level[:, 2]), self.rounding)

    def weakest_slopes(self, point: int) -> float:
        """Direction (rad, from x towards y) in which the slopes around a usable point are least."""
        slopes = self.subsets.normal[point]
        return 0.5 * (math.atan2(2.0 * slopes[0, 3], slopes[0, 0] - slopes[3, 3]) + math.pi)

    def sums(self, image: NDArray[Any]) -> NDArray[np.float64]:
        """Sum an image (row, column) over what counts of every subset, (usable,)."""
        return sums_over(image if self.images.inside is None else image * self.images.inside, self.subsets)


def near_half(reference: Reference, order: int = 4) -> tuple[NDArray[np.float64], float]:
    """Squares [grey²] of the reference near half a wave per px, along x and along y, (row, column).

    Also the variance there of white noise of variance 1 in each of the static frames. They are the
    differences of an even order over what it makes of half a wave per px: the higher, the nearer to it.
    """
    import cv2

    weights = np.array([(-1.0) ** k * math.comb(order, k) for k in range(order + 1)]) / 2.0**order

    total = np.zeros(reference.mean.shape)
    nothing = np.ones(1)
    for along_x, along_y in ((weights, nothing), (nothing, weights)):
        total += cv2.sepFilter2D(reference.mean, cv2.CV_64F, along_x, along_y, borderType=cv2.BORDER_REFLECT_101) ** 2
    return total, 2.0 * float((weights**2).sum()) / reference.noise.static_frames


def _third_difference(area: NDArray[np.float64], step: tuple[int, int]) -> NDArray[np.float64]:
    """Third difference (row, column) along a step of whole columns and rows, none of them negative."""
    across, down = step
    for _ in range(3):
        rows, columns = area.shape
        area = area[down:, across:] - area[: max(rows - down, 0), : max(columns - across, 0)]
    return area


def average_static_frames(frames: FrameSource, count: int) -> tuple[NDArray[np.float64], int, bool]:
    """Mean of the undamaged ones of the first ``count`` frames.

    Returns
    -------
    mean : array (row, column)
        Grey levels.
    used : int
        How many frames were averaged.
    is_integer : bool
        Whether they hold whole grey levels.

    Raises
    ------
    InputError
        All of them are damaged.
    """
    _, rows, columns = frames.shape
    total = np.zeros((rows, columns))
    used = 0
    is_integer = True
    valid = frames.valid
    for index in range(count):
        if not valid[index]:
            continue
        image = frames[index]
        if image.ndim != 2:
            message = f"grey images are needed, frame {index} has shape {image.shape}"
            raise InputError(message)
        if image.dtype.kind == "f" and not np.isfinite(image).all():
            continue
        total += image
        used += 1
        is_integer &= image.dtype.kind in "iu"
    if not used:
        message = (
            f"no reference: all of the first {count} frames are damaged; start the film later "
            "or take more static frames"
        )
        raise InputError(message)
    return total / used, used, is_integer


def make_reference(
    frames: FrameSource,
    points: NDArray[np.float64],
    half: NDArray[np.int64],
    is_rigid: NDArray[np.bool_],
    order: int,
    static_frames: int,
    blur: float,
    inside: Floats32 | None = None,
) -> Reference:
    """Average the static frames and cut the subsets that can be used.

    ``frames``: the film; ``points``: (point, 2) [px], points (x, y); ``half``: integer (point,) [px], half widths
    of the subsets; ``is_rigid``: bool (point,), motion allowed; ``order``: spline order; ``static_frames``:
    frames at the start in which nothing moves; ``blur``: float [px], gaussian blur; ``inside``: float32 (row,
    column), optional, 0 where a mask covers the first frame.
    """
    mean, used, is_integer = average_static_frames(frames, static_frames)
    grey = smooth(mean, blur)
    centres = np.rint(points).astype(np.int64)
    rows, columns = grey.shape
    status = np.zeros(len(points), np.int8)
    low, high = centres - half[:, None], centres + half[:, None]
    is_outside = (low < 0).any(axis=1) | (high >= np.array([columns, rows])).any(axis=1)
    status[is_outside] = Status.OUTSIDE
    usable = np.flatnonzero(~is_outside)
    # Slopes at the border are those of the mirrored image: along a bare edge they would be texture.
    margin = min(
        int(low[usable].min(initial=rows)), int((np.array([columns, rows]) - 1 - high[usable]).min(initial=rows))
    )
    if margin < _FRAME_BORDER:
        inside = np.ones_like(grey) if inside is None else inside.copy()
        for side in (inside, inside.T):
            side[:_FRAME_BORDER] = side[-_FRAME_BORDER:] = 0.0
    rounding = _ROUNDING**2 if is_integer else (_FINEST * float(np.ptp(mean))) ** 2

    def cut(chosen: NDArray[np.int64], growth: Growth = NO_GROWTH) -> Pattern:
        own = centres[chosen], half[chosen], is_rigid[chosen]
        return make_pattern(grey, order, blur, used, *own, inside, rounding, growth)

    pattern = cut(usable)
    subsets = pattern.subsets
    counted = mean if inside is None else _filled_up(mean, inside)
    found = _reference_status(counted, subsets, frames.levels if is_integer else None)
    repeats = find_repeats(counted, subsets.layout)
    found[repeats.is_folded & (found == Status.OK)] = Status.TEXTURELESS
    found[subsets.level[:, 2] < LEAST_SUBSET**2] = Status.COVERED
    status[usable] = found
    period = repeats.period[found == Status.OK]
    is_faint = _may_be_noise(counted, subsets, frames.levels if is_integer else None)[found == Status.OK]
    if found.any():
        usable = usable[found == Status.OK]
        pattern = cut(usable)
    return Reference(
        pattern,
        Patterns(lambda growth: cut(usable, growth) if growth != NO_GROWTH else pattern),
        usable,
        points[usable] - centres[usable],
        status,
        make_pyramid(grey if inside is None else _filled_up(grey, inside)),
        mean,
        period,
        is_faint,
        rounding,
    )


def _filled_up(image: NDArray[Any], inside: Floats32) -> NDArray[Any]:
    """Image with the mean of what counts where a mask covers it: neither pattern nor clipped."""
    counts = inside > 0.0
    return np.where(counts, image, image[counts].mean() if counts.any() else 0.0).astype(image.dtype)


def _reference_status(
    mean: NDArray[np.float64], subsets: Subsets, levels: tuple[float, float] | None
) -> NDArray[np.int8]:
    """Tell saturated and textureless subsets from usable ones; levels of integer images only."""
    status = np.zeros(len(subsets), np.int8)
    variance = np.maximum(subsets.inverse[:, 0, 0], subsets.inverse[:, 3, 3])
    floor = _ROUNDING if levels else 0.0
    is_blind = (variance <= 0.0) | (floor * np.sqrt(variance) > _WORST_RESOLUTION)
    status[is_blind] = Status.TEXTURELESS
    if levels is not None:
        for clipped in (mean >= levels[1] - 0.5, mean <= levels[0] + 0.5):
            if clipped.any():
                status[_share(clipped, subsets) > _SATURATED_SHARE] = Status.SATURATED
    return status


def _share(flags: NDArray[np.bool_], subsets: Subsets) -> NDArray[np.float64]:
    """Share of flagged pixels among those of every subset that count."""
    return np.asarray(sums_over(flags, subsets) / np.maximum(subsets.level[:, 2], 1.0))


def _may_be_noise(mean: NDArray[np.float64], subsets: Subsets, levels: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Tell subsets of a weak pattern without likeness between neighbouring pixels."""
    span = levels[1] - levels[0] if levels else float(np.ptp(mean))
    contrast = np.sqrt(subsets.level[:, 1] / np.maximum(subsets.level[:, 2], 1.0))
    result = contrast < _WEAK_CONTRAST * span
    for n in np.flatnonzero(result):
        x, y, half = subsets.layout[n, :3]
        area = mean[y - half : y + half + 1, x - half : x + half + 1]
        change = area - area.mean()
        along = max(float((change[:, 1:] * change[:, :-1]).mean()), float((change[1:] * change[:-1]).mean()))
        result[n] = along < _NOISE_LIKENESS * float((change**2).mean())
    return result

"""The reference of image correlation: the mean of the frames before anything moves."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.errors import InputError
from labpipe.frames import FrameSource
from labpipe.imaging.dic._aperture_problem import slopes_of_edges
from labpipe.imaging.dic._arguments import LEAST_SUBSET
from labpipe.imaging.dic._film_window import smooth
from labpipe.imaging.dic._periodic_ambiguity import best_repetition
from labpipe.imaging.dic._seeding import Pyramid, make_pyramid
from labpipe.imaging.dic._spline import node_gradients, prefilter
from labpipe.imaging.dic._subsets import Subsets, cut_subsets
from labpipe.imaging.dic._uncertainty import NoiseModel

#: Share of pixels at black or white from which a subset counts as saturated.
_SATURATED_SHARE = 0.5
#: Best standard deviation of the motion (px) that rounding to whole levels must allow.
_WORST_RESOLUTION = 0.1
#: A weak pattern (standard deviation below this share of the grey range) that does not correlate with
#: itself one pixel further is noise, not texture.
_WEAK_CONTRAST, _NOISE_CORRELATION = 0.03, 0.2


class Status(IntEnum):
    """Reason why a point of a frame has a value or none."""

    OK = 0
    OUTSIDE = 1  # the subset is not wholly inside the frame
    SATURATED = 2  # too many pixels at the black or white level in the reference
    TEXTURELESS = 3  # nothing but noise, or edges in one direction only
    FRAME_DAMAGED = 4  # the file says so, or the frame holds NaN
    LOST = 5  # no place in the frame correlates well enough, or nothing supports the one that does
    OUTVOTED = 6  # its neighbours agree on another place
    COVERED = 7  # the masks leave too few of its pixels
    PERIODIC = 8  # the pattern repeats itself, and the match is no better than the repetition
    OCCLUDED = 9  # something that nobody stated hides a part of the subset


@dataclass(frozen=True)
class Reference:
    """Everything that frames are compared with.

    Attributes
    ----------
    images : float32 arrays (row, column)
        Grey levels, slopes in x and in y.
    inside : bool array (row, column) or None
        Pixels that count.
    subsets : Subsets
        Those of the usable points only.
    usable : integer array
        Their numbers among all points.
    offset : array (usable, 2) [px]
        From the subset's centre pixel to the point.
    status : array (point,)
        :class:`Status` of every point in the reference itself.
    noise : NoiseModel
        For the uncertainties.
    smoothing, edges : arrays (usable,)
        See :func:`.covariance`.
    repetition : array (usable,) [1]
        See :func:`.best_repetition`.
    """

    images: tuple[Floats32, Floats32, Floats32]
    inside: Flags | None
    subsets: Subsets
    usable: Integers
    offset: Floats
    status: NDArray[np.int8]
    noise: NoiseModel
    smoothing: Floats
    edges: Floats
    repetition: Floats

    @cached_property
    def pyramid(self) -> Pyramid:
        """The reference, to be found in whole frames; pixels that do not count have the mean of those that do."""
        grey, inside = self.images[0], self.inside
        if inside is not None:
            grey = np.where(inside, grey, grey[inside].mean() if inside.any() else 0.0)
        return make_pyramid(np.asarray(grey, np.float32))

    def partly_hidden(self, chosen: Integers, visible: Sequence[Flags]) -> Subsets:
        """Cut chosen subsets anew from the pixels (row, column) of each that are visible."""
        own = self.subsets
        layout = own.layout[chosen]
        return cut_subsets(*self.images, layout[:, :2], layout[:, 2], own.shape[chosen], self.inside, visible)


def average_static_frames(frames: FrameSource, count: int) -> tuple[Floats, int, bool]:
    """Mean of the undamaged ones of the first ``count`` frames.

    Returns
    -------
    mean : array (row, column)
        Grey levels.
    used : int
        Frames that were averaged.
    is_integer : bool
        All of them hold whole grey levels.

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
    points: Floats,
    half: Integers,
    shape: NDArray[np.int8],
    order: int,
    static_frames: int,
    blur: float,
    inside: Flags | None = None,
) -> Reference:
    """Average the static frames and cut the subsets that can be used.

    Parameters
    ----------
    frames : FrameSource
        The film.
    points : array (point, 2) [px]
        Points (x, y).
    half : integer array (point,) [px]
        Half widths of the subsets.
    shape : int8 array (point,)
        Shape of each subset.
    order : 3 or 5
        Spline order.
    static_frames : int
        Frames at the start in which nothing moves.
    blur : float [px]
        Gaussian blur.
    inside : bool array (row, column), optional
        Pixels that count; by default all.
    """
    mean, used, is_integer = average_static_frames(frames, static_frames)
    grey = smooth(mean, blur)
    coefficients = prefilter(grey, order)
    images = (grey, *node_gradients(coefficients, order))
    centres = np.rint(points).astype(np.int64)
    rows, columns = grey.shape
    status = np.zeros(len(points), np.int8)
    low, high = centres - half[:, None], centres + half[:, None]
    is_outside = (low < 0).any(axis=1) | (high >= np.array([columns, rows])).any(axis=1)
    status[is_outside] = Status.OUTSIDE
    usable = np.flatnonzero(~is_outside)
    subsets = cut_subsets(*images, centres[usable], half[usable], shape[usable], inside)
    found = _status_in_reference(mean, subsets, frames.levels if is_integer else None)
    status[usable] = found
    if found.any():
        usable = usable[found == Status.OK]
        subsets = cut_subsets(*images, centres[usable], half[usable], shape[usable], inside)
    # The noise of the motion is that of the slopes blurred once more.
    squares = images[1] ** 2 + images[2] ** 2
    blurred = smooth(images[1], blur) ** 2 + smooth(images[2], blur) ** 2
    smoothing = _sums_over(blurred, subsets) / np.maximum(_sums_over(squares, subsets), 1e-30)
    return Reference(
        images,
        inside,
        subsets,
        usable,
        points[usable] - centres[usable],
        status,
        NoiseModel.of(order, blur, used),
        smoothing,
        slopes_of_edges(subsets),
        best_repetition(grey, coefficients, order, subsets),
    )


def _status_in_reference(mean: Floats, subsets: Subsets, levels: tuple[float, float] | None) -> NDArray[np.int8]:
    """Tell saturated, textureless and covered subsets from usable ones; levels of integer images only."""
    status = np.zeros(len(subsets), np.int8)
    inverse = subsets.inverse
    variance = np.maximum(inverse[:, 0, 0], inverse[:, 3, 3])
    rounding = np.sqrt(1.0 / 12.0) if levels else 0.0
    is_blind = (inverse[:, 0, 0] <= 0.0) | (rounding * np.sqrt(np.maximum(variance, 0.0)) > _WORST_RESOLUTION)
    status[is_blind] = Status.TEXTURELESS
    span = levels[1] - levels[0] if levels else float(np.ptp(mean))
    contrast = np.sqrt(subsets.level[:, 1] / np.maximum(subsets.level[:, 2], 1.0))
    for n in np.flatnonzero(contrast < _WEAK_CONTRAST * span):
        x, y, reach = subsets.layout[n, :3]
        area = mean[y - reach : y + reach + 1, x - reach : x + reach + 1]
        change = area - area.mean()
        along = max(float((change[:, 1:] * change[:, :-1]).mean()), float((change[1:] * change[:-1]).mean()))
        if along <= _NOISE_CORRELATION * float((change**2).mean()):
            status[n] = Status.TEXTURELESS
    if levels is not None:
        for clipped in (mean >= levels[1] - 0.5, mean <= levels[0] + 0.5):
            if clipped.any():
                share = _sums_over(clipped, subsets) / np.maximum(subsets.level[:, 2], 1.0)
                status[share > _SATURATED_SHARE] = Status.SATURATED
    status[subsets.level[:, 2] < LEAST_SUBSET**2] = Status.COVERED
    return status


def _sums_over(image: NDArray[Any], subsets: Subsets) -> Floats:
    """Sum of an image (row, column) over every subset (point,), from a table of sums."""
    import cv2

    table = cv2.integral(np.asarray(image, np.float32))
    x, y, half = subsets.layout[:, :3].T
    low_x, high_x, low_y, high_y = x - half, x + half + 1, y - half, y + half + 1
    return np.asarray(table[high_y, high_x] - table[low_y, high_x] + table[low_y, low_x] - table[high_y, low_x])

"""The reference of image correlation: the mean of the frames before anything moves."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats32
from labpipe.errors import InputError
from labpipe.frames import FrameSource
from labpipe.imaging.dic._film_window import smooth
from labpipe.imaging.dic._motion_uncertainty import COARSE, NoiseModel, make_noise_model
from labpipe.imaging.dic._seeding import Pyramid, make_pyramid
from labpipe.imaging.dic._spline import node_gradients, prefilter
from labpipe.imaging.dic._subset_solver import Subsets, cut_subsets

#: Share of pixels at black or white from which a subset counts as saturated.
_SATURATED_SHARE = 0.5
#: A weak pattern (standard deviation below this share of the grey range) that does not resemble
#: itself one pixel further is noise, not texture.
_WEAK_CONTRAST = 0.03
_NOISE_LIKENESS = 0.2
#: Best standard deviation of the motion (px) that rounding to whole levels must allow.
_WORST_RESOLUTION = 0.1
_ROUNDING = 1.0 / np.sqrt(12.0)


class Status(IntEnum):
    """Why a point of a frame has a value or none."""

    OK = 0
    OUTSIDE = 1  # the subset is not wholly inside the frame
    SATURATED = 2  # too many pixels at the black or white level in the reference
    TEXTURELESS = 3  # nothing but noise, or edges in one direction only
    FRAME_DAMAGED = 4  # the file says so, or the frame holds NaN
    LOST = 5  # no place in the frame correlates well enough
    OUTVOTED = 6  # its neighbours agree on another place


@dataclass(frozen=True)
class Reference:
    """What every frame is compared with.

    Attributes
    ----------
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
    pyramid : Pyramid
        For seeds.
    """

    subsets: Subsets
    usable: NDArray[np.int64]
    offset: NDArray[np.float64]
    status: NDArray[np.int8]
    noise: NoiseModel
    pyramid: Pyramid


def average_static_frames(frames: FrameSource, count: int) -> tuple[NDArray[np.float64], int]:
    """Mean of the undamaged ones of the first ``count`` frames.

    Returns
    -------
    mean : array (row, column)
        Grey levels.
    used : int
        How many frames were averaged.

    Raises
    ------
    InputError
        All of them are damaged.
    """
    _, rows, columns = frames.shape
    total = np.zeros((rows, columns))
    used = 0
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
    if not used:
        message = (
            f"no reference: all of the first {count} frames are damaged; start the film later "
            "or take more static frames"
        )
        raise InputError(message)
    return total / used, used


def make_reference(
    frames: FrameSource,
    points: NDArray[np.float64],
    half: NDArray[np.int64],
    is_rigid: NDArray[np.bool_],
    order: int,
    static_frames: int,
    blur: float,
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
    is_rigid : bool array (point,)
        Motion allowed.
    order : 3 or 5
        Spline order.
    static_frames : int
        Frames at the start in which nothing moves.
    blur : float [px]
        Gaussian blur.
    """
    mean, used = average_static_frames(frames, static_frames)
    grey = smooth(mean, blur)
    gradient_x, gradient_y = node_gradients(prefilter(grey, order), order)
    centres = np.rint(points).astype(np.int64)
    rows, columns = grey.shape
    status = np.zeros(len(points), np.int8)
    low, high = centres - half[:, None], centres + half[:, None]
    is_outside = (low < 0).any(axis=1) | (high >= np.array([columns, rows])).any(axis=1)
    status[is_outside] = Status.OUTSIDE
    usable = np.flatnonzero(~is_outside)
    subsets = _cut(grey, gradient_x, gradient_y, centres, half, is_rigid, usable)
    is_integer = frames[0].dtype.kind in "iu"
    found = _reference_status(mean, subsets, frames.levels if is_integer else None)
    status[usable] = found
    if found.any():
        usable = usable[found == Status.OK]
        subsets = _cut(grey, gradient_x, gradient_y, centres, half, is_rigid, usable)
    smoothing = np.ones(len(usable))
    if blur > 0.0:
        # The noise of the motion is that of the slopes blurred once more.
        slopes = smooth(gradient_x, blur), smooth(gradient_y, blur)
        twice = _cut(grey, *slopes, centres, half, is_rigid, usable).normal
        normal = subsets.normal
        smoothing = (twice[:, 0, 0] + twice[:, 3, 3]) / (normal[:, 0, 0] + normal[:, 3, 3])
    slopes = smooth(gradient_x, COARSE), smooth(gradient_y, COARSE)
    coarse = _cut(smooth(grey, COARSE), *slopes, centres, half, is_rigid, usable).normal
    return Reference(
        subsets,
        usable,
        points[usable] - centres[usable],
        status,
        make_noise_model(order, blur, used, smoothing, subsets, coarse),
        make_pyramid(grey),
    )


def _cut(
    grey: Floats32,
    gradient_x: Floats32,
    gradient_y: Floats32,
    centres: NDArray[np.int64],
    half: NDArray[np.int64],
    is_rigid: NDArray[np.bool_],
    chosen: NDArray[np.int64],
) -> Subsets:
    """Cut the subsets of chosen points."""
    return cut_subsets(grey, gradient_x, gradient_y, centres[chosen], half[chosen], is_rigid[chosen])


def _reference_status(
    mean: NDArray[np.float64], subsets: Subsets, levels: tuple[float, float] | None
) -> NDArray[np.int8]:
    """Tell saturated and textureless subsets from usable ones; levels of integer images only."""
    status = np.zeros(len(subsets), np.int8)
    variance = np.maximum(subsets.inverse[:, 0, 0], subsets.inverse[:, 3, 3])
    floor = _ROUNDING if levels else 0.0
    is_blind = (variance <= 0.0) | (floor * np.sqrt(variance) > _WORST_RESOLUTION)
    status[is_blind] = Status.TEXTURELESS
    span = levels[1] - levels[0] if levels else float(np.ptp(mean))
    contrast = np.sqrt(subsets.level[:, 1]) / (2 * subsets.half + 1)
    for n in np.flatnonzero(contrast < _WEAK_CONTRAST * span):
        x, y, half = subsets.layout[n, :3]
        if _is_noise(mean[y - half : y + half + 1, x - half : x + half + 1]):
            status[n] = Status.TEXTURELESS
    if levels is not None:
        for clipped in (mean >= levels[1] - 0.5, mean <= levels[0] + 0.5):
            if clipped.any():
                status[_share(clipped, subsets) > _SATURATED_SHARE] = Status.SATURATED
    return status


def _share(flags: NDArray[np.bool_], subsets: Subsets) -> NDArray[np.float64]:
    """Share of flagged pixels in every subset, from a table of sums."""
    table = np.zeros((flags.shape[0] + 1, flags.shape[1] + 1), np.int64)
    table[1:, 1:] = flags.cumsum(axis=0).cumsum(axis=1)
    x, y, half = subsets.layout[:, :3].T
    low_x, high_x, low_y, high_y = x - half, x + half + 1, y - half, y + half + 1
    count = table[high_y, high_x] - table[low_y, high_x]
    count += table[low_y, low_x] - table[high_y, low_x]
    return np.asarray(count / (2 * half + 1) ** 2)


def _is_noise(area: NDArray[np.float64]) -> bool:
    """Whether a subset is flat or without likeness between neighbouring pixels."""
    deviation = area - area.mean()
    variance = float((deviation**2).mean())
    if variance == 0.0:
        return True
    along_x = (deviation[:, 1:] * deviation[:, :-1]).mean() / variance
    along_y = (deviation[1:] * deviation[:-1]).mean() / variance
    return bool(max(along_x, along_y) < _NOISE_LIKENESS)

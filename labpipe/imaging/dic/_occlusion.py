"""Occlusion: pixels of a subset that do not count in the reference, or that something hides in a frame.

Stated polygons are left out: regions and covers belong to the specimen and move with the subsets, obstructions
stand still in the picture. A subset of which something hides a part that nobody stated is refused.
"""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError

#: Reach (px) of interpolation across the border of a mask: beside a black or a white wall the
#: error was 1.5 to 3 times as large with one pixel less, and no smaller with more.
_BORDER = 2.5
#: Corners beyond (px) are moved there: whole numbers of 32 bit hold them, at no cost to the shape.
_FARTHEST = 1e6


def masks_of(
    regions: Sequence[ArrayLike] | None,
    covers: Sequence[ArrayLike] | None,
    obstructions: Sequence[ArrayLike] | None,
    shape: tuple[int, int, int],
    blur: float,
) -> tuple[Flags | None, Flags | None]:
    """Pixels (row, column) that count in the reference, and those that are hidden in every frame; None for nothing.

    The border is drawn in by the reach of blur and interpolation, which mix both of its sides.

    Parameters
    ----------
    regions, covers, obstructions : list of arrays (corner, 2) [px]
        See :func:`labpipe.imaging.track`.
    shape : (frame, row, column)
        Of the film.
    blur : float [px]
        Gaussian blur of reference and frames.

    Raises
    ------
    InputError
        No polygon of ``regions``, one of less than three corners, that crosses itself, or that no pixel
        lies in.
    """
    if regions is None and not covers and not obstructions:
        return None, None
    import cv2

    size = shape[1:]
    inside = np.ones(size, np.uint8)
    if regions is not None:
        if not len(regions):
            message = "regions holds no polygon, so that no pixel counts; leave it out when all of them do"
            raise InputError(message)
        inside = _filled(regions, size, "regions")
    inside[_filled(covers or (), size, "covers") > 0] = 0
    seen = 1 - _filled(obstructions or (), size, "obstructions")
    width = 2 * math.ceil(_BORDER + blur) + 1

    def drawn_in(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        # the frame itself has no border of the mask
        return np.asarray(cv2.erode(image, np.ones((width, width)), borderType=cv2.BORDER_REPLICATE), np.uint8)

    return drawn_in(inside & seen) > 0, drawn_in(seen) == 0 if obstructions else None


def _filled(polygons: Sequence[ArrayLike], size: tuple[int, int], name: str) -> NDArray[np.uint8]:
    """Image (row, column) of what lies in any of the polygons."""
    import cv2

    image = np.zeros(size, np.uint8)
    for number, polygon in enumerate(polygons, 1):
        corners = np.array(polygon, float)
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
            message = (
                f"{name} must hold polygons of three or more corners (x, y) in px, found shape {corners.shape} "
                f"as polygon {number}"
            )
            raise InputError(message).because(name)
        if (crossing := _crossing(corners)) is not None:
            message = (
                f"{name}: polygon {number} crosses itself, its sides from corner {crossing[0] + 1} and from corner "
                f"{crossing[1] + 1}; list its corners in the order in which they follow each other around it"
            )
            raise InputError(message).because(name)
        own = np.zeros(size, np.uint8)
        cv2.fillPoly(own, [np.rint(corners.clip(-_FARTHEST, _FARTHEST)).astype(np.int32)], 1)
        if not own.any() or not cv2.contourArea(corners.astype(np.float32)):
            message = (
                f"{name}: no pixel lies in polygon {number}, x {corners[:, 0].min():g} to {corners[:, 0].max():g} px, "
                f"y {corners[:, 1].min():g} to {corners[:, 1].max():g} px; the frames are {size[1]} px wide and "
                f"{size[0]} px high"
            )
            raise InputError(message).because(name)
        image |= own
    return image


def _crossing(corners: Floats) -> tuple[int, int] | None:
    """Return the first corners of two sides of a polygon that cross each other; None where none do."""
    ends = np.roll(corners, -1, axis=0)

    def side(a: Floats, b: Floats, c: Floats) -> float:
        return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    for i, j in combinations(range(len(corners)), 2):
        a, b, c, d = corners[i], ends[i], corners[j], ends[j]
        if side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0:
            return i, j
    return None


def visible_pixels(hidden: Flags, centre: Floats, half: int, motion: Floats) -> Flags | None:
    """Pixels (row, column) of a subset that no stated obstruction hides in a frame; None when none is hidden.

    Parameters
    ----------
    hidden : bool array (row, column)
        From :func:`masks_of`.
    centre : array (2,) [px]
        Centre (x, y) of the subset in the reference.
    half : int [px]
        Half width of the subset.
    motion : array (6,)
        Motion to the frame, within a pixel: the margin of ``hidden`` is wider.
    """
    rows, columns = hidden.shape
    reach = half * (1.0 + np.abs(motion[[1, 2]]).sum()) + 1.0, half * (1.0 + np.abs(motion[[4, 5]]).sum()) + 1.0
    x, y = centre[0] + motion[0], centre[1] + motion[3]
    left, right = max(0, int(x - reach[0])), min(columns, int(x + reach[0]) + 2)
    top, bottom = max(0, int(y - reach[1])), min(rows, int(y + reach[1]) + 2)
    if not hidden[top : max(bottom, 0), left : max(right, 0)].any():
        return None
    i, j = np.mgrid[-half : half + 1, -half : half + 1]
    column = np.rint(x + j + motion[1] * j + motion[2] * i).astype(int).clip(0, columns - 1)
    row = np.rint(y + i + motion[4] * j + motion[5] * i).astype(int).clip(0, rows - 1)
    visible = ~hidden[row, column]
    return None if visible.all() else visible


def is_occluded(nothing_shown: Floats) -> Flags:
    """Tell subsets of which something unstated hides a part.

    Parameters
    ----------
    nothing_shown : array (point,) [1]
        Share of the blocks of each subset that show nothing of its pattern in the frame, while others do.
    """
    return np.asarray(nothing_shown > 0.0)

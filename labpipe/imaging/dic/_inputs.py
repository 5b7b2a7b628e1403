"""Check the arguments of :func:`labpipe.imaging.track`."""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labpipe.arrays import Flags, Floats, Floats32
from labpipe.errors import InputError
from labpipe.frames import FrameSource

#: Smallest subset (px) that holds enough pixels for six motions, gain and offset.
LEAST_SUBSET = 9
#: Reach (px) of interpolation across the border of a mask: beside a black or a white wall the
#: error was 1.5 to 3 times as large with one pixel less, and no smaller with more.
_BORDER = 2.5
#: Corners beyond (px) are moved there: whole numbers of 32 bit hold them, at no cost to the shape.
_FARTHEST = 1e6


def check_points(
    points: ArrayLike, subset: int | Sequence[int], shape: str | Sequence[str]
) -> tuple[Floats, NDArray[np.int64], NDArray[np.str_]]:
    """Points (point, 2), half widths and shapes, one of each per point."""
    places = np.array(points, float, ndmin=2)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isfinite(places).all():
        message = f"points must be finite numbers of shape (point, 2) as (x, y) in px, found shape {places.shape}"
        raise InputError(message)
    count = len(places)
    widths = np.array(subset)
    if widths.dtype.kind not in "iu" or (widths < LEAST_SUBSET).any() or (widths % 2 == 0).any():
        message = f"subset must be odd and at least {LEAST_SUBSET} px, found {subset}"
        raise InputError(message)
    shapes = np.array(shape)
    if not np.isin(shapes, ("auto", "rigid", "affine")).all():
        message = f'shape must be "auto", "rigid" or "affine", found {shape!r}'
        raise InputError(message)
    for name, values in (("subset", widths), ("shape", shapes)):
        if values.shape not in {(), (count,)}:
            message = f"{name} must be one value or one per point ({count}), found {values.shape}"
            raise InputError(message)
    half = np.broadcast_to(widths // 2, (count,)).astype(np.int64)
    return places, half, np.broadcast_to(shapes, (count,)).copy()


def check_settings(
    film: FrameSource,
    order: int,
    static_frames: int,
    blur: float,
    tolerance: float,
    max_iterations: int,
    min_zncc: float,
) -> None:
    """Refuse settings outside their range."""
    rules = (
        (order in (3, 5), f"order must be 5 (quintic) or 3 (cubic), found {order}"),
        (len(film) > 0, "the film holds no frames"),
        (
            1 <= static_frames <= max(len(film), 1),
            f"static_frames must be between 1 and the {len(film)} frames of the film, found {static_frames}",
        ),
        (0.0 <= blur <= 5.0, f"blur must be between 0 and 5 px, found {blur}"),
        (tolerance > 0.0, f"tolerance must be positive, found {tolerance}"),
        (max_iterations >= 1, f"max_iterations must be 1 or more, found {max_iterations}"),
        (-1.0 <= min_zncc < 1.0, f"min_zncc must be at least -1 and below 1, found {min_zncc}"),
    )
    for is_right, message in rules:
        if not is_right:
            raise InputError(message)


def check_seeds(seeds: ArrayLike | None, count: int) -> Floats | None:
    """Displacements (point, 2), or None."""
    if seeds is None:
        return None
    start = np.array(seeds, float)
    if start.shape != (count, 2) or not np.isfinite(start).all():
        message = f"seeds must be finite numbers of shape ({count}, 2), found {start.shape}"
        raise InputError(message)
    return start


def masks_of(
    regions: Sequence[ArrayLike] | None,
    covers: Sequence[ArrayLike] | None,
    obstructions: Sequence[ArrayLike] | None,
    shape: tuple[int, int, int],
    blur: float,
) -> tuple[Floats32 | None, Flags | None]:
    """Image (row, column) of what counts in the reference, 1 or 0, and of what is hidden in every frame.

    Each is None when there is nothing of it.

    Its border is drawn in by what blur and interpolation reach: they mix what lies on both sides.

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
    width = 2 * reach_of(blur) + 1

    def drawn_in(image: NDArray[np.uint8]) -> NDArray[np.generic]:
        # the frame itself has no border of the mask
        return cv2.erode(image, np.ones((width, width)), borderType=cv2.BORDER_REPLICATE)

    return np.asarray(drawn_in(inside & seen), np.float32), drawn_in(seen) == 0 if obstructions else None


def reach_of(blur: float) -> int:
    """Pixels across the border of a mask that blur (px) and interpolation mix."""
    return math.ceil(_BORDER + blur)


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


def selected_frames(select: slice | Sequence[int] | NDArray[np.integer] | None, count: int) -> NDArray[np.int64]:
    """Increasing frame numbers."""
    if select is None:
        return np.arange(count)
    if isinstance(select, slice):
        wanted = np.arange(count)[select]
    else:
        wanted = np.asarray(select)
        if wanted.dtype.kind not in "iu" and wanted.size:
            message = f"select must hold whole frame numbers, found {wanted.dtype} values"
            raise InputError(message)
        wanted = wanted.astype(np.int64).reshape(-1)
    is_right = len(wanted) > 0 and wanted[0] >= 0 and wanted[-1] < count
    if not is_right or (np.diff(wanted) <= 0).any():
        message = f"select must name one or more increasing frames between 0 and {count - 1}, found {select}"
        raise InputError(message)
    return wanted

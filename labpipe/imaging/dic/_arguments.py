"""Check the arguments of :func:`labpipe.imaging.track`."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError
from labpipe.frames import FrameSource

#: Smallest subset (px) that holds enough pixels for six motions, gain and offset.
LEAST_SUBSET = 9
#: In the order of the codes of the solver.
_SHAPES = ("rigid", "affine", "auto")


def check_points(
    points: ArrayLike, subset: int | Sequence[int], shape: str | Sequence[str]
) -> tuple[Floats, Integers, NDArray[np.int8]]:
    """Points (point, 2), half widths and shapes (``RIGID``, ``AFFINE`` or ``AUTO``), one of each per point."""
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
    if not np.isin(shapes, _SHAPES).all():
        message = f'shape must be "auto", "rigid" or "affine", found {shape!r}'
        raise InputError(message)
    for name, values in (("subset", widths), ("shape", shapes)):
        if values.shape not in {(), (count,)}:
            message = f"{name} must be one value or one per point ({count}), found {values.shape}"
            raise InputError(message)
    half = np.broadcast_to(widths // 2, (count,)).astype(np.int64)
    codes = np.select([shapes == name for name in _SHAPES], range(len(_SHAPES)))
    return places, half, np.broadcast_to(codes, (count,)).astype(np.int8)


def check_settings(film: FrameSource, order: int, static_frames: int, blur: float, min_zncc: float) -> None:
    """Refuse settings outside their range."""
    rules = (
        (order in (3, 5), f"order must be 5 (quintic) or 3 (cubic), found {order}"),
        (len(film) > 0, "the film holds no frames"),
        (
            1 <= static_frames <= max(len(film), 1),
            f"static_frames must be between 1 and the {len(film)} frames of the film, found {static_frames}",
        ),
        (0.0 <= blur <= 5.0, f"blur must be between 0 and 5 px, found {blur}"),
        (-1.0 <= min_zncc < 1.0, f"min_zncc must be at least -1 and below 1, found {min_zncc}"),
    )
    for is_right, message in rules:
        if not is_right:
            raise InputError(message)


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

"""The pixels of a frame between two distances from a contact."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32
from labpipe.imaging.fringes._ring_parameters import Parameter

#: Distance (px) from saturated pixels up to which others are left out: more takes whole fringes away.
_NEAR = 1
#: Side (px) of the square around a pixel of which so many at the black level leave it out: of light 1.4 standard
#: deviations of the noise above it there are so many, and clipping adds 0.04 of them.
_AROUND, _BLACK = 5, 2


@dataclass(frozen=True)
class Ring:
    """The pixels of one fit: a piece of the frame, two distances, and every how many rows."""

    image: Floats32
    first_row: int
    first_column: int
    stride: int
    inner: float
    outer: float
    origin: Floats
    ceiling: float

    @property
    def region(self) -> tuple[Floats32, int, int, int, float, float]:
        """The pixels, as the compiled loops take them."""
        return self.image, self.first_row, self.first_column, self.stride, self.inner, self.outer


def pixels_in_ring(shape: tuple[int, int], x: float, y: float, inner: float, outer: float) -> int:
    """Count, to a row's rounding, the pixels of a frame between two distances."""
    dy = np.arange(shape[0]) - y

    def inside(distance: float) -> float:
        half = np.sqrt(np.maximum(distance**2 - dy**2, 0.0))
        right = np.minimum(x + half, shape[1] - 0.5)
        return float(np.maximum(right - np.maximum(x - half, -0.5), 0.0).sum())

    return int(inside(outer) - inside(inner))


def cut_ring(
    frame: NDArray[np.generic],
    start: Floats,
    inner: float,
    outer: float,
    levels: tuple[float, float],
    max_pixels: int,
    margin: int = 0,
) -> Ring | None:
    """Cut the piece of a frame that holds a ring, or None when they do not meet.

    Pixels that are less than ``margin`` from the border of the frame are left out.
    """
    rows, columns = frame.shape
    x, y = start[Parameter.X], start[Parameter.Y]
    slack = 2.0 + outer * (abs(start[Parameter.STRETCH]) + abs(start[Parameter.SHEAR]))
    top = max(margin, math.floor(y - outer - slack))
    bottom = min(rows - margin, math.ceil(y + outer + slack) + 1)
    left = max(margin, math.floor(x - outer - slack))
    right = min(columns - margin, math.ceil(x + outer + slack) + 1)
    if bottom - top < 2 or right - left < 2:
        return None
    count = pixels_in_ring((rows, columns), float(x), float(y), inner, outer)
    stride = max(1, math.ceil(count / max_pixels))
    piece = _without_clipped(np.ascontiguousarray(frame[top:bottom, left:right], np.float32), *levels)
    middle, spread = 0.5 * (outer**2 + inner**2), 0.5 * (outer**2 - inner**2)
    origin = np.array([x, y, outer, middle / outer**2, outer**2 / spread])
    return Ring(piece, top, left, stride, inner, outer, origin, levels[1])


def _without_clipped(piece: Floats32, floor: float, ceiling: float) -> Floats32:
    """Set what is clipped to the ceiling, so that it is left out.

    Noise decides which of the pixels just below the ceiling reach it: those that do not are darker than
    their light in the mean, and are left out with them. Where darkness is clipped, what is around a pixel
    decides and not its own noise.
    """
    import cv2

    is_left_out = piece >= ceiling
    if is_left_out.any():
        near = np.ones((2 * _NEAR + 1, 2 * _NEAR + 1), np.uint8)
        is_left_out = cv2.dilate(is_left_out.astype(np.uint8), near) > 0
    is_black = piece <= floor
    if is_black.any():
        around = cv2.boxFilter(is_black.astype(np.uint8), cv2.CV_16U, (_AROUND, _AROUND), normalize=False)
        is_left_out |= around >= _BLACK
    return np.where(is_left_out, np.float32(ceiling), piece) if is_left_out.any() else piece

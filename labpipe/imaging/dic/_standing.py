"""What stands still in the picture and hides part of the subsets that move behind it."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Integers

#: Frames in which a pixel must have stood still, and most pixels of a part where more were looked at; and pixels
#: of a part that is believed.
_FEWEST_VOTES, _VOTES, _LEAST_PART = 2, 3, 8


@dataclass(frozen=True)
class Standing:
    """Pixels of the picture on which the specimen is not seen, in any frame.

    Attributes
    ----------
    hidden : bool array (row, column)
        Where that is.
    """

    hidden: Flags
    _table: NDArray[np.int32] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_table", cv2.integral(self.hidden.astype(np.uint8)))

    def touches(self, x: Integers, y: Integers, half: Integers, motion: Floats) -> Flags:
        """Tell which subsets (point,) of given centres may hold something hidden once they have moved."""
        reach = half[:, None] * (1.0 + np.abs(motion[:, [1, 4]]) + np.abs(motion[:, [2, 5]])) + 1.0
        centre = np.stack([x, y], axis=1) + motion[:, [0, 3]]
        most = np.array(self.hidden.shape[::-1])
        low = np.clip(np.nan_to_num(np.floor(centre - reach)), 0, most).astype(np.int64)
        high = np.clip(np.nan_to_num(np.ceil(centre + reach)) + 1, 0, most).astype(np.int64)
        (left, top), (right, bottom) = low.T, high.T
        count = self._table[bottom, right] - self._table[top, right]
        return np.asarray(count - self._table[bottom, left] + self._table[top, left] > 0)

    def left(self, x: int, y: int, half: int, motion: Floats) -> Flags:
        """Pixels (row, column) of a subset on which the specimen is seen once they have moved."""
        column, row = moved_pixels(x, y, half, motion)
        column, row = np.rint(column).astype(np.int64), np.rint(row).astype(np.int64)
        rows, columns = self.hidden.shape
        is_inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return np.asarray(~(is_inside & self.hidden[row.clip(0, rows - 1), column.clip(0, columns - 1)]))


@dataclass
class Votes:
    """In how many of the frames pixels (row, column) of the picture stood still before the specimen, or showed it."""

    stands: Integers
    moves: Integers
    frames: int = 0

    @classmethod
    def none(cls, shape: tuple[int, ...]) -> "Votes":
        """Return votes of no frame."""
        return cls(*np.zeros((2, *shape), np.int32))

    @property
    def any(self) -> bool:
        """Whether something stood anywhere."""
        return bool(self.stands.any())

    def hidden(self, reach: int) -> Flags:
        """Pixels of the picture before which something stands, and those within its reach (px)."""
        if not self.any:
            return np.zeros(self.stands.shape, bool)
        found = ((self.stands >= _FEWEST_VOTES) & (self.stands > 2 * self.moves)).astype(np.uint8)
        _, parts, of_parts, _ = cv2.connectedComponentsWithStats(found, connectivity=8)
        needed = _VOTES if self.frames > _VOTES else _FEWEST_VOTES
        often = np.bincount(parts.ravel(), (self.stands >= needed).ravel())
        area = of_parts[:, cv2.CC_STAT_AREA]
        found &= ((area >= _LEAST_PART) & (2.0 * often > area))[parts]
        width = 2 * reach + 1
        return np.asarray(cv2.dilate(found, np.ones((width, width))) > 0)


def unstated_box(hidden: Flags | None, stated: Flags | None, reach: int) -> list[int]:
    """First and last column, first and last row (px) of what stands before the specimen though nobody stated it.

    Empty where nothing does. What is found within twice the reach (px) of what was stated is its border.
    """
    if hidden is None:
        return []
    width = 4 * reach + 1
    found = hidden if stated is None else hidden & (cv2.dilate(stated.astype(np.uint8), np.ones((width, width))) == 0)
    if not found.any():
        return []
    rows, columns = np.flatnonzero(found.any(axis=1)), np.flatnonzero(found.any(axis=0))
    return [int(side) for side in (columns[0], columns[-1], rows[0], rows[-1])]


def standing_told(standing: list[int], *, is_beside_stated: bool) -> str:
    """Say where something stands before the specimen, or beside it in a subset, though nobody stated it.

    ``standing`` are its first and last column and row [px].
    """
    left, right, top, bottom = standing
    beside = ", and what is stated may lie beside what it should cover" * is_beside_stated
    return (
        f"something stands still before the specimen or beside it, within x {left} to {right} px and y {top} to "
        f"{bottom} px, and is left out{beside}"
    )


def moved_pixels(x: int, y: int, half: int, motion: Floats) -> tuple[Floats, Floats]:
    """Columns and rows (row, column) in the picture to which the pixels of a subset move."""
    i, j = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    u, u_x, u_y, v, v_x, v_y = motion
    return x + j + u + u_x * j + u_y * i, y + i + v + v_x * j + v_y * i


def packed(left: Flags) -> NDArray[np.uint8]:
    """Pixels of a subset that count, one bit each."""
    return np.packbits(left)


def unpacked(bits: NDArray[np.uint8], half: int) -> Flags:
    """Reverse :func:`packed`."""
    width = 2 * half + 1
    return np.unpackbits(bits, count=width * width).reshape(width, width).astype(bool)

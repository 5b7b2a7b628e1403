"""Films in files of any kind: the rectangle of their frames that is shown, and pixels without gaps between them."""

import copy
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from labpipe.binary import Window
from labpipe.errors import InputError
from labpipe.frames import ShownFrames

LARGEST_SIDE = 1 << 15  # px; no sensor is larger
PACKED_GROUPS = {10: (4, 5), 12: (2, 3)}  # bits to pixels and bytes of one group that is packed without gaps


class StoredFrames(ShownFrames):
    """Frames of one size, ``count`` of them, of which a rectangle is decoded; the whole image at first."""

    def __init__(self, count: int, height: int, width: int) -> None:
        self._count, self._rows, self._columns = count, range(height), range(width)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of frames that the file declares, rows, columns."""
        return self._count, len(self._rows), len(self._columns)

    def roi(self, rows: slice, columns: slice) -> Self:
        """Return a view of a rectangle of this view; InputError where it holds no pixel, or leaves rows out."""
        view = copy.copy(self)
        view._rows, view._columns = self._rows[rows], self._columns[columns]
        if view._rows.step != 1 or view._columns.step != 1:
            raise InputError("a region of interest is a contiguous rectangle; found a step other than 1")
        if not view._rows or not view._columns:
            size = f"{len(self._rows)} rows × {len(self._columns)} columns"
            raise InputError(f"the region of interest {rows}, {columns} holds no pixel of the {size}")
        return view

    def _place(self, index: int) -> int:
        """Return the number of a frame, counted from the first; IndexError where there is no such frame."""
        if not -self._count <= index < self._count:
            raise IndexError(f"frame {index} of {self._count}")
        return int(index) % self._count


_Header = TypeVar("_Header", bound=Any)  # with count, height and width [px]


class MappedFrames(StoredFrames, Generic[_Header]):
    """Frames of a camera's own file: ``window`` maps it, ``header`` describes it."""

    def __init__(self, window: Window, header: _Header) -> None:
        super().__init__(header.count, header.height, header.width)
        self._window, self.header, self.path = window, header, window.path


def unpacked(stored: NDArray[np.uint8], bits: int) -> NDArray[np.uint16]:
    """Unpack pixels (row, pixel) of 10 or 12 bits from whole groups of bytes (row, byte), highest bits first."""
    pixels, size = PACKED_GROUPS[bits]
    groups = stored.reshape(len(stored), -1, size).astype(np.uint16)
    words = []
    for byte, bit in (divmod(bits * k, 8) for k in range(pixels)):
        words.append((groups[..., byte] << 8 | groups[..., byte + 1]) >> (16 - bit - bits) & 2**bits - 1)
    return np.stack(words, axis=-1).reshape(len(stored), -1)

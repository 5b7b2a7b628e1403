"""Phantom high-speed films (.cine): lazy, memory-mapped, times from the time stamps.

Nothing but the header is read when a film is opened. An image, or a rectangle of it, is decoded
when it is asked for; rows outside the rectangle are not touched.
"""

import os
import warnings
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.phantom._header import Header, read_header
from instruments.phantom._pixels import PACKED_GROUP, decode, linear_from_companded, row_bytes
from instruments.phantom._times import TimeAxis, exposure_times, time_axis
from labpipe.arrays import Flags, Floats, Integers
from labpipe.binary import Window
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.frames import IncompleteFilmWarning, ShownFrames

#: Bytes that the system maps when one of them is looked at (Linux: 16 pages).
_FAULT_AROUND = 64 * 2**10
_HIGHEST_LEVEL = 2**16 - 1
_LEAST_ANNOTATION = 8  # bytes before the pixels of a frame
_MOST_NEIGHBOURS = 16  # damaged offsets within one frame; with more, none of them is believed


def read(path: str | os.PathLike[str]) -> "CineFrames":
    """Open a .cine film.

    Parameters
    ----------
    path : path-like
        The film.

    Returns
    -------
    CineFrames
        Lazy frames; see :class:`labpipe.frames.FrameSource`.

    Raises
    ------
    SourceError
        The file is no .cine, is colour or JPEG, or declares sizes that it does not hold.

    Warns
    -----
    UserWarning
        The file ends before some of its frames.
    """
    window = Window(Path(path))
    header = read_header(window)
    _warn_of_end(window, header)
    return CineFrames(window, header)


def _warn_of_end(window: Window, header: Header) -> None:
    """Warn of frames that lie beyond the end of the file, as after a copy that broke off."""
    last = window.size - _LEAST_ANNOTATION - header.image_bytes
    beyond = np.flatnonzero(header.offsets > last)
    if beyond.size:
        frames = "frames lie" if beyond.size > 1 else "frames lies"
        warn_of(
            window.path.name,
            f"{beyond.size} of {header.count} {frames} beyond the end of the file, the "
            f"first is frame {beyond[0]}; they are left out. Copy the film from the camera again",
            category=IncompleteFilmWarning,
        )


class CineFrames(ShownFrames):
    """The frames of a .cine file.

    Parameters
    ----------
    window : Window
        The mapped file.
    header : Header
        What it says of itself.
    rows, columns : slice, optional
        The rectangle that is decoded; the whole image by default.
    """

    def __init__(self, window: Window, header: Header, rows: slice = slice(None), columns: slice = slice(None)) -> None:
        self._window = window
        self._header = header
        self._rows = range(header.height)[rows]
        self._columns = range(header.width)[columns]
        if self._rows.step != 1 or self._columns.step != 1:
            raise InputError("a region of interest is a contiguous rectangle; found a step other than 1")
        if not self._rows or not self._columns:
            raise InputError(
                f"the region of interest {rows}, {columns} holds no pixel of the "
                f"{header.height} rows × {header.width} columns"
            )

    @property
    def header(self) -> Header:
        """What the file says of itself."""
        return self._header

    @property
    def path(self) -> Path:
        """The file."""
        return self._window.path

    @cached_property
    def time_axis(self) -> TimeAxis:
        """Times with a flag per frame, and how many frames are missing between neighbours.

        Raises
        ------
        SourceError
            The file holds neither time stamps nor a frame rate.

        Warns
        -----
        UserWarning
            Times had to be replaced, or frames are missing.
        """
        try:
            axis = time_axis(self._header)
        except InputError as error:
            raise SourceError(
                self.path, str(error), hint="The header is damaged; export the film again from the camera's software."
            ) from None
        for text in axis.warnings:
            warnings.warn(text, UserWarning, stacklevel=3)
        return axis

    @property
    def time(self) -> Floats:
        """Time of every frame in s, the trigger being 0; shape (frame,)."""
        return self.time_axis.time

    @cached_property
    def exposure(self) -> Floats | None:
        """Exposure of every frame in s, NaN where the file's value is impossible; or None."""
        return exposure_times(self._header, self.time_axis)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of frames that the file declares, rows, columns."""
        return self._header.count, len(self._rows), len(self._columns)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the decoded pixels."""
        return np.dtype(np.uint8 if self._header.packing == "8" else np.uint16)

    @cached_property
    def levels(self) -> tuple[float, float]:
        """Black and white level in the units of the decoded pixels."""
        black, white = self._header.setup.black_level, self._header.setup.white_level
        if black is None or white is None or not 0 <= black < white <= _HIGHEST_LEVEL:
            return 0.0, float(2**self._header.bits - 1)
        if self._header.packing == "10-packed":
            table = linear_from_companded()
            return float(table[min(black, 1023)]), float(table[min(white, 1023)])
        return float(black), float(white)

    @cached_property
    def valid(self) -> Flags:
        """False for frames that the file does not hold completely; shape (frame,)."""
        sound = np.array([self._fault(i) is None for i in range(len(self))])
        sound.setflags(write=False)
        return sound

    def __getitem__(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame, first row on top.

        Raises
        ------
        IndexError
            There is no such frame.
        SourceError
            The file does not hold this frame completely.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        index = int(index) % len(self)
        fault = self._fault(index)
        if fault is not None:
            raise SourceError(
                self.path,
                f"frame {index}: {fault}",
                offset=int(self._header.offsets[index]),
                hint="Use the frames marked in `.valid`; copy the film again to get the others.",
            )
        return self._decode(self._pixels_at(index))

    def roi(self, rows: slice, columns: slice) -> "CineFrames":
        """Return a view of a rectangle of this view; rows outside are not read."""
        inner_rows, inner_columns = self._rows[rows], self._columns[columns]
        view = CineFrames(
            self._window,
            self._header,
            slice(inner_rows.start, inner_rows.stop, inner_rows.step),
            slice(inner_columns.start, inner_columns.stop, inner_columns.step),
        )
        if "time_axis" in self.__dict__:  # what is known once is not warned of again
            view.__dict__["time_axis"] = self.time_axis
        return view

    @cached_property
    def _order(self) -> Integers:
        """The frames in the order of their places in the file."""
        return np.argsort(self._header.offsets, kind="stable")

    @cached_property
    def _rank(self) -> Integers:
        """Position of each frame in that order."""
        rank = np.empty(len(self), np.int64)
        rank[self._order] = np.arange(len(self))
        return rank

    @cached_property
    def _gaps(self) -> Floats:
        """Bytes from each place to the next in that order, and beyond both ends."""
        places = self._header.offsets[self._order].astype(np.float64)  # no difference overflows
        return np.diff(places, prepend=-np.inf, append=np.inf)

    def _fault(self, index: int) -> str | None:
        """Say what is wrong with a frame's place in the file, or None."""
        return self._own_fault(index) or self._overlap(index)

    def _overlap(self, index: int) -> str | None:
        """Say which sound frame holds the same bytes; two frames cannot share any."""
        offsets, rank = self._header.offsets, int(self._rank[index])
        before, after = self._gaps[rank], self._gaps[rank + 1]
        length = self._pixels_at(index) + self._header.image_bytes - int(offsets[index])
        if before > 0 and after >= length:
            return None
        if before == 0:
            # of two frames at one place the earlier is believed
            return f"it lies where frame {self._order[rank - 1]} does"
        end = int(offsets[index]) + length
        behind = self._order[rank + 1 : rank + 1 + _MOST_NEIGHBOURS]
        inside = behind[(offsets[behind] > offsets[index]) & (offsets[behind] < end)]
        if inside.size == _MOST_NEIGHBOURS:
            return "the table of offsets points into it again and again"
        runs_into = (int(i) for i in inside if self._own_fault(int(i)) is None)
        return next((f"it runs into frame {i}" for i in runs_into), None)

    def _own_fault(self, index: int) -> str | None:
        start, size = int(self._header.offsets[index]), self._window.size
        self._window.note_use(_FAULT_AROUND)
        if not 0 <= start <= size - 8:
            return f"its offset {start} lies outside the file of {size} bytes"
        annotation = self._window.integer("I", start, "AnnotationSize")
        if not _LEAST_ANNOTATION <= annotation <= size - start:
            return f"its annotation claims {annotation} bytes"
        stored = self._window.integer("I", start + annotation - 4, "ImageSize")
        if stored != self._header.image_bytes:
            return f"its stored size is {stored} bytes, expected {self._header.image_bytes}"
        if start + annotation + stored > size:
            return f"it ends {start + annotation + stored - size} bytes after the file does"
        return None

    def _pixels_at(self, index: int) -> int:
        start = int(self._header.offsets[index])
        return start + self._window.integer("I", start, "AnnotationSize")

    def _decode(self, start: int) -> NDArray[np.integer[Any]]:
        header = self._header
        stride = row_bytes(header.packing, header.width)
        first, last = self._rows.start, self._rows.stop
        if not header.top_down:
            first, last = header.height - last, header.height - first
        group, stored = PACKED_GROUP.get(header.packing, (1, stride // header.width))
        left = self._columns.start // group
        right = -(-self._columns.stop // group)
        block = self._window.bytes[start + first * stride : start + last * stride]
        rows = block.reshape(-1, stride)[:, left * stored : right * stored]
        if not header.top_down:
            rows = rows[::-1]
        self._window.note_use(block.size)
        inset = self._columns.start - left * group
        pixels = decode(rows, header.packing)[:, inset : inset + len(self._columns)]
        return np.ascontiguousarray(pixels)

"""Phantom high-speed films (.cine): lazy, memory-mapped, times from the time stamps.

Unpacked rows are stored bottom-up, packed rows top-down. Ten-bit packed values are companded; they are expanded to
twelve linear bits by the inverse of Rec. 709.
"""

import os
import warnings
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments._stored_film import PACKED_GROUPS, MappedFrames, unpacked
from instruments.phantom._header import Header, read_header
from instruments.phantom._times import SHARE, UNIT, TimeAxis, longest_order, time_axis
from labpipe.arrays import Flags, Floats, Integers
from labpipe.binary import Window
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.frames import IncompleteFilmWarning

_FAULT_AROUND = 64 * 2**10  # bytes that the system maps when one of them is looked at (Linux: 16 pages)
_LEAST_ANNOTATION = 8  # bytes before the pixels of a frame
_P10_BLACK, _P10_WHITE = 64, 1014  # companded levels of black and white
_LINEAR_BLACK, _LINEAR_WHITE = 64, 4064  # the 12-bit linear levels for them


@cache
def linear_from_companded() -> NDArray[np.uint16]:
    """Table of the 1,024 companded values in 12-bit linear levels (inverse Rec. 709)."""
    signal = (np.arange(1024) - _P10_BLACK) / (_P10_WHITE - _P10_BLACK)
    light = np.where(signal < 0.081, signal / 4.5, ((np.maximum(signal, 0.0) + 0.099) / 1.099) ** (1 / 0.45))
    linear = _LINEAR_BLACK + light * (_LINEAR_WHITE - _LINEAR_BLACK)
    return np.clip(np.rint(linear), 0, 4095).astype(np.uint16)


def read(path: str | os.PathLike[str]) -> "CineFrames":
    """Open a .cine film; SourceError where it is colour or JPEG, or declares sizes that it does not hold.

    Parameters
    ----------
    path : path-like
        The film.

    Returns
    -------
    CineFrames
        Lazy frames; see :class:`labpipe.frames.FrameSource`. Frames behind the end of the file, as after a copy that
        broke off, are warned of (IncompleteFilmWarning).
    """
    window = Window(Path(path))
    header = read_header(window)
    beyond = np.flatnonzero(header.offsets > window.size - _LEAST_ANNOTATION - header.image_bytes)
    if beyond.size:
        text = f"{beyond.size} of {header.count} {'frames lie' if beyond.size > 1 else 'frames lies'} beyond the end "
        text += f"of the file, the first is frame {beyond[0]}; they are left out. Copy the film from the camera again"
        warn_of(window.path.name, text, category=IncompleteFilmWarning)
    return CineFrames(window, header)


class CineFrames(MappedFrames[Header]):
    """The frames of a .cine file."""

    @cached_property
    def time_axis(self) -> TimeAxis:
        """Times, with warnings of doubtful ones; SourceError where the file holds neither stamps nor a frame rate."""
        try:
            axis = time_axis(self.header)
        except InputError as error:
            hint = "The header is damaged; export the film again from the camera's software."
            raise SourceError(self.path, str(error), hint=hint) from None
        for text in axis.warnings:
            warnings.warn(text, UserWarning, stacklevel=3)
        return axis

    @property
    def time(self) -> Floats:
        """Time of every frame in s, the trigger being 0; shape (frame,)."""
        return self.time_axis.time

    @cached_property
    def exposure(self) -> Floats | None:
        """Exposure of every frame in s, NaN where the file's value is longer than a frame lasts; or None."""
        stated, shutter, interval = self.header.exposures, self.header.shutter, self.time_axis.interval
        if stated is None:
            return None if shutter is None else np.full(self._count, shutter)
        exposure = np.asarray(stated * UNIT, np.float64)
        return np.where((self._count > 1) & (exposure > interval * (1 + SHARE)), np.nan, exposure)

    @cached_property
    def levels(self) -> tuple[float, float]:
        """Black and white level in the units of the decoded pixels."""
        black, white = self.header.black_level, self.header.white_level
        if black is None or white is None or not 0 <= black < white < 2**16:
            return 0.0, float(2**self.header.bits - 1)
        if self.header.packing == "10-packed":
            table = linear_from_companded()
            return float(table[min(black, 1023)]), float(table[min(white, 1023)])
        return float(black), float(white)

    @cached_property
    def valid(self) -> Flags:
        """False for frames that the file does not hold completely; shape (frame,)."""
        return np.array([not self._fault(i) for i in range(self._count)])

    def __getitem__(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame, first row on top; SourceError where the file does not hold it completely."""
        index, header = self._place(index), self.header
        start = int(header.offsets[index])
        if fault := self._fault(index):
            hint = "Use the frames marked in `.valid`; copy the film again to get the others."
            raise SourceError(self.path, f"frame {index}: {fault}", offset=start, hint=hint)
        start += self._window.field("I", start, "AnnotationSize")
        stride = header.image_bytes // header.height
        first, last = self._rows.start, self._rows.stop
        if not header.top_down:
            first, last = header.height - last, header.height - first
        group, stored = PACKED_GROUPS.get(header.packed_bits, (1, stride // header.width))
        left, right = self._columns.start // group, -(-self._columns.stop // group)
        block = self._window.bytes[start + first * stride : start + last * stride]
        self._window.note_use(block.size)
        rows = block.reshape(-1, stride)[:, left * stored : right * stored]
        rows = rows if header.top_down else rows[::-1]
        pixels: NDArray[np.integer[Any]] = rows
        if header.packed_bits:
            pixels = unpacked(rows, header.packed_bits)
        elif header.packing == "16":
            pixels = np.ascontiguousarray(rows).view("<u2")
        if header.packing == "10-packed":
            pixels = linear_from_companded()[pixels]
        inset = self._columns.start - left * group
        return np.ascontiguousarray(pixels[:, inset : inset + len(self._columns)])

    @cached_property
    def _ordered(self) -> Integers:
        """The frames whose places in the file go on from each to the next; a damaged offset breaks the order."""
        shortest = self.header.image_bytes + _LEAST_ANNOTATION
        apart: Floats = self.header.offsets.astype(np.float64) - np.arange(self._count) * shortest
        either = [np.flatnonzero(longest_order(apart)), np.flatnonzero(longest_order(-apart[::-1])[::-1])]
        return max(either, key=lambda kept: np.count_nonzero(np.diff(apart[kept]) == 0))  # frames have no gaps

    def _fault(self, index: int) -> str:
        """Describe the fault of a frame's place in the file, "" for none."""
        start, size = int(self.header.offsets[index]), self._window.size
        self._window.note_use(_FAULT_AROUND)
        if not 0 <= start <= size - 8:
            return f"its offset {start} lies outside the file of {size} bytes"
        annotation = self._window.field("I", start, "AnnotationSize")
        if not _LEAST_ANNOTATION <= annotation <= size - start:
            return f"its annotation claims {annotation} bytes"
        stored = self._window.field("I", start + annotation - 4, "ImageSize")
        if stored != self.header.image_bytes:
            return f"its stored size is {stored} bytes, expected {self.header.image_bytes}"
        end = start + annotation + stored
        if end > size:
            return f"it ends {end - size} bytes after the file does"
        behind = self._ordered[self._ordered > index]
        if index not in self._ordered:
            return f"its offset {start} is out of the order of the other frames"
        return f"it runs into frame {behind[0]}" if behind.size and end > self.header.offsets[behind[0]] else ""

"""AVI without compression: the pixels lie in the file as they are, and are read from there.

OpenCV 5 damages its memory, and ends the program, over the usual form of such files: three colours
whose rows begin at the bottom.
"""

import mmap
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from instruments.images._pictures import Channel, one_intensity
from instruments.images._video import warn_of_lost, warn_of_video
from labpipe.arrays import Flags
from labpipe.errors import SourceError

_LISTS = (b"RIFF", b"LIST")  # chunks that hold chunks, behind four bytes that name them
_PLAIN = b"\0\0\0\0"
_FROM_THE_TOP = (b"Y800", b"Y8  ", b"GREY")  # one grey byte a pixel, whatever the sign of the height
_BITMAP = struct.Struct("<IiiHH4s")
_MOST_PIXELS, _MOST_CHUNKS = 1 << 26, 1 << 22
_PALETTE = 256


class _Chunk(NamedTuple):
    """A named stretch of the file, behind its name and size."""

    name: bytes
    begin: int
    size: int


def uncompressed(path: Path, channel: Channel | None = None) -> "UncompressedVideo | None":
    """Open an AVI whose pixels are not compressed; None for any other."""
    with path.open("rb") as stream:
        head = stream.read(12)
        if head[:4] != b"RIFF" or head[8:] != b"AVI ":
            return None
        data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    chunks = _chunks(data)
    main, layout = (next((c for c in chunks if c.name == name), None) for name in (b"avih", b"strf"))
    videos = [data[c.begin : c.begin + 4] for c in chunks if c.name == b"strh"]
    if main is None or layout is None or videos[:1] != [b"vids"] or layout.begin + layout.size > len(data):
        return None
    _, columns, rows, _, bits, packing = _BITMAP.unpack(data[layout.begin : layout.begin + _BITMAP.size])
    if not (packing == _PLAIN and bits in (8, 24, 32)) and not (packing in _FROM_THE_TOP and bits in (8, 12, 16, 24)):
        return None
    interval, declared = (struct.unpack_from("<I", data, main.begin + at)[0] for at in (0, 16))
    colours = bits // 8 if packing == _PLAIN else 1
    if not 0 < abs(rows) * columns <= _MOST_PIXELS:
        raise SourceError(path, f"declares {columns} × {abs(rows)} px")
    stride = -(-columns * colours // 4) * 4 if packing == _PLAIN else columns
    size = stride * abs(rows)
    begins = [
        c.begin for c in chunks if c.name in (b"00db", b"00dc") and c.size >= size and c.begin + size <= len(data)
    ]
    if not begins:
        raise SourceError(path, "no frame of the video is whole", hint="Copy it from the camera again.")
    entries = np.frombuffer(data, np.uint8, max(min(layout.size - 40, 4 * _PALETTE), 0), layout.begin + 40)
    palette = entries[: len(entries) // 4 * 4].reshape(-1, 4)[:, :3] if packing == _PLAIN and bits == 8 else None
    warn_of_video(path, 1e6 / interval if interval else 0.0)
    if len(begins) < declared:
        warn_of_lost(path, declared, len(begins))
    is_from_top = rows < 0 or packing in _FROM_THE_TOP
    return UncompressedVideo(path, data, begins, (abs(rows), columns, colours), stride, palette, is_from_top, channel)


def _chunks(data: mmap.mmap) -> list[_Chunk]:
    """List the chunks of a RIFF file in the order of the file; the last may go on behind it."""
    found: list[_Chunk] = []
    at = 0
    while at + 8 <= len(data) and len(found) < _MOST_CHUNKS:
        name, size = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        if name in _LISTS:
            at += 12
            continue
        found.append(_Chunk(name, at + 8, size))
        at += 8 + size + size % 2
    return found


class UncompressedVideo:
    """Frames that lie in an AVI as they are.

    ``path``; ``data``: the file; ``begins``: where the pixels of each frame begin; ``shape``; ``stride``: bytes from
    row to row; ``palette`` (entry, 3): colour of each number, where pixels are such numbers; ``is_from_top``: whether
    the first row in the file is the top one.
    """

    def __init__(
        self,
        path: Path,
        data: mmap.mmap,
        begins: list[int],
        shape: tuple[int, int, int],
        stride: int,
        palette: NDArray[np.uint8] | None,
        is_from_top: bool,
        channel: Channel | None,
    ) -> None:
        self._channel = channel
        self._path, self._data, self._begins = path, data, begins
        self._shape, self._stride, self._is_from_top = shape, stride, is_from_top
        self.size, self.levels = shape[:2], (0.0, 255.0)
        self._grey = None
        if palette is not None and len(palette):
            used = one_intensity(palette[np.newaxis], 0, path, "the palette of the video", self._channel)[0]
            self._grey = np.resize(used, _PALETTE) if len(used) < _PALETTE else used

    @property
    def valid(self) -> Flags:
        """All true: frames that are not whole are not counted."""
        return np.ones(len(self), dtype=bool)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._begins)

    def fault(self, index: int) -> str:
        """Return "": frames that are not whole are not counted."""
        del index
        return ""

    def whole(self, index: int) -> NDArray[np.integer[Any]]:
        """Return one frame, the first row on top."""
        rows, columns, colours = self._shape
        stored = np.frombuffer(self._data, np.uint8, rows * self._stride, self._begins[index]).reshape(rows, -1)
        image = stored[:, : columns * colours].reshape(rows, columns, colours)[:: 1 if self._is_from_top else -1]
        if colours > 1:
            return np.ascontiguousarray(one_intensity(image, 0, self._path, f"frame {index}", self._channel))
        return np.ascontiguousarray(image[..., 0]) if self._grey is None else self._grey[image[..., 0]]

"""Bounded reading of binary files: every access is checked against the size of the file."""

import mmap
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe.errors import SourceError


class Window:
    """A memory-mapped file from which nothing beyond its end can be read.

    Going through a large file does not fill the memory: pages that were read (:meth:`note_use`) are given back to the
    system after ``kept`` bytes. ``size`` is in bytes. SourceError: the file is missing, unreadable or empty.
    """

    def __init__(self, path: Path, kept: int = 1 << 26) -> None:
        self.path = path
        self._used, self._kept = 0, kept
        try:
            with path.open("rb") as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except ValueError:
            raise SourceError(path, "the file is empty", hint="Copy it again from the instrument.") from None
        except OSError as error:
            raise SourceError(path, f"cannot be opened: {error.strerror}") from None
        self.bytes: NDArray[np.uint8] = np.frombuffer(self._map, np.uint8)
        self.size = int(self.bytes.size)

    def note_use(self, length: int) -> None:
        """Count bytes that were looked at; of many give the pages back, after which arrays made of them stay valid."""
        self._used += length
        if self._used > self._kept and hasattr(mmap, "MADV_DONTNEED"):
            self._map.madvise(mmap.MADV_DONTNEED)
            self._used = 0

    def field(self, layout: str, offset: int, what: str) -> Any:
        """Read a little-endian number, by a letter of :mod:`struct`, at an offset [bytes]; errors name it ``what``."""
        (value,) = struct.unpack("<" + layout, self.take(offset, struct.calcsize(layout), what))
        return value

    def take(self, offset: int, length: int, what: str) -> bytes:
        """Read ``length`` bytes or say which field the file does not hold."""
        return self.array("u1", offset, length, what).tobytes()

    def array(self, kind: str, offset: int, count: int, what: str) -> NDArray[np.generic]:
        """Map ``count`` little-endian numbers of a numpy type without copying them."""
        length = np.dtype(kind).itemsize * count
        if offset < 0 or length < 0 or offset + length > self.size:
            raise SourceError(
                self.path,
                f"{what} would need bytes {offset} to {offset + length}, but the file holds {self.size}",
                offset=max(0, min(offset, self.size)),
                hint="The file is truncated or damaged; copy it again from the camera.",
            )
        return self.bytes[offset : offset + length].view(kind)

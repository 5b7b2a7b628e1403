"""Photron films (.cih or .cihx with .mraw): lazy, memory-mapped.

The .mraw holds the frames one behind the other and nothing else. Pixels are bytes, little-endian words of 16 bits, or
12 bits packed with the highest bits first. Layout as in the public readers pyMRAW and pyidi (ladisk).
"""

import contextlib
import os
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from datetime import UTC
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments._clock import moment
from instruments._stored_film import LARGEST_SIDE, MappedFrames, unpacked
from instruments.photron import frames_of, header_of
from labpipe.arrays import Flags, Floats
from labpipe.binary import Window
from labpipe.errors import SourceError, warn_of
from labpipe.frames import IncompleteFilmWarning
from labpipe.text import shorten

_LARGEST_HEADER = 1 << 24  # bytes; a header has some kilobytes
_KEYS = {
    "rate": ("record rate(fps)", "recordinfo/recordrate"),
    "shutter": ("shutter speed(s)", "recordinfo/shutterspeed"),
    "shutter_ns": ("shutter type2(nsec)", "recordinfo/shutterspeednsec"),
    "count": ("total frame", "frameinfo/totalframe"),
    "start": ("start frame", "frameinfo/startframe"),
    "width": ("image width", "imagedatainfo/resolution/width"),
    "height": ("image height", "imagedatainfo/resolution/height"),
    "colour": ("color type", "imagedatainfo/colorinfo/type"),
    "bits": ("color bit", "imagedatainfo/colorinfo/bit"),
    "depth": ("effectivebit depth", "imagedatainfo/effectivebit/depth"),
    "side": ("effectivebit side", "imagedatainfo/effectivebit/side"),
    "date": ("date", "fileinfo/date"),
    "format": ("file format", "imagefileinfo/fileformat"),
}


@dataclass(frozen=True, slots=True)
class Header:
    """Counts, size [px], bits of a pixel, rate [1/s], exposure [s], white level; day since 1970 as trigger [2⁻³² s]."""

    count: int
    start: int
    height: int
    width: int
    bits: int
    rate: float
    exposure: float | None
    white: float
    trigger: int

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame."""
        return self.height * self.width * self.bits // 8


def read(path: str | os.PathLike[str]) -> "MrawFrames":
    """Open a Photron film by either of its two files; SourceError where one is missing or does not fit the other.

    Parameters
    ----------
    path : path-like
        The header (.cih, .cihx) or the frames (.mraw); the other has the same name and is in the same folder.

    Returns
    -------
    MrawFrames
        Lazy frames; see :class:`labpipe.frames.FrameSource`. Time 0 is the trigger. Frames that a short .mraw does not
        hold are warned of (IncompleteFilmWarning).
    """
    path = Path(path)
    if (header_path := header_of(path)) is None:
        raise SourceError(path, "its header is missing", hint=f"Put {path.stem}.cih or .cihx in the same folder.")
    header = _header(header_path)
    if (frames := frames_of(header_path)) is None:
        hint = f"Put {header_path.stem}.mraw in the same folder."
        raise SourceError(header_path, "its frames are missing", hint=hint)
    window = Window(frames)
    whole, expected = window.size // header.frame_bytes, header.count * header.frame_bytes
    if window.size > expected:
        text = f"holds {window.size} bytes; {header_path.name} describes {header.count} frames of {header.width} × "
        text += f"{header.height} px with {header.bits} bits, {expected} bytes"
        hint = "The two files belong to different films or the header was edited: save the film again from PFV."
        raise SourceError(frames, text, hint=hint)
    if whole < header.count:
        text = f"{header.count - whole} of {header.count} frames are beyond the end of the file, the first is frame "
        text += f"{whole}; they are left out. Copy the film from the camera again"
        warn_of(frames.name, text, category=IncompleteFilmWarning)
    return MrawFrames(window, header, whole)


def _header(path: Path) -> Header:
    """Read and check a header."""
    try:
        data = path.read_bytes() if path.stat().st_size <= _LARGEST_HEADER else b""
    except OSError as error:
        raise SourceError(path, f"cannot be opened: {error.strerror}") from None
    if b"<cih>" in data:
        values = _of_xml(path, data)
    else:  # a .cih ends at the first empty line
        lines = takewhile(str.strip, data.decode("utf-8", "replace").lstrip("\ufeff").splitlines())
        parts = [line.partition(":") for line in lines if ":" in line]
        values = {key.strip().lower(): value.strip() for key, _, value in reversed(parts)}
    hint = "Save the film again from PFV, as MRAW with its header, or export it as TIFF."

    def word(name: str) -> str:
        return next((values[key] for key in _KEYS[name] if key in values), "").strip().lower()

    def number(name: str, least: float, most: float, default: float | None = None) -> float:
        text = word(name)
        try:
            value = float(text) if text or default is None else default
        except ValueError:
            value = np.nan
        if not least <= value <= most:
            said = f"found {shorten(text)}" if text else "found nothing"
            message = f'"{_KEYS[name][0]}" must be a number from {least:g} to {most:g}; {said}'
            raise SourceError(path, message, hint=hint)
        return value

    width, height = (int(number(name, 1, LARGEST_SIDE)) for name in ("width", "height"))
    bits = int(number("bits", 1, 64))
    if word("colour") not in ("mono", "") or bits not in (8, 12, 16) or word("format") not in ("mraw", ""):
        found = f"{word('colour') or 'unknown'} frames of {bits} bits as {word('format') or 'mraw'}"
        raise SourceError(path, f"{found}; grey .mraw of 8, 12 or 16 bits is read", hint="Export it as TIFF from PFV.")
    if bits == 12 and width * height % 2:
        raise SourceError(path, f"{width} × {height} px of 12 bits do not fill bytes", hint="Export as TIFF from PFV.")
    rate, depth = number("rate", 1e-3, 1e9), int(number("depth", 1, 16, bits))
    white = 2.0**bits - 1.0
    if bits == 16 and depth < bits:
        white = 2.0**bits - 2.0 ** (bits - depth) if word("side") == "higher" else 2.0**depth - 1.0
    count, start = int(number("count", 1, 2**31)), int(number("start", -(2**31), 2**31, 0))
    day = moment(word("date"))
    trigger = int(day.replace(tzinfo=UTC).timestamp()) << 32 if day else 0
    exposure = _exposure(word("shutter_ns"), word("shutter"), rate)
    return Header(count, start, height, width, bits, rate, exposure, white, trigger)


def _of_xml(path: Path, data: bytes) -> dict[str, str]:
    """Return the entries of a .cihx, whose XML other bytes may surround."""
    text = data[data.index(b"<cih>") : data.rfind(b"</cih>") + len(b"</cih>")]
    if b"<!" in text:
        raise SourceError(path, "the header declares a document type, which no camera writes")
    try:
        root = ET.fromstring(text.decode("utf-8", "replace").lower())  # noqa: S314 - without a document type
    except ET.ParseError as error:
        raise SourceError(path, f"the header is no XML: {error}", hint="Save the film again from PFV.") from None
    found = {key: root.findtext(key) for keys in _KEYS.values() for key in keys[1:]}
    return {key: value.strip() for key, value in found.items() if value is not None}


def _exposure(nanoseconds: str, seconds: str, rate: float) -> float | None:
    """Return the exposure [s]: in nanoseconds, as 1/x, or as a number that fits the rate; None where none does."""
    for text, factor in ((nanoseconds, 1e-9), (seconds, 1.0)):
        match = re.fullmatch(r"(?:(1)/)?([0-9.]+(?:e[-+]?\d+)?)", text.replace(" ", ""))
        with contextlib.suppress(ValueError, ZeroDivisionError):
            value = float(match[2]) if match else 0.0
            for candidate in (1.0 / value if match and match[1] else value * factor, 1.0 / value):
                if 0.0 < candidate <= 1.001 / rate:
                    return candidate
    return None


class MrawFrames(MappedFrames[Header]):
    """The frames of a .mraw, of which the first ``whole`` are valid; times and exposures (frame,) are in s."""

    def __init__(self, window: Window, header: Header, whole: int) -> None:
        super().__init__(window, header)
        self.time: Floats = (header.start + np.arange(self._count)) / header.rate
        self.exposure = None if header.exposure is None else np.full(self._count, header.exposure)
        self.valid: Flags = np.arange(self._count) < whole
        self.levels = (0.0, header.white)

    def __getitem__(self, index: int) -> NDArray[np.integer[Any]]:
        """Decode one frame, first row on top; SourceError where the file does not hold it."""
        index, header = self._place(index), self.header
        if not self.valid[index]:
            raise SourceError(self.path, f"frame {index} is beyond the end of the file", hint="Copy the film again.")
        first, last = self._rows.start * header.width, self._rows.stop * header.width  # pixels
        inset = first % 2 if header.bits == 12 else 0
        first, last = first - inset, last + (last % 2 if header.bits == 12 else 0)
        start = index * header.frame_bytes
        stored = self._window.bytes[start + first * header.bits // 8 : start + last * header.bits // 8]
        self._window.note_use(stored.size)
        pixels: NDArray[np.integer[Any]] = stored
        if header.bits == 12:
            pixels = unpacked(stored[None], 12)[0, inset : inset + len(self._rows) * header.width]
        elif header.bits == 16:
            pixels = stored.view("<u2")
        image = pixels.reshape(-1, header.width)[:, self._columns.start : self._columns.stop]
        return np.array(image, np.uint8 if header.bits == 8 else np.uint16)

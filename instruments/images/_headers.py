"""Headers of image files, checked before decoding.

A few bytes can declare an image of any size, so sizes are compared with limits and with the file first. Accepted are
PNG, TIFF, BMP and JPEG of 8 bits, PNG and TIFF of 16, and grey TIFF of 10, 12 or 14 packed bits in files of one image.
"""

import mmap
import os
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

from instruments.images._names import JPEG
from labpipe.errors import SourceError

MOST_PIXELS = 1 << 26  # of one image: four times the largest camera
_MOST_PAGES = 1 << 20  # of one TIFF
_PNG, _PNG_END = b"\x89PNG\r\n\x1a\n", b"\x00\x00\x00\x00IEND\xaeB`\x82"
_JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers of a segment that begins with the size of the image
_COPY = "Copy it from the camera again."
_EXPORT = "Export the film as grey TIFF without compression, or as PNG images."
_FIELDS = {
    256: "columns",
    257: "rows",
    258: "bits",
    259: "compression",
    262: "meaning",
    273: "offsets",
    274: "orientation",
    277: "samples",
    279: "counts",
    324: "offsets",
    325: "counts",
}
_FIELD_BYTES = {1: "B", 3: "H", 4: "I", 16: "Q"}
_COMPRESSIONS = {1, 5, 7, 8, 32773, 32946}  # none, LZW, JPEG, deflate by two numbers, PackBits


class ImageHeader(NamedTuple):
    """Size and bits of one image; ``fault`` names damage that shows without decoding, or is "".

    ``kind`` is "PNG", "JPEG", "BMP" or "TIFF", by content; ``is_compressed`` if only decoding shows whether the pixels
    are whole; ``turned`` is the byte of a TIFF's note of another orientation, or 0.
    """

    rows: int
    columns: int
    bits: int
    fault: str = ""
    is_compressed: bool = False
    kind: str = ""
    turned: int = 0


class CutOffError(SourceError):
    """An image ends before its header does, or has none: nothing of it can be read."""


def is_tiff(head: bytes) -> bool:
    """Recognise a TIFF or BigTIFF by its first bytes."""
    return head[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def read_headers(path: Path) -> list[ImageHeader]:
    """Return the header of every image in a PNG, TIFF, BMP or JPEG file.

    Raises
    ------
    CutOffError
        The file ends within its first header, or is none of these.
    SourceError
        The file declares more than it holds, or an image that is not read.
    """
    try:
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if not size:
                raise CutOffError(path, "the image is empty")
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
                head = data[:34]
                if is_tiff(head):
                    return _tiff(path, data)
                for mark, read in ((_PNG, _png), (b"BM", _bmp), (JPEG, _jpeg)):
                    if head.startswith(mark):
                        return [read(path, data)]
    except OSError as error:
        raise SourceError(path, f"cannot be opened: {error.strerror}") from None
    raise CutOffError(path, f"is neither PNG nor TIFF nor BMP nor JPEG: it starts with {head[:8]!r}", hint=_EXPORT)


def _checked(path: Path, header: ImageHeader, known: tuple[int, ...] = (8, 16)) -> ImageHeader:
    rows, columns, bits, *_ = header
    if min(rows, columns) < 1 or rows * columns > MOST_PIXELS:
        message = f"declares {columns} × {rows} px; expected at least one and at most {MOST_PIXELS}"
        raise SourceError(path, message, hint="No camera takes such images: the header is damaged.")
    if bits not in known:
        expected = f"{', '.join(map(str, known[:-1]))} or {known[-1]}"
        hint = "Export the film as grey images of 16 bits."
        raise SourceError(path, f"holds {bits} bits per pixel; expected {expected}", hint=hint)
    return header


def _png(path: Path, data: mmap.mmap) -> ImageHeader:
    if len(data) < 33 or data[12:16] != b"IHDR":
        raise CutOffError(path, "the PNG ends within its header", hint=_COPY)
    columns, rows, bits, colour = struct.unpack(">IIBB", data[16:26])
    if colour not in (0, 2, 3, 4, 6):
        raise SourceError(path, f"the PNG is of colour type {colour}; known are 0, 2, 3, 4, 6", offset=25)
    fault = "" if data[-12:] == _PNG_END else "the PNG is cut off: its end mark is missing"
    return _checked(path, ImageHeader(rows, columns, bits, fault, kind="PNG"))


def png_fault(path: Path) -> str:
    """Return the first contradiction between the chunks of a PNG and their checksums, or "".

    A decoder would return nothing for such an image, or other pixels than those that were taken.
    """
    try:
        data = memoryview(path.read_bytes())
    except OSError as error:
        return f"cannot be opened: {error.strerror}"
    at = len(_PNG)
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if end + 4 > len(data):
            return f"the PNG's part at byte {at} ends behind the file"
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return f"the PNG's part at byte {at} does not fit its checksum"
        at = end + 4
    return "" if at == len(data) else "the PNG goes on behind its last part"


def _bmp(path: Path, data: mmap.mmap) -> ImageHeader:
    if len(data) < 34:
        raise CutOffError(path, "the BMP ends within its header", hint=_COPY)
    begin, _, columns, rows, _, bits, packing = struct.unpack("<IIiiHHI", data[10:34])
    if bits not in (8, 24, 32) or packing:
        message = f"the BMP has {bits} bits per pixel, packing {packing}; expected 8, 24 or 32 that are not compressed"
        raise SourceError(path, message, hint=_EXPORT)
    is_whole = begin + -(-columns * bits // 32) * 4 * abs(rows) <= len(data)
    return _checked(path, ImageHeader(abs(rows), columns, 8, "" if is_whole else "the BMP is cut off", kind="BMP"))


def _jpeg(path: Path, data: mmap.mmap) -> ImageHeader:
    at = 2
    while at + 9 <= len(data):
        mark, kind, length, bits, rows, columns = struct.unpack(">BBHBHH", data[at : at + 9])
        if mark != 0xFF:
            break
        if kind in _JPEG_SIZES:
            fault = "" if b"\xff\xd9" in data[-64:] else "the JPEG is cut off: its end mark is missing"
            return _checked(path, ImageHeader(rows, columns, bits, fault, is_compressed=True, kind="JPEG"))
        at += 2 + length
    raise CutOffError(path, "the JPEG ends within its header", hint=_COPY)


def _tiff(path: Path, data: mmap.mmap) -> list[ImageHeader]:
    """Go through the chain of a TIFF's directories; no pixel is touched."""
    order = "<" if data[:2] == b"II" else ">"

    def number(layout: str, at: int) -> int:
        size = struct.calcsize(order + layout)
        if not 0 <= at <= len(data) - size:
            raise CutOffError(path, "the TIFF points outside of itself", offset=at, hint=f"It is damaged. {_COPY}")
        return int(struct.unpack(order + layout, data[at : at + size])[0])

    is_big = number("H", 2) == 43
    word, count_word, entry_bytes, room = ("Q", "Q", 20, 8) if is_big else ("I", "H", 12, 4)
    unread = len(data)  # bytes of directories and lists; a sound file holds each of them once

    def directory(at: int) -> tuple[dict[str, list[int]], int]:
        nonlocal unread
        entries = number(count_word, at)
        first = at + struct.calcsize(order + count_word)
        unread -= entries * entry_bytes
        found: dict[str, list[int]] = {}
        for entry in range(first, first + entries * entry_bytes if unread >= 0 else first, entry_bytes):
            name = _FIELDS.get(number("H", entry))
            if name is None:
                continue
            layout, count = _FIELD_BYTES.get(number("H", entry + 2)), number(word, entry + 4)
            size = 0 if layout is None else struct.calcsize(order + layout)
            if not 0 < count * size <= len(data):
                message = f"a TIFF field of type {number('H', entry + 2)} and {count} values"
                raise SourceError(path, message, offset=entry, hint=_COPY)
            place = entry + 4 + room
            if count * size > room:
                place, unread = number(word, place), unread - count * size
            if name == "orientation":
                found["turned"] = [place]
            if unread >= 0:
                found[name] = [number(str(layout), place + i * size) for i in range(count)]
        if unread < 0:
            message = "the TIFF's directories and lists are longer than the file: they overlap"
            raise SourceError(path, message, offset=at, hint=_COPY)
        return found, number(word, first + entries * entry_bytes)

    headers: list[ImageHeader] = []
    several, seen, at = False, set[int](), number(word, room)
    while at:
        if at in seen or len(seen) >= _MOST_PAGES:
            raise SourceError(path, "the TIFF's pages form a circle", offset=at)
        seen.add(at)
        try:
            fields, at = directory(at)
        except CutOffError:
            if not headers:
                raise
            fault = "the TIFF breaks off before it, and the number of pages behind it is not known"
            headers.append(headers[0]._replace(fault=fault))
            break
        several = several or bool(headers or at)
        headers.append(_page(path, fields, len(data), several))
    if not headers:
        raise SourceError(path, "the TIFF holds no image")
    return headers


def _page(path: Path, fields: dict[str, list[int]], size: int, several: bool) -> ImageHeader:
    def first(name: str, default: int) -> int:
        return fields.get(name, [default])[0]

    rows, columns, bits, samples = first("rows", 0), first("columns", 0), first("bits", 1), first("samples", 1)
    meaning, packing = first("meaning", 1), first("compression", 1)
    is_grey, is_colour = samples == 1 and meaning in (0, 1, 3), samples in (3, 4) and meaning == 2
    if not (is_grey or is_colour) or packing not in _COMPRESSIONS:
        message = f"a page has {samples} samples per pixel of interpretation {meaning}, compression {packing}"
        raise SourceError(path, f"{message}; expected grey or RGB", hint=_EXPORT)
    is_turned = first("orientation", 1) != 1
    if several and (is_turned or (is_colour and bits != 8)):
        raise SourceError(
            path, "its pages are turned, or in colours of 16 bits; only files of one image may be", hint=_EXPORT
        )
    starts, counts = fields.get("offsets", []), fields.get("counts", [])
    is_whole = starts and len(starts) == len(counts) and max(map(sum, zip(starts, counts, strict=True))) <= size
    fault = "" if is_whole else "the TIFF page is cut off"
    header = ImageHeader(rows, columns, bits, fault, packing != 1, "TIFF", is_turned * first("turned", 0))
    return _checked(path, header, (8, 16) if is_colour or several else (8, 10, 12, 14, 16))

"""Headers of image files, checked before decoding.

A few bytes can declare an image of any size; sizes are therefore checked against limits and
against the file first. Only what the films of a laboratory need is accepted: PNG and TIFF of 8 or
16 bits, grey TIFF of 10, 12 or 14 packed bits, and BMP and JPEG of 8 bits a colour. Whether three colours say
the same, as of a grey camera, only their pixels tell.
"""

import os
import struct
import zlib
from pathlib import Path
from typing import BinaryIO, NamedTuple

from instruments.images._names import JPEG
from labpipe.errors import SourceError

MOST_PIXELS = 1 << 26  # of one image: four times the largest camera
MOST_PAGES = 1 << 20  # of one TIFF
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"
_PNG_COLOURS = (0, 2, 3, 4, 6)
_JPEG_END, _JPEG_TAIL = b"\xff\xd9", 64
_JPEG_SIZES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # marks behind which the size of the image stands
_BYTES, _PACKED = (8, 16), (10, 12, 14)  # bits of a pixel that fill bytes, and that do not
_RGB, _PALETTE = 2, 3  # interpretations of a TIFF's samples
_TIFF_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 16: 8, 13: 4}
_WIDTH, _LENGTH, _BITS, _PHOTOMETRIC, _OFFSETS, _SAMPLES, _COUNTS = (256, 257, 258, 262, 273, 277, 279)
_TILE_OFFSETS, _TILE_COUNTS = 324, 325
_ORIENTATION = 274
_MOST_FIELDS = 4096  # of a directory that are looked at
_LARGE_HEAD = 16  # bytes before the first directory of a TIFF of large numbers
_COMPRESSION, _PLAIN = 259, 1
_COMPRESSIONS = {1, 5, 7, 8, 32773, 32946}  # none, LZW, JPEG, deflate of two numbers, PackBits
_WANTED = (_COMPRESSION, _WIDTH, _LENGTH, _BITS, _PHOTOMETRIC, _OFFSETS, _SAMPLES, _COUNTS, _TILE_OFFSETS, _TILE_COUNTS)


class ImageHeader(NamedTuple):
    """Size and depth of one image; ``fault`` says why it cannot be decoded completely, or "".

    Only decoding tells whether pixels are whole that are compressed without checksums.
    """

    rows: int
    columns: int
    bits: int
    fault: str = ""
    is_compressed: bool = False
    directory: int = 0  # byte at which that of a TIFF's page begins
    kind: str = ""  # "PNG" or "JPEG", by content


class _Field(NamedTuple):
    """Where a field of a TIFF's directory stands, the type of its values, and how many there are."""

    entry: int
    kind: int
    number: int


class CutOffError(SourceError):
    """An image ends before its header does, or has none: nothing of it can be read."""


def is_tiff(head: bytes) -> bool:
    """Tell a TIFF or BigTIFF by its first bytes."""
    return head[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def read_headers(path: Path) -> list[ImageHeader]:
    """Return the header of every image in a PNG, TIFF, BMP or JPEG file.

    Raises
    ------
    CutOffError
        The file ends within its first header, or is none of these.
    SourceError
        The file declares what it cannot hold.
    """
    try:
        with path.open("rb") as stream:
            head, size = stream.read(34), os.fstat(stream.fileno()).st_size
            if head[:8] == _PNG:
                stream.seek(-min(12, size), os.SEEK_END)
                return [_png(path, head, stream.read(12))]
            if head[:2] == b"BM":
                return [_bmp(path, head, size)]
            if head[:3] == JPEG:
                return [_jpeg(path, stream, size)]
        if is_tiff(head):
            return _tiff(path, path.read_bytes() if path.stat().st_size < 1 << 20 else None)
    except OSError as error:
        raise SourceError(path, f"cannot be opened: {error.strerror}") from None
    if not head:
        raise CutOffError(path, "the image is empty")
    raise CutOffError(
        path,
        f"is neither PNG nor TIFF nor BMP nor JPEG: it starts with {head[:8]!r}",
        hint="Export the film as PNG or TIFF images, or give the camera's own file.",
    )


def _bmp(path: Path, head: bytes, size: int) -> ImageHeader:
    if len(head) < 34:
        raise CutOffError(path, "the BMP ends within its header", hint="Copy it from the camera again.")
    begin, _, columns, rows, _, bits, packing = struct.unpack("<IIiiHHI", head[10:34])
    rows, colours = abs(rows), bits // 8
    if bits not in (8, 24, 32) or packing:
        message = f"the BMP has {bits} bits per pixel, packing {packing}; expected 8, 24 or 32 that are not compressed"
        raise SourceError(path, message, hint="Export the film as PNG or TIFF images.")
    _check_size(path, rows, columns, 8)
    is_whole = begin + -(-columns * colours // 4) * 4 * rows <= size
    return ImageHeader(rows, columns, 8, "" if is_whole else "the BMP is cut off")


def _jpeg(path: Path, stream: BinaryIO, size: int) -> ImageHeader:
    at = 2
    while at + 9 <= size:
        stream.seek(at)
        mark, kind, length, bits, rows, columns = struct.unpack(">BBHBHH", stream.read(9))
        if mark != 0xFF:
            break
        if kind in _JPEG_SIZES:
            _check_size(path, rows, columns, bits)
            stream.seek(-min(_JPEG_TAIL, size), os.SEEK_END)
            fault = "" if _JPEG_END in stream.read() else "the JPEG is cut off: its end mark is missing"
            return ImageHeader(rows, columns, bits, fault, is_compressed=True, kind="JPEG")
        at += 2 + length
    raise CutOffError(path, "the JPEG ends within its header", hint="Copy it from the camera again.")


def _png(path: Path, head: bytes, tail: bytes) -> ImageHeader:
    if len(head) < 33 or head[12:16] != b"IHDR":
        raise CutOffError(path, "the PNG ends within its header", hint="Copy it from the camera again.")
    columns, rows, bits, colour = struct.unpack(">IIBB", head[16:26])
    if colour not in _PNG_COLOURS:
        raise SourceError(path, f"the PNG is of colour type {colour}; known are 0, 2, 3, 4, 6", offset=25)
    _check_size(path, rows, columns, bits)
    fault = "" if tail == _PNG_END else "the PNG is cut off: its end mark is missing"
    return ImageHeader(rows, columns, bits, fault, kind="PNG")


def png_fault(path: Path) -> str:
    """Say what is wrong with the parts of a PNG by their own checksums, or "".

    A decoder would return nothing for such an image, or one that is not the one that was taken.
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


def _check_size(path: Path, rows: int, columns: int, bits: int, known: tuple[int, ...] = _BYTES) -> None:
    if min(rows, columns) < 1 or rows * columns > MOST_PIXELS:
        raise SourceError(
            path,
            f"declares {columns} × {rows} px; expected at least one and at most {MOST_PIXELS}",
            hint="A film of this project is far smaller: the header is damaged.",
        )
    if bits not in known:
        *most, last = map(str, sorted(known))
        message = f"holds {bits} bits per pixel; expected {', '.join(most)} or {last}"
        raise SourceError(path, message, hint="Export the film as grey images of 16 bits.")


def _tiff(path: Path, data: bytes | None) -> list[ImageHeader]:
    import mmap

    if data is not None:
        return _Tiff(path, data).pages()
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as view:
        return _Tiff(path, view).pages()


def one_page(path: Path, at: int) -> bytes:
    """Return a page of a TIFF, whose directory begins at a byte, as a TIFF of its own.

    A decoder that is asked for a page goes through all pages before it.
    """
    import mmap

    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as view:
        return _Tiff(path, view).page(at)


class _Tiff:
    """The chain of directories of a TIFF; no pixel is touched."""

    def __init__(self, path: Path, data: "bytes | object") -> None:
        self.path = path
        self.data: bytes = data  # type: ignore[assignment]  # a mapped file is read as bytes are
        self.order = "<" if self.data[:2] == b"II" else ">"
        self.is_big = self.unpack("H", 2) == 43
        self.word = "Q" if self.is_big else "I"  # of places and counts
        self.unread = len(self.data)

    def spend(self, length: int, at: int) -> None:
        """Count bytes of directories and lists; a sound file holds each of them once."""
        self.unread -= length
        if self.unread < 0:
            message = "the TIFF's directories and lists are longer than the file: they overlap"
            raise SourceError(self.path, message, offset=at)

    def unpack(self, layout: str, at: int) -> int:
        size = struct.calcsize(self.order + layout)
        if not 0 <= at <= len(self.data) - size:
            hint = "It is cut off or damaged: copy it from the camera again."
            raise CutOffError(self.path, "the TIFF points outside of itself", offset=at, hint=hint)
        return int(struct.unpack(self.order + layout, self.data[at : at + size])[0])

    def pages(self) -> list[ImageHeader]:
        at = self.unpack(self.word, 8 if self.is_big else 4)
        seen: set[int] = set()
        found: list[ImageHeader] = []
        while at:
            if at in seen or len(seen) >= MOST_PAGES:
                raise SourceError(self.path, "the TIFF's pages form a circle", offset=at)
            seen.add(at)
            try:
                header, at = self._page(at)
            except CutOffError:
                if not found:
                    raise
                header, at = (
                    found[0]._replace(fault="the TIFF breaks off before it, and how many follow is not known"),
                    0,
                )
            found.append(header)
        if not found:
            raise SourceError(self.path, "the TIFF holds no image")
        return found

    def _page(self, at: int) -> tuple[ImageHeader, int]:
        entries = self._entries(at)
        self.spend(entries.stop - entries.start, at)
        tags = {}
        for entry in entries[:_MOST_FIELDS]:
            tag = self.unpack("H", entry)
            if tag in _WANTED:
                tags[tag] = self._values(entry)
        return self._header(tags, at), self.unpack(self.word, entries.stop)

    def page(self, at: int) -> bytes:
        """Return a page as a TIFF of its own: a large one, whose numbers reach everywhere."""
        fields = self._fields(at)
        fields.pop(_ORIENTATION, None)  # as the sensor has it, however the camera was held
        starts, tail = {}, bytearray()
        begin = _LARGE_HEAD + 8 + 20 * len(fields) + 8
        for of, sizes in ((_OFFSETS, _COUNTS), (_TILE_OFFSETS, _TILE_COUNTS)):
            if of in fields:
                places = [self._values(fields[tag].entry) for tag in (of, sizes)]
                starts[of] = struct.pack(f"{self.order}{len(places[0])}Q", *self._moved(places, begin, tail))
        directory = bytearray()
        for tag, field in fields.items():
            kind, value = (16, starts[tag]) if tag in starts else (field.kind, self._stored(field))
            if len(value) > 8:
                tail += value + b"\0" * (-len(value) % 8)
                value = struct.pack(f"{self.order}Q", begin + len(tail) - len(value) - (-len(value) % 8))
            directory += struct.pack(f"{self.order}HHQ", tag, kind, field.number) + value.ljust(8, b"\0")
        head = (b"II" if self.order == "<" else b"MM") + struct.pack(f"{self.order}HHHQ", 43, 8, 0, _LARGE_HEAD)
        return bytes(head + struct.pack(f"{self.order}Q", len(fields)) + directory + bytes(8) + tail)

    def _moved(self, places: list[list[int]], begin: int, tail: bytearray) -> list[int]:
        """Copy stretches of the file behind others that begin at a byte, and return where they are then."""
        found = []
        for start, length in zip(*places, strict=True):
            found.append(begin + len(tail))
            tail += self.data[start : start + length]
            tail += b"\0" * (-len(tail) % 8)
        return found

    def _entries(self, at: int) -> range:
        """Return where the fields of a directory begin."""
        count = self.unpack("Q" if self.is_big else "H", at)
        first, size = (at + 8, 20) if self.is_big else (at + 2, 12)
        return range(first, first + size * count, size)

    def _fields(self, at: int) -> dict[int, "_Field"]:
        return {self.unpack("H", entry): self._field(entry) for entry in self._entries(at)}

    def _field(self, entry: int) -> "_Field":
        return _Field(entry, self.unpack("H", entry + 2), self.unpack(self.word, entry + 4))

    def _place(self, entry: int, length: int) -> tuple[int, bool]:
        """Return where the values of a field lie: in it, or elsewhere, where it points."""
        room, place = (8, entry + 12) if self.is_big else (4, entry + 8)
        return (self.unpack(self.word, place), True) if length > room else (place, False)

    def _stored(self, field: "_Field") -> bytes:
        """Return the bytes of a field."""
        length = field.number * _TIFF_SIZES.get(field.kind, 8)
        place, _ = self._place(field.entry, length)
        return self.data[place : place + length]

    def _values(self, entry: int) -> list[int]:
        _, kind, count = self._field(entry)
        size = _TIFF_SIZES.get(kind, 0)
        layout = {1: "B", 2: "H", 4: "I", 8: "Q"}.get(size)
        if layout is None or count == 0 or count * size > len(self.data):
            raise SourceError(self.path, f"a TIFF field of type {kind} and {count} values", offset=entry)
        place, is_elsewhere = self._place(entry, count * size)
        if is_elsewhere:
            self.spend(count * size, entry)
        return [self.unpack(layout, place + i * size) for i in range(count)]

    def _header(self, tags: dict[int, list[int]], at: int) -> ImageHeader:
        rows, columns = (tags.get(tag, [0])[0] for tag in (_LENGTH, _WIDTH))
        bits, samples = tags.get(_BITS, [1])[0], tags.get(_SAMPLES, [1])[0]
        meaning = tags.get(_PHOTOMETRIC, [1])[0]
        if not (samples == 1 and meaning in (0, 1, _PALETTE)) and not (samples in (3, 4) and meaning == _RGB):
            raise SourceError(
                self.path,
                f"a page has {samples} samples per pixel of interpretation {meaning}; expected grey or RGB",
                offset=at,
                hint="Export the film as grey TIFF or PNG images.",
            )
        packing = tags.get(_COMPRESSION, [_PLAIN])[0]
        if packing not in _COMPRESSIONS:
            raise SourceError(
                self.path,
                f"a page is compressed by method {packing}, which is not read",
                offset=at,
                hint="Export the film as TIFF without compression, or with LZW or deflate.",
            )
        _check_size(self.path, rows, columns, bits, _BYTES + _PACKED * (samples == 1))
        starts = tags.get(_OFFSETS) or tags.get(_TILE_OFFSETS, [])
        sizes = tags.get(_COUNTS) or tags.get(_TILE_COUNTS, [])
        ends = [s + n for s, n in zip(starts, sizes, strict=False)]
        is_whole = ends and len(starts) == len(sizes) and max(ends) <= len(self.data)
        return ImageHeader(rows, columns, bits, "" if is_whole else "the TIFF page is cut off", packing != _PLAIN, at)

"""Headers of image files, read before anything is decoded: a few bytes can declare an image of any size.

Accepted are PNG, TIFF, BMP and JPEG of 8 bits, PNG and TIFF of 16, and grey TIFF of 10, 12 or 14 packed bits in files
of one image. Pillow reads the headers of PNG, BMP and JPEG, tifffile those of TIFF.
"""

import logging
import struct
import warnings
from pathlib import Path
from typing import NamedTuple

import tifffile
from PIL import Image

from instruments.images import is_tiff
from labpipe.errors import SourceError

_MOST_PIXELS = 1 << 26  # of one image: four times the largest camera
_ENDS = {"PNG": b"\x00\x00\x00\x00IEND\xaeB`\x82", "JPEG": b"\xff\xd9", "BMP": b""}
_COMPRESSIONS = {1, 5, 7, 8, 32773, 32946}  # of TIFF: none, LZW, JPEG, deflate by two numbers, PackBits
_COPY = "It is damaged: copy it from the camera again."
_EXPORT = "Export the film as grey TIFF without compression, or as PNG images."
UNREADABLE = (
    OSError, ValueError, TypeError, SyntaxError, EOFError, IndexError, struct.error, Image.DecompressionBombError
)  # fmt: skip
"""Errors of Pillow over a damaged file."""
logging.getLogger("tifffile").setLevel(logging.CRITICAL)  # damage is reported once, by an error or a warning of ours


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
            head = stream.read(34)
            size = stream.seek(0, 2)
            stream.seek(-min(size, 64), 2)
            tail = stream.read()
    except OSError as error:
        raise SourceError(path, f"cannot be opened: {error.strerror}") from None
    if not head:
        raise CutOffError(path, "the image is empty")
    if is_tiff(head):
        return _tiff(path, size)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of sizes, which are checked below
            with Image.open(path, formats=tuple(_ENDS)) as image:
                kind, (columns, rows) = str(image.format), image.size
    except UNREADABLE as error:
        if isinstance(error, Image.DecompressionBombError):
            raise SourceError(path, f"declares an image that no camera takes: {error}", hint=_COPY) from None
        text = "ends within its header, or is neither PNG nor TIFF nor BMP nor JPEG"
        raise CutOffError(path, f"{text}: it starts with {head[:8]!r}", hint=_EXPORT) from None
    is_whole = int.from_bytes(head[2:6], "little") <= size if kind == "BMP" else _ENDS[kind] in tail
    fault = "" if is_whole else f"the {kind} is cut off: its end is missing"
    bits = head[24] if kind == "PNG" else 8
    return [_checked(path, ImageHeader(rows, columns, bits, fault, kind == "JPEG", kind))]


def checksum_fault(path: Path) -> str:
    """Return why the parts of a PNG contradict their checksums, or "".

    A decoder would return nothing for such an image, or other pixels than those that were taken.
    """
    try:
        with Image.open(path) as image:
            image.verify()
    except UNREADABLE as error:
        return f"the PNG contradicts its checksums: {error}"
    return ""


def _checked(path: Path, header: ImageHeader, known: tuple[int, ...] = (8, 16)) -> ImageHeader:
    rows, columns, bits, *_ = header
    if min(rows, columns) < 1 or rows * columns > _MOST_PIXELS:
        message = f"declares {columns} × {rows} px; expected at least one and at most {_MOST_PIXELS}"
        raise SourceError(path, message, hint="No camera takes such images: the header is damaged.")
    if bits not in known:
        expected = f"{', '.join(map(str, known[:-1]))} or {known[-1]}"
        hint = "Export the film as grey images of 16 bits."
        raise SourceError(path, f"holds {bits} bits per pixel; expected {expected}", hint=hint)
    return header


def _tiff(path: Path, size: int) -> list[ImageHeader]:
    """Go through the pages of a TIFF; no pixel is touched."""
    headers: list[ImageHeader] = []
    said = "a page ends behind the file"
    try:
        with tifffile.TiffFile(path) as film:
            count, is_broken = _pages(path, film)
            stated = int((film.imagej_metadata or {}).get("images", 1)) if film.is_imagej else 1
            if stated > count and not is_broken:  # ImageJ describes only the first image of a stack beyond 4 GB
                text = f"ImageJ states {stated} images, of which {count} are described in the file"
                raise SourceError(path, text, hint="Save the stack as an image sequence of TIFF or PNG files.")
            headers.extend(_page(path, film.pages[index], size, several=count > 1) for index in range(count))
    except (tifffile.TiffFileError, MemoryError, *UNREADABLE) as error:
        is_broken, said = True, str(error)
    if is_broken and not headers:
        raise CutOffError(path, f"the TIFF is cut off or damaged: {said}", hint=_COPY)
    if is_broken:
        fault = "the TIFF breaks off before it, and the number of pages behind it is not known"
        headers.append(headers[0]._replace(fault=fault))
    return headers


def _pages(path: Path, film: tifffile.TiffFile) -> tuple[int, bool]:
    """Count the pages of a TIFF, each of which names the place of the next, and find out whether they break off."""
    form, handle, seen, at = film.tiff, film.filehandle, set[int](), film.pages[0].offset
    while at:
        if at in seen:
            raise SourceError(path, "the TIFF's pages form a circle", offset=at, hint=_COPY)
        try:
            handle.seek(at)
            (entries,) = struct.unpack(form.tagnoformat, handle.read(form.tagnosize))
            handle.seek(at + form.tagnosize + entries * form.tagsize)
            (following,) = struct.unpack(form.offsetformat, handle.read(form.offsetsize))
        except (struct.error, ValueError, OSError):
            return len(seen), True
        seen.add(at)
        at = following
    return len(seen), False


def _page(path: Path, page: "tifffile.TiffPage | tifffile.TiffFrame", size: int, *, several: bool) -> ImageHeader:
    if not isinstance(page, tifffile.TiffPage):
        raise SourceError(path, "a page holds no description of its image", hint=_EXPORT)
    samples, meaning, bits = page.samplesperpixel, int(page.photometric), page.bitspersample
    is_grey, is_colour = samples == 1 and meaning in (0, 1, 3), samples in (3, 4) and meaning == 2
    if not (is_grey or is_colour) or page.compression not in _COMPRESSIONS:
        message = f"a page has {samples} samples per pixel of interpretation {meaning}, compression {page.compression}"
        raise SourceError(path, f"{message}; expected grey or RGB", hint=_EXPORT)
    note = page.tags.get(274)
    is_turned = note is not None and note.value != 1
    if several and (is_turned or (is_colour and bits != 8)):
        text = "its pages are turned, or in colours of 16 bits; only files of one image may be"
        raise SourceError(path, text, hint=_EXPORT)
    starts, counts = page.dataoffsets, page.databytecounts
    is_whole = len(starts) == len(counts) > 0 and max(map(sum, zip(starts, counts, strict=True))) <= size
    fault = "" if is_whole else "the TIFF page is cut off"
    turned = note.valueoffset if note is not None and is_turned else 0
    header = ImageHeader(page.imagelength, page.imagewidth, bits, fault, page.compression != 1, "TIFF", turned)
    return _checked(path, header, (8, 16) if is_colour or several else (8, 10, 12, 14, 16))

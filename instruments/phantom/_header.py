"""Header of a Phantom .cine file.

Layout (little-endian, from the vendor's description): CINEFILEHEADER at 0, BITMAPINFOHEADER at 44, SETUP after it,
tagged blocks, the table of image offsets, images. Every declared size is compared with the file before it is used.
"""

import struct
from dataclasses import dataclass
from typing import Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from instruments._stored_film import LARGEST_SIDE, PACKED_GROUPS
from labpipe.arrays import Integers
from labpipe.binary import Window
from labpipe.errors import EXCHANGED, SourceError

Packing = Literal["8", "16", "10-packed", "12-packed"]

TAG_TIMES, TAG_EXPOSURES = 1002, 1003
_PACKINGS: dict[tuple[int, int], Packing] = {
    (8, 0): "8",
    (16, 0): "16",
    (16, 256): "10-packed",
    (16, 1024): "12-packed",
}
_BITS_OF_LEVELS = {2**bits: bits for bits in (8, 10, 12, 14, 16)}
_MOST_BLOCKS = 1 << 10  # tagged blocks; a film has about five


@dataclass(frozen=True, slots=True)
class Header:
    """Everything needed to find and decode the images.

    ``offsets`` is the table of image positions; ``stamps`` and ``exposures`` hold raw times of the frames in 2⁻³² s;
    ``frame_rate`` [1/s], ``decimation``, ``shutter`` [s] and the levels are settings. None is what the file lacks.
    """

    first_image: int
    count: int
    width: int
    height: int
    top_down: bool
    packing: Packing
    bits: int
    image_bytes: int
    trigger: int
    offsets: Integers
    stamps: NDArray[np.uint64] | None
    exposures: NDArray[np.uint32] | None
    frame_rate: int | None
    decimation: float | None
    shutter: float | None
    black_level: int | None
    white_level: int | None

    @property
    def packed_bits(self) -> int:
        """Bits of a pixel that is stored without gaps, 0 of others."""
        return int(self.packing[:2]) if self.packing.endswith("packed") else 0


def read_header(window: Window) -> Header:
    """Read and check everything before the images.

    SourceError where the file is no .cine, is colour or compressed, or declares more than it holds.
    """
    if window.take(0, 2, "the file type") != b"CI":
        text, hint = 'does not begin with "CI": not a Phantom .cine file', "Give the .cine file itself, not a sidecar."
        raise SourceError(window.path, text, hint=hint)
    compression = window.field("H", 4, "Compression")
    if compression == 1:
        text, hint = "the film is JPEG-compressed (.cci), which alters grey levels", "Save it as an uncompressed .cine."
        raise SourceError(window.path, text, offset=4, hint=hint)
    if compression == 2:
        _refuse_colour(window, "Compression is 2, an uninterpolated colour image")
    if compression != 0:
        _refuse(window, 4, f"Compression is {compression}; known are 0, 1 and 2")
    version = window.field("H", 6, "Version")
    if version not in {0, 1}:
        _refuse(window, 6, f"Version is {version}; known are 0 and 1")
    names = ("ImageCount", "OffImageHeader", "OffSetup", "OffImageOffsets")
    count, bitmap, setup_at, table_at = (window.field("I", 20 + 4 * k, name) for k, name in enumerate(names))
    if count == 0:
        _refuse(window, 20, "ImageCount is 0: the file holds no image")
    width, height, top_down, packing, bits, image_bytes = _image(window, bitmap)
    if window.take(setup_at + 140, 2, "the mark of SETUP") != b"ST":
        _refuse(window, setup_at + 140, 'SETUP does not carry its mark "ST"')
    length = window.field("H", setup_at + 142, "the length of SETUP")
    window.take(setup_at, length, "SETUP")

    def setting(layout: str, offset: int) -> float | None:
        return window.field(layout, setup_at + offset, "SETUP") if offset + struct.calcsize(layout) <= length else None

    def whole(layout: str, offset: int) -> int | None:
        value = setting(layout, offset)
        return None if value is None else int(value)

    if (whole("I", 1588), whole("I", 1592)) == (height, width) and width != height:
        text = f"the images are {width} × {height} px, in the camera's settings {height} × {width} px: "
        _refuse(window, bitmap + 4, f"{text}width and height are exchanged", EXCHANGED)
    if colour_filter := whole("I", 808):
        _refuse_colour(window, f"the sensor has a colour filter (CFA {colour_filter})")
    offsets = window.array("<i8" if version == 1 else "<u4", table_at, count, f"the table of {count} image offsets")
    stamps, exposures, stated = _tags(window, setup_at + length, table_at, count)
    room = (int(offsets.min()) - table_at) // offsets.dtype.itemsize
    if stated is not None and stated != count and stated == room:
        _refuse(window, 20, f"ImageCount is {count}, but there are time stamps and offsets of {stated} images")
    fractions, seconds = (window.field("I", at, "TriggerTime") for at in (36, 40))
    shutter_ns, shutter_us = whole("I", 1568), whole("I", 772)
    return Header(
        first_image=window.field("i", 16, "FirstImageNo"),
        count=count,
        width=width,
        height=height,
        packing=packing,
        bits=bits,
        top_down=top_down,
        image_bytes=image_bytes,
        trigger=(seconds << 32) | (fractions & ~3),
        offsets=offsets.astype(np.int64),
        stamps=stamps,
        exposures=exposures,
        frame_rate=whole("I", 768),
        decimation=setting("f", 10388),
        shutter=shutter_ns * 1e-9 if shutter_ns else shutter_us * 1e-6 if shutter_us else None,
        black_level=whole("i", 5732),
        white_level=whole("i", 5736),
    )


def _refuse(window: Window, offset: int, message: str, reason: str = "") -> NoReturn:
    hint = "The header is damaged; export the film again from the camera's software."
    raise SourceError(window.path, message, offset=offset, hint=hint).because(reason)


def _refuse_colour(window: Window, reason: str) -> NoReturn:
    text = f"this is a colour film: {reason}; labpipe measures on grey levels linear in light"
    hint = "Export it as monochrome (uninterpolated, grey) from the camera's software."
    raise SourceError(window.path, text, hint=hint)


def _image(window: Window, bitmap: int) -> tuple[int, int, bool, Packing, int, int]:
    """Read the BITMAPINFOHEADER: width, height, whether the first row is stored first, packing, bits, bytes."""
    width, height = window.field("i", bitmap + 4, "biWidth"), window.field("i", bitmap + 8, "biHeight")
    if not (0 < width <= LARGEST_SIDE and 0 < abs(height) <= LARGEST_SIDE):
        _refuse(window, bitmap + 4, f"the image size is {width} × {height} px")
    depth = window.field("H", bitmap + 14, "biBitCount")
    compression = window.field("I", bitmap + 16, "biCompression")
    if depth in {24, 48}:
        _refuse_colour(window, f"{depth} bits per pixel are three colours")
    packing = _PACKINGS.get((depth, compression))
    if packing is None:
        text = f"biBitCount {depth} with biCompression {compression} is no known pixel format; known are 8 and 16 "
        _refuse(window, bitmap + 14, f"{text}plain, 16 with 256 (10-bit packed) and 16 with 1024 (12-bit packed)")
    levels = window.field("I", bitmap + 36, "biClrImportant")
    bits = {"8": 8, "10-packed": 10, "12-packed": 12}.get(packing, _BITS_OF_LEVELS.get(levels, 16))
    stored = 16 if packing == "16" else bits
    if width % PACKED_GROUPS.get(stored, (1, 1))[0]:
        _refuse(window, bitmap + 4, f"a width of {width} px does not fit {packing} rows")
    expected = width * abs(height) * stored // 8
    declared = window.field("I", bitmap + 20, "biSizeImage")
    if declared not in {expected, 0}:
        text = f"biSizeImage is {declared} bytes, but {width} × {abs(height)} px of this format need {expected}"
        _refuse(window, bitmap + 20, text)
    return width, abs(height), height < 0 or packing.endswith("packed"), packing, bits, expected


def _tags(
    window: Window, start: int, end: int, count: int
) -> tuple[NDArray[np.uint64] | None, NDArray[np.uint32] | None, int | None]:
    """Walk the tagged blocks, up to one whose size cannot be right: stamps, exposures, how many stamps there are."""
    stamps: NDArray[np.uint64] | None = None
    exposures: NDArray[np.uint32] | None = None
    stated: int | None = None
    at = start
    for _ in range(_MOST_BLOCKS):
        if at + 8 > min(end, window.size):
            break
        size, kind, more = struct.unpack("<IHH", window.take(at, 8, "a tagged block"))
        if size < 8 or at + size > window.size:
            break
        if kind == TAG_TIMES:
            stated = (size - 8) // 8
        if kind == TAG_TIMES and size >= 8 + 8 * count:
            pairs = window.array("<u4", at + 8, 2 * count, "time stamps").astype(np.uint64)
            # fractions come first; their two lowest bits are flags, not time
            stamps = (pairs[1::2] << np.uint64(32)) | (pairs[0::2] & ~np.uint64(3))
        elif kind == TAG_EXPOSURES and size >= 8 + 4 * count:
            exposures = window.array("<u4", at + 8, count, "exposures").astype(np.uint32)
        if not more:
            break
        at += size
    return stamps, exposures, stated

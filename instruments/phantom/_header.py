"""Header of a Phantom .cine file.

Layout (little-endian, from the vendor's description of the format): CINEFILEHEADER at 0,
BITMAPINFOHEADER at 44, SETUP after it, tagged blocks, the table of image offsets, images.
Every declared size is compared with the file before it is used.
"""

from dataclasses import dataclass
from typing import Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

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
_SIZE_AT = 1588  # of SETUP: columns and rows of the images
_LARGEST_SIDE = 1 << 15  # pixels; no sensor of this family is larger
_MOST_BLOCKS = 1 << 10  # tagged blocks; a film has about five


@dataclass(frozen=True, slots=True)
class Setup:
    """The recording's settings, shown beside the film; None where this version of the format has no such field."""

    frame_rate: int | None
    decimation: float | None
    shutter: float | None
    black_level: int | None
    white_level: int | None
    real_bits: int | None
    serial: int | None
    software_version: int | None
    colour_filter: int
    camera_model: str
    lens: str
    description: str
    time_zone: int | None


@dataclass(frozen=True, slots=True)
class Header:
    """Everything needed to find and decode the images.

    ``offsets`` is the table of image positions; ``stamps`` holds raw 64-bit times of the frames
    and ``exposures`` their exposure in units of 2⁻³² s, both None where the file lacks them.
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
    setup: Setup


def read_header(window: Window) -> Header:
    """Read and check everything before the images.

    Raises
    ------
    SourceError
        The file is no .cine, is colour or compressed, or declares what it does not hold.
    """
    if window.take(0, 2, "the file type") != b"CI":
        raise SourceError(
            window.path,
            'does not begin with "CI": not a Phantom .cine file',
            hint="Give the .cine file itself, not a sidecar or an export.",
        )
    _require_grey(window, window.integer("H", 4, "Compression"))
    version = window.integer("H", 6, "Version")
    if version not in {0, 1}:
        _refuse(window, 6, f"Version is {version}; known are 0 and 1")
    count = window.integer("I", 20, "ImageCount")
    bitmap = window.integer("I", 24, "OffImageHeader")
    setup_at = window.integer("I", 28, "OffSetup")
    table_at = window.integer("I", 32, "OffImageOffsets")
    if count == 0:
        _refuse(window, 20, "ImageCount is 0: the file holds no image")
    width, height, top_down = _size(window, bitmap)
    packing, bits = _packing(window, bitmap)
    image_bytes = _image_bytes(window, bitmap, width, height, packing)
    setup, setup_length = _setup(window, setup_at)
    _require_upright(window, bitmap, setup_at, setup_length, width, height)
    if setup.colour_filter:
        _refuse_colour(window, f"the sensor has a colour filter (CFA {setup.colour_filter})")
    kind = "<i8" if version == 1 else "<u4"
    offsets = window.array(kind, table_at, count, f"the table of {count} image offsets")
    stamps, exposures, stated = _tags(window, setup_at + setup_length, table_at, count)
    room = (int(offsets.min()) - table_at) // offsets.dtype.itemsize
    if stated is not None and stated != count and stated == room:
        _refuse(window, 20, f"ImageCount is {count}, but there are time stamps and offsets of {stated} images")
    fractions = window.integer("I", 36, "TriggerTime")
    seconds = window.integer("I", 40, "TriggerTime")
    return Header(
        first_image=window.integer("i", 16, "FirstImageNo"),
        count=count,
        width=width,
        height=height,
        packing=packing,
        bits=bits,
        top_down=top_down or packing.endswith("packed"),
        image_bytes=image_bytes,
        trigger=(seconds << 32) | (fractions & ~3),
        offsets=offsets.astype(np.int64),
        stamps=stamps,
        exposures=exposures,
        setup=setup,
    )


def _refuse(window: Window, offset: int, message: str, reason: str = "") -> NoReturn:
    hint = "The header is damaged; export the film again from the camera's software."
    raise SourceError(window.path, message, offset=offset, hint=hint).because(reason)


def _refuse_colour(window: Window, reason: str) -> NoReturn:
    raise SourceError(
        window.path,
        f"this is a colour film: {reason}; labpipe measures on grey levels linear in light",
        hint="Export it as monochrome (uninterpolated, grey) from the camera's software.",
    )


def _require_grey(window: Window, compression: int) -> None:
    if compression == 1:
        raise SourceError(
            window.path,
            "the film is JPEG-compressed (.cci), which alters grey levels",
            offset=4,
            hint="Save it as an uncompressed .cine from the camera's software.",
        )
    if compression == 2:
        _refuse_colour(window, "Compression is 2, an uninterpolated colour image")
    if compression != 0:
        _refuse(window, 4, f"Compression is {compression}; known are 0, 1 and 2")


def _size(window: Window, bitmap: int) -> tuple[int, int, bool]:
    width = window.integer("i", bitmap + 4, "biWidth")
    height = window.integer("i", bitmap + 8, "biHeight")
    if not (0 < width <= _LARGEST_SIDE and 0 < abs(height) <= _LARGEST_SIDE):
        _refuse(window, bitmap + 4, f"the image size is {width} × {height} px")
    return width, abs(height), height < 0


def _packing(window: Window, bitmap: int) -> tuple[Packing, int]:
    depth = window.integer("H", bitmap + 14, "biBitCount")
    compression = window.integer("I", bitmap + 16, "biCompression")
    if depth in {24, 48}:
        _refuse_colour(window, f"{depth} bits per pixel are three colours")
    packing = _PACKINGS.get((depth, compression))
    if packing is None:
        _refuse(
            window,
            bitmap + 14,
            f"biBitCount {depth} with biCompression {compression} is no known pixel format; known "
            "are 8 and 16 plain, 16 with 256 (10-bit packed) and 16 with 1024 (12-bit packed)",
        )
    levels = window.integer("I", bitmap + 36, "biClrImportant")
    fixed = {"8": 8, "10-packed": 10, "12-packed": 12}
    return packing, fixed.get(packing, _BITS_OF_LEVELS.get(levels, 16))


def _image_bytes(window: Window, bitmap: int, width: int, height: int, packing: Packing) -> int:
    per_pixel = {"8": (1, 1), "16": (2, 1), "10-packed": (5, 4), "12-packed": (3, 2)}
    over, under = per_pixel[packing]
    if width % under:
        _refuse(window, bitmap + 4, f"a width of {width} px does not fit {packing} rows")
    expected = width * height * over // under
    declared = window.integer("I", bitmap + 20, "biSizeImage")
    if declared not in {expected, 0}:
        _refuse(
            window,
            bitmap + 20,
            f"biSizeImage is {declared} bytes, but {width} × {height} px of this format need {expected}",
        )
    return expected


def _require_upright(window: Window, bitmap: int, setup_at: int, length: int, width: int, height: int) -> None:
    """Hold the size of the images against that in the camera's settings, where these are long enough."""
    if length < _SIZE_AT + 8:
        return
    own = [int(window.field("I", setup_at + _SIZE_AT + 4 * i, "SETUP")) for i in (0, 1)]
    if own == [height, width] and width != height:
        text = f"the images are {width} × {height} px, in the camera's settings {height} × {width} px: "
        _refuse(window, bitmap + 4, f"{text}width and height are exchanged", EXCHANGED)


def _setup(window: Window, start: int) -> tuple[Setup, int]:
    if window.take(start + 140, 2, "the mark of SETUP") != b"ST":
        _refuse(window, start + 140, 'SETUP does not carry its mark "ST"')
    length = window.integer("H", start + 142, "the length of SETUP")
    window.require(start, length, "SETUP")

    def number(layout: str, offset: int, size: int) -> int | float | None:
        return window.field(layout, start + offset, "SETUP") if offset + size <= length else None

    def whole(layout: str, offset: int, size: int) -> int | None:
        value = number(layout, offset, size)
        return None if value is None else int(value)

    def text(offset: int, size: int) -> str:
        if offset + size > length:
            return ""
        raw = window.take(start + offset, size, "SETUP").split(b"\0", 1)[0]
        return "".join(c for c in raw.decode("latin-1") if c.isprintable())

    shutter_ns, shutter_us = whole("I", 1568, 4), whole("I", 772, 4)
    shutter = shutter_ns * 1e-9 if shutter_ns else shutter_us * 1e-6 if shutter_us else None
    return Setup(
        frame_rate=whole("I", 768, 4),
        decimation=number("f", 10388, 4),
        shutter=shutter,
        black_level=whole("i", 5732, 4),
        white_level=whole("i", 5736, 4),
        real_bits=whole("I", 896, 4),
        serial=whole("I", 743, 4),
        software_version=whole("I", 800, 4),
        colour_filter=whole("I", 808, 4) or 0,
        camera_model=text(10128, 256),
        lens=text(5740, 256),
        description=text(1596, 4096),
        time_zone=whole("i", 804, 4),
    ), length


def _tags(
    window: Window, start: int, end: int, count: int
) -> tuple[NDArray[np.uint64] | None, NDArray[np.uint32] | None, int | None]:
    """Walk the tagged blocks for stamps, exposures, and how many stamps there are.

    A block that lies about its size ends the walk.
    """
    stamps: NDArray[np.uint64] | None = None
    exposures: NDArray[np.uint32] | None = None
    stated: int | None = None
    at = start
    for _ in range(_MOST_BLOCKS):
        if at + 8 > min(end, window.size):
            break
        size = window.integer("I", at, "a tagged block")
        kind = window.integer("H", at + 4, "a tagged block")
        more = window.integer("H", at + 6, "a tagged block")
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

"""Writing .cine films, for sample data and round-trip tests.

The layout is that of the vendor's current version (SETUP of 10,412 bytes, 64-bit offsets, time
stamps and exposures per frame), so that other readers of the format take these files too.
"""

import os
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from instruments._stored_film import PACKED_GROUPS
from instruments.phantom._film import linear_from_companded
from instruments.phantom._header import TAG_EXPOSURES, TAG_TIMES, Packing
from labpipe import files
from labpipe.arrays import Floats
from labpipe.errors import InputError

_SETUP_BYTES = 10412
_SETUP_AT = 84
_SOFTWARE = 781  # the version whose SETUP this is
_UNIT = 2.0**-32  # s
_FLAGS = 3  # the two lowest bits of every stamp seen in real films
_PITCH = 35714  # pixels per metre on the sensor, 28 µm
_LEVELS = {8: (4, 254), 10: (64, 1014), 12: (64, 4064), 14: (256, 16256), 16: (0, 65535)}


@dataclass(frozen=True, slots=True)
class Recording:
    """How a film was recorded.

    ``bits`` are 8, 10, 12, 14 or 16; ``packed`` stores 10 or 12 bits without gaps. The pixels of
    a 10-bit packed film are handed over as 12-bit linear levels and are companded on writing.
    ``trigger`` is the trigger's time in s since 1970 (UTC).
    """

    frame_rate: int
    exposure: float
    bits: int = 12
    packed: bool = False
    trigger: int = 1_700_000_000
    first_image: int = 0
    camera: str = ""
    lens: str = ""
    description: str = ""


def write(
    path: str | os.PathLike[str],
    images: Iterable[NDArray[np.integer]],
    shape: tuple[int, int, int],
    time: Floats,
    recording: Recording,
) -> None:
    """Write a film frame by frame; the whole is never in memory.

    Parameters
    ----------
    path : path-like
        Where to.
    images : iterable of array (row, column)
        ``shape[0]`` images, first row on top.
    shape : (int, int, int)
        Frames, rows, columns.
    time : array (frame,) [s]
        Time since the trigger.
    recording : Recording
        Everything else.

    Raises
    ------
    InputError
        Sizes do not fit the format or each other, or an image is not of the stated shape.
    """
    count, height, width = shape
    packing, bits = _packing(recording), recording.bits
    group = PACKED_GROUPS[bits][0] if recording.packed else 1
    if count < 1 or len(time) != count or width % group:
        raise InputError(
            f"{count} frames of {height} × {width} px with {len(time)} times cannot be stored as {packing}: at least "
            f"one frame, one time each, and a width that is a multiple of {group}"
        )
    if not 0 < recording.exposure < 1:
        raise InputError(f"an exposure of {recording.exposure} s: the format holds more than 0, below 1 s")
    image_bytes = width * height * (16 if packing == "16" else bits) // 8
    head = _head(shape, np.asarray(time, float), recording, packing, image_bytes)

    def chunks() -> Iterator[bytes]:
        yield head
        written = 0
        for image in images:
            if image.shape != shape[1:]:
                raise InputError(f"image {written} has shape {image.shape}, expected {shape[1:]}")
            yield struct.pack("<II", 8, image_bytes) + _encode(image, packing)
            written += 1
        if written != count:
            raise InputError(f"{written} images were given, {count} were announced")

    files.write_chunks(path, len(head) + count * (image_bytes + 8), chunks())


def _packing(recording: Recording) -> Packing:
    bits, packed = recording.bits, recording.packed
    if bits not in _LEVELS or (packed and bits not in PACKED_GROUPS):
        text = f"{bits} bits{' packed' if packed else ''} is no format of these cameras; known are 8, 10, 12, 14, 16, "
        raise InputError(text + "and 10 or 12 packed")
    if packed:
        return "10-packed" if bits == 10 else "12-packed"
    return "8" if bits == 8 else "16"


def _encode(image: NDArray[np.integer], packing: Packing) -> bytes:
    if packing == "8":
        return image[::-1].astype(np.uint8).tobytes()
    if packing == "16":
        return image[::-1].astype("<u2").tobytes()
    if packing == "12-packed":
        return pack(image.astype(np.uint16), 12).tobytes()
    return pack(companded_from_linear()[np.clip(image, 0, 4095)], 10).tobytes()


def pack(pixels: NDArray[np.uint16], bits: int) -> NDArray[np.uint8]:
    """Pack values of 10 or 12 bits, the inverse of :func:`instruments._stored_film.unpacked`."""
    every = pixels[..., None] >> np.arange(bits, dtype=np.uint16)[::-1] & 1
    return np.packbits(every.astype(np.uint8).reshape(pixels.shape[0], -1), axis=1)


@cache
def companded_from_linear() -> NDArray[np.uint16]:
    """Nearest companded value of every 12-bit linear level."""
    table, levels = linear_from_companded().astype(np.int64), np.arange(4096)
    above = np.clip(np.searchsorted(table, levels), 1, 1023)
    return np.where(levels - table[above - 1] <= table[above] - levels, above - 1, above).astype(np.uint16)


def _head(shape: tuple[int, int, int], time: Floats, recording: Recording, packing: Packing, image_bytes: int) -> bytes:
    count, height, width = shape
    ticks = np.rint(time / _UNIT).astype(np.int64)
    stamps = ((recording.trigger << 32) + ticks).astype(np.uint64) & ~np.uint64(_FLAGS)
    stamps |= np.uint64(_FLAGS)
    pairs = np.empty(2 * count, dtype="<u4")
    pairs[0::2], pairs[1::2] = stamps & np.uint64(0xFFFFFFFF), stamps >> np.uint64(32)
    exposure = np.full(count, round(recording.exposure / _UNIT), dtype="<u4")
    blocks = struct.pack("<IHH", 8 + 8 * count, TAG_TIMES, 1) + pairs.tobytes()
    blocks += struct.pack("<IHH", 8 + 4 * count, TAG_EXPOSURES, 0) + exposure.tobytes()
    table_at = _SETUP_AT + _SETUP_BYTES + len(blocks)
    first = table_at + 8 * count
    offsets = first + np.arange(count, dtype="<i8") * (image_bytes + 8)
    file_header = struct.pack(
        "<2sHHHiIiIIIIII",
        *(b"CI", 44, 0, 1, recording.first_image, count, recording.first_image, count),
        *(44, _SETUP_AT, table_at, _FLAGS, recording.trigger),
    )
    compression = {"10-packed": 256, "12-packed": 1024}.get(packing, 0)
    bitmap = struct.pack(
        "<IiiHHIIiiII",
        *(40, width, height, 1, 8 if packing == "8" else 16, compression),
        *(image_bytes, _PITCH, _PITCH, 0, 2**recording.bits),
    )
    return file_header + bitmap + _setup(recording, shape) + blocks + offsets.tobytes()


def _setup(recording: Recording, shape: tuple[int, int, int]) -> bytes:
    _, height, width = shape
    setup = bytearray(_SETUP_BYTES)

    def put(layout: str, offset: int, value: float | bytes) -> None:
        struct.pack_into("<" + layout, setup, offset, value)

    black, white = _LEVELS[recording.bits]
    rate, exposure = recording.frame_rate, recording.exposure
    fields = (
        ("H", 0, min(rate, 65535)), ("2s", 140, b"ST"), ("H", 142, _SETUP_BYTES), ("H", 737, width), ("H", 739, height),
        ("I", 768, rate), ("I", 772, round(exposure * 1e6)), ("I", 800, _SOFTWARE), ("I", 896, recording.bits),
        ("I", 1568, round(exposure * 1e9)), ("I", 1588, width), ("I", 1592, height), ("i", 5732, black),
        ("i", 5736, white), ("I", 10112, recording.bits), ("f", 10388, 1.0), ("d", 10400, float(rate)),
    )  # fmt: skip
    for layout, at, value in fields:
        put(layout, at, value)
    for offset, size, text in (
        (1596, 4096, recording.description),
        (5740, 256, recording.lens),
        (10128, 256, recording.camera),
    ):
        put(f"{size}s", offset, text.encode("latin-1", "replace")[: size - 1])
    return bytes(setup)

"""Writing .cine films of 8 or 16 stored bits, for sample data and tests, in the layout of the vendor's version 781."""

import os
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instruments.phantom._header import TAG_EXPOSURES, TAG_TIMES
from instruments.phantom._times import UNIT
from labpipe import files
from labpipe.arrays import Floats
from labpipe.errors import InputError

_SETUP_BYTES = 10412
_SETUP_AT = 84
_SOFTWARE = 781  # the version whose SETUP this is
_FLAGS = 3  # the two lowest bits of every stamp seen in real films
_PITCH = 35714  # pixels per metre on the sensor, 28 µm
_LEVELS = {8: (4, 254), 10: (64, 1014), 12: (64, 4064), 14: (256, 16256), 16: (0, 65535)}


@dataclass(frozen=True, slots=True)
class Recording:
    """How a film was recorded: rate [1/s], exposure [s], 8, 10, 12, 14 or 16 bits, trigger [s since 1970, UTC]."""

    frame_rate: int
    exposure: float
    bits: int = 12
    trigger: int = 1_700_000_000
    first_image: int = 0
    camera: str = ""
    description: str = ""


def write(
    path: str | os.PathLike[str],
    images: Iterable[NDArray[np.integer]],
    shape: tuple[int, int, int],
    time: Floats,
    recording: Recording,
) -> None:
    """Write a film frame by frame; the whole is never in memory.

    ``images`` have shape (row, column), their first row on top; ``shape`` is that of the film (frame, row, column),
    ``time`` (frame,) [s] that since the trigger. InputError where sizes do not fit the format or each other.
    """
    count, height, width = shape
    for is_wrong, text in (
        (recording.bits not in _LEVELS, f"{recording.bits} bits is no format of these cameras, of {list(_LEVELS)}"),
        (count < 1 or len(time) != count, f"{count} frames with {len(time)} times: at least one frame, one time each"),
        (not 0 < recording.exposure < 1, f"an exposure of {recording.exposure} s: expected more than 0, below 1 s"),
    ):
        if is_wrong:
            raise InputError(text)
    kind = np.dtype(np.uint8 if recording.bits == 8 else "<u2")
    image_bytes = width * height * kind.itemsize
    head = _head(shape, np.asarray(time, float), recording, kind.itemsize)

    def chunks() -> Iterator[bytes]:
        yield head
        written = 0
        for image in images:
            if image.shape != shape[1:]:
                raise InputError(f"image {written} has shape {image.shape}, expected {shape[1:]}")
            yield struct.pack("<II", 8, image_bytes) + image[::-1].astype(kind).tobytes()
            written += 1
        if written != count:
            raise InputError(f"{written} images were given, {count} were announced")

    files.write_bytes(path, chunks(), len(head) + count * (image_bytes + 8))


def _head(shape: tuple[int, int, int], time: Floats, recording: Recording, pixel_bytes: int) -> bytes:
    count, height, width = shape
    rate, exposure, (black, white) = recording.frame_rate, recording.exposure, _LEVELS[recording.bits]
    stamps = ((recording.trigger << 32) + np.rint(time / UNIT).astype(np.int64)).astype(np.uint64) | np.uint64(_FLAGS)
    pairs = np.column_stack([stamps & np.uint64(0xFFFFFFFF), stamps >> np.uint64(32)]).astype("<u4")
    blocks = struct.pack("<IHH", 8 + 8 * count, TAG_TIMES, 1) + pairs.tobytes()
    blocks += struct.pack("<IHH", 8 + 4 * count, TAG_EXPOSURES, 0)
    blocks += np.full(count, round(exposure / UNIT), dtype="<u4").tobytes()
    table_at = _SETUP_AT + _SETUP_BYTES + len(blocks)
    image_bytes = width * height * pixel_bytes
    offsets = table_at + 8 * count + np.arange(count, dtype="<i8") * (image_bytes + 8)
    file_header = struct.pack(
        "<2sHHHiIiIIIIII",
        *(b"CI", 44, 0, 1, recording.first_image, count, recording.first_image, count),
        *(44, _SETUP_AT, table_at, _FLAGS, recording.trigger),
    )
    bitmap = struct.pack(
        "<IiiHHIIiiII", *(40, width, height, 1, 8 * pixel_bytes, 0, image_bytes, _PITCH, _PITCH, 0, 2**recording.bits)
    )
    setup = bytearray(_SETUP_BYTES)
    fields = (
        ("H", 0, min(rate, 65535)), ("2s", 140, b"ST"), ("H", 142, _SETUP_BYTES), ("H", 737, width), ("H", 739, height),
        ("I", 768, rate), ("I", 772, round(exposure * 1e6)), ("I", 800, _SOFTWARE), ("I", 896, recording.bits),
        ("I", 1568, round(exposure * 1e9)), ("I", 1588, width), ("I", 1592, height), ("i", 5732, black),
        ("i", 5736, white), ("I", 10112, recording.bits), ("f", 10388, 1.0), ("d", 10400, float(rate)),
        ("4096s", 1596, recording.description.encode("latin-1", "replace")[:4095]),
        ("256s", 10128, recording.camera.encode("latin-1", "replace")[:255]),
    )  # fmt: skip
    for layout, at, value in fields:
        struct.pack_into("<" + layout, setup, at, value)
    return file_header + bitmap + bytes(setup) + blocks + offsets.tobytes()

"""Pixels of a .cine image: rows of bytes to grey levels that are linear in light.

Unpacked rows are stored bottom-up, packed rows top-down. Ten-bit packed values are companded;
they are expanded to twelve linear bits by the inverse of Rec. 709.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from instruments.phantom._header import Packing

PACKED_GROUP: dict[str, tuple[int, int]] = {"10-packed": (4, 5), "12-packed": (2, 3)}
"""Pixels and bytes of one group of packed pixels."""

_P10_BLACK, _P10_WHITE = 64, 1014  # companded levels of black and white
_LINEAR_BLACK, _LINEAR_WHITE = 64, 4064  # the 12-bit linear levels that they stand for


def row_bytes(packing: Packing, width: int) -> int:
    """Return the length of one row of pixels in bytes."""
    pixels, stored = {"8": (1, 1), "16": (1, 2), **PACKED_GROUP}[packing]
    return width // pixels * stored


def decode(rows: NDArray[np.uint8], packing: Packing) -> NDArray[np.integer]:
    """Turn (row, byte) into (row, pixel).

    Returns
    -------
    array (row, pixel)
        ``uint8`` for 8-bit films, ``uint16`` otherwise; 10-bit packed films are linearised to
        12 bits.
    """
    if packing == "8":
        return rows
    if packing == "16":
        return np.ascontiguousarray(rows).view("<u2")
    if packing == "12-packed":
        return unpack12(rows)
    return linear_from_companded()[unpack10(rows)]


def unpack10(rows: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack four 10-bit pixels from every five bytes, most significant bits first."""
    b = rows.reshape(rows.shape[0], -1, 5).astype(np.uint16)
    pixels = np.empty((*b.shape[:2], 4), dtype=np.uint16)
    pixels[..., 0] = b[..., 0] << 2 | b[..., 1] >> 6
    pixels[..., 1] = (b[..., 1] & 0x3F) << 4 | b[..., 2] >> 4
    pixels[..., 2] = (b[..., 2] & 0x0F) << 6 | b[..., 3] >> 2
    pixels[..., 3] = (b[..., 3] & 0x03) << 8 | b[..., 4]
    return pixels.reshape(rows.shape[0], -1)


def unpack12(rows: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Unpack two 12-bit pixels from every three bytes, most significant bits first."""
    b = rows.reshape(rows.shape[0], -1, 3).astype(np.uint16)
    pixels = np.empty((*b.shape[:2], 2), dtype=np.uint16)
    pixels[..., 0] = b[..., 0] << 4 | b[..., 1] >> 4
    pixels[..., 1] = (b[..., 1] & 0x0F) << 8 | b[..., 2]
    return pixels.reshape(rows.shape[0], -1)


def pack(pixels: NDArray[np.uint16], depth: int) -> NDArray[np.uint8]:
    """Pack values of 10 or 12 bits, the inverse of :func:`unpack10` and :func:`unpack12`."""
    bits = pixels[..., None] >> np.arange(depth, dtype=np.uint16)[::-1] & 1
    return np.packbits(bits.astype(np.uint8).reshape(pixels.shape[0], -1), axis=1)


@cache
def linear_from_companded() -> NDArray[np.uint16]:
    """Table of the 1,024 companded values in 12-bit linear levels (inverse Rec. 709)."""
    signal = (np.arange(1024) - _P10_BLACK) / (_P10_WHITE - _P10_BLACK)
    light = np.where(signal < 0.081, signal / 4.5, ((np.maximum(signal, 0.0) + 0.099) / 1.099) ** (1 / 0.45))
    linear = _LINEAR_BLACK + light * (_LINEAR_WHITE - _LINEAR_BLACK)
    table = np.clip(np.rint(linear), 0, 4095).astype(np.uint16)
    table.setflags(write=False)
    return table


@cache
def companded_from_linear() -> NDArray[np.uint16]:
    """Nearest companded value of every 12-bit linear level; what a camera would have stored."""
    table = linear_from_companded().astype(np.int64)
    above = np.clip(np.searchsorted(table, np.arange(4096)), 1, 1023)
    levels = np.arange(4096)
    nearer_below = levels - table[above - 1] <= table[above] - levels
    return np.where(nearer_below, above - 1, above).astype(np.uint16)

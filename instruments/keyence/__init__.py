"""Keyence laser displacement sensors: storage files read and written, and live recordings."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument, text_of
from labpipe.installation import lazily
from labpipe.units import Quantity

if TYPE_CHECKING:
    from instruments.keyence._acquisition import Setup as Setup, record as record, recover as recover
    from instruments.keyence._connection import (
        DL_EN1 as DL_EN1,
        LK_G5000 as LK_G5000,
        LK_PORT as LK_PORT,
        Connection as Connection,
    )
    from instruments.keyence._markers import Status as Status
    from instruments.keyence._storage import read as read
    from instruments.keyence._writer import encode as encode, write as write
else:
    __getattr__ = lazily(__name__)

_WORDS = re.compile(
    r"keyence|\bLK-?[GHNS]|\bCL-?3|\bCL-?[PLHS]\d|\bIL-?\d|\bOUT ?\d|sampling (?:cycle|period)|"
    # or, of its analogue output through another recorder, the names of two columns
    r"^\W*(?:time|zeit|temps)\b[^\n,;\t]{0,12}[,;\t]\W*(?:displacement|distance|voltage|weg|spannung)\b",
    re.IGNORECASE | re.MULTILINE,
)
# A line of a header, or of readings: notes and papers that speak of the instrument hold neither.
_LINE = re.compile(
    r"^[^,;\t\n]{0,40}[,;\t](?! )|^\s*[+-]?(?:[\d.,]+|F{4,}|-{4,})\s*$|^\s*[+-]?\d[\d.,]*\s+[+-]?[\dF-]", re.MULTILINE
)


class Options(TypedDict, total=False):
    """Settings that a storage file does not state; see :func:`read`."""

    cycle: str | float | Quantity | None
    units: Sequence[str] | None
    storage_factor: int | None
    encoding: str | None
    decimal: str | None
    allow_incomplete: bool


def _sniff(head: bytes, path: Path) -> bool:
    """Recognise a storage export by the model, an output, a sampling cycle or its columns' names."""
    del path
    # A film or any other binary file may hold these letters by chance, but no text holds a NUL.
    text = text_of(head)
    return "\0" not in text and _WORDS.search(text) is not None and _LINE.search(text) is not None


INSTRUMENT = Instrument("keyence", "Keyence storage file", "displacement", _sniff, "instruments.keyence:read", Options)

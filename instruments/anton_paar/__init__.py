"""Anton Paar rheometer exports (RheoCompass CSV, TXT and XLSX; RheoPlus), read and written."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import HEAD_BYTES, Instrument, text_of
from instruments._workbook_texts import beginnings
from labpipe.installation import lazily
from labpipe.text import Limits

if TYPE_CHECKING:
    from instruments.anton_paar._dataset import (
        assemble as assemble,
        make_column as make_column,
        make_interval as make_interval,
    )
    from instruments.anton_paar._export import read as read
    from instruments.anton_paar._sources import workbook_rows as workbook_rows
    from instruments.anton_paar._values import Column as Column, Interval as Interval
    from instruments.anton_paar._words import (
        SI_OF as SI_OF,
        column_name as column_name,
        repaired as repaired,
        slug as slug,
        unit_of as unit_of,
    )
    from instruments.anton_paar._writer import LANGUAGES as LANGUAGES, encode as encode, write as write
else:
    __getattr__ = lazily(__name__)


_INTERVAL = re.compile(
    r'^"?[^\t;,\n]{4,60}:"?[\t;,]+"?[0-9]{1,9}"?[\t;,]+"?[0-9]{1,9}"?[\t;,]*\r?$'
    r"|^\"?(?:Data Series Information|Datenreihen ?-?Information)"
    r"|Rheo\.Repository\.",
    re.MULTILINE,
)
_FIRST_PARTS = re.compile(r"xl/sharedStrings\.xml$|xl/worksheets/sheet1")
_INTERVAL_IN_SHEET = re.compile(r"interval[^<]{0,40}:|abschnitt[^<]{0,40}:", re.IGNORECASE)


class Options(TypedDict, total=False):
    """How an export is to be read where it does not decide; see :func:`read`."""

    encoding: str | None
    delimiter: str | None
    decimal: str | None
    allow_incomplete: bool
    limits: Limits | None


def _sniff(head: bytes, path: Path) -> bool:
    """Tell a RheoCompass or RheoPlus export by the line that begins a table, or its window XML."""
    if head.startswith(b"PK\x03\x04"):
        return any(map(_INTERVAL_IN_SHEET.search, beginnings(path, _FIRST_PARTS, 16 * HEAD_BYTES)))
    text = text_of(head)
    return "\0" not in text and _INTERVAL.search(text) is not None


INSTRUMENT = Instrument(
    name="anton_paar",
    title="rheometer export",
    content="sweep",
    sniff=_sniff,
    reader="instruments.anton_paar:read",
    options=Options,
    writer="instruments.anton_paar:write",
)

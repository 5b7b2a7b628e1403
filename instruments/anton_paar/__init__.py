"""Anton Paar rheometer exports (RheoCompass CSV, TXT and XLSX; RheoPlus), read and written."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from instruments._instrument import Instrument, text_of
from instruments._workbook import beginning, is_workbook
from labpipe.installation import lazily

if TYPE_CHECKING:
    from instruments._intervals import (
        Column as Column,
        assemble as assemble,
        make_column as make_column,
        make_interval as make_interval,
    )
    from instruments.anton_paar._export import read as read
    from instruments.anton_paar._writer import encode as encode, write as write
else:
    __getattr__ = lazily(__name__)

_INTERVAL = re.compile(
    r'^"?[^\t;,\n]{4,60}:"?[\t;,]+"?[0-9]{1,9}"?[\t;,]+"?[0-9]{1,9}"?[\t;,]*\r?$'
    r"|^\"?(?:Data Series Information|Datenreihen ?-?Information)"
    r"|Rheo\.Repository\.",
    re.MULTILINE,
)


class Options(TypedDict, total=False):
    """How an export is to be read where it does not decide; see :func:`read`."""

    encoding: str | None
    decimal: str | None
    allow_incomplete: bool


def _sniff(head: bytes, path: Path) -> bool:
    """Recognise a RheoCompass or RheoPlus export by the line that begins a table, or its window XML."""
    text = beginning(path) if is_workbook(head) else text_of(head)
    return "\0" not in text and _INTERVAL.search(text) is not None


INSTRUMENT = Instrument("anton_paar", "rheometer export", "sweep", _sniff, "instruments.anton_paar:read", Options)

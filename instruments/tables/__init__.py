"""Tables of a dynamic mechanical analysis, text or workbook, and any table whose columns the user names."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from instruments._instrument import HEAD_BYTES, Instrument, text_of
from instruments._workbook import beginning, is_workbook
from labpipe.installation import lazily
from labpipe.text import first_bytes
from labpipe.units import Quantity

if TYPE_CHECKING:
    from instruments._mapping import chosen as chosen
    from instruments.tables._table import read as read
else:
    __getattr__ = lazily(__name__)

_FAR = 64 * HEAD_BYTES  # how far into a file the lines about specimen and procedure may reach


class Options(TypedDict, total=False):
    """How a table is to be read where it does not decide; see :func:`read`."""

    columns: str | Mapping[str, Any] | None
    cycle: str | float | Quantity | None
    encoding: str | None
    decimal: str | None
    allow_incomplete: bool


def _sniff(head: bytes, path: Path) -> bool:
    """Recognise a table of sweeps, responses or shift factors by the quantities in its headings."""
    from instruments._layout import SIGNAL, TAB, headings_of, plain_lines

    lines = [line for _, line in plain_lines(_beginning(head, path).splitlines())]
    of_signals = TAB.join(match[1] for line in lines if (match := SIGNAL.fullmatch(line)) is not None)
    return any(headings_of(line) is not None for line in (*lines, of_signals))


def _beginning(head: bytes, path: Path) -> str:
    """Return the first lines of a text or of the sheets of a workbook; "" of another file."""
    if is_workbook(head):
        return beginning(path)
    text = text_of(head)
    # a page or a document of JSON is no table; of its long lines every part would be tried as a heading
    if "\0" in text or re.match(r"\ufeff?\s*(?:\{|<!|<html|<\?xml)", text):
        return ""
    return text_of(first_bytes(path, _FAR)) if len(head) == HEAD_BYTES else text


def columns_hint(head: bytes, path: Path) -> str:
    """Return how the columns of an unknown table can be named, "" of a file without rows of numbers."""
    from instruments._layout import plain_lines
    from instruments._mapping import suggestion

    found = suggestion(plain_lines(_beginning(head, path).splitlines()))
    return found and f"Name its columns, in session.toml or with --columns: {found}"


INSTRUMENT = Instrument(
    "plain_table", "plain table of sweeps or shift factors", "sweep", _sniff, "instruments.tables:read", Options
)

"""Sheets of a workbook as lines with TAB between the cells, which the reader of texts understands."""

import re
from html import unescape
from itertools import groupby
from pathlib import Path

from instruments._workbook_texts import beginnings
from instruments.anton_paar import workbook_rows
from instruments.tables import _layout, _words
from instruments.tables._cells import TAB

_MOST = 1 << 20  # bytes of the texts of a workbook in which its headings are looked for
_PARTS = re.compile(r"xl/(sharedStrings|worksheets/sheet)")
_TEXT = re.compile(r"<(?:\w+:)?t(?:\s[^>]*)?>([^<]*)</")


def sheets(path: Path) -> list[tuple[str, list[tuple[int, str]]]]:
    """Return title and lines of every sheet that holds any; a title that states a temperature is a line."""
    found = []
    for title, rows in groupby(workbook_rows(path), key=lambda row: row.sheet):
        lines = [(row.line, TAB.join(_text(cell) for cell in row.cells)) for row in rows]
        filled = [(number, line) for number, line in lines if line.strip()]
        if filled:
            found.append((title, [(1, title), *filled]))
    return found


def names_quantities(path: Path) -> bool:
    """Tell a workbook whose cells name the quantities of a table; nothing but its texts is unpacked."""
    names: set[str] = set()
    for text in beginnings(path, _PARTS, _MOST):
        headings = {_words.parsed(" ".join(unescape(cell).split())) for cell in set(_TEXT.findall(text))}
        names |= {heading.name for heading in headings if heading.is_known}
        names |= {_layout.place_of(heading) for heading in headings if heading.at is not None}
        if _layout.is_begin(names):
            return True
    return False


def _text(cell: str | float | None) -> str:
    return repr(cell) if isinstance(cell, float) else " ".join((cell or "").split())

"""Rows of cells from a text file or a workbook."""

import csv
import re
from collections.abc import Iterator
from pathlib import Path

from instruments._quantities import quantity
from instruments._workbook import Cell, sheets
from instruments.anton_paar._table import Row
from labpipe.errors import SourceError
from labpipe.text import TextFile

_LOOKED_AT = 200  # lines in which the delimiter must show


def delimiter_of(source: TextFile) -> str:
    """Return TAB, semicolon or comma, as the line that begins a table shows it.

    Raises
    ------
    SourceError
        None of them separates a label from its numbers, or the names of the columns.
    """
    head = [line for _, line in zip(range(_LOOKED_AT), source.lines(), strict=False)]
    for delimiter in ("\t", ";", ","):
        sign = re.escape(delimiter)
        begins = re.compile(rf'"?[^{sign}]+:"?{sign}+"?[0-9]+"?(?:{sign}+"?[0-9]+"?)?{sign}*\s*')
        if any(
            begins.fullmatch(line) or quantity((split(line, delimiter) or [""])[0] or "") == "point" for line in head
        ):
            return delimiter
    if any("\t" in line for line in head):
        return "\t"
    text = f"no line such as 'Interval and data points: 1 11' in the first {_LOOKED_AT} lines"
    raise SourceError(source.path, text, line=1, hint="Is this an Anton Paar export? If so, export it again as CSV.")


def text_rows(source: TextFile, delimiter: str) -> Iterator[Row]:
    """Split the lines of a text file into cells."""
    for number, line in enumerate(source.lines(), 1):
        yield Row(number, split(line, delimiter))


def split(line: str, delimiter: str) -> list[Cell]:
    """Split one line; quotes are an edited file's.

    Examples
    --------
    >>> split(',1,"ME-,taD"', ",")
    ['', '1', 'ME-,taD']
    """
    if delimiter == "\t":
        return [_unquoted(cell) for cell in line.split("\t")]
    return list(next(csv.reader([line], delimiter=delimiter), [""]))


def _unquoted(cell: str) -> str:
    is_quoted = len(cell) > 1 and cell[0] == cell[-1] == '"'
    return cell[1:-1].replace('""', '"') if is_quoted else cell


def workbook_rows(path: Path) -> Iterator[Row]:
    """Return the rows of all sheets of a workbook."""
    for title, rows in sheets(path):
        for number, cells in enumerate(rows, 1):
            yield Row(number, list(cells), title)

"""Rows of cells from a text file or a workbook, within a size limit."""

import csv
import re
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from instruments.anton_paar._table import Cell, Row
from labpipe.errors import SourceError
from labpipe.text import TextFile, shorten

_LOOKED_AT = 200  # lines in which the delimiter must show
_MOST_UNPACKED = 256 << 20  # bytes of a workbook; the largest known export has 0.2 MB
_MOST_PARTS = 2000
_MOST_ROWS = 1_048_576  # of a sheet, what spreadsheets can hold

# What a damaged workbook makes openpyxl, zipfile and expat raise.
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    EOFError,
    KeyError,
    ValueError,
    TypeError,
    IndexError,
    AttributeError,
    SyntaxError,
    RuntimeError,
    OverflowError,
    AssertionError,
)


def delimiter_of(source: TextFile) -> str:
    """Return TAB, semicolon or comma, as the line that begins a table shows it.

    Raises
    ------
    SourceError
        None of them separates a label from its numbers.
    """
    head = [line for _, line in zip(range(_LOOKED_AT), source.lines(), strict=False)]
    for delimiter in ("\t", ";", ","):
        sign = re.escape(delimiter)
        begins = re.compile(rf'"?[^{sign}]+:"?{sign}+"?[0-9]+"?(?:{sign}+"?[0-9]+"?)?{sign}*\s*')
        if any(begins.fullmatch(line) for line in head):
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
    """Read the sheets of a workbook, sizes checked before anything is unpacked.

    Raises
    ------
    SourceError
        It is damaged, encrypted, or declares more than is read.
    """
    _check_sizes(path)
    import openpyxl

    try:
        # A stream, because the library would go by the file's extension.
        with path.open("rb") as stream, warnings.catch_warnings():
            warnings.filterwarnings("ignore", module="openpyxl")
            book = openpyxl.load_workbook(stream, read_only=True, data_only=True)
            for sheet in book.worksheets:
                yield from _sheet_rows(path, sheet)
    except SourceError:
        raise
    except Exception as error:
        # The library answers damage with KeyError, LookupError, TypeError, zlib's and others.
        raise _damaged(path, error) from None


def _sheet_rows(path: Path, sheet: Any) -> Iterator[Row]:
    sheet.reset_dimensions()  # the declared ones may be wrong, and then rows would be lost
    for number, cells in enumerate(sheet.iter_rows(values_only=True), 1):
        if number > _MOST_ROWS:
            raise SourceError(path, f"sheet {sheet.title} has more than {_MOST_ROWS} rows")
        if cells:
            yield Row(number, [_cell(path, sheet.title, number, c) for c in cells], sheet.title)
        else:
            yield Row(number, [], sheet.title)


_SHEET_ERRORS = re.compile(r"#(?:REF|DIV/0|VALUE|NAME\?|N/A|NUM|NULL)!?")


def _cell(path: Path, sheet: str, number: int, value: Any) -> Cell:
    if value is None or isinstance(value, bool):
        return None if value is None else str(value)
    if isinstance(value, int | float):
        return float(value)
    text = str(value)
    if _SHEET_ERRORS.fullmatch(text.strip()):
        raise SourceError(path, f"sheet {sheet}: found the error {text}", line=number)
    return text


def _damaged(path: Path, error: BaseException) -> SourceError:
    return SourceError(
        path,
        f"the workbook is damaged or incomplete: {shorten(str(error) or type(error).__name__)}",
        hint="Copy it again, or export as CSV.",
    )


def _check_sizes(path: Path) -> None:
    try:
        with zipfile.ZipFile(path) as archive:
            parts = archive.infolist()
    except _DAMAGE as error:
        raise _damaged(path, error) from None
    total = sum(part.file_size for part in parts)
    if total > _MOST_UNPACKED or len(parts) > _MOST_PARTS:
        raise SourceError(
            path,
            f"the workbook unpacks to {total} bytes in {len(parts)} parts; at most "
            f"{_MOST_UNPACKED} bytes in {_MOST_PARTS} parts are read",
            hint="This is no export of a rheometer; export as CSV.",
        )
    if any(part.flag_bits & 1 for part in parts):
        raise SourceError(path, "the workbook is encrypted", hint="Save it without a password.")
    if not any(part.filename == "xl/workbook.xml" for part in parts):
        raise SourceError(path, "a ZIP archive that holds no workbook")

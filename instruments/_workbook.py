"""Sheets of a workbook (.xlsx, .xlsm, .xls, .ods), read by calamine in a process of its own.

Calamine reserves memory for all cells that a sheet declares, and ends its process where there is not so much.
"""

import json
import re
import subprocess
import sys
import zipfile
import zlib
from functools import lru_cache
from pathlib import Path

from labpipe.errors import SourceError
from labpipe.text import first_bytes, shorten

_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,(?!\d{3}\s*$)\d+(?:[eE][+-]?\d+)?\s*")  # "1,234" may group thousands
_OLD = b"\xd0\xcf\x11\xe0"  # .xls
_ZIP = b"PK\x03\x04"  # .xlsx, .ods, and any other archive
MOST_BYTES = 128 << 20  # of an export, a workbook unpacked; real ones have below 1 MB, and all lines are kept
_MEMORY = 2 << 30  # bytes of the child, where the system can hold it to them
_SECONDS = 120
_CHILD = """
import json, sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
except (ImportError, ValueError, OSError):
    pass
import python_calamine
def cell(value):
    if value is None or value == "":
        return None
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else str(value)
found = []
try:
    with open(sys.argv[1], "rb") as stream:
        book = python_calamine.CalamineWorkbook.from_filelike(stream)
        for name in book.sheet_names:
            try:
                rows = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
            except python_calamine.WorksheetNotFound:  # a chart
                continue
            found.append([name, [[cell(value) for value in row] for row in rows]])
except Exception as error:
    found = f"{error or type(error).__name__}"
json.dump(found, sys.stdout)
"""


def is_workbook(head: bytes) -> bool:
    """Return whether the first bytes are those of a workbook, or of another archive of the same containers."""
    return head.startswith((_OLD, _ZIP))


def sheets(path: Path) -> list[tuple[str, list[list[str]]]]:
    """Return title and rows of every sheet, cells as texts; "" for an empty one and one with an error such as #REF!.

    Numbers have the decimal sign of those that the workbook holds as text.

    SourceError where the file is damaged, encrypted, no workbook, or unpacks to too much.
    """
    first_bytes(path)  # refuses a file that cannot be opened
    return _sheets(path, path.stat().st_size, path.stat().st_mtime_ns)


def beginning(path: Path, rows: int = 200) -> str:
    """Return the first rows of every sheet as lines with TABs; "" of a file that cannot be read as a workbook."""
    try:
        found = sheets(path)
    except SourceError:
        return ""
    return "".join("\t".join(row) + "\n" for _, cells in found for row in cells[:rows])


@lru_cache(8)  # a file is recognised, read and described one after the other
def _sheets(path: Path, size: int, modified: int) -> list[tuple[str, list[list[str]]]]:
    del modified
    if first_bytes(path).startswith(_ZIP):
        # refused before anything is unpacked: what is no workbook, is encrypted, or unpacks to too much
        try:
            with zipfile.ZipFile(path) as archive:
                parts = archive.infolist()
                names = {part.filename for part in parts}
        except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, RuntimeError) as error:
            raise _damaged(path, str(error)) from None
        total, text, hint = sum(part.file_size for part in parts), "", ""
        if not ({"xl/workbook.xml", "xl/workbook.bin"} & names or {"content.xml", "mimetype"} <= names):
            text, hint = "a ZIP archive that holds no workbook", "Unpack it, and name the files in it."
            if names and all(name.endswith(".npy") for name in names):
                text, arrays = "an archive of NumPy arrays (.npz)", sorted(n.removesuffix(".npy") for n in names)[:4]
                hint = f"It is a NumPy archive (.npz) of the arrays {', '.join(arrays)}: "
                hint += "save them as CSV with headings and units."
        elif total > MOST_BYTES:
            text = f"the workbook unpacks to {total} bytes; at most {MOST_BYTES} are read"
            hint = "This is no export of an instrument; export as CSV."
        elif any(part.flag_bits & 1 for part in parts):
            text, hint = "the workbook is encrypted", "Save it without a password."
        if text:
            raise SourceError(path, text, hint=hint)
    elif size > MOST_BYTES:
        raise SourceError(path, f"the workbook has {size} bytes, at most {MOST_BYTES} are read")
    command = [sys.executable, "-P", "-c", _CHILD, str(path.resolve()), str(_MEMORY)]
    try:
        ended = subprocess.run(command, capture_output=True, timeout=_SECONDS, check=False)
        found = json.loads(ended.stdout) if ended.returncode == 0 else "its cells cannot be read"
    except (subprocess.TimeoutExpired, ValueError):
        found = "its cells cannot be read"
    if isinstance(found, str):
        raise _damaged(path, found)
    texts = (cell for _, rows in found for row in rows for cell in row if isinstance(cell, str))
    decimal = "," if any(map(_DECIMAL_COMMA.fullmatch, texts)) else "."

    def text_of(cell: str | float | None) -> str:
        if isinstance(cell, float):  # a number in its shortest form
            return (repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)).replace(".", decimal)
        return " ".join((cell or "").split())

    return [(title, [list(map(text_of, row)) for row in rows]) for title, rows in found]


def _damaged(path: Path, found: str) -> SourceError:
    is_locked = "password" in found.casefold() or "encrypt" in found.casefold()
    hint = "Save it without a password." if is_locked else "Copy it again, or export as CSV."
    return SourceError(path, f"the workbook is damaged or incomplete: {shorten(found)}", hint=hint)

"""The texts in a workbook, by which its kind is told before a reader unpacks it."""

import re
from collections.abc import Iterator
from pathlib import Path


def beginnings(path: Path, parts: re.Pattern[str], most: int) -> Iterator[str]:
    """Yield the first bytes of the parts of a workbook whose names begin so, decoded; none of a damaged one.

    Damage is no error here: the reader says what is wrong, with its remedy.
    """
    import zipfile
    import zlib

    try:
        with zipfile.ZipFile(path) as archive:
            for part in filter(parts.match, archive.namelist()):
                with archive.open(part) as stream:
                    text = stream.read(most).decode("utf-8", errors="replace")
                yield text
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError):
        return

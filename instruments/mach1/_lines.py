"""Lines of a Mach-1 file one after the other: tags, pairs, and where a file is cut short."""

import csv
import re
from collections.abc import Iterator
from typing import NamedTuple

from labpipe.errors import SourceError, warn_of
from labpipe.text import TextFile, shorten

END_DATA = "<END DATA>"
_TAG = re.compile(r"<([^<>\t]+)>\s*")
_SEPARATED = re.compile(r'"?<Mach-1 File>"?([,;])')


class Options(NamedTuple):
    """What the caller allows: a decimal comma, a file cut short, rows missing inside."""

    decimal: str = "."
    allow_incomplete: bool = False
    allow_gaps: bool = False


class Cursor:
    """The line under the reader's eye, with its number; ``None`` after the last."""

    def __init__(self, source: TextFile) -> None:
        self.source = source
        self.cut: str | None = None
        self.number = 0
        self.line: str | None = None
        self._lines = source.lines()
        self._delimiter = "\t"
        self.advance()

    def advance(self) -> None:
        """Go to the next line; a cut last line is put aside, never used."""
        self.line = next(self._lines, None)
        if self.line is None:
            return
        self.number += 1
        if self.number == 1 and (separated := _SEPARATED.match(self.line)):
            self._delimiter = separated[1]
        if self._delimiter != "\t" or '"' in self.line:
            self.line = self._as_written(self.line)
        is_last = self.number == self.source.n_lines
        if is_last and not self.source.is_ended and self.line.rstrip() != END_DATA:
            # A number that lost its last digits still reads as a number: never use such a line.
            self.cut, self.line = self.line, None

    def _as_written(self, line: str) -> str:
        """Undo what a spreadsheet did: quotes around cells, other signs between them, empty cells at the end."""
        try:
            cells = next(csv.reader([line], delimiter=self._delimiter, strict=True), [])
        except csv.Error:  # a lone quote is damage, to be found where the cell is read
            return line
        return "\t".join(cells).rstrip("\t")

    def rows(self) -> Iterator[str]:
        """Go on to the next line that starts with a tag."""
        while self.line is not None and not self.line.startswith("<"):
            yield self.line
            self.advance()

    def error(self, message: str, column: int = 1, hint: str | None = None) -> SourceError:
        """Make the error for the line under the eye."""
        number = max(self.number, 1)
        return SourceError(self.source.path, message, line=number, column=column, hint=hint)


def tag_of(line: str | None) -> str | None:
    """Return the text between the brackets of a tag, None for any other line.

    Examples
    --------
    >>> tag_of("<END DATA>"), tag_of("0.010000")
    ('END DATA', None)
    """
    match = _TAG.fullmatch(line) if line is not None else None
    return match[1] if match else None


COPY_AGAIN = (
    "The recording stopped, or the file was copied before it was complete: copy it again, or "
    "read what there is with allow_incomplete=True."
)


def refuse_incomplete(cursor: Cursor, message: str, options: Options) -> None:
    """Refuse a file that ends too early, or only warn where the caller allows it."""
    if cursor.cut is not None:
        message += f"; the line is {shorten(cursor.cut)}"
    if not options.allow_incomplete:
        raise cursor.error(message, hint=COPY_AGAIN)
    warn_of(cursor.source.path, message, line=cursor.number)


def pair_of(line: str, separators: tuple[str, ...] = (":\t", "\t")) -> tuple[str, str] | None:
    r"""Split at the first colon that a tab follows: values hold colons of their own.

    Examples
    --------
    >>> pair_of("Load Cell Name:\t25kg SN:1886652")
    ('Load Cell Name', '25kg SN:1886652')
    """
    stripped = line.rstrip("\t ")
    if not stripped:
        return None
    for separator in separators:
        key, found, value = line.partition(separator)
        if found and key.strip():
            return key.strip(), value.strip()
    return (stripped[:-1], "") if stripped.endswith(":") else None

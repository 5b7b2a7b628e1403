"""Sheets of lines, a workbook by its sheets, a text as a single one without a name; and notes over a file."""

from dataclasses import dataclass, field
from pathlib import Path

from instruments._layout import TAB, Lines, plain_lines
from instruments._workbook import MOST_BYTES, is_workbook, sheets
from labpipe.errors import warn_of
from labpipe.text import first_bytes, survey

CODECS = ("cp1252", "cp932")


@dataclass(frozen=True, slots=True)
class Notes:
    """Warnings over a file, each given once however many of its tables show it."""

    path: Path
    texts: list[str] = field(default_factory=list)

    def add(self, text: str, line: int | None = None) -> None:
        """Warn, unless that was said before."""
        if text not in self.texts:
            self.texts.append(text)
            warn_of(self.path, text, line=line)


def open_sheets(
    notes: Notes, encoding: str | None, *, allow_incomplete: bool
) -> tuple[list[tuple[str, Lines]], str, int]:
    """Return titles with lines that are not empty, the codec, and the number of a last line without line end, or 0.

    Such a line is dropped where ``allow_incomplete``, with a warning. Cells of a workbook stand between TABs.
    """
    path = notes.path
    if is_workbook(first_bytes(path)):
        found = [(title, plain_lines(map(TAB.join, rows))) for title, rows in sheets(path)]
        return found, path.suffix.lstrip(".").lower() or "xlsx", 0
    source = survey(path, declared=(encoding,) if encoding else CODECS, max_bytes=MOST_BYTES)
    lines, open_line = plain_lines(source.lines()), 0 if source.is_ended else source.n_lines
    if allow_incomplete and lines and lines[-1][0] == open_line:
        notes.add("the last line is cut, it has no line end; it is dropped", open_line)
        lines = lines[:-1]
    return [("", lines)], source.encoding, 0 if allow_incomplete else open_line

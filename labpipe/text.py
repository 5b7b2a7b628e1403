"""Text files of instruments: encoding, size, completeness, and tables of numbers.

:func:`survey` goes through a file once in pieces, then :meth:`TextFile.lines` streams its lines: a file of 150 MB is
never whole in memory. Numbers are parsed by numpy and verified (rows, columns, finite); on any doubt the lines are read
again one cell at a time, only to name the file, the line and the column.
"""

import codecs
import contextlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from labpipe.errors import MARKER, UNSAID, InputError, SourceError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# --- numbers: the decimal sign, and what counts as one ------------------------------------------

_NUMBER = re.compile(r"\s*[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\s*")


class Separators(NamedTuple):
    """The decimal sign of a file, and its thousands sign ("" when it has none)."""

    decimal: str
    thousands: str


#: What instruments write unless a spreadsheet of another country has been at the file.
DOT = Separators(".", "")


def is_number(cell: str) -> bool:
    """Return whether a cell is a finite decimal number with a dot (not ``nan``, not ``1_000``).

    Examples
    --------
    >>> is_number("+00.1234"), is_number("1,5"), is_number("nan")
    (True, False, False)
    """
    return _NUMBER.fullmatch(cell) is not None and abs(float(cell)) != float("inf")


def check_decimal(given: str | None) -> None:
    """Refuse another decimal sign than the dot and the comma; None says that the file decides."""
    if given not in (None, ".", ","):
        raise InputError(f'decimal must be "." or ",", found "{given}"')


_GROUPED = {
    ",": re.compile(r"[+-]?[1-9][0-9]{0,2}(?:,[0-9]{3})+(?:\.[0-9]*)?"),
    ".": re.compile(r"[+-]?[1-9][0-9]{0,2}(?:\.[0-9]{3})+(?:,[0-9]*)?"),
}


def separators(cells: Iterable[str]) -> Separators:
    """Decide from cells which sign is the decimal one, or refuse to guess.

    ``0,010`` and ``1,5`` can only have a decimal comma, ``1,234,567`` only thousands, ``1.234,5``
    shows both; but ``1,234`` alone may be either, and a file that shows nothing else is refused. Cells that are no
    numbers are ignored.

    Raises InputError: the evidence is ambiguous or contradicts itself.

    Examples
    --------
    >>> separators(["+00,1234", "-00,0120"])
    Separators(decimal=',', thousands='')
    >>> separators(["1.234,50", "2,00"])
    Separators(decimal=',', thousands='.')
    """
    proved: set[Separators] = set()
    ambiguous: str | None = None
    for cell in map(str.strip, cells):
        if not ("," in cell or "." in cell) or not cell.strip("+-").replace(",", "").replace(".", "").isdigit():
            continue
        last, other = (",", ".") if cell.rfind(",") > cell.rfind(".") else (".", ",")
        if other in cell:
            if _GROUPED[other].fullmatch(cell):
                proved.add(Separators(last, other))
        elif not _GROUPED[last].fullmatch(cell):
            proved |= {Separators(last, "")} if cell.count(last) == 1 else set()
        elif cell.count(last) > 1:
            proved.add(Separators(other, last))
        else:
            ambiguous = ambiguous or cell
    decimals = {each.decimal for each in proved}
    if len(decimals) > 1:
        raise InputError(
            "both the dot and the comma are used as decimal sign; "
            'say which one is meant with decimal="." or decimal=","'
        )
    if proved:
        return Separators(decimals.pop(), max(each.thousands for each in proved))
    if ambiguous is not None and "," in ambiguous:
        raise InputError(
            f'"{ambiguous}" may hold a decimal comma or a thousands comma, and nothing else in '
            'the file decides it; say which with decimal="." or decimal=","'
        )
    return DOT  # one dot is the decimal sign unless something else in the file proves otherwise


def plain_number(cell: str, signs: Separators = DOT) -> float | None:
    """Read one cell, or return None when it is not a finite number with these signs.

    Examples
    --------
    >>> plain_number("1.234,50", Separators(",", "."))
    1234.5
    >>> plain_number("1.5", Separators(",", "")) is None
    True
    """
    if signs != DOT:
        other = "." if signs.decimal == "," else ","
        if other in cell:
            if signs.thousands != other or not _GROUPED[other].fullmatch(cell.strip()):
                return None
            cell = cell.replace(other, "")
        cell = cell.replace(signs.decimal, ".")
    return float(cell) if is_number(cell) else None


def listed(lines: Sequence[int], most: int = 5) -> str:
    """Name lines for a message; of more than ``most`` the rest is counted.

    Examples
    --------
    >>> listed([3]), listed([3, 7]), listed(range(10, 20))
    ('line 3', 'lines 3, 7', 'lines 10, 11, 12, 13, 14 and 5 more')
    """
    shown = ", ".join(map(str, lines[:most]))
    more = f" and {len(lines) - most} more" if len(lines) > most else ""
    return f"line{'s' * (len(lines) > 1)} {shown}{more}"


def shorten(text: str, length: int = 60) -> str:
    """Quote a piece of a file for a message: control characters escaped, long text cut.

    Examples
    --------
    >>> shorten("1.2e" + "0" * 99, length=8)
    "'1.2e000…'"
    """
    return repr(text if len(text) <= length else text[: length - 1] + "…")


# --- files ---------------------------------------------------------------------------------------

_PIECE = _LONGEST_LINE = 1 << 20  # characters decoded at a time: a thousand times the longest line of a recording
_MARKS = (  # UTF-32 before UTF-16, because its little-endian mark begins with the UTF-16 one
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
_MARKER = re.compile(r"-*|\+*|\*+|[+-]?9{4,}[.\d]*|[A-Za-z]+")  # what an instrument writes in place of a reading


@dataclass(frozen=True, slots=True)
class TextFile:
    """A text file whose codec decodes every byte, with its size in bytes and in lines.

    ``is_ended`` is False when the last line, which counts, has no line end: the file may be cut inside a number.
    """

    path: Path
    encoding: str
    size: int
    n_lines: int
    is_ended: bool

    def lines(self) -> Iterator[str]:
        """Stream the lines without their ends; CRLF, LF and CR are all line ends.

        Raises SourceError: the file has changed since it was surveyed.
        """
        count, size = 0, -1
        try:
            with self.path.open(encoding=self.encoding, errors="strict", newline=None) as stream:
                for line in stream:
                    count += 1
                    yield line.removesuffix("\n")
                size = os.fstat(stream.fileno()).st_size
        except UnicodeError:
            count = -1  # it could be decoded a moment ago
        if size != self.size or count != self.n_lines:
            raise SourceError(
                self.path,
                f"the file changed while it was read (it had {self.size} bytes)",
                hint="It may still be being written: wait until the instrument has finished.",
            )


def survey(path: str | os.PathLike[str], declared: Sequence[str] = ("cp1252",), max_bytes: int = 1 << 30) -> TextFile:
    """Settle the codec of a text file and whether it is complete, without keeping its text.

    Codecs that the format declares are tried in this order, where there is no byte order mark and it is not UTF-8.
    The default limit is seven times the size of the largest Mach-1 mapping set known.

    Raises SourceError: the file is missing, empty, too large, holds a control character or a line beyond the limit, or
    none of the codecs decodes it.
    """
    path = Path(path)
    head = first_bytes(path)
    size = path.stat().st_size
    if size == 0:
        raise SourceError(path, "the file is empty", hint="Copy it from the instrument again.")
    if size > max_bytes:
        message = f"the file has {size} bytes, at most {max_bytes} are read"
        raise SourceError(path, message, hint="A recording of this size is not read; split it.")
    marked = next((codec for mark, codec in _MARKS if head.startswith(mark)), None) or unmarked_codec(head)
    failures = []
    for encoding in (marked,) if marked else ("utf-8", *declared):
        n_lines, is_ended = 0, True
        try:
            with path.open(encoding=encoding, errors="strict", newline=None) as stream:
                while piece := stream.read(_PIECE) + stream.readline(_LONGEST_LINE + 1):  # whole lines
                    if found := _CONTROL.search(piece):
                        above = piece[: found.start()].split("\n")
                        name = "NUL" if found[0] == "\0" else shorten(found[0])
                        message = f"the control character {name} where text was expected: the file is damaged or binary"
                        at = {"line": n_lines + len(above), "column": len(above[-1]) + 1}
                        raise SourceError(path, message, **at, hint="Copy it from the instrument again.")
                    lengths = list(map(len, piece.removesuffix("\n").split("\n")))
                    if max(lengths) > _LONGEST_LINE:
                        line = n_lines + next(i for i, length in enumerate(lengths, 1) if length > _LONGEST_LINE)
                        message = f"the line is longer than {_LONGEST_LINE} characters"
                        raise SourceError(path, message, line=line, hint="This is not a table of readings.")
                    n_lines, is_ended = n_lines + len(lengths), piece.endswith("\n")
            return TextFile(path, encoding, size, n_lines, is_ended)
        except UnicodeError as error:
            failures.append(f"{encoding} ({error})")
    if marked and marked.startswith("utf-16") and size % 2:
        message = "ends within a character of UTF-16: the file was cut off"
        raise SourceError(path, message, hint="Copy it from the instrument again.")
    message = f"no codec decodes the file; tried {'; '.join(failures)}"
    hint = 'Give the codec it was written with, for example encoding="cp932".'
    raise SourceError(path, message, hint=hint).because(UNSAID)


def unmarked_codec(head: bytes) -> str | None:
    """Recognise UTF-16 without its mark by the zeros next to most characters; None of another text.

    Examples
    --------
    >>> unmarked_codec("f (Hz), E' (MPa)".encode("utf-16-le")), unmarked_codec(b"f (Hz), E' (MPa)")
    ('utf-16-le', None)
    """
    first, second = head[: len(head) // 2 * 2 : 2], head[1::2]
    for codec, empty, full in (("utf-16-le", second, first), ("utf-16-be", first, second)):
        if len(full) >= 8 and 2 * empty.count(0) > len(empty) and not full.count(0):
            return codec
    return None


def first_bytes(path: Path, count: int = 512) -> bytes:
    """Return the beginning of a file; SourceError where it cannot be opened, or is no file."""
    try:
        if path.exists() and not path.is_file():
            raise SourceError(path, "is not a regular file")
        with path.open("rb") as stream:
            return stream.read(count)
    except OSError as error:
        raise SourceError(path, f"cannot be opened: {error.strerror}") from None


def parse_rows(
    lines: Sequence[str],
    n_columns: int,
    delimiter: str,
    *,
    path: str | os.PathLike[str],
    first_line: int,
    signs: Separators = DOT,
) -> "NDArray[np.float64]":
    """Parse lines of plain numbers; every row must have every column, every number be finite.

    ``lines``: the rows, without line ends; ``n_columns``: cells expected in every row; ``delimiter``: one character;
    ``path``, ``first_line``: named in the error: the file, and the line number of ``lines[0]``; ``signs``: decimal and
    thousands sign. Returns the numbers (row, column). Raises SourceError, with file, line and column of the first cell
    that is not a number, or the first row that has another number of cells.

    Examples
    --------
    >>> parse_rows(["0.00,1.5", "0.01,1.6"], 2, ",", path="a.txt", first_line=1).tolist()
    [[0.0, 1.5], [0.01, 1.6]]
    """
    import numpy as np

    if not lines:
        return np.empty((0, n_columns))
    rows = np.empty((0, 0))
    has_comma = signs.decimal == "," and not any("." in line for line in lines)
    if signs == DOT or (has_comma and not signs.thousands):  # otherwise only a look at every cell can tell
        dotted = [line.replace(",", ".") for line in lines] if has_comma else lines
        with contextlib.suppress(ValueError):
            rows = np.loadtxt(dotted, delimiter=delimiter, comments=None, ndmin=2)
    # loadtxt skips empty lines and takes "nan" and "inf": neither may pass unseen.
    if rows.shape == (len(lines), n_columns) and bool(np.isfinite(rows).all()):
        return rows
    rows = np.empty((len(lines), n_columns))
    for row, line in enumerate(lines):
        cells, at = line.split(delimiter), first_line + row
        check_width(line, cells, n_columns, delimiter, path=path, line_number=at)
        for place, cell in enumerate(cells):
            if (number := plain_number(cell, signs)) is None:
                column = len(delimiter.join(cells[:place])) + 1 + (place > 0)
                raise not_a_number(cell, path=path, line_number=at, column=column)
            rows[row, place] = number
    return rows


def check_width(
    line: str, cells: Sequence[str], n_columns: int, delimiter: str, *, path: str | os.PathLike[str], line_number: int
) -> None:
    """Refuse a row with missing or additional cells."""
    if len(cells) == n_columns:
        return
    # The first cell too many, or the end of the line where one is missing.
    is_long = len(cells) > n_columns
    column = len(delimiter.join(cells[:n_columns])) + 2 if is_long else len(line) + 1
    text = f"found {len(cells)} cells, expected {n_columns}: {shorten(line)}"
    hint = "A cell is missing or was added; compare the row with its neighbours."
    raise SourceError(path, text, line=line_number, column=column, hint=hint)


def not_a_number(cell: str, *, path: str | os.PathLike[str], line_number: int, column: int | None) -> SourceError:
    """Make the error for a cell that should be a number."""
    hint = "Correct the cell, or export the file again."
    if "," in cell and is_number(cell.replace(",", ".", 1)):
        hint = 'If the comma is the decimal sign, give decimal=","; it is not guessed here.'
    text = f"found {shorten(cell)}, expected a number"
    return SourceError(path, text, line=line_number, column=column, hint=hint).because(marker_reason(cell))


def marker_reason(cell: str) -> str:
    """Reason of an error for a cell: that it may be an instrument's marker in place of a reading, or none."""
    return MARKER if _MARKER.fullmatch(cell) else ""

"""From rows of cells to intervals: the structure that all Anton Paar exports share.

RheoCompass::

    Project:  name | host, date | counter
    Test:     sample A 25C
    Result:   Frequency sweep 1
    Interval and data points:  1  11
    Interval data:  Point No.  Angular Frequency  Storage Modulus  …  Status
                    (a row of sub-labels, mostly empty)
                               [rad/s]            [Pa]
                    1          50                 62589

RheoPlus has one label for each of interval and number of points, and no empty first column.
Structure is asked before words: a label and two whole numbers begin an interval in any language.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

from instruments._quantities import TEXT, fold, quantity, repaired
from instruments._workbook import Cell, text_of
from labpipe.errors import SourceError
from labpipe.text import listed, shorten

_BRACKETS = re.compile(r"\s*\[.*\]\s*")
_WHOLE = re.compile(r"\s*[0-9]{1,9}(?:\.0*)?\s*")
_NUMBER = re.compile(r"[+-]?[0-9][0-9.,]*(?:[eE][+-]?[0-9]+)?")
_UNITS_WITHIN = 3  # lines below the header: sub-labels, and a line that a hand has added
_MOST_COLUMNS = 512

#: The meaning of a label before a table, by its spellings.
_LABELS = {
    "project": "project, projekt, projet, projeto, file, data series information, datenreihen information",
    "test": "test, teste, essai, versuch, name",
    "result": "result, ergebnis, resultat, resultado",
    "interval": "interval, abschnitt, messabschnitt, intervalle, intervalo",
    "points": (
        "number of data points, anzahl datenpunkte, anzahl messpunkte, nombre de points de donnees, "
        "numero de pontos de dados"
    ),
    "header": (
        "interval data, intervalldaten, abschnittsdaten, intervall daten, intervalle donnees, interval donnees, "
        "donnees intervalle, dados do intervalo, intervalo dados"
    ),
}
_LABEL_OF = {fold(word): name for name, words in _LABELS.items() for word in words.split(", ")}
_INVALID = ("invalid", "invalide", "ungultig", "invalido")
_COUNT = re.compile(r"\s*(\d{1,9})(?:\.0*)?\s*(?:\(\s*(.+?)\s*\))?\s*")


def label(text: str) -> str | None:
    """Return the meaning of a label, or None when it is not known."""
    return _LABEL_OF.get(fold(text))


def point_number(text: str) -> tuple[int, bool] | None:
    """Read a point number and whether the point is valid; None when it is neither.

    Examples
    --------
    >>> point_number("7"), point_number("8 (invalid)"), point_number("8 (perhaps)")
    ((7, True), (8, False), None)
    """
    match = _COUNT.fullmatch(text)
    if match is None or (match[2] is not None and fold(match[2]) not in _INVALID):
        return None
    return int(match[1]), match[2] is None


@dataclass(frozen=True, slots=True)
class Row:
    """One row: its number in the file or sheet, its sheet ("" in a text), its cells.

    ``is_short`` means that the file holds fewer of them than the table has columns.
    """

    line: int
    cells: list[Cell]
    sheet: str = ""
    is_short: bool = False


@dataclass(slots=True)
class RawInterval:
    """One table as in the file.

    ``declared`` is the number of points that the file announces (None when it does not);
    ``first`` the cell with which the columns begin.
    """

    test: str
    result: str
    number: int
    declared: int | None
    line: int
    sheet: str
    headers: list[str] = field(default_factory=list)
    sub_labels: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    first: int = 0


@dataclass(slots=True)
class Export:
    """Everything between the first and the last row."""

    path: Path
    intervals: list[RawInterval] = field(default_factory=list)
    header: list[str] = field(default_factory=list)
    projects: int = 0
    notes: list[str] = field(default_factory=list)
    cut: list[tuple[int, str]] = field(default_factory=list)  # intervals that lack points: their line, and its note


def read_table(path: Path, rows: Iterable[Row]) -> Export:
    """Find the intervals.

    Raises
    ------
    SourceError
        There is none, a table has no units, or a row does not fit its header.
    """
    reader = _Reader(path)
    for row in rows:
        reader.take(row)
    return reader.finished()


class _Reader:
    """The state of one pass: which labels were seen, and which part of a table comes next."""

    def __init__(self, path: Path) -> None:
        self.export = Export(path)
        self.sheet: str | None = None
        self.test = self.result = ""
        self.number: int | None = None  # RheoPlus: stated before the number of points
        self.current: RawInterval | None = None
        self.expects = "labels"
        self.is_rheoplus = False
        self.dangling = 0  # line of a label after the last table

    def fail(self, row: Row, message: str, hint: str = "") -> SourceError:
        where = f"sheet {row.sheet}: " if row.sheet else ""
        return SourceError(self.export.path, where + message, line=row.line, hint=hint)

    def take(self, row: Row) -> None:
        """Take one row in."""
        if row.sheet != self.sheet:
            self.close()
            self.sheet, self.test, self.result = row.sheet, "", ""
            self.number = None
        cells = [text_of(c) for c in row.cells]
        while cells and not cells[-1]:
            cells.pop()
        if not cells:
            if self.current is not None and self.current.rows:
                self.close()
            return
        if len(cells) > _MOST_COLUMNS:
            raise self.fail(row, f"found {len(cells)} cells, no table has more than {_MOST_COLUMNS}")
        if self._is_label(cells):
            self._label(row, cells)
        elif self.current is None and quantity(repaired(cells[0])) == "point" and len(cells) > 2:
            self._begin_unstated(row, cells)
        elif self.current is None:
            self._loose(row, cells)
        elif self.expects == "header":
            self._header(self.current, row, cells)
        elif self.expects == "units":
            self._units(self.current, row, cells)
        else:
            self._data(self.current, row, cells)

    def _is_label(self, cells: list[str]) -> bool:
        first = cells[0]
        if self.expects == "header" and len(cells) > 2 and not _WHOLE.fullmatch(cells[1]):
            return False
        return first.endswith(":") or label(first) in ("header", "project")

    def _label(self, row: Row, cells: list[str]) -> None:
        values = [c for c in cells[1:] if c]
        text = repaired(" ".join(values))
        meaning = label(repaired(cells[0]))
        numbers = [int(float(v)) for v in values if _WHOLE.fullmatch(v)]
        if meaning is None and self.expects == "header" and self.is_rheoplus:
            # Settings of the interval, which RheoPlus writes between its number of points and its table.
            self.export.header.append(f"{cells[0]}\t{text}")
            return
        self.close()
        self.dangling = row.line
        if len(values) == 2 and len(numbers) == 2:
            self._begin(row, numbers[0], numbers[1])
            self.is_rheoplus = False
        elif meaning == "header" and len(values) > 1:
            self._begin_unstated(row, cells)
        elif meaning == "interval" and len(values) == 1 and numbers:
            self.number = numbers[0]
        elif meaning == "points" and len(values) == 1 and numbers:
            self._begin(row, self.number or self._next_number(), numbers[0])
            self.number, self.is_rheoplus = None, True
        else:
            self._named(row, meaning, cells[0], text)

    def _next_number(self) -> int:
        place = (self.sheet, self.test, self.result)
        return sum((i.sheet, i.test, i.result) == place for i in self.export.intervals) + 1

    def _begin_unstated(self, row: Row, cells: list[str]) -> None:
        self.export.notes.append(f"line {row.line}: a table without the line that states its number of points")
        self._header(self._begin(row, self._next_number(), None), row, cells)

    def _named(self, row: Row, meaning: str | None, name: str, text: str) -> None:
        self.export.header.append(f"{name}\t{text}")
        if meaning == "project":
            self.export.projects += 1
            if self.export.projects == 2 and not row.sheet:
                self.export.notes.append(f"line {row.line}: a second project begins; exports were joined")
        elif meaning == "test":
            self.test, self.result = text, ""
        elif meaning == "result":
            self.result = text

    def _begin(self, row: Row, number: int, declared: int | None) -> RawInterval:
        self.current = RawInterval(self.test, self.result, number, declared, row.line, self.sheet or "")
        self.expects = "header"
        return self.current

    def _header(self, current: RawInterval, row: Row, cells: list[str]) -> None:
        headers = [repaired(c) for c in cells]
        if self.is_rheoplus and quantity(headers[0]) != "point" and not any(map(_NUMBER.fullmatch, cells)):
            self.export.header.append(" ".join(cells))  # of the measuring profile
            return
        # RheoCompass keeps the first column for the label, RheoPlus begins with the points.
        current.first = 0 if quantity(headers[0]) == "point" else 1
        current.headers = headers[current.first :]
        while current.headers and not current.headers[-1]:
            current.headers.pop()
        if len(current.headers) < 2 or any(_WHOLE.fullmatch(h) for h in headers):
            text = f"found {shorten(' '.join(cells))}, expected the names of the columns"
            raise self.fail(row, text, "The lines of the table were changed; export the file again.")
        self.header_line = row.line
        self.expects = "units"

    def _units(self, current: RawInterval, row: Row, cells: list[str]) -> None:
        inside = [repaired(c) for c in cells[current.first :]]
        stated = [c for c in inside if c]
        if stated and not cells[0] and all(_BRACKETS.fullmatch(c) for c in stated):
            if len(inside) > len(current.headers):
                raise self.fail(row, f"found {len(inside)} units for {len(current.headers)} columns")
            current.units = inside + [""] * (len(current.headers) - len(inside))
            self.expects = "data"
            return
        is_number = any(_NUMBER.fullmatch(c) for c in stated)
        if row.line - self.header_line > _UNITS_WITHIN or is_number:
            text = "found no row of units such as [Pa] below the names of the columns"
            raise self.fail(row, text, "Export again with units; they are not guessed.")
        current.sub_labels = inside

    def _data(self, current: RawInterval, row: Row, cells: list[str]) -> None:
        # At least the first cell is empty (RheoCompass) or a point number (RheoPlus).
        compare = "compare the row with its neighbours."
        if current.first and cells[0]:
            text = f"found {shorten(cells[0])} where the first cell of a row of data is empty"
            raise self.fail(row, text, f"A cell was added or moved; {compare}")
        width, filled = len(current.headers), len(cells) - current.first
        inside = row.cells[current.first :][:width]
        is_short = not row.sheet and len(inside) < width
        if filled > width or (is_short and any(quantity(h) not in TEXT for h in current.headers[len(inside) :])):
            text = f"found {max(filled, len(inside))} cells, expected {width}: {shorten(' '.join(cells))}"
            raise self.fail(row, text, f"A cell {'was added' if filled > width else 'is missing'}; {compare}")
        inside = inside + [None] * (width - len(inside))
        current.rows.append(Row(row.line, inside, row.sheet, is_short))

    def _loose(self, row: Row, cells: list[str]) -> None:
        numbers = sum(bool(_NUMBER.fullmatch(c)) for c in cells)
        # Above the first table one number may be a remark; several are a row that lost its table.
        if numbers > (0 if self.export.intervals else 1):
            text = f"found {shorten(' '.join(cells))} outside a table"
            raise self.fail(row, text, "An empty line stands inside the table, or its header is lost.")
        self.export.header.append(" ".join(cells))

    def close(self) -> None:
        """End the table at hand."""
        found, self.current = self.current, None
        self.expects = "labels"
        if found is None:
            return
        self.dangling = 0
        place = f"{found.sheet + ', ' if found.sheet else ''}line {found.line}"
        if found.declared is not None and found.declared != len(found.rows):
            text = (
                f"{place}: interval {found.number} of {shorten(found.test)} declares {found.declared} points and holds "
                f"{len(found.rows)}: the test was stopped, or the file is cut"
            )
            self.export.notes.append(text)
            self.export.cut.append((found.line, text))
        # Which cells a row lost is not known, so no value of it is believed; where every row lacks the same text at
        # its end, an editor has taken off what was empty.
        short = [row.line for row in found.rows if row.is_short]
        if len(short) == len(found.rows):
            found.rows = [replace(row, is_short=False) for row in found.rows]
        elif short:
            self.export.notes.append(
                f"{listed(short)}: {len(short)} of {len(found.rows)} rows lost cells at "
                "their end; which ones is not known, so the points are marked invalid"
            )
        self.export.intervals.append(found)

    def finished(self) -> Export:
        """Return the export; refuse one without a row of data."""
        last = self.dangling if self.current is None else 0
        self.close()
        if last:
            self.export.notes.append(f"line {last}: the file ends after a label, before its table: it is cut")
        if not any(i.rows for i in self.export.intervals):
            hint = "Export the table of the measurement from RheoCompass as CSV or XLSX."
            raise SourceError(self.export.path, "found no table with rows of data", hint=hint)
        return self.export

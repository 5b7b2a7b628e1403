"""From rows of cells to tables: the structure that all Anton Paar exports share.

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
from dataclasses import dataclass, field

from instruments._quantities import TEXT, fold, quantity, repaired, slug
from instruments.tables import Block, Heading, Notes, is_unit
from labpipe.errors import SourceError
from labpipe.text import shorten

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


def label(text: str) -> str | None:
    """Return the meaning of a label, or None when it is not known."""
    return _LABEL_OF.get(fold(text))


@dataclass(slots=True)
class Table:
    """One table as in the file.

    ``declared`` is the number of points that the file announces (None when it does not); ``sub_labels`` stand below
    the headings; ``first`` is the cell with which the columns begin.
    """

    test: str
    result: str
    number: int
    declared: int | None
    block: Block
    sub_labels: list[str] = field(default_factory=list)
    first: int = 0


@dataclass(slots=True)
class Export:
    """Everything between the first and the last row; ``cut`` holds line and note of tables that lack points."""

    tables: list[Table] = field(default_factory=list)
    header: list[str] = field(default_factory=list)
    projects: int = 0
    cut: list[tuple[int, str]] = field(default_factory=list)


class Parser:
    """One pass over the rows: which labels were seen, and which part of a table comes next."""

    def __init__(self, notes: Notes) -> None:
        self.notes, self.export = notes, Export()
        self.sheet, self.test, self.result = "", "", ""
        self.number: int | None = None  # RheoPlus: stated before the number of points
        self.current: Table | None = None
        self.expects = "labels"
        self.is_rheoplus = False
        self.header_line = self.dangling = 0  # line of a label after the last table

    def _fail(self, line: int, message: str, hint: str = "") -> SourceError:
        where = f"sheet {self.sheet}: " if self.sheet else ""
        return SourceError(self.notes.path, where + message, line=line, hint=hint)

    def take(self, line: int, sheet: str, row: list[str]) -> None:
        """Take one row in, from the sheet of that name ("" in a text).

        Raises
        ------
        SourceError
            A table has no units, or a row does not fit its headings.
        """
        if sheet != self.sheet:
            self._close()
            self.sheet, self.test, self.result, self.number = sheet, "", "", None
        cells = row[: max((k + 1 for k, cell in enumerate(row) if cell), default=0)]
        if not cells:
            if self.current is not None and self.current.block.rows:
                self._close()
            return
        if len(cells) > _MOST_COLUMNS:
            raise self._fail(line, f"found {len(cells)} cells, no table has more than {_MOST_COLUMNS}")
        is_names = self.expects == "header" and len(cells) > 2 and not _WHOLE.fullmatch(cells[1])
        if not is_names and (cells[0].endswith(":") or label(cells[0]) in ("header", "project")):
            self._label(line, cells)
        elif self.current is None and quantity(repaired(cells[0])) == "point" and len(cells) > 2:
            self._unstated(line, cells)
        elif self.current is None:
            numbers = sum(bool(_NUMBER.fullmatch(cell)) for cell in cells)
            # Above the first table one number may be a remark; several are a row that lost its table.
            if numbers > (0 if self.export.tables else 1):
                text = f"found {shorten(' '.join(cells))} outside a table"
                raise self._fail(line, text, "An empty line stands inside the table, or its header is lost.")
            self.export.header.append(" ".join(cells))
        elif self.expects == "header":
            self._names(self.current, line, cells)
        elif self.expects == "units":
            self._units(self.current, line, cells)
        else:
            self._data(self.current, line, row, cells)

    def _label(self, line: int, cells: list[str]) -> None:
        values = [cell for cell in cells[1:] if cell]
        text, meaning = repaired(" ".join(values)), label(repaired(cells[0]))
        numbers = [int(float(v)) for v in values if _WHOLE.fullmatch(v)]
        if meaning is None and self.expects == "header" and self.is_rheoplus:
            # Settings of the interval, which RheoPlus writes between its number of points and its table.
            self.export.header.append(f"{cells[0]}\t{text}")
            return
        self._close()
        self.dangling = line
        if len(values) == 2 and len(numbers) == 2:
            self._begin(line, numbers[0], numbers[1])
            self.is_rheoplus = False
        elif meaning == "header" and len(values) > 1:
            self._unstated(line, cells)
        elif meaning == "interval" and len(values) == 1 and numbers:
            self.number = numbers[0]
        elif meaning == "points" and len(values) == 1 and numbers:
            self._begin(line, self.number, numbers[0])
            self.number, self.is_rheoplus = None, True
        else:
            self.export.header.append(f"{cells[0]}\t{text}")
            if meaning == "project":
                self.export.projects += 1
                if self.export.projects == 2:
                    self.notes.add("a second project begins; exports were joined", line)
            elif meaning == "test":
                self.test, self.result = text, ""
            elif meaning == "result":
                self.result = text

    def _begin(self, line: int, number: int | None, declared: int | None) -> Table:
        place = (self.sheet, self.test, self.result)
        before = sum((t.block.sheet, t.test, t.result) == place for t in self.export.tables)
        self.current = Table(self.test, self.result, number or before + 1, declared, Block(line, [], sheet=self.sheet))
        self.expects = "header"
        return self.current

    def _unstated(self, line: int, cells: list[str]) -> None:
        self.notes.add("a table without the line that states its number of points", line)
        self._names(self._begin(line, None, None), line, cells)

    def _names(self, current: Table, line: int, cells: list[str]) -> None:
        names = [repaired(cell) for cell in cells]
        if self.is_rheoplus and quantity(names[0]) != "point" and not any(map(_NUMBER.fullmatch, cells)):
            self.export.header.append(" ".join(cells))  # of the measuring profile
            return
        # RheoCompass keeps the first column for the label, RheoPlus begins with the points.
        current.first = 0 if quantity(names[0]) == "point" else 1
        current.block.headings = [Heading(name, "") for name in names[current.first :]]
        current.block.inset = current.first
        if len(current.block.headings) < 2 or any(map(_WHOLE.fullmatch, names)):
            text = f"found {shorten(' '.join(cells))}, expected the names of the columns"
            raise self._fail(line, text, "The lines of the table were changed; export the file again.")
        self.header_line, self.expects = line, "units"

    def _units(self, current: Table, line: int, cells: list[str]) -> None:
        inside, headings = [repaired(cell) for cell in cells[current.first :]], current.block.headings
        stated = [cell for cell in inside if cell]
        if stated and not cells[0] and all(map(_BRACKETS.fullmatch, stated)):
            if len(inside) > len(headings):
                raise self._fail(line, f"found {len(inside)} units for {len(headings)} columns")
            inside += [""] * (len(headings) - len(inside))
            subs = current.sub_labels + [""] * len(headings)
            current.sub_labels, current.block.unit_line = subs[: len(headings)], line
            current.block.headings = self._named([h.text for h in headings], inside, current.sub_labels)
            self.expects = "data"
            return
        if line - self.header_line > _UNITS_WITHIN or any(map(_NUMBER.fullmatch, stated)):
            text = "found no row of units such as [Pa] below the names of the columns"
            raise self._fail(line, text, "Export again with units; they are not guessed.")
        current.sub_labels = inside

    def _named(self, texts: list[str], units: list[str], sub_labels: list[str]) -> list[Heading]:
        """Name the columns; of those with one heading the further ones by their sub-label or a number."""
        headings: list[Heading] = []
        for text, unit, sub in zip(texts, units, sub_labels, strict=True):
            first = quantity(text) or slug(text)
            if text.endswith(","):
                self.notes.add(f'"{text}" is taken as the column {first}: a dot was replaced by a comma')
            others = [name for name in (f"{first}_{slug(sub)}" if sub else "", slug(text)) if name]
            numbered = [f"{others[-1]}_{serial}" for serial in range(2, len(texts) + 2)]
            taken = {heading.name for heading in headings}
            name = next(one for one in (first, *others, *numbered) if one not in taken)
            # A column of an unknown quantity is converted by its unit all the same.
            is_known = name == quantity(text) or (bool(unit.strip("[] ")) and is_unit(unit))
            headings.append(Heading(text, name, unit, is_known=is_known and name not in ("point", *TEXT)))
        return headings

    def _data(self, current: Table, line: int, row: list[str], cells: list[str]) -> None:
        # At least the first cell is empty (RheoCompass) or a point number (RheoPlus).
        if current.first and cells[0]:
            text = f"found {shorten(cells[0])} where the first cell of a row of data is empty"
            raise self._fail(line, text, "A cell was added or moved; compare the row with its neighbours.")
        inside = row[current.first :][: max(len(current.block.headings), len(cells) - current.first)]
        current.block.rows.append((line, inside))
        current.block.widths.append(len(current.block.headings) if self.sheet else len(inside))

    def _close(self) -> None:
        """End the table at hand."""
        found, self.current, self.expects = self.current, None, "labels"
        if found is None:
            return
        self.dangling, rows = 0, len(found.block.rows)
        if found.declared is not None and found.declared != rows:
            sheet = f"{self.sheet}, " if self.sheet else ""
            text = (
                f"interval {found.number} of {shorten(found.test)} declares {found.declared} points and holds {rows}: "
            )
            text += "the test was stopped, or the file is cut"
            self.notes.add(text, found.block.line)
            self.export.cut.append((found.block.line, f"{sheet}line {found.block.line}: {text}"))
        self.export.tables.append(found)

    def finished(self) -> Export:
        """Return the export; SourceError for one without a row of data."""
        last = self.dangling if self.current is None else 0
        self._close()
        if last:
            self.notes.add("the file ends after a label, before its table: it is cut", last)
        if not any(table.block.rows for table in self.export.tables):
            hint = "Export the table of the measurement from RheoCompass as CSV or XLSX."
            raise SourceError(self.notes.path, "found no table with rows of data", hint=hint)
        return self.export

"""From lines to tables: the structure that all Anton Paar exports share.

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

from instruments._headings import Heading, is_unit
from instruments._layout import Block, Lines, cells, is_numeric, trimmed
from instruments._quantities import TEXT, WORDS, fold, quantity, repaired, slug
from instruments._sheets import Notes
from labpipe.errors import SourceError
from labpipe.text import shorten

_BRACKETS = re.compile(r"\s*\[.*\]\s*")
_WHOLE = re.compile(r"\s*[0-9]{1,9}(?:\.0*)?\s*")
_UNITS_WITHIN = 3  # lines below the header: sub-labels, and a line that a hand has added
_MOST_COLUMNS = 512

#: The meaning of a label before a table, by its spellings.
_LABEL_OF = {fold(word): name for name, words in WORDS["rheometer"].items() for word in words}


@dataclass(slots=True)
class Table(Block):
    """A table with its test, result, number and declared points; ``inset`` is 1 where a label has the first column."""

    test: str = ""
    result: str = ""
    number: int = 1
    declared: int | None = None
    sub_labels: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Export:
    """One pass over the lines: the tables, the lines around them, and which part of a table comes next.

    ``cut`` holds line and note of tables that lack points; ``number`` is that of the next interval of RheoPlus,
    ``dangling`` the line of a label behind the last table.
    """

    notes: Notes
    tables: list[Table] = field(default_factory=list)
    header: list[str] = field(default_factory=list)
    cut: list[tuple[int, str]] = field(default_factory=list)
    projects: int = 0
    sheet: str = ""
    test: str = ""
    result: str = ""
    number: int | None = None
    current: Table | None = None
    expects: str = "labels"
    is_rheoplus: bool = False
    header_line: int = 0
    dangling: int = 0

    def read(self, sheet: str, lines: Lines, delimiter: str) -> None:
        """Read the lines of a sheet ("" of a text); SourceError for a table without units or a row that does not fit.

        An empty line ends a table that has rows.
        """
        self.sheet, self.test, self.result, self.number, before = sheet, "", "", None, 0
        for number, line in lines:
            row = cells(line, delimiter)
            found = trimmed(row)
            if not found:
                continue
            if number > before + 1 and self.current is not None and self.current.rows:
                self._close()
            if len(found) > _MOST_COLUMNS:
                raise self._fail(number, f"found {len(found)} cells, no table has more than {_MOST_COLUMNS}")
            self._take(number, row, found)
            before = number
        self.dangling = self.dangling if self.current is None else 0
        self._close()

    def _fail(self, line: int, message: str, hint: str = "") -> SourceError:
        where = f"sheet {self.sheet}: " if self.sheet else ""
        return SourceError(self.notes.path, where + message, line=line, hint=hint)

    def _take(self, line: int, row: list[str], found: list[str]) -> None:
        table, meaning = self.current, _LABEL_OF.get(fold(found[0]))
        is_names = self.expects == "header" and len(found) > 2 and not _WHOLE.fullmatch(found[1])
        if not is_names and (found[0].endswith(":") or meaning in ("header", "project")):
            self._label(line, found)
        elif table is None and quantity(repaired(found[0])) == "point" and len(found) > 2:
            self._names(self._begin(line, None, None), line, found)
        elif table is None:
            # Above the first table one number may be a remark; several are a row that lost its table.
            if sum(map(is_numeric, found)) > (0 if self.tables else 1):
                text = f"found {shorten(' '.join(found))} outside a table"
                raise self._fail(line, text, "An empty line stands inside the table, or its header is lost.")
            self.header.append(" ".join(found))
        elif self.expects == "header":
            self._names(table, line, found)
        elif self.expects == "units":
            self._units(table, line, found)
        elif table.inset and found[0]:
            text = f"found {shorten(found[0])} where the first cell of a row of data is empty"
            raise self._fail(line, text, "A cell was added or moved; compare the row with its neighbours.")
        else:
            inside = row[table.inset :][: max(len(table.headings), len(found) - table.inset)]
            table.rows.append((line, inside))
            table.widths.append(len(table.headings) if self.sheet else len(inside))

    def _label(self, line: int, found: list[str]) -> None:
        values = [cell for cell in found[1:] if cell]
        text, meaning = repaired(" ".join(values)), _LABEL_OF.get(fold(repaired(found[0])))
        numbers = [int(float(v)) for v in values if _WHOLE.fullmatch(v)]
        if meaning is None and self.expects == "header" and self.is_rheoplus:
            # Settings of the interval, which RheoPlus writes between its number of points and its table.
            self.header.append(f"{found[0]}\t{text}")
            return
        self._close()
        self.dangling = line
        if len(values) == 2 and len(numbers) == 2:
            self._begin(line, *numbers)
            self.is_rheoplus = False
        elif meaning == "header" and len(values) > 1:
            self._names(self._begin(line, None, None), line, found)
        elif meaning == "interval" and len(values) == 1 and numbers:
            self.number = numbers[0]
        elif meaning == "points" and len(values) == 1 and numbers:
            self._begin(line, self.number, numbers[0])
            self.number, self.is_rheoplus = None, True
        else:
            self.header.append(f"{found[0]}\t{text}")
            if meaning == "project":
                self.projects += 1
                if self.projects == 2:
                    self.notes.add("a second project begins; exports were joined", line)
            elif meaning == "test":
                self.test, self.result = text, ""
            elif meaning == "result":
                self.result = text

    def _begin(self, line: int, number: int | None, declared: int | None) -> Table:
        if declared is None:
            self.notes.add("a table without the line that states its number of points", line)
        place = (self.sheet, self.test, self.result)
        number = number or sum((t.sheet, t.test, t.result) == place for t in self.tables) + 1
        names = {"test": self.test, "result": self.result, "number": number, "declared": declared}
        self.current = Table(line, [], sheet=self.sheet, **names)  # type: ignore[arg-type]  # of several types
        self.expects = "header"
        return self.current

    def _names(self, table: Table, line: int, found: list[str]) -> None:
        names = [repaired(cell) for cell in found]
        if self.is_rheoplus and quantity(names[0]) != "point" and not any(map(is_numeric, found)):
            self.header.append(" ".join(found))  # of the measuring profile
            return
        # RheoCompass keeps the first column for the label, RheoPlus begins with the points.
        table.inset = 0 if quantity(names[0]) == "point" else 1
        table.headings = [Heading(name, "") for name in names[table.inset :]]
        if len(table.headings) < 2 or any(map(_WHOLE.fullmatch, names)):
            text = f"found {shorten(' '.join(found))}, expected the names of the columns"
            raise self._fail(line, text, "The lines of the table were changed; export the file again.")
        self.header_line, self.expects = line, "units"

    def _units(self, table: Table, line: int, found: list[str]) -> None:
        inside, count = [repaired(cell) for cell in found[table.inset :]], len(table.headings)
        stated = [cell for cell in inside if cell]
        if not (stated and not found[0] and all(map(_BRACKETS.fullmatch, stated))):
            if line - self.header_line > _UNITS_WITHIN or any(map(is_numeric, stated)):
                text = "found no row of units such as [Pa] below the names of the columns"
                raise self._fail(line, text, "Export again with units; they are not guessed.")
            table.sub_labels = inside
            return
        if len(inside) > count:
            raise self._fail(line, f"found {len(inside)} units for {count} columns")
        units, subs = ([*texts, *[""] * count][:count] for texts in (inside, table.sub_labels))
        table.unit_line, self.expects = line, "data"
        headings: list[Heading] = []
        for heading, unit, sub in zip(table.headings, units, subs, strict=True):
            # of several columns with one heading the further ones have their sub-label or a number in their names
            text, known = heading.text, quantity(heading.text)
            first = known or slug(text)
            if text.endswith(","):
                self.notes.add(f'"{text}" is taken as the column {first}: a dot was replaced by a comma')
            others = [name for name in (f"{first}_{slug(sub)}" if sub else "", slug(text)) if name]
            numbered = [f"{others[-1]}_{serial}" for serial in range(2, count + 2)]
            name = next(one for one in (first, *others, *numbered) if one not in {each.name for each in headings})
            # A column of an unknown quantity is converted by its unit all the same.
            is_known = name == known or (bool(unit.strip("[] ")) and is_unit(unit))
            headings.append(Heading(text, name, unit, is_known=is_known and name not in ("point", *TEXT)))
        table.headings = headings

    def _close(self) -> None:
        """End the table at hand."""
        found, self.current, self.expects = self.current, None, "labels"
        if found is None:
            return
        self.dangling, rows = 0, len(found.rows)
        if found.declared is not None and found.declared != rows:
            sheet, name = f"{self.sheet}, " if self.sheet else "", shorten(found.test)
            text = f"interval {found.number} of {name} declares {found.declared} points and holds {rows}: "
            text += "the test was stopped, or the file is cut"
            self.notes.add(text, found.line)
            self.cut.append((found.line, f"{sheet}line {found.line}: {text}"))
        self.tables.append(found)

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

from instruments._headings import Heading
from instruments._layout import Block, Lines, cells, is_numeric, trimmed
from instruments._quantities import TEXT, WORDS, fold, is_unit, quantity, repaired, slug
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
    number: int = 0
    declared: int | None = None


@dataclass(slots=True)
class Export:
    """The tables of an export; ``cut``: line and note of those that lack points, ``dangling``: line of a last label."""

    notes: Notes
    tables: list[Table] = field(default_factory=list)
    header: list[str] = field(default_factory=list)
    cut: list[tuple[int, str]] = field(default_factory=list)
    projects: int = 0
    dangling: int = 0

    def read(self, sheet: str, lines: Lines, delimiter: str) -> None:
        """Read the lines of a sheet, "" of a text; SourceError for a table without units or a row that does not fit."""
        rows = [(number, row) for number, line in lines if any(row := cells(line, delimiter))]
        test, result, count, is_plus, k = "", "", 0, False, 0
        while k < len(rows):
            (line, row), k = rows[k], k + 1
            found, table = trimmed(row), Table(rows[k - 1][0], [], sheet=sheet)
            if len(found) > _MOST_COLUMNS:
                text = f"found {len(found)} cells, no table has more than {_MOST_COLUMNS}"
                raise SourceError(table.place(self.notes.path), text, line=line)
            values, meaning, is_label = [repaired(cell) for cell in found[1:] if cell], *_label(found)
            numbers = [int(float(v)) for v in values if _WHOLE.fullmatch(v)] if is_label else []
            is_point = quantity(repaired(found[0])) == "point" and len(found) > 2
            self.dangling = line if is_label else self.dangling
            if len(numbers) == len(values) == 2:
                table.number, table.declared, is_plus = numbers[0], numbers[1], False
            elif (is_label and meaning == "header" and len(values) > 1) or (is_point and not is_label):
                self.notes.add("a table without the line that states its number of points", line)
                k -= 1  # these are its names
            elif meaning == "points" and len(numbers) == len(values) == 1:
                table.number, table.declared, is_plus, count = count, numbers[0], True, 0
            elif meaning == "interval" and len(numbers) == len(values) == 1:
                count = numbers[0]
                continue
            else:
                # Above the first table one number may be a remark; several are a row that lost its table.
                if not is_label and sum(map(is_numeric, found)) > (0 if self.tables else 1):
                    text, hint = f"found {shorten(' '.join(found))} outside a table", "An empty line stands inside the "
                    hint += "table, or its header is lost."
                    raise SourceError(table.place(self.notes.path), text, line=line, hint=hint)
                self.header.append(f"{found[0]}\t{' '.join(values)}" if is_label else " ".join(found))
                test, result = (" ".join(values), "") if is_label and meaning == "test" else (test, result)
                result = " ".join(values) if is_label and meaning == "result" else result
                self.projects += is_label and meaning == "project"
                if is_label and meaning == "project" and self.projects == 2:
                    self.notes.add("a second project begins; exports were joined", line)
                continue
            table.test, table.result = test, result
            before = sum((t.sheet, t.test, t.result) == (sheet, test, result) for t in self.tables)
            table.number = table.number or before + 1
            k = self._table(table, rows, k, is_plus=is_plus)

    def _table(self, table: Table, rows: list[tuple[int, list[str]]], k: int, *, is_plus: bool) -> int:
        """Read names, units and rows of a table up to an empty line; return the index of the first line behind it."""
        path, names_at, subs, before = table.place(self.notes.path), 0, list[str](), 0
        while k < len(rows):
            line, row = rows[k]
            found, (meaning, is_label) = trimmed(row), _label(trimmed(row))
            names = [repaired(cell) for cell in found]
            text = f"found {shorten(' '.join(found))}"
            if not names_at:
                is_setting = is_label and (len(found) < 3 or _WHOLE.fullmatch(found[1]) is not None)
                is_of_points = quantity(names[0]) == "point"
                if is_setting and (meaning or not is_plus):
                    break
                if is_setting or (is_plus and not is_of_points and not any(map(is_numeric, found))):
                    rest = " ".join(filter(None, names[1:]))
                    self.header.append(f"{found[0]}\t{rest}" if is_setting else " ".join(found))
                else:
                    table.inset, names_at = 0 if is_of_points else 1, line
                    table.headings = [Heading(name, "") for name in names[table.inset :]]
                    if len(table.headings) < 2 or any(map(_WHOLE.fullmatch, names)):
                        hint = "The lines of the table were changed; export the file again."
                        raise SourceError(path, f"{text}, expected the names of the columns", line=line, hint=hint)
            elif is_label or (table.rows and line > before + 1):
                break
            elif not table.unit_line:
                inside, stated = names[table.inset :], [cell for cell in names[table.inset :] if cell]
                if stated and not found[0] and all(map(_BRACKETS.fullmatch, stated)):
                    self._take_units(table, line, inside, subs)
                elif line - names_at > _UNITS_WITHIN or any(map(is_numeric, stated)):
                    text, hint = "found no row of units such as [Pa] below the names of the columns", "Export again "
                    raise SourceError(path, text, line=line, hint=hint + "with units; they are not guessed.")
                else:
                    subs = inside
            elif table.inset and found[0]:
                text, hint = f"{text} where a row of data begins with an empty cell", "A cell was added or moved; "
                raise SourceError(path, text, line=line, hint=hint + "compare the row with its neighbours.")
            else:
                inside = row[table.inset :][: max(len(table.headings), len(found) - table.inset)]
                table.rows.append((line, inside))
                table.widths.append(len(table.headings) if table.sheet else len(inside))
            k, before = k + 1, line
        self.tables.append(table)
        self.dangling = 0
        if table.declared not in (None, len(table.rows)):
            sheet, name = f"{table.sheet}, " if table.sheet else "", shorten(table.test)
            text = f"interval {table.number} of {name} declares {table.declared} points and holds {len(table.rows)}: "
            text += "the test was stopped, or the file is cut"
            self.notes.add(text, table.line)
            self.cut.append((table.line, f"{sheet}line {table.line}: {text}"))
        return k

    def _take_units(self, table: Table, line: int, inside: list[str], subs: list[str]) -> None:
        """Give the columns their units, and names of their own; ``subs`` are the sub-labels above the units."""
        if len(inside) > len(table.headings):
            text = f"found {len(inside)} units for {len(table.headings)} columns"
            raise SourceError(table.place(self.notes.path), text, line=line)
        table.unit_line, headings = line, list[Heading]()
        units, labels = ([*texts, *[""] * len(table.headings)][: len(table.headings)] for texts in (inside, subs))
        for heading, unit, sub in zip(table.headings, units, labels, strict=True):
            # of several columns with one heading the further ones have their sub-label or a number in their names
            text, known = heading.text, quantity(heading.text)
            first = known or slug(text)
            if text.endswith(","):
                self.notes.add(f'"{text}" is taken as the column {first}: a dot was replaced by a comma')
            others = [name for name in (f"{first}_{slug(sub)}" if sub else "", slug(text)) if name]
            numbered = [f"{others[-1]}_{serial}" for serial in range(2, len(table.headings) + 2)]
            name = next(one for one in (first, *others, *numbered) if one not in {each.name for each in headings})
            # A column of an unknown quantity is converted by its unit all the same.
            is_known = name == known or (bool(unit.strip("[] ")) and is_unit(unit))
            headings.append(Heading(text, name, unit, is_known=is_known and name not in ("point", *TEXT)))
        table.headings = headings


def _label(found: list[str]) -> tuple[str | None, bool]:
    """Return the meaning of the first cell of a line, and whether it is a label."""
    meaning = _LABEL_OF.get(fold(repaired(found[0])))
    return meaning, found[0].endswith(":") or meaning in ("header", "project")

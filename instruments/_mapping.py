"""Columns that a user names (:func:`instruments.tables.read`), of a table or trace that no reader recognises.

The unit is given in brackets in the heading, in a row of units, in a line of the header, or with the column. One that
contradicts the file is refused.
"""

import re
import tomllib
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

from instruments._headings import Heading, facts, parsed
from instruments._instrument import HEAD_LINES
from instruments._layout import ABSENT, TAB, WAYS, Block, Lines, cells, fill, is_numeric, is_row
from instruments._quantities import SI_OF, TIMES, TRACES, is_begin, is_unit, quantity, slug, unit_of
from labpipe.errors import UNSAID, InputError, SourceError
from labpipe.text import not_a_number, shorten

Columns = str | Mapping[str, Any]

_BRACKET = re.compile(r"[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
_OF_TIME = re.compile(r"\bx|horizontal|time", re.IGNORECASE)
_ROWS = 3  # rows of numbers, one below the other, that make a table
_EXAMPLE = 'columns = { time = "Time (s)", displacement = "Position (m)" }'


class Chosen(NamedTuple):
    """One column: the quantity, its heading or number from 1, and a unit that is stated with it."""

    name: str
    column: str | int
    unit: str = ""


def chosen(columns: Columns) -> tuple[Chosen, ...]:
    """Read the columns that a user names; InputError where no trace, sweep, response or table of shifts has them."""
    if isinstance(columns, str) and "=" in columns:
        text = columns.strip().removeprefix("columns").lstrip(" =").strip()
        try:
            columns = tomllib.loads(f"columns = {text if text.startswith('{') else '{' + text + '}'}")["columns"]
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"columns cannot be read ({error}); write {_EXAMPLE}") from None
    found: list[Chosen] = []
    if isinstance(columns, str):
        given = enumerate(map(parsed, columns.split(";" if ";" in columns else ",")), 1)
        found, columns = [Chosen(h.name, number, h.unit) for number, h in given if h.is_known], {}
    for name, value in columns.items():
        known = name if name in TRACES else quantity(name)
        if known not in SI_OF:
            quantities = ", ".join(n for n in SI_OF if n not in ("set", "b_T"))
            raise InputError(f'columns: "{name}" is no quantity; known are {quantities}')
        stated = value if isinstance(value, Mapping) else {"column": value}
        column, unit = stated.get("column"), stated.get("unit", "")
        is_column = (isinstance(column, str) and column.strip()) or (type(column) is int and column >= 1)
        if not is_column or not isinstance(unit, str) or set(stated) - {"column", "unit"}:
            text = f"columns: {name} is given {value!r}; expected the heading of a column, its number from 1, or "
            raise InputError(text + '{ column = "Position", unit = "m" }')
        found.append(Chosen(str(known), column, unit))  # type: ignore[arg-type]  # it is a text or a number
    names = [each.name for each in found]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise InputError(f"columns: {twice} is named twice")
    is_trace = "displacement" in names or {"position", "force"} <= set(names)
    if not is_trace and not is_begin(set(names)):
        text = f"columns name {', '.join(names) or 'no quantity that is known'}; expected displacement and time, or "
        text += "position, force and time, or frequency and two of storage modulus, loss modulus, tan δ and so on"
        raise InputError(f"{text}, for example {_EXAMPLE}")
    return tuple(found)


def located(path: Path, lines: Lines, wanted: tuple[Chosen, ...]) -> Block:
    """Find the named columns among the lines of a file; the table that is returned holds them alone.

    SourceError where there is no such heading, a unit is missing or contradicts the file, or a cell is no number.
    """
    start, separator, texts, line = _headings(path, lines, wanted)
    places = [c.column - 1 if isinstance(c.column, int) else _at(texts, c.column) or 0 for c in wanted]
    headings = [Heading(text, slug(text)) for text in texts]
    for each, place in zip(wanted, places, strict=True):
        head = parsed(texts[place])  # of a known quantity the unit may be behind a slash or a comma
        is_fitting = head.is_known and is_unit(head.unit, head.name) and (head.name == each.name or each.name in TIMES)
        unit = _in_brackets(texts[place]) or (head.unit if is_fitting else "")
        headings[place] = Heading(texts[place], each.name, unit, is_known=True)
    block = Block(line, headings)
    for _, text in lines[:start]:
        block.facts |= facts(text)
    k = fill(block, lines, start, separator)
    if not block.rows:
        raise SourceError(path, "found no row of numbers in the named columns", line=line or None)
    if below := next((number for number, text in lines[k:] if is_row(text, block, block.separator)), None):
        text = f"found {shorten(lines[k][1])}, and rows again from line {below}"
        raise SourceError(path, text, line=lines[k][0], hint="Correct the line, or give each table a file of its own.")
    for (number, row), width in zip(block.rows, block.widths, strict=True):
        if max(places) >= width:
            text = f"found {width} cells, expected {max(places) + 1}"
            raise SourceError(path, text, line=number, hint="A cell is missing; the file may be cut.")
        for place in places:
            if place < len(row) and not is_numeric(row[place]) and row[place].casefold() not in ABSENT:
                at = sum(len(before) + 1 for before in row[:place]) + 1
                raise not_a_number(row[place], path=path, line_number=number, column=at)
    above = lines[:start][-HEAD_LINES:]
    block.headings = [
        _with_unit(path, each, block.headings[p], line, _in_header(above, each.name in TIMES, p, separator))
        for each, p in zip(wanted, places, strict=True)
    ]
    block.rows = [(number, [row[p] if p < len(row) else "" for p in places]) for number, row in block.rows]
    block.widths = [len(places)] * len(block.rows)
    return block


def _headings(path: Path, lines: Lines, wanted: tuple[Chosen, ...]) -> tuple[int, str, list[str], int]:
    """Return the index behind the line of the headings, the sign between its cells, the headings, its number or 0."""
    named = [each.column for each in wanted if isinstance(each.column, str)]
    last = max((each.column for each in wanted if isinstance(each.column, int)), default=0)
    best: tuple[int, list[str], int] = (0, [], 0)
    for k, (number, line) in enumerate(lines):
        ways: tuple[str, ...] = (TAB,) if TAB in line.strip() else WAYS
        if not named:  # the sign that leaves nothing but numbers, of several the one that leaves most
            found = {way: [is_numeric(cell) for cell in cells(line, way) if cell] for way in WAYS}
            ways = (max(found, key=lambda way: (all(found[way]), sum(found[way]))),)
        for way in ways:
            parts = [part.strip('"') for part in cells(line, way)]
            if named:
                hits = sum(_at(parts, text) is not None for text in named)
                if hits == len(named):
                    return k + 1, way, parts, number
                if (hits > best[0] or (not best[1] and len(parts) > 1)) and not any(map(is_numeric, parts)):
                    best = (hits, parts, number)
            elif len(parts) >= last and sum(map(is_numeric, parts)) >= len(wanted):
                for at in range(k - 1, max(k - 4, -1), -1):  # headings that are there count
                    if len(above := cells(lines[at][1], way)) >= last and _are_names(above, len(parts)):
                        return at + 1, way, above, lines[at][0]
                return k, way, [f"column {count}" for count in range(1, len(parts) + 1)], 0
    lost = next((text for text in named if _at(best[1], text) is None), "")
    text = f"no column, or more than one, is called {shorten(lost)}" if named else "no row has as many columns"
    shown = f"; the headings are {', '.join(shorten(part) for part in best[1] if part)}" if best[1] else ""
    hint = "Write the heading as in the file, or the column's number."
    raise SourceError(path, text + shown, line=best[2] or None, hint=hint)


def _at(parts: Sequence[str], text: str) -> int | None:
    """Return which heading a text names, as a whole or without its unit; None for none or several."""
    for spell in (_plain, lambda one: _plain(_BRACKET.sub("", one))):
        found = [k for k, part in enumerate(parts) if spell(part) == spell(text)]
        if found:
            return found[0] if len(found) == 1 else None
    return None


def _in_brackets(text: str) -> str:
    return next((m for m in _BRACKET.findall(text) if m.strip() and is_unit(m)), "")


def _plain(text: str) -> str:
    return " ".join(unicodedata.normalize("NFKC", text).casefold().split())


def _with_unit(path: Path, each: Chosen, heading: Heading, line: int, in_header: str) -> Heading:
    """Return a heading with its unit; refuse one that contradicts the file or is none of the quantity."""
    shown, at = shorten(heading.text), line or None
    if each.name not in TIMES and quantity(_BRACKET.sub("", heading.text)) in TIMES:
        raise SourceError(path, f"{shown} is a time, no {each.name.replace('_', ' ')}", line=at)
    in_file = heading.unit if heading.unit and is_unit(heading.unit) else in_header
    if each.unit and in_file and unit_of(each.unit) != unit_of(in_file):
        said = f"{shown} is in {shorten(in_file)}, and columns say {shorten(each.unit)}"
        hint = "Correct the unit in columns, or leave it out: that of the file is taken."
        raise SourceError(path, said, line=at, hint=hint)
    si, unit = SI_OF[each.name], each.unit or in_file
    if not unit and si != ("1",):
        column = _quoted(each.column if not line else heading.text)
        example = f'{each.name} = {{ column = {column}, unit = "{_USUAL.get(si[0], si[0])}" }}'
        text, hint = f"the unit of {shown} is not stated", f"State it with the column: {example}."
        raise SourceError(path, text, line=at, hint=hint).because(UNSAID)
    if unit and not is_unit(unit, each.name):
        spelled = " or ".join(one for one in si if one != "degF")
        text = f"{shown} is in {shorten(unit)}, expected a unit of {spelled} for {each.name}"
        raise SourceError(path, text, line=at, hint="Name another column, or correct its unit.")
    return replace(heading, name=each.name, unit=unit, is_known=True)


def _in_header(lines: Lines, is_time: bool, place: int, way: str) -> str:
    """Return the unit that a line such as ``Y_Unit_Label  Volts`` or ``Vertical Units,V`` states for a column."""
    for _, line in lines:
        label, *stated = [part.strip() for part in cells(line, way)]
        units = [unit for unit in stated if unit and is_unit(unit)]
        if "unit" in label.casefold() and units and (_OF_TIME.search(label) is not None) == is_time:
            return units[0] if len(set(units)) == 1 or not 0 < place <= len(units) else units[place - 1]
    return ""


def time_step(lines: Lines, line: int) -> float | None:
    """Return the time between rows [s] that a header of LabVIEW states, ``Delta_X  5.0E-4``; None without one."""
    head = (cells(text, TAB) for number, text in lines if number < line)
    stated = (cell for label, *row in head if label == "Delta_X" for cell in row if is_numeric(cell))
    return float(next(stated, "0").replace(",", ".")) or None


_USUAL = {"m": "mm", "degC": "degC", "Pa": "MPa"}
#: Quantity and usual unit of a trace, by the SI unit of its column; that unit by the first word of other headings.
_TRACES = {"m": ("displacement", "mm"), "V": ("displacement", "V"), "N": ("force", "N"), "s": ("time", "s")}
_TRACE_WORDS = {
    **dict.fromkeys(("displacement", "position", "distance", "height", "weg", "abstand", "laser"), "m"),
    **dict.fromkeys(("voltage", "spannung", "channel", "ch1", "ai0"), "V"),
    **dict.fromkeys(("force", "load", "kraft"), "N"),
}


def _quoted(text: str | int) -> str:
    return str(text) if isinstance(text, int) else '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def line_to_copy(headings: Sequence[Heading], *, by_number: bool = False) -> str:
    """Write the mapping of a table as it may be copied, filled in as far as the headings allow."""
    found: dict[str, str] = {}
    for number, heading in enumerate(headings, 1):
        unit = heading.unit.strip("[]()") if heading.unit and is_unit(heading.unit) else ""
        is_known = heading.is_known and heading.at is None and (not unit or is_unit(unit, heading.name))
        name, usual = (heading.name, "") if is_known else _of_trace(heading)
        if name in ("", "point", "set") or name in found or name not in SI_OF:
            continue
        column, si = _quoted(number if by_number else heading.text), SI_OF[name]
        has_unit = bool(unit) and is_unit(unit, name)
        if si != ("1",) and (by_number or not has_unit):
            unit = unit if has_unit else usual or _USUAL.get(si[0], si[0])
            column = f'{{ column = {column}, unit = "{unit}" }}'
        found[name] = column
    if not found:
        return _EXAMPLE
    if "force" in found and "displacement" in found:  # of a tester
        found = {"position" if name == "displacement" else name: text for name, text in found.items()}
    return f"columns = {{ {', '.join(f'{name} = {text}' for name, text in found.items())} }}"


def _of_trace(heading: Heading) -> tuple[str, str]:
    """Propose the quantity of a trace for the line to copy, and its usual unit, by unit and first word of a heading."""
    unit, word = _in_brackets(heading.text) or heading.unit, slug(_BRACKET.sub("", heading.text)).split("_")[0]
    if quantity(word) in TIMES or heading.text.strip() == "X_Value":  # of LabVIEW
        return _TRACES["s"]
    return _TRACES.get(unit_of(unit).si if unit and is_unit(unit) else _TRACE_WORDS.get(word, ""), ("", ""))


def suggestion(lines: Lines) -> str:
    """Return the line to copy for an unknown table, "" where the lines hold no rows of numbers."""
    longest, way, first = 0, TAB, 0  # the longest run of rows of numbers
    for sign in WAYS:
        length = 0
        for k, (_, line) in enumerate(lines):
            filled = [cell for cell in cells(line, sign) if cell]
            is_one = len(cells(line, sign)) > 1 and sum(map(is_numeric, filled)) >= max(1, len(filled) - 1)
            length = length + 1 if is_one else 0
            if length > longest:
                longest, way, first = length, sign, k - length + 1
    if longest < _ROWS:
        return ""
    width = len(cells(lines[first][1], way))
    above = [cells(text, way) for _, text in lines[max(first - 3, 0) : first]]
    names = next((row for row in reversed(above) if _are_names(row, width)), [])
    units = next((row for row in reversed(above) if row != names and any(map(is_unit, filter(None, row)))), [])
    headings = [parsed(name).with_unit(unit) for name, unit in zip_longest(names, units[: len(names)], fillvalue="")]
    for k, heading in enumerate(headings):
        if cells(lines[first][1], way)[k : k + 1] == [""]:
            headings[k] = Heading("", "")  # an empty column
        elif not heading.unit and (name := _of_trace(heading)[0]):  # a line of the header may state it
            headings[k] = heading.with_unit(_in_header(lines[:first], name == "time", k, way))
    return line_to_copy(headings)


def _are_names(row: Sequence[str], width: int) -> bool:
    filled = [cell for cell in row if cell]
    is_full = len(filled) >= min(width, 2) and len(row) <= width + 1
    return is_full and not any(map(is_numeric, filled)) and not all(map(is_unit, filled))

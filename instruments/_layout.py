"""The layout of a text with tables: headings, a row of units, rows of numbers, and the lines above them.

A file may hold many tables, each after any number of lines about specimen and procedure. A table begins at the line
that names at least two quantities of a dynamic mechanical analysis and has rows of numbers below it.
"""

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from instruments._headings import Heading, facts, parsed, stated_in_title
from instruments._quantities import OTHERS, is_begin, is_unit
from labpipe.errors import InputError, SourceError
from labpipe.text import DOT, Separators, separators

TAB, SEMICOLON, COMMA, GAPS, BLANKS = "\t", ";", ",", "two blanks", "blanks"
WAYS = (TAB, SEMICOLON, COMMA, GAPS, BLANKS)  # to part a line, in the order in which they are tried
_OF_ROWS = (TAB, SEMICOLON, COMMA, BLANKS)

#: Marks of a cell without a reading.
ABSENT = (
    "", "-", "--", "---", "nan", "n/a", "na", "n.a.", "null", "none", "invalid", "error", "#n/a", "#num!", "#div/0!",
    "#value!", "#ref!", "*", "**", "***", "****", "?", "inf", "-inf", "infinity", "∞", "-∞", "1.#inf", "-1.#ind",
    "over", "under", "overload", "n.d.", "k.a.", *("#" * count for count in range(2, 16)),
    "+fffffff", "-fffffff", "fffffff", "-------", "--------", "alarm",  # of Keyence sensors
)  # fmt: skip
_NUMERIC = re.compile(r"[+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?")
_CLOCK = re.compile(
    r"(?:\d{1,4}([-/.])\d{1,2}\1\d{1,4}[T ,]*)?\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?(?:\s*[AP]M)?", re.IGNORECASE
)
_MARK = re.compile(r"^\s*(?:#+|%+|//|!)\s*")
_MINUS = re.compile(r"\u2212|(?<![\w.,])\u2013(?=\d)")  # as papers and word processors write it
SIGNAL = re.compile(r"\s*Sig\d+\s+(.+?)\s*", re.IGNORECASE)  # a column of a file of Universal Analysis
_DATA = re.compile(r"\s*StartOfData\s*", re.IGNORECASE)
_STEP = re.compile(r"^\s*\[step\]\s*$", re.IGNORECASE)
Lines = Sequence[tuple[int, str]]
_LONGEST = 20_000  # characters of a line of headings; a longer one is a row of something else
_BETWEEN = 6  # lines of units and remarks between headings and rows at most
_NO_NUMBERS = OTHERS | {"set", "point"}  # quantities that a row of numbers may lack


@dataclass(slots=True)
class Block:
    """One table of a text.

    ``line`` and ``unit_line`` are those of the headings and of the row of units (0 without one), whose units the
    ``headings`` have; ``rows`` are line and cells of every row, ``widths`` their numbers of cells with the padding at
    the end, ``separator`` is between them; ``title`` names the step; ``facts`` are quantities stated above the table,
    by name value and unit; ``above`` is the line above the headings; ``sheet`` that of a workbook; ``inset`` the
    characters of each line before the first of these cells.
    """

    line: int
    headings: list[Heading]
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    widths: list[int] = field(default_factory=list)
    separator: str = ""
    title: str = ""
    facts: dict[str, tuple[float, str]] = field(default_factory=dict)
    above: str = ""
    unit_line: int = 0
    sheet: str = ""
    inset: int = 0

    def place(self, path: Path) -> Path:
        """Name the sheet with the file, for messages."""
        return path.with_name(f"{path.name}, sheet {self.sheet}") if self.sheet else path

    def names(self) -> set[str]:
        """Return the quantities that it names, or that stand above it."""
        named = {heading.name for heading in self.headings if heading.is_known}
        return named | {heading.place for heading in self.headings if heading.at is not None} | set(self.facts)


def cells(line: str, separator: str) -> list[str]:
    """Part one line into cells."""
    if separator in (TAB, SEMICOLON, COMMA):
        # A quotation mark in place of two primes does not begin a quotation.
        if re.search(rf'(?:^|{separator})\s*"[^"]*"\s*(?:{separator}|$)', line):
            return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
        return [cell.strip() for cell in line.split(separator)]
    return re.split(r"\s{2,}", line.strip()) if separator == GAPS else line.split()


def trimmed(found: list[str]) -> list[str]:
    """Drop the padding of a spreadsheet at the end of a line."""
    return found[: next((k for k in range(len(found), 0, -1) if found[k - 1]), 0)]


def is_numeric(cell: str) -> bool:
    """Return whether a cell can be a number, whatever its decimal sign."""
    return _NUMERIC.fullmatch(cell.strip()) is not None


def is_clock(cell: str) -> bool:
    """Recognise a time of day, a date, or both, which are no number."""
    return _CLOCK.fullmatch(cell) is not None


def plain_lines(lines: Iterable[str]) -> Lines:
    """Return the lines that are not empty with their numbers, with plain minus signs."""
    return [(number, _MINUS.sub("-", line)) for number, line in enumerate(lines, 1) if line.strip("\t;,| \ufeff")]


def headings_of(line: str) -> tuple[list[Heading], str] | None:
    """Return the headings of a line that begins a table, and the sign between them; None of others."""
    bare = _MARK.sub("", line)
    if len(bare) > _LONGEST or not any(c.isalpha() for c in bare):
        return None
    best: tuple[int, list[Heading], str] | None = None
    for separator in (TAB,) if TAB in bare.rstrip() else WAYS[1:]:
        texts = trimmed([re.sub(r'^"(.*)"$', r"\1", cell) for cell in cells(bare, separator)])
        if len(texts) < 2 or any(is_numeric(text) or text == "=" for text in texts):
            continue  # "at 25 °C" is no a_T
        found = [parsed(text) for text in texts]
        known = [heading for heading in found if heading.is_known]
        if not is_begin({heading.name for heading in known} | {h.place for h in known if h.at is not None}):
            continue
        unknown = sum(map(bool, texts)) - len(known)  # a wrong sign cuts names into unknown pieces
        if best is None or unknown < best[0]:
            best = (unknown, found, separator)
    return None if best is None else (best[1], best[2])


def blocks(lines: Lines) -> list[Block]:
    """Find the tables of a text.

    Headings without a row of numbers, as in prose, are passed over where there are other tables. Rows that go on below
    lines of words are a table of their own, with the headings above.
    """
    found: list[Block] = []
    signals: list[Heading] = []
    stated: dict[str, tuple[float, str]] = {}
    title, in_step, k = "", False, 0
    while k < len(lines):
        number, line = lines[k]
        above = lines[k - 1][1] if k else ""
        last = found[-1] if found and found[-1].rows else None
        block, sign = None, ""
        if signal := SIGNAL.fullmatch(line):
            signals.append(parsed(signal[1]))
        elif signals and _DATA.fullmatch(line):
            block, sign = Block(number, signals), TAB if TAB in lines[min(k + 1, len(lines) - 1)][1] else BLANKS
        elif named := headings_of(line):
            block, sign = Block(number, named[0]), named[1]
        elif last is not None and (  # a whole row below some words goes on with the table above them
            len(cells(line, last.separator)) in last.widths and is_row(line, last, last.separator)
        ):
            block = replace(last, rows=[], widths=[], facts=last.facts | stated | stated_in_title(above))
            k, in_step = fill(block, lines, k, last.separator), False
            found.append(block)
            continue
        if block is not None:
            block.title, block.above, in_step = title, above, False
            block.facts = stated | stated_in_title(title) | (stated_in_title(above) if not headings_of(above) else {})
            k = fill(block, lines, k + 1, sign)
            found += [block] if block.rows or not found else []
            continue
        if _STEP.match(line):
            in_step, title = True, ""
        elif in_step and not title:
            title = line.split(TAB)[-1].strip()
        stated |= facts(line)
        k += 1
    return [block for block in found if block.rows] or found


def fill(block: Block, lines: Lines, k: int, separator: str) -> int:
    """Read units and rows of a table; return the index of the first line behind it."""
    near = range(k, min(k + _BETWEEN, len(lines)))
    first = next((i for i in near if any(is_row(lines[i][1], block, way) for way in (separator, BLANKS))), None)
    if first is None:
        return k
    for number, line in lines[k:first]:
        if not block.unit_line and _take_units(block, line, separator):
            block.unit_line = number
        else:
            block.facts |= facts(line) or stated_in_title(line)
    head = lines[first][1]
    ways = dict.fromkeys([separator, *_OF_ROWS] if separator in _OF_ROWS else _OF_ROWS)
    numbers = {way: sum(map(is_numeric, cells(head, way))) for way in ways}
    whole = [way for way in numbers if len(trimmed(cells(head, way))) == len(block.headings)]
    block.separator = TAB if TAB in head.strip() else separator
    if block.separator != TAB and (whole or numbers.get(separator, 0) <= 1):  # that of the headings does not fit
        block.separator = max(whole or numbers, key=lambda way: numbers[way])
    for end, (number, line) in enumerate(lines[first:], first):
        parts = cells(line, block.separator)
        if not is_row(line, block, block.separator):  # a row with a damaged cell, or something else
            known = [cell for heading, cell in zip(block.headings, parts, strict=False) if heading.is_known and cell]
            is_damaged = sum(map(is_numeric, known)) * 2 >= len(known) > 1
            if not is_damaged or headings_of(line) is not None or facts(line):
                return end
        block.rows.append((number, trimmed(parts)))
        block.widths.append(len(parts))
    return len(lines)


def _take_units(block: Block, line: str, separator: str) -> bool:
    """Take a row of units; between blanks nobody sees which column has none, so the best fit counts."""
    bare = _MARK.sub("", line)

    def fitting(units: Sequence[str]) -> int:
        pairs = zip(block.headings, units, strict=False)
        return sum(each.is_known and bool(unit.strip()) and is_unit(unit, each.name) for each, unit in pairs)

    for way in dict.fromkeys((separator, *_OF_ROWS)):
        texts = cells(bare, way) if way in (TAB, SEMICOLON, COMMA) else trimmed(cells(bare, way))
        lost = len(block.headings) - len(trimmed(texts))
        if lost < 0 or not any(texts) or any(is_numeric(text) and text != "1" for text in texts):
            continue
        shifts = range(lost + 1) if way in (BLANKS, GAPS) else range(1)
        rows = [["" for _ in range(k)] + texts for k in shifts]
        count, units = max(((fitting(row), row) for row in rows), key=lambda one: one[0])
        if count or (way == separator and len(trimmed(texts)) > 1):
            padded = units + [""] * len(block.headings)
            block.headings = [heading.with_unit(unit) for heading, unit in zip(block.headings, padded, strict=False)]
            return True
    return False


def is_row(line: str, block: Block, separator: str) -> bool:
    """Recognise a row of numbers: the known columns that a result may need hold numbers, or nothing."""
    way = TAB if TAB in line.strip() else separator if separator in _OF_ROWS else BLANKS
    pairs = zip(block.headings, trimmed(cells(line, way)), strict=False)
    known = [cell for heading, cell in pairs if cell and heading.is_known and heading.name not in _NO_NUMBERS]
    good = sum(is_numeric(cell) or cell.casefold() in ABSENT or is_clock(cell) for cell in known)
    return bool(known) and good == len(known) and any(map(is_numeric, known))


def signs_of(path: Path, tables: Iterable[Block], decimal: str | None) -> Separators:
    """Decide the decimal and the thousands sign of a file from its cells of numbers, or from a stated decimal sign.

    SourceError where the cells are ambiguous, or show both signs as the decimal one.
    """
    rows = ((block, row) for block in tables for _, row in block.rows)
    pairs = (pair for block, row in rows for pair in zip(block.headings, row, strict=False))
    numbers = [cell for heading, cell in pairs if heading.is_known and heading.name != "point"]
    if decimal is not None:
        other = "." if decimal == "," else ","
        has_other = any(other in c and c.strip("+-").replace(",", "").replace(".", "").isdigit() for c in numbers)
        return Separators(decimal, other if has_other else "")
    if not any("," in cell for cell in numbers):
        return DOT
    parts = (cell.strip().lower().partition("e") for cell in numbers)
    try:  # no thousands sign stands before an exponent: one digit more makes that plain
        return separators(m + "0" if exponent and {",", "."} & set(m) else m for m, _, exponent in parts)
    except InputError as error:
        raise SourceError(path, str(error)) from None

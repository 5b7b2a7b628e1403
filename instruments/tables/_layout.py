"""The layout of a text with tables: headings, a row of units, rows of numbers, and the lines above them.

A file may hold one table or many (the steps of a procedure), after any number of lines about
specimen and procedure. A table begins at the line that names at least two quantities of a dynamic
mechanical analysis; what separates its columns is what names the most of them.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from instruments import anton_paar
from instruments._symbols import FREQUENCIES, MODULI, RESPONSES, TIMES
from instruments.tables import _words
from instruments.tables._cells import (
    ABSENT,
    BLANKS,
    COMMA,
    GAPS,
    OF_ROWS,
    SEMICOLON,
    SEPARATORS,
    TAB,
    cells,
    is_all_numbers,
    is_clock,
    is_numeric,
    trimmed,
)
from instruments.tables._words import DEGREES, Heading

_LETTER = re.compile(r"[^\W\d_]")
_MARK = re.compile(
    r"^\s*(?:#+|%+|//|!)\s*(?:(?:columns?|fields?|variables?|names?|header|units?)\s*[:=]\s*)?", re.IGNORECASE
)
_FACT = re.compile(
    r"(?:^|[\s;,(])(?P<key>[A-Za-zα-ωΑ-Ω°'_ .]+?(?:\s*[\[(][^\])]*[\])])?)(?:\s*[:=\t]\s*|\s{2,})"
    r"(?P<value>[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)"
    r"\s*(?P<unit>[^\s;,)]*(?:\s?C\b)?)"
)
_PLACES = rf"{DEGREES}|[mk]?Hz|rad/s"
_AT = re.compile(rf"(?:^|\s)(?:at|@|bei|à|[Tf]\s*=)\s*([+-]?\d+(?:[.,]\d+)?)\s*({_PLACES}|C)(?!\w)")
_GIVE_OR_TAKE = re.compile(r"\s*(?:±|\+/-|\+-)\s*\d+(?:[.,]\d+)?")
# Dashes that decorate a title do not touch its number: a single one is its sign.
_ALONE = re.compile(rf"[\s#*=:]*(?:--+\s+)?([+-]?\d+(?:[.,]\d+)?)\s*({_PLACES})[\s#*=:-]*")
_TITLE = re.compile(rf"(?:^|.*?[\s(\[_,:;=])([+-]?\d+(?:[.,]\d+)?)\s*({_PLACES})\s*[)\]]?[\s:;,#=-]*")
_OF_A_SWEEP = re.compile(r"iso|step|sweep|temp|freq|segment|run\b|test|versuch|messung|balayage|essai", re.IGNORECASE)
_OF_ANOTHER = re.compile(
    r"\bref|glass|\bt[gm]\b|\d\s*(?:°C|K)?\s*/\s*min|\bto\b|\bfrom\b|dried|drying|cur(?:ed|ing)|anneal|age(?:d|ing)"
    r"|\bstart|\bend\b|\bfinal\b|\binitial|\bambient|\broom|stored|storing|condition|humid|\bRH\b",
    re.IGNORECASE,
)
_PLAIN = re.compile(r"[+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?")
_OPEN = re.compile(r'(?:^|[,;\t])\s*"[^"]*$')  # a cell in quotation marks that goes on in the next line
_PLACE = re.compile(rf"[+-]?\d+(?:[.,]\d+)?\s*(?:{DEGREES}|C|Hz|rad/s)")
_PARAMETERS = re.compile(r"\s*[A-Za-z]\w*\s*=\s*[^=;]*;")  # key=value; of a RepTate header
_SIGNAL = re.compile(r"\s*Sig\d+\s+(.+?)\s*", re.IGNORECASE)  # a column of a file of Universal Analysis
_MINUS = re.compile(r"\u2212|(?<![\w.,])\u2013(?=\d)")  # as papers and word processors write it
_DATA = re.compile(r"\s*StartOfData\s*", re.IGNORECASE)
_BEGINS = re.compile(r"^\s*\[step\]\s*$", re.IGNORECASE)


@dataclass(slots=True)
class Block:
    """One table of a text.

    Attributes
    ----------
    line : int
        Of the headings.
    headings : list of Heading
        Units of a row of their own are theirs already.
    rows : list of (int, list of str)
        Line and cells of every row.
    widths : list of int
        Cells of every row before padding at its end fell away.
    separator : str
        Between the cells of the rows.
    title : str
        The name of the step, "" where there is none.
    facts : dict
        Quantities stated above the table: canonical name to value and unit.
    unit_line : int
        Of the row of units, 0 where there is none.
    sheet : str
        In which it stands, "" in a text.
    """

    line: int
    headings: list[Heading]
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    widths: list[int] = field(default_factory=list)
    separator: str = ""
    title: str = ""
    facts: dict[str, tuple[float, str]] = field(default_factory=dict)
    above: tuple[int, str] = (0, "")
    unit_line: int = 0
    sheet: str = ""

    def names(self) -> set[str]:
        """Return the quantities that it names, or that stand above it."""
        named = {heading.name for heading in self.headings if heading.is_known}
        at = {place_of(heading) for heading in self.headings if heading.at is not None}
        return named | at | set(self.facts)


def place_of(heading: Heading) -> str:
    """Name the quantity that the heading of a column states beside its own: of ``E'(1 Hz)`` the frequency."""
    return "frequency" if heading.at is not None and heading.at[1].endswith(("Hz", "rad/s")) else "temperature"


def joined(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Yield lines with their numbers, those together that are one heading in quotation marks."""
    held, first = "", 0
    for number, given in enumerate(lines, 1):
        line = _MINUS.sub("-", given)
        text = f"{held} {line}" if held else line
        first = first if held else number
        is_open = _OPEN.search(text) is not None and any(map(str.isalpha, text))
        if is_open and number - first < _MOST_LINES:
            held = text
            continue
        held = ""
        yield first, text
    if held:
        yield first, held


def headings_of(line: str, below: Sequence[str] = ()) -> tuple[list[Heading], str] | None:
    """Return the headings of a line that begins a table, and what separates them; None of others.

    The lines below tell how many columns there are, where it can be seen.
    """
    bare = _MARK.sub("", line)
    if len(bare) > _LONGEST or not _LETTER.search(bare):
        return None
    best: tuple[tuple[bool, int, int], list[Heading], str] | None = None
    widths = {len(row) for text in below for way in OF_ROWS if is_all_numbers(row := trimmed(cells(text, way)))}
    for separator in SEPARATORS:
        texts = trimmed([cell.strip().strip('"') if len(cell) > 2 else cell for cell in cells(bare, separator)])
        is_prose = separator == BLANKS and any(
            text == "=" or is_numeric(text) for text in texts
        )  # "at 25 °C" is no a_T
        if len(texts) < 2 or is_prose or all(is_numeric(text) for text in texts if text):
            continue
        found = [_words.parsed(text) for text in texts]
        names = {heading.name for heading in found if heading.is_known}
        if not is_begin(names):
            continue
        # A wrong separator cuts names into pieces, of which some are known and many are not.
        known = sum(heading.is_known for heading in found)
        rank = (len(found) in widths, 2 * known - sum(map(bool, texts)), known)
        if best is None or rank > best[0]:
            best = (rank, found, separator)
    return None if best is None else (best[1], best[2])


_BETWEEN = 4
"""Lines of words inside a table at most."""

_MOST_LINES = 8
"""Lines of one heading at most."""

_LONGEST = 20_000
"""Characters of a line of headings at most; a longer one is a row of something else."""


def is_begin(names: set[str]) -> bool:
    """Tell whether a line with these quantities begins a table, complete or not."""
    axes = names & (FREQUENCIES | TIMES | {"temperature", "temperature_set"})
    values = names & (MODULI | RESPONSES | {"loss_factor", "phase_angle"})
    return _words.is_table(names) or bool(axes and values and len(names) > 2) or len(names & MODULI) > 1


def blocks(lines: Sequence[tuple[int, str]], given: list[Heading] | None = None) -> list[Block]:
    """Find the tables of a text: its lines that are not empty, with their numbers.

    ``given`` are the columns, where a user names them: rows of as many numbers make the table.
    """
    found: list[Block] = []
    facts: dict[str, tuple[float, str]] = {}
    title, in_step, k = "", False, 0
    signals: list[Heading] = []
    if given is not None:
        return _given(lines, given)
    while k < len(lines):
        number, line = lines[k]
        signal = _SIGNAL.fullmatch(line)
        if signal:
            signals.append(_words.parsed(signal[1]))
        head = None if signal else _head(lines, k)
        if signals and _DATA.fullmatch(line):
            head = (signals, BLANKS, k + 1)
        if head is None:
            if _BEGINS.match(line):
                in_step, title = True, ""
            elif in_step and not title:
                title = line.split("\t")[-1].strip()
            facts |= dict(_facts(line))
            k += 1
            continue
        above = lines[k - 1] if k else (0, "")
        block = Block(number, head[0], title=title, facts=facts | _stated_at(title) | _stated_at(above[1]), above=above)
        k = _fill(block, lines, head[2], head[1])
        in_step = False
        if block.rows or not found:
            found.append(block)
        while (go_on := _goes_on(block, lines, k)) is not None:
            between = [line for _, line in lines[k:go_on]]
            facts |= dict(fact for line in between for fact in _facts(line))
            stated = {name: fact for line in between for name, fact in _stated_at(line).items()}
            block = replace(block, rows=[], widths=[], facts=block.facts | facts | stated)
            k = _fill(block, lines, go_on, block.separator)
            found.append(block)
    return [block for block in found if block.rows] or found


def signals_of(lines: Sequence[str]) -> str:
    """Return the columns that stand one below the other (``Sig1  Time (min)``) as one line of headings."""
    found = [match[1] for line in lines if (match := _SIGNAL.fullmatch(line)) is not None]
    return TAB.join(found)


def _goes_on(block: Block, lines: Sequence[tuple[int, str]], k: int) -> int | None:
    """Return where a table goes on below some lines of words, whose rows have the same columns."""
    if not block.rows:
        return None
    width = max(block.widths)
    for at in range(k, min(k + _BETWEEN, len(lines))):
        line = lines[at][1]
        if headings_of(line) is not None or _BEGINS.match(line):
            return None
        parts = cells(line, block.separator)
        if len(parts) == width and _is_row(line, block, block.separator) and not any(_facts(line)):
            return at
    return None


def _stated_at(line: str) -> dict[str, tuple[float, str]]:
    """Return the temperature or frequency that a title states, ``Isotherm at 20 °C``, or that stands alone."""
    line = _GIVE_OR_TAKE.sub("", line)
    match = None if _OF_ANOTHER.search(line) else _AT.search(line) or _ALONE.fullmatch(line)
    if match is None and _OF_A_SWEEP.search(line) and not _OF_ANOTHER.search(line):
        match = _TITLE.fullmatch(line) if len(_PLACE.findall(line)) == 1 else None
    if match is None:
        return {}
    value, unit = float(match[1].replace(",", ".")), match[2]
    is_frequency = unit.endswith(("Hz", "rad/s"))
    return {"frequency": (value, unit)} if is_frequency else {"temperature": (value, _words.degrees(unit))}


def _head(lines: Sequence[tuple[int, str]], k: int) -> tuple[list[Heading], str, int] | None:
    """Return headings that begin at a line, what separates them, and where what follows begins.

    Names may stand in two rows, ``Storage`` above ``Modulus``, or below what they have in common:
    ``Modulus`` above ``E'`` and ``E''``, ``20 °C`` above both; cells that were merged are empty.
    """
    head = headings_of(lines[k][1], [text for _, text in lines[k + 1 : k + 4]])
    if head is None:
        return None
    if k + 1 < len(lines):
        below = cells(_MARK.sub("", lines[k + 1][1]), head[1])
        found = _of_two_rows([h.text for h in head[0]], below)
        if found is not None:
            third = cells(_MARK.sub("", lines[k + 2][1]), head[1]) if k + 2 < len(lines) else []
            more = _of_two_rows([h.text for h in found], third)
            return (found, head[1], k + 2) if more is None else (more, head[1], k + 3)
    if k:
        above = cells(_MARK.sub("", lines[k - 1][1]), head[1])
        found = _of_two_rows(above, [h.text for h in head[0]]) if len(above) > 1 else None
        if found is not None and _quantities(found) > _quantities(head[0]):
            return found, head[1], k + 1
    return (*head, k + 1)


def _quantities(headings: Sequence[Heading]) -> set[str]:
    return {h.name for h in headings if h.is_known} | {"at" for h in headings if h.at is not None}


def _of_two_rows(above: Sequence[str], below: Sequence[str]) -> list[Heading] | None:
    """Join two rows of names; None where the second is one of units, or of something else."""
    width = max(len(above), len(trimmed(list(below))))
    if len(trimmed(list(below))) > len(above) and any(above[len(below) :]):
        return None
    found: list[Heading] = []
    common, named = "", 0
    # Of several temperatures above, each holds for the columns up to the next: ``T = 20 °C`` over f, E', E''.
    are_places = sum(len(_PLACE.findall(cell)) == 1 and not _words.parsed(cell).is_known for cell in above) > 1
    for k in range(width):
        top, bottom = (row[k].strip() if k < len(row) else "" for row in (above, below))
        common = top or common
        if is_numeric(bottom):
            return None
        made, symbol = _words.parsed(top), _words.parsed(bottom)
        # ``f`` below nothing, or below "Frequency", is no degree Fahrenheit.
        is_symbol = symbol.is_known and (top == "" or symbol.name == made.name)
        if not bottom or (_words.is_unit(bottom) and not is_symbol):
            found.append(_with_unit(made, bottom))
            continue
        place = _PLACE.search(common) if are_places else _PLACE.fullmatch(common)
        if place is not None:
            tries = [f"{bottom} @ {place[0]}"]
        else:
            tries = [f"{top} {bottom}".strip(), bottom, f"{common} {bottom}"]
        joined = next((h for text in tries if (h := _words.parsed(text)).is_known), None)
        if joined is None:
            return None
        named += 1
        found.append(joined)
    return found if named else None


def is_of_parameters(line: str) -> bool:
    """Tell the header of a RepTate file, ``T=20;Mw=94.9;``, whose columns are in rad/s and Pa."""
    return _PARAMETERS.match(line) is not None


def _facts(line: str) -> Iterator[tuple[str, tuple[float, str]]]:
    """Yield temperature and frequency as a line above a table states them, with their unit."""
    is_parameters = is_of_parameters(line)
    for way in (SEMICOLON, COMMA):  # a name, a number and a unit in cells of their own
        name, value, unit, *more = [*trimmed(cells(line, way)), "", "", ""]
        if not any(more) and _PLAIN.fullmatch(value):
            heading = _words.parsed(name.rstrip(": "))
            unit = unit or heading.unit
            if heading.name in ("temperature", "temperature_set", "frequency") and unit:
                line = f"{name.rstrip(': ')}: {value} {unit}"
                break
    for match in _FACT.finditer(_MARK.sub("", line)):
        heading = _words.parsed(match["key"].strip())
        if heading.name not in ("temperature", "temperature_set", "frequency"):
            continue
        unit = match["unit"] or heading.unit
        if is_parameters and not unit and heading.name == "temperature":
            unit = "degC"  # the format says so
        if unit and _words.fits(heading.name, unit):
            yield heading.name.removesuffix("_set"), (float(match["value"].replace(",", ".")), unit)


def _fill(block: Block, lines: Sequence[tuple[int, str]], k: int, separator: str) -> int:
    """Read units and rows of a table; return the index of the first line behind it."""
    if k < len(lines) and not _is_row(lines[k][1], block, separator):
        k = _units(block, lines, k, separator)
        k = _behind_remarks(block, lines, k, separator)
    if k < len(lines):
        block.separator = _separator_of_rows(lines[k][1], block, separator)
    while k < len(lines):
        number, line = lines[k]
        parts = cells(line, block.separator)
        is_row = _is_row(line, block, block.separator)
        if not is_row and (headings_of(line) or any(_facts(line)) or not _is_damaged(parts, block)):
            break
        block.rows.append((number, trimmed(parts)))
        block.widths.append(len(parts))
        k += 1
    _take_row_names(block)
    return k


def _behind_remarks(block: Block, lines: Sequence[tuple[int, str]], k: int, separator: str) -> int:
    """Return where the rows begin below some lines of words, such as the comments of a worksheet."""
    for at in range(k, min(k + _BETWEEN, len(lines))):
        if _is_row(lines[at][1], block, separator):
            return at
        parts = cells(lines[at][1], separator)
        if headings_of(lines[at][1]) or any(_facts(lines[at][1])) or any(map(is_numeric, parts)):
            break
    return k


def _take_row_names(block: Block) -> None:
    """Give the numbers of the rows, which some programs write without a heading, a column."""
    whole = [cells for _, cells in block.rows if len(cells) == len(block.headings) + 1]
    if whole and len(whole) == len(block.rows):
        numbers = [row[0].strip('"') for row in whole]
        if numbers in ([str(k + first) for k in range(len(whole))] for first in (0, 1)):
            block.headings = [Heading("", ""), *block.headings]


def _units(block: Block, lines: Sequence[tuple[int, str]], k: int, separator: str) -> int:
    """Take the row of units, if there is one; a line of something else may stand between."""
    number, line = lines[k]
    bare = _MARK.sub("", line)
    for way in dict.fromkeys((separator, *OF_ROWS)):
        texts = cells(bare, way)
        texts = texts if way in (TAB, SEMICOLON, COMMA) else trimmed(texts)
        if not any(texts) or len(trimmed(texts)) > len(block.headings):
            continue
        lost = len(block.headings) - len(texts)
        # Between blanks nobody sees which column has no unit.
        shifts = range(lost + 1) if way in (BLANKS, GAPS) else range(1)
        stated = max(([""] * k + texts + [""] * (lost - k) for k in shifts), key=partial(_fitting, block.headings))
        pairs = list(zip(block.headings, stated, strict=False))
        known = [unit for h, unit in pairs if h.is_known and unit.strip()]
        if known and _fitting(block.headings, stated) * 2 >= len(known):
            block.headings = [_with_unit(h, unit) for h, unit in pairs]
            block.unit_line = number
            return k + 1
    # A row of units that are none would be found to be no number; it is told as units.
    texts = [cell for cell in cells(bare, separator) if cell.strip()]
    if 1 < len(texts) <= len(block.headings) and not any(is_numeric(text) for text in texts):
        stated = cells(bare, separator) + [""] * len(block.headings)
        block.headings = [_with_unit(h, unit) for h, unit in zip(block.headings, stated, strict=False)]
        block.unit_line = number
        return k + 1
    return k


def _fitting(headings: Sequence[Heading], units: Sequence[str]) -> int:
    """Count the known columns whose unit is one of their quantity."""
    pairs = zip(headings, units, strict=False)
    return sum(h.is_known and bool(unit.strip()) and _words.fits(h.name, unit) for h, unit in pairs)


def _with_unit(heading: Heading, unit: str) -> Heading:
    """Add the unit of a row below to a heading that states none.

    What stands in brackets may be another word, ``Stress (step)``; what stands behind a slash makes another
    quantity, ``G*/sin(delta)``.
    """
    if not unit.strip() or (heading.unit and _words.is_unit(heading.unit)):
        return heading
    found = replace(heading, unit=unit.strip())
    is_in_brackets = f"({heading.unit})" in heading.text or f"[{heading.unit}]" in heading.text
    if heading.unit and not is_in_brackets:
        return replace(found, name=anton_paar.slug(heading.text), is_known=False)
    return found


def _separator_of_rows(line: str, block: Block, separator: str) -> str:
    """Return what separates the cells of the rows: that of the headings, unless it does not fit."""
    width = len(block.headings)
    ways = [separator] if separator in OF_ROWS else []
    numbers: dict[str, int] = {}
    for way in (*ways, *OF_ROWS):
        found = trimmed(cells(line, way))
        count = sum(is_numeric(cell) or cell.casefold() in ABSENT for cell in found)
        if len(found) == width and count * 2 > width:
            numbers.setdefault(way, count)
    if numbers:
        return max(numbers, key=lambda way: numbers[way])  # of equals the first
    if ways and sum(map(is_numeric, cells(line, separator))) > 1:
        return separator
    counts = {way: sum(map(is_numeric, cells(line, way))) for way in OF_ROWS}
    return max(counts, key=lambda way: counts[way])


def _is_row(line: str, block: Block, separator: str) -> bool:
    """Tell a row of numbers: of the columns that are known most hold one."""
    parts = trimmed(cells(line, separator if separator in OF_ROWS else BLANKS))
    if not parts:
        return False
    pairs = list(zip(block.headings, parts, strict=False))
    known = [cell for heading, cell in pairs if heading.is_known and heading.name != "set" and cell]
    good = sum(is_numeric(cell) or cell.casefold() in ABSENT[1:] or is_clock(cell) for cell in known)
    return bool(known) and good == len(known) and any(map(is_numeric, known))


def _is_damaged(parts: Sequence[str], block: Block) -> bool:
    """Tell a row with a damaged cell from a line of something else."""
    pairs = zip(block.headings, parts, strict=False)
    known = [cell for heading, cell in pairs if heading.is_known and cell]
    return sum(map(is_numeric, known)) * 2 >= len(known) > 1


def _given(lines: Sequence[tuple[int, str]], given: list[Heading]) -> list[Block]:
    """Take every row of as many numbers as there are columns."""
    block = Block(lines[0][0] if lines else 1, given)
    for number, line in lines:
        way = block.separator or next((w for w in OF_ROWS if _fits_given(line, w, given)), "")
        if not way:
            block.facts |= dict(_facts(line))
            continue
        parts = cells(line, way)
        if not _fits_given(line, way, given) and not (block.rows and _is_damaged(parts, block)):
            continue
        block.separator = way
        block.rows.append((number, trimmed(parts)))
        block.widths.append(len(parts))
    return [block]


def _fits_given(line: str, way: str, given: list[Heading]) -> bool:
    parts = trimmed(cells(line, way))
    return len(parts) == len(given) and all(is_numeric(p) or p.casefold() in ABSENT for p in parts)

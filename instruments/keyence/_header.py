"""The header of a Keyence storage file: its settings, the columns below it, and the first row of readings.

No storage file of LK-Navigator is public, so the layout is assumed. Settings that the header does not hold (sampling
cycle, units) are asked for, never guessed. Columns of judgements, notes and the like are left out.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from instruments._layout import trimmed
from instruments._quantities import WORDS, is_unit, unit_of
from instruments.keyence._markers import marker_status
from labpipe.errors import UNSAID, InputError, SourceError, warn_of
from labpipe.text import shorten
from labpipe.units import quantity

#: Patterns of the labels of header lines by their meaning, compared as a whole.
_LABELS = {meaning: re.compile("|".join(words), re.IGNORECASE) for meaning, words in WORDS["laser"].items()}
_COUNTER = re.compile(r"n[or°º]\.?|#|index|count(?:er)?|data no\.?|point|番号|序号", re.IGNORECASE)
_OUTPUT = re.compile(r"out ?0*([0-9]{1,2})\s*(?:[\[(]([^\])]*)[\])])?", re.IGNORECASE)
_LABEL = re.compile(r"(.*?)\s*(?:[\[(]([^\])]*)[\])](?:\s.*)?)?")  # a recorder may name the run behind the unit
_TIME = re.compile(
    r"(?:elapsed |relative |sampling )?time(?:[ -]?stamp)?|timestamp|t|date[ /&]*time|clock|"
    r"zeit|uhrzeit|temps|時間|時刻|时间",
    re.IGNORECASE,
)
_JUDGEMENT = re.compile(r"GO|NG|OK|HI|LO|HH|LL|HIGH|LOW|PASS|FAIL", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?[0-9][0-9.,]*(?:[eE][+-]?[0-9]+)?")
CLOCK = re.compile(r"(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[ T])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)")
# A unit that lost a letter may be another unit ("mm" and "m"), so only displayed ones are taken.
_UNITS = tuple(map(unit_of, ("mm", "um", "cm", "V", "mV", "mm/s", "m/s2", "km/s2")))
_SHORTEST, _LONGEST = 1e-7, 86400.0  # s; the time between samples of any sensor of this family


@dataclass(frozen=True, slots=True)
class Header:
    """Lines above the readings, and the columns below them.

    ``entries``: meaning of a label to (line number, cells of its value, unit inside the label); ``outputs``: numbers of
    the outputs in their order; ``has_counter``: the first column that is read counts the points; ``units``: one per
    output, or fewer; ``n_cells`` of a row, of which the indices ``kept`` are read; ``times``: index of such a column.
    """

    path: Path
    lines: Sequence[str]
    delimiter: str
    entries: Mapping[str, tuple[int, tuple[str, ...], str]]
    outputs: tuple[int, ...]
    has_counter: bool
    units: tuple[str, ...]
    n_cells: int
    kept: tuple[int, ...]
    times: int | None

    @property
    def n_lines(self) -> int:
        """Number of lines above the first row."""
        return len(self.lines)

    def text(self, meaning: str) -> str:
        """Return the value of a header line as one text, "" where there is none."""
        return " ".join(self.entries[meaning][1]).strip() if meaning in self.entries else ""

    def count(self, meaning: str) -> int | None:
        """Return a whole number (number of points, averaging), None without one; SourceError for any other cell."""
        if meaning not in self.entries:
            return None
        line, cells, _ = self.entries[meaning]
        found = {cell for cell in cells if cell}
        if len(found) != 1 or not re.fullmatch(r"[0-9]{1,12}", next(iter(found))):
            raise SourceError(self.path, f"found {shorten(','.join(cells))}, expected one whole number", line=line)
        return int(found.pop())

    def settle_units(self, given: Sequence[str] | None) -> tuple[str, ...]:
        """Return the unit of every output; SourceError without one, an unknown one, or where file and caller differ."""
        line, cells, _ = self.entries.get("units", (None, (), ""))
        stated, asked = tuple(filter(None, cells)) or self.units, tuple(given or ())
        units = stated or asked
        if len(units) != len(self.outputs):
            text = f"found {len(units)} units for {len(self.outputs)} outputs"
            text = text if units else "the file does not say the unit of its readings"
            hint = 'Give one for every output, in order: units=["mm"].'
            raise SourceError(self.path, text, line=line, hint=hint).because(UNSAID)
        if wrong := next((text for text in units if not _is_displayed(text)), ""):
            text = f"found the unit {shorten(wrong)}, expected a length, volts or a derivative"
            hint = "Units of Keyence outputs are mm, um, cm, V, mm/s, m/s2, km/s2."
            raise SourceError(self.path, text, line=line, hint=hint)
        if asked and list(map(unit_of, asked)) != list(map(unit_of, units)):
            raise self._contradiction("units", line, ", ".join(stated), ", ".join(asked))
        return units

    def settle_cycle(self, given: str | float | None) -> float:
        """Return the sampling cycle [s]; SourceError without one or its unit, or where file and caller differ."""
        asked = None if given is None else _seconds(given if isinstance(given, str) else f"{given} s")
        if given is not None and asked is None:
            raise InputError(f'cycle must be a time such as "50 us", found "{given}"')
        line, _, unit_text = self.entries.get("cycle", (None, (), ""))
        text = f"{self.text('cycle')} {unit_text}".strip()
        stated = _seconds(text)
        if line is not None and stated is None:
            message = f"found the sampling cycle {shorten(text)}, expected a time with its unit"
            hint = 'The line should read for example "Sampling cycle,50us".'
            raise SourceError(self.path, message, line=line, hint=hint)
        if stated and asked and abs(asked - stated) > 1e-9 * stated:
            raise self._contradiction("cycle", line, f"{stated:g} s", f"{asked:g} s")
        if (cycle := stated or asked) is None:
            text, hint = "the file does not say its sampling cycle", 'Give it: cycle="50 us".'
            raise SourceError(self.path, text, hint=hint).because(UNSAID)
        return cycle

    def settle_storage(self, given: int | None, cycle: float, *, is_cycle_given: bool) -> int:
        """Return the samples per stored point; SourceError without them, or where file and caller differ."""
        if "storage" not in self.entries:
            if given is None and not is_cycle_given:
                text = "the file does not say whether every sample was stored"
                hint = "Give the factor between samples and stored points: storage_factor=1."
                raise SourceError(self.path, text, hint=hint).because(UNSAID)
            return given or 1
        line, _, unit_text = self.entries["storage"]
        text = self.text("storage")
        match = re.fullmatch(r"(?:[x×*]|1/)?\s*([0-9]{1,9})\s*(?:times|回|倍)?", text, re.IGNORECASE)
        in_time = _seconds(f"{text} {unit_text}".strip())
        factor = float(match[1]) if match and not unit_text else (in_time or 0.0) / cycle
        if not 1 <= factor <= 1e9 or abs(factor - round(factor)) > 1e-6 * factor:
            message = f"found the storage cycle {shorten(text)}, expected a whole factor such as x1"
            hint = 'The line should read for example "Storage cycle,x10".'
            raise SourceError(self.path, message, line=line, hint=hint)
        if given is not None and given != round(factor):
            raise self._contradiction("storage_factor", line, round(factor), given)
        return round(factor)

    def _contradiction(self, name: str, line: int | None, stated: object, given: object) -> SourceError:
        text, hint = f"the file says {stated}, the option {name} says {given}", f"Leave the option {name} out, "
        return SourceError(self.path, text, line=line, hint=f"{hint}or correct it.")


def _seconds(text: str) -> float | None:
    """Read a time, or a rate as its inverse; None when it is neither, or cannot be meant."""
    try:
        value, _, si = quantity(text.replace(",", "."))
    except InputError:
        return None
    if value <= 0 or si not in ("s", "Hz"):
        return None
    seconds = value if si == "s" else 1.0 / value
    return seconds if _SHORTEST <= seconds <= _LONGEST else None


def _is_displayed(cell: str) -> bool:
    """Recognise a unit that an output can have."""
    return bool(cell) and is_unit(cell) and unit_of(cell) in _UNITS


def split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line and take quotes and blanks from its cells."""
    return [cell.strip().strip('"').strip() for cell in line.split(delimiter)]


def column_of(line: str, delimiter: str, index: int) -> int:
    """Return the place of a cell in its line, counted from 1."""
    return len(delimiter.join(line.split(delimiter)[:index])) + (2 if index else 1)


def _is_reading(cell: str) -> bool:
    return _NUMBER.fullmatch(cell) is not None or marker_status(cell) is not None


def parse_header(path: Path, lines: Sequence[str]) -> Header:
    """Find the first row of readings and understand the lines above it.

    ``lines`` are the beginning of the file. SourceError without a row of readings, with a line between the names of the
    columns and the first row, or names that do not fit the columns.
    """
    delimiter, start = _first_row(path, lines)
    split = [split_cells(line, delimiter) for line in lines[: start + 3]]
    row, names_at = split[start], _names_at(path, lines[:start], split[:start], len(split[start]))
    names = split[names_at] if names_at is not None else []
    if names and len(names) != len(row):
        hint = "If the comma is the decimal sign, export with semicolons or TABs between the columns."
        text = f"the first row has {len(row)} cells, its names are {len(names)}"
        raise SourceError(path, text, line=start + 1, column=1, hint=hint)
    kept: list[int] = []
    times, unneeded = None, _unneeded(names)
    for index, cell in enumerate(row):  # without names the cells of the first row tell
        label = _LABEL.fullmatch(names[index]) if names else None
        if index in unneeded:
            continue
        if times is None and (_TIME.fullmatch(label[1]) if label else CLOCK.fullmatch(cell)):
            times = index
        elif (cell or (label and label[0])) and not _JUDGEMENT.fullmatch(cell):
            kept.append(index)
    firsts = [cells[0] for cells in split[start:]]
    has_counter = len(kept) > 1 and len(firsts) == 3 and firsts[0] in ("0", "1") and all(map(str.isdigit, firsts))
    has_counter = has_counter and all(int(b) - int(a) == 1 for a, b in pairwise(firsts))
    if names:
        has_counter = _COUNTER.fullmatch(names[0]) is not None
    of_outputs = kept[int(has_counter) :]
    if not of_outputs:
        raise SourceError(path, "there is no column of readings", line=start + 1)
    outputs, units = tuple(range(1, len(of_outputs) + 1)), tuple[str, ...]()
    if names_at is not None:
        outputs, units = _outputs(path, [names[index] for index in of_outputs], names_at)
        units = _units_below(path, lines[:start], names_at, delimiter, of_outputs) or units
    others = [names[k] or f"column {k + 1}" for k in sorted(unneeded) if not _JUDGEMENT.fullmatch(row[k])]
    if others:
        warn_of(path, f"not read: {', '.join(others)}", line=(names_at or 0) + 1)
    entries: dict[str, tuple[int, tuple[str, ...], str]] = {}
    for number, line in enumerate(lines[: start if names_at is None else names_at], 1):
        cells = split_cells(line, delimiter)
        if len(cells) == 1:
            cells = [part.strip() for part in re.split(r"\s*[:=]\s*", cells[0], maxsplit=1)]
        label = _LABEL.fullmatch(cells[0].lstrip("#%; ").rstrip(":= "))
        for meaning, pattern in _LABELS.items():
            if label and pattern.fullmatch(label[1]) and meaning not in entries:
                entries[meaning] = (number, tuple(cells[1:]), label[2] or "")
    return Header(path, lines[:start], delimiter, entries, outputs, has_counter, units, len(row), tuple(kept), times)


def _unneeded(names: Sequence[str]) -> set[int]:
    """Return the places of other columns beside outputs OUT1, OUT2, …, a counter and times, such as notes."""
    if not any(map(_OUTPUT.fullmatch, names)):
        return set()
    labels = map(_LABEL.fullmatch, names)
    known = [label and (_COUNTER.fullmatch(label[0]) or _TIME.fullmatch(label[1])) for label in labels]
    return {k for k, name in enumerate(names) if not (known[k] or _OUTPUT.fullmatch(name))}


def _first_row(path: Path, lines: Sequence[str]) -> tuple[str, int]:
    """Return delimiter and index of the first row: readings, times of day, judgements, and empty cells at the end."""
    unneeded: set[int] = set()
    for index, line in enumerate(lines):
        for delimiter in ("\t", ";", ","):
            cells = split_cells(line, delimiter)
            unneeded = _unneeded(cells) or unneeded
            filled = trimmed([cell for k, cell in enumerate(cells) if k not in unneeded])
            others = [cell for cell in filled if not _is_reading(cell)]
            is_row = len(others) < len(filled) and all(CLOCK.fullmatch(c) or _JUDGEMENT.fullmatch(c) for c in others)
            if delimiter in line and is_row:
                return delimiter, index
        if _is_reading(line.strip().strip('"')):
            return "\t" if line.startswith("\t") else ",", index
    text = f"found no row of readings in the first {len(lines)} lines"
    raise SourceError(path, text, line=1, hint="Expected rows of numbers or markers such as +FFFFFFF below the header.")


def _names_at(path: Path, head: Sequence[str], split: Sequence[Sequence[str]], n_columns: int) -> int | None:
    """Return the index of the names of the columns: OUT1, or a word over every column, the first a counter or time."""
    found = [index for index, cells in enumerate(split) if any(map(_OUTPUT.fullmatch, cells))]
    if len(found) > 1:
        text = f"the columns are named twice, before on line {found[0] + 1}"
        raise SourceError(path, text, line=found[1] + 1, hint="Two exports were joined: split the file.")
    if found:
        return found[0]
    filled = [index for index, line in enumerate(head) if line.strip()]
    if len(filled) > 1 and len(split[filled[-1]]) == n_columns and all(c and is_unit(c) for c in split[filled[-1]]):
        filled.pop()  # a row of units below the names
    if filled:
        cells = split[filled[-1]]
        first = _LABEL.fullmatch(cells[0])
        is_first = _COUNTER.fullmatch(cells[0]) or (first is not None and _TIME.fullmatch(first[1]))
        if len(cells) == n_columns > 1 and is_first and all(re.match(r"[^\W\d_]|#", cell) for cell in cells):
            return filled[-1]
    # without names a damaged first row must not pass for a line of the header
    damaged = (i for i, cells in enumerate(split) if len(cells) == n_columns and re.match(r"[+-]?[0-9]", cells[0]))
    if (index := next(damaged, None)) is not None:
        text = f"found {shorten(head[index])}, which is neither a row of readings nor a header line"
        raise SourceError(path, text, line=index + 1, column=1, hint="If it is a damaged row, export the file again.")
    return None


def _outputs(path: Path, names: Sequence[str], names_at: int) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return the numbers of the outputs, and their units where all are in the names."""
    is_numbered = any(map(_OUTPUT.fullmatch, names))
    labels = [(_OUTPUT if is_numbered else _LABEL).fullmatch(name) for name in names]
    numbers = [int(label[1]) if label and is_numbered else k for k, label in enumerate(labels, 1)]
    for k, name in enumerate(names):
        if labels[k] is None or numbers[k] in numbers[:k]:
            text = f"found the column name {shorten(name)}, expected OUT1, OUT2, … each once"
            raise SourceError(path, text, line=names_at + 1, column=1)
    units = tuple((label and label[2]) or "" for label in labels)
    return tuple(numbers), units if all(units) else ()


def _units_below(
    path: Path, head: Sequence[str], names_at: int, delimiter: str, of_outputs: Sequence[int]
) -> tuple[str, ...]:
    """Return the row of units under the names, whole; no other line may be there."""
    units: tuple[str, ...] = ()
    for index, line in enumerate(head[names_at + 1 :], names_at + 1):
        cells = split_cells(line, delimiter)
        if not any(cells):
            continue
        if units or len(cells) <= max(of_outputs) or not all(_is_displayed(cells[k]) for k in of_outputs):
            wrong = next((i for i, cell in enumerate(cells) if not _is_reading(cell)), 0)
            at = column_of(line, delimiter, wrong)
            text = f"found {shorten(cells[wrong])}, expected the first row of readings"
            hint = "A cell of the row is no number and no known marker; export the file again."
            raise SourceError(path, text, line=index + 1, column=at, hint=hint)
        units = tuple(cells[k] for k in of_outputs)
    return units

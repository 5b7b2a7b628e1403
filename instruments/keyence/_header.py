"""The header of a Keyence storage file, its columns, and the first row of readings.

No storage file of LK-Navigator is public, so the layout is assumed. Settings that the header does not hold (sampling
cycle, units) are asked for, never guessed. Only outputs and the counter are read as numbers; columns of words and empty
ones are left out, and a column of times stays text, as its decimals say how exact it is.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from instruments.keyence._markers import marker_status
from labpipe.errors import InputError, SourceError
from labpipe.text import check_width, shorten
from labpipe.units import unit

LABELS: Mapping[str, str] = {
    "model": r"model|controller|modell|mod[èe]le|機種|型式|型号",
    "serial": r"serial(?: (?:number|no\.?))?|s/n",
    "head": r"(?:sensor )?head",
    "date": r"date(?: and time)?|start(?: time)?|datum|日付|日時|日期",
    "clock": r"time",
    "cycle": r"sampling (?:cycle|period|interval|rate|frequency|time)|abtast(?:zyklus|periode|intervall|rate|zeit)|"
    r"p[ée]riode d['’][ée]chantillonnage|fr[ée]quence d['’][ée]chantillonnage|サンプリング周期|采样周期|取样周期",
    "storage": r"(?:storage|storing|save) (?:cycle|factor|interval)|speicher(?:zyklus|intervall|faktor)|"
    r"ストレージ周期|蓄積周期|存储周期",
    "units": r"units?|y_unit_label|einheit(?:en)?|unit[ée]s?|単位|单位",
    "averaging": r"averag(?:e|ing)(?: (?:count|number|times))?|number of averages",
    "rows": r"(?:number of )?(?:data|points|samples)(?: (?:count|points|number))?",
}
"""Patterns of the labels of header lines by their meaning, compared as a whole without case."""

_COUNTER = re.compile(r"n[or°º]\.?|#|index|count(?:er)?|data no\.?|point|番号|序号", re.IGNORECASE)
_OUTPUT = re.compile(r"out ?0*([0-9]{1,2})\s*(?:[\[(]([^\])]*)[\])])?", re.IGNORECASE)
_LABEL = re.compile(r"(.*?)\s*(?:[\[(]([^\])]*)[\])](?:\s.*)?)?")  # a recorder may name the run behind the unit
_TIME = re.compile(
    r"(?:elapsed |relative |sampling )?time(?:[ -]?stamp)?|timestamp|t|date[ /&]*time|clock|"
    r"zeit|uhrzeit|temps|時間|時刻|时间",
    re.IGNORECASE,
)
_WORDS = re.compile(r"judge?ments?|judge|results?(?: info)?|status|state|go/?ng|判定(?:結果)?|结果", re.IGNORECASE)
_JUDGEMENT = re.compile(r"GO|NG|OK|HI|LO|HH|LL|HIGH|LOW|PASS|FAIL", re.IGNORECASE)
CLOCK = re.compile(r"(?:\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[ T])?(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)")
# A unit that lost a letter may be another unit ("mm" and "m"), so only displayed ones are taken.
_UNITS = tuple(map(unit, ("mm", "um", "cm", "V", "mV", "mm/s", "m/s2", "km/s2")))


@dataclass(frozen=True, slots=True)
class Header:
    """Lines above the readings, and the columns below them.

    ``text``: the lines, unchanged; ``n_lines``: their number; ``delimiter``; ``entries``: meaning of a label to (line
    number, cells of its value, unit inside the label); ``outputs``: numbers of the outputs, in the order of their
    columns; ``has_counter``: the first column read counts the points; ``unit_texts``: from the names of the columns or
    a row below them, or none; ``n_cells`` of a row, of which the indices ``kept`` are read; ``times``: index of the
    column of times or None, and ``time_unit``, "" where it is not said or they are times of day.
    """

    text: str
    n_lines: int
    delimiter: str
    entries: Mapping[str, tuple[int, tuple[str, ...], str]]
    outputs: tuple[int, ...]
    has_counter: bool
    unit_texts: tuple[str, ...]
    n_cells: int
    kept: tuple[int, ...]
    times: int | None
    time_unit: str

    def readings(self, lines: Iterable[str], path: Path) -> Iterator[str]:
        """Pass on the cells of each row that are read."""
        for number, line in enumerate(lines, self.n_lines + 1):
            cells = line.split(self.delimiter)
            check_width(line, cells, self.n_cells, self.delimiter, path=path, line_number=number)
            yield self.delimiter.join(cells[index] for index in self.kept)


def is_length_or_volts(text: str) -> bool:
    """Recognise a unit that an output can have."""
    try:
        return bool(text) and unit(text) in _UNITS
    except InputError:
        return False


def split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line and take quotes and blanks from its cells."""
    return [cell.strip().strip('"').strip() for cell in line.split(delimiter)]


def column_of(line: str, delimiter: str, index: int) -> int:
    """Return the place of a cell in its line, counted from 1.

    Examples
    --------
    >>> column_of("1,+00.1234", ",", 1)
    3
    """
    return len(delimiter.join(line.split(delimiter)[:index])) + (2 if index else 1)


def _is_unit(cell: str) -> bool:
    try:
        return bool(cell) and bool(unit(cell))
    except InputError:
        return False


def _is_reading(cell: str) -> bool:
    looks_like_number = re.fullmatch(r"[+-]?[0-9][0-9.,]*(?:[eE][+-]?[0-9]+)?", cell) is not None
    return looks_like_number or marker_status(cell) is not None


def parse_header(path: Path, lines: Sequence[str], delimiter: str | None) -> Header:
    """Find the first row of readings and understand the lines above it.

    ``lines`` are the beginning of the file, ``delimiter`` is found without one. Raises SourceError without a row of
    readings, with a line between the names of the columns and the first row, or names that do not fit the columns.
    """
    delimiter, start = _find_start(path, lines, delimiter)
    head, row = lines[:start], split_cells(lines[start], delimiter)
    names_at = _find_names(path, head, delimiter, len(row))
    unit_texts: tuple[str, ...] = ()
    if names_at is None:
        kept, times, time_unit = _sorted_columns((), row)
        firsts = [split_cells(line, delimiter)[0] for line in lines[start : start + 3]]
        counts = len(kept) > 1 and len(firsts) == 3 and all(map(str.isdigit, firsts)) and int(firsts[0]) in (0, 1)
        has_counter = counts and all(int(b) - int(a) == 1 for a, b in pairwise(firsts))
        outputs = tuple(range(1, len(kept) + 1 - has_counter))
    else:
        names = split_cells(head[names_at], delimiter)
        if len(names) != len(row):
            hint = 'If the comma is the decimal sign, the delimiter must be another: delimiter=";".'
            message = f"the first row has {len(row)} cells, its names are {len(names)}"
            raise SourceError(path, message, line=start + 1, column=1, hint=hint)
        has_counter = _COUNTER.fullmatch(names[0]) is not None
        kept, times, time_unit = _sorted_columns(names, row)
        of_outputs = kept[int(has_counter) :]
        outputs, unit_texts = _outputs(path, [names[index] for index in of_outputs], names_at)
        if below := _units_below(path, head, names_at, delimiter, of_outputs):
            unit_texts = tuple(below[index] for index in of_outputs)
            time_unit = time_unit if times is None else below[times] or time_unit
    if not outputs:
        raise SourceError(path, "there is no column of readings", line=start + 1)
    entries = _entries(head[:names_at], delimiter)
    text = "\n".join(head)
    return Header(text, start, delimiter, entries, outputs, has_counter, unit_texts, len(row), kept, times, time_unit)


def _find_start(path: Path, lines: Sequence[str], given: str | None) -> tuple[str, int]:
    """Return delimiter and index of the first row: readings, times of day, judgements, and empty cells at the end."""
    delimiters = (given,) if given else ("\t", ";", ",")
    for index, line in enumerate(lines):
        for delimiter in delimiters:
            cells = split_cells(line, delimiter)
            filled = cells[: max((k + 1 for k, cell in enumerate(cells) if cell), default=0)]
            others = [cell for cell in filled if not _is_reading(cell)]
            is_row = len(others) < len(filled) and all(CLOCK.fullmatch(c) or _JUDGEMENT.fullmatch(c) for c in others)
            if delimiter in line and is_row:
                return delimiter, index
        if _is_reading(line.strip().strip('"')):
            return delimiters[0 if line.startswith("\t") else -1], index
    text = f"found no row of readings in the first {len(lines)} lines"
    raise SourceError(path, text, line=1, hint="Expected rows of numbers or markers such as +FFFFFFF below the header.")


def _find_names(path: Path, head: Sequence[str], delimiter: str, n_columns: int) -> int | None:
    """Return the index of the names of the columns: OUT1, or a word over every column, the first a counter or time."""
    split = [split_cells(line, delimiter) for line in head]
    found = [index for index, cells in enumerate(split) if any(map(_OUTPUT.fullmatch, cells))]
    if len(found) > 1:
        text = f"the columns are named twice, before on line {found[0] + 1}"
        raise SourceError(path, text, line=found[1] + 1, hint="Two exports were joined: split the file.")
    filled = [index for index, line in enumerate(head) if line.strip()]
    if len(filled) > 1 and len(split[filled[-1]]) == n_columns and all(map(_is_unit, split[filled[-1]])):
        filled.pop()  # a row of units below the names
    last = filled[-1] if filled else None
    if not found and last is not None:
        cells = split[last]
        first = _LABEL.fullmatch(cells[0])
        is_first = _COUNTER.fullmatch(cells[0]) or (first is not None and _TIME.fullmatch(first[1]))
        if len(cells) == n_columns > 1 and is_first and all(re.match(r"[^\W\d_]|#", cell) for cell in cells):
            found = [last]
    # without names a damaged first row must not pass for a line of the header
    damaged = (i for i, cells in enumerate(split) if len(cells) == n_columns and re.match(r"[+-]?[0-9]", cells[0]))
    if not found and (index := next(damaged, None)) is not None:
        text = f"found {shorten(head[index])}, which is neither a row of readings nor a header line"
        raise SourceError(path, text, line=index + 1, column=1, hint="If it is a damaged row, export the file again.")
    return found[0] if found else None


def _sorted_columns(names: Sequence[str], row: Sequence[str]) -> tuple[tuple[int, ...], int | None, str]:
    """Sort the columns by their names, or without names by the cells of the first row: read, of times, its unit."""
    kept, times, time_unit = [], None, ""
    for index, cell in enumerate(row):
        name = _LABEL.fullmatch(names[index]) if names else None
        if times is None and (_TIME.fullmatch(name[1]) if name else CLOCK.fullmatch(cell)):
            times, time_unit = index, (name and name[2]) or ""
        elif (cell or (names and names[index])) and not (
            _WORDS.fullmatch(name[1] if name else "") or _JUDGEMENT.fullmatch(cell)
        ):
            kept.append(index)
    return tuple(kept), times, time_unit


def _outputs(path: Path, names: Sequence[str], names_at: int) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Return the numbers of the outputs, and their units where all are in the names."""
    if not any(map(_OUTPUT.fullmatch, names)):
        labels = [_LABEL.fullmatch(name) for name in names]
        texts = [(label and label[2]) or "" for label in labels]
        return tuple(range(1, len(names) + 1)), tuple(texts) if all(texts) else ()
    numbers, units = [], []
    for name in names:
        match = _OUTPUT.fullmatch(name)
        if match is None or int(match[1]) in numbers:
            text = f"found the column name {shorten(name)}, expected OUT1, OUT2, … each once"
            raise SourceError(path, text, line=names_at + 1, column=1)
        numbers.append(int(match[1]))
        units.append(match[2] or "")
    return tuple(numbers), tuple(units) if all(units) else ()


def _units_below(
    path: Path, head: Sequence[str], names_at: int, delimiter: str, of_outputs: Sequence[int]
) -> tuple[str, ...]:
    """Return the row of units under the names, whole; no other line may be there."""
    units: tuple[str, ...] = ()
    for index in range(names_at + 1, len(head)):
        cells = split_cells(head[index], delimiter)
        if not any(cells):
            continue
        texts = [cells[k] for k in of_outputs] if len(cells) > max(of_outputs, default=0) else []
        if units or not texts or not all(map(is_length_or_volts, texts)):
            wrong = next((i for i, cell in enumerate(cells) if not _is_reading(cell)), 0)
            raise SourceError(
                path,
                f"found {shorten(cells[wrong])}, expected the first row of readings",
                line=index + 1,
                column=column_of(head[index], delimiter, wrong),
                hint="A cell of the row is no number and no known marker; export the file again.",
            )
        units = tuple(cells)
    return units


def _entries(head: Sequence[str], delimiter: str) -> dict[str, tuple[int, tuple[str, ...], str]]:
    entries: dict[str, tuple[int, tuple[str, ...], str]] = {}
    for number, line in enumerate(head, 1):
        cells = split_cells(line, delimiter)
        if len(cells) == 1:
            cells = [part.strip() for part in re.split(r"\s*[:=]\s*", cells[0], maxsplit=1)]
        label = _LABEL.fullmatch(cells[0].lstrip("#%; ").rstrip(":= "))
        for meaning, pattern in LABELS.items():
            if label and re.fullmatch(pattern, label[1], re.IGNORECASE) and meaning not in entries:
                entries[meaning] = (number, tuple(cells[1:]), label[2] or "")
    return entries

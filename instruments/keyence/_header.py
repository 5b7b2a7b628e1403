"""The header of a Keyence storage file, driven by a profile; and where the readings begin.

No storage file of LK-Navigator is public, so the layout is assumed and the profile holds every
assumption. What the header does not say (sampling cycle, units) is asked for, never guessed.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from instruments.keyence._columns import Columns, is_aside, is_time, sort_columns
from instruments.keyence._markers import MARKERS, Marker, marker_status
from labpipe.errors import InputError, SourceError
from labpipe.numbers import shorten
from labpipe.units import unit

#: What the labels of header lines look like, by what they say. Compared as a whole, without case.
HEADER_LABELS: Mapping[str, str] = {
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

_COUNTER = re.compile(r"n[or°º]\.?|#|index|count(?:er)?|data no\.?|point|番号|序号", re.IGNORECASE)
_OUTPUT = re.compile(r"out ?0*([0-9]{1,2})\s*(?:[\[(]([^\])]*)[\])])?", re.IGNORECASE)
_LABEL_UNIT = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])](?:\s.*)?")
# A unit that lost a letter may be another unit ("mm" and "m"), so only displayed ones are taken.
_UNITS_ALLOWED = tuple(map(unit, ("mm", "um", "cm", "V", "mV", "mm/s", "m/s2", "km/s2")))


@dataclass(frozen=True, slots=True)
class KeyenceProfile:
    """What a storage file looks like, and what it does not say of itself.

    Attributes
    ----------
    encodings : tuple of str
        Codecs tried, in order, when there is no byte order mark and it is not UTF-8.
    delimiter, decimal : str, optional
        By default decided from the file.
    cycle : str, optional
        Time between samples, ``"50 us"``.
    storage_factor : int, optional
        Only every n-th sample is stored.
    units : tuple of str, optional
        Unit of every output, in order.
    rows : int, optional
        Number of stored points that the run should have.
    labels : mapping
        Patterns of header labels, see :data:`HEADER_LABELS`.
    markers : tuple of Marker
        Tokens that stand for "no reading".
    saturation : float
        Volts from which an analogue reading counts as saturated; the alarm voltage itself is not
        documented, ±10 V is the end of the controller's output.
    """

    encodings: tuple[str, ...] = ("cp932", "cp1252", "gbk")
    delimiter: str | None = None
    decimal: str | None = None
    cycle: str | float | None = None
    storage_factor: int | None = None
    units: tuple[str, ...] | None = None
    rows: int | None = None
    labels: Mapping[str, str] = field(default_factory=lambda: HEADER_LABELS)
    markers: tuple[Marker, ...] = MARKERS
    saturation: float = 10.0


@dataclass(frozen=True, slots=True)
class Header:
    """What stands above the readings.

    ``text``: the lines, unchanged; ``n_lines``: their number: the first reading stands on line ``n_lines + 1``;
    ``delimiter``; ``entries``: label's meaning to (line number, cells of its value, unit inside the label);
    ``outputs``: numbers of the outputs, in the order of their columns; ``has_counter``: whether the first column counts
    the points; ``unit_texts``: from the column names or a row below them, empty when there are none; ``columns``: which
    of its columns those are, and where the times stand.
    """

    text: str
    n_lines: int
    delimiter: str
    entries: Mapping[str, tuple[int, tuple[str, ...], str]]
    outputs: tuple[int, ...]
    has_counter: bool
    unit_texts: tuple[str, ...]
    columns: Columns


def is_length_or_volts(text: str) -> bool:
    """Tell whether a text is a unit that an output can have."""
    try:
        return bool(text) and unit(text) in _UNITS_ALLOWED
    except InputError:
        return False


def _is_unit(cell: str) -> bool:
    try:
        return bool(cell) and bool(unit(cell))
    except InputError:
        return False


def split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line and take quotes and blanks from its cells."""
    return [cell.strip().strip('"').strip() for cell in line.split(delimiter)]


def column_of(line: str, delimiter: str, index: int) -> int:
    """Return where a cell begins in its line, counted from 1.

    Examples
    --------
    >>> column_of("1,+00.1234", ",", 1)
    3
    """
    return len(delimiter.join(line.split(delimiter)[:index])) + (2 if index else 1)


def is_reading(cell: str, markers: tuple[Marker, ...]) -> bool:
    """Tell whether a cell is a number, with any decimal sign, or a marker."""
    looks_like_number = re.fullmatch(r"[+-]?[0-9][0-9.,]*(?:[eE][+-]?[0-9]+)?", cell) is not None
    return looks_like_number or marker_status(cell, markers) is not None


def parse_header(path: Path, lines: Sequence[str], profile: KeyenceProfile) -> Header:
    """Find the first row of readings and understand what stands above it.

    ``path``: named in errors; ``lines``: the beginning of the file; ``profile``: assumptions. Raises SourceError: there
    is no row of readings, or a line stands between the names of the columns and the first row, or the number of columns
    does not fit their names.
    """
    delimiter, start = _find_start(path, lines, profile)
    head = lines[:start]
    first_row = split_cells(lines[start], delimiter)
    n_columns = len(first_row)
    names_at = _find_names(path, head, delimiter, n_columns)
    names = split_cells(head[names_at], delimiter) if names_at is not None else []
    if names_at is None:
        _refuse_damaged_row(path, head, delimiter, n_columns)
        columns = sort_columns((), first_row)
        has_counter = _counts(lines[start : start + _COUNTED], delimiter, len(columns.kept))
        outputs = tuple(range(1, len(columns.kept) + 1 - has_counter))
        unit_texts: tuple[str, ...] = ()
    else:
        if len(names) != n_columns:
            raise SourceError(
                path,
                f"the first row has {n_columns} cells, its names are {len(names)}",
                line=start + 1,
                column=1,
                hint='If the comma is the decimal sign, the delimiter must be another: delimiter=";".',
            )
        has_counter = _COUNTER.fullmatch(names[0]) is not None
        columns = sort_columns(names, first_row)
        of_outputs = columns.kept[int(has_counter) :]
        outputs, unit_texts = _outputs(path, [names[index] for index in of_outputs], names_at)
        below = _units_below(path, head, names_at, delimiter, of_outputs, profile.markers)
        if below:
            unit_texts = tuple(below[index] for index in of_outputs)
        if below and columns.times is not None:
            columns = replace(columns, unit_text=below[columns.times] or columns.unit_text)
    if not outputs:
        raise SourceError(path, "there is no column of readings", line=start + 1)
    entries = _entries(head[:names_at], delimiter, profile)
    return Header("\n".join(head), start, delimiter, entries, outputs, has_counter, unit_texts, columns)


_COUNTED = 3  # rows that must count 1, 2, 3 before a column without a name is taken for a counter


def _find_start(path: Path, lines: Sequence[str], profile: KeyenceProfile) -> tuple[str, int]:
    delimiters = (profile.delimiter,) if profile.delimiter else ("\t", ";", ",")
    for index, line in enumerate(lines):
        for delimiter in delimiters:
            cells = split_cells(line, delimiter)
            if delimiter in line and _is_row(cells, profile.markers):
                return delimiter, index
        if is_reading(line.strip().strip('"'), profile.markers):
            return delimiters[0 if line.startswith("\t") else -1], index
    text = f"found no row of readings in the first {len(lines)} lines"
    raise SourceError(path, text, line=1, hint="Expected rows of numbers or markers such as +FFFFFFF below the header.")


def _is_row(cells: Sequence[str], markers: tuple[Marker, ...]) -> bool:
    """Tell whether cells are a row: readings, and beside them times of day, judgements, empty cells at the end."""
    filled = list(cells)
    while filled and not filled[-1]:
        filled.pop()
    readings = [is_reading(cell, markers) for cell in filled]
    return any(readings) and all(is_aside(c) for c, known in zip(filled, readings, strict=True) if not known)


def _find_names(path: Path, head: Sequence[str], delimiter: str, n_columns: int) -> int | None:
    found = [
        index
        for index, line in enumerate(head)
        if any(_OUTPUT.fullmatch(cell) for cell in split_cells(line, delimiter))
    ]
    if len(found) > 1:
        text = f"the columns are named twice, before on line {found[0] + 1}"
        raise SourceError(path, text, line=found[1] + 1, hint="Two exports were joined: split the file.")
    return found[0] if found else _other_names(head, delimiter, n_columns)


def _other_names(head: Sequence[str], delimiter: str, n_columns: int) -> int | None:
    """Find names that are not the controller's own: the last line, as wide as the rows, with a word in each cell."""
    filled = [index for index, line in enumerate(head) if line.strip()]
    last = filled[-1] if filled else None
    cells = split_cells(head[last], delimiter) if last is not None else []
    if len(filled) > 1 and len(cells) == n_columns and all(map(_is_unit, cells)):  # a row of units below the names
        last = filled[-2]
        cells = split_cells(head[last], delimiter)
    is_named = len(cells) == n_columns > 1 and all(re.match(r"[^\W\d_]|#", cell) for cell in cells)
    has_first = is_named and (_COUNTER.fullmatch(cells[0]) or is_time(cells[0]))
    return last if has_first else None


def _refuse_damaged_row(path: Path, head: Sequence[str], delimiter: str, n_columns: int) -> None:
    """Without names of columns a damaged first row must not pass for a line of the header."""
    for index, line in enumerate(head):
        cells = split_cells(line, delimiter)
        if len(cells) == n_columns and re.match(r"[+-]?[0-9]", cells[0]):
            text = f"found {shorten(line)}, which is neither a row of readings nor a header line"
            hint = "If it is a damaged row, export the file again."
            raise SourceError(path, text, line=index + 1, column=1, hint=hint)


def _counts(rows: Sequence[str], delimiter: str, n_columns: int) -> bool:
    """Tell whether the first column counts from 0 or 1, as a column without a name."""
    firsts = [split_cells(row, delimiter)[0] for row in rows]
    if n_columns == 1 or len(firsts) < _COUNTED or not all(cell.isdigit() for cell in firsts):
        return False
    numbers = [int(cell) for cell in firsts]
    return numbers[0] in (0, 1) and all(b - a == 1 for a, b in pairwise(numbers))


def _outputs(path: Path, names: Sequence[str], names_at: int) -> tuple[tuple[int, ...], tuple[str, ...]]:
    numbers, units = [], []
    if not any(map(_OUTPUT.fullmatch, names)):
        texts = [inner[2] if (inner := _LABEL_UNIT.fullmatch(name)) else "" for name in names]
        return tuple(range(1, len(names) + 1)), tuple(texts) if all(texts) else ()
    for name in names:
        match = _OUTPUT.fullmatch(name)
        if match is None or int(match[1]) in numbers:
            text = f"found the column name {shorten(name)}, expected OUT1, OUT2, … each once"
            raise SourceError(path, text, line=names_at + 1, column=1)
        numbers.append(int(match[1]))
        units.append(match[2] or "")
    return tuple(numbers), tuple(units) if all(units) else ()


def _units_below(
    path: Path,
    head: Sequence[str],
    names_at: int,
    delimiter: str,
    of_outputs: Sequence[int],
    markers: tuple[Marker, ...],
) -> tuple[str, ...]:
    """Return the row of units under the names, whole; nothing else may stand there."""
    units: tuple[str, ...] = ()
    for index in range(names_at + 1, len(head)):
        cells = split_cells(head[index], delimiter)
        if not any(cells):
            continue
        texts = [cells[k] for k in of_outputs] if len(cells) > max(of_outputs, default=0) else []
        if units or not texts or not all(map(is_length_or_volts, texts)):
            wrong = next((i for i, c in enumerate(cells) if not is_reading(c, markers)), 0)
            raise SourceError(
                path,
                f"found {shorten(cells[wrong])}, expected the first row of readings",
                line=index + 1,
                column=column_of(head[index], delimiter, wrong),
                hint="A cell of the row is no number and no known marker; export the file again.",
            )
        units = tuple(cells)
    return units


def _entries(
    head: Sequence[str], delimiter: str, profile: KeyenceProfile
) -> dict[str, tuple[int, tuple[str, ...], str]]:
    entries: dict[str, tuple[int, tuple[str, ...], str]] = {}
    for number, line in enumerate(head, 1):
        cells = split_cells(line, delimiter)
        if len(cells) == 1:
            cells = [part.strip() for part in re.split(r"\s*[:=]\s*", cells[0], maxsplit=1)]
        label, unit_text = cells[0].lstrip("#%; ").rstrip(":= "), ""
        inner = _LABEL_UNIT.fullmatch(label)
        if inner:
            label, unit_text = inner[1], inner[2]
        for meaning, pattern in profile.labels.items():
            if re.fullmatch(pattern, label, re.IGNORECASE) and meaning not in entries:
                entries[meaning] = (number, tuple(cells[1:]), unit_text)
    return entries

"""The header of a Keyence storage file, driven by a profile; and where the readings begin.

No storage file of LK-Navigator is public, so the layout is assumed and the profile holds every
assumption. What the header does not say (sampling cycle, units) is asked for, never guessed.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from itertools import pairwise
from pathlib import Path

from instruments.keyence_markers import MARKERS, Marker, marker_status
from labpipe.errors import InputError, SourceError
from labpipe.text import shorten
from labpipe.units import quantity, unit

#: What the labels of header lines look like, by what they say. Compared as a whole, without case.
HEADER_LABELS: Mapping[str, str] = {
    "model": r"model|controller",
    "serial": r"serial(?: (?:number|no\.?))?|s/n",
    "head": r"(?:sensor )?head",
    "date": r"date(?: and time)?|start(?: time)?",
    "clock": r"time",
    "cycle": r"sampling (?:cycle|period|interval|rate)|サンプリング周期",
    "storage": r"(?:storage|storing|save) (?:cycle|factor|interval)|ストレージ周期",
    "units": r"units?|単位",
    "averaging": r"averag(?:e|ing)(?: (?:count|number|times))?|number of averages",
    "rows": r"(?:number of )?(?:data|points|samples)(?: (?:count|points|number))?",
}

_COUNTER = re.compile(r"no\.?|#|index|count(?:er)?|data no\.?|番号", re.IGNORECASE)
_OUTPUT = re.compile(r"out ?0*([0-9]{1,2})\s*(?:[\[(]([^\])]*)[\])])?", re.IGNORECASE)
_LABEL_UNIT = re.compile(r"(.*?)\s*[\[(]([^\])]*)[\])]\s*")
_DATES = ("%Y/%m/%d", "%Y-%m-%d", "%d.%m.%Y")
_CLOCKS = ("", " %H:%M:%S", " %H:%M:%S.%f", "T%H:%M:%S", "T%H:%M:%S.%f", " %H:%M")
_UNITS_ALLOWED = ("m", "V", "m/s", "m/s2")


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

    encodings: tuple[str, ...] = ("cp932", "cp1252")
    delimiter: str | None = None
    decimal: str | None = None
    cycle: str | None = None
    storage_factor: int | None = None
    units: tuple[str, ...] | None = None
    rows: int | None = None
    labels: Mapping[str, str] = field(default_factory=lambda: HEADER_LABELS)
    markers: tuple[Marker, ...] = MARKERS
    saturation: float = 10.0


@dataclass(frozen=True, slots=True)
class Header:
    """What stands above the readings.

    Attributes
    ----------
    text : str
        The lines, unchanged.
    n_lines : int
        Their number: the first reading stands on line ``n_lines + 1``.
    delimiter : str
    entries : mapping
        Label's meaning to (line number, cells of its value, unit inside the label).
    outputs : tuple of int
        Numbers of the outputs, in the order of their columns.
    has_counter : bool
        Whether the first column counts the points.
    unit_texts : tuple of str
        From the column names or a row below them, empty when there are none.
    """

    text: str
    n_lines: int
    delimiter: str
    entries: Mapping[str, tuple[int, tuple[str, ...], str]]
    outputs: tuple[int, ...]
    has_counter: bool
    unit_texts: tuple[str, ...]


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

    Parameters
    ----------
    path : Path
        Named in errors.
    lines : sequence of str
        The beginning of the file.
    profile : KeyenceProfile
        Assumptions.

    Raises
    ------
    SourceError
        There is no row of readings, or a line stands between the names of the columns and the
        first row, or the number of columns does not fit their names.
    """
    delimiter, start = _find_start(path, lines, profile)
    head = lines[:start]
    n_columns = len(split_cells(lines[start], delimiter))
    names_at = _find_names(path, head, delimiter)
    names = split_cells(head[names_at], delimiter) if names_at is not None else []
    if names_at is None:
        _refuse_damaged_row(path, head, delimiter, n_columns)
        has_counter = _counts(lines[start : start + _COUNTED], delimiter, n_columns)
        outputs = tuple(range(1, n_columns + 1 - has_counter))
        unit_texts: tuple[str, ...] = ()
    else:
        if len(names) != n_columns:
            raise SourceError(
                path,
                f"the first row has {n_columns} cells, its names are {len(names)}",
                line=start + 1,
                column=1,
                hint="If the comma is the decimal sign, the delimiter must be another: "
                'delimiter=";".',
            )
        has_counter = _COUNTER.fullmatch(names[0]) is not None
        outputs, unit_texts = _outputs(path, names, names_at, has_counter)
        below = _units_below(path, head, names_at, delimiter, has_counter, profile.markers)
        unit_texts = below or unit_texts
    if not outputs:
        raise SourceError(path, "there is no column of readings", line=start + 1)
    entries = _entries(head[:names_at], delimiter, profile)
    return Header("\n".join(head), start, delimiter, entries, outputs, has_counter, unit_texts)


_COUNTED = 3  # rows that must count 1, 2, 3 before a column without a name is taken for a counter


def _find_start(path: Path, lines: Sequence[str], profile: KeyenceProfile) -> tuple[str, int]:
    delimiters = (profile.delimiter,) if profile.delimiter else ("\t", ";", ",")
    for index, line in enumerate(lines):
        for delimiter in delimiters:
            cells = split_cells(line, delimiter)
            has_delimiter = delimiter in line
            if has_delimiter and all(is_reading(cell, profile.markers) for cell in cells):
                return delimiter, index
        if is_reading(line.strip().strip('"'), profile.markers):
            return delimiters[-1], index
    raise SourceError(
        path,
        f"found no row of readings in the first {len(lines)} lines",
        line=1,
        hint="Expected rows of numbers or markers such as +FFFFFFF below the header.",
    )


def _find_names(path: Path, head: Sequence[str], delimiter: str) -> int | None:
    found = [
        index
        for index, line in enumerate(head)
        if any(_OUTPUT.fullmatch(cell) for cell in split_cells(line, delimiter))
    ]
    if len(found) > 1:
        raise SourceError(
            path,
            f"the columns are named twice, before on line {found[0] + 1}",
            line=found[1] + 1,
            hint="Two exports were joined: split the file.",
        )
    return found[0] if found else None


def _refuse_damaged_row(path: Path, head: Sequence[str], delimiter: str, n_columns: int) -> None:
    """Without names of columns a damaged first row must not pass for a line of the header."""
    for index, line in enumerate(head):
        cells = split_cells(line, delimiter)
        if len(cells) == n_columns and re.match(r"[+-]?[0-9]", cells[0]):
            raise SourceError(
                path,
                f"found {shorten(line)}, which is neither a row of readings nor a header line",
                line=index + 1,
                column=1,
                hint="If it is a damaged row, export the file again.",
            )


def _counts(rows: Sequence[str], delimiter: str, n_columns: int) -> bool:
    """Tell whether the first column counts from 0 or 1, as a column without a name."""
    firsts = [split_cells(row, delimiter)[0] for row in rows]
    if n_columns == 1 or len(firsts) < _COUNTED or not all(cell.isdigit() for cell in firsts):
        return False
    numbers = [int(cell) for cell in firsts]
    return numbers[0] in (0, 1) and all(b - a == 1 for a, b in pairwise(numbers))


def _outputs(
    path: Path, names: Sequence[str], names_at: int, has_counter: bool
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    numbers, units = [], []
    for index, name in enumerate(names):
        if index == 0 and has_counter:
            continue
        match = _OUTPUT.fullmatch(name)
        if match is None or int(match[1]) in numbers:
            raise SourceError(
                path,
                f"found the column name {shorten(name)}, expected OUT1, OUT2, … each once",
                line=names_at + 1,
                column=1,
            )
        numbers.append(int(match[1]))
        units.append(match[2] or "")
    return tuple(numbers), tuple(units) if all(units) else ()


def _units_below(
    path: Path,
    head: Sequence[str],
    names_at: int,
    delimiter: str,
    has_counter: bool,
    markers: tuple[Marker, ...],
) -> tuple[str, ...]:
    """Read a row of units under the names; nothing else may stand there."""
    units: tuple[str, ...] = ()
    for index in range(names_at + 1, len(head)):
        cells = split_cells(head[index], delimiter)
        texts = cells[1:] if has_counter else cells
        if not any(cells):
            continue
        if units or not texts or not all(map(_is_unit, texts)):
            wrong = next((i for i, c in enumerate(cells) if not is_reading(c, markers)), 0)
            raise SourceError(
                path,
                f"found {shorten(cells[wrong])}, expected the first row of readings",
                line=index + 1,
                column=column_of(head[index], delimiter, wrong),
                hint="A cell of the row is no number and no known marker; export the file again.",
            )
        units = tuple(texts)
    return units


def _is_unit(text: str) -> bool:
    try:
        return bool(text) and unit(text).si in _UNITS_ALLOWED
    except InputError:
        return False


def _entries(
    head: Sequence[str], delimiter: str, profile: KeyenceProfile
) -> dict[str, tuple[int, tuple[str, ...], str]]:
    entries: dict[str, tuple[int, tuple[str, ...], str]] = {}
    for number, line in enumerate(head, 1):
        cells = split_cells(line, delimiter)
        if len(cells) == 1:
            cells = [part.strip() for part in re.split(r"\s*[:=]\s*", cells[0], maxsplit=1)]
        label, unit_text = cells[0].rstrip(":= "), ""
        inner = _LABEL_UNIT.fullmatch(label)
        if inner:
            label, unit_text = inner[1], inner[2]
        for meaning, pattern in profile.labels.items():
            if re.fullmatch(pattern, label, re.IGNORECASE) and meaning not in entries:
                entries[meaning] = (number, tuple(cells[1:]), unit_text)
    return entries


def stated_units(path: Path, header: Header, given: Iterable[str] | None) -> tuple[str, ...]:
    """Return the unit of every output, from the file or from the caller.

    Raises
    ------
    SourceError
        There are none, they are not known, their number is not that of the outputs, or the
        caller contradicts the file.
    """
    line, cells, _ = header.entries.get("units", (None, (), ""))
    stated = tuple(cell for cell in cells if cell) or header.unit_texts
    asked = tuple(given) if given is not None else ()
    units = stated or asked
    if not units:
        raise SourceError(
            path,
            "the file does not say the unit of its readings",
            hint='Give one for every output, in order: units=["mm"].',
        )
    if len(units) != len(header.outputs):
        raise SourceError(
            path,
            f"found {len(units)} units for {len(header.outputs)} outputs",
            line=line,
            hint='Give one for every output, in order: units=["mm", "um"].',
        )
    for text in units:
        if not _is_unit(text):
            raise SourceError(
                path,
                f"found the unit {shorten(text)}, expected a length, volts or a derivative",
                line=line,
                hint="Units of Keyence outputs are mm, um, V, mm/s, m/s2, km/s2.",
            )
    if stated and asked and [unit(a) for a in asked] != [unit(s) for s in stated]:
        raise _contradiction(path, "units", line, ", ".join(stated), ", ".join(asked))
    return units


def _contradiction(
    path: Path, name: str, line: int | None, stated: object, given: object
) -> SourceError:
    return SourceError(
        path,
        f"the file says {stated}, the option {name} says {given}",
        line=line,
        hint=f"Leave the option {name} out, or correct it.",
    )


def stated_cycle(path: Path, header: Header, given: str | float | None) -> float:
    """Return the sampling cycle in s, from the file or from the caller.

    Raises
    ------
    SourceError
        Neither says it, it has no unit, or they contradict each other.
    """
    asked = None if given is None else _time(str(given) if isinstance(given, str) else f"{given} s")
    if given is not None and asked is None:
        message = f'cycle must be a time such as "50 us", found "{given}"'
        raise InputError(message)
    if "cycle" not in header.entries:
        if asked is None:
            raise SourceError(
                path,
                "the file does not say its sampling cycle",
                hint='Give it: cycle="50 us".',
            )
        return asked
    line, cells, unit_text = header.entries["cycle"]
    text = f"{' '.join(cells)} {unit_text}".strip()
    stated = _time(text)
    if stated is None:
        raise SourceError(
            path,
            f"found the sampling cycle {shorten(text)}, expected a time with its unit",
            line=line,
            hint='Correct the line; it should read for example "Sampling cycle,50us".',
        )
    if asked is not None and abs(asked - stated) > 1e-9 * stated:
        raise _contradiction(path, "cycle", line, f"{stated:g} s", f"{asked:g} s")
    return stated


def _time(text: str) -> float | None:
    """Read a time, or a rate as its inverse; None when it is neither or not positive."""
    try:
        found = quantity(text.replace(",", "."))
    except InputError:
        return None
    if found.value <= 0 or found.si not in ("s", "Hz"):
        return None
    return found.value if found.si == "s" else 1.0 / found.value


def stated_storage(
    path: Path, header: Header, given: int | None, cycle: float, *, is_cycle_given: bool
) -> int:
    """Return how many samples one stored point stands for.

    Raises
    ------
    SourceError
        The line is missing or not understood, or contradicts the caller.
    """
    if "storage" not in header.entries:
        if given is None and not is_cycle_given:
            raise SourceError(
                path,
                "the file does not say whether every sample was stored",
                hint="Give the factor between samples and stored points: storage_factor=1.",
            )
        return given or 1
    line, cells, unit_text = header.entries["storage"]
    text = " ".join(cells).strip()
    match = re.fullmatch(r"[x×*]?\s*([0-9]+)", text, re.IGNORECASE)
    interval = _time(f"{text} {unit_text}".strip())
    by_interval = interval / cycle if interval else 0.0
    factor = float(match[1]) if match and not unit_text else by_interval
    if factor < 1 or abs(factor - round(factor)) > 1e-6 * factor:
        raise SourceError(
            path,
            f"found the storage cycle {shorten(text)}, expected a whole factor such as x1",
            line=line,
            hint='Correct the line; it should read for example "Storage cycle,x10".',
        )
    if given is not None and given != round(factor):
        raise _contradiction(path, "storage_factor", line, round(factor), given)
    return round(factor)


def stated_count(path: Path, header: Header, meaning: str) -> int | None:
    """Return a whole number of the header (number of points, averaging), or None.

    Raises
    ------
    SourceError
        The line holds something else, or not the same number for every output.
    """
    if meaning not in header.entries:
        return None
    line, cells, _ = header.entries[meaning]
    found = {cell for cell in cells if cell}
    if len(found) != 1 or not re.fullmatch(r"[0-9]{1,12}", next(iter(found))):
        raise SourceError(
            path, f"found {shorten(','.join(cells))}, expected one whole number", line=line
        )
    return int(found.pop())


def stated_start(header: Header) -> str:
    """Return the ISO start, or "" when there is no date of a form that is not ambiguous."""
    date = " ".join(header.entries.get("date", (0, (), ""))[1]).strip()
    clock = " ".join(header.entries.get("clock", (0, (), ""))[1]).strip()
    for text in (f"{date} {clock}".strip(), date):
        for day in _DATES:
            for time in _CLOCKS:
                try:
                    return datetime.strptime(text, day + time).isoformat()
                except ValueError:
                    continue
    return ""

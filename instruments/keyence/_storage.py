"""Keyence laser displacement storage files, read.

No such file is public, so the layout is assumed (``layout = "assumed"`` in the result). A storage file carries no time:
time is the number of the point times the storage interval, from the first point.

::

    Model,LK-G5001
    Date,2024/05/14 10:22:31
    Sampling cycle,50us
    Storage cycle,x1
    Unit,mm,mm
    No.,OUT1,OUT2
    1,+00.1234,-00.0120
    2,+00.1236,-FFFFFFF
"""

import contextlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from instruments._clock import moment
from instruments.keyence._header import CLOCK, Header, is_length_or_volts, parse_header, split_cells
from instruments.keyence._markers import Status, layout, marker_status
from instruments.keyence._rows import Rows, read_rows
from instruments.keyence._writer import DEVICE, output_variables
from labpipe.errors import UNSAID, InputError, SourceError, warn_of
from labpipe.text import Limits, TextFile, check_decimal, shorten, survey
from labpipe.units import Quantity, quantity, unit
from labpipe.variables import variable

_CODECS = ("cp932", "cp1252", "gbk")  # tried in this order without a byte order mark where it is not UTF-8
_HEADER_LINES = 400  # above the first row of readings; a header is a few dozen lines at most
_SATURATION = 10.0  # V, the end of the controller's output; its alarm voltage is not documented
_SHORTEST, _LONGEST = 1e-7, 86400.0  # s; the time between samples of any sensor of this family


class _Given(NamedTuple):
    """Settings that the caller gives: cycle, storage factor, units, delimiter and decimal sign."""

    cycle: str | float | None
    storage_factor: int | None
    units: tuple[str, ...] | None
    delimiter: str | None
    decimal: str | None


def read(
    path: str | os.PathLike[str],
    *,
    cycle: str | float | Quantity | None = None,
    units: Sequence[str] | None = None,
    storage_factor: int | None = None,
    encoding: str | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
    limits: Limits | None = None,
) -> xr.Dataset:
    """Read a Keyence storage file.

    Parameters
    ----------
    path : path-like
        The file.
    cycle : str or float or Quantity, optional
        Time between samples, ``"50 us"`` or a number in s; needed when the file does not say it.
        Without any word on the storage factor it is the time between stored points.
    units : sequence of str, optional
        Unit of every output, in order; needed when the file does not say them.
    storage_factor : int, optional
        Samples per stored point; needed when the file says its cycle but not this.
    encoding, delimiter, decimal : str, optional
        By default decided from the file.
    allow_incomplete : bool
        Read a file that lacks rows: a cut last row is dropped, and where the counter jumps the
        time follows the counter; both give a warning. By default such a file is refused.
    limits : Limits, optional
        Size limits.

    Returns
    -------
    Dataset
        Over ``time`` [s], 0 at the first point: ``out1``, ``out2``, … [m, or V, m/s, m/s2],
        NaN without a reading, and ``status1``, … (:class:`Status`). Attributes:
        ``sampling_interval`` [s] between stored points, ``sampling_cycle`` [s],
        ``storage_factor``, ``averaging`` when stated, ``header``, ``start``, ``encoding``,
        ``layout``, ``status_counts`` (JSON).

    Raises
    ------
    SourceError
        With file, line and column of the fault, or with the option that is needed.

    Examples
    --------
    >>> readings = read("drop.csv", cycle="50 us", units=["mm"])  # doctest: +SKIP
    """
    check_decimal(decimal)
    if delimiter is not None and len(delimiter) != 1:
        raise InputError(f'delimiter must be one character, found "{delimiter}"')
    if storage_factor is not None and (not isinstance(storage_factor, int) or storage_factor < 1):
        raise InputError(f"storage_factor must be a whole number from 1, found {storage_factor!r}")
    given = _Given(
        f"{cycle.value!r} {cycle.si}" if isinstance(cycle, Quantity) else cycle,
        storage_factor,
        None if units is None else tuple(units),
        delimiter,
        decimal,
    )
    codecs = (encoding,) if encoding else _CODECS
    source, header, unit_texts, stream = _open(Path(path), given, codecs, limits or Limits())
    if header.times is not None:
        return _with_times(source.path, header, unit_texts, next(stream), given, allow_incomplete)
    lines = _complete_rows(source, stream, header, allow_incomplete)
    if len(header.kept) < header.n_cells:
        lines = header.readings(lines, source.path)
    rows = read_rows(source.path, header, lines, decimal)
    _check_rows(source, header, rows, allow_incomplete)
    sampling = _stated_cycle(source.path, header, given.cycle)
    is_given = given.cycle is not None
    factor = _stated_storage(source.path, header, storage_factor, sampling, is_cycle_given=is_given)
    return _assemble(source, header, unit_texts, rows, sampling, factor)


def _with_times(
    path: Path, header: Header, unit_texts: Sequence[str], row: str, given: _Given, allow_incomplete: bool
) -> xr.Dataset:
    """Read a table whose rows carry their times, as a recorder writes it: a trace of two named columns."""
    from instruments import tables

    place = header.times or 0
    is_of_day = CLOCK.fullmatch(split_cells(row, header.delimiter)[place]) is not None
    if is_of_day or len(header.outputs) != 1:
        text = f"the rows carry times of day, or times and {len(header.outputs)} outputs"
        hint = 'Name the columns that are wanted: columns = { time = "Time (s)", displacement = "OUT1 (mm)" }.'
        raise SourceError(path, text, line=header.n_lines + 1, hint=hint)
    cycle = None
    if given.cycle is not None or {"cycle", "storage"} <= header.entries.keys():
        stated = _stated_cycle(path, header, given.cycle)
        factor = _stated_storage(path, header, given.storage_factor, stated, is_cycle_given=True)
        cycle = Quantity(stated * factor, 0.0, "s")
    columns = {
        "time": {"column": place + 1, "unit": header.time_unit},
        "displacement": {"column": header.kept[-1] + 1, "unit": unit_texts[0]},
    }
    return tables.read(path, columns=columns, cycle=cycle, decimal=given.decimal, allow_incomplete=allow_incomplete)


def _open(
    path: Path, given: _Given, codecs: Sequence[str], limits: Limits
) -> tuple[TextFile, Header, tuple[str, ...], Iterator[str]]:
    """Settle the codec by the first one under which the header makes sense.

    cp932 decodes many cp1252 files without an error; but then "µm" is not a unit.
    """

    def understood(source: TextFile) -> tuple[TextFile, Header, tuple[str, ...], Iterator[str]]:
        stream = source.lines()
        head = list(islice(stream, _HEADER_LINES))
        header = parse_header(path, head, given.delimiter)
        return source, header, _stated_units(path, header, given.units), chain(head[header.n_lines :], stream)

    source = survey(path, declared=codecs, limits=limits)
    try:
        return understood(source)
    except SourceError:
        others = codecs[codecs.index(source.encoding) + 1 :] if source.encoding in codecs else ()
        for codec in others:
            with contextlib.suppress(SourceError):
                return understood(survey(path, declared=(codec,), limits=limits))
        raise


def _complete_rows(source: TextFile, stream: Iterator[str], header: Header, allow_incomplete: bool) -> Iterator[str]:
    """Pass the rows on; leave out blank lines at the end; refuse or drop a cut last line."""
    blank = 0
    for number, line in enumerate(stream, header.n_lines + 1):
        if not line.strip():
            blank = blank or number
            continue
        if blank:
            raise SourceError(source.path, "an empty line between two rows", line=blank, column=1)
        if number == source.n_lines and not source.is_ended and not _is_stated(source, header, line, number):
            message = f"the last line is cut, it has no line end: {shorten(line)}"
            if not allow_incomplete:
                hint = "Export the file again, or drop this row with allow_incomplete=True."
                raise SourceError(source.path, message, line=number, column=len(line) + 1, hint=hint)
            warn_of(source.path, f"{message}; it is dropped", line=number)
            return
        yield line


def _is_stated(source: TextFile, header: Header, line: str, number: int) -> bool:
    """Return whether a last line without line end is the last row stated, with a number as long as those above."""
    if number - header.n_lines != _stated_count(source.path, header, "rows"):
        return False
    lines = [*islice(source.lines(), max(header.n_lines, number - 200), number - 1), line]
    *above, last = (text.rsplit(header.delimiter, maxsplit=1)[-1].strip('" ') for text in lines)
    found = layout(last)
    decimals = {each.decimals for each in map(layout, above) if each is not None}
    return marker_status(last) is not None or (found is not None and {found.decimals} == decimals - {0})


def _check_rows(source: TextFile, header: Header, rows: Rows, allow_incomplete: bool) -> None:
    """Refuse a file with fewer or more rows than its header states, or in which the counter jumps."""
    path, first_line = source.path, header.n_lines + 1
    found, expected = len(rows.values), _stated_count(path, header, "rows")
    if not found:
        raise SourceError(path, "there are no rows of readings", line=first_line)
    if expected not in (None, found):
        message = f"found {found} rows, the header states {expected}"
        if not allow_incomplete:
            hint = "The recording or the copy stopped early, or rows were added; export it "
            hint += "again, or read the rows that are there with allow_incomplete=True."
            raise SourceError(path, message, line=first_line + found - 1, column=1, hint=hint)
        warn_of(path, message)
    counter = rows.counter
    steps = np.empty(0) if counter is None else np.diff(counter)
    wrong = np.flatnonzero(steps != 1)
    if counter is None or (not wrong.size and counter[0] in (0, 1)):
        return
    if allow_incomplete and (steps > 0).all():
        missing = int(counter[-1] - counter[0]) + 1 - len(counter)
        warn_of(path, f"{missing} rows are missing between, the time follows the counter")
        return
    back = np.flatnonzero(steps <= 0)
    row = int(back[0] if back.size else wrong[0]) + 1 if wrong.size else 0
    before = int(counter[row - 1]) if row else 0
    said = f"{counter[row]} after {before}" if row else f"{counter[0]} at the beginning"
    hint = (
        "The rows are in reverse order, from the last reading to the first: sort them by their number."
        if (steps == -1).all()
        else "Rows are missing, repeated or moved: export the file again. Where rows are only "
        "missing, allow_incomplete=True reads the rest at its right times."
    )
    text = f"the counter says {said}, expected {before + 1}"
    raise SourceError(path, text, line=first_line + row, column=1, hint=hint)


def _assemble(
    source: TextFile, header: Header, unit_texts: Sequence[str], rows: Rows, cycle: float, factor: int
) -> xr.Dataset:
    index = np.arange(len(rows.values)) if rows.counter is None else rows.counter - rows.counter[0]
    variables: dict[str, Any] = {}
    for column, (output, text) in enumerate(zip(header.outputs, unit_texts, strict=True)):
        values, status = rows.values[:, column], rows.status[:, column]
        if unit(text).si == "V":
            is_saturated = np.abs(values * unit(text).factor) >= _SATURATION
            values = np.where(is_saturated, np.nan, values)
            status = np.where(is_saturated, np.int8(Status.SUSPECT), status)
        variables |= output_variables(output, text, values, status, rows.layouts[column])
    entries: Mapping[str, tuple[int, tuple[str, ...], str]] = header.entries
    named = {n: " ".join(entries[n][1]).strip() for n in ("model", "serial", "head") if n in entries}
    averaging = _stated_count(source.path, header, "averaging")
    date, clock = (" ".join(entries.get(name, (0, (), ""))[1]).strip() for name in ("date", "clock"))
    start = moment(f"{date} {clock}".strip()) or moment(date)  # None in a form that is ambiguous
    states = {name: np.bincount(column[1]) for name, column in variables.items() if name.startswith("status")}
    counts = {name: {Status(k).name: int(n) for k, n in enumerate(found) if n} for name, found in states.items()}
    attrs = {
        "instrument": DEVICE,
        **named,
        "source": source.path.name,
        "layout": "assumed",
        "start": "" if start is None else start.isoformat(),
        "clock": "none: a counter of samples",
        "sampling_cycle": cycle,
        "storage_factor": factor,
        "sampling_interval": cycle * factor,
        **({"averaging": averaging} if averaging is not None else {}),
        "rows_stated": int("rows" in entries),
        "header": header.text,
        "encoding": source.encoding,
        "delimiter": header.delimiter,
        "decimal": rows.signs.decimal,
        "work": json.dumps({"bytes_read": source.size, "rows_read": len(rows.values)}),
        "status_counts": json.dumps(counts),
    }
    coords = {"time": variable("time", index * (cycle * factor), "s", "time from the first point")}
    return xr.Dataset(variables, coords=coords, attrs=attrs)


def _contradiction(path: Path, name: str, line: int | None, stated: object, given: object) -> SourceError:
    text = f"the file says {stated}, the option {name} says {given}"
    return SourceError(path, text, line=line, hint=f"Leave the option {name} out, or correct it.")


def _stated_units(path: Path, header: Header, given: tuple[str, ...] | None) -> tuple[str, ...]:
    """Return the unit of every output; SourceError without one, an unknown one, or where file and caller differ."""
    line, cells, _ = header.entries.get("units", (None, (), ""))
    stated, asked = tuple(cell for cell in cells if cell) or header.unit_texts, given or ()
    units = stated or asked
    if len(units) != len(header.outputs):
        text = f"found {len(units)} units for {len(header.outputs)} outputs"
        text = text if units else "the file does not say the unit of its readings"
        hint = 'Give one for every output, in order: units=["mm"].'
        raise SourceError(path, text, line=line, hint=hint).because(UNSAID)
    for text in units:
        if not is_length_or_volts(text):
            message = f"found the unit {shorten(text)}, expected a length, volts or a derivative"
            hint = "Units of Keyence outputs are mm, um, cm, V, mm/s, m/s2, km/s2."
            raise SourceError(path, message, line=line, hint=hint)
    if stated and asked and [unit(a) for a in asked] != [unit(s) for s in stated]:
        raise _contradiction(path, "units", line, ", ".join(stated), ", ".join(asked))
    return units


def _stated_cycle(path: Path, header: Header, given: str | float | None) -> float:
    """Return the sampling cycle in s; SourceError without one, without its unit, or where file and caller differ."""
    asked = None if given is None else _time(str(given) if isinstance(given, str) else f"{given} s")
    if given is not None and asked is None:
        raise InputError(f'cycle must be a time such as "50 us", found "{given}"')
    if "cycle" not in header.entries:
        if asked is None:
            message = "the file does not say its sampling cycle"
            raise SourceError(path, message, hint='Give it: cycle="50 us".').because(UNSAID)
        return asked
    line, cells, unit_text = header.entries["cycle"]
    text = f"{' '.join(cells)} {unit_text}".strip()
    stated = _time(text)
    if stated is None:
        message = f"found the sampling cycle {shorten(text)}, expected a time with its unit"
        raise SourceError(path, message, line=line, hint='The line should read for example "Sampling cycle,50us".')
    if asked is not None and abs(asked - stated) > 1e-9 * stated:
        raise _contradiction(path, "cycle", line, f"{stated:g} s", f"{asked:g} s")
    return stated


def _time(text: str) -> float | None:
    """Read a time, or a rate as its inverse; None when it is neither, or cannot be meant."""
    try:
        found = quantity(text.replace(",", "."))
    except InputError:
        return None
    if found.value <= 0 or found.si not in ("s", "Hz"):
        return None
    seconds = found.value if found.si == "s" else 1.0 / found.value
    return seconds if _SHORTEST <= seconds <= _LONGEST else None


def _stated_storage(path: Path, header: Header, given: int | None, cycle: float, *, is_cycle_given: bool) -> int:
    """Return the samples per stored point; SourceError without them, or where file and caller differ."""
    if "storage" not in header.entries:
        if given is None and not is_cycle_given:
            hint = "Give the factor between samples and stored points: storage_factor=1."
            raise SourceError(path, "the file does not say whether every sample was stored", hint=hint).because(UNSAID)
        return given or 1
    line, cells, unit_text = header.entries["storage"]
    text = " ".join(cells).strip()
    match = re.fullmatch(r"(?:[x×*]|1/)?\s*([0-9]{1,9})\s*(?:times|回|倍)?", text, re.IGNORECASE)
    factor = float(match[1]) if match and not unit_text else (_time(f"{text} {unit_text}".strip()) or 0.0) / cycle
    if not 1 <= factor <= 1e9 or abs(factor - round(factor)) > 1e-6 * factor:
        message = f"found the storage cycle {shorten(text)}, expected a whole factor such as x1"
        raise SourceError(path, message, line=line, hint='The line should read for example "Storage cycle,x10".')
    if given is not None and given != round(factor):
        raise _contradiction(path, "storage_factor", line, round(factor), given)
    return round(factor)


def _stated_count(path: Path, header: Header, meaning: str) -> int | None:
    """Return a whole number of the header (number of points, averaging), or None; SourceError for any other cell."""
    if meaning not in header.entries:
        return None
    line, cells, _ = header.entries[meaning]
    found = {cell for cell in cells if cell}
    if len(found) != 1 or not re.fullmatch(r"[0-9]{1,12}", next(iter(found))):
        raise SourceError(path, f"found {shorten(','.join(cells))}, expected one whole number", line=line)
    return int(found.pop())

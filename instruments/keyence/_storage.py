"""Keyence laser displacement storage files, read and written.

No such file is public: the layout (``layout = "assumed"`` in the result) is a
:class:`KeyenceProfile`, and what a file does not say is asked for, never guessed. A storage file
carries no time: time is the number of the point times the storage interval, from the first point.

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
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments.keyence._columns import only_readings
from instruments.keyence._header import Header, KeyenceProfile, parse_header
from instruments.keyence._markers import Status, layout, marker_status
from instruments.keyence._rows import Rows, read_rows
from instruments.keyence._statements import (
    interval_of_times,
    stated_count,
    stated_cycle,
    stated_start,
    stated_storage,
    stated_units,
)
from instruments.keyence._writer import DEVICE, output_variables
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.text import Limits, TextFile, check_decimal, shorten, survey
from labpipe.units import Quantity, unit
from labpipe.variables import variable

_HEADER_LINES = 400  # above the first row of readings; a header is a few dozen lines at most


def read(
    path: str | os.PathLike[str],
    *,
    cycle: str | float | Quantity | None = None,
    units: Sequence[str] | None = None,
    storage_factor: int | None = None,
    rows: int | None = None,
    encoding: str | None = None,
    delimiter: str | None = None,
    decimal: str | None = None,
    profile: KeyenceProfile | None = None,
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
    rows : int, optional
        Number of points that the run should have; the file is refused when it has another.
    encoding, delimiter, decimal : str, optional
        By default decided from the file.
    profile : KeyenceProfile, optional
        The same and more, for a whole laboratory; the options above go before it.
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
        With file, line and column of what is wrong, or with the option that is needed.

    Examples
    --------
    >>> readings = read("drop.csv", cycle="50 us", units=["mm"])  # doctest: +SKIP
    """
    profile = _merge(
        profile or KeyenceProfile(),
        cycle=f"{cycle.value!r} {cycle.si}" if isinstance(cycle, Quantity) else cycle,
        units=tuple(units) if units is not None else None,
        storage_factor=storage_factor,
        rows=rows,
        encodings=(encoding,) if encoding else None,
        delimiter=delimiter,
        decimal=decimal,
    )
    source, header, unit_texts, stream = _open(Path(path), profile, limits or Limits())
    lines = _complete_rows(source, stream, header, profile, allow_incomplete)
    times: list[str] = []
    first_line = header.n_lines + 1
    if not header.columns.all_kept:
        lines = only_readings(lines, header.columns, header.delimiter, times, path=source.path, first_line=first_line)
    readings = read_rows(source.path, header, lines, profile)
    _check_count(source, header, readings, profile, allow_incomplete)
    _check_counter(source, header, readings, allow_incomplete)
    return _assemble(source, header, unit_texts, readings, times, profile)


def _merge(profile: KeyenceProfile, **options: Any) -> KeyenceProfile:
    given = {name: value for name, value in options.items() if value is not None}
    check_decimal(given.get("decimal"))
    if len(given.get("delimiter", ",")) != 1:
        raise InputError(f'delimiter must be one character, found "{given["delimiter"]}"')
    factor = given.get("storage_factor", 1)
    if not isinstance(factor, int) or factor < 1:
        raise InputError(f"storage_factor must be a whole number from 1, found {factor!r}")
    return replace(profile, **given)


def _open(
    path: Path, profile: KeyenceProfile, limits: Limits
) -> tuple[TextFile, Header, tuple[str, ...], Iterator[str]]:
    """Settle the codec by the first one under which the header makes sense.

    cp932 decodes many cp1252 files without an error; but then "µm" is not a unit.
    """
    source = survey(path, declared=profile.encodings, limits=limits)
    try:
        return source, *_understand(source, profile)
    except SourceError:
        if source.encoding not in profile.encodings:
            raise  # a mark or UTF-8 settled the codec, so the mistake lies elsewhere
        for codec in profile.encodings[profile.encodings.index(source.encoding) + 1 :]:
            with contextlib.suppress(SourceError):
                other = survey(path, declared=(codec,), limits=limits)
                return other, *_understand(other, profile)
        raise


def _understand(source: TextFile, profile: KeyenceProfile) -> tuple[Header, tuple[str, ...], Iterator[str]]:
    stream = source.lines()
    head = list(islice(stream, _HEADER_LINES))
    header = parse_header(source.path, head, profile)
    texts = stated_units(source.path, header, profile.units)
    return header, texts, chain(head[header.n_lines :], stream)


def _complete_rows(
    source: TextFile, stream: Iterator[str], header: Header, profile: KeyenceProfile, allow_incomplete: bool
) -> Iterator[str]:
    """Pass the rows on; leave blank lines at the end out; refuse or drop a cut last line."""
    number = header.n_lines
    blank = 0
    for line in stream:
        number += 1
        if line[:1] not in _OF_A_ROW:  # most lines begin with a digit
            if not line.strip():
                blank += 1
                continue
            # what stands below the rows begins: the word END, or words after an empty line
            if _END.fullmatch(line.strip(' "\t;,')) is not None or (blank > 0 and _LETTER.match(line) is not None):
                _refuse_rows_below(source, stream, number)
                return
        if blank:
            raise SourceError(source.path, "an empty line between two rows", line=number - blank, column=1)
        is_last = number == source.n_lines and not source.is_ended
        if not is_last or _is_stated(source, header, line, number, profile):
            yield line
            continue
        message = f"the last line is cut, it has no line end: {shorten(line)}"
        if not allow_incomplete:
            hint = "Export the file again, or drop this row with allow_incomplete=True."
            raise SourceError(source.path, message, line=number, column=len(line) + 1, hint=hint)
        warn_of(source.path, f"{message}; it is dropped", line=number)


_END = re.compile(r"\[?/?(?:end|eof)(?: of (?:file|data))?\]?", re.IGNORECASE)
_OF_A_ROW = frozenset("0123456789+-")
_LETTER = re.compile(r"\"?[^\W\d_]")


def _refuse_rows_below(source: TextFile, stream: Iterator[str], number: int) -> None:
    """Maxima, means and the like may follow the rows; rows may not."""
    for below, line in enumerate(stream, number + 1):
        if line.strip() and not _LETTER.match(line):
            text = f"found {shorten(line)} below the end of the rows on line {number}"
            raise SourceError(source.path, text, line=below, column=1, hint="Two exports were joined: split the file.")


_ABOVE = 200  # rows with which the last one is compared


def _is_stated(source: TextFile, header: Header, line: str, number: int, profile: KeyenceProfile) -> bool:
    """Tell whether a last line without line end is complete: its row is the last one stated.

    Its last cell must also end like those above: a number that lost digits still reads as one.
    """
    stated = stated_count(source.path, header, "rows")
    if stated is None or number - header.n_lines != stated:
        return False
    last = line.rsplit(header.delimiter, maxsplit=1)[-1].strip('" ')
    if marker_status(last, profile.markers) is not None:
        return True
    above = islice(source.lines(), max(header.n_lines, number - 1 - _ABOVE), number - 1)
    written = {layout(text.split(header.delimiter)[-1].strip('" ')) for text in above} - {None}
    decimals = {each.decimals for each in written if each}
    found = layout(last)
    return found is not None and found.decimals > 0 and decimals == {found.decimals}


def _check_count(source: TextFile, header: Header, readings: Rows, profile: KeyenceProfile, allow: bool) -> None:
    found = len(readings.values)
    if not found:
        raise SourceError(source.path, "there are no rows of readings", line=header.n_lines + 1)
    stated = stated_count(source.path, header, "rows")
    for expected, who in ((stated, "the header states"), (profile.rows, "the option rows says")):
        if expected is None or expected == found:
            continue
        message = f"found {found} rows, {who} {expected}"
        if not allow:
            hint = "The recording or the copy stopped early, or rows were added; export it "
            hint += "again, or read what there is with allow_incomplete=True."
            raise SourceError(source.path, message, line=header.n_lines + found, column=1, hint=hint)
        warn_of(source.path, message)


def _check_counter(source: TextFile, header: Header, readings: Rows, allow: bool) -> None:
    counter = readings.counter
    if counter is None:
        return
    steps = np.diff(counter)
    wrong = np.flatnonzero(steps <= 0)
    if not wrong.size:
        wrong = np.flatnonzero(steps != 1)
        if not wrong.size and counter[0] not in (0, 1):
            wrong = np.array([-1])
        if wrong.size and allow:
            missing = int(counter[-1] - counter[0]) + 1 - len(counter)
            message = f"{missing} rows are missing between, the time follows the counter"
            warn_of(source.path, message)
            return
    if not wrong.size:
        return
    row = int(wrong[0]) + 1
    before = int(counter[row - 1]) if row else None
    found = f"{counter[row]} after {before}" if row else f"{counter[0]} at the beginning"
    hint = (
        "The rows stand in reverse order, from the last reading to the first: sort them by their number."
        if (steps == -1).all()
        else "Rows are missing, repeated or moved: export the file again. Where rows are only "
        "missing, allow_incomplete=True reads the rest at its right times."
    )
    text = f"the counter says {found}, expected {before + 1 if before is not None else 1}"
    raise SourceError(source.path, text, line=header.n_lines + 1 + row, column=1, hint=hint)


def _assemble(
    source: TextFile,
    header: Header,
    unit_texts: Sequence[str],
    readings: Rows,
    times: Sequence[str],
    profile: KeyenceProfile,
) -> xr.Dataset:
    path = source.path
    if len(times) > 1:
        cycle, factor = interval_of_times(path, header, times, profile)
    else:
        cycle = stated_cycle(path, header, profile.cycle)
        factor = stated_storage(path, header, profile.storage_factor, cycle, is_cycle_given=profile.cycle is not None)
    index = np.arange(len(readings.values)) if readings.counter is None else readings.counter - readings.counter[0]
    time = index * (cycle * factor)
    variables: dict[str, Any] = {}
    for column, (output, text) in enumerate(zip(header.outputs, unit_texts, strict=True)):
        values, status = readings.values[:, column], readings.status[:, column]
        if unit(text).si == "V":
            is_saturated = np.abs(values * unit(text).factor) >= profile.saturation
            values = np.where(is_saturated, np.nan, values)
            status = np.where(is_saturated, np.int8(Status.SUSPECT), status)
        variables |= output_variables(output, text, values, status, readings.layouts[column])
    attrs = _attributes(source, header, readings, cycle, factor, profile)
    attrs["status_counts"] = json.dumps(_status_counts(variables))
    coords = {"time": variable("time", time, "s", "time from the first point")}
    return xr.Dataset(variables, coords=coords, attrs=attrs)


def _status_counts(variables: Mapping[str, Any]) -> dict[str, dict[str, int]]:
    counts = {}
    for name, column in variables.items():
        if name.startswith("status"):
            found = np.bincount(column[1], minlength=len(Status))
            counts[name] = {state.name: int(found[state]) for state in Status if found[state]}
    return counts


def _attributes(
    source: TextFile, header: Header, readings: Rows, cycle: float, factor: int, profile: KeyenceProfile
) -> dict[str, Any]:
    averaging = stated_count(source.path, header, "averaging")
    stated = stated_count(source.path, header, "rows")
    named = {
        meaning: " ".join(header.entries[meaning][1]).strip()
        for meaning in ("model", "serial", "head")
        if meaning in header.entries
    }
    work = {"bytes_read": source.size, "rows_read": len(readings.values)}
    return {
        "instrument": DEVICE,
        **named,
        "source": source.path.name,
        "layout": "assumed",
        "start": stated_start(header),
        "clock": "none: a counter of samples" if header.columns.times is None else "times of the rows",
        "sampling_cycle": cycle,
        "storage_factor": factor,
        "sampling_interval": cycle * factor,
        **({"averaging": averaging} if averaging is not None else {}),
        "rows_stated": int(stated is not None or profile.rows is not None),
        "header": header.text,
        "encoding": source.encoding,
        "delimiter": header.delimiter,
        "decimal": readings.signs.decimal,
        "work": json.dumps(work),
    }

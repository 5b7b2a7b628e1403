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
from typing import Any

import numpy as np
import xarray as xr

from instruments.keyence._header import Header, parse_header
from instruments.keyence._markers import Status, layout, marker_status
from instruments.keyence._rows import Rows, read_rows
from instruments.keyence._statements import (
    Options,
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

_CODECS = ("cp932", "cp1252", "gbk")  # tried in this order without a byte order mark where it is not UTF-8
_HEADER_LINES = 400  # above the first row of readings; a header is a few dozen lines at most
_SATURATION = 10.0  # V, the end of the controller's output; its alarm voltage is not documented
_END = re.compile(r"\[?/?(?:end|eof)(?: of (?:file|data))?\]?", re.IGNORECASE)
_OF_A_ROW = frozenset("0123456789+-")
_LETTER = re.compile(r"\"?[^\W\d_]")


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
        With file, line and column of what is wrong, or with the option that is needed.

    Examples
    --------
    >>> readings = read("drop.csv", cycle="50 us", units=["mm"])  # doctest: +SKIP
    """
    check_decimal(decimal)
    if delimiter is not None and len(delimiter) != 1:
        raise InputError(f'delimiter must be one character, found "{delimiter}"')
    if storage_factor is not None and (not isinstance(storage_factor, int) or storage_factor < 1):
        raise InputError(f"storage_factor must be a whole number from 1, found {storage_factor!r}")
    given = Options(
        f"{cycle.value!r} {cycle.si}" if isinstance(cycle, Quantity) else cycle,
        storage_factor,
        None if units is None else tuple(units),
        delimiter,
        decimal,
    )
    codecs = (encoding,) if encoding else _CODECS
    source, header, unit_texts, stream = _open(Path(path), given, codecs, limits or Limits())
    lines, times = _complete_rows(source, stream, header, allow_incomplete), list[str]()
    if len(header.kept) < header.n_cells:
        lines = header.readings(lines, times, source.path)
    rows = read_rows(source.path, header, lines, decimal)
    _check_count(source, header, rows, allow_incomplete)
    _check_counter(source, header, rows, allow_incomplete)
    if len(times) > 1:
        sampling, factor = interval_of_times(source.path, header, times, given)
    else:
        sampling = stated_cycle(source.path, header, given.cycle)
        is_given = given.cycle is not None
        factor = stated_storage(source.path, header, storage_factor, sampling, is_cycle_given=is_given)
    return _assemble(source, header, unit_texts, rows, sampling, factor)


def _open(
    path: Path, given: Options, codecs: Sequence[str], limits: Limits
) -> tuple[TextFile, Header, tuple[str, ...], Iterator[str]]:
    """Settle the codec by the first one under which the header makes sense.

    cp932 decodes many cp1252 files without an error; but then "µm" is not a unit.
    """

    def understood(source: TextFile) -> tuple[TextFile, Header, tuple[str, ...], Iterator[str]]:
        stream = source.lines()
        head = list(islice(stream, _HEADER_LINES))
        header = parse_header(path, head, given.delimiter)
        return source, header, stated_units(path, header, given.units), chain(head[header.n_lines :], stream)

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
    """Pass the rows on; leave out blank lines and statistics at the end; refuse or drop a cut last line."""
    number = header.n_lines
    blank = 0
    for line in stream:
        number += 1
        if line[:1] in _OF_A_ROW and not blank and number < source.n_lines:  # nearly all lines
            yield line
            continue
        if not line.strip():
            blank += 1
            continue
        if _END.fullmatch(line.strip(' "\t;,')) is not None or (blank > 0 and _LETTER.match(line) is not None):
            for below, other in enumerate(stream, number + 1):  # maxima and means may follow; rows may not
                if other.strip() and not _LETTER.match(other):
                    text = f"found {shorten(other)} below the end of the rows on line {number}"
                    hint = "Two exports were joined: split the file."
                    raise SourceError(source.path, text, line=below, column=1, hint=hint)
            return
        if blank:
            raise SourceError(source.path, "an empty line between two rows", line=number - blank, column=1)
        if number == source.n_lines and not source.is_ended and not _is_stated(source, header, line, number):
            message = f"the last line is cut, it has no line end: {shorten(line)}"
            if not allow_incomplete:
                hint = "Export the file again, or drop this row with allow_incomplete=True."
                raise SourceError(source.path, message, line=number, column=len(line) + 1, hint=hint)
            warn_of(source.path, f"{message}; it is dropped", line=number)
            return
        yield line


def _is_stated(source: TextFile, header: Header, line: str, number: int) -> bool:
    """Whether a last line without line end is the last row stated, and its number is as long as those above."""
    if number - header.n_lines != stated_count(source.path, header, "rows"):
        return False
    lines = [*islice(source.lines(), max(header.n_lines, number - 200), number - 1), line]
    *above, last = (text.rsplit(header.delimiter, maxsplit=1)[-1].strip('" ') for text in lines)
    found = layout(last)
    decimals = {each.decimals for each in map(layout, above) if each is not None}
    return marker_status(last) is not None or (found is not None and {found.decimals} == decimals - {0})


def _check_count(source: TextFile, header: Header, rows: Rows, allow_incomplete: bool) -> None:
    found, expected = len(rows.values), stated_count(source.path, header, "rows")
    if not found:
        raise SourceError(source.path, "there are no rows of readings", line=header.n_lines + 1)
    if expected in (None, found):
        return
    message = f"found {found} rows, the header states {expected}"
    if not allow_incomplete:
        hint = "The recording or the copy stopped early, or rows were added; export it "
        hint += "again, or read what there is with allow_incomplete=True."
        raise SourceError(source.path, message, line=header.n_lines + found, column=1, hint=hint)
    warn_of(source.path, message)


def _check_counter(source: TextFile, header: Header, rows: Rows, allow_incomplete: bool) -> None:
    counter = rows.counter
    if counter is None:
        return
    steps = np.diff(counter)
    wrong = np.flatnonzero(steps != 1)
    if not wrong.size and counter[0] in (0, 1):
        return
    if allow_incomplete and (steps > 0).all():
        missing = int(counter[-1] - counter[0]) + 1 - len(counter)
        warn_of(source.path, f"{missing} rows are missing between, the time follows the counter")
        return
    back = np.flatnonzero(steps <= 0)
    row = int(back[0] if back.size else wrong[0]) + 1 if wrong.size else 0
    before = int(counter[row - 1]) if row else 0
    found = f"{counter[row]} after {before}" if row else f"{counter[0]} at the beginning"
    hint = (
        "The rows are in reverse order, from the last reading to the first: sort them by their number."
        if (steps == -1).all()
        else "Rows are missing, repeated or moved: export the file again. Where rows are only "
        "missing, allow_incomplete=True reads the rest at its right times."
    )
    text = f"the counter says {found}, expected {before + 1}"
    raise SourceError(source.path, text, line=header.n_lines + 1 + row, column=1, hint=hint)


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
    averaging = stated_count(source.path, header, "averaging")
    states = {name: np.bincount(column[1]) for name, column in variables.items() if name.startswith("status")}
    counts = {name: {Status(k).name: int(n) for k, n in enumerate(found) if n} for name, found in states.items()}
    attrs = {
        "instrument": DEVICE,
        **named,
        "source": source.path.name,
        "layout": "assumed",
        "start": stated_start(header),
        "clock": "none: a counter of samples" if header.times is None else "times of the rows",
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

"""Keyence laser displacement storage files, read.

No such file is public, so the layout is assumed. A storage file carries no time: time is the number of the point times
the storage interval, from the first point.

::

    Model,LK-G5001
    Date,2024/05/14 10:22:31
    Sampling cycle,50us
    Storage cycle,x1
    Unit,mm,mm
    No.,OUT1,OUT2
    1,+00.1234,-00.0120
    2,+00.1236,-FFFFFFF

Rows are parsed in batches by numpy; one that holds a marker, a number that may be one, or a fault, cell by cell.
"""

import contextlib
import json
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments._clock import moment
from instruments._instrument import HEAD_LINES
from instruments._quantities import unit_of
from instruments.keyence._header import CLOCK, Header, column_of, parse_header, split_cells
from instruments.keyence._markers import NUMERIC_MARKER, Layout, Status, layout, marker_status
from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError, warn_of
from labpipe.text import (
    DOT,
    Separators,
    TextFile,
    check_decimal,
    check_width,
    marker_reason,
    not_a_number,
    parse_rows,
    plain_number,
    separators,
    shorten,
    survey,
)
from labpipe.units import Quantity
from labpipe.variables import variable

DEVICE = "Keyence laser displacement sensor"
_CODECS = ("cp932", "cp1252", "gbk")  # tried in this order without a byte order mark where it is not UTF-8
_SATURATION = 10.0  # V, the end of the controller's output; its alarm voltage is not documented
_BATCH = 1 << 11  # rows: markers come in runs, so a small batch keeps most of the file fast


def read(
    path: str | os.PathLike[str],
    *,
    cycle: str | float | Quantity | None = None,
    units: Sequence[str] | None = None,
    storage_factor: int | None = None,
    encoding: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read a Keyence storage file; SourceError names file, line and column of a fault, or the option that is needed.

    Parameters
    ----------
    path : path-like
        The file.
    cycle : str or float or Quantity, optional
        Time between samples, ``"50 us"`` or s, of stored points where nothing says the storage factor.
    units : sequence of str, optional
        Unit of every output, in order.
    storage_factor : int, optional
        Samples per stored point. Each of these three is needed when the file does not say it.
    encoding, decimal : str, optional
        By default decided from the file.
    allow_incomplete : bool
        Read a file that lacks rows, with a warning: a cut last row is dropped, and where the counter jumps the time
        follows it. By default such a file is refused.

    Returns
    -------
    Dataset
        Over ``time`` [s], 0 at the first point: ``out1``, ``out2``, … [m, or V, m/s, m/s2], NaN without a reading, and
        ``status1``, … (:class:`Status`). Attributes: ``sampling_interval`` [s] between stored points,
        ``sampling_cycle`` [s], ``storage_factor``, ``averaging`` when stated, ``header``, ``start``, ``encoding``,
        ``layout``, ``status_counts`` (JSON).
    """
    check_decimal(decimal)
    if storage_factor is not None and (not isinstance(storage_factor, int) or storage_factor < 1):
        raise InputError(f"storage_factor must be a whole number from 1, found {storage_factor!r}")
    asked = f"{cycle.value!r} {cycle.si}" if isinstance(cycle, Quantity) else cycle
    source, header, unit_texts = _open(Path(path), (encoding,) if encoding else _CODECS, units)
    if header.times is not None:
        stated = None
        if asked is not None or {"cycle", "storage"} <= header.entries.keys():
            sampling = header.settle_cycle(asked)
            stated = sampling * header.settle_storage(storage_factor, sampling, is_cycle_given=True)
        return _with_times(source, header, unit_texts[0], stated, decimal=decimal, allow_incomplete=allow_incomplete)
    form, values, status = _read_rows(header, _rows(source, header, allow_incomplete), decimal)
    index = _numbers(header, values, allow_incomplete)
    sampling = header.settle_cycle(asked)
    factor = header.settle_storage(storage_factor, sampling, is_cycle_given=asked is not None)
    variables: dict[str, Any] = {}
    states: dict[str, dict[str, int]] = {}
    for column, (output, text) in enumerate(zip(header.outputs, unit_texts, strict=True), int(header.has_counter)):
        flags, (scale, si), how = status[:, column], unit_of(text), dict[str, Any](original_unit=text)
        readings = values[:, column] * scale
        is_saturated = np.abs(readings) >= (_SATURATION if si == "V" else np.inf)
        flags = np.where(is_saturated, np.int8(Status.SUSPECT), flags)
        if (written := form.layouts[column]) is not None:
            how |= {"decimals": written.decimals, "resolution": scale * 10.0**-written.decimals}
        meaning = {"flag_values": [*map(int, Status)], "flag_meanings": " ".join(state.name for state in Status)}
        readings = np.where(is_saturated, np.nan, readings)
        variables[f"out{output}"] = variable("time", readings, si, f"OUT{output}", **how)
        variables[f"status{output}"] = variable("time", flags, "1", f"state of OUT{output}", **meaning)
        states[f"status{output}"] = {Status(k).name: int(n) for k, n in enumerate(np.bincount(flags)) if n}
    averaging, date = header.count("averaging"), header.text("date")
    start = moment(f"{date} {header.text('clock')}".strip()) or moment(date)  # None in a form that is ambiguous
    facts: dict[str, Any] = {"instrument": DEVICE, "source": source.path.name, "layout": "assumed"}
    facts |= {name: header.text(name) for name in ("model", "serial", "head") if name in header.entries}
    facts |= {"start": "" if start is None else start.isoformat(), "clock": "none: a counter of samples"}
    facts |= {"sampling_cycle": sampling, "storage_factor": factor, "sampling_interval": sampling * factor}
    facts |= {} if averaging is None else {"averaging": averaging}
    facts |= {"header": "\n".join(header.lines), "encoding": source.encoding, "delimiter": header.delimiter}
    facts |= {"decimal": form.signs.decimal, "status_counts": json.dumps(states)}
    facts["work"] = json.dumps({"bytes_read": source.size, "rows_read": len(values)})
    coords = {"time": variable("time", index * (sampling * factor), "s", "time from the first point")}
    return xr.Dataset(variables, coords, facts)


def _open(path: Path, codecs: tuple[str, ...], units: Sequence[str] | None) -> tuple[TextFile, Header, tuple[str, ...]]:
    """Settle the codec by the first one under which the header makes sense: "µm" is no unit under another."""
    source = survey(path, declared=codecs)
    try:
        header = parse_header(path, list(islice(source.lines(), HEAD_LINES)))
        return source, header, header.settle_units(units)
    except SourceError:
        for codec in codecs[codecs.index(source.encoding) + 1 :] if source.encoding in codecs else ():
            with contextlib.suppress(SourceError):
                return _open(path, (codec,), units)
        raise


def _with_times(source: TextFile, header: Header, unit_text: str, stated: float | None, **how: Any) -> xr.Dataset:
    """Read a table whose rows carry their times, as a recorder writes it: a trace of two named columns."""
    from instruments import tables

    place = header.times or 0
    row = split_cells(next(islice(source.lines(), header.n_lines, None)), header.delimiter)
    if CLOCK.fullmatch(row[place]) or len(header.outputs) != 1:
        text = f"the rows carry times of day, or times and {len(header.outputs)} outputs"
        hint = 'Name the columns that are wanted: columns = { time = "Time (s)", displacement = "OUT1 (mm)" }.'
        raise SourceError(source.path, text, line=header.n_lines + 1, hint=hint)
    columns = {"time": place + 1, "displacement": {"column": header.kept[-1] + 1, "unit": unit_text}}
    return tables.read(source.path, columns=columns, cycle=stated, **how)


def _rows(source: TextFile, header: Header, allow_incomplete: bool) -> Iterator[str]:
    """Yield the cells of each row that are read; leave out blank lines at the end; refuse or drop a cut last line."""
    blank, before = 0, ""
    for number, line in enumerate(islice(source.lines(), header.n_lines, None), header.n_lines + 1):
        if not line.strip():
            blank = blank or number
            continue
        if blank:
            raise SourceError(source.path, "an empty line between two rows", line=blank, column=1)
        # with the stated number of rows, and as long as the row before, nothing is cut off
        lengths = {len(text.partition(header.delimiter)[2] if header.has_counter else text) for text in (line, before)}
        is_whole = number - header.n_lines == header.count("rows") and len(lengths) == 1
        if number == source.n_lines and not source.is_ended and not is_whole:
            message = f"the last line is cut, it has no line end: {shorten(line)}"
            if not allow_incomplete:
                hint = "Export the file again, or drop this row with allow_incomplete=True."
                raise SourceError(source.path, message, line=number, column=len(line) + 1, hint=hint)
            warn_of(source.path, f"{message}; it is dropped", line=number)
            return
        before = line
        if len(header.kept) == header.n_cells:
            yield line
            continue
        cells = line.split(header.delimiter)
        check_width(line, cells, header.n_cells, header.delimiter, path=source.path, line_number=number)
        yield header.delimiter.join(cells[index] for index in header.kept)


class _Form(NamedTuple):
    """Signs, layout of each column that has one; where ``is_fixed``, another layout is a fault."""

    signs: Separators
    layouts: tuple[Layout | None, ...]
    is_fixed: bool


def _read_rows(header: Header, lines: Iterable[str], decimal: str | None) -> tuple[_Form, Floats, NDArray[np.int8]]:
    """Return the form of the rows, and values and states (row, column), those of the counter among them.

    SourceError with line and column of another cell, row or layout of a number.
    """
    stream, delimiter, first = iter(lines), header.delimiter, int(header.has_counter)
    sample = list(islice(stream, HEAD_LINES))  # from which decimal sign and layout of the columns are learnt
    rows = [split_cells(line, delimiter) for line in sample]
    signs = DOT if decimal is None else Separators(decimal, "")
    if decimal is None and delimiter != ",":
        try:
            signs = separators([cell for row in rows for cell in row[first:] if marker_status(cell) is None])
        except InputError as error:
            raise SourceError(header.path, str(error), line=header.n_lines + 1) from None
    n_columns = first + len(header.outputs)
    columns = [[row[i] for row in rows if len(row) == n_columns] for i in range(n_columns)]
    layouts: list[Layout | None] = []
    for column in columns:  # one odd cell does not unsettle a layout
        counted = Counter(found for found in map(layout, column) if found is not None).most_common()
        others = sum(count for _, count in counted[1:])
        is_one = counted and others <= max(1, counted[0][1] // 20) and counted[0][1] > others
        layouts.append(counted[0][0] if is_one else None)
    is_padded = all(any(re.match(r"[+-]*0\d", cell) for cell in column) for column in columns[first:])
    form = _Form(signs, tuple(layouts), all(layouts[first:]) and is_padded)
    stream, number = chain(sample, stream), header.n_lines + 1
    parts = [(np.empty((0, n_columns)), np.empty((0, n_columns), np.int8))]
    while batch := list(islice(stream, _BATCH)):
        if '"' in batch[0]:
            batch = [line.replace('"', "") for line in batch]
        # rows of fixed numbers are equally long, apart from the digits of the counter
        lengths = {len(line) - (line.find(delimiter) if header.has_counter else 0) for line in batch}
        values, states = np.empty((0, n_columns)), np.zeros((len(batch), n_columns), np.int8)
        if (not form.is_fixed or len(lengths) == 1) and not NUMERIC_MARKER.search("\n".join(batch)):
            with contextlib.suppress(SourceError):
                values = parse_rows(batch, n_columns, delimiter, path=header.path, first_line=number, signs=signs)
        if not len(values):
            cells = [_read_row(header, form, line, at) for at, line in enumerate(batch, number)]
            values, states = np.array([one for one, _ in cells], float), np.array([two for _, two in cells], np.int8)
        parts.append((values, states))
        number += len(batch)
    return form, np.concatenate([values for values, _ in parts]), np.concatenate([states for _, states in parts])


def _read_row(header: Header, form: _Form, line: str, number: int) -> tuple[list[float], list[int]]:
    cells = split_cells(line, header.delimiter)
    check_width(line, cells, len(form.layouts), header.delimiter, path=header.path, line_number=number)
    values, states = [], []
    for index, cell in enumerate(cells):
        is_counter, known = header.has_counter and index == 0, form.layouts[index]
        status = None if is_counter else marker_status(cell, known)
        value = np.nan if status is not None else plain_number(cell, form.signs)
        column = column_of(line, header.delimiter, index) if len(header.kept) == header.n_cells else None
        if value is None:
            raise not_a_number(cell, path=header.path, line_number=number, column=column)
        if is_counter and not cell.isdigit():
            text = f"found the counter {shorten(cell)}, expected a whole number"
            raise SourceError(header.path, text, line=number, column=column)
        if status is None and form.is_fixed and not is_counter and known is not None and layout(cell) != known:
            text = f"found {shorten(cell)}, but every number of this column has {known.whole} digits before and "
            text, hint = f"{text}{known.decimals} after the decimal sign", "Characters were lost or added: export "
            error = SourceError(header.path, text, line=number, column=column, hint=f"{hint}the file again.")
            raise error.because(marker_reason(cell))
        values.append(value)
        states.append(int(Status.VALID if status is None else status))
    return values, states


def _numbers(header: Header, values: Floats, allow_incomplete: bool) -> NDArray[np.int64]:
    """Return the numbers of the points from 0; refuse rows that the header does not state, or a counter that jumps."""
    path, first_line, expected, found = header.path, header.n_lines + 1, header.count("rows"), len(values)
    if not found:
        raise SourceError(path, "there are no rows of readings", line=first_line)
    if expected not in (None, found):
        message = f"found {found} rows, the header states {expected}"
        if not allow_incomplete:
            hint = (
                "The recording or the copy stopped early, or rows were added; export it again, or read the rows that "
                "are there with allow_incomplete=True."
            )
            raise SourceError(path, message, line=first_line + found - 1, column=1, hint=hint)
        warn_of(path, message)
    counter = values[:, 0].astype(np.int64) if header.has_counter else np.arange(found)
    steps = np.diff(counter)
    wrong = np.flatnonzero(steps != 1)
    if not wrong.size and counter[0] in (0, 1):
        return counter - counter[0]
    if allow_incomplete and (steps > 0).all():
        missing = int(counter[-1] - counter[0]) + 1 - found
        warn_of(path, f"{missing} rows are missing between, the time follows the counter")
        return counter - counter[0]
    back = np.flatnonzero(steps <= 0)
    row = int(back[0] if back.size else wrong[0]) + 1 if wrong.size else 0
    before = int(counter[row - 1]) if row else 0
    said = f"{counter[row]} after {before}" if row else f"{counter[0]} at the beginning"
    hint = "Rows are missing, repeated or moved: export the file again, or sort them by their number. Where rows are "
    hint += "only missing, allow_incomplete=True reads the rest at its right times."
    text = f"the counter says {said}, expected {before + 1}"
    raise SourceError(path, text, line=first_line + row, column=1, hint=hint)

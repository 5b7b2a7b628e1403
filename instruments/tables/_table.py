"""Tables of sweeps, of responses over time and of shift factors, and tables whose columns the user names."""

import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments._headings import stated_in_title
from instruments._instrument import HEAD_LINES
from instruments._intervals import Interval, assemble
from instruments._layout import COMMA, Block, Lines, blocks, signs_of
from instruments._mapping import Columns, chosen, line_to_copy, located, suggestion, time_step
from instruments._moduli import missing
from instruments._quantities import SHIFTS, unit_of
from instruments._readings import intervals, numbers
from instruments._sheets import Notes, open_sheets
from labpipe.arrays import Floats
from labpipe.errors import UNSAID, SourceError
from labpipe.text import DOT, Separators, check_decimal
from labpipe.units import Measure, si as in_si
from labpipe.variables import variable

_DECIMAL = re.compile(r"#DE[CZ]IMAL:\s*(\w+)")
_SIGNS = {"point": ".", "punkt": ".", "comma": ",", "komma": ","}
_OF_TESTER = {"time": "Time, s", "position": "Position (z), mm", "force": "Fz, N"}
_INVALID = 5  # of the states of a Keyence sensor: no reading, for a reason that the file does not state


def read(
    path: str | os.PathLike[str],
    *,
    columns: Columns | None = None,
    cycle: Measure | None = None,
    encoding: str | None = None,
    decimal: str | None = None,
    allow_incomplete: bool = False,
) -> xr.Dataset:
    """Read sweeps, responses over time or shift factors from a table, or the columns of any table that are named.

    SourceError names file, line and column of a fault. Warns of columns, rows or tables that nothing is made of.

    Parameters
    ----------
    path : path-like
        Text with TAB, semicolon, comma or blanks between the columns, or a workbook (.xlsx, .xls, .ods).
    columns : mapping or str, optional
        Quantity to the heading of its column, ``{"time": "Time (s)", "displacement": "Position (m)"}``, to its
        number from 1, or to both with a unit, ``{"column": "Position", "unit": "m"}``; the same as text, as in
        session.toml. Or all columns in their order with their units, ``"f (Hz), E' (MPa), E'' (MPa), T (degC)"``.
        By default the quantities are recognised by their headings.
    cycle : str or float or Quantity, optional
        Time between the rows of a displacement without a column of times and without ``Delta_X`` of LabVIEW.
    encoding, decimal : str, optional
        By default decided from the file.
    allow_incomplete : bool
        Drop a last row that has no line end; by default it is kept if it is whole, and else refused.

    Returns
    -------
    Dataset
        Over ``sample``, as :func:`instruments.anton_paar.read`: ``frequency`` [Hz], ``storage_modulus``,
        ``loss_modulus`` [Pa], ``temperature`` [degC] where the file gives it; ``interval`` counts the sets and tables.
        Of responses ``time`` [s] and ``relaxation_modulus`` [Pa] or ``creep_compliance`` [1/Pa]; of shifts
        ``temperature`` and ``log10_aT``. Of a named displacement as :func:`instruments.keyence.read`, of position and
        force (compression positive) as :func:`instruments.mach1.read`.
    """
    check_decimal(decimal)
    notes, named = Notes(Path(path)), None if columns is None else chosen(columns)
    opened, codec, open_line = open_sheets(notes, encoding, allow_incomplete=allow_incomplete)
    path, found = notes.path, [(t, [(1, t), *own] if own and stated_in_title(t) else own) for t, own in opened]
    stated = (_DECIMAL.match(line) for _, lines in found for _, line in lines[:HEAD_LINES])
    decimal = decimal or next((_SIGNS.get(word[1].casefold()) for word in stated if word), None)
    if named is None:
        return _sweeps(notes, _blocks(path, found), decimal, open_line, codec)
    faults: list[SourceError] = []
    for _, own in found:  # the first sheet that has them
        try:
            block = located(path, own, named)
            break
        except SourceError as error:
            faults.append(error)
    else:
        raise next((each for each in faults if each.line), (*faults, SourceError(path, "the file holds no line"))[0])
    if {each.name for each in named}.isdisjoint({"displacement", "force"}):
        return _sweeps(notes, [block], decimal, open_line, codec)
    if open_line == block.rows[-1][0]:
        notes.add("the last line has no line end; if the file was cut, its last number is wrong", open_line)
    signs = DOT if block.separator == COMMA else signs_of(path, [block], decimal)
    made = _trace(notes, block, signs, cycle, time_step(own, block.line))
    return made.assign_attrs(source=path.name, encoding=codec, decimal=signs.decimal)


def _blocks(path: Path, found: Sequence[tuple[str, Lines]]) -> list[Block]:
    """Find the tables; sheets and lines without any, such as remarks, are passed over."""
    tables = [replace(block, sheet=title) for title, lines in found for block in blocks(lines)]
    whole = [block for block in tables if block.rows]
    if tables and not whole:
        text = "found no row of numbers below the headings"
        hint = "Cells hold numbers alone; the units stand in the headings or in a row below them."
        raise SourceError(tables[0].place(path), text, line=tables[0].line, hint=hint)
    if not whole:
        hint = next((text for _, lines in found if (text := suggestion(lines))), "")
        hint = hint or """columns = "f (Hz), E' (MPa), E'' (MPa), T (degC)\""""
        text = "no line names the columns: expected frequency, temperature, storage and loss modulus (or tan δ, phase)"
        line = next((lines[0][0] for _, lines in found if lines), 1)
        hint = f"Name the columns in a first line, or say which they are: {hint}"
        raise SourceError(path, f"{text}, or temperature and log_aT", line=line, hint=hint)
    return whole


def _sweeps(notes: Notes, tables: list[Block], decimal: str | None, open_line: int, encoding: str) -> xr.Dataset:
    """Convert the tables that can be used to one Dataset; refuse a file that has none, naming the missing quantity."""
    path, last = notes.path, tables[-1]
    if open_line and last.rows and last.rows[-1][0] == open_line:
        if len(last.rows[-1][1]) < max(len(row) for _, row in last.rows):
            text = "the last line has no line end and fewer cells than the others; it is cut"
            hint = "Complete the line, or drop it with allow_incomplete=True."
            raise SourceError(path, text, line=open_line, hint=hint)
        text = "the last line has no line end; it is kept, as no cell is missing, but if the file was cut, its last "
        notes.add(text + "number is wrong", open_line)
    lacking = [missing(block.names()) for block in tables]
    whole = [block for block, text in zip(tables, lacking, strict=True) if not text]
    if not whole:
        block = tables[0]
        known = [h.name for h in block.headings if h.is_known and h.name not in ("point", "set")]
        names = dict.fromkeys(name.replace("_", " ") for name in known)
        hint = "Export the table again with it; if a column is there under another name, name all that are needed: "
        text = f"found {', '.join(names)}; no {lacking[0]}"
        raise SourceError(block.place(path), text, line=block.line, hint=hint + line_to_copy(block.headings))
    sweeps = [block for block in whole if not block.names() & SHIFTS]
    if sweeps and len(sweeps) < len(whole):
        notes.add("a table of shift factors among the readings is left out; give it as a file of its own")
        whole = sweeps
    for block, text in zip(tables, lacking, strict=True):
        if text:
            title = f' "{block.title or block.sheet}"' if block.title or block.sheet else ""
            notes.add(f"the table{title} is left out: it has no {text}", block.line)
    signs = signs_of(path, tables, decimal)
    made: list[Interval] = []
    for block in whole:
        made += intervals(notes, block, signs, len(made) + 1)
    sizes = [interval.point.size for interval in made]
    is_cut = len(sizes) > 2 and len(set(sizes[:-1])) == 1 and sizes[-1] < sizes[0]
    if is_cut:
        notes.add(f"the last set holds {sizes[-1]} rows, all others {sizes[0]}; the file may be cut")
    work = {"bytes_read": path.stat().st_size, "rows_read": sum(sizes), "intervals_read": len(made)}
    facts = {"instrument": "plain table of a dynamic mechanical analysis", "layout": "plain table", "header": ""}
    facts |= {"encoding": encoding, "delimiter": whole[0].separator, "decimal": signs.decimal, "work": json.dumps(work)}
    return assemble(made, path, **facts, **({"incomplete": 1} if is_cut else {}))


def _trace(notes: Notes, block: Block, signs: Separators, cycle: Measure | None, step: float | None) -> xr.Dataset:
    """Convert named columns to the form of a displacement sensor, or of a mechanical tester.

    ``step`` [s] between the rows is that of the file's header. SourceError for times that are missing, go back, do not
    lie evenly or contradict the cycle.
    """
    names = [heading.name for heading in block.headings]
    factors = [unit_of(heading.unit).factor for heading in block.headings]
    table = numbers(notes, block, signs, set(names)) * factors
    columns, lines = dict(zip(names, table.T, strict=True)), [number for number, _ in block.rows]

    def last_decimal(name: str, of: Callable[[list[int]], int]) -> float:
        """Return the value of the last decimal that is written [SI]: the finest (min) or the coarsest (max)."""
        k = names.index(name)
        is_one = np.isfinite(table[:, k]) & (table[:, k] != 0)  # 0.000E+00 says nothing of its last decimal
        texts = [row[k] for (_, row), one in zip(block.rows, is_one, strict=True) if one]
        plain = (text.replace(signs.thousands or " ", "").replace(signs.decimal, ".") for text in texts)
        return factors[k] * 10.0 ** of([int(Decimal(text).as_tuple().exponent) for text in plain] or [0])

    if "displacement" in columns:
        interval, said = step, "the header states a step of"
        if "time" in columns:
            interval = _even_interval(notes.path, columns["time"], last_decimal("time", max), lines)
            said = "the times of the rows are apart by"
        stated = None if cycle is None else in_si(cycle, "s", "cycle")
        if stated is not None and interval is not None and abs(stated - interval) > 1e-3 * interval:
            text = f"{said} {interval:.6g} s, and the cycle is stated as {stated:g} s"
            raise SourceError(notes.path, text, line=lines[0], hint="Correct the cycle, or leave it out.")
        heading, resolution = block.headings[names.index("displacement")], last_decimal("displacement", min)
        if (interval := interval or stated) is None:
            text, hint = "no column of times is named", 'Name it (time = "Time (s)"), or give the cycle: cycle="50 us".'
            raise SourceError(notes.path, text, line=lines[0], hint=hint).because(UNSAID)
        values, how = columns["displacement"], {"original_unit": heading.unit, "resolution": resolution}
        status = np.where(np.isfinite(values), 0, _INVALID).astype(np.int8)
        lost = int(np.count_nonzero(status))
        counts = {"VALID": status.size - lost} | ({"INVALID": lost} if lost else {})
        facts: dict[str, Any] = {"sampling_cycle": interval, "storage_factor": 1, "sampling_interval": interval}
        facts |= {"start": "", "status_counts": json.dumps({"status1": counts})}
        variables = {
            "out1": variable("time", values, unit_of(heading.unit).si, heading.text, **how),
            "status1": variable("time", status, "1", f"0 where {heading.text} is valid"),
        }
        time = variable("time", np.arange(status.size) * interval, "s", "time from the first point")
        made = xr.Dataset(variables, coords={"time": time}, attrs=facts)
    else:
        made = _force(notes, columns, lines)
    work = {"bytes_read": notes.path.stat().st_size, "rows_read": len(lines)}
    clock = "times of the rows" if "time" in columns else "none: a counter of rows"
    return made.assign_attrs(
        instrument="table of named columns", layout="named columns", clock=clock, work=json.dumps(work)
    )


def _force(notes: Notes, columns: dict[str, Floats], lines: list[int]) -> xr.Dataset:
    """Make the Dataset of a mechanical tester, one block over ``sample``; its force counts compression positive."""
    from instruments import mach1

    if "time" not in columns:
        text, hint = "no column of times is named", 'Name it in columns: time = "Time (s)".'
        raise SourceError(notes.path, text, line=lines[0], hint=hint)
    table = np.column_stack([columns[name] for name in _OF_TESTER])
    for bad, text in (
        (~np.isfinite(table).all(axis=1), "a reading is missing"),
        (np.diff(table[:, 0], prepend=-np.inf) <= 0, "the time goes back"),
    ):
        if bad.any():
            line = lines[int(np.argmax(bad))]
            raise SourceError(notes.path, text, line=line, hint="Give each whole record a file.")
    named = dict(zip(_OF_TESTER.values(), table.T, strict=True))
    made = mach1.make_block("Named columns", datetime(1970, 1, 1), named, {})
    in_file = table / [column.unit.factor for column in made.columns]  # not on the steps of a load cell
    dataset = mach1.assemble([replace(made, values=in_file, info_lines=())])
    dataset["compression_sign"] = dataset["compression_sign"].copy(data=[1])
    return dataset.assign_attrs(compression_sign=1)


def _even_interval(path: Path, time: Floats, resolution: float, lines: Sequence[int]) -> float:
    """Return the interval [s] of times that lie evenly, each within its last decimal; SourceError for others."""
    steps = np.diff(time)
    interval = float((time[-1] - time[0]) / steps.size) if steps.size else 0.0
    off = np.abs(time - time[0] - interval * np.arange(time.size))
    if interval > 0 and (off <= 1.001 * resolution + 1e-9 * interval).all():
        return interval
    usual = float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0
    row = int(np.argmax(np.nan_to_num(np.abs(steps - usual), nan=np.inf))) if steps.size else -1
    text = f"the times are uneven: a step of {steps[row] if steps.size else 0.0:.6g} s, {usual:.6g} s elsewhere"
    hint = "Rows are missing, repeated or moved: export the file again, without gaps."
    raise SourceError(path, text, line=lines[row + 1], hint=hint)

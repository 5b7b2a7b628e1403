"""Traces of named columns: displacement over time as a sensor records it, position and force as a tester does."""

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from decimal import Decimal
from typing import Any

import numpy as np
import xarray as xr

from instruments._clock import even_interval
from instruments._layout import Block
from instruments._quantities import unit_of
from instruments._readings import numbers
from instruments._sheets import Notes
from labpipe.arrays import Floats
from labpipe.errors import UNSAID, SourceError
from labpipe.text import Separators
from labpipe.units import Measure, si as in_si
from labpipe.variables import variable

DEVICE = "table of named columns"
_OF_TESTER = {"time": "Time, s", "position": "Position (z), mm", "force": "Fz, N"}
_INVALID = 5  # of the states of a Keyence sensor: no reading, for a reason that the file does not state


def trace(notes: Notes, block: Block, signs: Separators, cycle: Measure | None, step: float | None) -> xr.Dataset:
    """Convert named columns to the form of a displacement sensor, or of a mechanical tester.

    ``step`` [s] between the rows is that of the file's header, where it states one.

    SourceError where a cell is no number, the times are missing, go back or do not lie evenly, or contradict the
    cycle.
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
            interval = even_interval(notes.path, columns["time"], last_decimal("time", max), lines)
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
    return made.assign_attrs(instrument=DEVICE, layout="named columns", clock=clock, work=json.dumps(work))


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

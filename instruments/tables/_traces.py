"""Traces of named columns: displacement over time as a sensor records it, position and force as a tester does."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments._clock import even_interval
from instruments._quantities import unit_of
from instruments.tables._layout import ABSENT
from instruments.tables._mapping import Located
from labpipe.arrays import Floats
from labpipe.errors import UNSAID, SourceError
from labpipe.text import Separators, not_a_number, plain_number
from labpipe.units import Measure, si as in_si
from labpipe.variables import described, variable

DEVICE = "table of named columns"
CONTENTS = ("displacement", "force")
_OF_TESTER = {"time": "Time, s", "position": "Position (z), mm", "force": "Fz, N"}
_INVALID = 5  # of the states of a Keyence sensor: no reading, for a reason that the file does not state


@dataclass(frozen=True, slots=True)
class _Column:
    """Readings in SI and their unit, heading and unit as written, and the exponents of their last digits."""

    values: Floats
    si: str
    heading: str
    unit: str
    exponents: list[int]
    factor: float

    def decimal(self, of: Callable[[list[int]], int]) -> float:
        """Return the value of the last decimal that is written: the finest (min) or the coarsest (max)."""
        return self.factor * 10.0 ** of(self.exponents or [0])


def trace(path: Path, found: Located, signs: Separators, cycle: Measure | None) -> xr.Dataset:
    """Convert named columns to the form of a displacement sensor, or of a mechanical tester.

    Raises
    ------
    SourceError
        A cell is no number, the times are missing, go back or do not lie evenly, or contradict the cycle.
    """
    columns = {each.name: _column(path, found, signs, k) for k, each in enumerate(found.chosen)}
    lines = [number for number, _ in found.rows]
    made = _displacement(path, columns, lines, cycle) if "displacement" in columns else _force(path, columns, lines)
    work = {"bytes_read": path.stat().st_size, "rows_read": len(lines)}
    clock = "times of the rows" if "time" in columns else "none: a counter of rows"
    return made.assign_attrs(instrument=DEVICE, layout="named columns", clock=clock, work=json.dumps(work))


def _column(path: Path, found: Located, signs: Separators, k: int) -> _Column:
    factor, si = unit_of(found.units[k])
    values = np.full(len(found.rows), np.nan)
    exponents = []
    for i, (number, row) in enumerate(found.rows):
        if row[k].casefold() in ABSENT:
            continue
        value = plain_number(row[k], signs)
        if value is None:
            raise not_a_number(row[k], path=path, line_number=number, column=None)
        values[i] = value
        text = row[k].replace(signs.thousands, "") if signs.thousands else row[k]
        exponents.append(int(Decimal(text.replace(signs.decimal, ".")).as_tuple().exponent))
    return _Column(values * factor, si, found.headings[k], found.units[k], exponents, factor)


def _displacement(path: Path, columns: dict[str, _Column], lines: list[int], cycle: Measure | None) -> xr.Dataset:
    """Make the Dataset of a displacement sensor: ``out1`` and ``status1`` over an even ``time``."""
    stated = None if cycle is None else in_si(cycle, "s", "cycle")
    reading = columns["displacement"]
    if "time" in columns:
        interval = even_interval(path, columns["time"].values, columns["time"].decimal(max), lines)
        if stated is not None and abs(stated - interval) > 1e-3 * interval:
            text = f"the times of the rows are {interval:.6g} s apart, and the cycle is stated as {stated:g} s"
            raise SourceError(path, text, line=lines[0], hint="Leave the cycle out.")
    elif stated is not None:
        interval = stated
    else:
        text, hint = "no column of times is named", 'Name it (time = "Time (s)"), or give the cycle: cycle="50 us".'
        raise SourceError(path, text, line=lines[0], hint=hint).because(UNSAID)
    status = np.where(np.isfinite(reading.values), 0, _INVALID).astype(np.int8)
    lost = int(np.count_nonzero(status))
    attrs = described(reading.si, reading.heading, original_unit=reading.unit, resolution=reading.decimal(min))
    variables: dict[str, Any] = {
        "out1": ("time", reading.values, attrs),
        "status1": ("time", status, described("1", f"0 where {reading.heading} is valid")),
    }
    time = variable("time", np.arange(status.size) * interval, "s", "time from the first point")
    counts = {"VALID": status.size - lost} | ({"INVALID": lost} if lost else {})
    facts = {"sampling_cycle": interval, "storage_factor": 1, "sampling_interval": interval, "start": ""}
    facts["status_counts"] = json.dumps({"status1": counts})
    return xr.Dataset(variables, coords={"time": time}, attrs=facts)


def _force(path: Path, columns: dict[str, _Column], lines: list[int]) -> xr.Dataset:
    """Make the Dataset of a mechanical tester, one block over ``sample``; its force counts compression positive."""
    from instruments import mach1

    if "time" not in columns:
        text, hint = "no column of times is named", 'Name it in columns: time = "Time (s)".'
        raise SourceError(path, text, line=lines[0], hint=hint)
    table = np.column_stack([columns[name].values for name in _OF_TESTER])
    for bad, text in (
        (~np.isfinite(table).all(axis=1), "a reading is missing"),
        (np.diff(table[:, 0], prepend=-np.inf) <= 0, "the time goes back"),
    ):
        if bad.any():
            raise SourceError(path, text, line=lines[int(np.argmax(bad))], hint="Give each whole record a file.")
    named = dict(zip(_OF_TESTER.values(), table.T, strict=True))
    block = mach1.make_block("Named columns", datetime(1970, 1, 1), named, {})
    factors = [column.unit.factor for column in block.columns]
    exact = replace(block, values=table / factors, info=(), info_lines=())  # not on the steps of a load cell
    made = mach1.assemble([exact])
    made["compression_sign"] = made["compression_sign"].copy(data=[1])
    return made.assign_attrs(compression_sign=1)

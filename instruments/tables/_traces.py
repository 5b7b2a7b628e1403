"""Traces of named columns: displacement over time as a sensor records it, position and force as a tester does."""

import json
from dataclasses import replace
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from instruments._quantities import unit_of
from instruments.tables._mapping import Located
from labpipe.arrays import Floats
from labpipe.errors import UNSAID, SourceError
from labpipe.units import Measure, si as in_si
from labpipe.variables import described, variable

DEVICE = "table of named columns"
CONTENTS = ("displacement", "force")
_OF_TESTER = {"time": "Time, s", "position": "Position (z), mm", "force": "Fz, N"}
_INVALID = 5  # of the states of a Keyence sensor: no reading, for a reason that the file does not state


def displacement(
    path: Path, found: Located, values: dict[str, Floats], texts: dict[str, list[str]], cycle: Measure | None
) -> xr.Dataset:
    """Make the Dataset of a displacement sensor: ``out1`` and ``status1`` over an even ``time``.

    Raises
    ------
    SourceError
        The times do not lie evenly, contradict the stated cycle, or there are none and no cycle.
    """
    first_line = found.rows[0][0]
    reading = values["displacement"]
    stated = None if cycle is None else in_si(cycle, "s", "cycle")
    if "time" in values:
        lines = [number for number, _ in found.rows]
        interval = even_interval(path, values["time"], _steps(texts["time"], found, "time"), lines)
        if stated is not None and abs(stated - interval) > 1e-3 * interval:
            text = f"the times of the rows are {interval:.6g} s apart, and the cycle is stated as {stated:g} s"
            raise SourceError(path, text, line=first_line, hint="Leave the cycle out.")
    elif stated is not None:
        interval = stated
    else:
        raise SourceError(
            path,
            "no column of times is named",
            line=first_line,
            hint='Name it in columns (time = "Time (s)"), or give the time between rows: cycle="50 us".',
        ).because(UNSAID)
    at = next(k for k, each in enumerate(found.chosen) if each.name == "displacement")
    unit = "V" if values_unit(found, "displacement") == "V" else "m"
    resolution = _steps(texts["displacement"], found, "displacement")
    status = np.where(np.isfinite(reading), 0, _INVALID).astype(np.int8)
    label = found.headings[at] or "displacement"
    variables: dict[str, Any] = {
        "out1": ("time", reading, described(unit, label, original_unit=found.units[at], resolution=resolution)),
        "status1": ("time", status, described("1", f"0 where {label} is valid")),
    }
    time = variable("time", np.arange(reading.size) * interval, "s", "time from the first point")
    lost = int(np.count_nonzero(status))
    counts = {"VALID": reading.size - lost} | ({"INVALID": lost} if lost else {})
    attrs = {
        "sampling_cycle": interval,
        "storage_factor": 1,
        "sampling_interval": interval,
        "start": "",
        "clock": "times of the rows" if "time" in values else "none: a counter of rows",
        "status_counts": json.dumps({"status1": counts}),
    }
    return xr.Dataset(variables, coords={"time": time}, attrs=attrs)


def force(path: Path, found: Located, values: dict[str, Floats]) -> xr.Dataset:
    """Make the Dataset of a mechanical tester, one block over ``sample``; its force counts compression positive.

    Raises
    ------
    SourceError
        There is no column of times, a reading is missing, or the times go back.
    """
    from instruments import mach1

    lines = [number for number, _ in found.rows]
    if "time" not in values:
        text, hint = "no column of times is named", 'Name it in columns: time = "Time (s)".'
        raise SourceError(path, text, line=lines[0], hint=hint)
    table = np.column_stack([values[name] for name in _OF_TESTER])
    bad = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if bad.size:
        raise SourceError(path, "a reading is missing", line=lines[bad[0]], hint="Complete the row, or remove it.")
    back = np.flatnonzero(np.diff(values["time"]) <= 0)
    if back.size:
        raise SourceError(path, "the time goes back", line=lines[back[0] + 1], hint="Give each record a file.")
    columns = dict(zip(_OF_TESTER.values(), table.T, strict=True))
    block = mach1.make_block("Named columns", datetime(1970, 1, 1), columns, {})
    factors = [column.unit.factor for column in block.columns]
    exact = replace(block, values=table / factors, info=(), info_lines=())  # not on the steps of a load cell
    made = mach1.assemble([exact])
    made["compression_sign"] = made["compression_sign"].copy(data=[1])
    return made.assign_attrs(compression_sign=1, clock="times of the rows")


def values_unit(found: Located, name: str) -> str:
    """Return the SI unit of a named column."""
    at = next(k for k, each in enumerate(found.chosen) if each.name == name)
    return unit_of(found.units[at]).si


def _steps(texts: list[str], found: Located, name: str) -> float:
    """Return the last decimal that is written, in SI, in any notation.

    Examples
    --------
    ``5.000000E-04`` and ``0.0005000000`` have the same.
    """
    at = next(k for k, each in enumerate(found.chosen) if each.name == name)
    last = max((int(Decimal(text).as_tuple().exponent) for text in texts if text), default=0)
    smallest = min((int(Decimal(text).as_tuple().exponent) for text in texts if text), default=last)
    return unit_of(found.units[at]).factor * 10.0 ** (smallest if name != "time" else last)


def even_interval(path: Path, time: Floats, resolution: float, lines: list[int]) -> float:
    """Return the interval [s] of times that lie evenly, each within its last decimal.

    Raises
    ------
    SourceError
        They do not, or one is missing.
    """
    steps = np.diff(time)
    n = time.size
    interval = float((time[-1] - time[0]) / (n - 1)) if n > 1 else 0.0
    off = np.abs(time - time[0] - interval * np.arange(n))
    if interval > 0 and (off <= 1.001 * resolution + 1e-9 * interval).all():
        return interval
    usual = float(np.nanmedian(steps)) if n > 1 else 0.0
    row = int(np.nanargmax(np.abs(steps - usual))) + 1 if n > 1 and np.isfinite(steps).any() else 0
    found = steps[row - 1] if n > 1 else 0.0
    raise SourceError(
        path,
        f"the times do not lie evenly: a step of {found:.6g} s, {usual:.6g} s elsewhere",
        line=lines[row],
        hint="Rows are missing, repeated or moved: export the file again, without gaps.",
    )

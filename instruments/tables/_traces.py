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
from instruments.tables._headings import Heading
from instruments.tables._layout import Block
from instruments.tables._readings import numbers
from labpipe.arrays import Floats
from labpipe.errors import UNSAID, SourceError
from labpipe.text import Separators
from labpipe.units import Measure, si as in_si
from labpipe.variables import described, variable

DEVICE = "table of named columns"
_OF_TESTER = {"time": "Time, s", "position": "Position (z), mm", "force": "Fz, N"}
_INVALID = 5  # of the states of a Keyence sensor: no reading, for a reason that the file does not state


@dataclass(frozen=True, slots=True)
class _Column:
    """Readings in SI, their heading, and the exponents of their last digits as written."""

    values: Floats
    heading: Heading
    exponents: list[int]

    def decimal(self, of: Callable[[list[int]], int]) -> float:
        """Return the value of the last decimal that is written [SI]: the finest (min) or the coarsest (max)."""
        return unit_of(self.heading.unit).factor * 10.0 ** of(self.exponents or [0])


def trace(path: Path, block: Block, signs: Separators, cycle: Measure | None, step: float | None) -> xr.Dataset:
    """Convert named columns to the form of a displacement sensor, or of a mechanical tester.

    ``step`` [s] between the rows is that of the file's header, where it states one.

    Raises
    ------
    SourceError
        A cell is no number, the times are missing, go back or do not lie evenly, or contradict the cycle.
    """
    table = numbers(path, block, signs, {heading.name for heading in block.headings})
    columns = {}
    for k, heading in enumerate(block.headings):
        is_one = np.isfinite(table[:, k]) & (table[:, k] != 0)  # 0.000E+00 says nothing of its last decimal
        texts = [
            row[k].replace(signs.thousands or " ", "") for (_, row), one in zip(block.rows, is_one, strict=True) if one
        ]
        exponents = [int(Decimal(text.replace(signs.decimal, ".")).as_tuple().exponent) for text in texts]
        columns[heading.name] = _Column(table[:, k] * unit_of(heading.unit).factor, heading, exponents)
    lines = [number for number, _ in block.rows]
    if "displacement" in columns:
        made = _displacement(path, columns, lines, None if cycle is None else in_si(cycle, "s", "cycle"), step)
    else:
        made = _force(path, columns, lines)
    work = {"bytes_read": path.stat().st_size, "rows_read": len(lines)}
    clock = "times of the rows" if "time" in columns else "none: a counter of rows"
    return made.assign_attrs(instrument=DEVICE, layout="named columns", clock=clock, work=json.dumps(work))


def _displacement(
    path: Path, columns: dict[str, _Column], lines: list[int], stated: float | None, step: float | None
) -> xr.Dataset:
    """Make the Dataset of a displacement sensor: ``out1`` and ``status1`` over an even ``time``."""
    reading, line = columns["displacement"], lines[0]
    in_file, said = step, "the header states a step of"
    if "time" in columns:
        in_file = even_interval(path, columns["time"].values, columns["time"].decimal(max), lines)
        said = "the times of the rows are apart by"
    if stated is not None and in_file is not None and abs(stated - in_file) > 1e-3 * in_file:
        text = f"{said} {in_file:.6g} s, and the cycle is stated as {stated:g} s"
        raise SourceError(path, text, line=line, hint="Correct the cycle, or leave it out.")
    interval = in_file or stated
    if interval is None:
        text, hint = "no column of times is named", 'Name it (time = "Time (s)"), or give the cycle: cycle="50 us".'
        raise SourceError(path, text, line=line, hint=hint).because(UNSAID)
    heading = reading.heading
    status = np.where(np.isfinite(reading.values), 0, _INVALID).astype(np.int8)
    lost = int(np.count_nonzero(status))
    unit, resolution = unit_of(heading.unit).si, reading.decimal(min)
    variables: dict[str, Any] = {
        "out1": (
            "time",
            reading.values,
            described(unit, heading.text, original_unit=heading.unit, resolution=resolution),
        ),
        "status1": ("time", status, described("1", f"0 where {heading.text} is valid")),
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

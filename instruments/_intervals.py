"""Intervals of readings of a rheometer or an analyser, joined to one Dataset over ``sample``."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments._quantities import TEXT, quantity, slug, unit_of
from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import warn_of
from labpipe.variables import variable

DEVICE = "Anton Paar rheometer"
CLIPPED = 20000.0  # the loss factor that RheoCompass writes when it has none
_CLIP_TOLERANCE = 1e-3  # a storage modulus that was made from the clipped value agrees so well

_SAMPLE = ("sample",)
_NUMBER_OF = {"test": "number of the test, from 0", "result": "number of the result in its test, from 0"}
_NUMBER_OF["interval"] = "number of the interval, as in the file"


@dataclass(frozen=True, slots=True)
class Column:
    """One column: its canonical name, header and unit as in the file, values in SI or text, of which ``si`` is ""."""

    name: str
    header: str
    unit: str
    si: str
    values: Floats | list[str]


@dataclass(frozen=True, slots=True)
class Interval:
    """One table: where it belongs, and its columns over its points, of which 0 has no number in the file."""

    test: str
    result: str
    number: int
    declared: int | None
    point: Integers
    is_valid: Flags
    columns: tuple[Column, ...]
    sheet: str = ""


def assemble(intervals: Sequence[Interval], path: Path | None = None, **attrs: Any) -> xr.Dataset:
    """Join intervals along ``sample``; a column that an interval lacks is NaN there.

    Parameters
    ----------
    intervals : sequence of Interval
        In the order of the file. A column that has several units, or is text in one, is left out with a warning.
    path, **attrs
        The file that they are from; further attributes of the Dataset.
    """
    counts = [interval.point.size for interval in intervals]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    units: dict[str, list[str]] = {}
    for column in (column for interval in intervals for column in interval.columns):
        units.setdefault(column.name, []).append(column.si)
    variables: dict[str, Any] = {}
    for name, found in units.items():
        if len(set(found)) > 1:
            text = " and ".join(sorted({unit or "text" for unit in found}))
            warn_of(path or "intervals", f"the column {name} is in {text}; it is left out")
            continue
        values: NDArray[Any] = np.full(starts[-1], np.nan) if found[0] else np.full(starts[-1], "", dtype=object)
        own = [(start, c) for i, start in zip(intervals, starts, strict=False) for c in i.columns if c.name == name]
        for start, column in own:
            values[start : start + len(column.values)] = column.values
        variables[name] = variable(_SAMPLE, values, found[0] or "1", own[0][1].header)
    tests: list[int] = []  # counted in the order of the file; a name that returns begins anew
    results: list[int] = []
    for before, interval in zip([None, *intervals], intervals, strict=False):
        is_same = before is not None and (before.sheet, before.test) == (interval.sheet, interval.test)
        is_next = before is not None and (interval.result != before.result or interval.number <= before.number)
        tests.append((tests[-1] + (not is_same)) if tests else 0)
        results.append(results[-1] + is_next if is_same else 0)
    counted = {"test": tests, "result": results, "interval": [interval.number for interval in intervals]}
    coords = {
        name: variable(_SAMPLE, np.repeat(np.asarray(values, dtype=np.int64), counts), "1", _NUMBER_OF[name])
        for name, values in counted.items()
    }
    points = np.concatenate([i.point for i in intervals])
    coords["point"] = variable(_SAMPLE, points, "1", "number of the point, 0 where the file gives none")
    marks, meaning = np.concatenate([i.is_valid for i in intervals]), "0 where the instrument marked the point invalid"
    variables["is_valid"] = variable(_SAMPLE, marks.astype(np.int8), "1", meaning)
    entries = [
        {"test": test, "result": result, "interval": i.number, "test_name": i.test, "result_name": i.result}
        | {"declared": i.declared, "rows": int(i.point.size), **({"sheet": i.sheet} if i.sheet else {})}
        for i, test, result in zip(intervals, tests, results, strict=True)
    ]
    facts = {"instrument": DEVICE, "layout": "RheoCompass", "tests": json.dumps(entries, ensure_ascii=False)}
    source = {} if path is None else {"source": path.name}
    return _completed(xr.Dataset(variables, coords, {**facts, **source, **attrs}))


def _completed(dataset: xr.Dataset) -> xr.Dataset:
    """Replace clipped loss factors by the ratio of real moduli, and give both frequencies where the file has one."""
    if "loss_factor" in dataset:
        factor = dataset["loss_factor"].values
        clipped = np.abs(factor) >= CLIPPED * (1 - 1e-9)
        fresh = np.where(clipped, np.nan, factor)
        if "storage_modulus" in dataset and "loss_modulus" in dataset:
            storage, loss = dataset["storage_modulus"].values, dataset["loss_modulus"].values
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = loss / storage
            fresh = np.where(clipped & (storage > 0) & (np.abs(ratio) < CLIPPED * (1 - _CLIP_TOLERANCE)), ratio, fresh)
        marked = variable(_SAMPLE, clipped.astype(np.int8), "1", "1 where the file's loss factor is clipped at 20000")
        dataset = dataset.assign(loss_factor=(_SAMPLE, fresh, dataset["loss_factor"].attrs), is_clipped=marked)
    names = {"frequency": ("Hz", "Frequency"), "angular_frequency": ("rad/s", "Angular Frequency")}
    if found := {name: dataset[name].values for name in names if name in dataset}:
        dataset.attrs["derived"] = next((name for name in names if name not in found), "")
        hertz, omega = (found.get(name, np.full(dataset.sizes["sample"], np.nan)) for name in names)
        pairs = (hertz, omega / (2 * np.pi)), (omega, hertz * (2 * np.pi))
        both = [np.where(np.isnan(stated), other, stated) for stated, other in pairs]
        made = {name: variable(_SAMPLE, v, *said) for (name, said), v in zip(names.items(), both, strict=True)}
        dataset = dataset.assign(made)
    return dataset


def make_column(header: str, unit: str, values: Any) -> Column:
    """Make a column of numbers in SI (or of text, with an empty unit) under an English heading."""
    name = quantity(header) or slug(header)
    if name in TEXT:
        return Column(name, header, "", "", [str(v) for v in values])
    return Column(name, header, unit, unit_of(unit).si, np.asarray(values, dtype=float))


def make_interval(test: str, result: str, number: int, columns: Sequence[Column]) -> Interval:
    """Make an interval of valid points, numbered from 1."""
    count = len(columns[0].values)
    return Interval(test, result, number, count, np.arange(1, count + 1), np.ones(count, dtype=bool), tuple(columns))

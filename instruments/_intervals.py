"""Intervals of readings of a rheometer or an analyser, joined to one Dataset over ``sample``."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments._quantities import TEXT, quantity, slug, unit_of
from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import InputError
from labpipe.variables import described, variable

DEVICE = "Anton Paar rheometer"
#: The loss factor that RheoCompass writes when it has none.
CLIPPED = 20000.0
_CLIP_TOLERANCE = 1e-3  # a storage modulus that was made from the clipped value agrees so well

_SAMPLE = ("sample",)


@dataclass(frozen=True, slots=True)
class Column:
    """One column of one interval.

    ``name`` is canonical, ``header`` and ``unit`` as in the file, ``values`` in SI (numbers) or
    text. ``si`` is "" for text.
    """

    name: str
    header: str
    unit: str
    si: str
    values: Floats | list[str]
    sub_label: str = ""


@dataclass(frozen=True, slots=True)
class Interval:
    """One table: where it belongs, and its columns over its points.

    ``point`` is the number of every point (0 where the file gives none), ``is_valid`` False where
    the instrument marked it invalid.
    """

    test: str
    result: str
    number: int
    declared: int | None
    point: Integers
    is_valid: Flags
    columns: tuple[Column, ...]
    sheet: str = ""


def assemble(intervals: Sequence[Interval], **attrs: Any) -> xr.Dataset:
    """Join intervals along ``sample``; a column that an interval lacks is NaN there.

    Parameters
    ----------
    intervals : sequence of Interval
        In the order of the file.
    **attrs
        Further attributes of the Dataset.

    Raises
    ------
    InputError
        One name has two SI units.
    """
    counts = [interval.point.size for interval in intervals]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    variables: dict[str, Any] = {}
    for interval, start in zip(intervals, starts, strict=False):
        for column in interval.columns:
            is_text = isinstance(column.values, list)
            if column.name not in variables:
                empty: NDArray[Any] = np.full(starts[-1], "", dtype=object) if is_text else np.full(starts[-1], np.nan)
                variables[column.name] = (_SAMPLE, empty, described("1" if is_text else column.si, column.header))
            array, known = variables[column.name][1:]
            if (array.dtype == object) != is_text or (not is_text and known["units"] != column.si):
                raise InputError(
                    f'the column "{column.header}" is in "{column.unit or "text"}" here and in "{known["units"]}" in '
                    "another table; rename one of them"
                )
            array[start : start + len(column.values)] = column.values
    tests: list[int] = []  # counted in the order of the file; a name that returns begins anew
    results: list[int] = []
    for before, interval in zip([None, *intervals], intervals, strict=False):
        is_same = before is not None and (before.sheet, before.test) == (interval.sheet, interval.test)
        is_next = before is not None and (interval.result != before.result or interval.number <= before.number)
        tests.append((tests[-1] + (not is_same)) if tests else 0)
        results.append(results[-1] + is_next if is_same else 0)
    coords = {
        name: variable(_SAMPLE, np.repeat(np.asarray(values, dtype=np.int64), counts), "1", text)
        for name, values, text in (
            ("test", tests, "number of the test, from 0"),
            ("result", results, "number of the result in its test, from 0"),
            ("interval", [i.number for i in intervals], "number of the interval, as in the file"),
        )
    }
    coords["point"] = variable(
        _SAMPLE, np.concatenate([i.point for i in intervals]), "1", "number of the point, 0 where the file gives none"
    )
    marks, meaning = np.concatenate([i.is_valid for i in intervals]), "0 where the instrument marked the point invalid"
    variables["is_valid"] = variable(_SAMPLE, marks.astype(np.int8), "1", meaning)
    described_intervals = [
        {
            "test": test,
            "result": result,
            "interval": interval.number,
            "test_name": interval.test,
            "result_name": interval.result,
            "declared": interval.declared,
            "rows": int(interval.point.size),
            **({"sheet": interval.sheet} if interval.sheet else {}),
            "columns": [
                {"name": c.name, "header": c.header, "unit": c.unit}
                | ({"sub_label": c.sub_label} if c.sub_label else {})
                for c in interval.columns
            ],
        }
        for interval, test, result in zip(intervals, tests, results, strict=True)
    ]
    dataset = xr.Dataset(variables, coords=coords)
    dataset.attrs = {
        "instrument": DEVICE,
        "layout": "RheoCompass",
        "tests": json.dumps(described_intervals, ensure_ascii=False),
        **attrs,
    }
    return _frequencies(_unclipped(dataset))


def in_one_unit(intervals: Sequence[Interval]) -> tuple[list[Interval], list[str]]:
    """Leave columns out whose unit is not the same in all tables, and name them in notes."""
    units: dict[str, set[str]] = {}
    for interval in intervals:
        for column in interval.columns:
            units.setdefault(column.name, set()).add(column.si)
    several = {name: found for name, found in units.items() if len(found) > 1}
    notes = [
        f"the column {name} is in {' and '.join(sorted(unit or 'text' for unit in found))}; it is left out"
        for name, found in several.items()
    ]
    return [replace(i, columns=tuple(c for c in i.columns if c.name not in several)) for i in intervals], notes


def _unclipped(dataset: xr.Dataset) -> xr.Dataset:
    """Replace clipped loss factors by the ratio of the moduli, where the storage modulus is real.

    RheoCompass clips at 20000 and often makes the storage modulus from the clipped value; such a
    modulus is no reading, so the loss factor stays NaN.
    """
    if "loss_factor" not in dataset:
        return dataset
    factor = dataset["loss_factor"].values
    clipped = np.abs(factor) >= CLIPPED * (1 - 1e-9)
    fresh = np.where(clipped, np.nan, factor)
    if "storage_modulus" in dataset and "loss_modulus" in dataset:
        storage, loss = dataset["storage_modulus"].values, dataset["loss_modulus"].values
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = loss / storage
        is_real = (storage > 0) & (np.abs(ratio) < CLIPPED * (1 - _CLIP_TOLERANCE))
        fresh = np.where(clipped & is_real, ratio, fresh)
    meaning = "1 where the file's loss factor is clipped at 20000"
    marked = variable(_SAMPLE, clipped.astype(np.int8), "1", meaning)
    dataset = dataset.assign(loss_factor=(_SAMPLE, fresh, dataset["loss_factor"].attrs), is_clipped=marked)
    dataset.attrs["clipped_loss_factors"] = int(clipped.sum())
    return dataset


def _frequencies(dataset: xr.Dataset) -> xr.Dataset:
    """Give both frequencies where the file has one."""
    names = {"frequency": ("Hz", "Frequency"), "angular_frequency": ("rad/s", "Angular Frequency")}
    found = {name: dataset[name].values for name in names if name in dataset}
    if not found:
        return dataset
    dataset.attrs["derived"] = next((name for name in names if name not in found), "")
    absent = np.full(dataset.sizes["sample"], np.nan)
    hertz, omega = found.get("frequency", absent), found.get("angular_frequency", absent)
    both = np.where(np.isnan(hertz), omega / (2 * np.pi), hertz), np.where(np.isnan(omega), hertz * (2 * np.pi), omega)
    return dataset.assign(
        {name: variable(_SAMPLE, v, *said) for (name, said), v in zip(names.items(), both, strict=True)}
    )


def make_column(header: str, unit: str, values: Any) -> Column:
    """Make a column of numbers in SI (or of text, with an empty unit) under an English heading.

    Examples
    --------
    >>> made = make_column("Torque", "[mN·m]", [1e-3])
    >>> made.name, made.si
    ('torque', 'N m')
    """
    name = quantity(header) or slug(header)
    if name in TEXT:
        return Column(name, header, "", "", [str(v) for v in values])
    return Column(name, header, unit, unit_of(unit).si, np.asarray(values, dtype=float))


def make_interval(test: str, result: str, number: int, columns: Sequence[Column]) -> Interval:
    """Make an interval of valid points, numbered from 1."""
    count = len(columns[0].values)
    return Interval(test, result, number, count, np.arange(1, count + 1), np.ones(count, dtype=bool), tuple(columns))

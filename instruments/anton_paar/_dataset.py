"""Intervals to one Dataset, and back."""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from instruments._quantities import TEXT, quantity, slug, unit_of
from instruments.anton_paar._values import Column, Interval
from labpipe.errors import InputError
from labpipe.variables import described, variable

DEVICE = "Anton Paar rheometer"
#: The loss factor that RheoCompass writes when it has none.
CLIPPED = 20000.0
_CLIP_TOLERANCE = 1e-3  # a storage modulus that was made from the clipped value agrees so well

_SAMPLE = ("sample",)


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
        One name stands for two SI units.
    """
    counts = [interval.point.size for interval in intervals]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(int)
    variables: dict[str, Any] = {}
    for interval, start in zip(intervals, starts, strict=False):
        for column in interval.columns:
            _put(variables, column, start, int(starts[-1]))
    tests, results = _numbered(intervals)
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
    dataset = xr.Dataset(variables, coords=coords)
    dataset.attrs = {
        "instrument": DEVICE,
        "layout": "RheoCompass",
        "tests": json.dumps(_described(intervals, tests, results), ensure_ascii=False),
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


def _put(variables: dict[str, Any], column: Column, start: int, total: int) -> None:
    """Write a column into its place."""
    if column.name not in variables:
        is_text = isinstance(column.values, list)
        empty: NDArray[Any] = np.full(total, "", dtype=object) if is_text else np.full(total, np.nan)
        attrs = described("1" if is_text else column.si, column.header)
        variables[column.name] = (_SAMPLE, empty, attrs)
    array, attrs = variables[column.name][1], variables[column.name][2]
    is_text = isinstance(column.values, list)
    if (array.dtype == object) != is_text or (not is_text and attrs["units"] != column.si):
        raise InputError(
            f'the column "{column.header}" is in "{column.unit or "text"}" here and in '
            f'"{attrs["units"]}" in another table; rename one of them'
        )
    array[start : start + len(column.values)] = column.values


def _numbered(intervals: Sequence[Interval]) -> tuple[list[int], list[int]]:
    """Count tests and results in the order of the file; a name that returns begins anew."""
    tests: list[int] = []
    results: list[int] = []
    before: Interval | None = None
    for interval in intervals:
        place = (interval.sheet, interval.test)
        if before is None or place != (before.sheet, before.test):
            tests.append(tests[-1] + 1 if tests else 0)
            results.append(0)
        else:
            is_next = interval.result != before.result or interval.number <= before.number
            tests.append(tests[-1])
            results.append(results[-1] + is_next)
        before = interval
    return tests, results


def _described(intervals: Sequence[Interval], tests: Sequence[int], results: Sequence[int]) -> list[dict[str, Any]]:
    """Return one entry per interval: names, counts, and the columns as they stand in the file."""
    return [
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
                {
                    "name": c.name,
                    "header": c.header,
                    "unit": c.unit,
                    **({"sub_label": c.sub_label} if c.sub_label else {}),
                }
                for c in interval.columns
            ],
        }
        for interval, test, result in zip(intervals, tests, results, strict=True)
    ]


def _unclipped(dataset: xr.Dataset) -> xr.Dataset:
    """Replace clipped loss factors by the ratio of the moduli, where the storage modulus is real.

    RheoCompass clips at 20000 and often makes the storage modulus from the clipped value; such a
    modulus is no reading, so nothing can be recomputed from it and the loss factor stays NaN.
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
    omega = dataset.get("angular_frequency")
    hertz = dataset.get("frequency")
    if omega is None and hertz is None:
        return dataset
    count = dataset.sizes["sample"]
    absent = np.full(count, np.nan)
    from_omega = absent if omega is None else omega.values / (2 * np.pi)
    from_hertz = absent if hertz is None else hertz.values * (2 * np.pi)
    dataset.attrs["derived"] = "frequency" if hertz is None else ("angular_frequency" if omega is None else "")
    return dataset.assign(
        frequency=variable(
            _SAMPLE,
            from_omega if hertz is None else np.where(np.isnan(hertz.values), from_omega, hertz.values),
            "Hz",
            "Frequency",
        ),
        angular_frequency=variable(
            _SAMPLE,
            from_hertz if omega is None else np.where(np.isnan(omega.values), from_hertz, omega.values),
            "rad/s",
            "Angular Frequency",
        ),
    )


def intervals_of(dataset: xr.Dataset) -> list[Interval]:
    """Return the intervals of a Dataset of the form of :func:`assemble`.

    Raises
    ------
    InputError
        It has another form.
    """
    try:
        stated = json.loads(dataset.attrs["tests"])
        stops = np.cumsum([entry["rows"] for entry in stated])
        if not len(stops) or int(stops[-1]) != dataset.sizes["sample"]:
            raise InputError("the attribute tests does not fit the samples")
        return [
            _interval(dataset.isel(sample=slice(int(stop) - entry["rows"], int(stop))), entry)
            for entry, stop in zip(stated, stops, strict=True)
        ]
    except KeyError as error:
        raise InputError(f"not a Dataset of this reader: {error} is missing") from None


def _interval(part: xr.Dataset, entry: dict[str, Any]) -> Interval:
    columns = []
    for stated in entry["columns"]:
        values_of = part[stated["name"]]
        is_text = values_of.dtype.kind not in "fiu"
        values = [str(v) for v in values_of.values] if is_text else values_of.values.astype(float)
        name, header, unit, below = stated["name"], stated["header"], stated["unit"], stated.get("sub_label", "")
        columns.append(Column(name, header, unit, "" if is_text else values_of.attrs["units"], values, below))
    return Interval(
        entry["test_name"],
        entry["result_name"],
        entry["interval"],
        entry["declared"],
        part["point"].values.astype(np.int64),
        part["is_valid"].values.astype(bool),
        tuple(columns),
        sheet=entry.get("sheet", ""),
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

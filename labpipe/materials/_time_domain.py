"""Relaxation and creep tests as isothermal sweeps, for every function that takes sweeps."""

import json
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials.spectrum import frequencies_of, prony_of_creep, prony_of_relaxation
from labpipe.variables import variable

_RESPONSES = {"relaxation_modulus": prony_of_relaxation, "creep_compliance": prony_of_creep}
_ONE_TEMPERATURE = 1.5  # K between neighbouring readings of one test
_SWEEP = ("frequency", "storage_modulus", "loss_modulus", "temperature")
_UNITS = {"frequency": "Hz", "storage_modulus": "Pa", "loss_modulus": "Pa", "temperature": "degC"}


def with_responses(readings: xr.Dataset) -> xr.Dataset:
    """Return readings whose relaxation and creep tests are sweeps, beside the sweeps that they hold.

    Each test is fitted by one spectrum, whose moduli are given at frequencies inside the times that
    were measured (:func:`labpipe.materials.prony_of_relaxation`).

    Parameters
    ----------
    readings : Dataset
        Over ``sample``, in the form of a rheometer's export: ``time`` or ``interval_time`` [s],
        ``relaxation_modulus`` [Pa] or ``creep_compliance`` [1/Pa], ``temperature`` [degC] where it
        is known; the attribute ``tests`` (JSON) counts the rows of every table.

    Returns
    -------
    Dataset
        The same where it holds no such test.

    Raises
    ------
    InputError
        No test can be fitted; the message names the first reason.
    """
    names = [name for name in _RESPONSES if name in readings]
    clock = next((name for name in ("interval_time", "time") if name in readings), None)
    if not names or clock is None:
        return readings
    tables: list[dict[str, Floats]] = []
    problems: list[str] = []
    for rows in _tables(readings, clock):
        for name in names:
            if np.isfinite(readings[name].values[rows]).sum() < 2:
                continue
            try:
                tables.append(_sweep(readings, clock, name, rows))
            except InputError as error:
                problems.append(str(error))
    if not tables:
        if problems and not _has_sweeps(readings):
            message = f"{readings.attrs.get('source', 'the export')}: no test over time can be used: {problems[0]}"
            raise InputError(message)
        return readings
    if _has_sweeps(readings):
        count = np.cumsum([entry["rows"] for entry in json.loads(readings.attrs["tests"])])
        parts = np.split(np.arange(readings.sizes["sample"]), count[:-1])
        parts = [rows for rows in parts if np.isfinite(readings["frequency"].values[rows]).any()]
        held = [name for name in (*_SWEEP, "is_valid") if name in readings]
        tables = [
            {name: np.asarray(readings[name].values[rows], dtype=float) for name in held} for rows in parts
        ] + tables
    return _joined(readings, tables)


def _has_sweeps(readings: xr.Dataset) -> bool:
    return all(name in readings and bool(np.isfinite(readings[name]).any()) for name in _SWEEP[:3])


def _tables(readings: xr.Dataset, clock: str) -> list[NDArray[np.intp]]:
    """Return the valid rows of every test: of one table, at one temperature, the clock running on."""
    stops = np.cumsum([entry["rows"] for entry in json.loads(readings.attrs["tests"])])
    time = readings[clock].values
    good = np.isfinite(time)
    if "is_valid" in readings:
        good &= readings["is_valid"].values.astype(bool)
    found = []
    for table in np.split(np.arange(readings.sizes["sample"]), stops[:-1]):
        rows = table[good[table]]
        begins = np.diff(time[rows]) < 0
        if "temperature" in readings:
            begins |= np.abs(np.diff(readings["temperature"].values[rows])) > _ONE_TEMPERATURE
        found += [part for part in np.split(rows, np.flatnonzero(begins) + 1) if part.size]
    return found


def _sweep(readings: xr.Dataset, clock: str, name: str, rows: NDArray[np.intp]) -> dict[str, Floats]:
    """Return the moduli of one test."""
    time = np.asarray(readings[clock].values[rows], dtype=float)
    before = readings[clock].values[: rows[0]]
    # A clock that runs on from table to table does not start at this step.
    if clock == "time" and before.size and np.isfinite(before[-1]) and time[0] >= before[-1] > 0:
        time = time - before[-1]
    fitted = _RESPONSES[name](time, readings[name].values[rows])
    frequency = frequencies_of(time[time > 0])
    if not frequency.size:
        message = f"the readings span {np.log10(time.max() / time[time > 0].min()):.2g} decades, too few for a sweep"
        raise InputError(message)
    modulus = fitted.complex_modulus(2.0 * np.pi * frequency)
    found = {"frequency": frequency, "storage_modulus": modulus.real, "loss_modulus": modulus.imag}
    if "temperature" in readings:
        found["temperature"] = np.full(frequency.size, float(np.nanmean(readings["temperature"].values[rows])))
    return found


def _joined(readings: xr.Dataset, tables: list[dict[str, Floats]]) -> xr.Dataset:
    """Put tables one below the other."""
    sizes = [table["frequency"].size for table in tables]
    names = [name for name in _SWEEP if any(name in table for table in tables)]
    variables: dict[str, Any] = {
        name: variable(
            "sample",
            np.concatenate([table.get(name, np.full(n, np.nan)) for table, n in zip(tables, sizes, strict=True)]),
            _UNITS[name],
            name.replace("_", " "),
        )
        for name in names
    }
    valid = [table.get("is_valid", np.ones(n)) for table, n in zip(tables, sizes, strict=True)]
    variables["is_valid"] = variable("sample", np.concatenate(valid).astype(np.int8), "1", "0 where marked invalid")
    interval = np.repeat(np.arange(1, len(sizes) + 1), sizes)
    coords = {"interval": variable("sample", interval, "1", "number of the table")}
    entries = json.dumps([{"rows": n, "interval": k} for k, n in enumerate(sizes, 1)])
    kept = {key: value for key, value in readings.attrs.items() if key in ("source", "instrument", "layout", "work")}
    return xr.Dataset(variables, coords, {**kept, "tests": entries, "time_domain": 1})

r"""Step tests (stress relaxation, creep) as moduli over frequency: one spectrum, taken at both.

A stress relaxation :math:`E(t) = E_\infty + \sum E_i e^{-t/\rho_i}` and a sweep hold the same
spectrum. It is fitted to the readings over time with weights that are not negative and a
smoothness chosen by cross-validation, as to sweeps; a creep compliance is fitted by retardation
terms, from which the relaxation terms follow exactly. Moduli are given at frequencies
:math:`\omega = 1/t` inside the times that were measured, where the spectrum is determined.

References
----------
Ferry, Viscoelastic Properties of Polymers, 3rd ed., Wiley, 1980, ch. 3.
"""

import json

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from labpipe.errors import InputError
from labpipe.materials.prony import Prony, Retardation, relaxation_from_creep
from labpipe.materials.spectrum import (
    LEAST_POINTS,
    MARGIN_DECADES,
    TERMS_PER_DECADE,
    compress,
    second_differences,
    solve_by_cross_validation,
)
from labpipe.variables import variable

_WITHIN = 0.5  # decades inside the measured times at either end, where a frequency is trusted
_PER_DECADE = 5  # frequencies, on a grid that all temperatures share
_ONE_TEMPERATURE = 1.5  # K between neighbouring readings of one test
_COLUMNS = {"frequency": "Hz", "storage_modulus": "Pa", "loss_modulus": "Pa", "temperature": "degC", "is_valid": "1"}


def _fitted(time: ArrayLike, values: ArrayLike, name: str) -> tuple[Prony, float, float]:
    """Fit terms that are not negative and smooth, by relative residuals.

    Returned are the effective number of terms and the relative uncertainty of the fitted curve as well.
    """
    t, y = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    good = np.isfinite(t) & np.isfinite(y) & (t > 0)
    t, y = t[good], y[good]
    if t.size < LEAST_POINTS or np.ptp(np.log10(t)) < 2 * _WITHIN:
        raise InputError(
            f"found {t.size} readings after the step{f', from {t.min():.3g} to {t.max():.3g} s' if t.size else ''}; "
            f"a spectrum needs {LEAST_POINTS} over a decade"
        )
    if (y <= 0).any():
        message = f"the {name.split('_')[1]} is zero or negative at {int((y <= 0).sum())} of {y.size} times; expected"
        raise InputError(f"{message} positive values")
    # Terms over the measured times and beyond, where the tails of faster and slower ones come from.
    low, high = np.log10(t.min()) - MARGIN_DECADES, np.log10(t.max()) + MARGIN_DECADES
    terms = np.logspace(low, high, int(np.ceil((high - low) * TERMS_PER_DECADE)) + 1)
    decay, constant = np.exp(-t[:, None] / terms), np.ones((t.size, 1))
    parts = [decay, constant] if name == "relaxation_modulus" else [1.0 - decay, constant, t[:, None] / t.max()]
    rows, scale = np.hstack(parts), float(np.median(y))
    penalty = second_differences(terms.size, rows.shape[1], TERMS_PER_DECADE)
    system = compress(rows * (scale / y)[:, None], np.ones(y.size))
    solution = solve_by_cross_validation(*system, penalty, y.size)
    scatter = solution.misfit / max(y.size - solution.freedom, 1.0)
    u = float(np.sqrt(scatter * solution.freedom / y.size))
    weight, (instant, *flow) = np.split(scale * solution.coefficient, [terms.size])
    if name == "relaxation_modulus":
        return Prony(instant, weight, terms), solution.freedom, u
    if instant <= 0:  # what yields before the first reading is instantaneous for these readings
        first = int(np.flatnonzero(weight > 0)[0])
        instant, weight[first] = weight[first], 0.0
    kept = weight > 0
    family = relaxation_from_creep(Retardation(float(instant), weight[kept], terms[kept], float(flow[0] / t.max())))
    return Prony(family.relaxed, family.weight, family.time, viscosity=family.viscosity), solution.freedom, u


def with_responses(readings: xr.Dataset) -> xr.Dataset:
    """Return readings whose relaxation and creep tests are sweeps, with the sweeps that they hold.

    Each test is fitted by one spectrum, whose moduli are given at frequencies inside the times that were measured.

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
    names = [name for name in ("relaxation_modulus", "creep_compliance") if name in readings]
    clock = next((name for name in ("interval_time", "time") if name in readings), None)
    if not names or clock is None:
        return readings
    tables, problems, known = list[pd.DataFrame](), list[str](), list[tuple[float, float]]()
    for rows in _runs(readings, clock):
        for name in names:
            if np.isfinite(readings[name].values[rows]).sum() < 2:
                continue
            try:
                table, freedom, u = _sweep(readings, clock, name, rows)
                tables.append(table)
                known.append((2 * len(table) / freedom, u))
            except InputError as error:
                problems.append(str(error))
    has_sweeps = all(name in readings and bool(np.isfinite(readings[name]).any()) for name in list(_COLUMNS)[:3])
    if not tables:
        if problems and not has_sweeps:
            message = f"{readings.attrs.get('source', 'the export')}: no test over time can be used: {problems[0]}"
            raise InputError(message)
        return readings
    if has_sweeps:
        held = pd.DataFrame({name: readings[name].values.astype(float) for name in _COLUMNS if name in readings})
        parts = [held.iloc[rows] for rows in tables_of(readings)]
        tables = [part for part in parts if np.isfinite(part["frequency"]).any()] + tables
    # all tables one below the other
    frame = pd.concat(tables, keys=range(1, len(tables) + 1))
    frame["is_valid"] = frame["is_valid"].fillna(1.0)
    variables = {
        name: variable("sample", frame[name].to_numpy(), units, name.replace("_", " "))
        for name, units in _COLUMNS.items()
        if name in frame
    }
    interval = variable("sample", frame.index.get_level_values(0).to_numpy(), "1", "number of the table")
    kept = {key: value for key, value in readings.attrs.items() if key in ("source", "instrument", "layout", "work")}
    entries = json.dumps([{"rows": len(table), "interval": k} for k, table in enumerate(tables, 1)])
    moduli_per_parameter, u_moduli = np.median(known, axis=0).tolist()
    kept |= {"tests": entries, "moduli_per_parameter": max(moduli_per_parameter, 1.0), "u_moduli": u_moduli}
    return xr.Dataset(variables, {"interval": interval}, kept)


def tables_of(readings: xr.Dataset) -> list[NDArray[np.intp]]:
    """Return the rows of every table of a rheometer's export."""
    stops = np.cumsum([entry["rows"] for entry in json.loads(readings.attrs["tests"])])
    return np.split(np.arange(readings.sizes["sample"]), stops[:-1])


def _runs(readings: xr.Dataset, clock: str) -> list[NDArray[np.intp]]:
    """Return the valid rows of every test: of one table, at one temperature, the clock running on."""
    time = readings[clock].values
    good = np.isfinite(time)
    if "is_valid" in readings:
        good &= readings["is_valid"].values.astype(bool)
    found = []
    for table in tables_of(readings):
        rows = table[good[table]]
        begins = np.diff(time[rows]) < 0
        if "temperature" in readings:
            begins |= np.abs(np.diff(readings["temperature"].values[rows])) > _ONE_TEMPERATURE
        found += [part for part in np.split(rows, np.flatnonzero(begins) + 1) if part.size]
    return found


def _sweep(readings: xr.Dataset, clock: str, name: str, rows: NDArray[np.intp]) -> tuple[pd.DataFrame, float, float]:
    """Return the moduli of one test, the effective number of terms that they come from, and their relative u.

    Frequencies lie on a grid that all temperatures share, half a decade inside the measured times.
    """
    time = np.asarray(readings[clock].values[rows], dtype=float)
    before = readings[clock].values[: rows[0]]
    # A clock that runs on from table to table does not start at this step.
    if clock == "time" and before.size and np.isfinite(before[-1]) and time[0] >= before[-1] > 0:
        time = time - before[-1]
    fitted, freedom, u = _fitted(time, readings[name].values[rows], name)
    ends = -np.log10(2.0 * np.pi * time.max()) + _WITHIN, -np.log10(2.0 * np.pi * time[time > 0].min()) - _WITHIN
    steps = np.arange(int(np.ceil(ends[0] * _PER_DECADE)), int(np.floor(ends[1] * _PER_DECADE)) + 1)
    if not steps.size:
        message = f"the readings span {np.log10(time.max() / time[time > 0].min()):.2g} decades, too few for a sweep"
        raise InputError(message)
    frequency = 10.0 ** (steps / _PER_DECADE)
    modulus = fitted.complex_modulus(2.0 * np.pi * frequency)
    table = pd.DataFrame({"frequency": frequency, "storage_modulus": modulus.real, "loss_modulus": modulus.imag})
    if "temperature" in readings:
        table["temperature"] = float(np.nanmean(readings["temperature"].values[rows]))
    return table.assign(is_valid=1.0), freedom, u

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

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials.prony import Prony, Retardation, relaxation_from_creep
from labpipe.materials.spectrum import TERMS_PER_DECADE, compress, second_differences, solve_by_cross_validation
from labpipe.variables import variable

_LEAST = 8  # readings over time
_WITHIN = 0.5  # decades inside the measured times at either end, where a frequency is trusted
_MARGIN = 1.5  # decades of terms beyond the measured times
_PER_DECADE = 5  # frequencies, on a grid that all temperatures share
_ONE_TEMPERATURE = 1.5  # K between neighbouring readings of one test
_SWEEP = ("frequency", "storage_modulus", "loss_modulus", "temperature")


def prony_of_relaxation(time: ArrayLike, modulus: ArrayLike, nu: float = 0.5) -> Prony:
    """Fit a relaxation modulus (reading,) [Pa] over the time [s] since the step, in any order; ``nu`` is handed on.

    Raises
    ------
    InputError
        There are too few readings, or times or moduli are not positive.

    Examples
    --------
    >>> t = np.geomspace(0.1, 100, 60)
    >>> found = prony_of_relaxation(t, 1e6 + 1e6 * np.exp(-t / 3.0))
    >>> bool(np.allclose(found.relaxation(t), 1e6 + 1e6 * np.exp(-t / 3.0), rtol=0.02))
    True
    """
    t, E = _checked(time, modulus, "modulus")
    rho = _times(t)
    columns = np.column_stack([np.exp(-t[:, None] / rho), np.ones(t.size)])
    weight = _fitted(columns, E, rho.size)
    return Prony(weight[-1], weight[:-1], rho, nu)


def prony_of_creep(time: ArrayLike, compliance: ArrayLike, nu: float = 0.5) -> Prony:
    """Fit a creep compliance (reading,) [1/Pa] over time, as :func:`prony_of_relaxation` does a modulus."""
    t, J = _checked(time, compliance, "compliance")
    tau = _times(t)
    columns = np.column_stack([-np.expm1(-t[:, None] / tau), np.ones(t.size), t / t.max()])
    weight = _fitted(columns, J, tau.size)
    C, instant, flow = weight[: tau.size], weight[tau.size], weight[tau.size + 1] / t.max()
    if instant <= 0:  # what yields before the first reading is instantaneous for these readings
        first = int(np.flatnonzero(C > 0)[0])
        instant, C[first] = C[first], 0.0
    kept = C > 0
    family = relaxation_from_creep(Retardation(float(instant), C[kept], tau[kept], float(flow)))
    return Prony(family.relaxed, family.weight, family.time, nu, family.viscosity)


def frequencies_of(time: ArrayLike) -> Floats:
    """Return the frequencies [Hz] at which readings over time [s] determine the moduli.

    They lie on a grid that all temperatures share, half a decade inside the measured times.

    Examples
    --------
    >>> found = frequencies_of([0.01, 100.0])
    >>> float(found[0].round(4)), float(found[-1].round(2))
    (0.0063, 3.98)
    """
    t = np.asarray(time, dtype=float)
    low = -np.log10(2.0 * np.pi * t.max()) + _WITHIN
    high = -np.log10(2.0 * np.pi * t.min()) - _WITHIN
    first, last = int(np.ceil(low * _PER_DECADE)), int(np.floor(high * _PER_DECADE))
    return np.asarray(10.0 ** (np.arange(first, last + 1) / _PER_DECADE))


def _checked(time: ArrayLike, values: ArrayLike, name: str) -> tuple[Floats, Floats]:
    t, y = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    good = np.isfinite(t) & np.isfinite(y) & (t > 0)
    t, y = t[good], y[good]
    if t.size < _LEAST or np.ptp(np.log10(t)) < 2 * _WITHIN:
        raise InputError(
            f"found {t.size} readings after the step"
            f"{f', from {t.min():.3g} to {t.max():.3g} s' if t.size else ''}; a spectrum needs {_LEAST} over a decade"
        )
    if (y <= 0).any():
        message = f"the {name} is zero or negative at {int((y <= 0).sum())} of {y.size} times; expected positive values"
        raise InputError(message)
    order = np.argsort(t, kind="stable")
    return t[order], y[order]


def _times(t: Floats) -> Floats:
    """Lay terms over the measured times and beyond, where the tails of faster and slower ones come from."""
    low, high = np.log10(t[0]) - _MARGIN, np.log10(t[-1]) + _MARGIN
    return np.logspace(low, high, int(np.ceil((high - low) * TERMS_PER_DECADE)) + 1)


def _fitted(columns: Floats, measured: Floats, terms: int) -> Floats:
    """Return weights that are not negative, smooth over the terms, by relative residuals."""
    scale = np.full(columns.shape[1], float(np.median(measured)))
    rows = columns * scale / measured[:, None]
    penalty = second_differences(terms, scale.size, TERMS_PER_DECADE)
    system = compress(rows, np.ones(measured.size))
    found = solve_by_cross_validation(*system, penalty, measured.size)
    return found.coefficient * scale


_RESPONSES = {"relaxation_modulus": prony_of_relaxation, "creep_compliance": prony_of_creep}


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
    for rows in _runs(readings, clock):
        for name in names:
            if np.isfinite(readings[name].values[rows]).sum() < 2:
                continue
            try:
                tables.append(_sweep(readings, clock, name, rows))
            except InputError as error:
                problems.append(str(error))
    has_sweeps = all(name in readings and bool(np.isfinite(readings[name]).any()) for name in _SWEEP[:3])
    if not tables:
        if problems and not has_sweeps:
            message = f"{readings.attrs.get('source', 'the export')}: no test over time can be used: {problems[0]}"
            raise InputError(message)
        return readings
    if has_sweeps:
        held = [name for name in (*_SWEEP, "is_valid") if name in readings]
        parts = [{name: readings[name].values[rows].astype(float) for name in held} for rows in tables_of(readings)]
        tables = [part for part in parts if np.isfinite(part["frequency"]).any()] + tables
    # all tables one below the other
    frame = pd.concat([pd.DataFrame(table) for table in tables], keys=range(1, len(tables) + 1))
    columns = {"frequency": "Hz", "storage_modulus": "Pa", "loss_modulus": "Pa", "temperature": "degC"}
    variables = {
        name: variable("sample", frame[name].to_numpy(), units, name.replace("_", " "))
        for name, units in columns.items()
        if name in frame
    }
    valid = frame["is_valid"].fillna(1.0) if "is_valid" in frame else pd.Series(1.0, frame.index)
    variables["is_valid"] = variable("sample", valid.to_numpy(np.int8), "1", "0 where marked invalid")
    interval = variable("sample", frame.index.get_level_values(0).to_numpy(), "1", "number of the table")
    kept = {key: value for key, value in readings.attrs.items() if key in ("source", "instrument", "layout", "work")}
    entries = json.dumps([{"rows": len(table["frequency"]), "interval": k} for k, table in enumerate(tables, 1)])
    return xr.Dataset(variables, {"interval": interval}, {**kept, "tests": entries, "time_domain": 1})


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

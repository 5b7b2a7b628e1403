"""Peers that shift sweeps or fit a Prony series, each with its own data format."""

import contextlib
import importlib
import importlib.util
import io
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from labpipe.arrays import Floats
from pipelines.bench.rheology_truth import Measured

PEERS = ("pyvisco", "mastercurves")
#: RepTate itself has no interface without windows: its procedure is written out below.
_PROCEDURE = "RepTate's procedure"
# Decades that two isotherms have to share, and what a pair that shares less is worth.
_LEAST_OVERLAP, _APART = 0.05, 1e3


def shifters(made: Measured) -> dict[str, tuple[str, Callable[[], object]]]:
    """Name every installed way to find shifts: group and a call that returns log10 a."""
    found: dict[str, tuple[str, Callable[[], object]]] = {
        f"{_PROCEDURE}, {label}": (_PROCEDURE, partial(pairwise_shifts, made, is_vertical))
        for label, is_vertical in (("horizontal", False), ("horizontal and vertical", True))
    }
    if importlib.util.find_spec("pyvisco"):
        found["pyvisco, storage"] = ("pyvisco", lambda: _pyvisco_shifts(made))
    if importlib.util.find_spec("mastercurves"):
        found["mastercurves, loss"] = ("mastercurves", lambda: _gaussian_processes(made))
    return found


def pairwise_shifts(made: Measured, is_vertical: bool) -> Floats:
    """Shift one isotherm after the other, nearest to the reference first, onto a table that grows.

    Both moduli count by the mean square of the distances of their logarithms over the frequencies
    that an isotherm shares with the table; the simplex of Nelder and Mead moves it. Returned is
    log10 a (temperature,), zero at the reference.
    """
    temperature = made.sweeps["temperature"].values
    x = np.log10(made.sweeps["frequency"].values)
    moduli = np.stack([np.log10(made.sweeps[name].values) for name in ("storage", "loss")], axis=1)
    order = np.argsort(np.abs(temperature - made.reference), kind="stable")
    shifts = np.zeros(temperature.size)
    table_x, table_y = x.copy(), moduli[order[0]].copy()
    for k in order[1:]:
        nearest = order[: list(order).index(k)]
        start = shifts[nearest[np.argmin(np.abs(temperature[nearest] - temperature[k]))]]
        moved = partial(_distance, table_x, table_y, x, moduli[k])
        size = 2 if is_vertical else 1
        simplex = np.vstack([np.zeros(size), 0.5 * np.eye(size)]) + np.array([start, 0.0])[:size]
        best = minimize(moved, simplex[0], method="Nelder-Mead", options={"initial_simplex": simplex}).x
        shifts[k] = best[0]
        table_x = np.concatenate([table_x, x + best[0]])
        table_y = np.concatenate([table_y, moduli[k] - (best[1] if is_vertical else 0.0)], axis=1)
        by = np.argsort(table_x, kind="stable")
        table_x, table_y = table_x[by], table_y[:, by]
    return shifts


def _distance(table_x: Floats, table_y: Floats, x: Floats, y: Floats, move: Floats) -> float:
    """Return the mean squared distance of a moved isotherm from the table, in decades squared."""
    at = x + move[0]
    inside = (at >= table_x[0]) & (at <= table_x[-1])
    if not inside.any() or np.ptp(at[inside]) < _LEAST_OVERLAP:
        return _APART + float(np.min(np.abs(at[:, None] - table_x)))
    down = move[1] if move.size > 1 else 0.0
    rest = [(row[inside] - down) - np.interp(at[inside], table_x, known) for row, known in zip(y, table_y, strict=True)]
    return float(np.mean(np.square(rest)))


def missing() -> list[str]:
    """Say which peers are not installed."""
    return [f"{name} is not installed" for name in PEERS if importlib.util.find_spec(name) is None]


def prony_fitters(made: Measured) -> dict[str, tuple[str, Callable[[], object]]]:
    """Name every installed fit of a series: group and a call that returns E*(ω) there."""
    if importlib.util.find_spec("pyvisco") is None:
        return {}
    return {"pyvisco, 1 term/decade": ("pyvisco", lambda: _pyvisco_series(made))}


def _frame(made: Measured) -> Any:
    """Return sweeps as pyvisco's raw frame (MPa)."""
    rows = []
    sweeps = made.sweeps
    for k, temperature in enumerate(sweeps["temperature"].values):
        for i, frequency in enumerate(sweeps["frequency"].values):
            values = (float(sweeps[name][k, i]) * 1e-6 for name in ("storage", "loss"))
            rows.append((frequency, *values, temperature, round(temperature), k))
    frame = pd.DataFrame(rows, columns=["f_set", "E_stor", "E_loss", "T", "T_round", "Set"])
    with warnings.catch_warnings(action="ignore"):
        for name, value in (("modul", "E"), ("domain", "freq")):
            object.__setattr__(frame, name, value)
    return frame


def _pyvisco_shifts(made: Measured) -> Floats:
    master = importlib.import_module("pyvisco.master")
    with warnings.catch_warnings(action="ignore"), contextlib.redirect_stdout(io.StringIO()):
        table, _ = master.get_aT(_frame(made), round(made.reference))
    return np.asarray(table["log_aT"], dtype=float)


def _pyvisco_series(made: Measured) -> Floats:
    """Fit with the true shifts given; return the moduli at the measured points (Pa)."""
    master = importlib.import_module("pyvisco.master")
    prony = importlib.import_module("pyvisco.prony")
    frame = _frame(made)
    temperature = made.sweeps["temperature"].values
    with warnings.catch_warnings(action="ignore"), contextlib.redirect_stdout(io.StringIO()):
        table = pd.DataFrame({"T": np.round(temperature), "log_aT": made.log10_aT})
        curve = master.smooth(master.get_curve(frame, table, round(made.reference)), 1)
        found = prony.fit_freq(prony.discretize(curve), curve, opt=True)
    terms = found["df_terms"]
    omega = 2.0 * np.pi * made.sweeps["frequency"].values * 10.0 ** made.log10_aT[:, None]
    z = 1j * omega[..., None] * np.asarray(terms["tau_i"], dtype=float)
    share = np.asarray(terms["alpha_i"], dtype=float)
    return np.asarray(1e6 * found["E_0"] * (1.0 - share.sum() + (z / (1.0 + z)) @ share))


def _gaussian_processes(made: Measured) -> Floats:
    """Superpose the loss modulus pair by pair, from the coldest isotherm on.

    The package looks for factors from 0.01 to 1, those of a warmer isotherm on a colder one.
    """
    package = importlib.import_module("mastercurves")
    transforms = importlib.import_module("mastercurves.transforms")
    sweeps = made.sweeps
    count = sweeps.sizes["temperature"]
    with warnings.catch_warnings(action="ignore"), contextlib.redirect_stdout(io.StringIO()):
        curve = package.MasterCurve(fixed_noise=0.02)
        curve.add_data(
            [np.log(sweeps["frequency"].values)] * count,
            [np.log(row) for row in sweeps["loss"].values],
            list(sweeps["temperature"].values),
        )
        curve.add_htransform(transforms.Multiply())
        curve.superpose()
    return np.log10(np.asarray(curve.hparams[0], dtype=float))

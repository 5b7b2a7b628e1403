"""Peers that shift sweeps or fit a Prony series, each with its own data format."""

import contextlib
import importlib
import importlib.util
import io
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from labpipe.arrays import Floats
from pipelines.bench.rheology_truth import Measured

PEERS = ("pyvisco", "mastercurves")


def shifters(made: Measured) -> dict[str, tuple[str, Callable[[], object]]]:
    """Name every installed way to find shifts: group and a call that returns log10 a."""
    found: dict[str, tuple[str, Callable[[], object]]] = {}
    if importlib.util.find_spec("pyvisco"):
        found["pyvisco, storage"] = ("pyvisco", lambda: _pyvisco_shifts(made))
    if importlib.util.find_spec("mastercurves"):
        found["mastercurves, loss"] = ("mastercurves", lambda: _gaussian_processes(made))
    return found


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
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, value in (("modul", "E"), ("domain", "freq")):
            object.__setattr__(frame, name, value)
    return frame


def _pyvisco_shifts(made: Measured) -> Floats:
    master = importlib.import_module("pyvisco.master")
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        table, _ = master.get_aT(_frame(made), round(made.reference))
    return np.asarray(table["log_aT"], dtype=float)


def _pyvisco_series(made: Measured) -> Floats:
    """Fit with the true shifts given; return the moduli at the measured points (Pa)."""
    master = importlib.import_module("pyvisco.master")
    prony = importlib.import_module("pyvisco.prony")
    frame = _frame(made)
    temperature = made.sweeps["temperature"].values
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
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
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        curve = package.MasterCurve(fixed_noise=0.02)
        curve.add_data(
            [np.log(sweeps["frequency"].values)] * count,
            [np.log(row) for row in sweeps["loss"].values],
            list(sweeps["temperature"].values),
        )
        curve.add_htransform(transforms.Multiply())
        curve.superpose()
    return np.log10(np.asarray(curve.hparams[0], dtype=float))

"""Isothermal frequency sweeps, gathered from the readings of a rheometer's export."""

import json
import re
import warnings
from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Flags
from labpipe.errors import InputError
from labpipe.materials._step_tests import tables_of
from labpipe.variables import variable

Mode = Literal["tension", "bending", "shear", "torsion"]

_NEEDED = ("frequency", "temperature", "storage_modulus", "loss_modulus")
_SAME_FREQUENCY = 1e-3  # relative; exports round to four or five digits
_UNTRUSTED = ("ME-",)  # the torque was too small for a reading
_LETTER = r"(?<![A-Za-z]){}(?:pp?|['′″’\"]+)?(?![A-Za-z])"
_LOADINGS = {
    "shear": re.compile("(?i:shear|scher|cisail|cisalh|cizall|torsion)|" + _LETTER.format("G")),
    "extensional": re.compile("(?i:extension|tensile|dehnung)|" + _LETTER.format("E")),
}
_HEADED = ("strain", "storage_modulus", "loss_modulus", "complex_modulus", "relaxation_modulus")


def modulus_factor(mode: Mode, nu: float) -> float:
    """Return tension modulus over measured modulus."""
    return 2.0 * (1.0 + nu) if mode in ("shear", "torsion") else 1.0


def loading_of(readings: xr.Dataset) -> tuple[str, str]:
    """Return the loading of a specimen by the headings of its export, and the heading that shows it.

    Returns
    -------
    loading : {"shear", "extensional", ""}
        Empty where no heading shows it, or two contradict each other.
    heading : str
        Of a strain ("Shear Strain") or of a modulus (the letter of G' or E').

    Examples
    --------
    >>> loading_of(xr.Dataset({"storage_modulus": ("sample", [1e6], {"long_name": "G' (Pa)"})}))
    ('shear', "G' (Pa)")
    """
    headings = [str(readings[name].attrs.get("long_name", "")) for name in _HEADED if name in readings]
    found = {
        loading: heading
        for loading, pattern in _LOADINGS.items()
        for heading in reversed(headings)
        if pattern.search(heading)
    }
    return next(iter(found.items())) if len(found) == 1 else ("", "")


def loading_asked_for(readings: Sequence[xr.Dataset], mode: Mode | None, nu: float | None) -> tuple[Mode, float]:
    """Return mode and Poisson's ratio of readings, which no reading holds; neither is guessed.

    Raises
    ------
    InputError
        The mode is not given and no heading shows it, or it contradicts one; Poisson's ratio is not given.
    """
    seen, heading = loading_of(readings[0])
    is_shear = seen == "shear"
    if mode is None and not seen:
        raise InputError(
            "the readings do not show what was loaded: give mode= (one of "
            f"{', '.join(get_args(Mode))}) and nu= (Poisson's ratio); E = 2 (1 + nu) G in shear and torsion"
        )
    if nu is None:
        kind = "shear moduli, which become E = 2 (1 + nu) G" if (mode or "").startswith(("sh", "to")) else "moduli"
        if mode is None:
            kind = f'{"shear" if is_shear else "tension"} moduli (column "{heading}")'
        example = mode or ("torsion" if is_shear else "tension")
        raise InputError(
            f'the readings are {kind}: give nu=, Poisson\'s ratio of the material, as in mode="{example}", nu=0.35'
        )
    if mode in get_args(Mode) and seen and is_shear != (mode in ("shear", "torsion")):
        raise InputError(
            f'mode = "{mode}", but the readings have a column "{heading}": they are '
            f"{'shear' if is_shear else 'tension'} moduli, a factor 2 (1 + nu) from those of the other mode. Leave "
            "mode out, or where the heading is wrong, correct it: its long_name in the readings"
        )
    return mode or ("shear" if is_shear else "tension"), nu


def gather_sweeps(
    datasets: xr.Dataset | Sequence[xr.Dataset], mode: Mode, nu: float, *, tolerance: float = 1.5, fewest: int = 3
) -> xr.Dataset:
    """Gather the isothermal frequency sweeps of rheometer readings, in tension.

    Parameters
    ----------
    datasets : Dataset or sequence of Dataset
        Over ``sample``: ``frequency`` [Hz], ``temperature`` [degC], ``storage_modulus`` and
        ``loss_modulus`` [Pa], ``is_valid``; the attribute ``tests`` (JSON) counts the rows of every
        table.
    mode : {"tension", "bending", "shear", "torsion"}
        The loading; shear moduli become E = 2 (1 + ν) G.
    nu : float
        Poisson's ratio.
    tolerance : float [K]
        Largest distance of a point's temperature from the mean of its sweep.
    fewest : int
        Frequencies that make a sweep.

    Returns
    -------
    Dataset
        ``storage`` and ``loss`` [Pa] over ``temperature`` [degC, measured mean, ascending] and
        ``frequency`` [Hz]; NaN where a sweep has no point. ``temperature_spread`` [K].

    Raises
    ------
    InputError
        A column is missing, or there is no sweep.
    """
    if mode not in ("tension", "bending", "shear", "torsion"):
        raise InputError(f'mode "{mode}" is unknown; expected tension, bending, shear or torsion')
    if not 0.0 <= nu <= 0.5:
        raise InputError(f"nu = {nu}: expected Poisson's ratio of a solid, from 0 to 0.5")
    parts = [datasets] if isinstance(datasets, xr.Dataset) else list(datasets)
    sweeps: list[pd.DataFrame] = []
    for part in parts:
        _check_columns(part)
        table = pd.DataFrame({name: part[name].values.astype(float) for name in _NEEDED} | {"good": _trusted(part)})
        sweeps += [table.iloc[rows] for rows in isothermal_runs(part, tolerance, fewest)]
    if not sweeps:
        raise InputError(
            f"found no isothermal frequency sweep of {fewest} frequencies within ±{tolerance:g} K; "
            "this experiment needs frequency sweeps at several temperatures"
        )
    sweeps.sort(key=lambda sweep: float(sweep["temperature"].mean()))
    made = _tabulated(sweeps, modulus_factor(mode, nu), mode, nu)
    over_time = [part.attrs for part in parts if "u_moduli" in part.attrs]
    return made.assign_attrs(
        {n: max(a[n] for a in over_time) for n in ("moduli_per_parameter", "u_moduli") if over_time}
    )


def _check_columns(dataset: xr.Dataset) -> None:
    missing = [name for name in _NEEDED if name not in dataset]
    if missing:
        names = ", ".join(name.replace("_", " ") for name in missing)
        remedy = "export the table again with frequency, temperature, storage and loss modulus"
        if missing == ["temperature"]:
            remedy = 'state it in session.toml, temperature = "25 degC", or assign it to the readings in Python'
        raise InputError(f"{dataset.attrs.get('source', 'the export')} has no column for: {names}; {remedy}")


def _tables(dataset: xr.Dataset) -> list[NDArray[np.intp]]:
    """Return the rows of every table that holds moduli at known frequency and temperature."""
    known = np.isfinite(dataset["frequency"].values) & np.isfinite(dataset["temperature"].values)
    return [rows[known[rows]] for rows in tables_of(dataset)]


def trusted_rows(dataset: xr.Dataset) -> list[NDArray[np.intp]]:
    """Return the rows of the valid points of every table of rheometer readings; InputError if a column is missing."""
    _check_columns(dataset)
    good = _trusted(dataset)
    return [rows[good[rows]] for rows in _tables(dataset)]


def isothermal_runs(dataset: xr.Dataset, tolerance: float, fewest: int) -> list[NDArray[np.intp]]:
    """Return the rows of every table at one temperature [within `tolerance`, K], of `fewest` frequencies."""
    temperature, frequency = dataset["temperature"].values, dataset["frequency"].values
    found: list[NDArray[np.intp]] = []
    for rows in _tables(dataset):
        starts, total = [0], 0.0
        for at, value in enumerate(temperature[rows].tolist()):
            # A run ends where the temperature leaves the mean of the points before.
            if at > starts[-1] and abs(value - total / (at - starts[-1])) > tolerance:
                starts.append(at)
                total = 0.0
            total += value
        found += [run[frequency[run] > 0] for run in np.split(rows, starts[1:])]
    return [run for run in found if np.unique(np.round(np.log10(frequency[run]), 3)).size >= fewest]


def _trusted(dataset: xr.Dataset) -> Flags:
    """Return the points that count: valid, not clipped, torque large enough."""
    good = dataset["is_valid"].values.astype(bool)
    if "is_clipped" in dataset:
        good &= dataset["is_clipped"].values == 0
    if "status" in dataset:
        tokens = [str(text).replace(" ", "").split(",") for text in dataset["status"].values]
        good &= np.array([not any(t in _UNTRUSTED for t in row) for row in tokens], dtype=bool)
    return good & np.isfinite(dataset["storage_modulus"].values) & np.isfinite(dataset["loss_modulus"].values)


def _tabulated(sweeps: Sequence[pd.DataFrame], factor: float, mode: str, nu: float) -> xr.Dataset:
    """Put ragged sweeps on the union of their frequencies.

    Frequencies that agree within rounding share a column; a frequency that one sweep holds twice has a second column.
    """
    table = pd.concat(sweep.assign(sweep=k) for k, sweep in enumerate(sweeps))
    table = table.sort_values("frequency", kind="stable", ignore_index=True)
    group = (np.log(table["frequency"]).diff() > _SAME_FREQUENCY).cumsum()
    table["column"] = table.groupby([group, table.groupby(["sweep", group]).cumcount()]).ngroup()
    table["frequency"] = table.groupby(group)["frequency"].transform("median")
    moduli = (factor * table[["storage_modulus", "loss_modulus"]]).where(table["good"])
    grid = table[["sweep", "column"]].join(moduli).pivot(index="sweep", columns="column")
    excluded = int((~table["good"]).sum())
    if excluded:
        text = f"{excluded} of {len(table)} points are left out: invalid, clipped, or torque too small"
        warnings.warn(text, stacklevel=3)
    temperature, dims = table.groupby("sweep")["temperature"], ("temperature", "frequency")
    mean, spread = temperature.mean().to_numpy(), (temperature.max() - temperature.min()).to_numpy()
    levels = table.groupby("column")["frequency"].first().to_numpy()
    return xr.Dataset(
        {
            "storage": variable(dims, grid["storage_modulus"].to_numpy(), "Pa", "storage modulus, tension"),
            "loss": variable(dims, grid["loss_modulus"].to_numpy(), "Pa", "loss modulus, tension"),
            "temperature_spread": variable("temperature", spread, "K", "range of the temperature within a sweep"),
        },
        coords={
            "temperature": variable("temperature", mean, "degC", "measured mean temperature"),
            "frequency": variable("frequency", levels, "Hz", "frequency"),
        },
        attrs={
            "mode": mode,
            "nu": nu,
            "modulus_factor": factor,
            "work": json.dumps({"isotherms": len(sweeps), "points": len(table) - excluded}),
        },
    )

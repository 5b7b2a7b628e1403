"""Relaxation under a periodic punch: force, ramps and holds with their peaks and plateaus, and all tests in a table."""

import json
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.errors import InputError
from labpipe.variables import variable, with_u
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, ramps_and_holds
from pipelines.experiments.shared.model_inputs import INPUTS

_BIRGE_LIMIT = 2.0  # of chance alone, three depths exceed it once in fifty


def loads(readings: xr.Dataset, record: Path | None, *, settings: Relaxation) -> xr.Dataset:
    """Make force compression-positive, and tare it where the file begins in air."""
    return mach1_readings.force(
        readings, settings.load_cell.tare, record, untared="peak and plateau hold the cell's offset and a preload"
    )


def ramps(loads: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Find every ramp and hold, first touch, and the peak and plateau of the force."""
    try:
        touch, how = mach1_readings.contact_position(loads, settings.contact)
    except InputError as error:
        # forces need no depth
        warnings.warn(f"no modulus and no model: {error}", stacklevel=2)
        touch, how = None, str(error)
    result = ramps_and_holds.measured(loads, touch, settings.hold.plateau.value)
    value, u = (np.nan, np.nan) if touch is None else (touch.value, touch.u)
    result = result.assign(with_u("contact_position", (), value, u, "m", "stage position of first touch"))
    return result.assign_attrs(contact=how)


def tests(
    ramps: list[xr.Dataset], curves: list[xr.Dataset], comparison: list[xr.Dataset], *, settings: Relaxation
) -> xr.Dataset:
    """Gather every ramp of every file, and average the modulus over the depths."""
    names = [
        Path(file).stem + (f", ramp {i + 1}" if found.sizes["ramp"] > 1 else "")
        for file, found in zip(settings.mach1, ramps, strict=True)
        for i in range(found.sizes["ramp"])
    ]
    parts = [
        xr.merge([found, curve, compared], combine_attrs="drop_conflicts")
        for found, curve, compared in zip(ramps, curves, comparison, strict=True)
    ]
    # a hold that ended sooner depends on fewer modes of a spectrum: on the others not at all
    known = [part for part in parts if "uncertain" in part.coords]
    simulated = max(known, key=lambda part: part.sizes["uncertain"], default=xr.Dataset())
    tables = []
    for part in parts:
        table = part[[n for n in part.data_vars if {"ramp"} <= set(part[n].dims) <= {"ramp", "uncertain"}]]
        if "uncertain" in table.coords:
            table = table.reindex(uncertain=simulated["uncertain"].values, fill_value=0.0)
        tables.append(table.drop_vars("ramp", errors="ignore"))
    made = xr.concat(tables, "ramp", data_vars="minimal", coords="minimal", compat="override", join="outer")
    made = made.rename(ramp="test").assign_coords(test=np.arange(1, len(names) + 1))
    made = made.merge(simulated[[name for name in INPUTS if name in simulated]])
    made.attrs = {"names": json.dumps(names)}
    if "reduced_modulus" in made:
        nus = [float(c["nu"]) for c in curves if "nu" in c]
        made = made.merge(_averaged(made, nus[0]))
    return made


def _averaged(table: xr.Dataset, nu: float) -> xr.Dataset:
    """Average the modulus over the tests, weighted by what they do not share.

    The scatter is tested against the stated uncertainties; where it is larger, they grow by the
    Birge ratio.
    """
    value = table["reduced_modulus"].values
    own, whole = table["reduced_modulus_own_part"].values, table["u_reduced_modulus"].values
    usable = np.isfinite(value) & (own > 0)
    weight = 1 / own[usable] ** 2
    mean = float(np.sum(weight * value[usable]) / weight.sum())
    shared = float(np.mean(np.sqrt(np.maximum(whole[usable] ** 2 - own[usable] ** 2, 0.0))))
    chi = float(np.sum(weight * (value[usable] - mean) ** 2))
    freedom = int(usable.sum()) - 1
    birge = max(1.0, np.sqrt(chi / freedom)) if freedom > 0 else 1.0
    if birge > _BIRGE_LIMIT:
        warnings.warn(
            f"the moduli of the depths differ by {birge:.1f} times their uncertainties: the rubber "
            "is not linear, or the punch is not what session.toml says",
            stacklevel=2,
        )
    u = float(np.hypot(birge / np.sqrt(weight.sum()), shared))
    tension = 1 - nu**2
    return xr.Dataset(
        with_u("mean_reduced_modulus", (), mean, u, "Pa", "relaxed reduced modulus over all tests")
        | with_u("mean_relaxed_modulus", (), mean * tension, u * tension, "Pa", "relaxed modulus in tension")
        | {"birge_ratio": variable((), birge, "1", "scatter between tests over their uncertainties")}
    )

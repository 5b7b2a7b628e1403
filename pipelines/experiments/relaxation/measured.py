"""Relaxation under a periodic punch: force, ramps and holds with their peaks and plateaus, and all tests in a table."""

import json
import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.variables import with_u
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, ramps_and_holds
from pipelines.experiments.shared.model_inputs import INPUTS

_BIRGE_LIMIT = 2.0  # of chance alone, three depths exceed it once in fifty


def ramps(loads: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Find every ramp and hold, first touch, and the peak and plateau of the force."""
    known = mach1_readings.first_touch(loads, settings.contact)
    made = ramps_and_holds.measured(loads, mach1_readings.touch_of(known))
    return made.merge(known).assign_attrs(made.attrs | known.attrs)


def tests(
    ramps: list[xr.Dataset], curves: list[xr.Dataset], comparison: list[xr.Dataset], *, settings: Relaxation
) -> xr.Dataset:
    """Gather every ramp of every file, and average the modulus over the depths."""
    names, tables = [], []
    for file, *found in zip(settings.mach1, ramps, curves, comparison, strict=True):
        part = xr.merge(found, combine_attrs="drop_conflicts")
        count = part.sizes["ramp"]
        names += [Path(file).stem + (f", ramp {i + 1}" if count > 1 else "") for i in range(count)]
        kept = [n for n in part.data_vars if {"ramp"} <= set(part[n].dims) <= {"ramp", "uncertain"} or n in INPUTS]
        tables.append(part[kept].drop_vars("ramp", errors="ignore"))
    # a hold that ended sooner depends on fewer modes of a spectrum: on the others not at all
    known = max((t for t in tables if "uncertain" in t.coords), key=lambda t: t.sizes["uncertain"], default=None)
    if known is not None:
        inputs, effects = known[list(INPUTS)], known["uncertain"].values
        tables = [t.drop_vars(INPUTS, errors="ignore") for t in tables]
        tables = [t.reindex(uncertain=effects, fill_value=0.0) if "uncertain" in t.coords else t for t in tables]
    made = xr.concat(tables, "ramp", data_vars="minimal", coords="minimal", compat="override", join="outer")
    made = made.rename(ramp="test").assign_coords(test=np.arange(1, len(names) + 1))
    if known is not None:
        made = made.merge(inputs)
    made.attrs = {"names": json.dumps(names)}
    if "reduced_modulus" in made:
        made = made.merge(_averaged(made, next(float(c["nu"]) for c in curves if "nu" in c)))
    return made


def _averaged(table: xr.Dataset, nu: float) -> xr.Dataset:
    """Average the modulus over the tests, weighted by the part of u that they do not share.

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
    )

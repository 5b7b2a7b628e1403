"""Simulation of the creeping contact, and Hertz's radius under each load."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe import contact, uncertainty
from labpipe.arrays import Floats
from labpipe.contact.sphere import counter_compliance, hertz
from labpipe.materials import Prony
from labpipe.uncertainty import Source
from labpipe.units import Quantity
from labpipe.variables import variable, with_u
from pipelines.experiments.shared.counter_body import counter_body_of, modulus_of
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.static_loading.load_steps import valid
from pipelines.experiments.static_loading.measured import spans
from pipelines.experiments.static_loading.settings import StaticLoading

_STEP_POINTS = 80  # of the simulation in one load step, evenly in the logarithm of time
_FIRST = 0.5  # s under a load at which the simulation is first asked


def model(
    displacement: xr.Dataset,
    steps: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: StaticLoading,
) -> xr.Dataset:
    """Simulate the loading with the times found; and Hertz's steps."""
    solid = resolve(settings.sphere, material_file, fitted)
    radius = settings.sphere.radius
    chosen = settings.model
    time, _ = valid(displacement)
    force = steps["force"].values
    stretches, loads = [], []
    for (begin, end), load in zip(spans(steps), force, strict=True):
        inside = begin + np.concatenate([[0.0], np.geomspace(_FIRST, end - begin, _STEP_POINTS)])
        stretches.append(inside)
        loads.append(np.full(inside.size, load))
    when, pushed, shape = np.concatenate(stretches), np.concatenate(loads), chosen.profile
    flat, share = counter_body_of(settings.counter_body), 1 - float(solid.nu) ** 2
    made = contact.load_sphere(solid, radius.value, when, pushed, profile=shape, substrate=flat)

    def compliance(of: Prony, lag: Any) -> Floats:
        return share * np.asarray(of.creep(lag)) + counter_compliance(flat)

    held = np.maximum(np.searchsorted(steps["begin"].values, time, side="right") - 1, 0)
    # exponents of Hertz's contact: approach (F J)^(2/3) R^(-1/3), radius (F J)^(1/3) R^(1/3)
    spread, size = (steps["u_force"].values / force)[held], radius.u / radius.value
    lasted = float(time[-1])
    # of loads that only grow the cube of the radius is the hereditary integral with the creep compliance (Lee & Radok)
    nodes = made["time"].values
    lag = np.maximum(nodes[:, None] - steps["begin"].values, 0.0)
    added = np.where(nodes[:, None] >= steps["begin"].values, np.diff(force, prepend=0.0), 0.0)
    whole, cube = float(compliance(solid, lasted)), np.sum(added * compliance(solid, lag), axis=1)
    softer: list[Source] = []  # relative change of the compliance
    wider: list[Floats] = []  # relative change of the contact radius by one u
    for name, (given, step, other) in variations(settings.sphere, material_file, fitted, (lasted, lasted)).items():
        softer.append(Source.of(name, given, float(np.log(float(compliance(other, lasted)) / whole)) / step))
        wider.append(given.u / step / 3.0 * np.log(np.sum(added * compliance(other, lag), axis=1) / cube))
    for name, modulus in modulus_of(settings.counter_body).items():  # a compliance that goes as 1/E
        by_flat = -counter_compliance(flat) / modulus.value
        softer.append(Source.of(name, modulus, by_flat / whole))
        wider.append(modulus.u * by_flat / 3.0 * np.sum(added, axis=1) / cube)
    u_compliance = uncertainty.combined_uncertainty(softer)
    table: dict[str, Any] = {}
    for name, power in (("approach", 2 / 3), ("contact_radius", 1 / 3)):
        values = np.interp(time, nodes, made[name].values)
        relative = np.sqrt((power * spread) ** 2 + (size / 3) ** 2 + (power * u_compliance) ** 2)
        text, of = f"{name.replace('_', ' ')}, viscoelastic model", "from load, radius, solid"
        table |= with_u(name, "time", values, values * relative, "m", text, of)
    last = float(values[-1])
    sources = [
        Source("load", float(force[-1]), float(steps["u_force"][-1]), "N", last / 3 / force[-1], "systematic"),
        Source.of("radius", radius, last / 3 / radius.value),
        *(source._replace(sensitivity=last / 3 * source.sensitivity) for source in softer),
    ]
    softest, reference = whole, f"modulus after {lasted:.3g} s"
    if solid.E_relaxed > 0.0:  # else the sweeps tell of no plateau
        softest, reference = share / float(solid.E_relaxed) + counter_compliance(flat), "relaxed modulus"
    level = np.asarray(hertz.static_load(force, radius.value, 1.0 / softest).contact_radius)
    table["hertz_radius_relaxed"] = variable("load", level, "m", f"contact radius by Hertz, {reference}")
    elapsed = compliance(solid, steps["elapsed"].values)
    table["compliance"] = variable("elapsed", elapsed, "1/Pa", "reduced creep compliance of sphere and disc")
    effect = np.array(wider).reshape(-1, nodes.size)
    table["effect"] = variable(("input", "node"), effect, "1", "relative change of the contact radius by one u")
    coords = {
        name: variable(name, each, "s", "time from the first point") for name, each in (("time", time), ("node", nodes))
    }
    budget = json.dumps(uncertainty.budget_rows(sources))
    return xr.Dataset(
        table,
        coords={**coords, "load": steps["load"], "elapsed": steps["elapsed"]},
        attrs={"reference": reference, "work": made.attrs["work"], "budget": budget},  # reference: of Hertz's steps
    )


def of_material(model: xr.Dataset | None) -> dict[str, tuple[Quantity, float]]:
    """Return each uncertain property of the solid, with the relative change of the contact radius per SI unit of it.

    They are the rows of the budget of the last contact radius, without load and radius.
    """
    if model is None:
        return {}
    last = float(model["contact_radius"][-1])
    return {
        row["source"]: (Quantity(row["value"], row["u"], row["unit"]), row["sensitivity"] / last)
        for row in json.loads(model.attrs["budget"])
        if row["source"] not in ("load", "radius")
    }

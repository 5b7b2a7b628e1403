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
from pipelines.experiments.shared.model_inputs import table_of
from pipelines.experiments.static_loading.measured import POINTS, spans, valid
from pipelines.experiments.static_loading.settings import StaticLoading


def model(
    displacement: xr.Dataset,
    steps: xr.Dataset,
    file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: StaticLoading,
) -> xr.Dataset:
    """Simulate the loading with the times found; and Hertz's steps.

    ``slope`` (uncertain, time) is the relative change of the contact radius with an input, SI.
    """
    solid = resolve(settings.sphere, file, fitted)
    radius, time = settings.sphere.radius, valid(displacement)[0]
    begin, force = (steps[name].values for name in ("begin", "force"))
    first = 0.1 * float(np.median(np.diff(time)))  # a load is put on between two readings
    inside = [at + np.append(0.0, np.geomspace(first, end - at, POINTS)) for at, end in spans(steps)]
    when, pushed, shape = np.concatenate(inside), np.repeat(force, POINTS + 1), settings.model.profile
    flat, share = counter_body_of(settings.counter_body), 1 - float(solid.nu) ** 2
    made = contact.load_sphere(solid, radius.value, when, pushed, profile=shape, substrate=flat)

    def compliance(of: Prony, lag: Any) -> Floats:
        return share * np.asarray(of.creep(lag)) + counter_compliance(flat)

    # of loads that only grow the cube of the radius is the hereditary integral with the creep compliance (Lee & Radok)
    lasted, lag = float(time[-1]), np.maximum(time[:, None] - begin, 0.0)
    added = np.where(time[:, None] >= begin, np.diff(force, prepend=0.0), 0.0)
    whole = np.sum(added * compliance(solid, lag), axis=1)
    inputs, slopes = dict[str, Quantity](), list[Floats]()
    for name, (given, step, other) in variations(settings.sphere, file, fitted, (lasted, lasted)).items():
        inputs[name] = given
        slopes.append(np.log(np.sum(added * compliance(other, lag), axis=1) / whole) / step / 3)
    for name, modulus in modulus_of(settings.counter_body).items():  # a compliance that goes as 1/E
        inputs[name] = modulus
        slopes.append(-counter_compliance(flat) / modulus.value * np.sum(added, axis=1) / whole / 3)
    slope = np.array(slopes).reshape(-1, time.size)
    of_solid = np.linalg.norm(slope * np.reshape([given.u for given in inputs.values()], (-1, 1)), axis=0)
    # exponents of Hertz's contact: approach (F J)^(2/3) R^(-1/3), radius (F J)^(1/3) R^(1/3)
    of_load = (steps["u_force"].values / force)[np.sum(time[:, None] >= begin, axis=1) - 1] / 3
    table: dict[str, Any] = {}
    for name, power in (("approach", 2), ("contact_radius", 1)):
        values = np.interp(time, made["time"].values, made[name].values)
        relative = np.sqrt((power * of_load) ** 2 + (radius.u / radius.value / 3) ** 2 + (power * of_solid) ** 2)
        text, of = f"{name.replace('_', ' ')}, viscoelastic model", "from load, radius, solid"
        table |= with_u(name, "time", values, values * relative, "m", text, of)
    last = float(values[-1])
    sources = [
        Source("load", float(force[-1]), float(steps["u_force"][-1]), "N", last / 3 / force[-1], "systematic"),
        Source.of("radius", radius, last / 3 / radius.value),
        *(Source.of(*given, last * float(one[-1])) for given, one in zip(inputs.items(), slope, strict=True)),
    ]
    softest, reference = float(compliance(solid, lasted)), f"modulus after {lasted:.3g} s"
    if solid.E_relaxed > 0.0:  # else the sweeps tell of no plateau
        softest, reference = share / float(solid.E_relaxed) + counter_compliance(flat), "relaxed modulus"
    level = np.asarray(hertz.static_load(force, radius.value, 1.0 / softest).contact_radius)
    table["hertz_radius_relaxed"] = variable("load", level, "m", f"contact radius by Hertz, {reference}")
    elapsed = compliance(solid, steps["elapsed"].values)
    table["compliance"] = variable("elapsed", elapsed, "1/Pa", "reduced creep compliance of sphere and disc")
    table["slope"] = variable(("uncertain", "time"), slope, "1", "relative change of the contact radius with an input")
    coords = {"time": variable("time", time, "s", "time from the first point")}
    result = table_of(inputs).assign(table).assign_coords(coords | {name: steps[name] for name in ("load", "elapsed")})
    budget = json.dumps(uncertainty.budget_rows(sources))
    return result.assign_attrs(reference=reference, work=made.attrs["work"], budget=budget)  # reference: of Hertz

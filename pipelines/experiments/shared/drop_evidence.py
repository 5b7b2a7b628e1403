"""Nuisance parameters of a dropped sphere, measured by laser or in a film."""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification import Bounces, DropModel, Parameter, drop_evidence
from labpipe.report import display_unit
from labpipe.units import Quantity
from pipelines.experiments.shared import settings as given
from pipelines.experiments.shared.counter_body import counter_body_of, plate_inputs, resolve_plate
from pipelines.experiments.shared.material_choice import poissons_ratio
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance, of_poissons_ratio


def body(sphere: given.Sphere) -> dict[str, Parameter]:
    """Return mass and radius of a sphere by their role, where they are uncertain; equal spheres are one."""
    found: dict[str, Parameter] = {}
    for role, stated, text in (("mass", sphere.mass, "moving mass"), ("radius", sphere.radius, "radius of the sphere")):
        if stated.u > 0.0:
            shown = display_unit([stated.value], stated.si)
            name = f"{role} {stated.value / shown.factor:g} {shown.text}"
            found[role] = nuisance(name, stated.value, stated.u, stated.si, text)
    return found


def mean_height(name: str, stated: Quantity, heights: Floats) -> Parameter:
    """Return the mean height of the repeats: the stated one, as far as it is repeated."""
    spread = float(np.std(heights, ddof=1)) if heights.size > 1 else 0.0
    sd = float(np.hypot(stated.u, spread / np.sqrt(max(heights.size, 1))))
    if sd == 0.0:
        message = f'{name}: the height is stated without an uncertainty; write it as "{stated.value * 1e3:g} ± 0.01 mm"'
        raise InputError(message)
    return nuisance(f"{name} height", stated.value, sd, "m", "mean height of the drops")


def of_drop(
    name: str,
    settings: Any,
    seen: Bounces,
    unknowns: dict[str, Parameter],
    plate: xr.Dataset | None,
    file: Path | None,
    fitted: xr.Dataset | None,
) -> MaterialEvidence:
    """Return the evidence of a ball drop or a contact area, with the plate's mass among its unknowns.

    ``unknowns`` are known by their role, ``plate`` is the result that the settings name. Of the material that the
    session assumes, ``file`` or ``fitted``, only Poisson's ratio is used.
    """
    nu = poissons_ratio(settings.sphere, file, fitted)
    unknowns = dict(unknowns)
    for unknown in of_poissons_ratio(nu):
        unknowns["modulus"] = unknown
    floor = resolve_plate(settings.plate, plate)
    mass = plate_inputs(settings.plate, plate).get("mass")
    if mass is not None and mass.u > 0.0:
        unknowns["plate"] = nuisance("mass of the plate", mass.value, mass.u, "kg", "modal mass of the plate")
    names = {role: unknown.name for role, unknown in unknowns.items()}
    sphere, chosen, empty = settings.sphere, settings.model, np.empty(0, dtype=np.int64)
    fixed = (sphere.radius.value, sphere.mass.value, settings.height.value, chosen.gravity.value)
    flat = counter_body_of(settings.counter_body)
    model = DropModel(*fixed, empty, empty, empty, 0.0, 0.0, names, chosen.profile, floor, flat, chosen.rtol)
    evidence = drop_evidence(name, seen, model)
    return MaterialEvidence(nu.value, evidence.model.window, tuple(unknowns.values()), lambda rho: evidence)

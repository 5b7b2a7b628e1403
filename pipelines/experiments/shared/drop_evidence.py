"""Evidence of a dropped sphere on its material, measured by laser or in a film."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.errors import InputError
from labpipe.identification import Bounces, DropModel, Parameter, drop_evidence
from labpipe.report import display_unit
from pipelines.experiments.shared.counter_body import counter_body_of, plate_inputs, resolve_plate
from pipelines.experiments.shared.material_choice import poissons_ratio
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance, of_poissons_ratio

_NO_HEIGHT = '{}: the height is stated without an uncertainty; write it as "{:g} ± 0.01 mm"'


def of_drop(
    name: str,
    settings: Any,
    seen: Bounces,
    unknowns: dict[str, Parameter],
    plate: xr.Dataset | None,
    file: Path | None,
    fitted: xr.Dataset | None,
    heights: Sequence[float] = (),
) -> MaterialEvidence:
    """Return the evidence of a ball drop or a contact area.

    ``unknowns`` of the measurement are known by their role; mass and radius of the sphere and mass of the plate, where
    they are uncertain, and the mean height of the repeats join them: the stated one, as far as the ``heights`` repeat.
    ``plate`` is the result that the settings name. Of the material that the session assumes, ``file`` or ``fitted``,
    only Poisson's ratio is used.
    """
    sphere, chosen, height, empty = settings.sphere, settings.model, settings.height, np.empty(0, dtype=np.int64)
    unknowns, nu = dict(unknowns), poissons_ratio(sphere, file, fitted)
    for role, given, text in (("mass", sphere.mass, "moving mass"), ("radius", sphere.radius, "radius of the sphere")):
        if given.u > 0.0:  # equal spheres are one
            shown = display_unit([given.value], given.si)
            title = f"{role} {given.value / shown.factor:g} {shown.text}"
            unknowns[role] = nuisance(title, given.value, given.u, given.si, text)
    spread = float(np.std(heights, ddof=1)) if len(heights) > 1 else 0.0
    sd = float(np.hypot(height.u, spread / np.sqrt(max(len(heights), 1))))
    if sd == 0.0:
        raise InputError(_NO_HEIGHT.format(name, height.value * 1e3))
    unknowns["height"] = nuisance(f"{name} height", height.value, sd, "m", "mean height of the drops")
    for unknown in of_poissons_ratio(nu):
        unknowns["modulus"] = unknown
    mass = plate_inputs(settings.plate, plate).get("mass")
    if mass is not None and mass.u > 0.0:
        unknowns["plate"] = nuisance("mass of the plate", mass.value, mass.u, "kg", "modal mass of the plate")
    names = {role: unknown.name for role, unknown in unknowns.items()}
    fixed = (sphere.radius.value, sphere.mass.value, height.value, chosen.gravity.value)
    floor, flat = resolve_plate(settings.plate, plate), counter_body_of(settings.counter_body)
    model = DropModel(*fixed, empty, empty, empty, 0.0, 0.0, names, chosen.profile, floor, flat, chosen.rtol)
    evidence = drop_evidence(name, seen, model)
    return MaterialEvidence(nu.value, evidence.model.window, tuple(unknowns.values()), lambda rho: evidence)

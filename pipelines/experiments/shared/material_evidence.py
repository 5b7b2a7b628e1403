"""Data of one experiment for the identification of its material: those of a drop or a punch, and in general."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification import Bounces, DropModel, Evidence, Parameter, drop_evidence
from labpipe.report import display_unit
from labpipe.uncertainty import combined_uncertainty
from labpipe.units import Quantity
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.counter_body import counter_body_of, plate_inputs, resolve_plate
from pipelines.experiments.shared.material_choice import poissons_ratio
from pipelines.experiments.shared.punch_model import Geometry, relative_sources
from pipelines.experiments.shared.punch_settings import Indentation


@dataclass(frozen=True, eq=False)
class MaterialEvidence:
    """One experiment, ready to become evidence once the relaxation times are chosen.

    Attributes
    ----------
    nu : float
    window : tuple of float [s]
        Shortest and longest time on which it depends.
    unknowns : tuple of Parameter
        Its unknowns in addition to the material.
    build : callable
        Takes relaxation times (term,) and returns the evidence.
    """

    nu: float
    window: tuple[float, float]
    unknowns: tuple[Parameter, ...]
    build: Callable[[Floats], Evidence]


CONTACT_MODULUS = "Poisson's ratio"
"""Unknown of all contacts with a material, by its effect: E/(1 - nu^2) over that of the stated ratio."""


def of_poissons_ratio(nu: Quantity) -> list[Parameter]:
    """Return the unknown that an uncertain Poisson's ratio is; none where it is stated as exact."""
    relative = 2.0 * nu.value * nu.u / (1.0 - nu.value**2)
    text = "Poisson's ratio, by E/(1 - nu²) of a contact"
    return [nuisance(CONTACT_MODULUS, 1.0, relative, "1", text)] if relative > 0.0 else []


def nuisance(name: str, mean: float, sd: float, unit: str, text: str) -> Parameter:
    """Return an unknown of an experiment."""
    return Parameter(name, mean, sd, unit, text, is_nuisance=True)


def of_punch(
    settings: Indentation, loads: xr.Dataset, depth: float, file: Path | None, fitted: xr.Dataset | None
) -> tuple[Geometry, list[Parameter]] | str:
    """Return the punch, and its unknowns and those of cell and rubber, for a depth [m].

    Where session.toml does not state them it is a text. Of the material that the session assumes (``file``, ``fitted``)
    only Poisson's ratio is used.
    """
    if settings.punch is None or settings.substrate is None:
        return "session.toml names no punch and no substrate"
    if not np.isfinite(depth):
        return "first touch was not found"
    nu = poissons_ratio(settings.substrate, file, fitted)
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, nu.value)
    punch, gain = combined_uncertainty(relative_sources(depth, 0.0, geometry)), mach1_readings.relative_gain(loads)
    known = (
        ("punch", punch, "effect of the punch's dimensions on the force"),
        ("load cell", gain, "gain of the load cell"),
    )
    unknowns = of_poissons_ratio(nu) + [nuisance(name, 1.0, sd, "1", text) for name, sd, text in known if sd > 0.0]
    return geometry, unknowns


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
        text = f'write it as "{height.value * 1e3:g} ± 0.01 mm"'
        raise InputError(f"{name}: the height is stated without an uncertainty; {text}")
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

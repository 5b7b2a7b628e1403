"""Nuisance parameters of a dropped sphere, measured by laser or in a film."""

from pathlib import Path
from typing import Protocol

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.identification import Bounces, DropModel, Parameter, drop_evidence
from labpipe.report import display_unit
from labpipe.units import Quantity
from pipelines.experiments.shared import settings as given
from pipelines.experiments.shared.material_choice import poissons_ratio
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance, of_poissons_ratio
from pipelines.experiments.shared.plate_under_drop import plate_inputs, resolve_plate


class Drop(Protocol):
    """Settings of a drop, whatever saw it."""

    @property
    def height(self) -> Quantity:
        """The fall."""

    @property
    def sphere(self) -> given.Sphere:
        """The falling body."""

    @property
    def plate(self) -> given.Plate | None:
        """The floor."""

    @property
    def model(self) -> given.DropModel:
        """Its simulation."""


def body(sphere: given.Sphere) -> tuple[dict[str, str], list[Parameter]]:
    """Return mass and radius of a sphere; equal spheres are one."""
    names, unknowns = {}, []
    for role, stated, text in (("mass", sphere.mass, "moving mass"), ("radius", sphere.radius, "radius of the sphere")):
        if stated.u > 0.0:
            shown = display_unit([stated.value], stated.si)
            names[role] = f"{role} {stated.value / shown.factor:g} {shown.text}"
            unknowns.append(nuisance(names[role], stated.value, stated.u, stated.si, text))
    return names, unknowns


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
    settings: Drop,
    seen: Bounces,
    names: dict[str, str],
    unknowns: list[Parameter],
    plate: xr.Dataset | None,
    file: Path | None,
    fitted: xr.Dataset | None,
) -> MaterialEvidence:
    """Return the evidence of a drop, with the plate's mass among its unknowns.

    ``names`` are those of the unknowns by their role, ``plate`` is the result that the settings name. Of the material
    that the session assumes, ``file`` or ``fitted``, only Poisson's ratio is used.
    """
    nu = poissons_ratio(settings.sphere, file, fitted)
    for unknown in of_poissons_ratio(nu):
        names["modulus"] = unknown.name
        unknowns.append(unknown)
    model = _model(settings, plate, names, unknowns)
    evidence = drop_evidence(name, seen, model)
    return MaterialEvidence(nu.value, evidence.model.window, tuple(unknowns), lambda rho: evidence)


def _model(settings: Drop, found: xr.Dataset | None, names: dict[str, str], unknowns: list[Parameter]) -> DropModel:
    plate = resolve_plate(settings.plate, found)
    mass = plate_inputs(settings.plate, found).get("mass")
    if plate is not None and mass is not None and mass.u > 0.0:
        names["plate"] = "mass of the plate"
        unknowns.append(nuisance(names["plate"], plate.mass, mass.u, "kg", "modal mass of the plate"))
    empty = np.empty(0, dtype=np.int64)
    return DropModel(
        settings.sphere.radius.value,
        settings.sphere.mass.value,
        settings.height.value,
        settings.model.gravity.value,
        empty,
        empty,
        empty,
        0.0,
        0.0,
        names,
        settings.model.profile,
        plate,
        settings.model.rtol,
    )

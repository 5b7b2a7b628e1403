"""Data of one experiment for the identification of its material."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.identification import Evidence, Parameter
from labpipe.uncertainty import combined_uncertainty
from labpipe.units import Quantity
from pipelines.experiments.shared import mach1_readings
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

"""Nuisance parameters common to relaxation and oscillation under one punch."""

from pathlib import Path

import xarray as xr

from labpipe.identification import Parameter
from labpipe.uncertainty import combined_uncertainty
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.material_choice import poissons_ratio
from pipelines.experiments.shared.material_evidence import nuisance, of_poissons_ratio
from pipelines.experiments.shared.punch_model import Geometry, relative_sources
from pipelines.experiments.shared.punch_settings import Indentation

SHIFT = 1e-7
"""m of first touch by which a derivative is found."""

FILTER = nuisance("filter", 0.0, 1.0, "1", "delay of the cell's filter, in units of its uncertainty")
"""One cell tests all specimens of a session: relaxation and oscillation share its filter."""


def of_punch(
    settings: Indentation, loads: xr.Dataset, depth: float, file: Path | None, fitted: xr.Dataset | None
) -> tuple[Geometry, list[Parameter]] | str:
    """Return the punch, and its unknowns and those of cell and rubber, for a depth [m].

    Where session.toml does not state them it is a text. Of the material that the session assumes (``file``, ``fitted``)
    only Poisson's ratio is used.
    """
    if settings.punch is None or settings.substrate is None:
        return "session.toml names no punch and no substrate"
    nu = poissons_ratio(settings.substrate, file, fitted)
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, nu.value)
    punch, gain = combined_uncertainty(relative_sources(depth, 0.0, geometry)), mach1_readings.relative_gain(loads)
    known = (
        ("punch", punch, "effect of the punch's dimensions on the force"),
        ("load cell", gain, "gain of the load cell"),
    )
    unknowns = of_poissons_ratio(nu) + [nuisance(name, 1.0, sd, "1", text) for name, sd, text in known if sd > 0.0]
    return geometry, unknowns

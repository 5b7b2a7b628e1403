"""Nuisance parameters common to relaxation and oscillation under one punch."""

from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from labpipe.identification import Parameter
from labpipe.uncertainty import combined_uncertainty
from pipelines.experiments.shared import ramps_and_holds
from pipelines.experiments.shared.material_choice import poissons_ratio
from pipelines.experiments.shared.material_evidence import nuisance, of_poissons_ratio
from pipelines.experiments.shared.punch_model import Geometry, relative_sources
from pipelines.experiments.shared.punch_settings import Indentation

SHIFT = 1e-7
"""m of first touch by which a derivative is found."""

FILTER = nuisance("filter", 0.0, 1.0, "1", "delay of the cell's filter, in units of its uncertainty")
"""One cell tests all specimens of a session: relaxation and oscillation share its filter."""


@dataclass(frozen=True, eq=False)
class PunchEvidence:
    """Evidence common to relaxation and harmonic indentation."""

    geometry: Geometry
    nu: float
    unknowns: list[Parameter]
    factors: tuple[str, ...]


def of_punch(
    settings: Indentation, loads: xr.Dataset, depth: float, file: Path | None, fitted: xr.Dataset | None
) -> PunchEvidence | str:
    """Return it for the settings of an indentation and a depth [m]; a text where session.toml does not state it.

    Of the material that the session assumes (``file``, ``fitted``) only Poisson's ratio is used.
    """
    if settings.punch is None or settings.substrate is None:
        return "session.toml names no punch and no substrate"
    nu = poissons_ratio(settings.substrate, file, fitted)
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, nu.value)
    punch, gain = combined_uncertainty(relative_sources(depth, 0.0, geometry)), ramps_and_holds.relative_gain(loads)
    known = (
        ("punch", punch, "effect of the punch's dimensions on the force"),
        ("load cell", gain, "gain of the load cell"),
    )
    unknowns = of_poissons_ratio(nu) + [nuisance(name, 1.0, sd, "1", text) for name, sd, text in known if sd > 0.0]
    return PunchEvidence(geometry, nu.value, unknowns, tuple(unknown.name for unknown in unknowns))

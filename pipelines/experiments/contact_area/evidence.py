"""Contact radii from a film, as data for identification."""

from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.identification import Bounces
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance, of_drop


def evidence(
    film: xr.Dataset,
    made: xr.Dataset,
    plate: xr.Dataset | None,
    file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: ContactArea,
    name: str,
    impacts: int,
    least: float = 5e-4,
) -> MaterialEvidence | str:
    """Gather the largest contact radii of a film, which are known to the ``least`` share at best."""
    count = min(impacts, made.sizes["impact"])
    if not count:
        return "no impact was seen in the film"
    relative = float(film.attrs["u_systematic_relative"])
    radius, whole = (made[of].values[:count] for of in ("peak_radius", "u_peak_radius"))
    u = np.sqrt(np.maximum(whole**2 - (relative * radius) ** 2, (least * radius) ** 2))
    scale, none = nuisance(f"{name} scale", 1.0, relative, "1", "scale of the film"), np.full(count, np.nan)
    seen = Bounces(none, none, none, none, radius, u)
    return of_drop(name, settings, seen, {"pixel": scale}, plate, file, fitted)

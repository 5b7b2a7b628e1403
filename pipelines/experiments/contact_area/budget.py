"""Budgets of a film of the contact: the largest radii, and the model's."""

from collections.abc import Iterator
from functools import partial
from math import pi

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.contact_area.comparison import largest_radii
from pipelines.experiments.shared.budget_quantity import Quantity, of_simulation, product
from pipelines.experiments.shared.comparison_rows import IMPACTS


def quantities(
    impacts: xr.Dataset, radius: xr.Dataset, model: xr.Dataset | None = None, comparison: xr.Dataset | None = None
) -> Iterator[Quantity]:
    """Yield the largest contact radii of the first impacts; with a model the areas, and its first one.

    Fringes show the Hertz-equivalent radius, that of the model; the area is that within the edge.
    """
    size, u_size = float(radius["pixel_size"]), float(radius["u_pixel_size"])
    shares = _shared(radius)
    total = float(np.sqrt(sum(share**2 for share in shares.values())))
    # rings in pixels of another size are taken for those of another gap, too
    power = shares["pixel_size"] * size / u_size if u_size > 0.0 else 1.0

    found = [values[:IMPACTS].tolist() for values in largest_radii(impacts, comparison)]
    for i, (largest, u) in enumerate(zip(*found, strict=True)):
        is_alone = u == float(impacts["u_peak_radius"][i])  # the model gives the course between the frames
        sampling = float(impacts["peak_sampling"][i]) if is_alone else 0.0
        errors = {"noise": excess_uncertainty(u, total * largest, sampling), "sampling": sampling}
        errors |= {n: share * largest for n, share in shares.items() if n not in ("pixel_size", "adhesion")}
        own = {n: Input(0.0, error) for n, error in errors.items()}
        scale = {"pixel_size": (Input(size, u_size, "m/px"), power)}
        yield product(f"largest contact radius, impact {i + 1}", "m", largest, scale, own)
        if model is not None and i < model.sizes["impact"]:
            own["adhesion"] = Input(float(model["adhesion_shift"][i]), float(model["u_adhesion_shift"][i]))
            edge = product("", "m", largest, scale, own)
            area = partial(lambda of_edge, **inputs: pi * of_edge(**inputs) ** 2, edge.model)
            yield Quantity(f"largest contact area, impact {i + 1}", "m2", area, edge.inputs)
    yield from of_simulation("largest contact radius of the model, impact 1", model, "peak_contact_radius")


def _shared(film: xr.Dataset) -> dict[str, float]:
    """Return the uncertainties that all frames share, relative to the radius, by source; their sum is the film's."""
    radius = film["radius"].values
    whole = film["radius_systematic"].values / radius
    total = float(np.nanmedian(whole)) if np.isfinite(whole).any() else 0.0
    parts = {str(name): film["systematic_part"].sel(source=name).values / radius for name in film["source"].values}
    medians = {n: float(np.nanmedian(p)) if np.isfinite(p).any() else 0.0 for n, p in parts.items()}
    found = float(np.sqrt(sum(m**2 for m in medians.values())))
    names = {"phase": "phase_of_the_light"}
    return {names.get(n, n): m * total / found if found else 0.0 for n, m in medians.items()}

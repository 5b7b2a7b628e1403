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
    # what all frames share, relative to the radius: the film's, in parts by their sources
    parts = {str(name): radius["systematic_part"].sel(source=name) for name in radius["source"].values}
    *each, total = (
        float(np.nanmedian(ratio)) if np.isfinite(ratio := part.values / radius["radius"].values).any() else 0.0
        for part in (*parts.values(), radius["radius_systematic"])
    )
    found = float(np.linalg.norm(each))
    total = total if found else 0.0
    shares = {n: part * total / (found or 1.0) for n, part in zip(parts, each, strict=True)}
    # rings in pixels of another size are taken for those of another gap, too
    power = shares["pixel_size"] * size / u_size if u_size > 0.0 else 1.0

    peaks = [values[:IMPACTS].tolist() for values in largest_radii(impacts, comparison)]
    for i, (largest, u) in enumerate(zip(*peaks, strict=True)):
        is_alone = u == float(impacts["u_peak_radius"][i])  # the model gives the course between the frames
        sampling = float(impacts["peak_sampling"][i]) if is_alone else 0.0
        errors = {"noise": excess_uncertainty(u, total * largest, sampling), "sampling": sampling}
        errors |= {n: share * largest for n, share in shares.items() if n not in ("pixel_size", "adhesion")}
        own = {"phase_of_the_light" if n == "phase" else n: Input(0.0, error) for n, error in errors.items()}
        scale = {"pixel_size": (Input(size, u_size, "m/px"), power)}
        yield product(f"largest contact radius, impact {i + 1}", "m", largest, scale, own)
        if model is not None and i < model.sizes["impact"]:
            own["adhesion"] = Input(float(model["adhesion_shift"][i]), float(model["u_adhesion_shift"][i]))
            edge = product("", "m", largest, scale, own)
            area = partial(lambda of_edge, **inputs: pi * of_edge(**inputs) ** 2, edge.model)
            yield Quantity(f"largest contact area, impact {i + 1}", "m2", area, edge.inputs)
    yield from of_simulation("largest contact radius of the model, impact 1", model, "peak_contact_radius")

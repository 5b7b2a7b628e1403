"""Budgets of a static loading: approach and contact radius under the last load, and the model's."""

from collections.abc import Iterator
from math import inf, sqrt

import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared.budget_quantity import Quantity, of_laser, of_simulation, product
from pipelines.experiments.static_loading.settings import StaticLoading


def quantities(
    displacement: xr.Dataset,
    steps: xr.Dataset,
    approach: xr.Dataset,
    model: xr.Dataset | None = None,
    *,
    settings: StaticLoading,
) -> Iterator[Quantity]:
    """Yield approach and contact radius under the last load, and the model's radius."""
    depth = float(approach["level_approach"][-1])
    along, by_loads = of_laser(displacement), float(steps["touch_part_of_loads"])
    errors = {
        "drift": settings.steps.drift.value,
        "first_touch": excess_uncertainty(float(steps["u_touch"]), by_loads),
        "mass_of_the_loads": by_loads,
    }
    own, rest = {name: Input(0.0, u) for name, u in errors.items()}, float(approach["u_level_approach"][-1])
    of_depth = product("approach under the last load", "m", depth, along, own, rest=("noise", rest, inf))
    yield of_depth

    def contact_radius(radius: float, **rest: float) -> float:
        return sqrt(max(radius * of_depth.model(**rest), 0.0))

    if depth > 0.0:
        ball = {"radius": Input(*settings.sphere.radius)}
        yield Quantity("contact radius under the last load", "m", contact_radius, ball | of_depth.inputs)
    yield from of_simulation("contact radius of the model under the last load", model, "contact_radius", -1)

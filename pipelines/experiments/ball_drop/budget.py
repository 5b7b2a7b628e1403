"""Budgets of a ball drop: height, speed, restitution, and the model's."""

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input
from pipelines.experiments.shared.budget_quantity import (
    Factor,
    Quantity,
    clock,
    of_laser,
    of_simulation,
    product,
    repeats,
)
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.pages import present


def quantities(
    bounces: Sequence[xr.Dataset | None], displacement: Sequence[xr.Dataset | None], model: xr.Dataset | None = None
) -> Iterator[Quantity]:
    """Yield drop height, speed of the first impact, and restitutions of the first ones, the model's first one too."""
    made, moved = present(bounces), present(displacement)[0]
    relative, scale = float(moved.attrs["u_systematic_relative"]), of_laser(moved)
    yield product("height of the fall", "m", *_read(made, "drop_height", 0, relative, scale))
    times = {"clock": (clock(moved), -1.0)}
    yield product("speed of the first impact", "m/s", *_read(made, "incoming_speed", 0, relative, scale | times))
    for i in range(min(IMPACTS, *(b.sizes["impact"] for b in made))):
        found = _read(made, "restitution", i, 0.0, {})  # a ratio of speeds has no scale
        if np.isfinite(found[0]):
            yield product(f"restitution, impact {i + 1}", "1", *found)
    yield from of_simulation("restitution of the model, impact 1", model, "restitution")


def _read(
    made: Sequence[xr.Dataset], name: str, impact: int, relative: float, scale: dict[str, Factor]
) -> tuple[float, dict[str, Factor], dict[str, Input]]:
    """Return the mean of the repeats, its scale, and its errors by noise, repeatability and shape of the pulse."""
    values, u, shared = (
        np.array([float(np.atleast_1d(b[key].values)[impact]) if key in b else 0.0 for b in made])
        for key in (name, f"u_{name}", f"shared_u_{name}")
    )
    pulse = float(np.sqrt(np.mean(shared**2)))
    noise, scatter = repeats(values, np.sqrt(np.maximum(u**2 - (relative * values) ** 2 - pulse**2, 0.0)))
    return float(values.mean()), scale, {"noise": noise, "repeatability": scatter, "pulse_shape": Input(0.0, pulse)}

"""Budgets of a ball drop: height, speed, restitution, and the model's."""

from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input
from pipelines.experiments.shared.budget_quantity import (
    MEASURED,
    Quantity,
    clock,
    of_laser,
    of_simulation,
    repeats,
    summed,
)
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.pages import present


def quantities(
    bounces: Sequence[xr.Dataset | None], displacement: Sequence[xr.Dataset | None], model: xr.Dataset | None = None
) -> Iterator[Quantity]:
    """Yield drop height, speed of the first impact, and restitutions of the first ones, the model's first one too."""
    made, moved = present(bounces), present(displacement)[0]
    relative = float(moved.attrs["u_systematic_relative"])
    for name, title, unit in (
        ("drop_height", "height of the fall", "m"),
        ("incoming_speed", "speed of the first impact", "m/s"),
    ):
        mean, errors = _read(made, name, unit, 0, relative)
        along, inputs = of_laser(moved, mean, unit)
        times = {} if unit == "m" else {"clock": clock(moved)}
        yield Quantity(title, unit, along, inputs | errors | times)
    for i in range(min(IMPACTS, *(b.sizes["impact"] for b in made))):
        mean, errors = _read(made, "restitution", "1", i, 0.0)  # a ratio of speeds has no scale
        if np.isfinite(mean):
            inputs = {MEASURED: Input(mean, 0.0), **errors}
            yield Quantity(f"restitution, impact {i + 1}", "1", summed, inputs, family="restitution")
    yield from of_simulation("restitution of the model, impact 1", model, "restitution")


def _read(
    made: Sequence[xr.Dataset], name: str, unit: str, impact: int, relative: float
) -> tuple[float, dict[str, Input]]:
    """Return the mean of the repeats, and its errors by noise, repeatability and the shape of the pulse they share."""
    values, u, shared = (
        np.array([float(np.atleast_1d(b[key].values)[impact]) if key in b else 0.0 for b in made])
        for key in (name, f"u_{name}", f"shared_u_{name}")
    )
    pulse = float(np.sqrt(np.mean(shared**2)))
    noise, scatter = repeats(values, np.sqrt(np.maximum(u**2 - (relative * values) ** 2 - pulse**2, 0.0)))
    errors = {"noise": noise, "repeatability": scatter, "pulse_shape": Input(0.0, pulse)}
    return float(values.mean()), {key: each._replace(unit=unit) for key, each in errors.items()}

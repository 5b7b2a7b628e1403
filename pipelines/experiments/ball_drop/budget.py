"""Budgets of a ball drop: height, speed, restitution, and the model's."""

import json
from collections.abc import Iterator, Sequence
from math import cos

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input
from pipelines.experiments.shared.budget_quantity import (
    IMPACTS,
    MEASURED,
    Quantity,
    clock,
    model_quantity,
    repeats,
    summed,
)
from pipelines.experiments.shared.pages import present

_INERT = (
    ("pixel size", "there is no camera"),
    ("filter lag", "the moving average of the sensor delays all readings equally"),
    (
        "mass, radius, Poisson's ratio, temperature",
        "they affect the model; the masses of body and plate act on the pulse by the row of its shape",
    ),
    ("zero", "a difference of two readings has none"),
    ("height", "that of session.toml enters only the model"),
)
_LEVELS = ("sampling", "levels are fitted and do not depend on time")
_RATIO = ("inclination, sampling", "common to both speeds, so that the scales of length and time cancel")


def quantities(
    bounces: Sequence[xr.Dataset | None], displacement: Sequence[xr.Dataset | None], model: xr.Dataset | None = None
) -> Iterator[Quantity]:
    """Yield drop height, speed of the first impact, and restitutions of the first ones, the model's first one too."""
    made, moved = present(bounces), present(displacement)[0]
    tilt = Input(float(moved["inclination"]), float(moved["u_inclination"]), "rad")
    gain = Input(float(moved["gain"]), float(moved["u_gain"]))
    relative = float(moved.attrs["u_systematic_relative"])

    along = cos(tilt.value) / gain.value  # of a true length, as it is read
    for name, title, unit, times in (
        ("drop_height", "height of the fall", "m", {}),
        ("incoming_speed", "speed of the first impact", "m/s", {"clock": clock(moved)}),
    ):
        read = _read(made, name, unit, 0, relative)
        inputs = read | {MEASURED: Input(read[MEASURED].value * along, 0.0, unit), "gain": gain, "inclination": tilt}
        yield Quantity(title, unit, _along_motion, inputs | times, _INERT if times else (*_INERT, _LEVELS))
    for i in range(min(IMPACTS, *(b.sizes["impact"] for b in made))):
        inputs = _read(made, "restitution", "1", i, 0.0)
        if np.isfinite(inputs[MEASURED].value):
            yield Quantity(f"restitution, impact {i + 1}", "1", summed, inputs, (*_INERT, _RATIO), "restitution")
    if model is not None and model.sizes["impact"] and "budget" in model.attrs:
        asked = ("mass", "radius", "height", "Poisson's ratio", "temperature")
        best, sources = float(model["restitution"][0]), json.loads(model.attrs["budget"])
        yield model_quantity("restitution of the model, impact 1", best, "1", sources, asked)


def _along_motion(
    measured: float,
    gain: float,
    inclination: float,
    noise: float,
    repeatability: float,
    pulse_shape: float,
    clock: float = 1.0,
) -> float:
    return (measured + noise) * gain / cos(inclination) / clock + repeatability + pulse_shape


def _read(made: Sequence[xr.Dataset], name: str, unit: str, impact: int, relative: float) -> dict[str, Input]:
    """Return the mean of the repeats, and its noise, repeatability and the shape of the pulse that they share.

    ``relative`` is the uncertainty of the scale, which the repeats' own contains.
    """
    values, u, shared = (
        np.array([float(np.atleast_1d(b[key].values)[impact]) if key in b else 0.0 for b in made])
        for key in (name, f"u_{name}", f"shared_u_{name}")
    )
    pulse = float(np.sqrt(np.mean(shared**2)))
    noise, scatter = repeats(values, np.sqrt(np.maximum(u**2 - (relative * values) ** 2 - pulse**2, 0.0)))
    inputs = {
        MEASURED: Input(float(values.mean()), 0.0),
        "noise": noise,
        "repeatability": scatter,
        "pulse_shape": Input(0.0, pulse),
    }
    return {key: each._replace(unit=unit) for key, each in inputs.items()}

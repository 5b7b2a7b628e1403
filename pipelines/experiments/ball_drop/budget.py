"""Budgets of a ball drop, heated or not: height, speed, restitution, and the model's."""

import json
from collections.abc import Iterator, Sequence
from math import cos

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
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

_CAMERA = ("pixel size", "there is no camera")
_LAG = ("filter lag", "the moving average of the sensor delays all readings equally")
_MODEL = (
    "mass, radius, Poisson's ratio, temperature",
    "they affect the model; what the masses of body and plate tell of the pulse stands in the row of its shape",
)
_ZERO = ("zero", "a difference of two readings has none")
_HEIGHT = ("height", "that of session.toml enters only the model")
_RATIO = ("inclination, sampling", "common to both speeds, so that the scales of length and time cancel")


def quantities(
    bounces: Sequence[xr.Dataset | None], displacement: Sequence[xr.Dataset | None], model: xr.Dataset | None = None
) -> Iterator[Quantity]:
    """Yield drop height, speed of the first impact, and restitutions of the first ones, the model's first one too."""
    made, moved = present(bounces), present(displacement)
    yield _fall(made, moved[0])
    yield _speed(made, moved[0])
    for i in range(min(IMPACTS, *(b.sizes["impact"] for b in made))):
        yield from _restitution(made, i)
    if model is not None and model.sizes["impact"] and "budget" in model.attrs:
        inputs = ("mass", "radius", "height", "Poisson's ratio", "temperature")
        best, sources = float(model["restitution"][0]), json.loads(model.attrs["budget"])
        yield model_quantity("restitution of the model, impact 1", best, "1", sources, inputs)


def _fall(made: list[xr.Dataset], moved: xr.Dataset) -> Quantity:
    inputs, _ = _along(made, moved, "drop_height", "m")
    return Quantity(
        "height of the fall",
        "m",
        lambda measured, gain, inclination, noise, repeatability, pulse_shape: (
            (measured + noise) * gain / cos(inclination) + repeatability + pulse_shape
        ),
        inputs,
        (_CAMERA, _ZERO, ("sampling", "levels are fitted and do not depend on time"), _LAG, _MODEL, _HEIGHT),
    )


def _speed(made: list[xr.Dataset], moved: xr.Dataset) -> Quantity:
    inputs, _ = _along(made, moved, "incoming_speed", "m/s")
    return Quantity(
        "speed of the first impact",
        "m/s",
        lambda measured, gain, inclination, noise, repeatability, pulse_shape, clock: (
            (measured + noise) * gain / cos(inclination) / clock + repeatability + pulse_shape
        ),
        inputs | {"clock": clock(moved)},
        (_CAMERA, _ZERO, _LAG, _MODEL, _HEIGHT),
    )


def _along(made: list[xr.Dataset], moved: xr.Dataset, name: str, unit: str) -> tuple[dict[str, Input], Floats]:
    """Return the inputs of what goes with the scale of the laser, and the repeats."""
    tilt = Input(float(moved["inclination"]), float(moved["u_inclination"]), "rad")
    gain = Input(float(moved["gain"]), float(moved["u_gain"]))
    relative = float(moved.attrs["u_systematic_relative"])
    values, u = (np.array([float(np.atleast_1d(b[n].values)[0]) for b in made]) for n in (name, f"u_{name}"))
    shape = _pulse_shape(made, name, 0)
    own = np.sqrt(np.maximum(u**2 - (relative * values) ** 2 - shape.u**2, 0.0))
    noise, scatter = repeats(values, own)
    along = float(values.mean()) * cos(tilt.value) / gain.value
    return {
        MEASURED: Input(along, 0.0, unit),
        "gain": gain,
        "inclination": tilt,
        "noise": noise._replace(unit=unit),
        "repeatability": scatter._replace(unit=unit),
        "pulse_shape": shape._replace(unit=unit),
    }, values


def _restitution(made: list[xr.Dataset], impact: int) -> Iterator[Quantity]:
    values = np.array([float(b["restitution"][impact]) for b in made])
    own = np.array([float(b["u_restitution"][impact]) for b in made])
    if not np.isfinite(values).all():
        return
    shape = _pulse_shape(made, "restitution", impact)
    noise, scatter = repeats(values, np.sqrt(np.maximum(own**2 - shape.u**2, 0.0)))
    yield Quantity(
        f"restitution, impact {impact + 1}",
        "1",
        summed,
        {MEASURED: Input(float(values.mean()), 0.0), "noise": noise, "repeatability": scatter, "pulse_shape": shape},
        (_RATIO, _CAMERA, _ZERO, _LAG, _MODEL, _HEIGHT),
        "restitution",
    )


def _pulse_shape(made: list[xr.Dataset], name: str, impact: int) -> Input:
    """Return what the unknown shape of the contact's pulse leaves, in all repeats alike."""
    if f"shared_u_{name}" not in made[0]:
        return Input(0.0, 0.0)
    shared = np.array([float(b[f"shared_u_{name}"][impact]) for b in made])
    return Input(0.0, float(np.sqrt(np.mean(shared**2))))

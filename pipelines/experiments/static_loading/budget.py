"""Budgets of a static loading: approach and contact radius under the last load, and the model's."""

import json
from collections.abc import Iterator
from dataclasses import replace
from math import cos, sqrt

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.shared.budget_quantity import MEASURED, Quantity, model_quantity
from pipelines.experiments.static_loading.load_steps import touch_apart
from pipelines.experiments.static_loading.settings import StaticLoading

_BOTH = (
    ("pixel size, height", "there is no camera and nothing falls"),
    ("filter lag, sampling", "a level is the mean over a minute of slow creep"),
    ("Poisson's ratio, temperature", "the sphere was measured at its temperature; they affect the model"),
    ("repeatability", "the loads are applied once"),
)
_GIVEN = ("mass", "first touch is given in session.toml, not found from the loads")


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
    angle = float(displacement["inclination"])
    gain = Input(1.0, float(displacement["u_gain"]) / float(displacement["gain"]))
    tilt = Input(angle, float(displacement["u_inclination"]), "rad")
    by_loads = float(steps["touch_part_of_loads"])
    of_touch, by_drift = touch_apart(steps)
    touch = Input(0.0, excess_uncertainty(of_touch, by_loads), "m")
    drift = Input(0.0, abs(settings.steps.drift.value - by_drift), "m")
    scale = depth * float(np.hypot(gain.u, np.tan(angle) * tilt.u))
    noise = excess_uncertainty(float(approach["u_level_approach"][-1]), scale, touch.u, by_loads, drift.u)

    def moved(
        measured: float,
        gain: float,
        inclination: float,
        noise: float,
        drift: float,
        first_touch: float,
        mass_of_the_loads: float,
    ) -> float:
        along = (measured * gain) * cos(angle) / cos(inclination)
        return along + noise + drift - first_touch - mass_of_the_loads

    inputs = {
        MEASURED: Input(depth, 0.0, "m"),
        "gain": gain,
        "inclination": tilt,
        "noise": Input(0.0, noise, "m"),
        "drift": drift,
        "first_touch": touch,
        "mass_of_the_loads": Input(0.0, by_loads, "m"),
    }
    asked = (*_BOTH, *((_GIVEN,) if settings.zero is not None else ()))
    yield Quantity(
        "approach under the last load", "m", moved, inputs, (("radius", "it affects only the contact radius"), *asked)
    )
    ball = settings.sphere.radius
    if depth > 0.0:
        yield Quantity(
            "contact radius under the last load",
            "m",
            lambda radius, **rest: sqrt(max(radius * moved(**rest), 0.0)),
            {"radius": Input(ball.value, ball.u, "m"), **inputs},
            asked,
        )
    if model is not None and "budget" in model.attrs:
        title, names = "contact radius of the model under the last load", ("radius", "Poisson's ratio", "temperature")
        best, sources = float(model["contact_radius"][-1]), json.loads(model.attrs["budget"])
        found = model_quantity(title, best, "m", sources, names)
        yield replace(found, inert=(*found.inert, ("height", "nothing falls")))

"""A reported quantity as a formula of its uncertain inputs, and helpers for such formulas.

Nothing counts twice: noise is estimated from the readings, and repeatability from the scatter of repeats beyond it,
type A with n − 1 degrees of freedom.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import cos, sqrt
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.uncertainty import Input, Model, excess_uncertainty, linear_budget, scatter_beyond
from pipelines.experiments.shared.comparison_rows import IMPACTS

TESTS = IMPACTS
"""Depths or frequencies of an indentation that are shown, as many as impacts of a drop."""

Factor = tuple[Input, float | Callable[[float], float]]
"""An input to which a quantity goes with a power, or by a function of it that is 1 at its value."""

MEASURED = "measured"
"""Name of the input that is the result as read; its uncertainty is in the others."""


@dataclass(frozen=True, eq=False)
class Quantity:
    """One reported quantity as a formula of uncertain inputs.

    ``name``, ``unit``; ``model``: takes every input by its name; ``inputs``.
    """

    name: str
    unit: str
    model: Model
    inputs: dict[str, Input]

    @property
    def family(self) -> str:
        """The name without impact, test, or place: that of quantities of the same sense."""
        return re.sub(r",? (impact|test|at) .*", "", self.name)


def repeats(values: Floats, own: Floats) -> tuple[Input, Input]:
    """Return the uncertainty that repeats state, averaged, and their scatter beyond it and chance."""
    n = values.size
    stated = float(np.sqrt(np.mean(own**2)))
    if n < 2:
        return Input(0.0, stated), Input(0.0, 0.0)
    beyond = float(scatter_beyond(np.std(values, ddof=1), stated, n))
    return Input(0.0, stated / sqrt(n)), Input(0.0, beyond / sqrt(n), degrees_of_freedom=n - 1)


def clock(displacement: xr.Dataset) -> Input:
    """Return the sensor's clock over the true one; one that nobody compared is assumed."""
    return Input(1.0, float(json.loads(displacement.attrs["time_base"])["u_relative"]))


def product(
    name: str,
    unit: str,
    value: float,
    factors: Mapping[str, Factor] = MappingProxyType({}),
    errors: Mapping[str, Input] = MappingProxyType({}),
    rest: tuple[str, float, float] | None = None,
) -> Quantity:
    """Return a quantity that goes with powers of its ``factors``, and has ``errors`` of its own unit.

    The ``rest`` is one more error: its name, the uncertainty of the whole, of which the others are a part, and its
    degrees of freedom.
    """

    def model(**inputs: float) -> float:
        made = value
        for key, (given, power) in factors.items():
            made *= power(inputs[key]) if callable(power) else (inputs[key] / given.value) ** power
        return made + sum(error for key, error in inputs.items() if key not in factors)

    inputs = {key: given for key, (given, _) in factors.items()}
    inputs |= {key: one._replace(unit=unit) for key, one in errors.items()}
    if rest is not None:
        left = excess_uncertainty(rest[1], linear_budget(model, inputs).u if inputs else 0.0)
        inputs[rest[0]] = Input(0.0, left, unit, rest[2])
    return Quantity(name, unit, model, inputs)


def of_laser(displacement: xr.Dataset, power: float = 1.0) -> dict[str, Factor]:
    """Return the sensor's scale, to which a length or speed along the motion goes with a power."""
    angle, u_gain = float(displacement["inclination"]), float(displacement["u_gain"]) / float(displacement["gain"])
    tilt = Input(angle, float(displacement["u_inclination"]), "rad")
    return {
        "gain": (Input(1.0, u_gain), power),
        "inclination": (tilt, lambda inclination: (cos(angle) / cos(inclination)) ** power),
    }


def of_simulation(name: str, model: xr.Dataset | None, variable: str, at: int = 0) -> Iterator[Quantity]:
    """Yield a value of a simulation by its stored budget, where there is one."""
    if model is not None and "budget" in model.attrs and model[variable].size:
        value, unit = float(model[variable][at]), str(model[variable].attrs["units"])
        yield model_quantity(name, value, unit, json.loads(model.attrs["budget"]))


def model_quantity(name: str, value: float, unit: str, rows: Sequence[Mapping[str, Any]]) -> Quantity:
    """Return a result of a model, of which only the sensitivities are known.

    Rows are those of :func:`labpipe.uncertainty.budget_rows`.
    """
    given = {str(r["source"]).replace(" ", "_"): r for r in rows}

    def model(measured: float, **inputs: float) -> float:
        return measured + sum(r["sensitivity"] * (inputs[n] - r["value"]) for n, r in given.items())

    inputs = {MEASURED: Input(value, 0.0, unit)}
    inputs |= {n: Input(r["value"], r["u"], r["unit"]) for n, r in given.items()}
    return Quantity(name, unit, model, inputs)

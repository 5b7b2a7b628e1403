"""One record of a drop as it was measured, and the acceleration with which it falls."""

from dataclasses import dataclass
from math import floor, isfinite, log10
from typing import Any

import xarray as xr

from labpipe.judging import Check, stated
from labpipe.report import quantity, value_with_uncertainty
from labpipe.units import Quantity

_ON_GROUND = (9.76, 9.84)  # m/s²: from the equator's mountains to the poles, by the International Gravity Formula


@dataclass(frozen=True, slots=True)
class Fall:
    """One record of a drop as it was measured.

    ``name`` is its file, for messages; ``bounces`` as :func:`labpipe.signals.bounces` returns them; ``relative`` the
    relative standard uncertainty of its scale of length.
    """

    name: str
    bounces: xr.Dataset
    relative: float

    def values(self, name: str) -> Any:
        """Return a quantity as its plain array: a DataArray takes longer to make than most checks to compute."""
        return self.bounces.variables[name].values

    def value(self, name: str, impact: int | None = None) -> tuple[float, float]:
        """Return a quantity with the standard uncertainty of the record alone."""
        values, u = self.values(name), self.values(f"u_{name}")
        if impact is None:
            return float(values), float(u)
        return float(values[impact]), float(u[impact])


def shown(value: float, u: float, unit: str) -> str:
    """Write a value with its uncertainty."""
    return value_with_uncertainty(value, u, unit) if isfinite(u) and u > 0 else quantity(value, unit)


def matched(value: float, u: float, unit: str) -> str:
    """Write a value with the digits of another one whose standard uncertainty is u, to compare both.

    Examples
    --------
    >>> matched(9.81, 5e-4, "m/s2")
    '9.8100 m/s²'
    """
    if not (value and isfinite(value) and isfinite(u) and u > 0.0):
        return quantity(value, unit)
    return quantity(value, unit, max(2, floor(log10(abs(value))) - floor(log10(u)) + 1))


def gravity_stated(gravity: Quantity) -> Check:
    """Hold the stated acceleration of fall against those on the ground of the Earth."""
    name, law = "stated gravity", "on the ground g lies between 9.76 and 9.84 m/s²"
    text = f"g is stated as {quantity(gravity.value, 'm/s2')}"
    low, high = _ON_GROUND
    if low - gravity.u <= gravity.value <= high + gravity.u:
        return stated(name, law, text, None)
    cause = "model.gravity in session.toml is no acceleration of fall on Earth: digits were exchanged or lost"
    return stated(name, law, text, "impossible", cause=cause, setting="model.gravity")

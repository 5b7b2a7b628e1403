"""Simulators as functions of named parameters with plain values in SI."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipelines.simulator_inputs import material

if TYPE_CHECKING:
    from labpipe.materials import Prony

Value = float | str | None
"""None: the parameter is not there."""
Outputs = dict[str, float]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: SI unit ("" for a name), default, and what it is."""

    unit: str
    default: Value
    text: str


@dataclass(frozen=True, slots=True)
class Simulator:
    """A function, its parameters, and the units of what it returns.

    ``together`` does the same for many points at once, where that is faster; when one of them has
    no answer it raises.
    """

    run: Callable[[Mapping[str, Value]], Outputs]
    parameters: dict[str, Parameter]
    outputs: dict[str, tuple[str, str]]
    together: Callable[[Sequence[Mapping[str, Value]]], list[Outputs]] | None = None


_MATERIAL = {
    "temperature": Parameter("degC", None, "of the material; without it, that of its data"),
    "vertical_shift": Parameter("1", 1.0, "factor b_T on all moduli at that temperature"),
}
_LIBRARY = "library name or TOML file"
RUBBER = {"material": Parameter("", "nbr", _LIBRARY), **_MATERIAL}
"""The material of a simulator, rubber by default; see :func:`solid`."""

FALL = {
    "material": Parameter("", "acrylic", _LIBRARY),
    **_MATERIAL,
    "radius": Parameter("m", 9.525e-3, "of the sphere"),
    "mass": Parameter("kg", 0.505, "total moving mass"),
    "height": Parameter("m", 1.5e-3, "drop height, from release to first touch"),
    "gravity": Parameter("m/s2", 9.81, "of the place"),
}
"""A sphere that falls."""

OSCILLATION = {
    **RUBBER,
    "tip_radius": Parameter("m", 2e-3, "of curvature"),
    "period": Parameter("m", 8e-3, "distance of two tips"),
    "depth": Parameter("m", 18e-3, "contact length summed over the tips"),
    "mean": Parameter("m", 1e-4, "mean indentation"),
    "amplitude": Parameter("m", 1e-5, "of the oscillation"),
    "frequency": Parameter("Hz", 1.0, "of the oscillation"),
}
"""A periodic punch that oscillates in a half-plane."""


def solid(point: Mapping[str, Value]) -> "Prony":
    """Return the material of a point, at its temperature."""
    temperature, shift = point["temperature"], point["vertical_shift"]
    return material(
        str(point["material"]),
        None if temperature is None else float(temperature),
        1.0 if shift is None else float(shift),
    )


def numbers(point: Mapping[str, Value]) -> dict[str, float]:
    """Return the parameters of a point that are numbers."""
    return {name: float(v) for name, v in point.items() if isinstance(v, int | float)}

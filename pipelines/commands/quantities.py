"""Quantities with units on the command line, and options common to the simulations."""

from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])


class Quantity(click.ParamType):  # type: ignore[type-arg]  # generic only since click 8.2
    """A number with a unit, such as ``9.525 mm``."""

    def __init__(self, name: str, si: str, example: str) -> None:
        self.name, self._si, self._example = name, si, example

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the value in SI."""
        from labpipe.errors import InputError
        from labpipe.units import quantity

        if isinstance(value, float):
            return value
        try:
            found = quantity(str(value))
        except InputError as error:
            self.fail(str(error), param, ctx)
        if found.si != self._si:
            unit = "has no unit" if found.si == "1" else f"is in {found.si}"
            self.fail(f'"{value}" {unit}; expected for example "{self._example}"', param, ctx)
        return found.value


LENGTH, TIME = Quantity("length", "m", "9.525 mm"), Quantity("time", "s", "0.5 s")
MASS, FREQUENCY = Quantity("mass", "kg", "505 g"), Quantity("frequency", "Hz", "2 Hz")
RATIO, SPEED = Quantity("number", "1", "0.03"), Quantity("speed", "m/s", "1 mm/s")
TEMPERATURE = Quantity("temperature", "degC", "23 degC")
WORK, FORCE = Quantity("energy per area", "J/m2", "50 mJ/m2"), Quantity("force", "N", "10 N")
HEAT_CAPACITY = Quantity("heat capacity", "J/kg/K", "1470 J/kg/K")
CONDUCTIVITY = Quantity("conductivity", "W/m/K", "0.19 W/m/K")


def material_options(default: str) -> Callable[[F], F]:
    """Add ``--material``, ``--temperature`` and ``--vertical-shift``."""
    return _all(
        click.option("--material", default=default, help="Library name or TOML file."),
        click.option(
            "--temperature",
            type=TEMPERATURE,
            help="Temperature of the material, by its shift law; default: that of its data.",
        ),
        click.option(
            "--vertical-shift", type=float, default=1.0, help="b_T: factor on all moduli at that temperature."
        ),
    )


def punch_options(function: F) -> F:
    """Add ``--tip-radius``, ``--period``, ``--depth`` and ``--mean`` of a periodic punch."""
    return _all(
        click.option("--tip-radius", type=LENGTH, default="2 mm", help="Of curvature."),
        click.option("--period", type=LENGTH, default="8 mm", help="Distance between neighbouring tips."),
        click.option("--depth", type=LENGTH, default="18 mm", help="Contact length summed over the tips."),
        click.option("--mean", type=LENGTH, default="0.1 mm", help="Mean indentation."),
    )(function)


def result_options(function: F) -> F:
    """Add ``--out`` and ``--picture``."""
    return _all(
        click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="netCDF file to write."),
        click.option(
            "--picture", type=click.Path(dir_okay=False, path_type=Path), help="Picture to draw (.png, .svg or .pdf)."
        ),
    )(function)


def _all(*options: Callable[[Any], Any]) -> Callable[[F], F]:
    return lambda function: reduce(lambda f, option: option(f), reversed(options), function)

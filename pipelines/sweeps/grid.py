"""The points of a sweep: the product of its axes, times random draws of uncertain inputs."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod

import numpy as np

from labpipe.errors import InputError, UsageError
from labpipe.units import Quantity, quantity
from labpipe.workflow.fields import suggest
from pipelines.sweeps.simulators import SIMULATORS, Parameter, Value

DRAW = "draw"
"""Name of the dimension of random draws."""
MOST_POINTS = 10_000_000


@dataclass(frozen=True, slots=True)
class Design:
    """All points of a sweep.

    ``axes``: values in SI by parameter, whose product is the grid, the first varies slowest; ``fixed``: every other
    parameter; ``drawn``: parameters with a standard uncertainty, one value per draw. The draws are the same at every
    point of the grid, so that differences over the grid are not noise.
    """

    simulator: str
    axes: dict[str, tuple[Value, ...]]
    fixed: dict[str, Value]
    drawn: dict[str, tuple[float, ...]]

    @property
    def sizes(self) -> dict[str, int]:
        """Points along each dimension, draws last."""
        draws = [(DRAW, len(values)) for values in self.drawn.values()]
        return {name: len(values) for name, values in self.axes.items()} | dict(draws)

    @property
    def count(self) -> int:
        """Number of points."""
        return prod(self.sizes.values())

    def points(self, start: int = 0, stop: int | None = None) -> list[dict[str, Value]]:
        """All parameters of some points, in the order of the flattened grid."""
        numbers = range(self.count)[start:stop]
        found = [dict(self.fixed) for _ in numbers]
        places = zip(*np.unravel_index(numbers, tuple(self.sizes.values())), strict=True) if self.sizes else ()
        for point, place in zip(found, places, strict=False):
            point |= {name: values[i] for (name, values), i in zip(self.axes.items(), place, strict=False)}
            point |= {name: values[place[-1]] for name, values in self.drawn.items()}
        return found


def design(
    simulator: str,
    vary: Mapping[str, str],
    fixed: Mapping[str, str | float] | None = None,
    *,
    draws: int = 0,
    seed: int = 0,
) -> Design:
    """Spell out a sweep.

    Parameters
    ----------
    simulator : {"drop", "indent"}
    vary : mapping
        Values of swept parameters: ``"acrylic, nylon"``, ``"1.5 mm, 5 mm"``, or a range ``"1 mm : 10 mm : 7"``; a
        fourth part ``log`` spaces it by equal ratios.
    fixed : mapping
        Text with a unit, ``"9.525 ± 0.005 mm"``, or numbers in SI; the others keep their default.
    draws : int
        Random draws of uncertain parameters (normal distribution).
    seed : int
        Of the draws.

    Raises
    ------
    UsageError
        A parameter is unknown, given twice or in another unit; draws and uncertainties do not
        belong together; or the points are more than ten million.

    Examples
    --------
    >>> design("drop", {"height": "1 mm : 4 mm : 3 : log"}).axes
    {'height': (0.001, 0.002, 0.004)}
    """
    given = dict(fixed or {})
    axes = {name: _axis(simulator, name, text) for name, text in vary.items()}
    for name in given:
        _parameter(simulator, name)
        if name in axes:
            raise UsageError(f"{name} is given twice")
    known = {name: parameter.default for name, parameter in SIMULATORS[simulator].parameters.items()}
    stated = {n: None if v is None else _value(simulator, n, v) for n, v in (known | given).items() if n not in axes}
    spread = {name: v for name, v in stated.items() if isinstance(v, Quantity) and v.u > 0.0}
    if bool(spread) != bool(draws):
        message = (
            f"{', '.join(spread)} has an uncertainty: give the number of draws"
            if spread
            else 'nothing to draw: give a fixed parameter an uncertainty, "9.525 ± 0.005 mm"'
        )
        raise UsageError(message)
    generator = np.random.default_rng(seed)
    drawn = {name: tuple(generator.normal(q.value, q.u, draws).tolist()) for name, q in spread.items()}
    made = Design(simulator, axes, {n: v.value if isinstance(v, Quantity) else v for n, v in stated.items()}, drawn)
    if made.count > MOST_POINTS:
        raise UsageError(f"{made.count} points; at most {MOST_POINTS} in one sweep")
    return made


def _axis(simulator: str, name: str, text: str) -> tuple[Value, ...]:
    parts = [part.strip() for part in text.split(":")]
    if len(parts) == 1 or not _parameter(simulator, name).unit:
        given = [_value(simulator, name, part.strip()) for part in text.split(",")]
        if any(isinstance(v, Quantity) and v.u > 0.0 for v in given):
            raise UsageError(f"{name}: a swept value has no uncertainty; set it fixed, with draws")
        values: tuple[Value, ...] = tuple(v.value if isinstance(v, Quantity) else v for v in given)
        if len(set(values)) < len(values):
            raise UsageError(f"{name}: a value is given twice in {text}")
        return values
    is_log = parts[3:] == ["log"]
    if len(parts) != 3 + is_log or not parts[2].isdigit():
        raise UsageError(
            f'{name}: cannot understand "{text}"; expected values separated by commas, or '
            '"first : last : number", with ": log" for equal ratios'
        )
    first, last = (_value(simulator, name, part) for part in parts[:2])
    if not (isinstance(first, Quantity) and isinstance(last, Quantity) and int(parts[2]) >= 2):
        raise UsageError(f"{name}: a range needs two numbers and at least two points")
    if is_log and min(first.value, last.value) <= 0.0:
        raise UsageError(f"{name}: equal ratios need positive ends")
    spaced = (np.geomspace if is_log else np.linspace)(first.value, last.value, int(parts[2]))
    # Twelve digits: 0.004 and not 0.0040000000000000001 of one machine and ..2 of another.
    return tuple(float(f"{v:.12g}") for v in spaced)


def _parameter(simulator: str, name: str) -> Parameter:
    if simulator not in SIMULATORS:
        raise UsageError(f'no simulator "{simulator}"{suggest(simulator, SIMULATORS)}')
    known = SIMULATORS[simulator].parameters
    if name not in known:
        raise UsageError(f'no parameter "{name}"{suggest(name, known)}; there are {", ".join(known)}')
    return known[name]


def _value(simulator: str, name: str, given: str | float) -> Quantity | str:
    unit = _parameter(simulator, name).unit
    if not unit:
        return str(given)
    try:
        found = quantity(given) if isinstance(given, str) else Quantity(float(given), 0.0, unit)
    except InputError as error:
        raise UsageError(f"{name}: {error}") from error
    if found.si != unit:
        is_in = "has no unit" if found.si == "1" else f"is in {found.si}"
        raise UsageError(f'{name}: "{given}" {is_in}; expected {unit}')
    return found

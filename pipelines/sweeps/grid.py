"""The points of a sweep: the product of its axes, times random draws of uncertain inputs."""

from collections.abc import Mapping, Sequence
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
class Axis:
    """One swept parameter and its values, SI."""

    name: str
    values: tuple[Value, ...]


@dataclass(frozen=True, slots=True)
class Design:
    """All points of a sweep.

    Attributes
    ----------
    simulator : str
        Key of :data:`SIMULATORS`.
    axes : tuple of Axis
        Their product is the grid; the first varies slowest.
    fixed : dict
        Every other parameter.
    drawn : dict
        Parameters with a standard uncertainty: one value per draw. The same draws at every point
        of the grid, so that differences over the grid are not noise.
    """

    simulator: str
    axes: tuple[Axis, ...]
    fixed: dict[str, Value]
    drawn: dict[str, tuple[float, ...]]

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions, draws last."""
        return tuple(a.name for a in self.axes) + ((DRAW,) if self.drawn else ())

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each dimension."""
        draws = len(next(iter(self.drawn.values()))) if self.drawn else 0
        return tuple(len(a.values) for a in self.axes) + ((draws,) if draws else ())

    @property
    def count(self) -> int:
        """Number of points."""
        return prod(self.shape)

    def points(self, start: int = 0, stop: int | None = None) -> list[dict[str, Value]]:
        """All parameters of some points, in the order of the flattened grid."""
        n_draws = self.shape[-1] if self.drawn else 1
        found = []
        for number in range(start, self.count if stop is None else min(stop, self.count)):
            place, draw = divmod(number, n_draws)
            point = dict(self.fixed)
            for swept in reversed(self.axes):
                place, i = divmod(place, len(swept.values))
                point[swept.name] = swept.values[i]
            found.append(point | {name: values[draw] for name, values in self.drawn.items()})
        return found


def axis(simulator: str, name: str, text: str) -> Axis:
    """Parse the values of one axis.

    Parameters
    ----------
    simulator, name : str
        Whose parameter it is.
    text : str
        ``"acrylic, nylon"``, ``"1.5 mm, 5 mm"``, or a range ``"1 mm : 10 mm : 7"``; a fourth part
        ``log`` spaces it by equal ratios.

    Raises
    ------
    UsageError
        The text is none of these, or in another unit.

    Examples
    --------
    >>> axis("drop", "height", "1 mm : 4 mm : 3 : log").values
    (0.001, 0.002, 0.004)
    """
    parameter = _parameter(simulator, name)
    parts = [part.strip() for part in text.split(":")]
    if len(parts) == 1 or not parameter.unit:
        values = [_value(simulator, name, part.strip()) for part in text.split(",")]
        if any(isinstance(v, Quantity) and v.u > 0.0 for v in values):
            raise UsageError(f"{name}: a swept value has no uncertainty; set it fixed, with draws")
        return Axis(name, tuple(v.value if isinstance(v, Quantity) else v for v in values))
    is_log = parts[3:] == ["log"]
    if len(parts) not in (3, 4) or not (is_log or len(parts) == 3) or not parts[2].isdigit():
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
    return Axis(name, tuple(float(f"{v:.12g}") for v in spaced))


def design(
    simulator: str,
    axes: Sequence[Axis],
    fixed: Mapping[str, str | float] | None = None,
    *,
    draws: int = 0,
    seed: int = 0,
) -> Design:
    """Spell out a sweep.

    Parameters
    ----------
    simulator : {"drop", "indent", "adhesion", "heating", "amplitude"}
    axes : sequence of Axis
        Swept parameters.
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
    """
    known = _parameters(simulator)
    names = [a.name for a in axes]
    given = dict(fixed or {})
    for name in [*names, *given]:
        _parameter(simulator, name)
        if [*names, *given].count(name) > 1:
            raise UsageError(f"{name} is given twice")
    values: dict[str, Value] = {}
    spread: dict[str, Quantity] = {}
    for name, parameter in known.items():
        found = _value(simulator, name, given[name]) if name in given else parameter.default
        if isinstance(found, Quantity):
            if found.u > 0.0:
                spread[name] = found
            found = found.value
        if name not in names:
            values[name] = found
    if bool(spread) != bool(draws):
        message = (
            f"{', '.join(spread)} has an uncertainty: give the number of draws"
            if spread
            else 'nothing to draw: give a fixed parameter an uncertainty, "9.525 ± 0.005 mm"'
        )
        raise UsageError(message)
    generator = np.random.default_rng(seed)
    drawn = {name: tuple(generator.normal(q.value, q.u, draws).tolist()) for name, q in spread.items()}
    made = Design(simulator, tuple(axes), values, drawn)
    if made.count > MOST_POINTS:
        raise UsageError(f"{made.count} points; at most {MOST_POINTS} in one sweep")
    return made


def _parameter(simulator: str, name: str) -> Parameter:
    known = _parameters(simulator)
    if name not in known:
        raise UsageError(f'no parameter "{name}"{suggest(name, known)}; there are {", ".join(known)}')
    return known[name]


def _parameters(simulator: str) -> dict[str, Parameter]:
    if simulator not in SIMULATORS:
        raise UsageError(f'no simulator "{simulator}"{suggest(simulator, SIMULATORS)}')
    return SIMULATORS[simulator].parameters


def _value(simulator: str, name: str, given: str | float) -> Quantity | str:
    unit = SIMULATORS[simulator].parameters[name].unit
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

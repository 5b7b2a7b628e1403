"""Simulators: their parameters, as the commands name them, and for sweeps sets of them in, a few numbers out for each.

They take plain values in SI and return plain floats, so that a point means the same in this process, in another one,
and on another machine.
"""

import itertools
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from labpipe.materials import Prony

_PER_CYCLE = 200  # samples of an oscillation
DRAW = "draw"  # name of the dimension of random draws
_STATE = ("temperature", "vertical_shift")  # of a material

Value = float | str | None
"""None: the parameter is not there."""
Point = Mapping[str, Any]
Outputs = dict[str, float]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: SI unit ("" for a name), default as it is written, and meaning."""

    unit: str
    default: str | float | None = None
    text: str = ""


@dataclass(frozen=True, slots=True)
class Simulator:
    """A function of some points, which raises when one of them has no answer; its parameters; units of its outputs."""

    run: Callable[[Sequence[Point]], list[Outputs]]
    parameters: dict[str, Parameter]
    outputs: dict[str, tuple[str, str]]


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

    def points(self, numbers: range) -> list[dict[str, Value]]:
        """All parameters of some points, by their numbers in the order of the flattened grid."""
        import numpy as np

        found = [dict(self.fixed) for _ in numbers]
        places = zip(*np.unravel_index(numbers, tuple(self.sizes.values())), strict=True) if self.sizes else ()
        for point, place in zip(found, places, strict=False):
            point |= {name: values[i] for (name, values), i in zip(self.axes.items(), place, strict=False)}
            point |= {name: values[place[-1]] for name, values in self.drawn.items()}
        return found


def _solid(point: Point) -> "Prony":
    """Return the material of a point, at its temperature."""
    from pipelines.simulator_inputs import material

    return material(point["material"], *(point[name] for name in _STATE))


def drops(points: Sequence[Point]) -> list[Outputs]:
    """First impacts of viscoelastic spheres on a rigid flat (or a ringing plate); each material is made once."""
    import numpy as np

    from labpipe import contact

    found: list[Outputs] = []
    material = itemgetter("material", *_STATE)
    solids = {key: _solid(point) for key, point in {material(point): point for point in points}.items()}
    for rtol, group in itertools.groupby(points, key=itemgetter("rtol")):
        some = list(group)
        of = {name: [point[name] for point in some] for name in some[0]}
        plates = zip(of["plate_mass"], of["plate_frequency"], of["plate_damping"], strict=True)
        falls = zip(of["height"], of["gravity"], of["after_touch"], strict=True)
        bodies: dict[str, Any] = {name: of[name] for name in ("radius", "mass", "height", "gravity")}
        made = contact.impacts(
            [solids[material(point)] for point in some],
            duration=[float(np.sqrt(2.0 * height / gravity)) + after for height, gravity, after in falls],
            rtol=rtol,
            plate=[contact.Plate(*plate) if plate[0] > 0.0 else None for plate in plates],
            **bodies,
        )
        for i in np.flatnonzero(made["impacts"].values == 0):
            raise ValueError(f"the sphere has not left within {of['after_touch'][i]:g} s; raise after_touch")
        columns = [(name, made[name].values.reshape(len(some), -1)) for name in SIMULATORS["drop"].outputs]
        found += [{name: float(values[i, 0]) for name, values in columns} for i in range(len(some))]
    return found


def indents(points: Sequence[Point]) -> list[Outputs]:
    """Oscillations of a periodic punch in a half-plane after a ramp and a hold."""
    import numpy as np

    from labpipe import contact
    from pipelines.simulator_inputs import ramp_hold_oscillation

    found: list[Outputs] = []
    for point in points:
        moves = {name: point[name] for name in ("mean", "amplitude", "frequency", "hold", "ramp")}
        cycles = round(point["cycles"])
        time, displacement = ramp_hold_oscillation(cycles=cycles, per_cycle=_PER_CYCLE, **moves)
        punch = {name: point[name] for name in ("tip_radius", "period", "depth", "profile")}
        made = contact.indent(_solid(point), time=time, displacement=displacement, **punch)
        force, last = made["force"].values, slice(time.size - _PER_CYCLE - 1, None)
        outputs = {
            "peak_force": force.max(),
            "plateau_force": force[-_PER_CYCLE * cycles - 1],
            "dissipated_work": np.trapezoid(force[last], displacement[last]),
            "least_half_width": made["contact_half_width"].values[last].min(),
            "solver_steps": json.loads(made.attrs["work"])["solver_steps"],
        }
        found.append({name: float(value) for name, value in outputs.items()})
    return found


_READ = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
SIMULATORS = {
    name: Simulator(run, {n: Parameter(**p) for n, p in _READ[name]["parameters"].items()}, _READ[name]["outputs"])
    for name, run in {"drop": drops, "indent": indents}.items()
}
"""Keys as ``labpipe sweep`` and ``labpipe simulate`` name them."""

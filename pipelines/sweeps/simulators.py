"""Simulators: their parameters, as the commands name them, and for sweeps sets of them in, a few numbers out for each.

They take plain values in SI and return plain floats, so that a point means the same in this process, in another one,
and on another machine.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from labpipe.materials import Prony

_PER_CYCLE = 200  # samples of an oscillation

Value = float | str | None
"""None: the parameter is not there."""
Point = Mapping[str, Value]
Outputs = dict[str, float]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: SI unit ("" for a name), default as it is written, and meaning."""

    unit: str
    default: str | float | None
    text: str


@dataclass(frozen=True, slots=True)
class Simulator:
    """A function of some points, which raises when one of them has no answer; its parameters; units of its outputs."""

    run: Callable[[Sequence[Point]], list[Outputs]]
    parameters: dict[str, Parameter]
    outputs: dict[str, tuple[str, str]]


_MATERIAL = {
    "temperature": Parameter("degC", None, "of the material, by its shift law; without it, that of its data"),
    "vertical_shift": Parameter("1", "1", "factor b_T on all moduli at that temperature"),
}
_LIBRARY = "library name or TOML file"


def _solid(point: Point) -> "Prony":
    """Return the material of a point, at its temperature."""
    from pipelines.simulator_inputs import material

    temperature, shift = (None if (given := point[n]) is None else float(given) for n in list(_MATERIAL))
    return material(str(point["material"]), temperature, 1.0 if shift is None else shift)


def _numbers(point: Point) -> dict[str, float]:
    """Return the parameters of a point that are numbers."""
    return {name: float(v) for name, v in point.items() if isinstance(v, int | float)}


def drops(points: Sequence[Point]) -> list[Outputs]:
    """First impacts of viscoelastic spheres on a rigid flat (or a ringing plate); each material is made once."""
    import numpy as np

    from labpipe import contact

    found: list[Outputs] = [{} for _ in points]
    numbers, solids = [_numbers(point) for point in points], dict[tuple[Value, ...], "Prony"]()
    keys = [tuple(point[name] for name in ("material", *_MATERIAL)) for point in points]
    for key, point in zip(keys, points, strict=True):
        solids[key] = solids.get(key) or _solid(point)
    for rtol in {one["rtol"] for one in numbers}:
        places = [i for i, one in enumerate(numbers) if one["rtol"] == rtol]
        given = [numbers[i] for i in places]
        plates = [
            contact.Plate(n["plate_mass"], n["plate_frequency"], n["plate_damping"]) if n["plate_mass"] > 0.0 else None
            for n in given
        ]
        duration = [float(np.sqrt(2.0 * n["height"] / n["gravity"])) + n["after_touch"] for n in given]
        radius, mass, height, gravity = ([n[name] for n in given] for name in ("radius", "mass", "height", "gravity"))
        own = [solids[keys[i]] for i in places]
        made = contact.impacts(own, radius, mass, height, duration, rtol=rtol, gravity=gravity, plate=plates)
        for number, happened in zip(given, made["impacts"].values.tolist(), strict=True):
            if not happened:
                after = number["after_touch"]
                raise ValueError(f"the sphere has not left within {after:g} s after its fall; raise after_touch")
        names = ("restitution", "peak_force", "peak_contact_radius", "contact_duration")
        columns = {name: made[name].values[:, 0].tolist() for name in names}
        columns["solver_steps"] = made["solver_steps"].values.astype(float).tolist()
        for place, i in enumerate(places):
            found[i] = {name: values[place] for name, values in columns.items()}
    return found


def indents(points: Sequence[Point]) -> list[Outputs]:
    """Oscillations of a periodic punch in a half-plane after a ramp and a hold."""
    import numpy as np

    from labpipe import contact
    from pipelines.simulator_inputs import ramp_hold_oscillation

    found: list[Outputs] = []
    for point in points:
        number = _numbers(point)
        mean, amplitude, frequency = number["mean"], number["amplitude"], number["frequency"]
        cycles, form = round(number["cycles"]), {"hold": number["hold"], "ramp": number["ramp"]}
        time, displacement = ramp_hold_oscillation(mean, amplitude, frequency, cycles, **form, per_cycle=_PER_CYCLE)
        tip_radius, period, depth = number["tip_radius"], number["period"], number["depth"]
        profile = str(point["profile"])
        made = contact.indent(_solid(point), tip_radius, period, depth, time, displacement, profile=profile)
        force = made["force"].values
        last = slice(time.size - _PER_CYCLE - 1, None)
        outputs = {
            "peak_force": force.max(),
            "plateau_force": force[-_PER_CYCLE * cycles - 1],
            "dissipated_work": np.trapezoid(force[last], displacement[last]),
            "least_half_width": made["contact_half_width"].values[last].min(),
            "solver_steps": json.loads(made.attrs["work"])["solver_steps"],
        }
        found.append({name: float(value) for name, value in outputs.items()})
    return found


SIMULATORS = {
    "drop": Simulator(
        drops,
        {
            "material": Parameter("", "acrylic", _LIBRARY),
            **_MATERIAL,
            "radius": Parameter("m", "9.525 mm", "of the sphere"),
            "mass": Parameter("kg", "505 g", "total moving mass"),
            "height": Parameter("m", "1.5 mm", "drop height, from release to first touch"),
            "gravity": Parameter("m/s2", "9.81 m/s2", "of the place"),
            "after_touch": Parameter("s", "20 ms", "simulated after the fall"),
            "plate_mass": Parameter("kg", "0 kg", "of a ringing substrate; 0 for a rigid one"),
            "plate_frequency": Parameter("Hz", "390 Hz", "natural frequency of the substrate"),
            "plate_damping": Parameter("1", "0.03", "damping ratio of the substrate"),
            "rtol": Parameter("1", "1e-4", "relative error aimed at"),
        },
        {
            "restitution": ("1", "Restitution of the first impact"),
            "peak_force": ("N", "Largest force of the first impact"),
            "peak_contact_radius": ("m", "Largest contact radius of the first impact"),
            "contact_duration": ("s", "Duration of the first contact"),
            "solver_steps": ("1", "Steps of the simulator"),
        },
    ),
    "indent": Simulator(
        indents,
        {
            "material": Parameter("", "nbr", _LIBRARY),
            **_MATERIAL,
            "tip_radius": Parameter("m", "2 mm", "of curvature"),
            "period": Parameter("m", "8 mm", "distance of two tips"),
            "depth": Parameter("m", "18 mm", "contact length summed over the tips"),
            "mean": Parameter("m", "0.1 mm", "mean indentation"),
            "amplitude": Parameter("m", "0.01 mm", "of the oscillation"),
            "frequency": Parameter("Hz", "1 Hz", "of the oscillation"),
            "cycles": Parameter("1", "5", "whole cycles; the last one is evaluated"),
            "hold": Parameter("s", "600 s", "before the oscillation"),
            "ramp": Parameter("m/s", "1 mm/s", "speed of pressing in"),
            "profile": Parameter("", "circle", "parabola, circle or cosine"),
        },
        {
            "peak_force": ("N", "Largest force"),
            "plateau_force": ("N", "Force at the end of the hold"),
            "dissipated_work": ("J", "Work dissipated in the last cycle"),
            "least_half_width": ("m", "Smallest contact half width of the last cycle"),
            "solver_steps": ("1", "Steps of the simulator"),
        },
    ),
}
"""Keys as ``labpipe sweep`` and ``labpipe simulate`` name them."""

"""Simulators for sweeps: a set of parameters in, a few numbers out.

Each takes plain values in SI and returns plain floats, so that a point means the same in this
process, in another one, and on another machine.
"""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipelines.simulator_inputs import ramp_hold_oscillation
from pipelines.sweeps.beyond import BEYOND
from pipelines.sweeps.parameters import FALL, OSCILLATION, Outputs, Parameter, Simulator, Value, numbers, solid

if TYPE_CHECKING:
    from labpipe.materials import Prony

_PER_CYCLE = 200


def drop(point: Mapping[str, Value]) -> Outputs:
    """First impact of a viscoelastic sphere on a rigid flat (or a ringing plate)."""
    return drops([point])[0]


def drops(points: Sequence[Mapping[str, Value]]) -> list[Outputs]:
    """First impacts of many: each material is made once."""
    found: list[Outputs] = [{} for _ in points]
    for rtol in {numbers(point)["rtol"] for point in points}:
        places = [i for i, point in enumerate(points) if numbers(point)["rtol"] == rtol]
        for i, made in zip(places, _first_impacts([points[i] for i in places], rtol), strict=True):
            found[i] = made
    return found


def _first_impacts(points: Sequence[Mapping[str, Value]], rtol: float) -> list[Outputs]:
    """First impacts at one tolerance."""
    from labpipe import contact

    solids: dict[tuple[Value, ...], Prony] = {}
    given: list[Prony] = []
    plates: list[contact.Plate | None] = []
    duration = []
    for point in points:
        number = numbers(point)
        material = tuple(point[name] for name in ("material", "temperature", "vertical_shift"))
        if material not in solids:
            solids[material] = solid(point)
        given.append(solids[material])
        plate = number["plate_mass"], number["plate_frequency"], number["plate_damping"]
        plates.append(contact.Plate(*plate) if plate[0] > 0.0 else None)
        duration.append(float(np.sqrt(2.0 * number["height"] / number["gravity"])) + number["after_touch"])
    radius, mass, height, gravity = (
        [numbers(point)[name] for point in points] for name in ("radius", "mass", "height", "gravity")
    )
    made = contact.impacts(given, radius, mass, height, duration, rtol=rtol, gravity=gravity, plate=plates)
    for point, happened in zip(points, made["impacts"].values.tolist(), strict=True):
        if not happened:
            after = numbers(point)["after_touch"]
            raise ValueError(f"the sphere has not left within {after:g} s after its fall; raise after_touch")
    names = ("restitution", "peak_force", "peak_contact_radius", "contact_duration")
    columns = {name: made[name].values[:, 0].tolist() for name in names}
    columns["solver_steps"] = made["solver_steps"].values.astype(float).tolist()
    return [{name: values[i] for name, values in columns.items()} for i in range(len(points))]


def indent(point: Mapping[str, Value]) -> Outputs:
    """Oscillation of a periodic punch in a half-plane after a ramp and a hold."""
    from labpipe import contact

    number = numbers(point)
    mean, amplitude, frequency = number["mean"], number["amplitude"], number["frequency"]
    cycles, form = round(number["cycles"]), {"hold": number["hold"], "ramp": number["ramp"]}
    time, displacement = ramp_hold_oscillation(mean, amplitude, frequency, cycles, **form, per_cycle=_PER_CYCLE)
    tip_radius, period, depth = number["tip_radius"], number["period"], number["depth"]
    profile = str(point["profile"])
    found = contact.indent(solid(point), tip_radius, period, depth, time, displacement, profile=profile)
    force = found["force"].values
    last = slice(time.size - _PER_CYCLE - 1, None)
    return {
        "peak_force": float(force.max()),
        "plateau_force": float(force[-_PER_CYCLE * round(number["cycles"]) - 1]),
        "dissipated_work": float(np.trapezoid(force[last], displacement[last])),
        "least_half_width": float(found["contact_half_width"].values[last].min()),
        "solver_steps": float(json.loads(found.attrs["work"])["solver_steps"]),
    }


SIMULATORS = {
    "drop": Simulator(
        drop,
        {
            **FALL,
            "after_touch": Parameter("s", 20e-3, "simulated after the fall"),
            "plate_mass": Parameter("kg", 0.0, "of a ringing substrate; 0 for a rigid one"),
            "plate_frequency": Parameter("Hz", 390.0, "natural frequency of the substrate"),
            "plate_damping": Parameter("1", 0.03, "damping ratio of the substrate"),
            "rtol": Parameter("1", 1e-4, "relative error aimed at"),
        },
        {
            "restitution": ("1", "Restitution of the first impact"),
            "peak_force": ("N", "Largest force of the first impact"),
            "peak_contact_radius": ("m", "Largest contact radius of the first impact"),
            "contact_duration": ("s", "Duration of the first contact"),
            "solver_steps": ("1", "Steps of the simulator"),
        },
        drops,
    ),
    "indent": Simulator(
        indent,
        {
            **OSCILLATION,
            "cycles": Parameter("1", 5.0, "whole cycles; the last one is evaluated"),
            "hold": Parameter("s", 600.0, "before the oscillation"),
            "ramp": Parameter("m/s", 1e-3, "speed of pressing in"),
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
    **BEYOND,
}

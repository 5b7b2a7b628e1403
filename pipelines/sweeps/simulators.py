"""Simulators for sweeps: a set of parameters in, a few numbers out.

Each takes plain values in SI and returns plain floats, so that a point means the same in this
process, in another one, and on another machine.
"""

import json
from collections.abc import Mapping

import numpy as np

from pipelines.simulator_inputs import ramp_hold_oscillation
from pipelines.sweeps.beyond import BEYOND
from pipelines.sweeps.parameters import FALL, OSCILLATION, Outputs, Parameter, Simulator, Value, numbers, solid

_PER_CYCLE = 200


def drop(point: Mapping[str, Value]) -> Outputs:
    """First impact of a viscoelastic sphere on a rigid flat (or a ringing plate)."""
    from labpipe import contact

    number = numbers(point)
    plate = None
    if number["plate_mass"] > 0.0:
        plate = contact.Plate(number["plate_mass"], number["plate_frequency"], number["plate_damping"])
    fall = np.sqrt(2.0 * number["height"] / number["gravity"])
    found = contact.drop(
        solid(point),
        number["radius"],
        number["mass"],
        number["height"],
        float(fall) + number["after_touch"],
        rtol=number["rtol"],
        gravity=number["gravity"],
        plate=plate,
    )
    if not found.sizes["impact"] or not np.isfinite(found["lift_off_time"].values[0]):
        message = f"the sphere has not left within {number['after_touch']:g} s after its fall; raise after_touch"
        raise ValueError(message)
    names = ("restitution", "peak_force", "peak_contact_radius", "contact_duration")
    values = {name: float(found[name].values[0]) for name in names}
    return values | {"solver_steps": float(json.loads(found.attrs["work"])["solver_steps"])}


def indent(point: Mapping[str, Value]) -> Outputs:
    """Oscillation of a periodic punch in a half-plane after a ramp and a hold."""
    from labpipe import contact

    number = numbers(point)
    time, displacement = ramp_hold_oscillation(
        number["mean"],
        number["amplitude"],
        number["frequency"],
        round(number["cycles"]),
        hold=number["hold"],
        ramp=number["ramp"],
        per_cycle=_PER_CYCLE,
    )
    found = contact.indent(
        solid(point),
        number["tip_radius"],
        number["period"],
        number["depth"],
        time,
        displacement,
        profile=str(point["profile"]),
    )
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

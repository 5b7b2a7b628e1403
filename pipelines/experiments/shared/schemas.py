"""Schemas of results common to several kinds of experiment."""

from labpipe.schema import Schema, Variable


def over(dims: str, units: dict[str, str], *, has_u: bool = True) -> dict[str, Variable]:
    """Return variables over dimensions, or single numbers, each with its uncertainty where there is one."""
    kept, before = tuple(dims.split()), ("", "u_") if has_u else ("",)
    return {f"{u}{name}": Variable(kept, unit) for name, unit in units.items() for u in before}


DISPLACEMENT = Schema(
    "displacement",
    over("time", {"displacement": "m"})
    | over("time", {"displacement_raw": "m"}, has_u=False)
    | over("", {"inclination": "rad"}),
)
"""Displacement by a laser, corrected for its inclination."""

VELOCITY = Schema("velocity", over("time", {"velocity": "m/s"}))

_EVENTS = {"touch_time": "s", "liftoff_time": "s", "incoming_speed": "m/s", "outgoing_speed": "m/s", "restitution": "1"}
BOUNCES = Schema("bounces", over("impact", _EVENTS))
"""The events of one drop."""

_MOTION = {"displacement": "m", "velocity": "m/s", "force": "N", "contact_radius": "m"}
DROP = Schema(
    "drop", over("time", _MOTION, has_u=False) | over("impact", {"restitution": "1", "impact_time": "s"}, has_u=False)
)
"""A simulated drop."""

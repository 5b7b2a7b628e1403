"""Schemas of results common to several kinds of experiment."""

from labpipe.schema import Schema, Variable


def _over(dim: str, units: dict[str, str], *, has_u: bool = True) -> dict[str, Variable]:
    """Return variables over a dimension, or single numbers, each with its uncertainty where there is one."""
    dims = (dim,) if dim else ()
    return {f"{u}{n}": Variable(dims, unit) for n, unit in units.items() for u in (("", "u_") if has_u else ("",))}


DISPLACEMENT = Schema(
    "displacement",
    _over("time", {"displacement": "m"})
    | _over("time", {"displacement_raw": "m"}, has_u=False)
    | _over("", {"inclination": "rad"}),
)
"""Displacement by a laser, corrected for its inclination."""

VELOCITY = Schema("velocity", _over("time", {"velocity": "m/s"}))

_EVENTS = {"touch_time": "s", "liftoff_time": "s", "incoming_speed": "m/s", "outgoing_speed": "m/s", "restitution": "1"}
BOUNCES = Schema("bounces", _over("impact", _EVENTS))
"""The events of one drop."""

_MOTION = {"displacement": "m", "velocity": "m/s", "force": "N", "contact_radius": "m"}
DROP = Schema(
    "drop", _over("time", _MOTION, has_u=False) | _over("impact", {"restitution": "1", "impact_time": "s"}, has_u=False)
)
"""A simulated drop."""

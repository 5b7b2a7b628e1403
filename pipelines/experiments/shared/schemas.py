"""Schemas of results common to several kinds of experiment."""

from labpipe.schema import Schema, Variable

_TIME = ("time",)
_IMPACT = ("impact",)


def _over_impact(*names: tuple[str, str]) -> dict[str, Variable]:
    """Return variables over ``impact``, each with its uncertainty."""
    table = {name: Variable(_IMPACT, units) for name, units in names}
    return table | {f"u_{name}": Variable(_IMPACT, units) for name, units in names}


DISPLACEMENT = Schema(
    "displacement",
    {
        "displacement": Variable(_TIME, "m"),
        "u_displacement": Variable(_TIME, "m"),
        "displacement_raw": Variable(_TIME, "m"),
        "inclination": Variable((), "rad"),
        "u_inclination": Variable((), "rad"),
    },
)
"""Displacement by a laser, corrected for its inclination."""

VELOCITY = Schema("velocity", {"velocity": Variable(_TIME, "m/s"), "u_velocity": Variable(_TIME, "m/s")})

BOUNCES = Schema(
    "bounces",
    _over_impact(
        ("touch_time", "s"),
        ("liftoff_time", "s"),
        ("incoming_speed", "m/s"),
        ("outgoing_speed", "m/s"),
        ("restitution", "1"),
    ),
)
"""The events of one drop."""

DROP = Schema(
    "drop",
    {
        "displacement": Variable(_TIME, "m"),
        "velocity": Variable(_TIME, "m/s"),
        "force": Variable(_TIME, "N"),
        "contact_radius": Variable(_TIME, "m"),
        "restitution": Variable(_IMPACT, "1"),
        "impact_time": Variable(_IMPACT, "s"),
    },
)
"""A simulated drop."""

"""Checks of a record of a falling and bouncing body, whichever sensor saw it.

Free fall and the order of bounces are redundant: the curvature of every flight is g, the fall is
what the session states, and no bounce is higher than the one before. A factor in time or length
moves them by different powers, which tells the mistake.
"""

from pipelines.experiments.shared.fall_checks._bounces import apexes, rest_level, restitution, touch_levels
from pipelines.experiments.shared.fall_checks._contact import (
    BY_NAME,
    MEASURED,
    Stiffness,
    body_stated,
    contact_duration,
    of_body,
    strain,
)
from pipelines.experiments.shared.fall_checks._fall import Fall, gravity_stated, shown
from pipelines.experiments.shared.fall_checks._flights import (
    SPEED,
    acceleration,
    direction,
    ends_early,
    flights_alike,
    height,
    release,
    smooth_flights,
    speed,
)
from pipelines.experiments.shared.fall_checks._repeats import levels_alike, repeats_alike

__all__ = [
    "BY_NAME",
    "MEASURED",
    "SPEED",
    "Fall",
    "Stiffness",
    "acceleration",
    "apexes",
    "body_stated",
    "contact_duration",
    "direction",
    "ends_early",
    "flights_alike",
    "gravity_stated",
    "height",
    "levels_alike",
    "of_body",
    "release",
    "repeats_alike",
    "rest_level",
    "restitution",
    "shown",
    "smooth_flights",
    "speed",
    "strain",
    "touch_levels",
]

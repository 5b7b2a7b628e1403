"""Checks of a record of a falling and bouncing body, whichever sensor saw it.

Free fall and the order of bounces are redundant: the curvature of every flight is g, the fall is
what the session states, and no bounce is higher than the one before. A factor in time or length
moves them by different powers, which tells the mistake.
"""

from pipelines.experiments.shared.fall_checks._bounces import (
    BACKWARDS as BACKWARDS,
    apexes as apexes,
    rest_level as rest_level,
    restitution as restitution,
    touch_levels as touch_levels,
)
from pipelines.experiments.shared.fall_checks._contact import (
    BY_NAME as BY_NAME,
    MEASURED as MEASURED,
    Stiffness as Stiffness,
    body_stated as body_stated,
    contact_duration as contact_duration,
    of_body as of_body,
    strain as strain,
)
from pipelines.experiments.shared.fall_checks._fall import (
    Fall as Fall,
    gravity_stated as gravity_stated,
    matched as matched,
    shown as shown,
)
from pipelines.experiments.shared.fall_checks._flights import (
    SPEED as SPEED,
    acceleration as acceleration,
    direction as direction,
    ends_early as ends_early,
    flights_alike as flights_alike,
    height as height,
    release as release,
    smooth_flights as smooth_flights,
    speed as speed,
)
from pipelines.experiments.shared.fall_checks._repeats import (
    levels_alike as levels_alike,
    repeats_alike as repeats_alike,
)

"""Checks of a sensor's readings by themselves, before anything is found in them.

A body has inertia: between two readings it moves no further than its speed allows, it does not
stand still in mid-flight, and its noise never repeats itself. What breaks that is the sensor, the
cable or the file, and it is told with its place in time.
"""

from pipelines.experiments.shared.trace_checks._checks import checks_of as checks_of, speed_of_swing as speed_of_swing
from pipelines.experiments.shared.trace_checks._copies import repeated_rows as repeated_rows, shared_rows as shared_rows
from pipelines.experiments.shared.trace_checks._failed import CAUSES as CAUSES, placed as placed
from pipelines.experiments.shared.trace_checks._inertia import SINGLE_ROWS as SINGLE_ROWS
from pipelines.experiments.shared.trace_checks._range import (
    held_readings as held_readings,
    resolution as resolution,
    unread as unread,
)
from pipelines.experiments.shared.trace_checks._record import of_record as of_record
from pipelines.experiments.shared.trace_checks._rest import (
    SMOOTHED as SMOOTHED,
    SWING as SWING,
    swing_at_rest as swing_at_rest,
)
from pipelines.experiments.shared.trace_checks._trace import Trace as Trace, longest_by_chance as longest_by_chance

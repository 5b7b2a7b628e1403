"""Checks of a sensor's readings by themselves, before anything is found in them.

A body has inertia: between two readings it moves no further than its speed allows, it does not
stand still in mid-flight, and its noise never repeats itself. What breaks that is the sensor, the
cable or the file, and it is told with its place in time.
"""

from pipelines.experiments.shared.trace_checks._checks import checks_of, speed_of_swing
from pipelines.experiments.shared.trace_checks._copies import repeated_rows, shared_rows
from pipelines.experiments.shared.trace_checks._range import OUT_OF_RANGE, held_readings, resolution, unread
from pipelines.experiments.shared.trace_checks._record import of_record
from pipelines.experiments.shared.trace_checks._rest import IN_MOTION, SMOOTHED, SWING, swing_at_rest
from pipelines.experiments.shared.trace_checks._trace import Trace, longest_by_chance

__all__ = [
    "IN_MOTION",
    "OUT_OF_RANGE",
    "SMOOTHED",
    "SWING",
    "Trace",
    "checks_of",
    "held_readings",
    "longest_by_chance",
    "of_record",
    "repeated_rows",
    "resolution",
    "shared_rows",
    "speed_of_swing",
    "swing_at_rest",
    "unread",
]

"""One step of a contact: how long it may be, what it finds, and where its numbers stand."""

from dataclasses import dataclass
from typing import NamedTuple

from labpipe.contact.impact._plate import PlateState
from labpipe.contact.impact._rungs import Rung
from labpipe.contact.memory import Array

# The step grows and shrinks by at most these factors; the safety factor is on the step length.
GROWTH, SHRINK, SAFETY = 2.0, 0.3, 0.9
# First step after touch, and longest step, as fractions of the time scale of the contact.
FIRST, LONGEST = 1e-4, 0.05
NEWTON_LIMIT = 60
# Newton converges quadratically: one more evaluation after this relative change is exact.
NEWTON_TOLERANCE = 1e-8
# Rows of the work buffer: unloaded displacement, its time integral, old load, new load,
# displacement. The first two are written by a trial, the others when it is accepted.
PAST, DWELL, OLD, NEW, DISPLACEMENT = range(5)


class Trial(NamedTuple):
    """A step that was computed and not yet accepted."""

    rung: Rung
    approach: float
    force: float
    position: float
    plate: PlateState
    reach: Array


@dataclass(slots=True)
class Pace:
    """Length of the next step, its limit, and when errors may grow, by which factor."""

    dt: float
    longest: float
    lenient_from: float
    leniency: float

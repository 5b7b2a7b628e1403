"""Free flight between two contacts: one step, however long.

The sphere is ballistic while its dent recovers, so it touches again on the residual dent, not where
the undeformed surface would be. On rigid ground the distance is a parabola minus a sum of decaying
exponentials: its second derivative increases, so that it has exactly one zero after lift-off, before the
sphere falls back to where it lifted off.
"""

from math import sqrt
from typing import Any

import numpy as np
from scipy.optimize import brentq

from labpipe.arrays import Floats
from labpipe.contact.impact._plate import Plate, PlateState
from labpipe.errors import LabpipeError

# Looks within a period of a ringing plate.
_LOOKS_PER_PERIOD = 32


def time_of_flight(
    gravity: float, velocity: float, dent: Floats, rate: Floats, plate: Plate | None, start: PlateState
) -> float:
    """Time [s] from lift-off at a velocity [m/s], at which both part, to the next touch.

    ``velocity`` [m/s]: at lift-off, downwards positive; ``dent``, ``rate`` (element,) [m] [1/s]: displacements of the
    elements of the central spring, and their rates of recovery; ``start``: the plate at lift-off. A ringing plate is
    looked at so often that no touch is missed that lasts longer than a small part of its period, but only within
    reach of its swing, which only falls.
    """

    def sunk(time: Any) -> Any:
        """Depth [m] to which the sphere, let alone, would have sunk into the surface, whose dent recovers."""
        raised = plate.free(start, time).displacement - start.displacement if plate else 0.0
        return (velocity + 0.5 * gravity * time) * time - np.expm1(-np.multiply.outer(time, rate)) @ dent - raised

    reach = 0.0 if plate is None else sqrt(2.0 * plate.energy(start) / plate.stiffness)
    longest = (-velocity + sqrt(velocity**2 + 4.0 * gravity * reach)) / gravity * 1.001
    looks = np.array([longest])
    if plate is not None:
        step = 1.0 / (plate.frequency * _LOOKS_PER_PERIOD)
        looks = step * np.arange(1, int(longest / step) + 2)
        highest = start.displacement + reach + float(np.maximum(dent, 0.0).sum())
        looks = looks[(velocity + 0.5 * gravity * looks) * looks + highest >= 0.0]
    touching = np.flatnonzero(sunk(looks) > 0.0)
    if not touching.size:
        raise LabpipeError("the sphere does not come back to the plate")
    end = float(looks[touching[0]])
    begin = 1e-9 * end if plate is None else max(end - step, 1e-9 * step)
    while sunk(begin) >= 0.0:
        begin *= 1e-2
        if begin < 1e-290 * end:
            return 0.0
    return float(brentq(sunk, begin, end, xtol=1e-300, rtol=8.9e-16))

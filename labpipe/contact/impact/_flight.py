"""Free flight between two contacts: one step, however long.

The sphere is ballistic while its dent recovers, so it touches again on the residual dent, not where
the undeformed surface would be.
"""

import numpy as np
from scipy.optimize import brentq

from labpipe.arrays import Floats
from labpipe.contact.impact._plate import Plate, PlateState
from labpipe.errors import LabpipeError

# A ringing plate is looked at this often per period when the next touch is sought.
_LOOKS_PER_PERIOD = 32
# Relative precision of a touch time.
_PRECISION = 4e-16 * 4


def time_to_touch(velocity: float, gravity: float, dent: Floats, rate: Floats) -> float:
    """Time in s until the sphere meets its recovering dent again; 0 when it does not part from it.

    Parameters
    ----------
    velocity : float [m/s]
        At lift-off, downwards positive, so negative when the sphere rises.
    gravity : float [m/s2]
    dent : array (element,) [m]
        Displacements of the central spring's elements at lift-off.
    rate : array (element,) [1/s]
        Their rates of recovery.

    Notes
    -----
    The distance is a parabola minus a sum of decaying exponentials: its second derivative
    increases, so that it has exactly one zero after lift-off. The dent only recovers, therefore the
    zero lies before the sphere falls back to where it lifted off.
    """
    if velocity + float(rate @ dent) >= 0.0:
        return 0.0
    fall = -2.0 * velocity / gravity

    def mean_approach_speed(time: float) -> float:
        recovered = float(-np.expm1(-rate * time) @ dent)
        return velocity + 0.5 * gravity * time + recovered / time

    shortest = fall * 1e-3
    while mean_approach_speed(shortest) >= 0.0:
        shortest *= 1e-3
        if shortest < fall * 1e-290:
            return 0.0
    if mean_approach_speed(fall) <= 0.0:
        return fall
    return float(brentq(mean_approach_speed, shortest, fall, xtol=1e-300, rtol=_PRECISION))


def time_to_touch_plate(
    velocity: float, gravity: float, dent: Floats, rate: Floats, plate: Plate, state: PlateState
) -> float:
    """As :func:`time_to_touch` from lift-off, above a plate that rings: the first touch.

    The plate is looked at often enough that no touch is missed which lasts longer than a small
    part of its period, but only while the sphere is within reach of its swing: the plate's energy
    only falls, so that what the sphere rises above the swing now is clear until it has fallen back.

    Raises
    ------
    LabpipeError
        The sphere does not come back: a defect of the program.
    """

    def climbed(time: float) -> float:
        """Approach gained since lift-off if the plate stood still."""
        fallen = velocity * time + 0.5 * gravity * time**2
        return fallen + float(-np.expm1(-rate * time) @ dent)

    def overlap(time: float) -> float:
        return climbed(time) - (plate.free(state, time).displacement - state.displacement)

    parting = velocity - state.velocity + float(rate @ dent)
    if parting >= 0.0:
        return 0.0
    look = 1.0 / (_LOOKS_PER_PERIOD * plate.frequency)
    rise = 2.0 * plate.swing(state)
    longest = (-velocity + (velocity**2 + 2.0 * gravity * rise) ** 0.5) / gravity * 1.001
    start, end = look * 1e-9, look
    while start < longest:
        if overlap(end) > 0.0:
            while overlap(start) >= 0.0:
                start *= 1e-2
            return float(brentq(overlap, start, end, xtol=1e-300, rtol=_PRECISION))
        clear = state.displacement + plate.swing(plate.free(state, end))
        if climbed(end) + clear < 0.0:
            end = float(brentq(lambda time, level: climbed(time) + level, end, longest, (clear,)))
        start, end = end, end + look
    message = "the sphere does not come back to the plate"
    raise LabpipeError(message)

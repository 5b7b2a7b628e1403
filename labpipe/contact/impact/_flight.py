"""Free flight between two contacts: one step, however long.

The sphere is ballistic while its dent recovers, so it touches again on the residual dent, not where
the undeformed surface would be.
"""

import math

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean
from labpipe.contact.impact._records import Fall

# Looks within a period of a ringing plate.
_LOOKS_PER_PERIOD = 32
# Halvings of a bracket, more than a number has digits.
_HALVINGS = 200
# A bounce is not sought at a smaller part of the time of the parabola.
_SHORTEST_FLIGHT = 1e-290


@inner()
def _fallen(velocity: float, gravity: float, dent: Floats, rate: Floats, time: float) -> float:
    """Approach [m] gained since lift-off over a recovering dent, on ground that stands still."""
    gained = (velocity + 0.5 * gravity * time) * time
    for k in range(rate.size):
        gained -= math.expm1(-rate[k] * time) * dent[k]
    return gained


@inner()
def _touch_of_dent(velocity: float, gravity: float, dent: Floats, rate: Floats) -> float:
    """Time of flight on rigid ground; 0 when the surface follows."""
    high = -2.0 * velocity / gravity
    low = 1e-3 * high
    while _fallen(velocity, gravity, dent, rate, low) >= 0.0:
        low *= 1e-3
        if low < _SHORTEST_FLIGHT * high:
            return 0.0
    if _fallen(velocity, gravity, dent, rate, high) <= 0.0:
        return high
    time = high
    for _ in range(_HALVINGS):
        over = _fallen(velocity, gravity, dent, rate, time)
        if over > 0.0:
            high = time
        else:
            low = time
        slope = velocity + gravity * time
        for k in range(rate.size):
            slope += rate[k] * math.exp(-rate[k] * time) * dent[k]
        new = time - over / slope if slope > 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - time) <= 4e-16 * time:
            break
        time = new
    return time


@inner()
def _swing_free(fall: Fall, u: float, w: float, time: float) -> tuple[float, float]:
    """Displacement and velocity of the plate, left alone for a time [s]."""
    omega = math.sqrt(fall.plate_stiffness / fall.plate_mass)
    rate = 0.5 * fall.plate_damping / fall.plate_mass
    damped = math.sqrt(max(omega**2 - rate**2, 0.0))
    left, c, s = math.exp(-rate * time), math.cos(damped * time), math.sin(damped * time)
    place = left * (u * c + (w + rate * u) / damped * s)
    return place, left * (w * c - (rate * w + omega**2 * u) / damped * s)


@inner()
def _reach(fall: Fall, u: float, w: float) -> float:
    """Largest displacement that the plate, left alone, can reach from now on."""
    return math.sqrt(fall.plate_mass / fall.plate_stiffness * w * w + u * u)


@inner()
def _over_plate(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float, time: float) -> float:
    """How far the sphere, let alone, would have sunk into the surface on the plate."""
    return _fallen(velocity, fall.gravity, dent, rate, time) - (_swing_free(fall, u, w, time)[0] - u)


@inner()
def _touch_of_plate(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float) -> float:
    """Time of flight above a ringing plate; -1 when the sphere does not come back, a defect.

    The plate is looked at so often that no touch is missed that lasts longer than a small part of
    its period, but only within reach of its swing, which only falls: a sphere above it is clear
    until it has fallen back.
    """
    look = 2.0 * math.pi * math.sqrt(fall.plate_mass / fall.plate_stiffness) / _LOOKS_PER_PERIOD
    rise = 2.0 * _reach(fall, u, w)
    longest = (-velocity + math.sqrt(velocity**2 + 2.0 * fall.gravity * rise)) / fall.gravity * 1.001
    start, end = 1e-9 * look, look
    while start < longest:
        if _over_plate(fall, velocity, dent, rate, u, w, end) > 0.0:
            while _over_plate(fall, velocity, dent, rate, u, w, start) >= 0.0:
                start *= 1e-2
                if start < _SHORTEST_FLIGHT * look:
                    return 0.0
            for _ in range(_HALVINGS):
                middle = 0.5 * (start + end)
                if not start < middle < end:
                    break
                if _over_plate(fall, velocity, dent, rate, u, w, middle) > 0.0:
                    end = middle
                else:
                    start = middle
            return end
        place, pace = _swing_free(fall, u, w, end)
        clear = u + _reach(fall, place, pace)
        if _fallen(velocity, fall.gravity, dent, rate, end) + clear < 0.0:
            low, high = end, longest
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                if not low < middle < high:
                    break
                if _fallen(velocity, fall.gravity, dent, rate, middle) + clear < 0.0:
                    low = middle
                else:
                    high = middle
            end = low
        start, end = end, end + look
    return -1.0


@lean()
def time_of_flight(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float) -> float:
    """Time [s] from lift-off at a velocity [m/s] to the next touch.

    ``fall``: what falls onto what; ``velocity`` [m/s]: at lift-off, downwards positive; ``dent``, ``rate`` (element,)
    [m] [1/s]: displacements of the elements of the central spring, and their rates of recovery; ``u``, ``w`` [m] [m/s]:
    displacement and velocity of the plate. Returns 0 when the surface follows at once; negative when no touch was
    found, a defect.

    Notes
    -----
    On rigid ground the distance is a parabola minus a sum of decaying exponentials: its second derivative
    increases, so that it has exactly one zero after lift-off, before the sphere falls back to where it lifted off.
    """
    parting = velocity - w
    for k in range(rate.size):
        parting += rate[k] * dent[k]
    if parting >= 0.0:
        return 0.0
    if fall.plate_mass > 0.0:
        return _touch_of_plate(fall, velocity, dent, rate, u, w)
    return _touch_of_dent(velocity, fall.gravity, dent, rate)

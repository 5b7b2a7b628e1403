"""Free flight between two contacts: one step, however long.

The sphere is ballistic while its dent recovers, so it touches again on the residual dent, not where
the undeformed surface would be. On rigid ground the distance is a parabola minus a sum of decaying
exponentials: its second derivative increases, so that it has exactly one zero after lift-off, before the
sphere falls back to where it lifted off.
"""

import math

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean
from labpipe.contact.impact._records import Fall

# Looks within a period of a ringing plate.
_LOOKS_PER_PERIOD = 32


@inner()
def _swing(fall: Fall, u: float, w: float, time: float) -> tuple[float, float]:
    """Displacement and velocity of the plate, left alone for a time [s]."""
    omega = math.sqrt(fall.plate_stiffness / fall.plate_mass)
    rate = 0.5 * fall.plate_damping / fall.plate_mass
    damped = math.sqrt(max(omega**2 - rate**2, 0.0))
    left, c, s = math.exp(-rate * time), math.cos(damped * time), math.sin(damped * time)
    place = left * (u * c + (w + rate * u) / damped * s)
    return place, left * (w * c - (rate * w + omega**2 * u) / damped * s)


@inner()
def _amplitude(fall: Fall, u: float, w: float) -> float:
    """Largest displacement that the plate, left alone, can reach from now on."""
    return math.sqrt(fall.plate_mass / fall.plate_stiffness * w * w + u * u)


@inner()
def _fallen(velocity: float, gravity: float, dent: Floats, rate: Floats, time: float) -> float:
    """Approach [m] gained since lift-off over a recovering dent, on ground that stands still."""
    gained = (velocity + 0.5 * gravity * time) * time
    for k in range(rate.size):
        gained -= math.expm1(-rate[k] * time) * dent[k]
    return gained


@inner()
def _sunk(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float, time: float) -> float:
    """Depth [m] to which the sphere, let alone, would have sunk into the surface."""
    raised = _swing(fall, u, w, time)[0] - u if fall.plate_mass > 0.0 else 0.0
    return _fallen(velocity, fall.gravity, dent, rate, time) - raised


@inner()
def _touch(
    fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float, low: float, high: float
) -> float:
    """Time between two at which the sphere is above and in the surface, by the secant method of Illinois."""
    above, below = _sunk(fall, velocity, dent, rate, u, w, low), _sunk(fall, velocity, dent, rate, u, w, high)
    side, time = 0, high
    for _ in range(200):
        new = high - below * (high - low) / (below - above)
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - time) <= 4e-16 * time or not low < new < high:
            return new
        time = new
        depth = _sunk(fall, velocity, dent, rate, u, w, time)
        if depth > 0.0:
            high, below = time, depth
            above *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, above = time, depth
            below *= 0.5 if side < 0 else 1.0
            side = -1
    return time


@lean()
def time_of_flight(fall: Fall, velocity: float, dent: Floats, rate: Floats, u: float, w: float) -> float:
    """Time [s] from lift-off at a velocity [m/s] to the next touch.

    ``fall``: what falls onto what; ``velocity`` [m/s]: at lift-off, downwards positive; ``dent``, ``rate`` (element,)
    [m] [1/s]: displacements of the elements of the central spring, and their rates of recovery; ``u``, ``w`` [m] [m/s]:
    displacement and velocity of the plate. Returns 0 when the surface follows at once; negative when no touch was
    found, a defect. A ringing plate is looked at so often that no touch is missed that lasts longer than a small part
    of its period, but only within reach of its swing, which only falls: a sphere above it is clear until it has fallen
    back.
    """
    parting = velocity - w
    for k in range(rate.size):
        parting += rate[k] * dent[k]
    if parting >= 0.0:
        return 0.0
    rise = 2.0 * _amplitude(fall, u, w) if fall.plate_mass > 0.0 else 0.0
    longest = (-velocity + math.sqrt(velocity**2 + 2.0 * fall.gravity * rise)) / fall.gravity * 1.001
    look = longest
    if fall.plate_mass > 0.0:
        look = 2.0 * math.pi * math.sqrt(fall.plate_mass / fall.plate_stiffness) / _LOOKS_PER_PERIOD
    start, end = 1e-9 * look, look
    while start < longest:
        if _sunk(fall, velocity, dent, rate, u, w, end) > 0.0:
            while _sunk(fall, velocity, dent, rate, u, w, start) >= 0.0:
                start *= 1e-2
                if start < 1e-290 * look:
                    return 0.0
            return _touch(fall, velocity, dent, rate, u, w, start, end)
        if fall.plate_mass > 0.0:
            place, pace = _swing(fall, u, w, end)
            clear = u + _amplitude(fall, place, pace)
            low, high = end, longest
            while high - low > 0.1 * look and _fallen(velocity, fall.gravity, dent, rate, low) + clear < 0.0:
                middle = 0.5 * (low + high)
                if _fallen(velocity, fall.gravity, dent, rate, middle) + clear < 0.0:
                    low = middle
                else:
                    high = middle
            end = low
        start, end = end, end + look
    return -1.0

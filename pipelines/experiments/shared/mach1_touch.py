"""First touch of an approach: the position at which the force of a moving stage begins.

Behind the touch the contact grows with a power of the depth, and relaxation lowers the force
meanwhile and when the stage rests: for a modulus that falls as t^-a,

    F(t) = k ∫ (t − s)^-a dA(s),     A = (z − z0)^q,

which at constant speed is a power q − a of the depth. The few readings that depend on it have passed
the load cell's filter. Neither z0 nor a are well known from them and their likelihood is far from
normal; so it is summed over both.
"""

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.signals import first_touch, independent_count
from labpipe.units import Quantity

FINENESS = 10  # steps per reading: a touch lies between two of them
STEP = 1e-7
"""m, the step of the stage's display outside a Sinusoid block."""
_POWERS = np.linspace(0.70, 1.15, 12)  # with relaxation: a loss factor of 0.6 lowers it by 0.35


def touched(
    part: xr.Dataset,
    delay: Quantity,
    sections: Floats | None,
    count: int = 81,
    line_power: float = 1.09,
    rested: float = 1.5,
) -> Quantity:
    """Return the position of first touch [m].

    ``part`` holds ``time``, ``position_z`` and ``force`` of an approach, ``delay`` [s] is that of the load cell's
    filter, ``sections`` (section, 6) the filter itself at :data:`FINENESS` steps a reading, None without one. The
    likelihood is found at ``count`` places at a time, about the likely ones until a quarter of them is. The force of
    a line contact grows over its first micrometres with a power of 1.06 to 1.13, ``line_power``; a power of time
    describes relaxation for ``rested`` times as long as from touch to rest. The uncertainty is the standard deviation
    of where the touch may be, with the display's step and the delay.
    """
    from scipy.signal import fftconvolve, sosfilt

    time, position, force = (part[n].values for n in ("time", "position_z", "force"))
    arrived = int(np.argmax(position >= position.max() - STEP / 2))
    # the force comes late by the filter's delay, so it belongs to an earlier position
    rough = first_touch(np.interp(time - delay.value, time, position)[: arrived + 1], force[: arrived + 1])
    # readings depend on the touch until the stage has rested for a while, or goes back
    touch = int(np.argmax(position > min(rough, position[arrived] - STEP)))
    used = arrived + 1 + round(rested * (arrived - touch) + delay.value / float(np.median(np.diff(time))))
    back = np.flatnonzero(position[arrived:] < position[arrived] - 2.0 * STEP)
    used = min(used, arrived + int(back[0]) if back.size else position.size)
    position, force = position[:used], force[:used]
    unit = max(float(position.max()) - rough, STEP)
    fine = np.interp(np.arange((used - 1) * FINENESS + 1) / FINENESS, np.arange(used), position)
    free, centred = force[position < rough - unit], force - force.mean()
    correlated = free.size / independent_count(free) if free.size else 1.0
    resolution = max(float(part.attrs.get("resolution", 0.0)), float(np.finfo(np.float32).eps * np.ptp(force)))

    def likelihood(places: Floats) -> Floats:
        """Return the logarithm of the likelihood (power, place) for the best level and stiffness."""
        depth, found = np.maximum(fine - places[:, None], 0.0) / unit, []
        for power in _POWERS.tolist():
            growth = max(power, line_power)
            # the force of a growing contact, in any unit
            memory = np.diff(np.arange(fine.size + 1, dtype=float) ** (1.0 - growth + power))
            shape = fftconvolve(np.diff(depth**growth, axis=1, prepend=0.0), memory[None], axes=1)[:, : fine.size]
            shape = (shape if sections is None else sosfilt(sections, shape, axis=1))[:, ::FINENESS]
            shape = shape - shape.mean(axis=1, keepdims=True)
            size = np.maximum(np.sum(shape**2, axis=1), np.finfo(float).tiny)
            rest = centred @ centred - np.maximum(shape @ centred, 0.0) ** 2 / size
            rest = np.maximum(rest, used * resolution**2 / 12.0)
            found.append(-0.5 * max(used - 3, 1) / correlated * np.log(rest))
        return np.array(found)

    low, high = max(rough - unit, float(position[0])), rough + unit
    while True:
        places = np.linspace(low, high, count)
        likely = likelihood(places)
        kept = np.flatnonzero(likely.max(axis=0) > likely.max() - 2.0 * np.log(count))
        if kept.size > count // 4 or high - low < STEP:
            break
        low, high = places[max(kept[0] - 1, 0)], places[min(kept[-1] + 1, count - 1)]
    weight = np.exp(likely - likely.max()).sum(axis=0)
    mean = float(np.average(places, weights=weight))
    variance = float(np.average((places - mean) ** 2, weights=weight)) + STEP**2 / 12.0
    by_delay = delay.u * float(position[arrived] - position[touch]) / max(float(time[arrived] - time[touch]), 1e-9)
    return Quantity(mean, float(np.hypot(np.sqrt(variance), by_delay)), "m")

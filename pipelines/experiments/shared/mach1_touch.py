"""First touch of an approach: the position at which the force of a moving stage begins.

Behind the touch the contact grows with a power of the depth, and relaxation lowers the force
meanwhile and when the stage rests: for a modulus that falls as t^-a,

    F(t) = k ∫ (t − s)^-a dA(s),     A = (z − z0)^q,

which at constant speed is a power q − a of the depth. The few readings that depend on it have passed
the load cell's filter. Neither z0 nor a are well known from them and their likelihood is far from
normal; so it is summed over both.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.signals import first_touch, independent_count
from labpipe.units import Quantity

FINENESS = 10  # steps per reading: a touch lies between two of them
_GROWTH = 1.09  # power of a line contact's force over its first micrometres: 1.06 to 1.13
_POWERS = np.linspace(0.70, 1.15, 12)  # with relaxation: a loss factor of 0.6 lowers it by 0.35
_PLACES = 81  # of the touch at which the likelihood is found
_BEFORE, _BEHIND = 1.5, 0.95  # of the first guess of the depth: where the touch may lie
_LIKELY = 12.0  # below the largest logarithm of the likelihood nothing counts
_ENOUGH = 20  # places that count, before their mean is taken
_ROUNDS = 5  # of searching, each at least ten times as fine
_STEP = 1e-7  # m of the stage's display
_RESTED = 1.5  # of the time from touch to rest: so long a power of time describes relaxation
_FEWEST = 20  # free readings that tell how noise is correlated
_LEAST_NOISE = 1e-9  # of the force's range


def touched(part: xr.Dataset, delay: float, filters: list[Floats]) -> Quantity:
    """Return the position of first touch [m].

    ``part`` holds ``time``, ``position_z`` and ``force`` of an approach, ``delay`` [s] of the load cell's filter is a
    first guess. ``filters`` (section, 6) are the filters that it may be, at :data:`FINENESS` steps a reading, all as
    likely; one without sections leaves the force as it is. The uncertainty is the standard deviation of where the touch
    may lie, the display's step included.
    """
    time, position, force = (part[n].values for n in ("time", "position_z", "force"))
    farthest = _farthest(position)
    back = np.flatnonzero(position[farthest:] < position[farthest] - 2.0 * _STEP)
    gone = farthest + int(back[0]) if back.size else position.size  # until the stage goes back
    time, position, force = time[:gone], position[:gone], force[:gone]
    # the force comes late by the filter's delay, so it belongs to an earlier position
    rough = first_touch(np.interp(time - delay, time, position), force)
    # readings depend on the touch until the stage has rested for a while
    farthest = _farthest(position)
    touch = int(np.argmax(position > min(rough, position[farthest] - _STEP)))
    used = farthest + 1 + round(_RESTED * (farthest - touch) + delay / float(np.median(np.diff(time))))
    likelihood = _likelihood(position[:used], force[:used], rough, filters, float(part.attrs.get("resolution", 0.0)))
    unit = max(float(position[:used].max()) - rough, _STEP)
    low, high = max(rough - _BEFORE * unit, float(position[0])), rough + _BEHIND * unit
    for _ in range(_ROUNDS):
        places = np.linspace(low, high, _PLACES)
        likely = likelihood(places)
        kept = np.flatnonzero(likely.max(axis=0) > likely.max() - _LIKELY)
        if kept.size > _ENOUGH:
            break
        low, high = places[max(kept[0] - 1, 0)], places[min(kept[-1] + 1, _PLACES - 1)]
    weight = np.exp(likely - likely.max()).sum(axis=0)
    weight /= weight.sum()
    mean = float(weight @ places)
    spread = float(np.sqrt(weight @ (places - mean) ** 2))
    return Quantity(mean, float(np.hypot(spread, _STEP / np.sqrt(12.0))), "m")


def _farthest(position: Floats) -> int:
    """Return where the stage has arrived."""
    return int(np.argmax(position >= position.max() - _STEP / 2))


def _likelihood(
    position: Floats, force: Floats, rough: float, filters: list[Floats], step: float
) -> Callable[[Floats], Floats]:
    """Return the logarithm of the likelihood (power and filter, place) of places, for the best level and stiffness."""
    from scipy.signal import sosfilt

    unit = max(float(position.max()) - rough, _STEP)
    fine = np.interp(np.arange((position.size - 1) * FINENESS + 1) / FINENESS, np.arange(position.size), position)
    free, centred = force[position < rough - unit], force - force.mean()
    memory = free.size / independent_count(free) if free.size > _FEWEST else 1.0
    weight = 0.5 * max(force.size - 3, 1) / memory
    least = force.size * max(step / np.sqrt(12.0), _LEAST_NOISE * float(np.ptp(force))) ** 2

    def of_shape(made: Floats, start: int) -> Floats:
        rows = np.arange(-(-start // FINENESS), force.size)
        shape = np.zeros((len(made), force.size))
        shape[:, rows] = made[:, rows * FINENESS - start]
        shape -= shape.mean(axis=1, keepdims=True)
        size = np.maximum(np.sum(shape**2, axis=1), np.finfo(float).tiny)
        rest = centred @ centred - np.maximum(shape @ centred, 0.0) ** 2 / size
        return np.asarray(-weight * np.log(np.maximum(rest, least)))

    def likelihood(places: Floats) -> Floats:
        start = max(int(np.searchsorted(np.maximum.accumulate(fine), places[0])) - 1, 0)
        depth = np.maximum(fine[start:] - places[:, None], 0.0) / unit
        shapes = (_relaxed(depth, float(power)) for power in _POWERS)
        return np.array(
            [
                of_shape(sosfilt(sections, shape, axis=1) if len(sections) else shape, start)
                for shape in shapes
                for sections in filters
            ]
        )

    return likelihood


def _relaxed(depth: Floats, power: float) -> Floats:
    """Return the force (place, step) of a growing contact, in any unit."""
    growth = max(power, _GROWTH)
    order = growth - power
    steps = np.arange(depth.shape[1] + 1, dtype=float) ** (1.0 - order)
    gained = np.diff(depth**growth, axis=1, prepend=0.0)
    if order == 0.0:
        return np.asarray(np.cumsum(gained, axis=1))
    from scipy.signal import fftconvolve

    return np.asarray(fftconvolve(gained, np.diff(steps)[None], axes=1)[:, : depth.shape[1]])

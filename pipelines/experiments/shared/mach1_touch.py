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
from labpipe.signals import FirstTouch, first_touch, independent_count
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
    first guess. ``filters`` (section, 6) are what that filter may be, at :data:`FINENESS` steps a reading, all as
    likely; one without sections leaves the force as it is. The uncertainty is the standard deviation of where the touch
    may lie, the display's step included.
    """
    gone = _without_return(part["position_z"].values)
    time, position, force = (part[n].values[:gone] for n in ("time", "position_z", "force"))
    # the force comes late by the filter's delay, so it belongs to an earlier position
    early = np.interp(time - delay, time, position)
    rough = first_touch(early, force)
    used = _moving_and_little_more(position, rough, delay / float(np.median(np.diff(time))))
    model = _Model(position[:used], force[:used], rough, filters, float(part.attrs.get("resolution", 0.0)))
    low = max(rough.position - _BEFORE * model.unit, float(position[0]))
    high = rough.position + _BEHIND * model.unit
    for _ in range(_ROUNDS):
        places = np.linspace(low, high, _PLACES)
        likely = model.log_likelihood(places)
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


def _without_return(position: Floats) -> int:
    """Return how many readings pass until the stage goes back."""
    farthest = _farthest(position)
    back = np.flatnonzero(position[farthest:] < position[farthest] - 2.0 * _STEP)
    return farthest + int(back[0]) if back.size else position.size


def _moving_and_little_more(position: Floats, rough: FirstTouch, late: float) -> int:
    """Return how many readings depend on the touch: until the stage has rested for a while."""
    farthest = _farthest(position)
    touch = int(np.argmax(position > min(rough.position, position[farthest] - _STEP)))
    end = farthest + 1 + round(_RESTED * (farthest - touch) + late)
    return min(end, position.size)


class _Model:
    """Likelihood of an approach's forces, whatever their level and the stiffness."""

    def __init__(self, position: Floats, force: Floats, rough: FirstTouch, filters: list[Floats], step: float) -> None:
        self.force, self.filters = force - force.mean(), filters
        self.unit = max(float(position.max()) - rough.position, _STEP)
        fine = np.arange((position.size - 1) * FINENESS + 1) / FINENESS
        self.fine = np.interp(fine, np.arange(position.size), position)
        free = force[position < rough.position - self.unit]
        memory = free.size / independent_count(free) if free.size > _FEWEST else 1.0
        self.weight = 0.5 * max(force.size - 3, 1) / memory
        least = max(step / np.sqrt(12.0), _LEAST_NOISE * float(np.ptp(force)))
        self.least = force.size * least**2

    def log_likelihood(self, places: Floats) -> Floats:
        """Return it (power and filter, place), for the best level and stiffness."""
        reached = np.maximum.accumulate(self.fine)
        start = max(int(np.searchsorted(reached, places[0])) - 1, 0)
        depth = np.maximum(self.fine[start:] - places[:, None], 0.0) / self.unit
        made = [
            self._of(_relaxed(depth, float(power)), sections, start) for power in _POWERS for sections in self.filters
        ]
        return np.array(made)

    def _of(self, force: Floats, sections: Floats, start: int) -> Floats:
        from scipy.signal import sosfilt

        passed = sosfilt(sections, force, axis=1) if len(sections) else force
        rows = np.arange(-(-start // FINENESS), self.force.size)
        shape = np.zeros((len(force), self.force.size))
        shape[:, rows] = passed[:, rows * FINENESS - start]
        shape -= shape.mean(axis=1, keepdims=True)
        along = np.maximum(shape @ self.force, 0.0)
        size = np.maximum(np.sum(shape**2, axis=1), np.finfo(float).tiny)
        rest = self.force @ self.force - along**2 / size
        return np.asarray(-self.weight * np.log(np.maximum(rest, self.least)))


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

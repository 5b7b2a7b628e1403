"""Where a body is free: the stretches in which two records of a drop are laid against each other."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats

_STRETCHES = 3  # of a fall or flight
_FEWEST = 10  # samples of each
_BESIDE = 0.1  # of a flight, from its contacts, where a small shift in time is a large one in height


def flights(time: Floats, touches: Floats, leaves: Floats, release: float) -> list[NDArray[np.int64]]:
    """Return the samples of three stretches within the fall and each flight that a record holds whole.

    The fall begins with the release [s], contacts begin and end at ``touches`` and ``leaves`` (impact,) [s].
    """
    places: list[NDArray[np.int64]] = []
    for begin, end in zip((max(release, float(time[0])), *leaves), touches, strict=False):
        margin = _BESIDE * (end - begin)
        inside = np.flatnonzero((time >= begin + margin) & (time <= end - margin))
        if inside.size >= _STRETCHES * _FEWEST and end <= time[-1]:
            places += np.array_split(inside, _STRETCHES)
    return places


def moved_by_scatter(time: Floats, touches: Floats, sd: Floats, velocity: Floats) -> Iterator[Floats]:
    """Yield the effect on a path (sample,) [m] of the scatter that each impact adds: it moves all that follows.

    ``sd`` (impact,) are the standard deviations [s] of times of touch between drops since the first of them.
    """
    for touch, grown in zip(touches[1:], np.diff(np.square(np.nan_to_num(sd))), strict=False):
        if grown > 0.0:
            yield np.where(time > touch, np.sqrt(grown) * velocity, 0.0)

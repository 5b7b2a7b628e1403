"""Where a body is free: the stretches in which two records of a drop are laid against each other."""

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats

_STRETCHES = 3  # of a fall or flight
_FEWEST = 10  # samples of each
_BESIDE = 0.1  # of a flight, from its contacts, where a small shift in time is a large one in height


def flights(time: Floats, touches: Floats, leaves: Floats, release: float) -> list[NDArray[np.int64]]:
    """Return the samples of three stretches within the fall and each flight that a record holds whole.

    Parameters
    ----------
    time : array (sample,) [s]
    touches, leaves : array (impact,) [s]
        Where contacts begin and end.
    release : float [s]
        Where the fall begins.
    """
    places: list[NDArray[np.int64]] = []
    for begin, end in zip((max(release, float(time[0])), *leaves), touches, strict=False):
        margin = _BESIDE * (end - begin)
        inside = np.flatnonzero((time >= begin + margin) & (time <= end - margin))
        if inside.size >= _STRETCHES * _FEWEST and end <= time[-1]:
            places += np.array_split(inside, _STRETCHES)
    return places

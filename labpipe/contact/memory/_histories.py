"""Check of a load or displacement history: the error names the sample and the remedy."""

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError


def checked_history(time: ArrayLike, value: ArrayLike, name: str) -> tuple[Floats, Floats]:
    """Return a history as two arrays (time,), or say where it is wrong.

    Raises
    ------
    InputError
        Lengths differ, a number is missing or infinite, or time runs backwards.

    Examples
    --------
    >>> checked_history([0.0, 1.0], [0.0, float("nan")], "displacement")
    Traceback (most recent call last):
    labpipe.errors.InputError: displacement[1] is nan (at 1 s); fill or cut the gap before simulating
    """
    times, values = np.asarray(time, dtype=float), np.asarray(value, dtype=float)
    if times.ndim != 1 or times.shape != values.shape or times.size == 0:
        raise InputError(
            f"time has the shape {times.shape} and {name} {values.shape}; expected two rows of the "
            "same length with at least one sample"
        )
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        raise InputError(f"time[{bad[0]}] is {times[bad[0]]}; every sample needs a finite time")
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        n = bad[0]
        raise InputError(f"{name}[{n}] is {values[n]} (at {times[n]:g} s); fill or cut the gap before simulating")
    back = np.flatnonzero(np.diff(times) < 0.0)
    if back.size:
        n = back[0] + 1
        raise InputError(
            f"time runs backwards at sample {n}: {times[n]:g} s after {times[n - 1]:g} s; "
            "sort the history (two samples at one time are a jump)"
        )
    return times, values


def checked_load(time: ArrayLike, load: ArrayLike) -> tuple[Floats, Floats]:
    """Return a history of load as :func:`checked_history` does; no load may be negative [N]."""
    times, loads = checked_history(time, load, "load")
    negative = np.flatnonzero(loads < 0.0)
    if negative.size:
        n = negative[0]
        raise InputError(f"load[{n}] is {loads[n]} N; a contact without adhesion cannot pull")
    return times, loads

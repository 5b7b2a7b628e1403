"""Sample times: the true sampling interval, and the delay of an averaging sensor."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.units import Quantity

#: Relative standard uncertainty of a quartz clock that nobody has compared: makers state 50 ppm.
UNCHECKED_CLOCK = 50e-6


class TimeBase(NamedTuple):
    """How the samples lie in time.

    Attributes
    ----------
    interval, u_interval : float [s]
        Between stored points.
    u_relative : float
        ``u_interval / interval``.
    averaging : int
        Samples in the moving average (1 = none).
    delay : float [s]
        By which the readings come late; already taken from the times.
    is_calibrated : bool
        False when the clock's uncertainty is the assumption :data:`UNCHECKED_CLOCK`.
    """

    interval: float
    u_interval: float
    u_relative: float
    averaging: int
    delay: float
    is_calibrated: bool


def filter_delay(averaging: int, cycle: float) -> float:
    """Return the group delay of a moving average.

    ``averaging`` counts samples that are ``cycle`` [s] apart (not stored points): ``(averaging - 1) / 2 * cycle``.

    Examples
    --------
    >>> filter_delay(5, 50e-6)
    0.0001
    """
    if averaging < 1 or not 0.0 < cycle < math.inf:
        raise InputError(f"expected averaging >= 1 and cycle > 0, found {averaging} and {cycle}")
    return (averaging - 1) / 2 * cycle


def time_base(attrs: Mapping[str, Any], deviation: Quantity | None = None, averaging: int | None = None) -> TimeBase:
    """Settle the time base of a record.

    ``attrs`` are those of the readings: ``sampling_interval``, ``sampling_cycle`` [s], ``averaging``, for which the
    argument is used where the file does not state it. ``deviation`` [1] is the calibrated relative deviation of the
    true interval from the stated one. Readings that do not say their interval raise InputError.
    """
    if "sampling_interval" not in attrs:
        raise InputError("the readings do not say their sampling_interval")
    known = deviation or Quantity(0.0, UNCHECKED_CLOCK, "1")
    stretch, stated = 1.0 + known.value, float(attrs["sampling_interval"])
    n_averaged = int(averaging if averaging is not None else attrs.get("averaging", 1))
    delay = filter_delay(n_averaged, float(attrs.get("sampling_cycle", stated)) * stretch)
    return TimeBase(stated * stretch, stated * known.u, known.u / stretch, n_averaged, delay, deviation is not None)


def corrected(time: Floats, base: TimeBase, stated: float) -> Floats:
    """Return the times (n,) [s] at which readings were true, from those on the ``stated`` interval [s]."""
    return time * (base.interval / stated) - base.delay

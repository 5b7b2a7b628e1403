"""Readings that a record has lost, told by when its loads were put on.

A laser's file has no clock: the time of a reading is its number times the sampling interval. When
readings are lost within it, all later loads come too early by one and the same time.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import in_words

_HAND = 3.0  # s, standard deviation by which a hand that follows a clock is early or late, at least
_CLEAR = 5.0  # standard deviations of that by which a shift of several loads stands out
_FEWEST = 3  # loads with a time, one of which tells how punctual the hand was
_CHANGED = 0.2  # of a span between two loads, by which its number of readings is another


@dataclass(frozen=True, slots=True)
class Shift:
    """A time by which some loads and all later ones come early or late.

    Attributes
    ----------
    by : float [s]
        Later than stated; negative for earlier.
    first : int
        Number of the first of these loads; that of the record's beginning is 1.
    """

    by: float
    first: int

    @property
    def sentence(self) -> str:
        """What would explain it."""
        span = f"{abs(self.by):.0f} s"
        if self.by > 0.0:
            return (
                f"load {self.first} and all later ones come {span} later than session.toml says: rows stand twice "
                "before, or the times are those that were planned"
            )
        where = "at its beginning" if self.first == 2 else f"between load {self.first - 1} and load {self.first}"
        return (
            f"the record has probably lost {span} of readings {where}, since load {self.first} and all later ones come "
            "so much earlier than session.toml says; or the times are those that were planned"
        )


def common_shift(begin: Floats, given: Floats) -> Shift | None:
    """Find the load from which on all loads come early or late by one time.

    ``begin`` and ``given`` (load,) [s] are when the record steps, and when session.toml says; NaN where it does not.
    The first load is on from the beginning. There is none where the loads come when they should, or each at another
    time.

    Examples
    --------
    >>> stated = np.array([0.0, 153.0, 1092.0, 1986.0, 2853.0])
    >>> common_shift(stated - [0.0, 1.0, 61.0, 59.0, 60.0], stated)
    Shift(by=-59.0, first=3)
    >>> common_shift(stated + [0.0, 2.0, 40.0, -3.0, 1.0], stated)  # a hand that was late once
    """
    number = np.flatnonzero(np.isfinite(given))
    number = number[number > 0]
    late = (begin - given)[number]
    best: tuple[float, Shift] | None = None
    # a load by itself may have been put on at another time
    for split in range(late.size - 1) if late.size >= _FEWEST else ():
        before, after = late[:split], late[split:]
        level = float(before.mean()) if split else 0.0
        rest = float(np.sum((before - level) ** 2) + np.sum((after - after.mean()) ** 2))
        spread = max(_HAND, (rest / (late.size - 1 - bool(split))) ** 0.5)
        by = float(after.mean()) - level
        u = spread * (1 / after.size + (1 / split if split else 0.0)) ** 0.5
        if abs(by) > _CLEAR * max(u, spread) and (best is None or rest < best[0]):
            best = rest, Shift(by, int(number[split]) + 1)
    return None if best is None else best[1]


def uneven(begin: Floats, given: Floats) -> str:
    """Say between which loads a record holds more or fewer readings than the stated times ask for; "" for none."""
    ratio = np.diff(begin) / np.diff(given)
    worst = int(np.argmax(np.where(ratio > 0.0, np.abs(np.log(np.maximum(ratio, 1e-9))), 0.0)))
    if not ratio[worst] > 0.0 or abs(ratio[worst] - 1.0) < _CHANGED:
        return ""
    return (
        f"between load {worst + 1} and load {worst + 2} the record holds {in_words(ratio[worst], 2)} times the readings"
        " that the stated times ask for: readings were lost, or the sampling interval was changed within the record"
    )

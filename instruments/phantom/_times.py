"""The time axis of a .cine film, from its time stamps rather than its frame rate.

The frame rate of the header ignores decimation and the camera's own rounding. Stamps are 64-bit counts of 2⁻³² s; they
are subtracted as integers, as seconds since 1970 in floats are only good to 0.24 µs. Cameras also write stamps that
cannot be true (a corrupt last one, a clock that was never set), which are replaced from the median interval and
flagged. A camera that records in bursts pauses between them: stamps that go on after a pause are true.
"""

from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from instruments.phantom._header import Header
from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError

UNIT = 2.0**-32  # s, the unit of stamps and exposures
_TOLERANCE = 2e-6  # s; some cameras round their stamps to 1 µs
SHARE = 0.05  # of the median interval, the tolerance for slow films
_CLOCK_LIMIT = 30 * 86400.0  # s; a recording further from its trigger has an unset clock
_PAUSE = 1.0  # s; a longer step between frames is a pause of the recording, not a dropped frame
_LONE = 10  # lengths of the film; a single frame that far from all others has a corrupt stamp


class TimeAxis(NamedTuple):
    """Times of the frames since the trigger [s], median time between frames [s], and sentences for the user."""

    time: Floats
    interval: float
    warnings: tuple[str, ...] = ()


def time_axis(header: Header) -> TimeAxis:
    """Return the times of all frames, each stamp checked against the others.

    InputError where there are no time stamps to be used, and no frame rate either.
    """
    number = header.first_image + np.arange(header.count, dtype=np.int64)
    # modular subtraction of unsigned counts, read as signed: exact for any pair of stamps
    stamps = number.astype(np.uint64) if header.stamps is None else header.stamps
    ticks = (stamps - np.uint64(header.trigger & (2**64 - 1))).view(np.int64)
    interval = (float(np.median(np.diff(ticks))) if ticks.size > 1 else 0.0) * UNIT
    rate, decimation = header.frame_rate, header.decimation or 1.0
    stated = decimation / rate if rate and 1.0 <= decimation < np.inf else None  # by the header, where it can be true
    if header.stamps is not None and header.count == 1 and abs(ticks[0] * UNIT) <= _CLOCK_LIMIT:
        return TimeAxis(np.asarray(ticks * UNIT, np.float64), stated or 0.0)
    if header.stamps is None or interval <= 0:
        if stated is None:
            text = f"the frame rate is {header.frame_rate} with a decimation of {header.decimation}"
            raise InputError(f"no frame has a time: there are no usable time stamps, and {text}")
        said = "the film has no time stamps: times follow the stated frame rate"
        return TimeAxis(np.asarray(number * stated, np.float64), stated, (said,))
    time: Floats = (ticks * UNIT).astype(np.float64)
    # impossible is a stamp outside the longest order, and a first or last one farther away than any pause
    good = np.flatnonzero(longest_order(time + np.arange(ticks.size) * max(_TOLERANCE, SHARE * interval)))
    for inner, end in ((slice(1, None), 0), (slice(None, -1), -1)):
        if good.size > 2 and np.diff(time[good])[end] > max(_PAUSE, _LONE * float(np.ptp(time[good[inner]]))):
            good = good[inner]
    bad, found = ~np.isin(np.arange(ticks.size), good), list[str]()
    if n := np.count_nonzero(bad):
        stamps_are, go_on = ("stamp is", "its time continues") if n == 1 else ("stamps are", "their times continue")
        found.append(f"{n} time {stamps_are} impossible (first at frame {np.argmax(bad)}); {go_on} the median interval")
    if abs(time[good[0]]) > _CLOCK_LIMIT:
        # keep the spacing of the stamps, give up their origin
        time = (ticks - ticks[good[0]]) * UNIT + number[good[0]] * interval
        found.append("the camera's clock was not set: time 0 is the frame numbered 0")
    nearest = good[np.clip(np.searchsorted(good, np.arange(header.count)) - 1, 0, None)]
    time = np.where(bad, time[nearest] + (np.arange(header.count) - nearest) * interval, time)
    step = np.diff(time)
    pauses = np.flatnonzero(step > _PAUSE + interval) + 1
    if pauses.size:
        times = f"{pauses.size} time{'s' * (pauses.size != 1)} (first before frame {pauses[0]})"
        found.append(f"the recording pauses {times}, the longest for {step[pauses - 1].max():.4g} s")
    late = step[(step > interval + max(_TOLERANCE, SHARE * interval)) & (step <= _PAUSE + interval)]
    if dropped := int(np.maximum(np.rint(late / interval) - 1, 0).sum()):
        bursts = f"recorded in bursts: {header.count} frames in {late.size + pauses.size + 1} windows"
        found.append(bursts if dropped > header.count else f"frames dropped by the camera: {dropped}")
    return TimeAxis(time, interval, tuple(found))


def longest_order(values: Floats) -> Flags:
    """Mark the longest subsequence that never decreases (patience sorting, n log n)."""
    if (np.diff(values) >= 0).all():
        return np.ones(values.size, dtype=bool)
    ends: list[float] = []  # smallest last value of a subsequence of each length
    at: list[int] = []  # index of that value
    before = np.full(values.size, -1)
    for i, value in enumerate(values.tolist()):
        length = bisect_right(ends, value)
        before[i] = at[length - 1] if length else -1
        ends[length : length + 1], at[length : length + 1] = [value], [i]
    chosen = np.zeros(values.size, dtype=bool)
    i = at[-1]
    while i >= 0:
        chosen[i] = True
        i = int(before[i])
    return chosen

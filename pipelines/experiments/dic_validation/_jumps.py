"""A place that jumps between two frames, as where frames were lost or two films were joined."""

import numpy as np

from labpipe.arrays import Floats

KNOCKED = 0.02  # of the travel, by which a level jumps that counts
STEP = 0.02  # of the usual interval between frames, by which others may differ
FEWEST = 20  # bends of the motion that tell its noise
_IN_NOISE, _RETURNS = 10.0, 0.3
"""Standard deviations of noise of a jump, and the share of it by which the frames beside it may bend."""
_MOST, _SHARP, _ALIKE, _SURE = 60, 0.15, 0.02, 4.0
"""Frames lost in one place at most; largest uncertainty of their number; the share of it and the standard
uncertainties by which it may be no whole number, and the flights on either side may be two."""
_OF_STEPS = np.array([2.0, 2.0, 1.0])
"""Variances of y in the variance of a ratio of steps: 2 + 2 r + r²."""


def jump(time: Floats, y: Floats, least: float) -> tuple[int, float] | None:
    """Find the largest jump of a level between two frames: the speed before and after it is one.

    A bounce bends the motion one way. A jump bends it one way and back in the next frame.

    ``y`` (frame,) jumps by ``least`` or more of its unit. Returns the last frame before the jump, and its size, or
    None.
    """
    steps = np.diff(time)
    bend = np.diff(y, 2)
    even = np.abs(steps - np.median(steps)) < STEP * np.median(steps)
    bend = np.where(even[1:] & even[:-1], bend, np.nan)
    known = bend[np.isfinite(bend)]
    if known.size < FEWEST:
        return None
    noise = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    one, back = bend[1:-2], bend[2:-1]
    size = np.where(one * back < 0, np.minimum(np.abs(one), np.abs(back)), 0.0)
    beside = np.maximum(np.abs(bend[:-3]), np.abs(bend[3:]))
    # where nothing is known beside it, nothing is told
    jumps = np.flatnonzero((size > max(_IN_NOISE * noise, least)) & (beside < _RETURNS * size))
    if not jumps.size:
        return None
    at = int(jumps[np.argmax(size[jumps])]) + 2
    return at, float(y[at + 1] - y[at])


def left_out(time: Floats, y: Floats) -> list[tuple[int, int]]:
    """Find where frames are missing in a flight though times go on evenly, as where the others were numbered anew.

    At constant acceleration the step across n missing frames is n + 1 times the mean of the steps before and after
    it, and both sides have one acceleration. Each is told by the last frame before it and n.
    """
    if y.size < FEWEST:
        return []
    noise = 1.4826 * float(np.nanmedian(np.abs(np.diff(y, 3)))) / np.sqrt(20.0)
    even = np.abs(np.diff(time) / np.median(np.diff(time)) - 1.0) < STEP
    before, last, across, first, after = (np.diff(y)[k : y.size - 5 + k] for k in range(5))
    is_even = np.all([even[k : y.size - 5 + k] for k in range(5)], axis=0)
    mean = 0.5 * (last + first)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = across / mean
        u = noise * np.sqrt(np.polynomial.polynomial.polyval(ratio, _OF_STEPS)) / np.abs(mean)
        count = np.rint(ratio) - 1.0
        bends = [last - before, after - first, (first - last) / (count + 2.0)]
        is_one = np.ptp(bends, axis=0) < _SURE * np.sqrt(12.0) * noise + _ALIKE * np.abs(mean)
        is_whole = np.abs(ratio - count - 1.0) < _SURE * u + _ALIKE * count
        found = is_even & (last * first > 0.0) & (count >= 1.0) & (count <= _MOST) & (u < _SHARP) & is_whole & is_one
    return [(int(at) + 2, int(count[at])) for at in np.flatnonzero(found)]

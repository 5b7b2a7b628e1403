"""A place that jumps between two frames, as where frames were lost or two films were joined."""

import numpy as np

from labpipe.arrays import Floats

KNOCKED = 0.02  # of the travel, by which a level jumps that counts
STEP = 0.02  # of the usual interval between frames, by which others may differ
FEWEST = 20  # bends of the motion that tell its noise
_IN_NOISE, _RETURNS = 10.0, 0.3
"""Standard deviations of noise of a jump, and the share of it by which the frames beside it may bend."""


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

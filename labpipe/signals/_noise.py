"""Noise of a record, estimated from the record alone.

High-order differences remove every smooth motion; the median makes the few samples at contacts harmless. A sensor that
averages leaves neighbouring samples correlated, and differences see too little: the estimate is repeated on block means
until it no longer grows.
"""

from itertools import pairwise
from math import comb, sqrt
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats

_DIFFERENCE_ORDER = 8  # a sinusoid of 20 samples per period is suppressed 2e4 times against noise
_LARGEST_BLOCK = 64  # of samples, and the fewest differences in one
_PLATEAU = 1.3  # two doublings of the block that change no more than this: it no longer grows
_DYNAMIC_RANGE = 1e-9  # no sensor resolves more; a computed curve without noise is treated so


class Noise(NamedTuple):
    """Standard deviation of the noise as a smoother sees it.

    ``sigma`` is the level of white noise with the same power at low frequency; ``step`` the quantisation found (0 when
    none); ``block`` the number of samples over which the noise is correlated (1 = white).
    """

    sigma: float
    step: float
    block: int


def estimate_noise(values: Floats, time: Floats | None = None) -> Noise:
    """Estimate the noise of samples in their order.

    Parameters
    ----------
    values : array (n,)
        Finite samples.
    time : array (n,), optional
        Their times, when they are not evenly spaced.

    Notes
    -----
    White noise has the same level in samples and in means of 2 and 4 samples (times the root of their number);
    correlated noise climbs to such a plateau, motion climbs without one. The first plateau is taken, and the samples
    themselves when there is none; at least ``step / sqrt(12)``, the standard deviation of rounding, or 1e-9 of the
    range.
    """
    step, low, high = quantisation_step(values), float(np.min(values)), float(np.max(values))
    floor = max(step / sqrt(12.0), 4.0 * float(np.finfo(float).eps) * max(high, -low), _DYNAMIC_RANGE * (high - low))
    if time is not None and np.ptp(interval := np.diff(time)) < 1e-3 * np.min(interval):
        time = None
    levels: list[float] = []
    block = 1
    while block == 1 or (block <= _LARGEST_BLOCK <= len(values)):
        levels.append(sqrt(block) * difference_sigma(values, time))
        even = slice(len(values) // 2 * 2)
        values = 0.5 * (values[even][::2] + values[even][1::2])
        time = None if time is None else 0.5 * (time[even][::2] + time[even][1::2])
        block *= 2
        three = levels[-3:]
        if len(three) == 3 and all(abs(np.log(b / a)) < np.log(_PLATEAU) for a, b in pairwise(three) if a and b):
            # On a later plateau the lowest blocks are still a little short of the top.
            found = levels[0] if len(levels) == 3 else max(three)
            return Noise(max(found, floor), step, 2 ** (len(levels) - 3))
    return Noise(max(levels[0], floor), step, 1)


def difference_sigma(values: Floats, time: Floats | None = None) -> float:
    """Noise level from the median of high-order differences; 0 when there are too few samples."""
    order = min(_DIFFERENCE_ORDER, len(values) - 2)
    if order < 1:
        return 0.0
    if time is None:
        binomial = [(-1.0) ** k * comb(order - 1, k) for k in range(order)]  # zero, without rounding, of equal values
        return deviation(np.correlate(np.diff(values), binomial)) / sqrt(comb(2 * order, order))
    # Divided differences, scaled so that white noise keeps its level.
    t, y = (np.lib.stride_tricks.sliding_window_view(each, order + 1) for each in (time, values))
    t = (t - t[:, :1]) / (t[:, -1:] - t[:, :1])
    weights = 1.0 / np.prod(t[:, :, None] - t[:, None, :] + np.eye(order + 1), axis=2)
    return deviation(np.sum(weights * y, axis=1) / np.linalg.norm(weights, axis=1))


def deviation(values: Floats) -> float:
    """Return the standard deviation of normal values (n,) about 0 from their median magnitude, robust to few others."""
    middle = len(values) // 2
    return 1.4826022185056018 * float(np.partition(np.abs(values), middle)[middle])


def quantisation_step(values: Floats) -> float:
    """Return the step of which all samples are multiples (about an offset), or 0.

    Among the differences it must occur three times, none or another multiple as well, and nine in ten must be multiples
    to a twentieth; noise of a continuous sensor passes none of these.
    """
    some = max(len(values) // 5000, 1)  # of a long record
    differences = np.abs(values[1::some] - values[:-1:some])
    # What is smaller is rounding of floating-point arithmetic on top of the step.
    positive = differences[differences > 16.0 * float(np.finfo(float).eps) * float(np.max(np.abs(values), initial=0.0))]
    near = positive[positive < 1.5 * float(np.min(positive, initial=np.inf))]
    if len(positive) < 8 or len(near) < 3:
        return 0.0
    step = float(np.median(near))
    ratio = positive[positive < 20.0 * step] / step
    has_variety = len(positive) < len(differences) or float(np.ptp(ratio)) > 0.5
    is_rounded = has_variety and float(np.mean(np.abs(ratio - np.round(ratio)) < 0.05)) >= 0.9
    return step if is_rounded else 0.0

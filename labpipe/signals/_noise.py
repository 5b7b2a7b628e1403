"""Noise of a record, estimated from the record alone.

High-order differences remove every smooth motion and leave the noise; the median makes the few
samples at contacts harmless. A sensor that averages (a moving average of N samples, a low-pass)
leaves neighbouring samples correlated, and then differences see far too little: the estimate is
repeated on block means, and climbs until it no longer grows.
"""

from itertools import pairwise
from math import comb, sqrt
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats

DIFFERENCE_ORDER = 8
"""High enough that a sinusoid of 20 samples per period is suppressed 2e4 times against noise."""

_MEDIAN_TO_SIGMA = 1.4826022185056018
_LARGEST_BLOCK = 64
_FEWEST_DIFFERENCES = 64
_PLATEAU = 1.3  # two doublings of the block that change no more than this: it no longer grows
_DYNAMIC_RANGE = 1e-9  # no sensor resolves more; a computed curve without noise is treated so
_UNEVEN = 1e-3  # relative spread of the sampling interval from which times are taken into account


class Noise(NamedTuple):
    """Standard deviation of the noise as a smoother sees it.

    ``sigma`` is the level of white noise with the same power at low frequency; ``step`` the
    quantisation found (0 when none); ``block`` the number of samples over which the noise is
    correlated (1 = white).
    """

    sigma: float
    step: float
    block: int


def estimate_noise(values: Floats, time: Floats | None = None) -> Noise:
    """Estimate the noise of equally important samples in their order.

    Parameters
    ----------
    values : array (n,)
        Finite samples.
    time : array (n,), optional
        Their times, when they are not evenly spaced.

    Returns
    -------
    Noise
        In the unit of ``values``.

    Notes
    -----
    White noise has the same level in samples and in means of 2 and 4 samples (times the root of
    their number); correlated noise climbs to such a plateau, motion climbs without one. The first
    plateau is taken, and the samples themselves when there is none.
    The smallest value returned is ``step / sqrt(12)``, the standard deviation of rounding, or
    1e-9 of the range of the values.

    Examples
    --------
    >>> wave = np.sin(np.linspace(0.0, 9.0, 5000))
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal(5000)
    >>> round(estimate_noise(wave + noise).sigma * 1e3, 1)
    1.0
    """
    step = quantisation_step(values)
    resolution = 4.0 * float(np.finfo(float).eps) * float(np.max(np.abs(values), initial=0.0))
    floor = max(step / sqrt(12.0), resolution, _DYNAMIC_RANGE * float(np.ptp(values)))
    levels: list[float] = []
    block = 1
    while block == 1 or (block <= _LARGEST_BLOCK and len(values) >= _FEWEST_DIFFERENCES):
        levels.append(sqrt(block) * difference_sigma(values, time))
        values, time = _means_of_two(values), None if time is None else _means_of_two(time)
        block *= 2
        three = levels[-3:]
        if len(three) == 3 and all(abs(np.log(b / a)) < np.log(_PLATEAU) for a, b in pairwise(three) if a and b):
            # On a later plateau the lowest blocks are still a little short of the top.
            found = levels[0] if len(levels) == 3 else max(three)
            return Noise(max(found, floor), step, 2 ** (len(levels) - 3))
    return Noise(max(levels[0], floor), step, 1)


def difference_sigma(values: Floats, time: Floats | None = None) -> float:
    """Noise level from the median of high-order differences; 0 when there are too few samples."""
    order = min(DIFFERENCE_ORDER, len(values) - 2)
    if order < 1:
        return 0.0
    interval = None if time is None else np.diff(time)
    if time is None or interval is None or np.ptp(interval) < _UNEVEN * np.min(interval):
        differences = np.diff(values, order) / sqrt(comb(2 * order, order))
    else:
        differences = _divided_differences(values, time, order)
    return _MEDIAN_TO_SIGMA * float(np.median(np.abs(differences)))


def _divided_differences(values: Floats, time: Floats, order: int) -> Floats:
    """Differences over uneven times, scaled so that white noise keeps its level."""
    count = len(values) - order
    t = np.stack([time[j : j + count] for j in range(order + 1)], axis=1)
    t = (t - t[:, :1]) / (t[:, -1:] - t[:, :1])
    gaps = t[:, :, None] - t[:, None, :] + np.eye(order + 1)
    weights = 1.0 / np.prod(gaps, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    y = np.stack([values[j : j + count] for j in range(order + 1)], axis=1)
    return np.asarray(np.sum(weights * y, axis=1))


def quantisation_step(values: Floats) -> float:
    """Return the step of which all samples are multiples (about an offset), or 0.

    The step must be met at least three times among the differences, differences of no step at all
    or of another multiple must occur, and nine in ten differences must be multiples to a twentieth;
    noise of a continuous sensor passes none of these.
    """
    differences = np.abs(np.diff(values))
    resolution = 16.0 * float(np.finfo(float).eps) * float(np.max(np.abs(values), initial=0.0))
    # What is smaller is rounding of floating-point arithmetic on top of the step.
    positive = differences[differences > resolution]
    if len(positive) < 8:
        return 0.0
    smallest = float(np.min(positive))
    near = positive[positive < 1.5 * smallest]
    step = float(np.median(near))
    ratio = positive[positive < 20.0 * step] / step
    is_multiple = np.abs(ratio - np.round(ratio)) < 0.05
    has_variety = len(positive) < len(differences) or float(np.ptp(ratio)) > 0.5
    if len(near) < 3 or not has_variety or float(np.mean(is_multiple)) < 0.9:
        return 0.0
    return step


def _means_of_two(values: Floats) -> Floats:
    end = len(values) // 2 * 2
    return 0.5 * (values[0:end:2] + values[1:end:2])

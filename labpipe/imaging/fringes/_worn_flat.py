"""A flat worn into the sphere, found where a whole sphere does not explain a film's contacts."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._trials import Attempt, Calibration, Trial

#: Flats that are tried as shares of the smallest contact, until one leaves so much more than
#: another; frames and pixels for that, and variances by which one must lower the sum of squares.
_FLATS, _WORSE = (0.35, 0.5, 0.62, 0.74, 0.86, 0.96), 1.2
_FLAT_FRAMES, _FLAT_PIXELS, _FLAT_VARIANCES, _FLAT_ROUNDS = 4, 12_000, 40.0, 2


def _disagreement(smaller: Trial, middle: Trial, larger: Trial, unit: float) -> float:
    """Mean square by which flats of single frames differ from that of all, over that of noise; 1 or more.

    A flat is the same in all contacts; another error of the sphere's form looks like one of another size in each.
    """
    before, now, after = (trial.left_of_each for trial in (smaller, middle, larger))
    bends = np.maximum(before + after - 2.0 * now, 1e-9)
    places = 0.5 * (before - after) / bends  # in steps from the middle
    mean = np.average(places, weights=bends)
    return max(float((bends * (places - mean) ** 2).sum()) / unit / max(len(bends) - 1, 1), 1.0)


def find_flat(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Flat that leaves least in all frames, when it explains them better than a whole sphere."""
    if known.flat or not best.is_doubtful:
        return None
    smallest = min(float(fit.parameters[Parameter.RADIUS]) for fit in best.fits)

    def left(flat: float) -> float:
        trial = attempt(axes, replace(known, flat=flat), _FLAT_FRAMES, _FLAT_PIXELS)
        return math.inf if trial is None else trial.left

    tried = [(0.0, left(0.0))]
    for share in _FLATS:
        tried.append((share * smallest, left(share * smallest)))
        if tried[-1][1] > _WORSE * min(value for _, value in tried):
            break
    near = min(range(len(tried)), key=lambda place: tried[place][1])
    if near == 0:
        return None
    low, high = tried[near - 1][0], tried[min(near + 1, len(tried) - 1)][0]
    width = high - low
    flat = float(minimize_scalar(left, bounds=(low, high), method="bounded", options={"xatol": 0.01 * width}).x)
    trial = attempt(axes, replace(known, flat=flat))
    if trial is None or trial.gain_over(best) < _FLAT_VARIANCES:
        return None
    # a wrong wavelength or ruler is commoner than wear, and moves rings nearly alike
    scaled = attempt((*axes, Parameter.SCALE), known)
    if scaled is not None and scaled.gain_over(best) >= trial.gain_over(best):
        return None
    # All pixels of all frames place the minimum better: the vertex of ever narrower parabolas.
    step = 0.1 * width
    for _ in range(_FLAT_ROUNDS):
        smaller, larger = (attempt(axes, replace(known, flat=size)) for size in (flat - step, flat + step))
        if smaller is None or larger is None:
            return None
        middle = trial
        bend = max((smaller.left + larger.left - 2.0 * trial.left) / step**2, 1e-9)
        flat += float(np.clip((smaller.left - larger.left) / (2.0 * step * bend), -step, step))
        trial = attempt(axes, replace(known, flat=flat)) or trial
        least = 2.0 * max(trial.left / trial.pixels, 1.0) / bend
        u_flat = min(math.sqrt(least * _disagreement(smaller, middle, larger, least * bend)), width)
        slopes = larger.changes(smaller) / (2.0 * step)
        step = min(step, 5.0 * u_flat)
    return trial, replace(known, flat=flat).with_shared(trial, slopes * u_flat)

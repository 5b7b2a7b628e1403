"""Harmonics of the fringes, of many beams before the lens or of a camera behind it that is not linear."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labpipe.imaging.fringes._lens_blur import LEAST_SHAPED, find_blur
from labpipe.imaging.fringes._ring_parameters import HARMONICS, Parameter
from labpipe.imaging.fringes._trials import VARIANCES, Attempt, Calibration, Trial, doubt, is_promising


def with_harmonics(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> tuple[Trial | None, Calibration]:
    """Fit the frames with harmonics, and return what is known with them."""
    trial = attempt((*axes, *HARMONICS), known)
    if trial is None:
        return None, known
    return trial, replace(known, harmonics=(trial.mean(Parameter.SECOND)[0], trial.mean(Parameter.THIRD)[0]))


def find_harmonics(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Harmonics of the fringes, before or behind the lens, when they explain the frames much better."""
    if known.harmonics != (0.0, 0.0) or not best.is_doubtful:
        return None
    orders = (False, True) if known.blur else (False,)
    free = (*axes, *HARMONICS)
    seen = [replace(known, by_camera=after) for after in orders]
    likely = [one for one in seen if is_promising(attempt, (axes, known), (free, one), best)]
    tried = [with_harmonics(attempt, axes, one) for one in likely]
    better = [(trial, found) for trial, found in tried if trial is not None and trial.is_better_than(best)]
    if not better:
        return None
    return min(better, key=lambda one: one[0].left)


def find_blur_before_camera(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Lens that blurs before a camera that is not linear, where neither explains much without the other."""
    if known.blur or known.harmonics != (0.0, 0.0):
        return None
    found = find_blur(attempt, (*axes, *HARMONICS), replace(known, by_camera=True), best)
    if found is None or found[1].blur < LEAST_SHAPED:
        return None
    trial, both = with_harmonics(attempt, axes, found[1])
    without = attempt(axes, found[1])
    if trial is None or (without is not None and trial.gain_over(without) <= VARIANCES * len(best.fits)):
        return None
    return trial, both


def settle_harmonics(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration:
    """Tell where harmonics arise when the lens blurs as well, and count as uncertain what that leaves open.

    Those of many beams are blurred with all else, those of a camera that is not linear arise after the
    lens, and are smaller where the fringes are fine.
    """
    if known.harmonics == (0.0, 0.0):
        return known
    orders = (False, True) if known.blur else (False,)
    tried = (with_harmonics(attempt, axes, replace(known, by_camera=after)) for after in orders)
    found = sorted(((trial, seen) for trial, seen in tried if trial is not None), key=lambda one: one[0].left)
    if len(found) < len(orders):
        return known
    (trial, known), (other, _) = found[0], found[-1]
    by_order = trial.changes(other) * math.sqrt(doubt(other.left - trial.left))
    return known.with_shared(trial, np.hypot(by_order, trial.shift_of_radius(HARMONICS)))

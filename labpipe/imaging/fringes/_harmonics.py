"""Harmonics of the fringes, of many beams before the lens or of a camera behind it that is not linear."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labpipe.imaging.fringes._lens_blur import LEAST_SHAPED, find_blur, shape_anew
from labpipe.imaging.fringes._ring_parameters import BEAMS, COATING, HARMONICS, Parameter
from labpipe.imaging.fringes._trials import FACTOR, SIGNIFICANT, VARIANCES, Attempt, Calibration, Trial, doubt
from labpipe.imaging.fringes._view import View


def with_harmonics(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> tuple[Trial | None, Calibration]:
    """Fit the frames with harmonics, and return what is known with them."""
    trial = attempt((*axes, *_free(known)), known)
    return (None, known) if trial is None else (trial, replace(known, harmonics=trial.harmonics))


def _free(known: Calibration) -> tuple[Parameter, ...]:
    """Return which harmonics are fitted, given what is known."""
    return HARMONICS if known.harmonics[1] else BEAMS


def find_harmonics(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Harmonics of the fringes, before or behind the lens, when they explain the frames much better."""
    if any(known.harmonics) or not best.is_doubtful:
        return None
    orders = (False, True) if known.blur else (False,)
    seen = [replace(known, by_camera=after) for after in orders]
    tried = [with_harmonics(attempt, axes, one) for one in seen]
    better = [(trial, found) for trial, found in tried if trial is not None and trial.is_better_than(best)]
    if not better:
        return None
    return min(better, key=lambda one: one[0].left)


def find_coating(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, view: View, least: float
) -> tuple[Trial, Calibration] | None:
    """Phase and turned harmonics of coatings that absorb, when neither explains as much without the other.

    Nor may something simpler, of which the ``least`` squared misfit is known.
    """
    if known.harmonics[1] or not best.is_doubtful:
        return None
    trial = attempt((*axes, *COATING), known)
    if trial is None or not trial.is_better_than(best):
        return None
    turned, deviation = trial.mean(Parameter.TURNED)
    if abs(turned) <= SIGNIFICANT * deviation or trial.excess * FACTOR > least:
        return None
    for free in (BEAMS, (Parameter.PHASE,)):
        simpler = attempt((*axes, *free), known)
        if simpler is not None and not trial.is_better_than(simpler):
            return None
    phase, deviation = trial.mean(Parameter.PHASE)
    shift = phase - view.optics.phase
    return trial, replace(known, harmonics=trial.harmonics, phase_shift=shift, u_phase_shift=deviation)


def find_blur_before_camera(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Lens that blurs before a camera that is not linear, where neither explains much without the other."""
    if known.blur or any(known.harmonics):
        return None
    found = find_blur(attempt, axes, replace(known, by_camera=True), best, BEAMS)
    if found is None or found[1].blur < LEAST_SHAPED:
        return None
    trial, both = with_harmonics(attempt, axes, found[1])
    without = attempt(axes, found[1])
    if trial is None or (without is not None and trial.gain_over(without) <= VARIANCES * len(best.fits)):
        return None
    return trial, both


def settle_harmonics(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration:
    """Tell where harmonics arise when the lens blurs as well, and count as uncertain what that leaves open.

    Harmonics bend the shape that a blur seemed to have before them: it is found again. Those of many
    beams are blurred with all else, those of a camera that is not linear arise after the lens, and are
    smaller where the fringes are fine.
    """
    if not any(known.harmonics):
        return known
    known = shape_anew(attempt, (*axes, *_free(known)), known)
    tried = (with_harmonics(attempt, axes, replace(known, by_camera=after)) for after in (False, True))
    found = sorted(((trial, seen) for trial, seen in tried if trial is not None), key=lambda one: one[0].left)
    if len(found) < 2:
        return known
    (trial, known), (other, _) = found[0], found[-1]
    by_order = trial.changes(other) * math.sqrt(doubt(other.left - trial.left))
    return known.with_shared(trial, np.hypot(by_order, trial.shift_of_radius(_free(known))))

"""A camera that sharpens its images, as most do that were not made to measure: the finer fringes are, the higher."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labpipe.imaging.fringes._lens_blur import BLUR_ROUNDS, LEAST_BLUR, least_blur
from labpipe.imaging.fringes._ring_parameters import EVEN, Parameter
from labpipe.imaging.fringes._together import what_is_found, with_beside
from labpipe.imaging.fringes._trials import ALL_PIXELS, FEW_PIXELS, HINT, SIGNIFICANT, Attempt, Calibration, Trial
from labpipe.imaging.fringes._view import View

#: Standard deviations (px) of the blur that a camera takes from its images: those tried, and by how much the likeliest
#: is placed by all pixels; most of what it takes; relative change at which that is settled.
_WIDTHS, _STEP, _MOST_SHARE, _SETTLED = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0), 1.1, 8.0, 0.002
#: Rounds in which the width is placed by all pixels, and steps in one at most.
_ROUNDS, _MOST_STEPS = 3, 3.0


def find_sharpening(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Sharpening that explains why frames show less than no blur: travel whose square is negative."""
    square, deviation = best.mean(Parameter.SMEAR)
    if known.halo[0] or square > -max(EVEN * LEAST_BLUR**2, SIGNIFICANT * deviation):
        return None

    first = -square / EVEN
    some = {
        width: found
        for width in _WIDTHS
        if (found := _sharpened(attempt, axes, known, (first / width**2, width), FEW_PIXELS)) is not None
    }
    if not some:
        return None
    width = min(some, key=lambda w: some[w][0].left / some[w][0].pixels)
    settled = _settled(attempt, axes, known, (some[width][1], width))
    return None if settled is None or settled[0].gain_over(best) <= HINT else settled


def sharpen_together(attempt: Attempt, axes: Sequence[Parameter], known: Calibration, view: View) -> Calibration:
    """Find sharpening again together with what was found beside it: either was found while the other was wrong."""
    beside = what_is_found(known)
    free = (*axes, *beside)
    # the fit with all of it free is what the others begin from
    is_again = known.halo[0] and beside and attempt(free, known) is not None
    settled = _settled(attempt, free, known, known.halo) if is_again else None
    return known if settled is None else with_beside(*settled, beside, view)


def _sharpened(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, halo: tuple[float, float], pixels: int = ALL_PIXELS
) -> tuple[Trial, float] | None:
    """Fit with as much of a sharpening of one width as leaves no travel in the frame at rest, and tell how much."""
    (share, width), trial = halo, None
    for _ in range(BLUR_ROUNDS):
        trial = attempt(axes, replace(known, halo=(share, width)), pixels=pixels)
        if trial is None or not trial.pixels:
            return None
        step = -least_blur(trial, 0.0)[0] / width**2
        share = float(np.clip(share + step, 0.5 * share, min(2.0 * share, _MOST_SHARE)))
        if abs(step) < _SETTLED * share:
            break
    return None if trial is None else (trial, share)


def _settled(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, halo: tuple[float, float]
) -> tuple[Trial, Calibration] | None:
    """Place the width by all pixels of all frames, and tell what its uncertainty makes of the radius."""
    share, width = halo
    for _ in range(_ROUNDS):
        sizes = (width / _STEP, width, width * _STEP)
        near = [_sharpened(attempt, axes, known, (share * (width / w) ** 2, w)) for w in sizes]
        made = [found for found in near if found is not None]
        if len(made) < len(near):
            return None
        (smaller, _), (middle, share), (larger, _) = made
        bend = max(smaller.left + larger.left - 2.0 * middle.left, 1e-9)
        beyond = float(np.clip(0.5 * (smaller.left - larger.left) / bend, -_MOST_STEPS, _MOST_STEPS))
        share, width = share * _STEP ** (-2.0 * beyond), width * _STEP**beyond
        if abs(beyond) < 1.0:
            break
    seen = replace(known, halo=(share, width))
    trial = attempt(axes, seen)
    if trial is None:
        return None
    steps = math.sqrt(2.0 * max(middle.left / middle.pixels, 1.0) / bend)
    return trial, seen.with_shared(trial, 0.5 * larger.changes(smaller) * min(steps, _MOST_STEPS))

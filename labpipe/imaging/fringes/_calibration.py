"""Calibration of the optics from a whole film: phase, phase scale, blur, ellipticity, harmonics, flat.

Each of them is taken from the largest contacts and then held for all frames. Left free in every
frame they would multiply the effect of every other error.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._attempts import Attempts
from labpipe.imaging.fringes._harmonics import find_blur_before_camera, find_coating, find_harmonics, settle_harmonics
from labpipe.imaging.fringes._lens_blur import find_blur, settle_blur
from labpipe.imaging.fringes._open_gap import explained_by_gap
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import ASSUMED, AXES, BEAMS, Parameter
from labpipe.imaging.fringes._second_colour import find_second_colour, settle_colour
from labpipe.imaging.fringes._together import settle_together
from labpipe.imaging.fringes._trials import (
    BY_MEMORY,
    FACTOR,
    FEW_PIXELS,
    MOST_FRAMES,
    PROMISE,
    SIGNIFICANT,
    VARIANCES,
    Attempt,
    Calibration,
    Trial,
    is_promising,
)
from labpipe.imaging.fringes._view import View
from labpipe.imaging.fringes._worn_flat import find_flat, weigh_flat

#: Greatest logarithm of the phase scale that is believed: a factor of two.
_MOST_SCALE = 0.7
#: Relative change of the blur at which it is settled with all else free.
_SETTLED_BLUR = 0.003
#: Share of the squared misfit below which nothing else is looked for beside what leaves no more, whatever that is
#: and where it may be there by chance.
_ALL_BUT, _MOSTLY = 0.02, 0.1
#: Explanations that cost most: a simpler one that leaves less than that by chance is taken before.
_COSTLY = 2
#: Place of the explanation that is no function of the distance: none of the others is tried where all such
#: functions together would not explain enough.
_UNEVEN = 1
#: Share that they explain from which no ellipse is tried.
_ROUND = 0.75
#: Share of a frame's squared misfit that a scale of its own must explain before frames are looked for whose gap
#: opens less than in the others; logarithm of the scale by which it does, at least and over the median difference;
#: share of the frames that do, at most.
_BY_GAP, _OPENED, _APART, _FEW_OPENED = 0.3, 0.03, 8.0, 0.34
#: Variances from which a phase is hinted at, beyond two for each frame, where pixels scatter alone.
_WEAK_HINT = 10.0
#: Variances by which one phase and scale for all frames would lower the squares from which more is asked of them.
_HINTED = 12.0
#: Things that are found one after the other at most, and from how many on they are found again together.
_ROUNDS, _TOGETHER = 4, 2


def calibrate(
    frame_of: Callable[[int], NDArray[np.generic]],
    fits: dict[int, RingFit],
    view: View,
    *,
    is_phase_free: bool,
    shape: str,
    rough: Sequence[Parameter] = (),
    phase_stated: float = 0.0,
    log_stated: float = 0.0,
) -> Calibration:
    """Find phase, scale and ellipticity of a film.

    Parameters
    ----------
    frame_of : callable
        Reads a frame.
    fits : dict
        Fits by frame.
    view : View
        The view they were made with.
    is_phase_free : bool
        Whether the phase may be changed.
    shape : "auto", "circle" or "ellipse"
        Whether circles may be ellipses: if the film says so, no, or yes in every frame.
    rough : sequence of Parameter
        Which of phase and scale the view has from single frames, so that they are found anew.
    phase_stated, log_stated : float
        Phase and logarithm of the phase scale as they are stated, relative to those of the view.

    Returns
    -------
    Calibration
        What differs from the assumptions beyond doubt; the assumptions else.
    """
    chosen = _choose(fits)
    if not chosen:
        return Calibration()
    attempt = Attempts([frame_of(index) for index in chosen], [fits[index] for index in chosen], view)
    plain_axes = AXES if shape == "ellipse" else ()
    result = Calibration(frames=chosen, colour=view.optics.colour)
    best = attempt(plain_axes, result)
    if best is None:
        return Calibration(colour=view.optics.colour)
    best, result = _without_opened(attempt, plain_axes, result, best)
    if shape == "auto":
        best, result = _find_ellipse(attempt, result, best)
    if rough:
        trial = attempt((*plain_axes, *rough), result)
        if trial is not None:
            result = _with(trial, result, rough, view)
            best = attempt(plain_axes, result) or best
    if result.colour[1]:
        best, result = settle_colour(attempt, plain_axes, result) or (best, result)
    # One may hide behind another: whatever explains most comes first.
    vain: dict[int, float] = {}
    for _ in range(_ROUNDS):
        better: list[tuple[Trial, Calibration]] = []
        for trial, found in _candidates(attempt, plain_axes, result, best, view, vain, log_stated):
            # What differs from frame to frame fits better than what holds for all: compare the latter.
            better.append((attempt(plain_axes, found) or trial, found))
            share = better[-1][0].excess / max(best.excess, 1e-300)
            if share < _ALL_BUT or (share < _MOSTLY and better[-1][0].is_all_noise):
                break
        if not better:
            break
        reference = best
        trial, found = max(better, key=lambda candidate: candidate[0].gain_over(reference))
        if found.phase_shift != result.phase_shift and not is_phase_free:
            # The scale would be bent to make up for a phase that is not what it is said to be.
            return replace(result, doubted_phase=view.optics.phase + found.phase_shift)
        result, best = found, trial
        attempt.begin_from(best, plain_axes, result)
    settled, result = settle_blur(attempt, plain_axes, result, best)
    if settled is not best:
        best = settled
        attempt.begin_from(best, plain_axes, result)
    best, result = weigh_flat(attempt, plain_axes, result, best, log_stated)
    result = settle_harmonics(attempt, plain_axes, result)
    best = attempt(plain_axes, result) or best
    if result.is_usual and not best.is_doubtful and best.shared_gain(ASSUMED) < _HINTED:
        return result
    stated = Calibration(phase_shift=phase_stated, log_scale=log_stated)
    return settle_together(attempt, plain_axes, result, best, stated, is_phase_free=is_phase_free)


def _without_opened(
    attempt: Attempts, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration]:
    """Leave out the few frames in which the gap opens less than in all others: the contact recedes from a dent.

    They would hide that R, the wavelength or the ruler is wrong, which is the same in all frames.
    """
    if not best.is_doubtful or all(explained_by_gap(fit) < _BY_GAP for fit in best.fits):
        return best, known
    trial = attempt((*axes, Parameter.SCALE), known, pixels=FEW_PIXELS)
    if trial is None:
        return best, known
    scales = np.array([float(fit.parameters[Parameter.SCALE]) for fit in trial.fits])
    below = np.median(scales) - scales
    is_opened = below > max(_OPENED, _APART * float(np.median(np.abs(below))))
    if not 0 < is_opened.sum() <= _FEW_OPENED * len(scales):
        return best, known
    kept = np.flatnonzero(~is_opened).tolist()
    known = replace(known, frames=tuple(known.frames[k] for k in kept))
    best = Trial(tuple(best.fits[k] for k in kept), tuple(best.noise[k] for k in kept))
    attempt.keep(kept, best, axes, known)
    return best, known


def _candidates(
    attempt: Attempts,
    axes: Sequence[Parameter],
    known: Calibration,
    best: Trial,
    view: View,
    vain: dict[int, float],
    log_stated: float,
) -> Iterator[tuple[Trial, Calibration]]:
    """Yield what explains the frames much better, the likelier and cheaper first.

    What explained nothing before is tried again when most of the misfit that it was ``vain`` at is gone,
    and the last, which cost most, when nothing simpler explains most of it. Functions of the distance explained
    nothing where all of them could 0.46 of the misfit, and what is much better explains more.
    """
    is_round = not best.is_doubtful or attempt.round_share(best, known) > 1.0 - 1.0 / FACTOR
    makers: tuple[Callable[[], tuple[Trial, Calibration] | None], ...] = (
        lambda: find_blur(attempt, axes, known, best),
        lambda: _find_uneven_light(attempt, axes, known, best),
        lambda: find_harmonics(attempt, axes, known, best),
        lambda: find_coating(attempt, axes, known, best, view),
        lambda: _find_optics(attempt, axes, known, best, Parameter.PHASE, view),
        lambda: _find_optics(attempt, axes, known, best, Parameter.SCALE, view),
        lambda: None if known.spread else _find_optics(attempt, axes, known, best, Parameter.SPREAD, view),
        lambda: find_flat(attempt, axes, known, best),
        lambda: find_flat(attempt, axes, replace(known, log_scale=log_stated), best) if log_stated else None,
        lambda: find_blur_before_camera(attempt, axes, known, best),
        lambda: find_second_colour(attempt, axes, known, best),
    )
    least = best.excess
    for place, make in enumerate(makers):
        is_vain = FACTOR * best.excess > vain.get(place, math.inf) or (place != _UNEVEN and not is_round)
        if is_vain or (place >= len(makers) - _COSTLY and least < _MOSTLY * best.excess):
            continue
        found = make()
        if found is not None:
            least = min(least, found[0].excess)
            yield found
        else:
            vain[place] = best.excess


def _find_ellipse(attempt: Attempts, known: Calibration, best: Trial) -> tuple[Trial, Calibration]:
    """Ellipse that explains the frames much better than circles, its area being right or not.

    A view that is oblique, or scaled along one axis, changes the area that a contact of known fringes
    covers: then neither ellipse nor scale explains anything without the other. Where nearly all that is left is
    the same all around the rings, no ellipse explains much of it.
    """
    if best.is_doubtful and attempt.round_share(best, known) > _ROUND:
        return best, known
    for extra in (AXES, (*AXES, Parameter.SCALE)):
        is_likely = best.may_gain(extra) and is_promising(attempt, ((), known), (extra, known), best, may_hide=False)
        oblique = attempt(extra, known) if is_likely else None
        if oblique is None or oblique.gain_over(best) <= VARIANCES * len(best.fits):
            continue
        # dust and the like leave as much with any ellipse
        is_beyond = oblique.gain_over(best) > BY_MEMORY * VARIANCES * len(best.fits)
        if oblique.rough_excess * (1.0 / PROMISE if is_beyond else FACTOR) >= best.rough_excess:
            continue
        (stretch, u_stretch), (shear, u_shear) = (oblique.mean(axis) for axis in AXES)
        if max(abs(stretch) / u_stretch, abs(shear) / u_shear) <= SIGNIFICANT:
            continue
        found = replace(known, ellipse=(stretch, shear))
        if Parameter.SCALE in extra:
            scale, u = oblique.mean(Parameter.SCALE)
            if abs(scale) <= SIGNIFICANT * u or abs(scale) > _MOST_SCALE:
                continue
            found = replace(found, log_scale=scale)
        return attempt((), found) or oblique, found
    return best, known


def _with(trial: Trial, known: Calibration, free: Sequence[Parameter], view: View) -> Calibration:
    """Take what was left free in a trial from it."""
    if Parameter.PHASE in free:
        known = replace(known, phase_shift=trial.mean(Parameter.PHASE)[0] - view.optics.phase)
    if Parameter.SCALE in free:
        known = replace(known, log_scale=known.log_scale + trial.mean(Parameter.SCALE)[0])
    if Parameter.SPREAD in free:
        known = replace(known, spread=max(known.spread + trial.mean(Parameter.SPREAD)[0], 0.0))
    if Parameter.SECOND in free:
        known = replace(known, harmonics=trial.harmonics)
    if Parameter.STRETCH in free:
        known = replace(known, ellipse=(trial.mean(Parameter.STRETCH)[0], trial.mean(Parameter.SHEAR)[0]))
    return known


def _find_uneven_light(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration] | None:
    """Light of higher powers of place, when it explains the frames much better."""
    is_negative = any(fit.has_negative_light for fit in best.fits)
    if known.has_uneven_light or not (best.is_doubtful or is_negative):
        return None
    uneven = replace(known, has_uneven_light=True)
    if not (is_negative or is_promising(attempt, (axes, known), (axes, uneven), best)):
        return None
    trial = attempt(axes, uneven)
    if trial is None:
        return None
    is_better = trial.is_better_than(best) or (is_negative and trial.gain_over(best) > VARIANCES * len(best.fits))
    return (trial, uneven) if is_better else None


def _found(known: Calibration) -> list[tuple[Parameter, ...]]:
    """Return what was found, by groups of parameters."""
    groups = (
        ((Parameter.PHASE,), known.phase_shift != 0.0),
        ((Parameter.SCALE,), known.log_scale != 0.0),
        (BEAMS, any(known.harmonics)),
        ((Parameter.TURNED,), known.harmonics[1] != 0.0),
        ((Parameter.SPREAD,), known.spread != 0.0),
        (AXES, known.ellipse != (0.0, 0.0)),
    )
    return [group for group, is_found in groups if is_found]


def _find_optics(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, parameter: Parameter, view: View
) -> tuple[Trial, Calibration] | None:
    """Phase, scale or spread of colours that the film shows, when it explains the frames much better.

    What was found while it was wrong is found again with it.
    """
    beside = tuple(p for group in _found(known) for p in group)
    free = tuple(dict.fromkeys((*axes, parameter, *beside)))
    if not (best.may_gain((parameter,)) and is_promising(attempt, (axes, known), (free, known), best)):
        return None
    trial = attempt(free, known)
    if trial is None or not trial.is_better_than(best):
        return None
    value, deviation = trial.mean(parameter)
    found = _with(trial, known, (parameter, *beside), view)
    if parameter is Parameter.PHASE:
        value = found.phase_shift - known.phase_shift
    if abs(value) <= SIGNIFICANT * deviation or abs(found.log_scale) > _MOST_SCALE:
        return None
    return None if parameter is Parameter.SPREAD and value < 0.0 else (trial, found)


def _choose(fits: dict[int, RingFit]) -> tuple[int, ...]:
    """Frames whose radius is best known among the larger contacts."""
    radius = {index: float(fit.parameters[Parameter.RADIUS]) for index, fit in fits.items()}
    if not radius:
        return ()
    largest = max(radius.values())
    large = [index for index, value in radius.items() if value > 0.5 * largest]
    # Contacts that hardly move and are seen from all sides come first.
    large.sort(key=lambda index: (fits[index].deviation(Parameter.RADIUS), index))
    return tuple(sorted(large[:MOST_FRAMES]))

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
from labpipe.imaging.fringes._band import weigh_band, with_small_band
from labpipe.imaging.fringes._gains import in_order
from labpipe.imaging.fringes._harmonics import find_blur_before_camera, find_coating, find_harmonics, settle_harmonics
from labpipe.imaging.fringes._hidden import by_uneven_scale, with_hidden, with_hidden_flat
from labpipe.imaging.fringes._lens_blur import find_blur, settle_blur
from labpipe.imaging.fringes._open_gap import explained_by_gap
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import ASSUMED, AXES, BEAMS, COATING, RADIAL, Parameter
from labpipe.imaging.fringes._second_colour import find_second_colour, settle_colour
from labpipe.imaging.fringes._sharpening import find_sharpening, sharpen_together
from labpipe.imaging.fringes._together import find_together, what_is_found, with_beside
from labpipe.imaging.fringes._trials import (
    FACTOR,
    FEW_PIXELS,
    HALF,
    MOST_FRAMES,
    SIGNIFICANT,
    VARIANCES,
    Attempt,
    Calibration,
    Trial,
    is_promising,
)
from labpipe.imaging.fringes._view import View
from labpipe.imaging.fringes._worn_flat import find_flat, find_flat_together, find_small_flat, weigh_flat

#: Greatest logarithm of the phase scale that is believed: a factor of two.
_MOST_SCALE = 0.7
#: Share of the squared misfit below which nothing else is looked for beside what leaves no more, whatever that is
#: and where it may be there by chance; the same of what two things that explain little alone may leave.
_ALL_BUT, _MOSTLY = 0.02, 0.1
#: Explanations.
_BLUR, _BAND, _HARMONICS, _COATING, _PHASE, _SCALE = "blur", "band", "harmonics", "coating", "phase", "scale"
_UNEVEN, _FLAT, _FLAT_BESIDE, _FOCUS = "uneven light", "flat", "flat beside the stated scale", "focus"
_BEFORE_CAMERA, _COLOUR, _SHARPENED = "blur before the camera", "second colour", "sharpened"
#: Those that cost most: a simpler one that leaves less than that by chance is taken before.
_COSTLY = (_SHARPENED, _BEFORE_CAMERA, _COLOUR)
#: Share of the squared misfit that what is tried would explain to first order, at least: what is much better explains
#: half of it, and a blur of 2.5 px beside harmonics, which explained 0.97, promised 0.44; and squared misfit from which
#: half as much is enough: harmonics of 0.4 promised 0.41 of 0.02 and explained all.
_LIKELY, _STEEP = 0.25, 0.0025
#: Share of what is left beyond differences of neighbours that an ellipse explains to first order at least: 0.15 where
#: there was one, hardly seen as one yet, 0.003 beside coma, astigmatism, speckle and ghosts; squared misfit from which
#: first order tells nothing.
_OBLIQUE, _FAR = 0.1, 0.02
#: Share of a frame's squared misfit that a scale of its own must explain before frames are looked for whose gap
#: opens less than in the others; logarithm of the scale by which it does, at least and over the median difference;
#: share of the frames that do, at most.
_BY_GAP, _OPENED, _APART, _FEW_OPENED = 0.3, 0.03, 8.0, 0.34
#: What is tried beside a distance from focus, which must explain about as much as these.
_LIKE_FOCUS = (Parameter.PHASE,), (Parameter.SCALE, Parameter.SPREAD)
#: Squared misfit over that of a rival up to which a distance from focus is as likely; share of the difference of their
#: radii by which either may be off.
_AS_LIKELY, _BETWEEN = 1.3, 0.4
#: Factor by which the squared misfit must fall where something else must be found beside.
_SOME = 1.2
#: Things that are found one after the other at most.
_ROUNDS = 4


def calibrate(
    frame_of: Callable[[int], NDArray[np.generic]],
    fits: dict[int, RingFit],
    view: View,
    *,
    is_phase_free: bool,
    shape: str,
    rough: Sequence[Parameter] = (),
    log_stated: float = 0.0,
) -> Calibration:
    """Find what differs from the assumptions about the optics of a film beyond doubt, from fits by frame with a view.

    Circles may be ellipses if the film says so ("auto"), not, or in every frame. Which of phase and scale the view has
    from single frames, so that they are ``rough``, is found anew; ``log_stated`` is the logarithm of the phase scale
    as it is stated, relative to that of the view.
    """
    chosen = _choose(fits)
    if not chosen:
        return Calibration()
    attempt = Attempts([frame_of(index) for index in chosen], [fits[index] for index in chosen], view)
    plain_axes = AXES if shape == "ellipse" else ()
    result = Calibration(frames=chosen, colour=view.optics.colour)
    if rough:
        trial = attempt((*plain_axes, *rough), result)
        result = result if trial is None else with_beside(trial, result, rough, view)
    best = attempt(plain_axes, result)
    if best is None:
        return Calibration(colour=view.optics.colour)
    best, result = _without_opened(attempt, plain_axes, result, best)
    if shape == "auto":
        best, result = _find_ellipse(attempt, result, best)
    if result.colour[1]:
        best, result = (
            _of_one_colour(attempt, plain_axes, result, best, rough, view)
            or settle_colour(attempt, plain_axes, result)
            or (best, result)
        )
    # One may hide behind another: whatever explains most comes first.
    vain: dict[str, float] = {}
    alone: tuple[Trial, Calibration] | None = None
    for _ in range(_ROUNDS):
        better = _better(attempt, plain_axes, result, best, view, vain, log_stated)
        if not better and alone is None and best.is_doubtful:
            # of two things neither may explain much without the other
            alone, vain = (best, result), {}
            better = _better(attempt, plain_axes, result, replace(best, factor=_SOME), view, {}, log_stated)
        if not better:
            break
        trial, found = _best_of(better, best)
        if found.phase_shift != result.phase_shift and not is_phase_free:
            # The scale would be bent to make up for a phase that is not what it is said to be.
            return replace(result, doubted_phase=view.optics.phase + found.phase_shift)
        result, best = found, trial
        attempt.begin_from(best, plain_axes, result)
    if alone is not None and best is not alone[0] and best.excess > _MOSTLY * alone[0].excess:
        best, result = alone
        attempt.begin_from(best, plain_axes, result)
    settled, result = settle_blur(attempt, plain_axes, result, best)
    if settled is not best:
        best = settled
        attempt.begin_from(best, plain_axes, result)
    is_stated = Parameter.PHASE not in rough
    settled, result = weigh_flat(attempt, plain_axes, result, best, log_stated, is_stated=is_stated)
    settled, result = find_small_flat(attempt, plain_axes, result, settled)
    if settled is not best:
        best = settled
        attempt.begin_from(best, plain_axes, result)
    result = find_together(attempt, plain_axes, settle_harmonics(attempt, plain_axes, result), view)
    result = sharpen_together(attempt, plain_axes, find_flat_together(attempt, plain_axes, result, view), view)
    result = weigh_band(attempt, plain_axes, with_small_band(attempt, plain_axes, result, view), view)
    is_told = not is_phase_free or result.phase_shift != 0.0
    is_open = ((Parameter.PHASE, not is_told), (Parameter.SCALE, result.log_scale == 0.0))
    best = attempt(plain_axes, result)
    if best is None:
        return result
    result = replace(result, fits=best.fits).with_shared(best, by_uneven_scale(best))
    result = with_hidden_flat(attempt, plain_axes, result, best)
    return with_hidden(attempt, plain_axes, result, best, [parameter for parameter, is_free in is_open if is_free])


def _better(
    attempt: Attempts,
    axes: Sequence[Parameter],
    known: Calibration,
    best: Trial,
    view: View,
    vain: dict[str, float],
    log_stated: float,
) -> list[tuple[Trial, Calibration]]:
    """Return what explains the frames much better, until one leaves hardly anything."""
    better: list[tuple[Trial, Calibration]] = []
    for trial, found in _candidates(attempt, axes, known, best, view, vain, log_stated):
        # What differs from frame to frame fits better than what holds for all: compare the latter.
        better.append((attempt(axes, found) or trial, found))
        share = better[-1][0].excess / max(best.excess, 1e-300)
        if share < _ALL_BUT or (share < _MOSTLY and better[-1][0].is_all_noise):
            break
    return better


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


def _best_of(better: Sequence[tuple[Trial, Calibration]], before: Trial) -> tuple[Trial, Calibration]:
    """Return what explains the frames best, or a distance from focus that does about as well as a phase.

    A lens is out of focus more often than faces are coated; what explains about as much counts as what may be wrong.
    """
    # a blur leaves pixels out at the border
    ranked = sorted(better, key=lambda one: -one[0].gain_over(before) / one[0].pixels)
    focused = next((one for one in ranked if one[1].focus), None)
    other = next((one for one in ranked if not one[1].focus), None)
    if focused is None or other is None:
        return ranked[0]
    share, is_turned = focused[0].excess / max(other[0].excess, 1e-300), other[1].phase_shift != 0.0
    is_preferred = share < (_AS_LIKELY if is_turned and not focused[1].blur else 1.0)
    trial, found = focused if is_preferred else other
    if 1.0 / _AS_LIKELY < share < _AS_LIKELY:
        found = found.with_shared(trial, _BETWEEN * focused[0].changes(other[0]))
    return trial, found


def _candidates(
    attempt: Attempts,
    axes: Sequence[Parameter],
    known: Calibration,
    best: Trial,
    view: View,
    vain: dict[str, float],
    log_stated: float,
) -> Iterator[tuple[Trial, Calibration]]:
    """Yield what explains the frames much better, the likelier and cheaper first.

    What explained nothing before is tried again when most of the misfit that it was ``vain`` at is gone,
    and the last, which cost most, when nothing simpler explains most of it. What to first order explains too little
    to be much better, or far less than what was found, is not tried.
    """
    makers: dict[str, Callable[[], tuple[Trial, Calibration] | None]] = {
        _BLUR: lambda: _find_blur(attempt, axes, known, best, view),
        _BAND: lambda: None if known.spread else _find_optics(attempt, axes, known, best, Parameter.SPREAD, view),
        _UNEVEN: lambda: _find_uneven_light(attempt, axes, known, best),
        _HARMONICS: lambda: find_harmonics(attempt, axes, known, best),
        _SHARPENED: lambda: find_sharpening(attempt, axes, known, best),
        _PHASE: lambda: _find_optics(attempt, axes, known, best, Parameter.PHASE, view),
        _SCALE: lambda: _find_optics(attempt, axes, known, best, Parameter.SCALE, view),
        _COATING: lambda: find_coating(attempt, axes, known, best, view, least),
        _FLAT: lambda: find_flat(attempt, axes, known, best),
        _FLAT_BESIDE: lambda: (
            find_flat(attempt, axes, replace(known, log_scale=log_stated), best) if log_stated else None
        ),
        _FOCUS: lambda: _find_focus(attempt, axes, known, best, view),
        _BEFORE_CAMERA: lambda: find_blur_before_camera(attempt, axes, known, best),
        _COLOUR: lambda: find_second_colour(attempt, axes, known, best),
    }
    least = best.excess
    shares = _promised(attempt, known, best) if best.is_doubtful else dict.fromkeys(makers, 1.0)
    likely = _LIKELY if best.excess < _STEEP else HALF * _LIKELY
    names = [name for name in makers if shares[name] >= likely and FACTOR * best.excess <= vain.get(name, math.inf)]
    simple = in_order({name: shares[name] for name in names if name not in _COSTLY})
    for name in (*simple, *(name for name in names if name in _COSTLY)):
        if FACTOR * least < (1.0 - shares[name]) * best.excess or (name in _COSTLY and least < _MOSTLY * best.excess):
            continue
        found = makers[name]()
        if found is not None:
            least = min(least, found[0].excess)
            yield found
        else:
            vain[name] = best.excess


def _promised(attempt: Attempts, known: Calibration, best: Trial) -> dict[str, float]:
    """Return the share of the squared misfit that each explanation would explain, to first order.

    A flat moves the rings as phase and scale do that differ from frame to frame, and a second colour as all that goes
    with the distance.
    """
    gains = attempt.gains(best, known)
    beside = what_is_found(known)
    one = {
        _BAND: (Parameter.SPREAD, *beside),
        _HARMONICS: BEAMS,
        _PHASE: (Parameter.PHASE, *beside),
        _SCALE: (Parameter.SCALE, *beside),
        _COATING: COATING,
        _FOCUS: (*BEAMS, *beside, Parameter.FOCUS),
        _BEFORE_CAMERA: (Parameter.BLUR, *BEAMS),
    }
    several = {_FLAT: ASSUMED, _FLAT_BESIDE: ASSUMED, _COLOUR: RADIAL}
    shares = {name: gains.share(group) for name, group in one.items()}
    shares |= {name: gains.share(group, is_common=False) for name, group in several.items()}
    # of rings of which a part is not seen this is an upper bound alone: light is tried whatever it is, and a blur
    # whose shape a motion has nearly
    return shares | {
        _BLUR: 1.0,
        _SHARPENED: 1.0,
        _UNEVEN: 1.0 if math.isnan(gains.round_share) else max(1.0 - gains.round_share, _LIKELY),
    }


def _find_ellipse(attempt: Attempts, known: Calibration, best: Trial) -> tuple[Trial, Calibration]:
    """Ellipse that explains the frames much better than circles, its area being right or not.

    A view that is oblique, or scaled along one axis, changes the area that a contact of known fringes
    covers: then neither ellipse nor scale explains anything without the other.
    """
    for extra in (AXES, (*AXES, Parameter.SCALE)):
        if not best.may_gain(extra):
            continue
        least = _OBLIQUE * best.rough_excess
        gains = attempt.gains(best, known) if best.excess <= _FAR else None
        if gains is not None and gains.explained(extra) - gains.explained(extra[len(AXES) :]) <= least:
            continue
        oblique = attempt(extra, known)
        if oblique is None or oblique.gain_over(best) <= VARIANCES * len(best.fits):
            continue
        if oblique.rough_excess * FACTOR >= best.rough_excess:
            continue
        (stretch, u_stretch), (shear, u_shear) = (oblique.mean(axis) for axis in AXES)
        if max(abs(stretch) / u_stretch, abs(shear) / u_shear) <= SIGNIFICANT:
            continue
        found = replace(known, ellipse=(stretch, shear))
        if Parameter.SCALE in extra:
            scale, u = oblique.mean(Parameter.SCALE)
            if abs(scale) <= SIGNIFICANT * u or abs(scale) > _MOST_SCALE:
                continue
            found = replace(found, log_scale=scale, u_log_scale=u)
        return attempt((), found) or oblique, found
    return best, known


def _of_one_colour(
    attempt: Attempts,
    axes: Sequence[Parameter],
    known: Calibration,
    best: Trial,
    rough: Sequence[Parameter],
    view: View,
) -> tuple[Trial, Calibration] | None:
    """Ellipse, with phase and scale, that explains as much without the second colour that stood in for it."""
    free = (*AXES, *rough)
    one = replace(known, colour=(1.0, 0.0))
    trial = attempt(free, one) if known.ellipse != (0.0, 0.0) else None
    if trial is None or trial.excess > best.excess:
        return None
    one = with_beside(trial, one, free, view)
    return attempt(axes, one) or trial, one


def _find_blur(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, view: View
) -> tuple[Trial, Calibration] | None:
    """Blur of the lens; what was found while there was none is found again with it."""
    beside = what_is_found(known)
    found = find_blur(attempt, axes, known, best, beside)
    return None if found is None else (found[0], with_beside(*found, beside, view))


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


def _find_optics(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, parameter: Parameter, view: View
) -> tuple[Trial, Calibration] | None:
    """Phase, scale or spread of the wavenumbers that the film shows, when it explains the frames much better.

    What was found while it was wrong is found again with it.
    """
    beside = what_is_found(known)
    free = tuple(dict.fromkeys((*axes, parameter, *beside)))
    if not best.may_gain((parameter,), HALF * best.least_gain):
        return None
    trial = attempt(free, known)
    if trial is None or not trial.is_better_than(best):
        return None
    value, deviation = trial.mean(parameter)
    found = with_beside(trial, known, beside, view)
    if parameter is Parameter.PHASE:
        shift = value - view.optics.phase
        is_told = abs(shift - known.phase_shift) > SIGNIFICANT * deviation
        if not is_told or _is_scale_of_ellipse(attempt, free, known, view):
            return None
        return trial, replace(found, phase_shift=shift, u_phase_shift=deviation)
    if parameter is Parameter.SPREAD:
        if value <= SIGNIFICANT * deviation:
            return None
        return trial, replace(found, spread=value).with_shared(trial, trial.shift_of_radius((parameter,)))
    scale = known.log_scale + value
    # a band of colours tells its mean wavenumber no better than that
    if abs(value) <= max(SIGNIFICANT * deviation, known.spread) or abs(scale) > _MOST_SCALE:
        return None
    return trial, replace(found, log_scale=scale, u_log_scale=deviation)


def _is_scale_of_ellipse(attempt: Attempt, free: Sequence[Parameter], known: Calibration, view: View) -> bool:
    """Tell whether what looks like a phase is a scale: an oblique view, which shows ellipses, changes the area."""
    if known.ellipse == (0.0, 0.0) or known.log_scale:
        return False
    both = attempt((*free, Parameter.SCALE), known)
    if both is None:
        return False
    phase, u = both.mean(Parameter.PHASE)
    return abs(phase - view.optics.phase - known.phase_shift) <= SIGNIFICANT * u


def _find_focus(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, view: View
) -> tuple[Trial, Calibration] | None:
    """Distance from focus, and harmonics, without which it explains less, when they explain the frames much better."""
    if known.focus or not best.is_doubtful:
        return None
    before = tuple(dict.fromkeys((*axes, *BEAMS, *what_is_found(known))))
    free = (*before, Parameter.FOCUS)
    trial = attempt(free, known)
    simple = None if trial is None else attempt(before, known)
    if trial is None or simple is None or not (trial.is_better_than(best) and trial.is_better_than(simple)):
        return None
    # what is no function of the distance, as coma, leaves more
    if FACTOR * trial.excess >= min(best.excess, simple.excess):
        return None
    # a wrong phase or scale, or a band of colours, moves rings nearly alike
    least = FACTOR if known.spread else 1.0 / _AS_LIKELY
    for other in _LIKE_FOCUS:
        rival = attempt(tuple(dict.fromkeys((*before, *other))), known)
        if rival is not None and rival.excess < least * trial.excess:
            return None
    found = with_beside(trial, known, free, view)
    found = found.with_shared(trial, trial.shift_of_radius((Parameter.FOCUS,)))
    # light from many sides is blurred where it is out of focus
    blurred = find_blur(attempt, axes, found, trial, BEAMS)
    again = None if blurred is None else attempt(free, blurred[1])
    if blurred is None or again is None:
        return trial, found
    return again, with_beside(again, blurred[1], free, view)


def _choose(fits: dict[int, RingFit]) -> tuple[int, ...]:
    """Frames whose radius is best known among the larger contacts, and of many the smallest of these."""
    radius = {index: float(fit.parameters[Parameter.RADIUS]) for index, fit in fits.items()}
    if not radius:
        return ()
    largest = max(radius.values())
    large = [index for index, value in radius.items() if value > 0.5 * largest]
    # Contacts that hardly move and are seen from all sides come first.
    large.sort(key=lambda index: (fits[index].deviation(Parameter.RADIUS), index))
    chosen = large[:MOST_FRAMES]
    if len(large) > MOST_FRAMES:
        # a flat shows most in the smallest
        chosen[-1] = min(large, key=radius.__getitem__)
    return tuple(sorted(chosen))

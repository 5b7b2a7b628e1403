"""The blur of the lens: its size and shape, as told from a motion of the contact in the exposure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import EVEN, Parameter
from labpipe.imaging.fringes._trials import ALL_PIXELS, FEW_FRAMES, FEW_PIXELS, Attempt, Calibration, Trial, doubt

#: Rounds in which the blur is found, its least (px), the relative change of its square at which they
#: end, by all pixels and by some, and the step by which its effect is told.
BLUR_ROUNDS, LEAST_BLUR, _SAME_BLUR, _ROUGHLY, _BLUR_STEP = 5, 0.2, 0.005, 0.06, 0.1
#: Steps of the search for a blur over what a motion in its stead shows; logarithm of the odds against an
#: equal motion in each further frame.
_GAINS, _EQUAL_MOTION = (0.3, 2.0), math.log(10.0)
#: Standard deviations of a difference of blurs within which two frames see the same.
_AT_REST = 3.0
#: Standard deviations of what frames show of a blur together from which it is weighed: below, small contacts that
#: were blurred by 1 px, and nothing larger beside them, were up to 0.07 µm off at 4 u.
_SEEN = 2.0
#: Standard deviations of a blur beside a motion from which a ring tells both.
_TOLD = 10.0
#: Blur (px) from which its shape shows: below, discs and Gaussians moved radii by a tenth of u.
LEAST_SHAPED = 0.7
#: Shares of a disc in the shape of the blur that are tried beside none, and between which the likeliest is sought.
_NEAR_BELL, _BETWEEN, _DISC, _LEAST_SHAPES = 0.35, 0.7, 1.0, 3
_SHAPES, _SHAPE_ROUNDS, _SAME_SHAPE = np.linspace(0.0, 1.0, 101), 3, 0.03
#: Frames and pixels that tell which shapes are likely.
_SHAPE_FRAMES, _SHAPE_PIXELS = 2, 6_000
#: Share of the uncertainty of a shape within which the likeliest one need not be fitted.
_NEAR_ENOUGH = 0.3
#: What a shape leaves over what the best one does from which its size is not sought, and over what none does.
_FAR_WORSE, _HOPELESS = 1.2, 2.0


def find_blur(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, beside: Sequence[Parameter] = ()
) -> tuple[Trial, Calibration] | None:
    """Blur of the lens, when it explains the frames much better than none.

    A lens and a contact that moves evenly blur nearly alike: what is seen is the sum of their
    variances. The frame in which it is least is taken for one without motion. What is free ``beside`` it
    was not so in the best trial.
    """
    if known.blur or not best.is_doubtful:
        return None
    square = _square_beside_motion(attempt, axes, known) or least_blur(best, 0.0)[0]
    if square <= LEAST_BLUR**2:
        return None
    axes = (*axes, *beside)
    lens = _blur_of_lens(attempt, axes, known, best)
    if lens is None or not lens.trial.is_better_than(best):
        return None
    return lens.trial, lens.known(attempt, axes, known)


def _square_beside_motion(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> float:
    """Square of the blur (px²) as some pixels show it beside a motion, 0 where they do not tell them apart.

    Small contacts do: what a lens blurs they show as a motion of up to four times its variance.
    """
    trial = attempt((*axes, Parameter.BLUR), known, FEW_FRAMES, FEW_PIXELS)
    square, deviation = (0.0, 0.0) if trial is None else trial.mean(Parameter.BLUR)
    return square if square > _TOLD * deviation else 0.0


@dataclass(frozen=True)
class _Lens:
    """Fits with a blur of the lens (px), the uncertainty of its square, and of the radii (px) for its shape."""

    trial: Trial
    blur: float
    u_square: float
    disc: float
    by_shape: Floats | float = 0.0

    def known(self, attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration:
        """Return what is known with this blur, and what its uncertainty makes of the radius."""
        seen = replace(known, disc=self.disc)
        sharper = attempt(axes, replace(seen, blur=(1.0 - _BLUR_STEP) * self.blur), pixels=ALL_PIXELS)
        slope = 0.0 if sharper is None else self.trial.changes(sharper) / (_BLUR_STEP * self.blur)
        own = slope * self.u_square / (2.0 * self.blur)
        uneven = np.array([_shift_by_uneven_light(fit, self.blur) for fit in self.trial.fits])
        shared = np.sqrt(own**2 + uneven**2 + self.by_shape**2)
        return replace(seen, blur=self.blur).with_shared(self.trial, shared)


def _shift_by_uneven_light(fit: RingFit, blur: float) -> float:
    """Return u of the radius (px) where blurred rings lie in light that falls off outwards.

    To first order the blur moves them by its variance times the relative slope of the light, if that
    is how the light falls on the body; not if the camera darkens its corners.
    """
    radius, bowl = (float(fit.parameters[p]) for p in (Parameter.RADIUS, Parameter.BOWL))
    return blur**2 * bowl * 2.0 * radius / fit.curvature / math.sqrt(3.0)


def _seen_blurs(trial: Trial, blur: float) -> list[tuple[float, float]]:
    """Variance (px²) of lens and motion together in every frame with its uncertainty, least first."""
    return sorted(
        (blur**2 + float(fit.parameters[Parameter.SMEAR]) / EVEN, fit.deviation(Parameter.SMEAR) / EVEN)
        for fit in trial.fits
    )


def least_blur(trial: Trial, blur: float) -> tuple[float, float, int]:
    """Variance (px²) of the lens alone, with its uncertainty, and the number of frames that show no other.

    Frames at rest see the same blur: the mean of those that are within chance of the least.
    """
    variances = _seen_blurs(trial, blur)
    least, deviation = variances[0]
    still = [one for one in variances if one[0] - least <= _AT_REST * math.hypot(one[1], deviation)]
    values, deviations = np.array(still).T
    weights = 1.0 / np.maximum(deviations, 1e-9) ** 2
    mean = float(np.average(values, weights=weights))
    scatter = float(np.average((values - mean) ** 2, weights=weights)) / max(len(still) - 1, 1)
    beside = variances[1][0] - least if len(still) == 1 and len(variances) > 1 else 0.0
    return mean, max(math.sqrt(max(1.0 / float(weights.sum()), scatter)), beside), len(still)


def next_gain(gain: float, step: float, beyond: float) -> float:
    """Return the step to make over what is seen beyond a blur (px²), after a step of another gain left that."""
    change = step / gain - beyond
    return float(np.clip(step / change, *_GAINS)) if step and change else 1.0


def _blur_of_lens(attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial) -> _Lens | None:
    """Fit the frames with a lens that blurs as much, and in the shape, as the frames show.

    Some pixels of a few frames tell nearly as much; all of them say it of the likeliest shapes, and are not asked
    where these leave far more than the best trial without any.
    """
    few = partial(attempt, count=_SHAPE_FRAMES, pixels=_SHAPE_PIXELS)
    blur = math.sqrt(_square_beside_motion(attempt, axes, known))
    start = few(axes, replace(known, blur=blur))
    rough = [] if start is None else _likely_shapes(few, axes, known, start, blur)
    left = min((lens.trial.left / lens.trial.pixels for lens in rough), default=math.inf)
    if left > _HOPELESS * best.left / best.pixels:
        return None
    all_told = partial(attempt, pixels=ALL_PIXELS)
    sized: list[_Lens] = []
    for one in rough:
        most = _FAR_WORSE * min((other.trial.left for other in sized), default=math.inf)
        found = _size_of_blur(all_told, axes, known, one.trial, one.disc, one.blur, is_near=True, most=most)
        sized += [] if found is None else [found]
    lens = _settled_shape(all_told, axes, known, sized, are_sized=True)
    trial = None if lens is None else attempt(axes, replace(known, blur=lens.blur, disc=lens.disc))
    return None if lens is None or trial is None else replace(lens, trial=trial)


def _likely_shapes(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, start: Trial, blur: float
) -> list[_Lens]:
    """Lenses of the shapes that leave least: the bell alone where its blur is too small to show a shape."""
    bell = _size_of_blur(attempt, axes, known, start, 0.0, blur)
    if bell is None or bell.blur < LEAST_SHAPED:
        return [] if bell is None else [bell]
    between = _size_of_blur(attempt, axes, known, bell.trial, _BETWEEN, bell.blur)
    if between is None:
        return [bell]
    # on the side of the better of both
    third = _DISC if between.trial.left < bell.trial.left else _NEAR_BELL
    tried = [bell, between]
    last = _size_of_blur(attempt, axes, known, between.trial, third, between.blur)
    if last is not None:
        tried.append(last)
        _settled_shape(attempt, axes, known, tried)
    likely = sorted(tried, key=lambda lens: lens.trial.left)[:_LEAST_SHAPES]
    return likely[:2] + [lens for lens in likely[2:] if lens.trial.left <= _FAR_WORSE * likely[0].trial.left]


def _settled_shape(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, tried: list[_Lens], *, are_sized: bool = False
) -> _Lens | None:
    """Lens of the likeliest shape; those that are tried on the way are added to the list.

    Where those tried ``are_sized`` by all that is known, sizes between theirs are near.
    """
    near, spread = sorted(tried, key=lambda lens: lens.trial.left), 0.0
    if len(near) < 2:
        return near[0] if near else None
    for _ in range(_SHAPE_ROUNDS if len(tried) >= _LEAST_SHAPES else 0):
        near = sorted(tried, key=lambda lens: lens.trial.left)[:_LEAST_SHAPES]
        # How likely each shape is: what the frames leave goes with the square of what is wrong in the
        # fourth moment, to which the disc adds by the square of its share.
        beyond = np.array([lens.trial.left for lens in tried]) - near[0].trial.left
        flat = np.array([lens.disc**2 for lens in tried])
        left = np.polynomial.Polynomial.fit(flat, beyond, 2, w=1.0 / (1.0 + beyond))(_SHAPES**2)
        weights = np.exp(0.5 * (left.min() - left))
        disc = float(np.average(_SHAPES, weights=weights))
        spread = math.sqrt(float(np.average((_SHAPES - disc) ** 2, weights=weights)))
        if min(abs(disc - lens.disc) for lens in near) < max(_SAME_SHAPE, _NEAR_ENOUGH * spread):
            break
        most = _FAR_WORSE * near[0].trial.left
        blur = near[0].blur
        if are_sized:
            blur = float(np.interp(disc**2, *np.array(sorted((lens.disc**2, lens.blur) for lens in tried)).T))
        found = _size_of_blur(attempt, axes, known, near[0].trial, disc, blur, is_near=are_sized, most=most)
        if found is None:
            break
        tried.append(found)
    deviation = math.sqrt(spread**2 + _SAME_SHAPE**2 / 3.0)
    slope = (near[1].trial.changes(near[0].trial)) / (near[1].disc - near[0].disc)
    return replace(near[0], by_shape=slope * deviation)


def shape_anew(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration:
    """Find size and shape of a blur again, with what was found since among ``axes``, unless that explains less."""
    before = attempt(axes, known) if known.blur >= LEAST_SHAPED else None
    if before is None:
        return known
    sharp = replace(known, blur=0.0, disc=0.0)
    trial = attempt(axes, sharp)
    lens = None if trial is None else _blur_of_lens(attempt, axes, sharp, trial)
    if lens is None or lens.trial.left > before.left:
        return known
    return replace(lens.known(attempt, axes, sharp), harmonics=lens.trial.harmonics)


def _size_of_blur(
    attempt: Attempt,
    axes: Sequence[Parameter],
    known: Calibration,
    trial: Trial,
    disc: float,
    blur: float = 0.0,
    *,
    is_near: bool = False,
    most: float = math.inf,
) -> _Lens | None:
    """Find the blur of a lens, of one shape, as that of the frame of least blur.

    The blur to begin with ``is_near`` where it was found for that shape by some pixels: all of them settle it. What
    leaves more than ``most`` is pursued no further.
    """
    square, u_square, gain = blur**2, 0.0, 1.0
    for done in range(BLUR_ROUNDS):
        seen, u_square, _ = least_blur(trial, blur)
        if seen <= LEAST_BLUR**2:
            return None
        step = gain * (seen - square)
        square = max(square + step, LEAST_BLUR**2)
        blur = math.sqrt(square)
        found = attempt(axes, replace(known, blur=blur, disc=disc))
        if found is None:
            return None
        trial = found
        if trial.left > most:
            break
        if abs(step) < (_SAME_BLUR if is_near else _ROUGHLY) * square:
            if done or is_near:
                break
            continue  # what it began with is of another shape
        # A motion is not quite a blur of the same variance.
        gain = next_gain(gain, step, least_blur(trial, blur)[0] - square)
    return _Lens(trial, blur, u_square, disc)


def settle_blur(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial
) -> tuple[Trial, Calibration]:
    """Lay a blur that every frame shows to the lens or to motion, as the frames tell.

    Either explains the frames nearly as well, with radii some hundredths of a pixel apart: what is
    likelier is taken, and the other counts as what may be wrong.
    """
    least, deviation, _ = least_blur(best, 0.0)
    if known.blur or least <= max(LEAST_BLUR**2, _SEEN * deviation):
        return best, known
    lens = _blur_of_lens(attempt, axes, known, best)
    if lens is None:
        return best, known
    pairs = zip(best.fits, lens.trial.fits, strict=True)
    # of a contact beside the images no pixel is left, and no residual
    gain = sum((a.residual**2 / b.residual**2 - 1.0) * b.pixels for a, b in pairs if b.residual > 0.0)
    # That a contact moves as far in every frame is unlikely.
    gain += 2.0 * _EQUAL_MOTION * (least_blur(lens.trial, lens.blur)[2] - 1)
    changes = lens.trial.changes(best) * math.sqrt(doubt(gain))
    if gain <= 0.0:
        return best, known.with_shared(best, changes)
    return lens.trial, lens.known(attempt, axes, known).with_shared(lens.trial, changes)

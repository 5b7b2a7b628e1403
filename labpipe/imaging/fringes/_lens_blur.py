"""The blur of the lens: its size and shape, as told from a motion of the contact in the exposure."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import EVEN, Parameter
from labpipe.imaging.fringes._trials import ALL_PIXELS, Attempt, Calibration, Trial, doubt

#: Rounds in which a blur is found, and its least (px).
BLUR_ROUNDS, LEAST_BLUR = 5, 0.2
#: Logarithm of the odds against an equal motion in each further frame.
_EQUAL_MOTION = math.log(10.0)
#: Standard deviations of a difference of blurs within which two frames see the same.
_AT_REST = 3.0
#: Standard deviations of what frames show of a blur together from which it is weighed: below, small contacts that
#: were blurred by 1 px, and nothing larger beside them, were up to 0.07 µm off at 4 u.
_SEEN = 2.0
#: Blur (px) from which its shape shows: below, discs and Gaussians moved radii by a tenth of u.
LEAST_SHAPED = 0.7
#: Shares of a disc in the shape of a blur, and least uncertainty of the square of that.
_SHAPES, _LEAST_UNKNOWN = np.linspace(0.0, 1.0, 101), 0.01
#: Frames and pixels that tell whether a blur explains them, and what it leaves at most over what the best one does.
_SOME_FRAMES, _SOME_PIXELS, _HOPELESS = 2, 6_000, 1.3


def find_blur(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, beside: Sequence[Parameter] = ()
) -> tuple[Trial, Calibration] | None:
    """Blur of the lens, when it explains the frames much better than none.

    A lens and a contact that moves evenly blur nearly alike: what is seen is the sum of their
    variances. The frame in which it is least is taken for one without motion. What is free ``beside`` it
    was not so in the best trial.
    """
    square = least_blur(best, 0.0)[0]
    if known.blur or not best.is_doubtful or square <= LEAST_BLUR**2:
        return None
    axes = (*axes, *beside)
    lens = _blur_of_lens(attempt, axes, known, best, square)
    return lens if lens is not None and lens[0].is_better_than(best) else None


def _shift_by_uneven_light(fit: RingFit, blur: float) -> float:
    """Return u of the radius (px) where blurred rings lie in light that falls off outwards.

    To first order the blur moves them by its variance times the relative slope of the light, if that
    is how the light falls on the body; not if the camera darkens its corners.
    """
    radius, bowl = (float(fit.parameters[p]) for p in (Parameter.RADIUS, Parameter.BOWL))
    return blur**2 * bowl * 2.0 * radius / fit.curvature / math.sqrt(3.0)


def _shift_by_chords(fit: RingFit, blur: float, disc: float) -> float:
    """Return u of the radius (px) where the light of a disc reaches over chords of the rings.

    The table allows for those of the ring in the middle: at the contact's edge, where they are shorter, light of a
    disc of radius ρ lies up to ρ²/24 (1/a - 1/r) farther out. Radii of 110 to 190 µm were 3 to 12 nm too small.
    """
    radius = float(fit.parameters[Parameter.RADIUS])
    half = 0.25 * fit.curvature / max(radius, 1.0)
    return disc * blur**2 / 6.0 * half / (max(radius, 1.0) * (radius + half))


def least_blur(trial: Trial, blur: float) -> tuple[float, float, int]:
    """Variance (px²) of the lens alone, with its uncertainty, and the number of frames that show no other.

    What a frame shows is that of lens and motion together. Frames at rest see the same blur: the mean of those that
    are within chance of the least.
    """
    variances = sorted(
        (
            blur**2 + float(fit.parameters[Parameter.BLUR]) + float(fit.parameters[Parameter.SMEAR]) / EVEN,
            math.hypot(fit.deviation(Parameter.BLUR), fit.deviation(Parameter.SMEAR) / EVEN),
        )
        for fit in trial.fits
    )
    least, deviation = variances[0]
    still = [one for one in variances if one[0] - least <= _AT_REST * math.hypot(one[1], deviation)]
    values, deviations = np.array(still).T
    weights = 1.0 / np.maximum(deviations, 1e-9) ** 2
    mean = float(np.average(values, weights=weights))
    scatter = float(np.average((values - mean) ** 2, weights=weights)) / max(len(still) - 1, 1)
    beside = variances[1][0] - least if len(still) == 1 and len(variances) > 1 else 0.0
    return mean, max(math.sqrt(max(1.0 / float(weights.sum()), scatter)), beside), len(still)


def _blur_of_lens(
    attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial, square: float
) -> tuple[Trial, Calibration] | None:
    """Fit the frames with a lens that blurs as they show, in size and shape; begun from a square (px²)."""
    near = replace(known, blur=math.sqrt(square))
    some = attempt((*axes, *_free(near)), near, _SOME_FRAMES, _SOME_PIXELS)
    if some is None or some.left * best.pixels > _HOPELESS * best.left * some.pixels:
        return None
    found = with_blur(attempt, axes, near)
    trial = None if found is None else attempt(axes, found)
    return None if found is None or trial is None else (trial, found)


def _free(known: Calibration) -> tuple[Parameter, ...]:
    """Return what of a blur the frames tell."""
    return (Parameter.BLUR, Parameter.SHAPE) if known.blur >= LEAST_SHAPED else (Parameter.BLUR,)


def with_blur(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration | None:
    """Return what is known with the blur that the frames show beside ``axes``, begun from the one that is known.

    Size and shape are fitted at once, in the place of a motion: it is that of the frames that show least. The shape
    lies between a Gaussian and a disc. What the uncertainty of either makes of the radius is shared by all frames.
    """
    free = _free(known)
    joint = attempt((*axes, *free), known, pixels=ALL_PIXELS)
    if joint is None:
        return None
    square, deviation, count = least_blur(joint, known.blur)
    still = sorted(joint.fits, key=lambda fit: float(fit.parameters[Parameter.BLUR]))[:count]
    own, disc, by_shape = [_changes(fit, Parameter.RADIUS, free) for fit in joint.fits], 0.0, np.zeros(1)
    if Parameter.SHAPE in free:
        change, unknown = Trial(tuple(still), (1.0,) * count).mean(Parameter.SHAPE)
        shape, turns = known.disc**2 + change, (Parameter.SHAPE,)
        apart = ((_SHAPES**2 - shape) / max(unknown, _LEAST_UNKNOWN)) ** 2
        weights = np.exp(0.5 * (apart.min() - apart))
        disc = float(np.average(_SHAPES, weights=weights))
        spread = math.sqrt(float(np.average((_SHAPES**2 - disc**2) ** 2, weights=weights)))
        slopes = np.array([_changes(fit, Parameter.BLUR, turns) for fit in still])
        back = np.array([_changes(fit, Parameter.SHAPE, (Parameter.BLUR,)) for fit in still])
        square += float(slopes.mean()) * (disc**2 - shape)
        # of a blur of known shape
        deviation *= math.sqrt(max(1.0 - float((slopes * back).mean()), 0.0))
        by_shape = spread * np.array([_changes(fit, Parameter.RADIUS, turns) for fit in joint.fits])
    seen = replace(known, blur=math.sqrt(max(square, LEAST_BLUR**2)), disc=disc)
    rest = [(_shift_by_uneven_light(f, seen.blur), _shift_by_chords(f, seen.blur, disc)) for f in joint.fits]
    return seen.with_shared(
        joint, np.sqrt((deviation * np.array(own)) ** 2 + by_shape**2 + np.square(rest).sum(axis=1))
    )


def _changes(fit: RingFit, what: Parameter, held: Sequence[Parameter]) -> float:
    """Return how something changes with the first of what is held, all else following."""
    rows = [fit.free.index(p) for p in held]
    return float((fit.inverse[fit.free.index(what), rows] @ np.linalg.pinv(fit.inverse[np.ix_(rows, rows)]))[0])


def shape_anew(attempt: Attempt, axes: Sequence[Parameter], known: Calibration) -> Calibration:
    """Find size and shape of a blur again, with what was found since among ``axes``, unless that explains less."""
    before = attempt(axes, known) if known.blur >= LEAST_SHAPED else None
    found = None if before is None else with_blur(attempt, axes, known)
    trial = None if found is None else attempt(axes, found)
    if before is None or found is None or trial is None or trial.left > before.left:
        return known
    return replace(found, harmonics=trial.harmonics)


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
    lens = _blur_of_lens(attempt, axes, known, best, least)
    if lens is None:
        return best, known
    trial, found = lens
    pairs = zip(best.fits, trial.fits, strict=True)
    # of a contact beside the images no pixel is left, and no residual
    gain = sum((a.residual**2 / b.residual**2 - 1.0) * b.pixels for a, b in pairs if b.residual > 0.0)
    # That a contact moves as far in every frame is unlikely.
    gain += 2.0 * _EQUAL_MOTION * (least_blur(trial, found.blur)[2] - 1)
    changes = trial.changes(best) * math.sqrt(doubt(gain))
    if gain <= 0.0:
        return best, known.with_shared(best, changes)
    return trial, found.with_shared(trial, changes)

"""What hides below what a film tells of its optics, and counts as what may be wrong."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.imaging.fringes._attempts import Attempts
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import ASSUMED, BEAMS, Parameter
from labpipe.imaging.fringes._together import what_is_found
from labpipe.imaging.fringes._trials import FACTOR, FEW_PIXELS, HINT, WEAK_HINT, Attempt, Calibration, Trial
from labpipe.imaging.fringes._worn_flat import flats_beside

#: Probability that faces, R, wavelength or ruler are not what they are said to be in a film that does not show it
#: beyond doubt, and by how much they then are: a phase (rad) and the logarithm of a scale. Share of the misfit that
#: goes evenly around the rings from which it is of the optics.
_HIDDEN, _USUAL_SIZE, _ROUND_LEFT = 0.2, {Parameter.PHASE: 0.3, Parameter.SCALE: 0.005}, 0.5
#: Misfit beside what was found from which that pulls at the radius as it does at worst: something else is there.
_MUCH_LEFT = 0.02
#: Standard deviations from which a phase or a scale counts that what else is wrong, as coma, may look like.
_NOTABLE = 3.0
#: Usual fourth power of a flat over that of the smallest contact.
_USUAL_FLAT = 0.2


def with_hidden(
    attempt: Attempts, axes: Sequence[Parameter], known: Calibration, best: Trial, parameters: Sequence[Parameter]
) -> Calibration:
    """Count what a phase or a scale that frames do not show beyond doubt makes of the radius.

    Where errors of the model are left all around the rings beside what was found, that is not what is there, or not
    all: what both together make of the radius counts. Else each is there or it is not, as likely as its value is by
    chance and as one of its usual size.
    """
    beside = what_is_found(known)
    if not (best.is_quiet or best.is_doubtful):  # noise with a memory, as of speckle, is all there is
        return known if beside or Parameter.SCALE not in parameters else _with_hidden_scale(best, known)
    if best.is_doubtful and not attempt.gains(best, known).round_share < _ROUND_LEFT:
        if best.excess > _MUCH_LEFT**2 and not known.is_usual:
            known = known.with_shared(best, np.array([fit.worst_deviation for fit in best.fits]))
        trial = attempt((*axes, *ASSUMED), known)
        is_odd = set(beside).difference(BEAMS) or known.flat or known.colour[1]
        if trial is not None and (is_odd or trial.excess * FACTOR < best.excess):
            return known.with_shared(trial, trial.changes(best))
    for parameter in parameters:
        usual, least = _USUAL_SIZE[parameter], _NOTABLE**2
        if best.is_quiet:
            least = (WEAK_HINT if parameter is Parameter.PHASE else HINT) + 2.0 * len(best.fits)
        value, deviation = best.hinted(parameter, beside)
        if best.is_doubtful and (value / deviation) ** 2 >= least:
            # errors of the model that the frames show may make as much
            trial = attempt((*axes, *beside, parameter), known)
            deviation = deviation if trial is None else max(deviation, trial.mean(parameter)[1])
        likelihood = _likelihood(value, deviation, usual)
        if likelihood < _HIDDEN or (value / deviation) ** 2 < least:
            continue  # the frames speak against it
        size = _expected_size(value, deviation, usual, likelihood)
        known = known.with_shared(best, best.slopes(parameter, beside) * size)
    return known


def by_uneven_scale(best: Trial) -> Floats:
    """Return what makes the scales of the fringes differ from frame to frame beyond chance, in the radii (px).

    Wavelength and sphere are the same in all of them: what differs is how long a pixel is where each contact has its
    rim, as behind a lens that distorts. The scale goes with the square of that.
    """
    radii = np.array([fit.parameters[Parameter.RADIUS] for fit in best.fits])
    slopes, bends = (
        np.ravel(parts) for parts in zip(*(fit.along((Parameter.SCALE,), 1.0) for fit in best.fits), strict=True)
    )
    if len(slopes) < max(len(radii), 2):
        return np.zeros(len(radii))
    pulls = np.array([max(fit.residual**2 * bend, _by_memory(fit)) for fit, bend in zip(best.fits, bends, strict=True)])
    scales, weights = slopes / bends, bends**2 / pulls
    apart = weights @ (scales - np.average(scales, weights=weights)) ** 2
    if apart < HINT + 2.0 * len(radii):
        return np.zeros(len(radii))
    return 0.5 * radii * math.sqrt((apart / (len(radii) - 1) - 1.0) * len(radii) / weights.sum())


def _by_memory(fit: RingFit) -> float:
    """Return the variance by which noise with a memory pulls at the scale of a frame."""
    return 0.0 if fit.by_memory is None else float(fit.by_memory[fit.asked.index(Parameter.SCALE)]) ** 2


def with_hidden_flat(attempt: Attempt, axes: Sequence[Parameter], known: Calibration, best: Trial) -> Calibration:
    """Count what a flat that frames do not show beyond doubt makes of the radius, as likely as it is there.

    What the frames leave goes with the fourth power of a small flat, and noise with a memory pulls at that as much more
    than pixels that scatter alone as it does at the radius.
    """
    if known.flat or (best.expected_gain(ASSUMED) <= HINT if best.is_quiet else best.is_doubtful):
        return known
    smallest = min(float(fit.parameters[Parameter.RADIUS]) for fit in best.fits)
    flats = [0.0, *flats_beside(best)[:2]]
    quartic = (flats[1] / smallest) ** 4
    tried = [attempt(axes, replace(known, flat=flat), pixels=FEW_PIXELS) for flat in flats]
    made = [trial for trial in tried if trial is not None]
    if len(made) < len(tried):
        return known
    share = best.pixels / max(made[0].pixels, 1)
    none, half, whole = (share * trial.left_of_each for trial in made)
    information = np.maximum(0.5 * (none + whole - 2.0 * half), 1e-9) / quartic**2
    values = (4.0 * (none - half) - (none - whole)) / (4.0 * quartic * information)
    place = Parameter.RADIUS
    by_memory = np.array([fit.covariance[place, place] / fit.inverse[place, place] for fit in best.fits])
    by_memory /= np.maximum(np.array(best.noise), 1e-6) ** 2
    value = float(np.average(values, weights=information))
    # what makes noise remember stands still: it is one in all frames
    deviation = float(np.sqrt(np.maximum(by_memory, 1.0) * information).sum() / information.sum())
    if value <= math.sqrt(HINT if best.is_quiet else 0.0) * deviation:
        return known
    size = _expected_size(value, deviation, _USUAL_FLAT, _likelihood(value, deviation, _USUAL_FLAT))
    return known.with_shared(best, made[1].changes(made[0]) / quartic * size)


def _with_hidden_scale(best: Trial, known: Calibration) -> Calibration:
    """Count what a scale that noise with a memory hides makes of the radius, however little hints at it.

    Such noise pulls at it many times as much as pixels that scatter alone: rays of a cone, which make fringes wider by
    up to a hundredth, hide in it. As likely as that is there, the radius is off by as much.
    """
    value, deviation = best.hinted(Parameter.SCALE)
    if all(fit.slow is None for fit in best.fits) or not deviation:
        return known
    usual = _USUAL_SIZE[Parameter.SCALE]
    size = _expected_size(value, deviation, usual, _likelihood(value, deviation, usual))
    return known.with_shared(best, np.array([fit.sensitivity[Parameter.SCALE] for fit in best.fits]) * size)


def _expected_size(value: float, deviation: float, usual: float, likelihood: float) -> float:
    """Root mean square of a quantity that is there with a likelihood, and has a usual size then."""
    share = usual**2 / (deviation**2 + usual**2)
    return math.sqrt(likelihood * (share * value**2 + deviation**2) * share)


def _likelihood(value: float, deviation: float, usual: float) -> float:
    """Probability that a quantity of this value is there, and not by chance; one that is there has a usual size."""
    square = deviation**2
    by_chance = math.exp(-0.5 * min(value**2 * (1.0 / square - 1.0 / (square + usual**2)), 700.0))
    return 1.0 / (1.0 + (1.0 / _HIDDEN - 1.0) * by_chance * math.sqrt(1.0 + usual**2 / square))

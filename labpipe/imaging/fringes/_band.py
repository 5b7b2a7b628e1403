"""Band of colours of a film's light: one that hides behind noise, and how skewed one is."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labpipe.imaging.fringes._ring_parameters import ASSUMED, Parameter
from labpipe.imaging.fringes._together import what_is_found, with_beside
from labpipe.imaging.fringes._trials import ALL_PIXELS, WEAK_HINT, Attempt, Calibration
from labpipe.imaging.fringes._view import View

#: Skewness of a band of colours that is tried, and that of usual ones, two lines among them; steps of it that are
#: believed at most, and variances in each frame by which another one must be better. Skew between bands even in
#: wavenumbers and in wavelengths.
_SKEWNESS, _USUAL_SKEWNESS, _MOST_STEPS, _CLEAR, _EVEN = 0.5, 2.0, 2.0, 300.0, 0.5
#: Blur (px) beside which no band of colours that hides is looked for: what is not known of its shape looks like one.
_WIDE_BLUR = 2.0


def with_small_band(attempt: Attempt, axes: Sequence[Parameter], known: Calibration, view: View) -> Calibration:
    """Take a band of colours that hides below what is seen of errors of the model, with all else known.

    A blur that seems a disc may be a Gaussian beside one: what explains the frames about as well counts, by how
    likely it is, as what may be wrong.
    """
    best = attempt(axes, known)
    if best is None or known.spread or known.focus or known.blur > _WIDE_BLUR or not best.is_quiet:
        return known
    least = WEAK_HINT + 2.0 * len(best.fits)
    if best.is_all_noise and not (known.disc or best.may_gain(ASSUMED, least)):
        return known
    ways, beside = [(best, known)], what_is_found(known)
    for disc in dict.fromkeys((known.disc, 0.5 * known.disc, 0.0)):
        shape = replace(known, disc=disc)
        free = attempt((*axes, Parameter.SPREAD, *beside), shape)
        spread = 0.0 if free is None else free.mean(Parameter.SPREAD)[0]
        if free is None or spread <= 0.0:
            continue
        seen = with_beside(free, replace(shape, spread=spread), beside, view)
        trial = attempt(axes, seen)
        if trial is not None:
            ways.append((trial, seen.with_shared(free, free.shift_of_radius((Parameter.SPREAD,)))))
    gains = [trial.gain_over(best) for trial, _ in ways]
    likeliest = max(range(len(gains)), key=lambda place: gains[place])
    taken, found = ways[likeliest if gains[likeliest] > least else 0]
    # a small flat looks like a band as well, and more like another phase and scale
    rival = attempt((*axes, *ASSUMED), known) if taken is not best else None
    if rival is not None:
        ways.append((rival, known))
        gains.append(rival.gain_over(best) - 2.0 * least)
    weights = np.exp(0.5 * (np.array(gains) - max(gains)))
    changes = np.array([trial.changes(taken) for trial, _ in ways])
    return found.with_shared(taken, np.sqrt(np.average(changes**2, axis=0, weights=weights)))


def weigh_band(attempt: Attempt, axes: Sequence[Parameter], known: Calibration, view: View) -> Calibration:
    """Find how skewed a band of colours is, a second line beside the first for one, or count what that may be."""
    if not known.spread:
        return known
    beside = what_is_found(known)
    free = (*axes, *beside)
    step = _SKEWNESS / (3.0 * math.sqrt(known.spread))
    skews = [known.skew + place * step for place in (-1.0, 0.0, 1.0)]
    ways = [attempt(free, replace(known, skew=skew), pixels=ALL_PIXELS) for skew in skews]
    made = [trial for trial in ways if trial is not None]
    if len(made) < len(ways):
        return known
    before, middle, after = (trial.left for trial in made)
    slope, bend = 0.5 * (after - before), after + before - 2.0 * middle
    likeliest = float(np.clip(-slope / max(bend, 0.5 * abs(slope) + 1e-9), -_MOST_STEPS, _MOST_STEPS))
    shift = 0.5 * made[2].changes(made[0])
    if -likeliest * (slope + 0.5 * likeliest * bend) > _CLEAR * len(made[1].fits):
        skewed = replace(known, skew=known.skew + likeliest * step)
        trial = attempt(free, skewed)
        if trial is not None and trial.gain_over(made[1]) > _CLEAR * len(trial.fits):
            known = with_beside(trial, skewed, beside, view)
    if known.skew == _EVEN:
        # a band may be even in wavenumbers or in wavelengths
        even, other = attempt(axes, known), attempt(axes, replace(known, skew=2.0 * _EVEN))
        known = known if even is None or other is None else known.with_shared(even, even.changes(other))
    by_noise = max(middle / made[1].pixels, 1.0)
    deviation = 1.0 / math.sqrt(max(bend, 0.0) / (2.0 * by_noise) + (_SKEWNESS / _USUAL_SKEWNESS) ** 2)
    return known.with_shared(made[1], shift * deviation)

"""Model uncertainty of the shifts from other starts and models, where superposition fails.

The covariance of a fit takes its model for granted. When the joint fit misses the sweeps by more
than they scatter about their own smooth curves, the material is not quite what time-temperature
superposition says, and the shifts depend on how the misfit is shared out: on the weight of either
modulus, on the vertical law, on the minimum that was found. So the fit is repeated with those
changed; the changes of the shifts are an uncertainty of their own.
"""

from dataclasses import replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials.superposition._joint_fit import Fit, Points, outer_problem, predictive_cost
from labpipe.materials.superposition._law_choice import less_smoothed, restarts, screened, under_law
from labpipe.materials.superposition._reweighting import (
    FIRST_LEVELS,
    Candidate,
    Options,
    Superposition,
    influences,
    settled,
    weights_in,
)
from labpipe.materials.superposition._runs import Runs, correlated, runs_in, sweeps_of
from labpipe.materials.superposition._shift_parameters import SLOPE_SPREAD, OuterModel

#: Noise of the fit over scatter of the sweeps, from which superposition counts as violated. The
#: scatter of the fewest sweeps that are judged is known to a fifth.
VIOLATED = 1.5
#: Relative residuals that no rheometer's noise explains.
ROUGH = {"storage": 0.05, "loss": 0.10}
# Either modulus counts this much more than the other in one of the repetitions.
_EMPHASIS = 3.0
# In units of twice the log-likelihood: another minimum counts when its cost is higher by less than
# this (three standard deviations) times the length of a run of residuals, and replaces the present
# one when its cost is lower by this much.
_SIMILAR, _BETTER = 9.0, 1.0
# Slopes of ln b (per kelvin) from which a glass is fitted anew where they could move its shifts by
# this much (decades), and the smoothing of the comparison at most, in units of the noise.
_SLOPES, _REACH, _STIFF = (-1e-3, -4e-4, -1e-4), 0.25, 100.0


def violation(current: Superposition, options: Options) -> float:
    """Return the noise of the fit over the scatter of the sweeps, of the worse modulus.

    Sweeps of a few readings do not tell their scatter; then it counts from :data:`ROUGH` on.
    """
    noise, scatter = current.noise, options.scatter
    if scatter is None:
        rough = max(noise.storage / ROUGH["storage"], noise.loss / ROUGH["loss"])
        return VIOLATED * rough if rough > 1.0 else 1.0
    return max(noise.storage / scatter.storage, noise.loss / scatter.loss)


def runs_of(points: Points, current: Superposition) -> Runs:
    """Return how alike neighbours err: a length of one where those of a sweep err independently."""
    return runs_in(current.standardised, influences(points, current.fit, current.model), sweeps_of(points))


def with_lasting_noise(points: Points, current: Superposition) -> Superposition:
    """Carry errors that last from one reading to the next through the fit.

    A shift listens to differences between the readings of a sweep, of which errors that all of them share
    change little: by the length of runs alone, which holds for a mean, its uncertainty would be too large.
    By that length goes what a misfit of the model leaves, which is no noise.

    References
    ----------
    Newey & West, Econometrica 55 (1987) 703, doi:10.2307/1913610.
    """
    runs = runs_of(points, current)
    found = replace(current, run_length=runs.length)
    if current.violation > VIOLATED or not current.model.size:
        return replace(found, covariance=runs.length * current.covariance)
    rest, inverse = influences(points, current.fit, current.model)[1]
    gain = rest @ inverse
    more = runs.size * gain.T @ correlated(gain, sweeps_of(points), runs.correlation) - gain.T @ gain
    return replace(found, covariance=current.covariance + more)


def started_anew(points: Points, current: Superposition, options: Options) -> list[Fit]:
    """Fit anew under the laws that were chosen, with their vertical factors and without any.

    The first starts knew nothing of delay and vertical law.
    """
    weight = weights_in(points, current, options)
    ln_bT = current.fit.state.ln_bT
    starts = restarts(points, current, ln_bT)
    if ln_bT.any():
        starts += restarts(points, current, np.zeros(ln_bT.size))
    return [screened(points, weight, current, current.model, first) for first in starts]


def other_minimum(points: Points, current: Superposition, options: Options, anew: list[Fit]) -> Candidate | None:
    """Return the best of some further fits if it is better than the present one."""
    model = current.model
    weight = weights_in(points, current, options)
    present = screened(points, weight, current, model, current.fit.state)
    best = min(anew, key=lambda fit: predictive_cost(fit, model))
    if predictive_cost(best, model) >= predictive_cost(present, model) - _BETTER:
        return None
    return Candidate(model, best, current.starts)


def alternatives(
    points: Points, current: Superposition, options: Options, anew: list[Fit]
) -> tuple[tuple[str, Floats], ...]:
    """Return log10 a_T (isotherm,) of every repetition, with what was changed in it."""
    weight = weights_in(points, current, options)
    model, state = current.model, current.fit.state
    half = points.omega.size
    root = float(np.sqrt(_EMPHASIS))
    tilt = np.concatenate([np.full(half, root), np.full(half, 1.0 / root)])
    found = [
        (name, screened(points, changed, current, model, state).state.log10_aT)
        for name, changed in (("storage", weight * tilt), ("loss", weight / tilt))
    ]
    for other in _other_laws(model, options):
        fit = screened(points, weight, current, other, state)
        found.append((f"vertical {other.vertical}", fit.state.log10_aT))
    limit = predictive_cost(current.fit, model) + _SIMILAR * runs_of(points, current).length
    found += [("start", fit.state.log10_aT) for fit in anew if predictive_cost(fit, model) < limit]
    return tuple(found)


def with_less_smoothing(points: Points, current: Superposition, options: Options) -> Superposition:
    """Widen a covariance to what it is with a spectrum that is free to bend (:func:`.less_smoothed`)."""
    model, loose = current.model, less_smoothed(points, current, options)
    if loose is None or not model.size:
        return current
    normal, _ = outer_problem(points, loose, model)
    free = np.linalg.pinv(normal, hermitian=True)
    unit = np.sqrt(np.maximum(np.diag(current.covariance), np.finfo(float).tiny))
    value, vector = np.linalg.eigh((free - current.covariance) / np.outer(unit, unit))
    wider = (vector * np.maximum(value, 0.0)) @ vector.T * np.outer(unit, unit)
    return replace(current, covariance=current.covariance + wider)


def with_other_slopes(points: Points, current: Superposition, options: Options) -> Superposition:
    """Fit a glass anew from slopes of its modulus, go on from the best answer and keep all of them.

    Where the loss is small and flat, E′ rises by about (2/π) ln(10) tan δ a decade, and a glass that
    softens by some percent over all temperatures looks like one that shifts by decades more. No
    curvature at one of the answers tells of the others.
    """
    model = current.model
    rise = 2.0 / np.pi * np.log(10.0) * float(np.median(points.loss / points.storage))
    if SLOPE_SPREAD * float(np.ptp(model.temperature)) / 2.0 < _REACH * rise or current.violation > VIOLATED:
        return current
    if not points.work.goes_on():
        return current
    solution = replace(current.fit.solution, strength=min(current.fit.solution.strength, _STIFF))
    softer = replace(current, fit=replace(current.fit, solution=solution))
    weight = weights_in(points, current, options)
    warmer = model.temperature - model.T_ref
    starts = [current.fit.state]
    for slope in _SLOPES:
        starts += restarts(points, current, slope * warmer)
    fits = [screened(points, weight, softer, model, start) for start in starts]
    costs = np.array([predictive_cost(fit, model) for fit in fits])
    shares = np.exp(-0.5 * (costs - costs.min()) / runs_of(points, current).length)
    shares /= shares.sum()
    best = Candidate(model, fits[int(np.argmin(costs))], current.starts)
    found = settled(points, best, current.noise, options)
    return replace(
        current,
        model=found.model,
        fit=found.fit,
        noise=found.noise,
        covariance=found.covariance,
        standardised=found.standardised,
        slopes=tuple((float(share), fit.state.log10_aT) for share, fit in zip(shares, fits, strict=True)),
    )


def _other_laws(model: OuterModel, options: Options) -> list[OuterModel]:
    """List vertical laws and levels that were left open and are not those of the model."""
    found = []
    if len(options.verticals) > 1:
        found += [
            under_law(model, name, options.verticals)
            for name in ("none", "linear")
            if name in options.verticals and name != model.vertical
        ]
    if options.levels is None:
        spread = 0.0 if model.level_spread else FIRST_LEVELS
        found.append(replace(model, level_spread=spread))
    return found

"""Search along barely determined steps for a better or an equally good solution.

A covariance sees the curvature at one minimum. Between two stiff sweeps the misfit as a function
of their step can be flat over a decade or have a second minimum; so every step that is loose, or
leaves a gap between its sweeps, is walked over a wide range, the spectrum following, and what is
found widens its uncertainty.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.materials.superposition._joint_fit import Fit, Points, evaluate, grid_for, minimise, predictive_cost
from labpipe.materials.superposition._shift_parameters import STEP_SPREAD, STEP_SPREAD_PER_KELVIN, OuterModel, State

#: Steps known worse than this (decades) are walked.
LOOSE = 0.1
# Walked offsets in decades, and the reach of the spectrum that they need.
_OFFSETS = np.arange(-4.5, 4.51, 0.25)
_MARGIN = 5.2
# The walk is coarse and holds the other shifts: a dip that comes within this misfit (in units of
# twice the log-likelihood) of the present minimum may be a better one.
_PROMISING = 100.0
# A walk looks at this many isotherms on either side of its step: further ones hardly see it.
_NEIGHBOURS = 3
# Of every walk this many of the lowest dips are fitted, well enough to be compared: tolerance
# and iterations.
_MOST_DIPS = 2
_SCREENING = (1e-3, 8)
# Smoothing under which sweeps cannot have a spectrum each, in units of the noise.
STIFF = 100.0
# A better minimum is better by this much at least; less is the rounding of two descents.
_BETTER = 0.1


@dataclass(frozen=True, slots=True)
class Probe:
    """What the walk along the loose steps found.

    ``groups`` (step, isotherm): the isotherms that move with every walked step: one, others zero; ``variance`` (step,):
    spread of every walked step by its likelihood and its other minima, beyond what its covariance said; ``better``: a
    fit from which to settle anew: some step was in a minimum that is not the best.
    """

    groups: Floats
    variance: Floats
    better: Fit | None


def probe_steps(
    points: Points, weight: Floats, fit: Fit, model: OuterModel, known: Floats, may_move: bool = True
) -> Probe:
    """Walk every step of free shifts that is loose or leaves a gap, one after the other.

    Minima are compared by :func:`.predictive_cost`. Sweeps that are
    torn apart have a spectrum each and always fit a little better; that is not to their credit.

    ``known`` (isotherm, isotherm): Covariance of log10 a_T. ``may_move``: Whether to go on from a better minimum
    where there is one, or only to count it.
    """
    groups = _loose_steps(points, fit, model, known)
    variance = np.zeros(len(groups))
    better: Fit | None = None
    for k, group in enumerate(groups):
        if not points.work.goes_on():
            # of a step that was not walked is known what is known of polymers
            order = np.argsort(model.temperature, kind="stable")
            step = int(np.flatnonzero(np.diff(group[order]))[0])
            variance[k] = (STEP_SPREAD + STEP_SPREAD_PER_KELVIN * float(np.diff(model.temperature[order])[step])) ** 2
            continue
        strength = fit.solution.strength
        present = _refitted(points, weight, fit, model, fit.state.log10_aT, strength)
        found, spread = _walked(points, weight, present, model, group)
        if found is not None and may_move:
            better = fit = found
            continue
        variance[k] = max(spread - float(group @ known @ group), 0.0)
    return Probe(np.array(groups).reshape(-1, model.temperature.size), variance, better)


def _loose_steps(points: Points, fit: Fit, model: OuterModel, known: Floats) -> list[Floats]:
    """Return the isotherms on the side away from the reference of every step to walk."""
    order = np.argsort(model.temperature, kind="stable")
    at = int(np.flatnonzero(order == model.reference)[0])
    groups: list[Floats] = []
    for k in range(order.size - 1):
        cold, warm = order[k], order[k + 1]
        variance = float(known[cold, cold] + known[warm, warm] - 2.0 * known[cold, warm])
        if variance <= LOOSE**2 and _overlap(points, fit.state, cold, warm) > 0:
            continue
        group = np.zeros(order.size)
        group[order[: k + 1] if k < at else order[k + 1 :]] = 1.0
        groups.append(group)
    return groups


def _walked(points: Points, weight: Floats, present: Fit, model: OuterModel, group: Floats) -> tuple[Fit | None, float]:
    """Walk one step; return the best fit if it is another minimum, and the spread of the step."""
    strength = present.solution.strength
    costs = _walk(points, weight, present, model, group, strength)
    likelihood = np.exp(-0.5 * (costs - costs.min()))
    spread = float(np.sum(likelihood * _OFFSETS**2) / np.sum(likelihood))
    dips = [(i, strength) for i in _lowest_minima(costs)]
    if strength < STIFF:
        # A torn spectrum is hardly smoothed; with so little smoothing all steps look alike.
        costs = _walk(points, weight, present, model, group, STIFF)
        dips += [(i, STIFF) for i in _lowest_minima(costs)]
    least = predictive_cost(present, model)
    best: Fit | None = None
    for i, smoothing in dips:
        shifts = present.state.log10_aT + _OFFSETS[i] * group
        fit = _refitted(points, weight, present, model, shifts, smoothing)
        cost = predictive_cost(fit, model)
        excess = cost - predictive_cost(present, model)
        # A second minimum widens the step by its distance, as likely as it is.
        away = float(np.max(np.abs(fit.state.log10_aT - present.state.log10_aT)))
        spread += away**2 * float(np.exp(-0.5 * max(excess, 0.0)))
        if cost < least - _BETTER:
            best, least = fit, cost
    return best, spread


def _refitted(points: Points, weight: Floats, present: Fit, model: OuterModel, shifts: Floats, strength: float) -> Fit:
    """Fit anew from other shifts, the smoothing chosen near a first one."""
    anchored = shifts - shifts[model.reference]
    state = _moved(model, present.state, anchored)
    grid = grid_for(points, state, present.grid.terms_per_decade)
    first = evaluate(points, weight, grid, state, None, strength)
    return minimise(points, weight, first, model, *_SCREENING)


def _overlap(points: Points, state: State, cold: int, warm: int) -> float:
    """Return the common range of reduced frequency of two isotherms in decades."""
    place = np.log10(points.omega) + state.log10_aT[points.isotherm]
    one, other = place[points.isotherm == cold], place[points.isotherm == warm]
    return float(min(one.max(), other.max()) - max(one.min(), other.min()))


def _lowest_minima(costs: Floats) -> NDArray[np.intp]:
    """Return the lowest promising dips of a walk away from its middle, the ends included."""
    padded = np.concatenate([[np.inf], costs, [np.inf]])
    dips = (costs <= padded[:-2]) & (costs <= padded[2:]) & (costs < _PROMISING)
    at = np.flatnonzero(dips)
    at = at[np.abs(at - costs.size // 2) > 1]
    return at[np.argsort(costs[at], kind="stable")[:_MOST_DIPS]]


def _walk(points: Points, weight: Floats, fit: Fit, model: OuterModel, group: Floats, strength: float) -> Floats:
    """Return the total cost at every offset of a group, less that at none."""
    points, weight = _near_the_step(points, weight, model, group)
    grid = grid_for(points, fit.state, fit.grid.terms_per_decade, _MARGIN)
    middle = int(np.argmin(np.abs(_OFFSETS)))
    costs = np.empty(_OFFSETS.size)
    for side in (range(middle, _OFFSETS.size), range(middle, -1, -1)):
        guess = None
        for i in side:
            state = _moved(model, fit.state, fit.state.log10_aT + _OFFSETS[i] * group)
            trial = evaluate(points, weight, grid, state, strength, guess=guess)
            guess = trial.solution
            costs[i] = predictive_cost(trial, model)
    return costs - costs[middle]


def _near_the_step(points: Points, weight: Floats, model: OuterModel, group: Floats) -> tuple[Points, Floats]:
    """Leave out the isotherms that are far from the step."""
    order = np.argsort(model.temperature, kind="stable")
    step = int(np.flatnonzero(np.diff(group[order]))[0])
    near = np.zeros(group.size, dtype=bool)
    near[order[max(step + 1 - _NEIGHBOURS, 0) : step + 1 + _NEIGHBOURS]] = True
    kept = near[points.isotherm]
    return points.only(kept), weight[np.concatenate([kept, kept])]


def _moved(model: OuterModel, state: State, log10_aT: Floats) -> State:
    parameters = state.parameters.copy()
    head = np.delete(log10_aT - log10_aT[model.reference], model.reference)
    parameters[: model.horizontal_size] = head
    moved = model.state(parameters)
    return state if moved is None else moved

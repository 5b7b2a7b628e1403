"""Look along every step that the data barely determine for a better one, or another as good.

A covariance sees the curvature at one minimum. Between two stiff sweeps the misfit as a function
of their step can be flat over a decade or have a second minimum; so every loose step is walked
over a wide range, the spectrum following, and what is found widens its uncertainty.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.materials.joint_fit import Fit, Points, evaluate, grid_for, total_cost
from labpipe.materials.outer_model import OuterModel, State
from labpipe.materials.spectrum import TERMS_PER_DECADE

Array = NDArray[np.float64]

#: Steps known worse than this (decades) are walked.
LOOSE = 0.1
# Walked offsets in decades, and the reach of the spectrum that they need.
_OFFSETS = np.arange(-3.25, 3.26, 0.25)
_MARGIN = 4.0
# The walk is coarse and holds the other shifts: a dip that comes within this misfit (in units of
# twice the log-likelihood) of the present minimum may be a better one.
_PROMISING = 30.0


@dataclass(frozen=True, slots=True)
class Probe:
    """What the walk along the loose steps found.

    Attributes
    ----------
    groups : array (step, isotherm)
        The isotherms that move with every walked step: one, others zero.
    variance : array (step,)
        Spread of every walked step by its likelihood, beyond what its covariance said.
    dips : tuple of (int, array (isotherm,))
        Other promising minima: the step and the shifts to fit from.
    """

    groups: Array
    variance: Array
    dips: tuple[tuple[int, Array], ...]


def probe_steps(points: Points, weight: Array, fit: Fit, model: OuterModel, known: Array) -> Probe:
    """Walk every loose step of free shifts.

    Parameters
    ----------
    known : array (isotherm, isotherm)
        Covariance of log10 a_T.
    """
    order = np.argsort(model.temperature, kind="stable")
    at = int(np.flatnonzero(order == model.reference)[0])
    groups: list[Array] = []
    variances: list[float] = []
    dips: list[tuple[int, Array]] = []
    for k in range(order.size - 1):
        cold, warm = order[k], order[k + 1]
        variance = float(known[cold, cold] + known[warm, warm] - 2.0 * known[cold, warm])
        if variance <= LOOSE**2:
            continue
        # The side of the gap away from the reference moves.
        group = np.zeros(order.size)
        group[order[: k + 1] if k < at else order[k + 1 :]] = 1.0
        costs = _walk(points, weight, fit, model, group)
        likelihood = np.exp(-0.5 * (costs - costs.min()))
        found = float(np.sum(likelihood * _OFFSETS**2) / np.sum(likelihood))
        dips += [
            (len(groups), fit.state.log10_aT + _OFFSETS[i] * group) for i in _other_minima(costs)
        ]
        groups.append(group)
        variances.append(max(found - variance, 0.0))
    return Probe(np.array(groups).reshape(-1, order.size), np.array(variances), tuple(dips))


def _other_minima(costs: Array) -> NDArray[np.intp]:
    """Return the promising dips of a walk away from its middle."""
    inner = (costs[1:-1] <= costs[:-2]) & (costs[1:-1] <= costs[2:]) & (costs[1:-1] < _PROMISING)
    at = np.flatnonzero(inner) + 1
    return at[np.abs(at - costs.size // 2) > 1]


def _walk(points: Points, weight: Array, fit: Fit, model: OuterModel, group: Array) -> Array:
    """Return the total cost at every offset of a group, less that at none."""
    grid = grid_for(points, fit.state, TERMS_PER_DECADE, _MARGIN)
    middle = int(np.argmin(np.abs(_OFFSETS)))
    costs = np.empty(_OFFSETS.size)
    for side in (range(middle, _OFFSETS.size), range(middle, -1, -1)):
        guess = None
        for i in side:
            state = _moved(model, fit.state, fit.state.log10_aT + _OFFSETS[i] * group)
            trial = evaluate(points, weight, grid, state, fit.solution.strength, guess=guess)
            guess = trial.solution
            costs[i] = total_cost(trial, model)
    return costs - costs[middle]


def _moved(model: OuterModel, state: State, log10_aT: Array) -> State:
    parameters = state.parameters.copy()
    head = np.delete(log10_aT - log10_aT[model.reference], model.reference)
    parameters[: model.horizontal_size] = head
    moved = model.state(parameters)
    return state if moved is None else moved

r"""Shifts of all isotherms and one spectrum, fitted together to both moduli.

Model of isotherm k at the angular frequency ω (rad/s):

.. math::
    E_k(\omega) = b_k\, e^{i\omega d}\,\Bigl[E_{relaxed} +
        \sum_j g_j \frac{i\omega a_k\tau_j}{1 + i\omega a_k\tau_j}\Bigr]

with the horizontal shift a, the vertical shift b and the delay d of the instrument's phase. The
spectrum enters linearly and is eliminated (variable projection): for every set of shifts the
best non-negative spectrum is one small least-squares problem, and the outer Levenberg-Marquardt
iteration sees only shifts, vertical parameters and the delay. Its matrix is the data's
sensitivity to those, less the part that a change of the spectrum could imitate (Kaufman's form); the
inverse of that matrix is their covariance.

References
----------
Golub & Pereyra, Inverse Problems 19 (2003) R1, doi:10.1088/0266-5611/19/2/201.
Kaufman, BIT 15 (1975) 49, doi:10.1007/BF01932995.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.materials.spectrum import (
    TERMS_PER_DECADE,
    Grid,
    Solution,
    compress,
    make_grid,
    maxwell_shapes,
    solve,
    solve_by_cross_validation,
    solve_nearby,
    solve_normal,
)
from labpipe.materials.superposition._parameters import OuterModel, State

_LN10 = float(np.log(10.0))
# Levenberg-Marquardt: first damping relative to the diagonal, and the factor by which it grows after a bad step and
# falls after a good one. The active set of the spectrum may flicker near the end: costs are watched, not gradients.
_DAMPING, _FACTOR = 1e-3, 5.0
# No shift moves further than this in one step (decades): the model is linear only so far.
_MAX_STEP_DECADES = 0.7


@dataclass(frozen=True, slots=True)
class Points:
    """All measured points of all isotherms, one after the other.

    ``omega`` (point,) [rad/s]. ``isotherm`` (point,): Index of the isotherm that each point belongs to. ``storage``,
    ``loss`` (point,) [Pa]. ``count``: Number of isotherms.
    """

    omega: Floats
    isotherm: NDArray[np.intp]
    storage: Floats
    loss: Floats
    count: int


@dataclass(frozen=True, slots=True)
class Fit:
    """One evaluated state: spectrum, residuals, and the outer least-squares problem there.

    ``residual`` (2 point,): Weighted residuals, storage first. ``predicted`` (2 point,) [Pa]. ``rows`` (2 point,
    column): Weighted design matrix of the active columns. ``normal`` (column, column): Penalised normal matrix of the
    active columns. ``by_shift``, ``by_vertical``, ``by_delay`` (2 point,): Weighted change of every prediction with
    its own ln a, ln b, and with the delay.
    """

    state: State
    grid: Grid
    solution: Solution
    residual: Floats
    predicted: Floats
    rows: Floats
    normal: Floats
    by_shift: Floats
    by_vertical: Floats
    by_delay: Floats

    @property
    def cost(self) -> float:
        """Squared residuals plus the penalty on the spectrum."""
        return self.solution.misfit + self.solution.roughness


def reduced(points: Points, state: State) -> Floats:
    """Return ln(a ω) of every point."""
    return np.log(points.omega) + _LN10 * state.log10_aT[points.isotherm]


def grid_for(points: Points, state: State, terms_per_decade: float = TERMS_PER_DECADE) -> Grid:
    """Lay the terms for the present shifts."""
    vertical = np.exp(-state.ln_bT[points.isotherm])
    storage, loss = points.storage * vertical, points.loss * vertical
    return make_grid(reduced(points, state), storage, loss, terms_per_decade)


def evaluate(
    points: Points,
    weight: Floats,
    grid: Grid,
    state: State,
    strength: float | None,
    near: float | None = None,
    guess: Solution | None = None,
) -> Fit:
    """Find the best spectrum for one state.

    ``strength`` None chooses the smoothing by cross-validation, walking from ``near`` if given.
    A ``guess`` is the solution at a nearby state, with the strength to keep.
    """
    storage, loss = maxwell_shapes(reduced(points, state), grid.ln_time)
    phase, vertical = points.omega * state.delay, np.exp(state.ln_bT[points.isotherm])
    turn, lean = np.cos(phase) * vertical, np.sin(phase) * vertical
    half = points.omega.size
    # Storage and loss of every term and of the relaxed modulus, weighted.
    rows = np.empty((2 * half, grid.scale.size))
    for part, w, own, sign, other in (
        (rows[:half], weight[:half], storage, -1.0, loss),
        (rows[half:], weight[half:], loss, 1.0, storage),
    ):
        np.multiply(own, (w * turn)[:, None], out=part[:, :-1])
        if state.delay:
            part[:, :-1] += (sign * w * lean)[:, None] * other
    rows[:half, -1], rows[half:, -1] = weight[:half] * turn, weight[half:] * lean
    rows *= grid.scale
    measured = np.concatenate([points.storage, points.loss])
    target = measured * weight
    gram = rows.T @ rows if guess is not None else None
    solution = None if guess is None or gram is None else solve_nearby(rows, target, gram, grid.penalty, guess)
    if solution is None:
        system = compress(rows, target)
        if strength is None:
            solution = solve_by_cross_validation(*system, grid.penalty, measured.size, near)
        else:
            solution = solve(*system, grid.penalty, strength)
    coefficient = solution.coefficient
    active = coefficient > 0
    predicted = rows @ coefficient / weight
    # d/d ln ω of the two shapes: 2 L² and L (1 − 2 S).
    weights = coefficient[:-1] * grid.scale[:-1]
    storage_slope = 2.0 * loss**2 @ weights
    loss_slope = (loss * (1.0 - 2.0 * storage)) @ weights
    by_shift = np.concatenate([turn * storage_slope - lean * loss_slope, lean * storage_slope + turn * loss_slope])
    by_delay = np.concatenate([-points.omega * predicted[half:], points.omega * predicted[:half]])
    used = rows if active.all() else rows[:, active]
    normal = used.T @ used if gram is None else gram[np.ix_(active, active)]
    normal = normal + solution.strength * grid.penalty[:, active].T @ grid.penalty[:, active]
    return Fit(
        state=state,
        grid=grid,
        solution=solution,
        residual=(measured - predicted) * weight,
        predicted=predicted,
        rows=used,
        normal=normal,
        by_shift=by_shift * weight,
        by_vertical=predicted * weight,
        by_delay=by_delay * weight,
    )


def sensitivity(points: Points, fit: Fit, model: OuterModel) -> Floats:
    """Return the weighted change of every prediction per outer parameter, spectrum held."""
    shift, vertical, delay = model.directions(fit.state)
    index = np.concatenate([points.isotherm, points.isotherm])
    return np.asarray(
        fit.by_shift[:, None] * (_LN10 * shift[index])
        + fit.by_vertical[:, None] * vertical[index]
        + fit.by_delay[:, None] * delay
    )


def outer_problem(points: Points, fit: Fit, model: OuterModel) -> tuple[Floats, Floats]:
    """Return normal matrix and gradient of the outer parameters, the spectrum following, expectation included."""
    change = sensitivity(points, fit, model)
    coupling = fit.rows.T @ change
    normal = change.T @ change - coupling.T @ solve_normal(fit.normal, coupling)
    more_normal, more_gradient = model.pull(fit.state)
    return normal + more_normal, change.T @ fit.residual + more_gradient


def minimise(
    points: Points, weight: Floats, fit: Fit, model: OuterModel, tolerance: float = 1e-5, iterations: int = 40
) -> Fit:
    """Move the outer parameters to the least cost, on the grid and smoothing of a first fit (Levenberg-Marquardt)."""
    damping, least = _DAMPING, total_cost(fit, model)
    for _ in range(iterations if model.size else 0):
        normal, gradient = outer_problem(points, fit, model)
        diagonal = np.diag(normal).copy()
        diagonal[diagonal <= 0] = 1.0
        gain, promised = 0.0, np.inf
        while gain <= 0.0 and promised > tolerance * fit.cost:
            step = solve_normal(normal + damping * np.diag(diagonal), gradient)
            promised = float(gradient @ step)
            state = model.state(fit.state.parameters + step)
            if state is not None and np.max(np.abs(state.log10_aT - fit.state.log10_aT)) <= _MAX_STEP_DECADES:
                trial = evaluate(points, weight, fit.grid, state, fit.solution.strength, guess=fit.solution)
                gain = least - total_cost(trial, model)
            damping *= _FACTOR if gain <= 0.0 else 1.0
        if gain <= 0.0:
            break
        fit, least, damping = trial, least - gain, damping / _FACTOR
        if gain <= tolerance * fit.cost:
            break
    return fit


def total_cost(fit: Fit, model: OuterModel) -> float:
    """Return the cost of the outer iteration: misfit, roughness, expectation."""
    return fit.cost + model.pull_cost(fit.state)


def predictive_cost(fit: Fit, model: OuterModel) -> float:
    """Return the cost by which two minima compare: misfit, its price in effective terms, expectation.

    The misfit to be expected of new data (C_p of Mallows, Technometrics 15 (1973) 661,
    doi:10.1080/00401706.1973.10489103): a spectrum that falls apart into one piece per sweep fits better by the terms
    it gains, and predicts worse.
    """
    return fit.solution.misfit + 2.0 * fit.solution.freedom + model.pull_cost(fit.state)

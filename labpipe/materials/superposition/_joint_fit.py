r"""Shifts of all isotherms and one spectrum, fitted together to both moduli.

Model of isotherm k at the angular frequency ω (rad/s):

.. math::
    E_k(\omega) = b_k\, e^{i\omega d}\,\Bigl[E_{relaxed} +
        \sum_j g_j \frac{i\omega a_k\tau_j}{1 + i\omega a_k\tau_j}\Bigr]

with the horizontal shift a, the vertical shift b and the delay d of the instrument's phase. The
spectrum enters linearly and is eliminated (variable projection): for every set of shifts the
best non-negative spectrum is one small least-squares problem, and the outer iteration sees only
shifts, vertical parameters and the delay. Its Jacobian is the data's sensitivity to those, less
what a change of the spectrum could imitate (Kaufman's form); the inverse of its normal matrix is
their covariance.

References
----------
Golub & Pereyra, Inverse Problems 19 (2003) R1, doi:10.1088/0266-5611/19/2/201.
Kaufman, BIT 15 (1975) 49, doi:10.1007/BF01932995.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from labpipe.arrays import Floats
from labpipe.materials.spectrum import (
    MARGIN_DECADES,
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
# The active set of the spectrum may flicker near the end, so the cost is watched, not the gradient.
_COST_TOLERANCE = 1e-5
_MAX_EVALUATIONS = 80
# No shift moves further than this in one step (decades): the model is linear only so far.
_MAX_STEP_DECADES = 0.7
# A residual that refuses a trial.
_REFUSED = 1e6


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

    @property
    def moduli(self) -> Floats:
        """Storage, then loss (2 point,) [Pa]."""
        return np.concatenate([self.storage, self.loss])

    def reach(self, log10_aT: Floats) -> tuple[Floats, Floats]:
        """Return the ends (isotherm,) of the sweeps on the master curve, log10 of rad/s."""
        place = np.log10(self.omega) + log10_aT[self.isotherm]
        parts = [place[self.isotherm == k] for k in range(self.count)]
        return np.array([part.min() for part in parts]), np.array([part.max() for part in parts])


@dataclass(frozen=True, slots=True)
class Fit:
    """One evaluated state: spectrum, residuals, and the least-squares problem there.

    ``residual`` (2 point,): Weighted residuals, storage first. ``predicted`` (2 point,) [Pa]. ``rows`` (2 point,
    column), ``rough`` (row, column): Weighted design matrix and penalty of the active columns. ``normal`` (column,
    column): Their penalised normal matrix. ``by_shift`` (2 point,): Weighted change of every prediction with its own
    ln a.
    """

    state: State
    grid: Grid
    solution: Solution
    weight: Floats
    residual: Floats
    predicted: Floats
    rows: Floats
    rough: Floats
    normal: Floats
    by_shift: Floats

    @property
    def cost(self) -> float:
        """Squared residuals plus the penalty on the spectrum."""
        return self.solution.misfit + self.solution.roughness


def reduced(points: Points, state: State) -> Floats:
    """Return ln(a ω) of every point."""
    return np.log(points.omega) + _LN10 * state.log10_aT[points.isotherm]


def grid_for(points: Points, state: State, terms_per_decade: float, margin: float = MARGIN_DECADES) -> Grid:
    """Lay the terms for the present shifts."""
    vertical = np.exp(-state.ln_bT[points.isotherm])
    storage, loss = points.storage * vertical, points.loss * vertical
    return make_grid(reduced(points, state), storage, loss, terms_per_decade=terms_per_decade, margin=margin)


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
    factor = np.exp(state.ln_bT[points.isotherm] + 1j * points.omega * state.delay)
    terms = factor[:, None] * np.column_stack([storage + 1j * loss, np.ones(points.omega.size)]) * grid.scale
    rows = np.vstack([terms.real, terms.imag]) * weight[:, None]
    measured = points.moduli
    target = measured * weight
    solution = None if guess is None else solve_nearby(rows, target, grid.penalty, guess)
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
    slope = factor * ((2.0 * loss**2 + 1j * loss * (1.0 - 2.0 * storage)) @ (coefficient * grid.scale)[:-1])
    used, rough = rows[:, active], np.sqrt(solution.strength) * grid.penalty[:, active]
    return Fit(
        state=state,
        grid=grid,
        solution=solution,
        weight=weight,
        residual=(measured - predicted) * weight,
        predicted=predicted,
        rows=used,
        rough=rough,
        normal=used.T @ used + rough.T @ rough,
        by_shift=np.concatenate([slope.real, slope.imag]) * weight,
    )


def sensitivity(points: Points, fit: Fit, model: OuterModel) -> Floats:
    """Return the weighted change of every prediction per outer parameter, spectrum held."""
    shift, vertical, delay = model.directions(fit.state)
    index = np.tile(points.isotherm, 2)
    storage, loss = np.split(fit.predicted, 2)
    by_delay = np.concatenate([-points.omega * loss, points.omega * storage])
    return np.asarray(
        fit.by_shift[:, None] * (_LN10 * shift[index])
        + (fit.predicted * fit.weight)[:, None] * vertical[index]
        + (by_delay * fit.weight)[:, None] * delay
    )


def outer_residuals(fit: Fit, model: OuterModel) -> Floats:
    """Return the residuals (row,) of the outer problem: of the data, the penalty on the spectrum, the expectations."""
    pull, target = model.expected
    active = fit.solution.coefficient[fit.solution.coefficient > 0]
    return np.concatenate([fit.residual, -fit.rough @ active, target - pull @ fit.state.parameters])


def outer_jacobian(points: Points, fit: Fit, model: OuterModel) -> Floats:
    """Return the change (row, parameter) of the predictions behind those residuals, the spectrum following."""
    change = sensitivity(points, fit, model)
    followed = solve_normal(fit.normal, fit.rows.T @ change)
    return np.vstack([change - fit.rows @ followed, -fit.rough @ followed, model.expected[0]])


def outer_problem(points: Points, fit: Fit, model: OuterModel) -> tuple[Floats, Floats]:
    """Return normal matrix and gradient of the outer parameters, the spectrum following."""
    jacobian = outer_jacobian(points, fit, model)
    return jacobian.T @ jacobian, jacobian.T @ outer_residuals(fit, model)


def minimise(
    points: Points,
    weight: Floats,
    fit: Fit,
    model: OuterModel,
    tolerance: float = _COST_TOLERANCE,
    evaluations: int = _MAX_EVALUATIONS,
) -> Fit:
    """Move the outer parameters to the least cost, on the grid and smoothing of a first fit."""
    if not model.size:
        return fit
    accepted = last = fit
    refused = np.full(outer_residuals(fit, model).size, _REFUSED)

    def residuals(parameters: Floats) -> Floats:
        nonlocal last
        state = model.state(parameters)
        if state is None or np.max(np.abs(state.log10_aT - accepted.state.log10_aT)) > _MAX_STEP_DECADES:
            return refused
        if not np.array_equal(parameters, last.state.parameters):
            last = evaluate(points, weight, fit.grid, state, fit.solution.strength, guess=accepted.solution)
        return outer_residuals(last, model)

    def slopes(parameters: Floats) -> Floats:
        nonlocal accepted
        accepted = last
        return -outer_jacobian(points, last, model)

    first = fit.state.parameters
    least_squares(residuals, first, slopes, ftol=tolerance, xtol=1e-6, gtol=None, max_nfev=evaluations, x_scale="jac")
    return accepted


def total_cost(fit: Fit, model: OuterModel) -> float:
    """Return the cost of the outer iteration: misfit, roughness, expectation."""
    return fit.cost + model.pull_cost(fit.state)


def predictive_cost(fit: Fit, model: OuterModel) -> float:
    """Return the cost by which two minima compare: misfit, its price in effective terms, expectation.

    The misfit to be expected of new data (Mallows' C_p), the same judge that cross-validation
    asks for the smoothing: a spectrum that falls apart into one piece per sweep fits better by
    the terms it gains, and predicts worse.

    References
    ----------
    Mallows, Technometrics 15 (1973) 661, doi:10.1080/00401706.1973.10489103.
    """
    return fit.solution.misfit + 2.0 * fit.solution.freedom + model.pull_cost(fit.state)

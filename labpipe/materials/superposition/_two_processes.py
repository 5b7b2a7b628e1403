r"""The alternative to superposition: two processes that shift apart.

.. math::
    E_k(\omega) = E_{relaxed} + \sum_j g_j \frac{i\omega a_k\tau_j}{1 + i\omega a_k\tau_j}
                  + \sum_j h_j \frac{i\omega a_k^r\tau_j}{1 + i\omega a_k^r\tau_j}

The second spectrum shifts by the share r of the first one's decades, as a secondary relaxation
does whose activation energy is lower. Vertical factors, levels and a delay can imitate this over
a few decades so well that both moduli stay consistent; only the comparison tells. It costs one
number more than superposition and no vertical law.

References
----------
Plazek, J. Rheol. 40 (1996) 987, doi:10.1122/1.550776.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials._shift_law import fit_law, law_values
from labpipe.materials.spectrum import (
    Grid,
    Solution,
    compress,
    make_grid,
    maxwell_shapes,
    solve,
    solve_nearby,
    solve_normal,
)
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._runs import runs_in, sweeps_of
from labpipe.materials.superposition._shift_parameters import SLOPE_SPREAD, OuterModel

# Shares of the second process to start from; it stays between these limits.
_SHARES, _LEAST_SHARE, _MOST_SHARE = (0.35, 0.65), 0.05, 0.97
_DAMPINGS = (1e-3, 1e-1, 10.0)
# Every start goes a few steps, the best one to its end.
_SCREENING, _MAX_ITERATIONS, _TOLERANCE = 5, 20, 1e-3
# Shifts move by this much (decades) in one step at most, the share by a tenth of it.
_MAX_STEP = 0.5
# Smoothing, in units of the noise, that biases no shift.
_UNBIASED = 1.0
_LN10 = float(np.log(10.0))


@dataclass(frozen=True, slots=True)
class TwoProcesses:
    """The best fit of two processes.

    ``share``: decades that the second process shifts for each of the first; ``log10_aT`` (isotherm,): of the first
    process, zero at the reference isotherm; ``covariance`` (isotherm, isotherm): of ``log10_aT``, the spectra and the
    share having followed; ``cost``: misfit, twice the effective number of terms, and the expectation of shifts:
    comparable with :func:`._joint_fit.predictive_cost` at the same weights; ``length``: how many neighbouring readings
    are worth one, by what two processes leave; ``belief``: probability of two processes after the data; one where they
    are the better model beyond doubt.
    """

    share: float
    log10_aT: Floats
    covariance: Floats
    cost: float
    length: float
    belief: float = 1.0


def two_processes(points: Points, weight: Floats, model: OuterModel, log10_aT: Floats, strength: float) -> TwoProcesses:
    """Fit two processes to the sweeps.

    ``points``; ``weight`` (2 point,): one over the noise, storage first; ``model``: free shifts; its vertical law,
    levels and delay are left out; ``log10_aT`` (isotherm,): shifts of one process, to start from; ``strength``:
    smoothing of either spectrum.
    """
    hot = np.argsort(model.temperature)[-max(4, model.temperature.size // 2) :]
    law = fit_law("wlf", model.temperature[hot], log10_aT[hot], np.eye(hot.size), model.T_ref)
    continued = law_values("wlf", np.array(law.parameters), model.temperature, model.T_ref)
    starts = [log10_aT]
    if continued is not None:
        starts.append(continued - continued[model.reference])
    search = _Search(points, weight, model, strength)
    tried: list[TwoProcesses] = []
    for first, share in product(starts, _SHARES):
        if tried and not points.work.goes_on():
            break
        tried.append(search.best(first, share, _SCREENING))
    found = min(tried, key=lambda fit: fit.cost)
    return search.best(found.log10_aT, found.share, _MAX_ITERATIONS) if points.work.goes_on() else found


@dataclass(frozen=True, slots=True)
class _Spectra:
    """Both spectra at one set of shifts, with the sensitivities to the shifts of either process and to the level."""

    solution: Solution
    residual: Floats
    rows: Floats
    normal: Floats
    by_first: Floats
    by_second: Floats
    by_vertical: Floats


@dataclass(frozen=True, slots=True)
class _Search:
    points: Points
    weight: Floats
    model: OuterModel
    strength: float

    def best(self, log10_aT: Floats, share: float, iterations: int) -> TwoProcesses:
        """Improve all shifts and the share by damped Gauss-Newton steps."""
        grids = (self._grid(log10_aT), self._grid(share * log10_aT))
        penalty = _stacked(*grids)
        found = self._spectra(grids, penalty, log10_aT, share, None)
        cost = self._cost(found, log10_aT)
        for _ in range(iterations):
            gain = 0.0
            for damping in _DAMPINGS:
                shifts, other = self._step(found, log10_aT, share, damping)
                trial = self._spectra(grids, penalty, shifts, other, found.solution)
                lower = self._cost(trial, shifts)
                if lower < cost:
                    gain, found, cost, log10_aT, share = cost - lower, trial, lower, shifts, other
                    break
            if gain <= _TOLERANCE * cost:
                break
        inverse = np.asarray(np.linalg.pinv(found.normal, hermitian=True))
        length = runs_in(found.residual, [(found.rows, inverse)], sweeps_of(self.points)).length
        # As certain as spectra leave them that may bend, and a modulus that may soften.
        free_to_bend = replace(self, strength=min(self.strength, _UNBIASED))
        loose = free_to_bend._spectra(grids, penalty, log10_aT, share, None)
        normal, _, free = self._problem(loose, log10_aT, share, has_slope=True)
        covariance = length * free @ np.linalg.pinv(normal, hermitian=True)[:-2, :-2] @ free.T
        predictive = found.solution.misfit + 2.0 * found.solution.freedom + self._pull(log10_aT)
        return TwoProcesses(share, log10_aT, covariance, predictive, length)

    def _grid(self, log10_aT: Floats) -> Grid:
        points = self.points
        x = np.log(points.omega) + _LN10 * log10_aT[points.isotherm]
        return make_grid(x, points.storage, points.loss, terms_per_decade=2)

    def _spectra(
        self, grids: tuple[Grid, Grid], penalty: Floats, log10_aT: Floats, share: float, guess: Solution | None
    ) -> _Spectra:
        points = self.points
        storage, loss, slopes = [], [], []
        for grid, shifts in zip(grids, (log10_aT, share * log10_aT), strict=True):
            x = np.log(points.omega) + _LN10 * shifts[points.isotherm]
            up, down = maxwell_shapes(x, grid.ln_time)
            scale = grid.scale[:-1]
            storage.append(up * scale)
            loss.append(down * scale)
            slopes.append(np.vstack([2.0 * down**2, down * (1.0 - 2.0 * up)]) * scale)
        constant = np.full((points.omega.size, 1), grids[0].scale[-1])
        design = np.vstack([np.hstack([*storage, constant]), np.hstack([*loss, 0.0 * constant])])
        rows = design * self.weight[:, None]
        points.work.spent += rows.size
        target = np.concatenate([points.storage, points.loss]) * self.weight
        solution = solve_nearby(rows, target, rows.T @ rows, penalty, guess) if guess is not None else None
        if solution is None:
            solution = solve(*compress(rows, target), penalty, self.strength)
        weights, active = solution.coefficient, solution.coefficient > 0
        first = grids[0].ln_time.size
        used = rows[:, active]
        return _Spectra(
            solution=solution,
            residual=target - rows @ weights,
            rows=used,
            normal=used.T @ used + self.strength * penalty[:, active].T @ penalty[:, active],
            by_first=(slopes[0] @ weights[:first]) * self.weight * _LN10,
            by_second=(slopes[1] @ weights[first:-1]) * self.weight * _LN10,
            by_vertical=rows @ weights,
        )

    def _step(self, found: _Spectra, log10_aT: Floats, share: float, damping: float) -> tuple[Floats, float]:
        """Return the next shifts and share."""
        normal, gradient, free = self._problem(found, log10_aT, share)
        diagonal = np.maximum(np.diag(normal), 1e-12)
        step = solve_normal(normal + damping * np.diag(diagonal), gradient)
        step /= max(1.0, float(np.max(np.abs(step[:-1]))) / _MAX_STEP, abs(float(step[-1])) / (0.1 * _MAX_STEP))
        return log10_aT + free @ step[:-1], float(np.clip(share + step[-1], _LEAST_SHARE, _MOST_SHARE))

    def _problem(
        self, found: _Spectra, log10_aT: Floats, share: float, *, has_slope: bool = False
    ) -> tuple[Floats, Floats, Floats]:
        """Return normal matrix and gradient of free shifts and share; the spectra follow (Kaufman's form).

        A slope of ln b over temperature, in its standard deviations, is the last parameter if there is to be one.
        """
        isotherm = np.concatenate([self.points.isotherm, self.points.isotherm])
        free = np.delete(np.eye(log10_aT.size), self.model.reference, axis=1)
        change = np.column_stack(
            [(found.by_first + share * found.by_second)[:, None] * free[isotherm], found.by_second * log10_aT[isotherm]]
        )
        if has_slope:
            slope = SLOPE_SPREAD * (self.model.temperature - self.model.T_ref)
            change = np.column_stack([change, found.by_vertical * slope[isotherm]])
        coupling = found.rows.T @ change
        normal = change.T @ change - coupling.T @ solve_normal(found.normal, coupling)
        gradient = change.T @ found.residual
        if self.model.expectation is not None:
            known = self.model.expectation
            pull = known.rows @ free
            count = free.shape[1]
            normal[:count, :count] += pull.T @ pull
            gradient[:count] -= pull.T @ (known.rows @ log10_aT - known.target)
        if has_slope:
            normal[-1, -1] += 1.0
        return normal, gradient, free

    def _pull(self, log10_aT: Floats) -> float:
        return 0.0 if self.model.expectation is None else self.model.expectation.cost(log10_aT)

    def _cost(self, found: _Spectra, log10_aT: Floats) -> float:
        return found.solution.misfit + found.solution.roughness + self._pull(log10_aT)


def _stacked(first: Grid, second: Grid) -> Floats:
    """Return the penalty on either spectrum; the relaxed modulus, last, pays none."""
    one, other = first.penalty[:, :-1], second.penalty[:, :-1]
    penalty = np.zeros((one.shape[0] + other.shape[0], one.shape[1] + other.shape[1] + 1))
    penalty[: one.shape[0], : one.shape[1]] = one
    penalty[one.shape[0] :, one.shape[1] : -1] = other
    return penalty

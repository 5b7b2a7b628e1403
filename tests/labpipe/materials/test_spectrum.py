"""The penalised non-negative spectrum: kernels, optimum, cross-validation."""

import numpy as np
import pytest

from labpipe.materials.spectrum._spectrum import (
    compress,
    make_grid,
    maxwell_shapes,
    solve,
    solve_by_cross_validation,
    solve_nearby,
)

LN_OMEGA = np.log(2 * np.pi * np.logspace(-3, 4, 80))


def problem(truth, noise, seed=0):
    exact = truth.modulus(np.exp(LN_OMEGA))
    rng = np.random.default_rng(seed)
    measured = np.concatenate([exact.real, exact.imag])
    measured = measured * (1 + noise * rng.standard_normal(measured.size))
    grid = make_grid(LN_OMEGA, measured[:80], measured[80:])
    storage, loss = maxwell_shapes(LN_OMEGA, grid.ln_time)
    upper = np.column_stack([storage, np.ones(80)])
    lower = np.column_stack([loss, np.zeros(80)])
    design = np.vstack([upper, lower]) * grid.scale
    weight = 1 / (max(noise, 1e-4) * measured)
    return design, measured, weight, grid, np.concatenate([exact.real, exact.imag])


def test_smoothing_chosen_by_cross_validation_is_near_the_best(maxwell_truth):
    design, measured, weight, grid, exact = problem(maxwell_truth, 0.02)
    system = compress(design * weight[:, None], measured * weight)
    chosen = solve_by_cross_validation(*system, grid.penalty, measured.size)

    def error(solution):
        return np.sqrt(np.mean((design @ solution.coefficient / exact - 1) ** 2))

    best = min(error(solve(*system, grid.penalty, s)) for s in np.logspace(-4, 5, 28))
    assert error(chosen) < 1.3 * best
    assert error(chosen) < 0.01
    assert 5 < chosen.freedom < 40


def test_nearby_solution_equals_the_one_from_nothing(maxwell_truth):
    design, measured, weight, grid, _ = problem(maxwell_truth, 0.02)
    rows, target = design * weight[:, None], measured * weight
    guess = solve(*compress(rows, target), grid.penalty, 0.01)
    moved = np.roll(target, 1)
    near = solve_nearby(rows, moved, rows.T @ rows, grid.penalty, guess)
    fresh = solve(*compress(rows, moved), grid.penalty, 0.01)
    if near is not None:
        np.testing.assert_allclose(near.coefficient, fresh.coefficient, atol=1e-6)
    small = solve_nearby(rows, target * (1 + 1e-3 * np.sin(np.arange(160))), rows.T @ rows, grid.penalty, guess)
    assert small is not None
    assert small.freedom == pytest.approx(guess.freedom, rel=0.2)

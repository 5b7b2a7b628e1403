"""The penalised non-negative spectrum: a problem near one that was solved before."""

import numpy as np
import pytest

from labpipe.materials.spectrum import compress, make_grid, moduli_of_terms, solve, solve_nearby

LN_OMEGA = np.log(2 * np.pi * np.logspace(-3, 4, 80))


def test_nearby_solution_equals_the_one_from_nothing(maxwell_truth):
    exact = maxwell_truth.modulus(np.exp(LN_OMEGA))
    noise = 1 + 0.02 * np.random.default_rng(0).standard_normal(160)
    measured = np.concatenate([exact.real, exact.imag]) * noise
    grid = make_grid(LN_OMEGA, measured[:80], measured[80:])
    weight = 1 / (0.02 * measured)
    rows = moduli_of_terms(LN_OMEGA, grid.ln_time) * grid.scale * weight[:, None]
    guess = solve(*compress(rows, measured * weight), grid.penalty, 0.01)
    target = measured * weight * (1 + 1e-3 * np.sin(np.arange(160)))
    near = solve_nearby(rows, target, rows.T @ rows, grid.penalty, guess)
    fresh = solve(*compress(rows, target), grid.penalty, 0.01)
    assert near is not None
    np.testing.assert_allclose(near.coefficient, fresh.coefficient, atol=1e-6)
    assert near.freedom == pytest.approx(fresh.freedom, rel=1e-6)

import numpy as np
import pytest

from labpipe.identification._fit import Objective, fit
from tests.labpipe.identification.holds import hold_problem


def test_surrogate_of_forces_is_exact_far_away() -> None:
    problem = hold_problem(1)
    objective = Objective(problem, problem.no_corrections(), {})
    at = np.zeros(len(problem.parameters))
    rest = objective.residuals(at)[: -at.size]
    surrogate = objective.surrogate(at, rest)
    there = at.copy()
    there[: problem.n_material] = np.linspace(-1.0, 1.0, problem.n_material)
    found, _ = surrogate.rows(there)
    assert np.allclose(found, objective.residuals(there)[: -at.size], rtol=1e-9, atol=1e-6)


def test_surrogate_has_its_least_cost_where_the_fit_ended() -> None:
    found = fit(hold_problem(1))
    objective = Objective.of(found)
    moved, cost = objective.surrogate(found.xi).lowest(1e-9, 6.0)
    assert cost == pytest.approx(objective.cost(moved), rel=1e-4)
    assert cost == pytest.approx(objective.cost(found.xi), rel=1e-3)

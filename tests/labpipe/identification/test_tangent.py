import numpy as np

from labpipe.identification.fit import Objective
from tests.labpipe.identification.holds import hold_problem


def test_surrogate_of_forces_is_exact_far_away() -> None:
    problem = hold_problem(1)
    objective = Objective(problem, problem.no_corrections(), {})
    at = np.zeros(len(problem.parameters))
    rest = objective.residuals(at)[: -at.size]
    surrogate = objective._surrogate(at, rest)
    there = at.copy()
    there[: problem.n_material] = np.linspace(-1.0, 1.0, problem.n_material)
    found, _ = surrogate.rows(there)
    assert np.allclose(found, objective.residuals(there)[: -at.size], rtol=1e-9, atol=1e-6)


def test_unknown_that_is_held_ends_at_its_target() -> None:
    problem = hold_problem(1)
    objective = Objective(problem, problem.no_corrections(), {})
    best = objective.minimised(np.zeros(len(problem.parameters)), 0.01)
    moved = objective.followed(best, 0, float(best[0]) - 0.1, 0.01)
    assert moved[0] == best[0] - 0.1
    assert objective._height(moved, 0)[0] > objective._height(best, 0)[0]

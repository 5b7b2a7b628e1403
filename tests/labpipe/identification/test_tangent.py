import numpy as np

from labpipe.identification._fit import Objective, fit
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


def test_unknown_that_is_held_stays_while_the_others_follow() -> None:
    found = fit(hold_problem(1))
    objective = Objective.of(found)
    begin = found.xi.copy()
    begin[0] -= 0.05
    moved, _ = objective.surrogate(found.xi).lowest(1e-9, 0, 6.0, begin)
    assert moved[0] == begin[0]
    assert objective.cost(found.xi) < objective.cost(moved) < objective.cost(begin)

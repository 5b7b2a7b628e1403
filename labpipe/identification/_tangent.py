"""Predictions near a point, linearised in the moduli and in the nuisance parameters.

Forces, stiffness and moduli are linear in the terms of the relaxation modulus, and a bounce hardly
minds how a modulus is divided among terms. Logarithms, in which the prior lives, bend this: so
the bending is kept, and only the answer of a model to the terms is taken as linear. Such a
tangent holds far along the valleys that the data leave open, where a linear step in the
logarithms would end after a factor of two.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from labpipe.arrays import Floats
from labpipe.identification._problem import Problem

_MOST_STEPS = 60


@dataclass(frozen=True, eq=False)
class Tangent:
    """Predictions of all models of a problem near one point: cheap enough to be minimised at every step.

    ``at`` (parameter,): Standard coordinates of the point. ``by_terms`` (n, 1 + term), ``by_values`` (n, nuisance):
    Derivatives of the fast models of all experiments, one below the other, per Pa and by the nuisances in their
    units; in a fit, over the deviations. ``rest`` (n,): Residuals of the data there.
    """

    problem: Problem
    at: Floats
    by_terms: Floats
    by_values: Floats
    rest: Floats

    @classmethod
    def of(cls, problem: Problem, xi: Floats) -> "Tangent":
        """Differentiate every model at standard coordinates (parameter,)."""
        solid, given = problem.material(xi), problem.values(xi)
        by_terms, by_values = [], []
        for each in problem.evidence:
            by_term, others = each.model.derivatives(solid, given)
            none = np.zeros(each.values.size)
            by_terms.append(by_term)
            by_values.append(np.array([others.get(p.name, none) for p in problem.nuisances]).reshape(-1, none.size).T)
        return cls(problem, xi, np.vstack(by_terms), np.vstack(by_values), np.zeros(0))

    def jacobian(self, xi: Floats) -> Floats:
        """Return the derivative (n, parameter) of the predictions over their deviations."""
        own = [p.slope(x) for p, x in zip(self.problem.nuisances, xi[self.problem.n_material :].tolist(), strict=True)]
        return np.hstack([self.by_terms @ self.problem.spectrum.terms(xi)[1], self.by_values * np.array(own)])

    def lowest(self, damping: float, bound: float) -> tuple[Floats, float]:
        """Return the place of the least cost, and that cost.

        ``damping``: Weight of half the squared way from the point. ``bound``: Within which standard coordinates stay.
        """
        unit, root = np.eye(self.at.size), np.sqrt(damping)

        def predicted(xi: Floats) -> Floats:
            values = np.array(list(self.problem.values(xi).values()))
            return np.asarray(self.by_terms @ self.problem.spectrum.terms(xi)[0] + self.by_values @ values)

        start = predicted(self.at) + self.rest

        def residual(xi: Floats) -> Floats:
            return np.concatenate([start - predicted(xi), xi, root * (xi - self.at)])

        def slopes(xi: Floats) -> Floats:
            return np.vstack([-self.jacobian(xi), unit, root * unit])

        # By the rows themselves: their product would lose combinations that are known a million times less.
        found = least_squares(residual, self.at, slopes, bounds=(-bound, bound), method="dogbox", max_nfev=_MOST_STEPS)
        way = found.x - self.at
        return found.x, float(found.cost - 0.5 * damping * way @ way)

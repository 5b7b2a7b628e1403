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
    """Derivatives of all models of a problem at one point.

    ``at`` (parameter,): Standard coordinates of the point. ``by_terms`` (n, 1 + term): Of the fast models of all
    experiments, one below the other, per Pa. ``by_values`` (n, nuisance): By the nuisances in their units.
    """

    at: Floats
    by_terms: Floats
    by_values: Floats

    @classmethod
    def of(cls, problem: Problem, xi: Floats) -> "Tangent":
        """Differentiate every model at standard coordinates (parameter,)."""
        solid, given = problem.material(xi), problem.nuisance_values(xi)
        place = {p.name: i for i, p in enumerate(problem.nuisances)}
        by_terms, by_values = [], []
        for each in problem.evidence:
            by_term, others = each.model.derivatives(solid, given)
            columns = np.zeros((each.values.size, len(place)))
            for name, column in others.items():
                columns[:, place[name]] = column
            by_terms.append(by_term)
            by_values.append(columns)
        return cls(xi, np.vstack(by_terms), np.vstack(by_values))


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Residuals near a point, by a tangent: cheap enough to be minimised at every step.

    ``at`` (parameter,): The point. ``rest`` (n,): Residuals of the data there. ``by_terms``, ``by_values`` (n, 1 +
    term): Derivatives of the predictions over their deviations.
    """

    problem: Problem
    at: Floats
    rest: Floats
    by_terms: Floats
    by_values: Floats

    def rows(self, xi: Floats) -> tuple[Floats, Floats]:
        """Return residuals (n,) of the data at a point, and their derivative (n, parameter)."""
        terms, start = self.terms(xi), self.terms(self.at)
        values, first = self.values(xi), self.values(self.at)
        moved = self.by_terms @ (terms - start) + self.by_values @ (values - first)
        return self.rest - moved, -self.jacobian(xi)

    def jacobian(self, xi: Floats) -> Floats:
        """Return the derivative (n, parameter) of the predictions over their deviations."""
        n = self.problem.n_material
        slopes = self.terms(xi)[:, None] * self.problem.spectrum.slopes(xi[:n])
        own = [p.slope(x) for p, x in zip(self.problem.nuisances, xi[n:].tolist(), strict=True)]
        return np.hstack([self.by_terms @ slopes, self.by_values * np.array(own)])

    def lowest(self, damping: float, bound: float) -> tuple[Floats, float]:
        """Return the place of the least cost of the surrogate, and that cost.

        ``damping``: Weight of half the squared way from the point. ``bound``: Within which standard coordinates stay.
        """
        unit, root = np.eye(self.at.size), np.sqrt(damping)

        def residual(xi: Floats) -> Floats:
            return np.concatenate([self.rows(xi)[0], xi, root * (xi - self.at)])

        def slopes(xi: Floats) -> Floats:
            return np.vstack([-self.jacobian(xi), unit, root * unit])

        # By the rows themselves: their product would lose combinations that are known a million times less.
        found = least_squares(residual, self.at, slopes, bounds=(-bound, bound), method="dogbox", max_nfev=_MOST_STEPS)
        way = found.x - self.at
        return found.x, float(found.cost - 0.5 * damping * way @ way)

    def terms(self, xi: Floats) -> Floats:
        """Return (E_relaxed, E) in Pa (1 + term,) at a point."""
        return np.exp(self.problem.spectrum.log_terms(xi[: self.problem.n_material]))

    def values(self, xi: Floats) -> Floats:
        """Return the nuisances (nuisance,) in their units at a point."""
        return np.array(list(self.problem.nuisance_values(xi).values()))

"""The most probable material: least squares in standard coordinates, from several starts.

Every step minimises a surrogate that is linear in the moduli (:mod:`._tangent`), damped as
Levenberg's where it does not help. They end when the next one promises less than a set part of the
cost: a measure that knows no scale, and that can be set above the small noise of differences of a
simulator, as the tests of general routines cannot.

Costly models enter as a correction of fast ones that is held during a fit and renewed after it
until nothing changes any more: the answer is that of the costly model, at a few of its runs.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaincinv

from labpipe.arrays import Floats
from labpipe.errors import InputError, LabpipeError
from labpipe.identification._problem import Misfit, Problem
from labpipe.identification._tangent import Tangent
from labpipe.uncertainty import propagated_variance

Misfits = dict[tuple[str, str], Misfit]

BOUND = 6.0  # standard deviations of the prior: farther out it is not believed
_MODULI = tuple(np.logspace(5.0, 11.0, 7).tolist())  # Pa, levels that are tried as starts
_LOSSES = (0.01, 0.05, 0.25)  # and loss factors
_STARTS = 2  # of these, from which a fit is made
_APART = 1.0  # standard coordinates between two starts that count as different
_FAR = 1e4  # residual of a trial that the model refuses
_ROUGH, _EXACT = 0.5, 0.01  # decrease of the cost, still promised, at which a fit ends
_MOST_STEPS = 25
_DAMPING, _FACTOR = 1e-3, 20.0  # of the first step, and by which it grows after a bad step and falls after a good one
_LOOSE = 0.01  # relative deviation of every number while starts are tried
_ROUNDS = 12  # of corrections; in the second half discrepancies are looked for anyway
_LOOKS = 4  # for discrepancies; they stay after the last one
_NEAR = 1.0  # standard deviations from round to round, from where on exact minima are worth it
_SETTLED = 0.1  # standard deviations by which the answer, and share by which a discrepancy, may still change
_SURE = 0.99  # a misfit shows where its chi square exceeds this quantile
_HIGHEST_CORRELATION = 0.9


@dataclass(frozen=True, eq=False)
class Fit:
    """The most probable unknowns and how they were found.

    ``xi`` (parameter,): Standard coordinates. ``corrections`` (n,): Ratios of the fuller models to the fast ones.
    ``misfits``: By names of experiment and group. ``cost``: Half the sum of squares, prior included.
    ``costs_from_starts``: Costs reached from the separate starts, with every number uncertain by another per cent.
    ``evaluations``, ``differentiations``: Times all models were run, and their derivatives. ``is_converged``:
    Corrections and misfits do not change any more. ``jacobian`` (n, parameter): Derivative of the predictions over
    their deviations at ``xi``.
    """

    problem: Problem
    xi: Floats
    corrections: Floats
    misfits: Misfits
    cost: float
    costs_from_starts: tuple[float, ...]
    evaluations: int
    differentiations: int
    is_converged: bool
    jacobian: Floats


def fit(problem: Problem, *, start: Floats | None = None, progress: Callable[[str], None] | None = None) -> Fit:
    """Find the most probable material and nuisances.

    ``problem``: At least one experiment. ``start`` (parameter,): Standard coordinates to begin from; by default a
    scan over moduli and losses. ``progress``: Called with a line of text now and then. Raises InputError: There is no
    evidence. Raises LabpipeError: No start can be simulated.
    """
    if not problem.evidence:
        raise InputError("there are no observations: identification needs at least one experiment")
    # Precise readings make a narrow, curved valley; widened ones lead near its lowest place.
    loose = {(name, group.name): Misfit(_LOOSE) for name, group, _ in problem.groups}
    objective = Objective(problem, np.ones(problem.observed.size), loose)
    say = progress or (lambda text: None)
    starts, ends = [start] if start is not None else _starts(objective), []
    for number, begin in enumerate(starts):
        say(f"fit from start {number + 1} of {len(starts)}")
        ends.append(objective.minimised(begin, _ROUGH))
    xi, costs = min(ends, key=objective.cost), tuple(sorted(objective.cost(end) for end in ends))
    misfits: Misfits = {}
    looks, decrease = 0, _ROUGH
    for round_ in range(_ROUNDS):
        say(f"fit with corrections, round {round_ + 1}")
        objective.corrections, objective.misfits = problem.corrections(xi), misfits
        before, xi = xi, objective.minimised(xi, decrease)
        jacobian = objective.surrogate(xi).jacobian(xi)
        covariance = laplace(jacobian)[0]
        moved = float(np.max(np.abs(xi - before) / np.sqrt(np.diag(covariance))))
        is_converged = decrease == _EXACT and moved < _SETTLED
        decrease = _EXACT if moved < _NEAR else _ROUGH
        if not is_converged and round_ < _ROUNDS // 2:
            continue  # what corrections still explain is no discrepancy
        found = objective.new_misfits(xi, propagated_variance(jacobian, covariance)) if looks < _LOOKS else misfits
        looks += 1
        is_same = found.keys() == misfits.keys() and all(
            abs(m.relative - misfits[key].relative) <= _SETTLED * m.relative for key, m in found.items()
        )
        if is_converged and is_same:
            break
        misfits = found
    cost, work = objective.cost(xi), (objective.evaluations, objective.differentiations)
    return Fit(problem, xi, objective.corrections, objective.misfits, cost, costs, *work, is_converged, jacobian)


class Objective:
    """Residuals of a problem, divided by their deviations, with the prior as further rows."""

    def __init__(self, problem: Problem, corrections: Floats, misfits: Misfits) -> None:
        self.problem, self.corrections, self.misfits = problem, corrections, misfits
        self.evaluations = self.differentiations = 0
        self._last: Tangent | None = None

    def residuals(self, xi: Floats) -> Floats:
        """Return the rows (n + parameter,)."""
        self.evaluations += 1
        try:
            missed = self.problem.observed - self.corrections * self.problem.predictions(xi)
        except LabpipeError:
            return np.append(np.full(self.problem.observed.size, _FAR), xi)
        return np.append(missed / self.deviations, xi)

    @property
    def deviations(self) -> Floats:
        """The deviations (n,) of all experiments; those of a misfit go with the values."""
        return np.concatenate([self.misfits.get((n, g.name), Misfit()).deviation(g) for n, g, _ in self.problem.groups])

    def surrogate(self, xi: Floats, rows: Floats | None = None) -> Tangent:
        """Return the surrogate around a point; derivatives of the last point are kept, as ``rows`` there may be."""
        if self._last is None or not np.array_equal(self._last.at, xi):
            self.differentiations += 1
            self._last = Tangent.of(self.problem, xi)
        rows, factor = self.residuals(xi) if rows is None else rows, (self.corrections / self.deviations)[:, None]
        by_terms, by_values = factor * self._last.by_terms, factor * self._last.by_values
        return replace(self._last, by_terms=by_terms, by_values=by_values, rest=rows[: -xi.size])

    def cost(self, xi: Floats) -> float:
        """Return half the sum of squares."""
        return 0.5 * float(np.sum(self.residuals(xi) ** 2))

    def minimised(self, start: Floats, decrease: float) -> Floats:
        """Return the minimum from a start (parameter,), up to a decrease of the cost that is not worth a step.

        Every step goes to the minimum of a surrogate, and is damped where the models do not follow it there.
        """
        xi, damping = np.clip(start, -BOUND, BOUND), _DAMPING
        rows = self.residuals(xi)
        for _ in range(_MOST_STEPS):
            trial, promised = self.surrogate(xi, rows).lowest(damping, BOUND)
            height = 0.5 * float(rows @ rows)
            if height - promised < decrease:
                break
            found = self.residuals(trial)
            if 0.5 * float(found @ found) >= height:
                damping *= _FACTOR
                continue
            xi, rows, damping = trial, found, damping / _FACTOR
        return xi

    def new_misfits(self, xi: Floats, used: Floats) -> Misfits:
        """Estimate the discrepancy of every group that the stated uncertainties do not explain.

        ``used`` (n,): Share of every number's variance that the fit itself takes.
        """
        missed = self.problem.observed - self.corrections * self.problem.predictions(xi)
        found: Misfits = {}
        for name, group, place in self.problem.groups:
            known = self.misfits.get((name, group.name), Misfit())
            freedom = max(group.values.size - float(used[place].sum()), 1.0)
            new = _misfit(missed[place], group.u, np.abs(group.values), freedom)
            if new is not None:
                found[name, group.name] = new
            elif known.relative > 0.0:
                found[name, group.name] = Misfit(0.5 * known.relative, 0.0)
        return found


def laplace(rows: Floats) -> tuple[Floats, float]:
    """Return the inverse of ``rows.T @ rows + 1`` and the logarithm of its own determinant.

    By singular values: combinations may be known a million times better than others, and the
    product of the rows would lose those others.
    """
    _, values, vectors = np.linalg.svd(rows, full_matrices=True)
    more = np.ones(rows.shape[1])
    more[: values.size] += values**2
    return np.asarray((vectors.T / more) @ vectors), float(np.log(more).sum())


def _misfit(rest: Floats, u: Floats, size: Floats, freedom: float) -> Misfit | None:
    """Return the discrepancy (Mandel and Paule) that brings chi square to the degrees of freedom, None if none does.

    Autocorrelated residuals show one before they are large.
    """
    power = float(np.sum((rest / u) ** 2))
    is_wavy = power > freedom and neighbours(rest / u) > 0.0
    if not size.any() or not (is_wavy or power > 2.0 * float(gammaincinv(0.5 * freedom, _SURE))):
        return None

    def excess(relative: float) -> float:
        return float(np.sum(rest**2 / (u**2 + (relative * size) ** 2))) - freedom

    relative = 1.0 if excess(1.0) > 0.0 else float(brentq(excess, 0.0, 1.0, xtol=1e-9))
    return Misfit(relative, neighbours(rest / np.hypot(u, relative * size)))


def neighbours(normalised: Floats) -> float:
    """Return the correlation of neighbouring residuals, 0 to 0.9; 0 where it may be by chance."""
    power = float(normalised @ normalised)
    value = float(normalised[1:] @ normalised[:-1]) / power if power > 0.0 else 0.0
    chance = 2.0 / np.sqrt(max(normalised.size, 1))
    return float(np.clip(value, 0.0, _HIGHEST_CORRELATION)) if value > chance else 0.0


def _starts(objective: Objective) -> list[Floats]:
    """Scan moduli and losses, and return the best that lie apart."""
    problem, tried = objective.problem, []
    for modulus in _MODULI:
        for loss in _LOSSES:
            xi = np.zeros(len(problem.parameters))
            xi[: problem.n_material] = problem.spectrum.start(modulus, loss)
            tried.append((objective.cost(xi), xi))
    tried.sort(key=lambda pair: pair[0])
    if tried[0][0] >= 0.5 * _FAR**2:
        raise LabpipeError(
            "no material between 0.1 MPa and 100 GPa can be simulated with these experiments; "
            "check mass, radius, heights and depths"
        )
    kept: list[Floats] = []
    for _, xi in tried:
        if len(kept) < _STARTS and all(np.linalg.norm(xi - other) > _APART for other in kept):
            kept.append(xi)
    return kept

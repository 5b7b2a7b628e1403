r"""How fine the structure of a spectrum is, and what a material may be all told.

Published series mostly have one term per decade, polymers have smooth spectra, and short series
that were fitted have whatever terms a fit gave them. Storage and loss modulus of a series with one
term per decade wave about those of a smooth spectrum by 4 % of the loss modulus (Poisson's
formula), so that an answer depends on which of them is true. Here each is a candidate: the smooth
spectrum, one term per decade at any of 24 places, and a spectrum of which every term stands for
itself. Their probability after the data is that of Laplace's approximation to the evidence,

.. math:: \ln Z = -\tfrac12 |R(\hat\xi)|^2 - \tfrac12 \ln\det(J^\top J + 1),

and what is told of a modulus is told by all of them, each with its probability.

A candidate takes no run of a simulator: what the numbers do with a term of any time is known from
the derivatives at one point (:mod:`.tangent`).

References
----------
J. A. Hoeting, D. Madigan, A. E. Raftery, C. T. Volinsky, Statist. Sci. 14 (1999) 382,
doi:10.1214/ss/1009212519.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import log

import numpy as np
from numpy.typing import NDArray

from labpipe.identification.evidence import Evidence
from labpipe.identification.fit import Fit, Objective, fit
from labpipe.identification.posterior import Posterior, Structure, posterior
from labpipe.identification.problem import Problem
from labpipe.identification.spectra import (
    RoughSpectrum,
    SmoothSpectrum,
    one_per_decade,
    relaxation_times,
)
from labpipe.identification.tangent import Surrogate
from labpipe.materials import Prony

Array = NDArray[np.float64]
Rebuilt = Callable[[Array], tuple[Evidence, ...]]

SMOOTH, SPACED, ROUGH = "smooth", "one term per decade", "rough"
BEFORE = {SMOOTH: 0.5, SPACED: 0.25, ROUGH: 0.25}
"""Probabilities before the data."""
_PLACES = 24
"""Of a series with one term per decade: a tenth of a decade would show in forces of 0.2 %."""
_ROUGH_PER_DECADE = 8
_LEAST_DAMPING, _BOUND = 1e-9, 6.0
_NEGLIGIBLE = 1e-4  # probability of a candidate that is not kept


def infer(
    problem: Problem, rebuilt: Rebuilt, *, progress: Callable[[str], None] | None = None
) -> Posterior:
    """Identify a material, whatever the structure of its spectrum.

    The fit is that of the most probable structure, which is asked for without any discrepancy:
    what a smooth spectrum cannot explain may be no fault of the model.

    Parameters
    ----------
    problem : Problem
        With a smooth spectrum.
    rebuilt : callable
        Takes relaxation times (term,) and returns the evidence for them.
    progress : callable, optional
        Called with a line of text now and then.

    Returns
    -------
    Posterior
        With its structures.

    Raises
    ------
    InputError
        There is no evidence.
    LabpipeError
        No start can be simulated.
    """
    if not isinstance(problem.spectrum, SmoothSpectrum):
        return posterior(fit(problem, progress=progress))
    found = fit(problem, progress=progress).differentiated()
    begin = problem.material(found.xi)
    made = structures(replace(found, misfits={}), rebuilt, begin)
    best = made[0]
    if best.name != SMOOTH:
        own = Problem(best.spectrum, rebuilt(best.spectrum.rho), problem.nuisances)
        found = fit(own, start=best.xi, progress=progress).differentiated()
    if found.misfits:
        made = structures(found, rebuilt, begin)
    return replace(posterior(found), structures=made)


def structures(found: Fit, rebuilt: Rebuilt, begin: Prony) -> tuple[Structure, ...]:
    """Weigh the candidates for the structure of a spectrum.

    Parameters
    ----------
    found : Fit
        About which the models are linear in the terms; its misfits count for all candidates.
    rebuilt : callable
        Takes relaxation times (term,) and returns the evidence for them.
    begin : Prony
        A smooth series, from which the candidates begin.

    Returns
    -------
    tuple of Structure
        The most probable one first; those that do not matter are left out.
    """
    candidates = _candidates(found.problem)
    tangent = _Anywhere.at(found, rebuilt, [spectrum.rho for _, spectrum, _ in candidates])
    made = []
    for name, spectrum, before in candidates:
        surrogate = tangent.surrogate(spectrum, spectrum.like(begin))
        xi, cost = surrogate.lowest(_LEAST_DAMPING, None, _BOUND)
        rows = surrogate.jacobian(xi)
        curvature = rows.T @ rows + np.eye(xi.size)
        evidence = -cost - 0.5 * float(np.linalg.slogdet(curvature)[1])
        made.append(
            (
                log(before) + evidence,
                Structure(name, spectrum, xi, np.asarray(np.linalg.inv(curvature)), 0.0),
            )
        )
    best = max(evidence for evidence, _ in made)
    weights = np.exp([evidence - best for evidence, _ in made])
    weights /= weights.sum()
    kept = [
        replace(one, weight=float(w))
        for (_, one), w in zip(made, weights, strict=True)
        if w > _NEGLIGIBLE
    ]
    total = sum(one.weight for one in kept)
    kept.sort(key=lambda one: -one.weight)
    return tuple(replace(one, weight=one.weight / total) for one in kept)


def _candidates(problem: Problem) -> list[tuple[str, SmoothSpectrum | RoughSpectrum, float]]:
    """Return names, spectra and probabilities before the data."""
    windows = [each.model.window for each in problem.evidence]
    data = min(w[0] for w in windows), max(w[1] for w in windows)
    nu = problem.spectrum.nu

    def on(rho: Array) -> SmoothSpectrum:
        return SmoothSpectrum(rho, nu)

    spaced = BEFORE[SPACED] / _PLACES
    return [
        (SMOOTH, on(relaxation_times(*data)), BEFORE[SMOOTH]),
        *((SPACED, on(one_per_decade(*data, i / _PLACES)), spaced) for i in range(_PLACES)),
        (ROUGH, RoughSpectrum(on(relaxation_times(*data, per_decade=_ROUGH_PER_DECADE))),
         BEFORE[ROUGH]),
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Anywhere:
    """Derivatives at a fit by terms of the times of all candidates.

    Attributes
    ----------
    found : Fit
    rho : array (term,) [s]
        Ascending.
    rest : array (n,)
        Residuals at the fit.
    by_terms : array (n, 1 + term)
        Over the deviations.
    by_values : array (n, nuisance)
        Over the deviations.
    at_fit : array (n,)
        What the terms of the fit make, by ``by_terms``.
    """

    found: Fit
    rho: Array
    rest: Array
    by_terms: Array
    by_values: Array
    at_fit: Array

    @classmethod
    def at(cls, found: Fit, rebuilt: Rebuilt, times: list[Array]) -> "_Anywhere":
        problem, xi = found.problem, found.xi
        objective = Objective.of(found)
        base = objective.surrogate(xi)
        rho = np.unique(np.concatenate([*times, problem.spectrum.rho]))
        solid, given = problem.material(xi), problem.given(xi)
        rows = []
        for number, (each, ratio) in enumerate(zip(rebuilt(rho), found.corrections, strict=True)):
            weight, _ = each.weight(ratio, given)
            scale = weight / objective.deviations(number)
            rows.append(scale[:, None] * each.model.by_times(solid, given, rho))
        by_terms = np.vstack(rows)
        terms = base.terms(xi)
        own = by_terms[:, _columns(rho, problem.spectrum.rho)] @ terms
        return cls(found, rho, base.rest, by_terms, base.by_values, own)

    def surrogate(self, spectrum: SmoothSpectrum | RoughSpectrum, material: Array) -> Surrogate:
        """Return the surrogate of a candidate about some coordinates of its material."""
        problem, xi = self.found.problem, self.found.xi
        own = replace(problem, spectrum=spectrum)
        by_terms = self.by_terms[:, _columns(self.rho, spectrum.rho)]
        at = np.concatenate([np.clip(material, -_BOUND, _BOUND), xi[problem.n_material :]])
        made = by_terms @ np.exp(spectrum.log_terms(at[: own.n_material]))
        return Surrogate(own, at, self.rest - (made - self.at_fit), by_terms, self.by_values)


def _columns(rho: Array, own: Array) -> NDArray[np.int64]:
    """Return the columns of E_relaxed and of some of the times."""
    return np.concatenate([[0], 1 + np.searchsorted(rho, own)])

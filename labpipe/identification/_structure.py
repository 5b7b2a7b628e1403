r"""How uneven a relaxation spectrum is: inference for several degrees of unevenness, and their average.

Spectra of polymers are smooth: broad dispersions that overlap. Some have a shoulder or a narrow
peak, or end steeply. How soon a slope may turn decides what the moduli between two readings and
beyond the last one can be, so that an answer depends on it. Each is a candidate: the smooth spectrum, and an
uneven one whose slope turns within half a decade. (A series of single terms is neither, and no
polymer has one; recorded from one, a misfit remains and is said.) Their probability after the data is
that of Laplace's approximation to the evidence,

.. math:: \ln Z = -\tfrac12 |R(\hat\xi)|^2 - \tfrac12 \ln\det(J^\top J + 1),

and a modulus is averaged over both with their posterior probabilities.

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
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats, Integers
from labpipe.identification._evidence import Evidence
from labpipe.identification._fit import Fit, Objective, fit, laplace
from labpipe.identification._posterior import Posterior, Structure, posterior
from labpipe.identification._problem import Problem
from labpipe.identification._spectra import SmoothSpectrum, relaxation_times
from labpipe.identification._tangent import Surrogate
from labpipe.materials import Prony

Rebuilt = Callable[[Floats], tuple[Evidence, ...]]

SMOOTH, UNEVEN = "smooth", "uneven"
STRUCTURE_PRIORS = {SMOOTH: 0.5, UNEVEN: 0.5}
"""Probabilities before the data."""
_UNEVEN_PER_DECADE, _UNEVEN_TURN = 4, 0.5
_LEAST_DAMPING, _BOUND = 1e-9, 6.0
_NEGLIGIBLE = 1e-4  # probability of a candidate that is not kept


def infer(problem: Problem, rebuilt: Rebuilt, *, progress: Callable[[str], None] | None = None) -> Posterior:
    """Identify a material, whatever the structure of its spectrum.

    The fit is that of the most probable structure, which is asked for without any discrepancy:
    what a smooth spectrum cannot explain may be no fault of the model.

    ``problem``: With a smooth spectrum. ``rebuilt``: Takes relaxation times (term,) and returns the evidence for
    them. ``progress``: Called with a line of text now and then. Returns: With its structures. Raises InputError:
    There is no evidence. Raises LabpipeError: No start can be simulated.
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
    if best.name != SMOOTH or found.misfits:
        # a gain stretches what is predicted: how, is known only where the prediction is right
        made = structures(found, rebuilt, begin)
    return replace(posterior(found), structures=made)


def structures(found: Fit, rebuilt: Rebuilt, begin: Prony) -> tuple[Structure, ...]:
    """Weigh the candidates for the structure of a spectrum.

    ``found``: about which the models are linear in the terms; its misfits count for all candidates; ``rebuilt``: takes
    relaxation times (term,) and returns the evidence for them; ``begin``: a smooth series, from which the candidates
    begin. Returns the most probable one first; those that do not matter are left out.
    """
    windows = [each.model.window for each in found.problem.evidence]
    data = min(w[0] for w in windows), max(w[1] for w in windows)
    nu = found.problem.spectrum.nu

    candidates = [
        _Candidate(SMOOTH, SmoothSpectrum(relaxation_times(*data), nu)),
        _Candidate(UNEVEN, SmoothSpectrum(relaxation_times(*data, per_decade=_UNEVEN_PER_DECADE), nu, _UNEVEN_TURN)),
    ]
    return _probable(_weighed(found, rebuilt, begin, candidates))


class _Candidate(NamedTuple):
    """Name and spectrum."""

    name: str
    spectrum: SmoothSpectrum


class _Weighed(NamedTuple):
    """The logarithm of a candidate's evidence, and what it says."""

    logarithm: float
    found: Structure


def _weighed(found: Fit, rebuilt: Rebuilt, begin: Prony, candidates: list[_Candidate]) -> list[_Weighed]:
    tangent = _Anywhere.at(found, rebuilt, [each.spectrum.rho for each in candidates])
    made = []
    for each in candidates:
        surrogate = tangent.surrogate(each.spectrum, each.spectrum.coordinates_of(begin))
        xi, cost = surrogate.lowest(_LEAST_DAMPING, _BOUND)
        covariance, size = laplace(surrogate.jacobian(xi))
        logarithm = log(STRUCTURE_PRIORS[each.name]) - cost - 0.5 * size
        structure = Structure(each.name, each.spectrum, xi, covariance, 0.0)
        made.append(_Weighed(logarithm, structure))
    return made


def _probable(made: list[_Weighed]) -> tuple[Structure, ...]:
    """Return those that matter with their probabilities, the most probable one first."""
    logarithms = np.array([one.logarithm for one in made])
    weights = np.exp(logarithms - logarithms.max())
    weights /= weights.sum()
    weights[weights < _NEGLIGIBLE] = 0.0
    weights /= weights.sum()
    kept = [replace(one.found, weight=float(w)) for one, w in zip(made, weights, strict=True) if w > 0.0]
    return tuple(sorted(kept, key=lambda one: -one.weight))


@dataclass(frozen=True, eq=False)
class _Anywhere:
    """Derivatives at a fit by terms of the times of all candidates.

    ``found``; ``rho`` (term,) [s]: ascending; ``rest`` (n,): residuals at the fit; ``by_terms`` (n, 1 + term): over the
    deviations; ``by_values`` (n, nuisance): over the deviations; ``at_fit`` (n,): what the terms of the fit make, by
    ``by_terms``.
    """

    found: Fit
    rho: Floats
    rest: Floats
    by_terms: Floats
    by_values: Floats
    at_fit: Floats

    @classmethod
    def at(cls, found: Fit, rebuilt: Rebuilt, times: list[Floats]) -> "_Anywhere":
        problem, xi = found.problem, found.xi
        objective = Objective.of(found)
        base = objective.surrogate(xi)
        rho = np.unique(np.concatenate([*times, problem.spectrum.rho]))
        solid, given = problem.material(xi), problem.nuisance_values(xi)
        scale = np.concatenate(found.corrections) / objective.deviations
        by_terms = scale[:, None] * np.vstack([each.model.by_times(solid, given, rho) for each in rebuilt(rho)])
        terms = base.terms(xi)
        own = by_terms[:, _columns(rho, problem.spectrum.rho)] @ terms
        return cls(found, rho, base.rest, by_terms, base.by_values, own)

    def surrogate(self, spectrum: SmoothSpectrum, material: Floats) -> Surrogate:
        """Return the surrogate of a candidate about some coordinates of its material."""
        problem, xi = self.found.problem, self.found.xi
        own = replace(problem, spectrum=spectrum)
        by_terms = self.by_terms[:, _columns(self.rho, spectrum.rho)]
        at = np.concatenate([np.clip(material, -_BOUND, _BOUND), xi[problem.n_material :]])
        made = by_terms @ np.exp(spectrum.log_terms(at[: own.n_material]))
        return Surrogate(own, at, self.rest - (made - self.at_fit), by_terms, self.by_values)


def _columns(rho: Floats, own: Floats) -> Integers:
    """Return the columns of E_relaxed and of some of the times."""
    return np.concatenate([[0], 1 + np.searchsorted(rho, own)])

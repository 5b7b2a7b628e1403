r"""How uneven a relaxation spectrum is: inference for several degrees of unevenness, and their average.

Spectra of polymers are smooth: broad dispersions that overlap. Some have a shoulder or a narrow
peak, or end steeply. How soon a slope may turn limits the moduli between two readings and
beyond the last one, so that an answer depends on it. Each is a candidate: the smooth spectrum, and an
uneven one whose slope turns within half a decade. (A series of single terms is neither, and no
polymer has one; recorded from one, a misfit remains and is said.) Their probability after the data is
that of Laplace's approximation to the evidence,

.. math:: \ln Z = -\tfrac12 |R(\hat\xi)|^2 - \tfrac12 \ln\det(J^\top J + 1),

and a modulus is averaged over both with their posterior probabilities.

A candidate takes no run of a simulator: the effect of a term of any time on the numbers is known from
the derivatives at one point (:mod:`.tangent`).

References
----------
J. A. Hoeting, D. Madigan, A. E. Raftery, C. T. Volinsky, Statist. Sci. 14 (1999) 382,
doi:10.1214/ss/1009212519.
"""

from collections.abc import Callable
from dataclasses import replace
from math import log

import numpy as np

from labpipe.arrays import Floats
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
    a misfit of a smooth spectrum may be no fault of the model.

    ``problem``: With a smooth spectrum. ``rebuilt``: Takes relaxation times (term,) and returns the evidence for
    them. ``progress``: Called with a line of text now and then. Returns: With its structures. Raises InputError:
    There is no evidence. Raises LabpipeError: No start can be simulated.
    """
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
    problem, xi, n = found.problem, found.xi, found.problem.n_material
    windows = [each.model.window for each in problem.evidence]
    data, nu = (min(w[0] for w in windows), max(w[1] for w in windows)), problem.spectrum.nu
    candidates = {
        SMOOTH: SmoothSpectrum(relaxation_times(*data), nu),
        UNEVEN: SmoothSpectrum(relaxation_times(*data, per_decade=_UNEVEN_PER_DECADE), nu, _UNEVEN_TURN),
    }
    # Derivatives at the fit by terms of the times of all candidates, over the deviations.
    objective = Objective.of(found)
    base = objective.surrogate(xi)
    rho = np.unique(np.concatenate([problem.spectrum.rho, *(each.rho for each in candidates.values())]))
    solid, given = problem.material(xi), problem.nuisance_values(xi)
    scale = np.concatenate(found.corrections) / objective.deviations
    by_terms = scale[:, None] * np.vstack([each.model.by_times(solid, given, rho) for each in rebuilt(rho)])

    def columns(own: Floats) -> Floats:
        """Return the derivatives by E_relaxed and by the terms of some of the times."""
        return by_terms[:, np.append(0, 1 + np.searchsorted(rho, own))]

    at_fit = columns(problem.spectrum.rho) @ base.terms(xi)
    made, logarithms = [], []
    for name, spectrum in candidates.items():
        by_own = columns(spectrum.rho)
        at = np.append(np.clip(spectrum.coordinates_of(begin), -_BOUND, _BOUND), xi[n:])
        own = replace(problem, spectrum=spectrum)
        rest = base.rest - (by_own @ np.exp(spectrum.log_terms(at[: own.n_material])) - at_fit)
        surrogate = Surrogate(own, at, rest, by_own, base.by_values)
        lowest, cost = surrogate.lowest(_LEAST_DAMPING, _BOUND)
        covariance, size = laplace(surrogate.jacobian(lowest))
        logarithms.append(log(STRUCTURE_PRIORS[name]) - cost - 0.5 * size)
        made.append(Structure(name, spectrum, lowest, covariance, 0.0))
    weights = np.exp(np.array(logarithms) - max(logarithms))
    weights = np.where(weights < _NEGLIGIBLE * weights.sum(), 0.0, weights)
    weights /= weights.sum()
    kept = [replace(one, weight=float(w)) for one, w in zip(made, weights, strict=True) if w > 0.0]
    return tuple(sorted(kept, key=lambda one: -one.weight))

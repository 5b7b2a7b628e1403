r"""How uneven a relaxation spectrum is: inference for several degrees of unevenness, and their average.

Spectra of polymers are smooth: broad dispersions that overlap. Some have a shoulder or a narrow
peak, or end steeply. How soon a slope may turn limits the moduli between two readings and
beyond the last one, so that an answer depends on it. Each is a candidate: the smooth spectrum, and an
uneven one whose slope turns within half a decade. (A series of single terms is neither, and no
polymer has one; recorded from one, a misfit remains and is said.) Their probability after the data is
that of Laplace's approximation to the evidence,

.. math:: \ln Z = -\tfrac12 |R(\hat\xi)|^2 - \tfrac12 \ln\det(J^\top J + 1),

and a modulus is averaged over both with their posterior probabilities.

A candidate takes the derivatives of the models at one point, about which they are linear in the terms
(:mod:`._tangent`).

References
----------
J. A. Hoeting, D. Madigan, A. E. Raftery, C. T. Volinsky, Statist. Sci. 14 (1999) 382,
doi:10.1214/ss/1009212519.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from labpipe.arrays import Floats
from labpipe.identification._evidence import Evidence
from labpipe.identification._fit import BOUND, LEAST_DAMPING, Fit, Objective, fit, laplace
from labpipe.identification._posterior import Posterior, Structure, posterior
from labpipe.identification._problem import Problem
from labpipe.identification._spectra import SmoothSpectrum, relaxation_times
from labpipe.materials import Prony

Rebuilt = Callable[[Floats], tuple[Evidence, ...]]

SMOOTH, UNEVEN = "smooth", "uneven"  # as probable as each other before the data
_UNEVEN_PER_DECADE, _UNEVEN_TURN = 4, 0.5
_NEGLIGIBLE = 1e-4  # probability of a candidate that is not kept


def infer(problem: Problem, rebuilt: Rebuilt, *, progress: Callable[[str], None] | None = None) -> Posterior:
    """Identify a material, whatever the structure of its spectrum.

    The fit is that of the most probable structure, which is asked for without any discrepancy:
    a misfit of a smooth spectrum may be no fault of the model.

    ``problem``: With a smooth spectrum. ``rebuilt``: Takes relaxation times (term,) and returns the evidence for
    them. ``progress``: Called with a line of text now and then. Returns: With its structures. Raises InputError:
    There is no evidence. Raises LabpipeError: No start can be simulated.
    """
    found = fit(problem, progress=progress)
    begin = problem.material(found.xi)
    made = structures(replace(found, misfits={}), rebuilt, begin)
    best = made[0]
    if best.name != SMOOTH:
        own = Problem(best.spectrum, rebuilt(best.spectrum.rho), problem.nuisances)
        found = fit(own, start=best.xi, progress=progress)
    if best.name != SMOOTH or found.misfits:
        # a gain stretches what is predicted: how, is known only where the prediction is right
        made = structures(found, rebuilt, begin)
    return replace(posterior(found), structures=made)


def structures(found: Fit, rebuilt: Rebuilt, begin: Prony) -> tuple[Structure, ...]:
    """Weigh the candidates for the structure of a spectrum.

    ``found``: its misfits count for all candidates; ``rebuilt``: takes relaxation times (term,) and returns the
    evidence for them; ``begin``: a smooth series, from which the candidates begin. Returns the most
    probable one first; those that do not matter are left out.
    """
    problem, n = found.problem, found.problem.n_material
    data, nu = problem.window, problem.spectrum.nu
    candidates = {
        SMOOTH: SmoothSpectrum(relaxation_times(*data), nu),
        UNEVEN: SmoothSpectrum(relaxation_times(*data, per_decade=_UNEVEN_PER_DECADE), nu, _UNEVEN_TURN),
    }
    made, logarithms = [], []
    for name, spectrum in candidates.items():
        own = Problem(spectrum, rebuilt(spectrum.rho), problem.nuisances)
        at = np.append(np.clip(spectrum.coordinates_of(begin), -BOUND, BOUND), found.xi[n:])
        surrogate = Objective(own, found.corrections, found.misfits).surrogate(at)
        lowest, cost = surrogate.lowest(LEAST_DAMPING, BOUND)
        covariance, size = laplace(surrogate.jacobian(lowest))
        logarithms.append(-cost - 0.5 * size)
        made.append(Structure(name, spectrum, lowest, covariance, 0.0))
    weights = np.exp(np.array(logarithms) - max(logarithms))
    weights = np.where(weights < _NEGLIGIBLE * weights.sum(), 0.0, weights)
    weights /= weights.sum()
    kept = [replace(one, weight=float(w)) for one, w in zip(made, weights, strict=True) if w > 0.0]
    return tuple(sorted(kept, key=lambda one: -one.weight))

r"""Inference over a smooth and an uneven relaxation spectrum (:mod:`._spectra`), and their average.

The distance over which a slope may turn limits the moduli between two readings and beyond the last one, so that an
answer depends on it. A series of single terms is neither, and no polymer has one; recorded from one, a misfit remains.
The probability of either after the data is that of Laplace's approximation to the evidence,

.. math:: \ln Z = -\tfrac12 |R(\hat\xi)|^2 - \tfrac12 \ln\det(J^\top J + 1),

by the derivatives of the models at one point (:mod:`._tangent`); a modulus is averaged over both.

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
from labpipe.identification._fit import BOUND, Fit, Objective, fit, laplace
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
    made = []
    for name, spectrum in candidates.items():
        own = Problem(spectrum, rebuilt(spectrum.rho), problem.nuisances)
        at = np.append(np.clip(spectrum.coordinates_of(begin), -BOUND, BOUND), found.xi[n:])
        surrogate = Objective(own, found.corrections, found.misfits).surrogate(at)
        lowest, cost = surrogate.lowest(0.0, BOUND)
        covariance, size = laplace(surrogate.jacobian(lowest))
        made.append(Structure(name, spectrum, lowest, covariance, -cost - 0.5 * size))
    made.sort(key=lambda one: -one.weight)
    weights = np.exp([one.weight - made[0].weight for one in made])
    weights[weights < _NEGLIGIBLE * weights.sum()] = 0.0
    shares = (weights / weights.sum()).tolist()
    return tuple(replace(one, weight=share) for one, share in zip(made, shares, strict=True) if share > 0.0)

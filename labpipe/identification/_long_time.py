r"""The long-time modulus: what a record of finite length says of it.

A modulus only falls, so what is left at the end of a record bounds the long-time modulus from above, whatever
the spectrum is. From below nothing does: something may always begin to relax later. A number may
be stated only where the record shows a plateau, that is where going on to fall as in its last decade
of time,

.. math:: E(t_{end}) - \lg\frac{30\,a}{t_{end}}\,\bigl[E(t_{end}/10) - E(t_{end})\bigr],

would take next to nothing. A power-law tail, whose decades differ little from each other, shows
none, however long and however precisely it is recorded. Both quantities are averaged over the structures that
a spectrum may have (:mod:`.structure`).
"""

from dataclasses import dataclass
from math import exp, log, log10, sqrt
from typing import Literal

import numpy as np
from scipy.special import ndtri

from labpipe.arrays import Floats
from labpipe.identification._posterior import Posterior, Structure
from labpipe.identification._spectra import HORIZON
from labpipe.uncertainty import propagated_u

Verdict = Literal["identified", "bounded from above", "not identifiable"]

PLATEAU = 0.05
"""Share of the modulus that may still relax within thirty years, falling as at the end of the record:
more would make the number rest on the extrapolation."""

_LEVEL = 0.95
"""Of the interval."""

_KNOWN = log(2.0)
"""Half the width of the logarithm's interval within which the modulus at the end is known at all."""


@dataclass(frozen=True, slots=True)
class LongTimeModulus:
    """Limits of the long-time modulus, and what they rest on; stored as they are.

    ``end`` [s]: The longest time of which the data tell. ``modulus`` [Pa]: Relaxation modulus at that time.
    ``u_ln_modulus``: Standard deviation of its logarithm. ``fall``, ``most_fall``: Share of the modulus that the
    decade of time before ``end`` took, and the upper end of its interval. ``low``, ``high`` [Pa]: Ends of the
    interval; ``low`` is 0 where there is no plateau. ``left`` [Pa]: The least that is left after thirty years if
    every further decade takes as many pascals.
    """

    end: float
    modulus: float
    u_ln_modulus: float
    fall: float
    most_fall: float
    low: float
    high: float
    left: float
    verdict: Verdict


def long_time_modulus(known: Posterior) -> LongTimeModulus:
    """Tell what is known of the long-time modulus, with an interval of 95 %."""
    end = max(each.model.window[1] for each in known.fit.problem.evidence)
    reach = float(ndtri(0.5 + 0.5 * _LEVEL))
    (modulus, u), (fall, u_fall) = _at_the_end(known, end)
    high, taken = modulus * exp(reach * u), fall * exp(reach * u_fall) / modulus
    fell, most = fall / (modulus + fall), taken / (1.0 + taken)
    decades = max(log10(HORIZON / end), 0.0)
    left = max(modulus * (exp(-reach * u) - decades * taken), 0.0)
    if reach * u > _KNOWN:
        return LongTimeModulus(end, modulus, u, fell, most, 0.0, float("inf"), 0.0, "not identifiable")
    is_flat = decades * taken <= PLATEAU
    verdict: Verdict = "identified" if is_flat else "bounded from above"
    return LongTimeModulus(end, modulus, u, fell, most, left if is_flat else 0.0, high, left, verdict)


def _at_the_end(known: Posterior, end: float) -> list[tuple[float, float]]:
    """Return modulus and its fall [Pa], each with the deviation of its logarithm, over all structures."""
    fit = known.fit
    own = Structure("", fit.problem.spectrum, fit.xi, known.covariance, 1.0)
    structures = known.structures or (own,)
    weights = np.array([one.weight for one in structures])
    told = np.array([_told(one, end) for one in structures])
    made = []
    for values, each in zip(told[:, 0].T, told[:, 1].T, strict=True):
        mean = float(weights @ values)
        made.append((exp(mean), sqrt(float(weights @ (each**2 + (values - mean) ** 2)))))
    return made


def _told(one: Structure, end: float) -> tuple[Floats, Floats]:
    """Return the logarithms of modulus and fall by one structure, and their deviations."""
    n = len(one.spectrum.parameters)
    terms = np.exp(one.spectrum.log_terms(one.xi[:n]))
    slopes = terms[:, None] * one.spectrum.slopes(one.xi[:n])
    left = np.append(1.0, np.exp(-end / one.spectrum.rho))
    before = np.append(1.0, np.exp(-0.1 * end / one.spectrum.rho))
    bases = np.array([left, before - left])
    values = bases @ terms
    by_xi = np.zeros((2, one.xi.size))
    by_xi[:, :n] = bases @ slopes / values[:, None]
    return np.log(values), propagated_u(by_xi, one.covariance)

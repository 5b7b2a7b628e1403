r"""The long-time modulus, as far as a record of finite length determines it.

A modulus only falls, so its value at the end of a record bounds the long-time modulus from above, whatever
the spectrum is. From below nothing does: something may always begin to relax later. A number may
be stated only where the record shows a plateau, that is where going on to fall as in its last decade
of time,

.. math:: E(t_{end}) - \lg\frac{30\,a}{t_{end}}\,\bigl[E(t_{end}/10) - E(t_{end})\bigr],

would take next to nothing. A power-law tail, whose decades differ little from each other, shows
none, however long and however precisely it is recorded. Both quantities are averaged over the structures that
a spectrum may have (:mod:`._model_averaging`).
"""

from dataclasses import dataclass
from math import exp, log, log10
from typing import Literal

import numpy as np
from scipy.special import ndtri

from labpipe.arrays import Floats
from labpipe.identification._posterior import Posterior
from labpipe.identification._spectra import HORIZON, SmoothSpectrum

Verdict = Literal["identified", "bounded from above", "not identifiable"]

PLATEAU = 0.05
"""Share of the modulus that may still relax within thirty years, falling as at the end of the record:
more would make the number rest on the extrapolation."""

_LEVEL = 0.95  # of the interval
_KNOWN = log(2.0)
"""Half the width of the logarithm's interval within which the modulus at the end is known at all."""


@dataclass(frozen=True, slots=True)
class LongTimeModulus:
    """Limits of the long-time modulus, and their grounds; stored as they are.

    ``end`` [s]: The longest time that the data cover. ``modulus`` [Pa]: Relaxation modulus at that time.
    ``u_ln_modulus``: Standard deviation of its logarithm. ``fall``, ``most_fall``: Share of the modulus that the
    decade of time before ``end`` took, and the upper end of its interval. ``low``, ``high`` [Pa]: Ends of the
    interval; ``low`` is 0 where there is no plateau.
    """

    end: float
    modulus: float
    u_ln_modulus: float
    fall: float
    most_fall: float
    low: float
    high: float
    verdict: Verdict


def long_time_modulus(known: Posterior) -> LongTimeModulus:
    """Return the limits of the long-time modulus, with an interval of 95 %."""
    end = known.fit.problem.window[1]

    def at_the_end(spectrum: SmoothSpectrum, xi: Floats) -> tuple[Floats, Floats]:
        """Return the logarithms of modulus and fall, with their derivatives."""
        terms, slopes = spectrum.terms(xi)
        left = np.append(1.0, np.exp(-end / spectrum.rho))
        bases = np.array([left, np.append(1.0, np.exp(-0.1 * end / spectrum.rho)) - left])
        values, by_xi = bases @ terms, np.zeros((2, xi.size))
        by_xi[:, : slopes.shape[1]] = bases @ slopes / values[:, None]
        return np.log(values), by_xi

    logarithms, deviations = known.averaged(at_the_end)
    (modulus, fall), (u, u_fall) = np.exp(logarithms).tolist(), deviations.tolist()
    reach = float(ndtri(0.5 + 0.5 * _LEVEL))
    high, taken = modulus * exp(reach * u), fall * exp(reach * u_fall) / modulus
    fell, most = fall / (modulus + fall), taken / (1.0 + taken)
    decades = max(log10(HORIZON / end), 0.0)
    left = max(modulus * (exp(-reach * u) - decades * taken), 0.0)
    if reach * u > _KNOWN:
        return LongTimeModulus(end, modulus, u, fell, most, 0.0, float("inf"), "not identifiable")
    is_flat = decades * taken <= PLATEAU
    verdict: Verdict = "identified" if is_flat else "bounded from above"
    return LongTimeModulus(end, modulus, u, fell, most, left if is_flat else 0.0, high, verdict)

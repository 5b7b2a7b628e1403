"""Profile likelihood of one unknown, with the others optimised, and its limits.

The others follow under their prior, without which a spectrum could be anything, but what the prior
of the spectrum objects does not count: where it alone resists, nothing has been observed. What is
known of the experiments, such as a gain, has been observed. Where minus the logarithm of the
likelihood does not rise by 1.92 (half the 95 % quantile of chi square with one degree of freedom)
within three standard deviations of the prior, the data set no limit on that side. The models are
followed by their tangent (:mod:`.tangent`), which is straight in the moduli: no run of a simulator
is needed.

References
----------
A. Raue et al., Bioinformatics 25 (2009) 1923, doi:10.1093/bioinformatics/btp358.
"""

from dataclasses import dataclass
from math import inf, isfinite
from typing import Literal

import numpy as np
from scipy.stats import chi2, norm

from labpipe.arrays import Floats
from labpipe.identification._fit import Objective
from labpipe.identification._posterior import Posterior
from labpipe.identification._tangent import Surrogate

Verdict = Literal["identified", "only an upper limit", "only a lower limit", "not identifiable"]

_EDGE = 3.0  # standard coordinates: the prior holds nothing farther out
_PACE = 0.02  # standard coordinates: others that must give way at once would fall to nothing
_LONGEST_STRIDE = 0.05  # of a logarithm
_SHORTEST = 1e-2  # of a stride
_OVER = 1.3  # of the limit: a side ends where the rise is clearly beyond
_LEAST_DAMPING = 1e-9
_ENDS = 1.0 / 9.0
"""Weight of the spectrum's prior on the way up: a spectrum may end at once, which a walk over the
decades believes too little, so an upper limit holds for a prior three times as wide."""
_BOUND = 12.0  # standard coordinates of the others: what only the prior resists may go far


@dataclass(frozen=True, eq=False)
class Profile:
    """What the data object along one unknown, the others at their most probable values.

    Attributes
    ----------
    name : str
    values : array (place,)
        Of the unknown, in its unit, ascending.
    rise : array (place,)
        Of minus the logarithm of the likelihood, above its least value.
    low, high : float
        Ends of the interval, the wider one of profile and normal approximation; 0 or minus
        infinity, and infinity, where the data set no limit.
    verdict : str
    """

    name: str
    values: Floats
    rise: Floats
    low: float
    high: float
    verdict: Verdict


def profile(known: Posterior, number: int, level: float = 0.95) -> Profile:
    """Follow one unknown to both sides until the data object.

    Parameters
    ----------
    known : Posterior
        Around the most probable answer.
    number : int
        Of the unknown.
    level : float
        Of the interval.

    Returns
    -------
    Profile
    """
    limit = 0.5 * float(chi2.ppf(level, 1))
    found = known.fit
    surrogate = Objective.of(found).surrogate(found.xi)
    parameter = found.problem.parameters[number]
    start = _objection(surrogate, found.xi)
    sides = [_side(surrogate, known, number, sign, limit) for sign in (-1.0, 1.0)]
    places = [(float(found.xi[number]), start)] + sides[0] + sides[1]
    places.sort()
    at, height = np.array(places).T
    rise = height - height.min()
    low, high = _crossings(at, rise, limit)
    verdict = _verdict(low, high)
    # the others' prior pulls a profile to one side, Laplace's normal forgets that it is skew
    reach = float(norm.ppf(0.5 + 0.5 * level)) * float(known.sd[number])
    low = min(low, float(found.xi[number]) - reach) if isfinite(low) else low
    high = max(high, float(found.xi[number]) + reach) if verdict == "identified" else high
    return Profile(
        parameter.name,
        np.array([parameter.value(x) for x in at.tolist()]),
        rise,
        parameter.value(low) if isfinite(low) else (0.0 if parameter.is_log else -inf),
        parameter.value(high) if isfinite(high) else inf,
        verdict,
    )


def _side(surrogate: Surrogate, known: Posterior, number: int, sign: float, limit: float) -> list[tuple[float, float]]:
    """Walk to one side until there is objection enough; returns places and heights."""
    longest = _LONGEST_STRIDE / known.fit.problem.parameters[number].sd
    stride = min(0.5 * float(known.sd[number]), longest, _PACE)
    xi, found = known.fit.xi, []
    start = height = _objection(surrogate, xi)
    least, belief = stride * _SHORTEST, _ENDS if sign > 0.0 else 1.0
    while abs(xi[number]) < _EDGE and height < start + _OVER * limit:
        trial = xi.copy()
        trial[number] += sign * stride
        trial, _ = surrogate.lowest(_LEAST_DAMPING, number, _BOUND, trial, belief)
        new = _objection(surrogate, trial)
        if new > height + limit and stride > least:
            stride *= 0.5  # the others did not follow, or a wall begins
            continue
        xi, height = trial, new
        found.append((float(xi[number]), height))
    return found


def _objection(surrogate: Surrogate, xi: Floats) -> float:
    """Half the sum of squares of the data, and of what is known of the experiments."""
    rest, _ = surrogate.rows(xi)
    own = xi[surrogate.problem.n_material :]
    return 0.5 * float(rest @ rest + own @ own)


def _crossings(at: Floats, rise: Floats, limit: float) -> tuple[float, float]:
    """Places left and right of the minimum where the rise passes the limit; infinite if nowhere."""
    least = int(np.argmin(rise))
    ends = []
    for side, none in ((range(least, 0, -1), -inf), (range(least, len(at) - 1), inf)):
        step = -1 if none < 0 else 1
        place = none
        for i in side:
            if rise[i + step] > limit:
                # the rise is about quadratic: interpolate its root
                share = (np.sqrt(limit) - np.sqrt(rise[i])) / (np.sqrt(rise[i + step]) - np.sqrt(rise[i]))
                place = float(at[i] + share * (at[i + step] - at[i]))
                break
        ends.append(place)
    return ends[0], ends[1]


def _verdict(low: float, high: float) -> Verdict:
    if isfinite(low) and isfinite(high):
        return "identified"
    if isfinite(high):
        return "only an upper limit"
    if isfinite(low):
        return "only a lower limit"
    return "not identifiable"

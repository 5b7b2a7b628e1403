"""Profile likelihood: how far an unknown may go while the others follow, and what that means.

The others follow under their prior, without which a spectrum could be anything, but only what the
data object counts: where the prior alone resists, nothing has been observed. Where minus the
logarithm of the likelihood does not rise by 1.92 (half the 95 % quantile of chi square with one
degree of freedom) within three standard deviations of the prior, or has become flat, the data set
no limit on that side.

References
----------
A. Raue et al., Bioinformatics 25 (2009) 1923, doi:10.1093/bioinformatics/btp358.
"""

from dataclasses import dataclass
from math import inf, isfinite
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from labpipe.identification.fit import Objective
from labpipe.identification.posterior import Posterior

Array = NDArray[np.float64]
Verdict = Literal["identified", "only an upper limit", "only a lower limit", "not identifiable"]

_EDGE = 3.0  # standard coordinates: the prior holds nothing farther out
_WORTH_A_STEP = 0.05  # of the objective: less is not worth another step of the others
_LONGEST_STRIDE = 0.35  # of a logarithm
_FAR_OVER = 3.0  # of the limit: the stride was too long
_OVER = 1.3  # of the limit: a side ends where the rise is clearly beyond
_FLAT, _NO_RISE = 2, 0.05  # so many places without a rise: there will be none
_FLAT_FROM = 0.25  # standard coordinates: half a decade of the long-time modulus
_GROWTH = 2.0  # from place to place
_MOST_PLACES = 14  # on one side


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
    values: Array
    rise: Array
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
    objective = Objective.of(found)
    parameter = found.problem.parameters[number]
    start = _objection(objective, found.xi)
    sides = [_side(objective, known, number, sign, start, limit) for sign in (-1.0, 1.0)]
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


def _side(
    objective: Objective, known: Posterior, number: int, sign: float, start: float, limit: float
) -> list[tuple[float, float]]:
    """Walk to one side with growing strides; returns places and heights."""
    parameter = known.fit.problem.parameters[number]
    stride = min(float(known.sd[number]), _LONGEST_STRIDE / parameter.sd)
    xi, wall, found = known.fit.xi.copy(), sign * np.inf, []
    total: list[tuple[float, float]] = []
    for _ in range(_MOST_PLACES):
        target = float(np.clip(xi[number] + sign * stride, -_EDGE, _EDGE))
        if target == xi[number]:
            break
        reached = objective.followed(xi, number, target, _WORTH_A_STEP)
        height = _objection(objective, reached)
        found.append((target, height))
        total.append((target, height + 0.5 * _others(reached, number)))
        if height - start > _FAR_OVER * limit:
            wall = target  # too far to tell where it crossed
            stride = abs(wall - xi[number]) / _GROWTH**2
            continue
        xi = reached
        is_flat = len(found) > _FLAT and _is_flat(*total[-1 - _FLAT], *total[-1])
        if height - start > _OVER * limit or abs(target) >= _EDGE or is_flat:
            break
        stride = min(stride * _GROWTH, abs(wall - xi[number]) / _GROWTH)
    return found


def _is_flat(before: float, low: float, at: float, height: float) -> bool:
    """Tell whether data and the others' prior do not object more; near places never do."""
    return abs(at - before) > _FLAT_FROM and abs(height - low) < _NO_RISE


def _objection(objective: Objective, xi: Array) -> float:
    """Half the sum of squares of the data alone."""
    return objective.cost(xi) - 0.5 * float(xi @ xi)


def _others(xi: Array, number: int) -> float:
    """Return the squared coordinates of all other unknowns."""
    return float(xi @ xi) - float(xi[number]) ** 2


def _crossings(at: Array, rise: Array, limit: float) -> tuple[float, float]:
    """Places left and right of the minimum where the rise passes the limit; infinite if nowhere."""
    least = int(np.argmin(rise))
    ends = []
    for side, none in ((range(least, 0, -1), -inf), (range(least, len(at) - 1), inf)):
        step = -1 if none < 0 else 1
        place = none
        for i in side:
            if rise[i + step] > limit:
                # the rise is about quadratic: interpolate its root
                share = (np.sqrt(limit) - np.sqrt(rise[i])) / (
                    np.sqrt(rise[i + step]) - np.sqrt(rise[i])
                )
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

"""The compiled loops of the smoothing spline: moments of the samples, the penalised fit, polynomials.

In each interval between knots the B-splines are polynomials of the distance from its middle. Samples enter by their
moments there; all else is one band of the normal matrix. The variance of a spline needs only the inverse inside the
band, which follows from the factor, last row first (Erisman & Tinney, Comm. ACM 18 (1975) 177,
doi:10.1145/360680.360704). Importing this imports numba.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean

DEGREE = 5
_FAST = {"reassoc", "contract", "nsz"}
_POOL = 6  # intervals on either side that share their estimate of the penalty
_SHARED = 2.0  # weight, in effective parameters, of all intervals of the same length
_UPDATES, _SETTLED = 10, 0.2  # updates of the penalty at most, and the change of its logarithm that ends them
Indices = NDArray[np.int64]


@lean()
def solved(band: Floats, x: Floats, inverse: Floats) -> None:
    """Factorise a matrix of n rows, solve for the right-hand side, and find the inverse inside the band.

    ``band[j, d] = A[j + d, j]``, of shape (n + DEGREE, DEGREE + 1) with 0 beyond the end of a diagonal, becomes the
    factors ``L D L'``, of D the inverse; ``x`` (n + DEGREE,) becomes the solution, NaN of a matrix that is not positive
    definite; ``inverse`` is filled like the band.
    """
    n = len(band) - DEGREE
    for j in range(n):
        pivot = 1.0 / band[j, 0] if band[j, 0] > 0.0 else math.nan
        for d in range(1, DEGREE + 1):
            for e in range(d, DEGREE + 1):
                band[j + d, e - d] -= band[j, d] * pivot * band[j, e]
        for d in range(1, DEGREE + 1):
            band[j, d] *= pivot
            x[j + d] -= band[j, d] * x[j]
        band[j, 0] = pivot
    x[n:], inverse[n:] = 0.0, 0.0
    for j in range(n - 1, -1, -1):
        x[j] *= band[j, 0]
        inverse[j, 0] = band[j, 0]
        for i in range(1, DEGREE + 1):
            x[j] -= band[j, i] * x[j + i]
            inverse[j, i] = 0.0
            for k in range(1, DEGREE + 1):
                inverse[j, i] -= band[j, k] * inverse[j + min(i, k), abs(i - k)]
            inverse[j, 0] -= band[j, i] * inverse[j, i]


@lean(fastmath=_FAST)
def expanded(knots: Floats, first: Indices, length: Floats) -> Floats:
    """Return the B-splines of intervals between ``knots`` (m + 6,): Cox and de Boor on polynomials.

    ``first`` (interval,) is the first coefficient that counts in one; the result (interval, 6, 6) holds, by power of
    the distance from its middle over its length, the factors of the six coefficients.
    """
    basis = np.zeros((length.size, DEGREE + 1, DEGREE + 1))
    for s in range(length.size):
        k, b = first[s] + DEGREE, basis[s]
        middle, b[0, 0] = knots[k] + 0.5 * length[s], 1.0
        for p in range(1, DEGREE + 1):
            for i in range(p - 1, -1, -1):
                left, right = knots[k + 1 + i - p], knots[k + 1 + i]
                falls, rises, slope = right - middle, middle - left, length[s]
                for q in range(p, -1, -1):
                    below = slope * b[q - 1, i] if q else 0.0
                    b[q, i + 1] += (rises * b[q, i] + below) / (right - left)
                    b[q, i] = (falls * b[q, i] - below) / (right - left)
    return basis


@lean(fastmath=_FAST)
def moments(place: Floats, z: Floats, ends: Indices) -> tuple[Floats, Floats]:
    """Return sums of the powers 0 to 10 of places (n,), and of samples ``z`` times powers 0 to 5, by intervals.

    ``ends`` (interval + 1,) are the first samples of each.
    """
    powers, products = np.zeros((ends.size - 1, 2 * DEGREE + 1)), np.zeros((ends.size - 1, DEGREE + 1))
    for s in range(ends.size - 1):
        u, y = place[ends[s] : ends[s + 1]], z[ends[s] : ends[s + 1]]
        for n in range(u.size):
            power = 1.0
            for k in range(2 * DEGREE + 1):
                powers[s, k] += power
                if k <= DEGREE:
                    products[s, k] += power * y[n]
                power *= u[n]
    return powers, products


@lean(fastmath=_FAST)
def followed(coefficients: Floats, place: Floats, ends: Indices) -> Floats:
    """Return the values (n,) of polynomials (interval, power) at places (n,)."""
    value, last = np.empty(place.size), coefficients.shape[1] - 1
    for s in range(ends.size - 1):
        u, found = place[ends[s] : ends[s + 1]], value[ends[s] : ends[s + 1]]
        found[:] = coefficients[s, last]
        for q in range(last - 1, -1, -1):
            for n in range(found.size):
                found[n] = found[n] * u[n] + coefficients[s, q]
    return value


@lean(fastmath=_FAST)
def penalised(
    normal: Floats, right: Floats, rough: Floats, power: Floats, octave: Indices, first: Indices
) -> tuple[Floats, Floats, int]:
    """Fit a spline whose roughness costs as much as the samples say (Fellner and Schall's update).

    ``normal``, ``rough`` (interval, 6, 6): parts of samples and of a unit penalty in the normal matrix; ``right``
    (m + 5,); ``power`` (interval,): lengths to the power in which a penalty grows; ``octave``: rounded logarithm of the
    lengths. Returned are the coefficients (m + 5,), the band (m + 5, 6) of their covariance, and the number of solves.
    """
    penalty, used, energy = 10.0 * power, np.empty(power.size), np.empty(power.size)
    band = np.empty((right.size, DEGREE + 1))
    inverse, n_solves, has_settled = np.empty(band.shape), 0, False
    while True:
        n_solves += 1
        coefficients = right.copy()
        band[:] = 0.0
        for s in range(power.size):
            for i in range(DEGREE + 1):
                for j in range(DEGREE + 1 - i):
                    band[first[s] + i, j] += normal[s, i, i + j] + penalty[s] * rough[s, i, i + j]
        solved(band, coefficients, inverse)
        if has_settled or n_solves > _UPDATES:
            return coefficients, inverse, n_solves
        for s in range(power.size):
            spread = size = 0.0
            for i in range(DEGREE + 1):
                at = first[s] + i
                for j in range(DEGREE + 1 - i):
                    twice = rough[s, i, i + j] * (2.0 if j else 1.0)
                    spread += twice * inverse[at, j]
                    size += twice * coefficients[at] * coefficients[at + j]
            used[s], energy[s] = max(1.0 - penalty[s] * spread, 1e-4), max(size, 0.0)
        has_settled = _updated(penalty, used, energy, power, octave)


@inner(fastmath=_FAST)
def _updated(penalty: Floats, used: Floats, energy: Floats, power: Floats, octave: Indices) -> bool:
    """Set penalties to parameters used per roughness; return True where they hardly changed.

    Both are pooled over neighbours (a triangular window) and over all intervals of equal length.
    """
    alike, has_settled = np.bincount(octave, energy) / np.bincount(octave, used), True
    for s in range(penalty.size):
        local_used, local_energy = _SHARED, _SHARED * alike[octave[s]]
        for o in range(max(s - _POOL, 0), min(s + _POOL + 1, penalty.size)):
            weight = 1.0 - abs(o - s) / (_POOL + 1.0)
            local_used += weight * used[o]
            local_energy += weight * energy[o]
        wanted = local_used / max(local_energy, 1e-250)
        wanted = min(max(wanted, penalty[s] / 100.0), penalty[s] * 100.0)
        # beyond, the penalty is off, or the spline rigid
        wanted = min(max(wanted, 1e-8 * power[s]), 1e8 * power[s])
        has_settled = has_settled and abs(math.log(wanted / penalty[s])) < _SETTLED
        penalty[s] = wanted
    return has_settled

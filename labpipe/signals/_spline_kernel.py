"""The compiled loops of the smoothing spline: bases, moments of the samples, the penalised fit, polynomials.

In each interval between knots the B-splines are polynomials of the distance from its middle. Samples enter by their
moments there, and all else works on one band of the normal matrix, in time linear in the coefficients: the variance of
a spline needs only those entries of the inverse inside the band, which follow from the factor from the last row to the
first (Takahashi, Fagan & Chin, Proc. 8th PICA Conf. (1973) 63; see Erisman & Tinney, Comm. ACM 18 (1975) 177,
doi:10.1145/360680.360704). Importing this imports numba.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean

DEGREE = 5
LEAF = 4
"""Samples over which the distance of knots is the same."""
_WIDTH = DEGREE + 1
_FAST = {"reassoc", "contract", "nsz"}
_POOL = 6  # intervals on either side that share their estimate of the penalty
_SHARED = 2.0  # weight, in effective parameters, of all intervals of the same length
_UPDATES, _SETTLED = 10, 0.2  # updates of the penalty at most, and the change of its logarithm that ends them
Indices = NDArray[np.int64]


@lean()
def factored(band: Floats, n: int) -> bool:
    """Replace the lower band of a matrix by its factors ``L D L'``; False if that fails.

    ``band[j, d] = A[j + d, j]``, of shape (n + DEGREE, DEGREE + 1); entries beyond the end of a
    diagonal, in its last rows too, is set to 0. ``D`` is kept as its inverse.
    """
    for j in range(n + DEGREE):
        for d in range(max(n - j, 0), DEGREE + 1):
            if j + d >= n:
                band[j, d] = 0.0
    for j in range(n):
        if not band[j, 0] > 0.0:
            return False
        inverse = 1.0 / band[j, 0]
        band[j, 0] = inverse
        for d in range(1, DEGREE + 1):
            share = band[j, d] * inverse
            for e in range(d, DEGREE + 1):
                band[j + d, e - d] -= share * band[j, e]
        for d in range(1, DEGREE + 1):
            band[j, d] *= inverse
    return True


@lean()
def solve(factor: Floats, x: Floats, n: int) -> None:
    """Replace the right-hand side ``x`` (n + DEGREE,) by the solution, with :func:`factored`."""
    for j in range(n, n + DEGREE):
        x[j] = 0.0
    for j in range(n):
        for d in range(1, DEGREE + 1):
            x[j + d] -= factor[j, d] * x[j]
    for j in range(n - 1, -1, -1):
        total = x[j] * factor[j, 0]
        for d in range(1, DEGREE + 1):
            total -= factor[j, d] * x[j + d]
        x[j] = total


@lean()
def inverse_of_factor(factor: Floats, inverse: Floats, n: int) -> None:
    """Fill in the entries (n + DEGREE, DEGREE + 1) of ``A^-1`` inside the band; the others 0."""
    for j in range(n, n + DEGREE):
        for d in range(DEGREE + 1):
            inverse[j, d] = 0.0
    for j in range(n - 1, -1, -1):
        on = factor[j, 0]
        for i in range(1, DEGREE + 1):
            total = 0.0
            for k in range(1, DEGREE + 1):
                total -= factor[j, k] * inverse[j + min(i, k), abs(i - k)]
            inverse[j, i] = total
            on -= factor[j, i] * total
        inverse[j, 0] = on


@lean()
def curved(total: Floats, limit: float, closest: float, distance: Floats) -> None:
    """Lower the distances (leaf,) of knots where a record bends; ``total`` (n + 1,): sums of its samples up to each.

    Means over L samples have fourth differences beyond ``limit``, over sqrt(L), which no white noise exceeds
    (sqrt(2 log n) deviations), where L is the scale of the curve: five such means then hold eight knots.
    """
    n, size = total.size - 1, 4
    while 10 * size <= n:
        size *= 2
    while size >= 2.0 * closest:
        reach, end = limit * math.sqrt(size), 0
        for i in range(0, n - 5 * size + 1, size // 2):
            bend = total[i + 5 * size] - total[i] - 5.0 * (total[i + 4 * size] - total[i + size])
            bend += 10.0 * (total[i + 3 * size] - total[i + 2 * size])
            if abs(bend) > reach:
                for leaf in range(max(end, i // LEAF), (i + 5 * size - 1) // LEAF + 1):
                    distance[leaf] = 0.625 * size
                end = (i + 5 * size - 1) // LEAF + 1
        size //= 2


@lean(fastmath=_FAST)
def expand(knots: Floats, first: Indices, length: Floats, basis: Floats) -> None:
    """Fill in the B-splines of intervals between ``knots`` (m + 6,): Cox and de Boor on polynomials.

    ``first`` (interval,) is the first coefficient that counts in one; ``basis`` (interval, 6, 6) holds, by power of the
    distance from its middle over its length, the factors of the six coefficients.
    """
    for s in range(length.size):
        k, b = first[s] + DEGREE, basis[s]
        middle = knots[k] + 0.5 * length[s]
        b[0, 0] = 1.0
        for p in range(1, _WIDTH):
            for i in range(p - 1, -1, -1):
                left = k + 1 + i - p
                over = 1.0 / (knots[left + p] - knots[left])
                falls, rises = (knots[left + p] - middle) * over, (middle - knots[left]) * over
                slope = length[s] * over
                for q in range(p, -1, -1):
                    below = slope * b[q - 1, i] if q else 0.0
                    b[q, i + 1] += rises * b[q, i] + below
                    b[q, i] = falls * b[q, i] - below


@lean(fastmath=_FAST)
def moments(place: Floats, z: Floats, ends: Indices, powers: Floats, products: Floats) -> None:
    """Add up powers 0 to 10 of places (n,), and samples ``z`` times powers 0 to 5, by intervals.

    ``ends`` (interval + 1,) are the first samples of each. ``powers`` (interval, 11), ``products`` (interval, 6).
    """
    for s in range(ends.size - 1):
        u, y = place[ends[s] : ends[s + 1]], z[ends[s] : ends[s + 1]]
        for n in range(u.size):
            power = 1.0
            for k in range(_WIDTH):
                powers[s, k] += power
                products[s, k] += power * y[n]
                power *= u[n]
            for k in range(_WIDTH, 2 * DEGREE + 1):
                powers[s, k] += power
                power *= u[n]


@lean(fastmath=_FAST)
def followed(coefficients: Floats, place: Floats, ends: Indices, value: Floats) -> None:
    """Fill in the values (n,) of polynomials (interval, power) at places (n,)."""
    last = coefficients.shape[1] - 1
    for s in range(ends.size - 1):
        u, found = place[ends[s] : ends[s + 1]], value[ends[s] : ends[s + 1]]
        for n in range(found.size):
            found[n] = coefficients[s, last]
        for q in range(last - 1, -1, -1):
            factor = coefficients[s, q]
            for n in range(found.size):
                found[n] = found[n] * u[n] + factor


@lean(fastmath=_FAST)
def penalised(
    normal: Floats,
    right: Floats,
    rough: Floats,
    power: Floats,
    octave: Indices,
    first: Indices,
    work: Floats,
    band: Floats,
    coefficients: Floats,
    inverse: Floats,
) -> int:
    """Fit a spline whose roughness costs as much as the samples say (Fellner and Schall's update).

    ``normal``, ``rough`` (interval, 6, 6): parts of samples and of a unit penalty in the normal matrix; ``right``
    (m + 5,); ``power`` (interval,): lengths to the power in which a penalty grows; ``octave``: rounded logarithm of the
    lengths. ``work`` (5, interval) and ``band`` (m + 5, 6) are work space; ``coefficients`` (m + 5,) and ``inverse``
    (m + 5, 6), the band of their covariance, are filled. Returns the solves of the band system, 0 when a matrix was
    not positive definite.
    """
    m, count, n_solves, has_settled = right.size - DEGREE, power.size, 0, False
    penalty, used, energy = work[0], work[1], work[2]
    for s in range(count):
        penalty[s] = 10.0 * power[s]
    while True:
        n_solves += 1
        for j in range(right.size):
            coefficients[j] = right[j]
            for d in range(_WIDTH):
                band[j, d] = 0.0
        for s in range(count):
            for i in range(_WIDTH):
                for j in range(_WIDTH - i):
                    band[first[s] + i, j] += normal[s, i, i + j] + penalty[s] * rough[s, i, i + j]
        if not factored(band, m):
            return 0
        solve(band, coefficients, m)
        inverse_of_factor(band, inverse, m)
        if has_settled or n_solves > _UPDATES:
            return n_solves
        for s in range(count):
            spread = size = 0.0
            for i in range(_WIDTH):
                at = first[s] + i
                spread += rough[s, i, i] * inverse[at, 0]
                size += rough[s, i, i] * coefficients[at] ** 2
                for j in range(1, _WIDTH - i):
                    spread += 2.0 * rough[s, i, i + j] * inverse[at, j]
                    size += 2.0 * rough[s, i, i + j] * coefficients[at] * coefficients[at + j]
            used[s], energy[s] = max(1.0 - penalty[s] * spread, 1e-4), max(size, 0.0)
        has_settled = _updated(work, power, octave)


@inner(fastmath=_FAST)
def _updated(work: Floats, power: Floats, octave: Indices) -> bool:
    """Set penalties to parameters used per roughness; return True where they hardly changed.

    Both are pooled over neighbours (a triangular window) and over all intervals of equal length.
    """
    penalty, used, energy, sum_used, sum_energy = work[0], work[1], work[2], work[3], work[4]
    count, has_settled = penalty.size, True
    for s in range(count):
        sum_used[s] = sum_energy[s] = 0.0
    for s in range(count):
        sum_used[octave[s]] += used[s]
        sum_energy[octave[s]] += energy[s]
    for s in range(count):
        local_used = local_energy = 0.0
        for o in range(max(s - _POOL, 0), min(s + _POOL + 1, count)):
            weight = 1.0 - abs(o - s) / (_POOL + 1.0)
            local_used += weight * used[o]
            local_energy += weight * energy[o]
        local_energy += _SHARED * sum_energy[octave[s]] / sum_used[octave[s]]
        wanted = (local_used + _SHARED) / max(local_energy, 1e-250)
        wanted = min(max(wanted, penalty[s] / 100.0), penalty[s] * 100.0)
        # beyond, the penalty is off, or the spline rigid
        wanted = min(max(wanted, 1e-8 * power[s]), 1e8 * power[s])
        has_settled = has_settled and abs(math.log(wanted / penalty[s])) < _SETTLED
        penalty[s] = wanted
    return has_settled

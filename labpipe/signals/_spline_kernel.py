"""The compiled loops of the smoothing spline: distance of knots, normal equations, penalised fit, its derivatives.

In each interval between knots the B-splines are polynomials of the distance from its middle. Samples enter by their
moments there; all else is one band of the normal matrix. The variance of a spline needs only the inverse inside the
band, which follows from the factor, last row first (Erisman & Tinney, Comm. ACM 18 (1975) 177,
doi:10.1145/360680.360704). Importing this imports numba.
"""

import math

import numpy as np

from labpipe.arrays import Floats, Integers
from labpipe.compilation import lean

DEGREE = 5
_FAST = {"reassoc", "contract", "nsz"}
_POOL = 6  # intervals on either side that share their estimate of the penalty
_SHARED = 2.0  # weight, in effective parameters, of all intervals of the same length
_UPDATES, _SETTLED = 10, 0.2  # updates of the penalty at most, and the change of its logarithm that ends them
LEAF = 4  # samples over which the distance of knots is the same
_SLOPE = 0.1  # by which the distance of knots may grow with that from closer ones


@lean()
def distances(z: Floats) -> Floats:
    """Return the distance of knots, in samples, for every leaf of samples ``z`` (n,) with a noise of 1.

    Means over L samples have fourth differences that no white noise reaches, where L is the scale of the curve: five
    such means then hold eight knots.
    """
    n = z.size
    found, total = np.full(-(-n // LEAF), n / 10.0), np.zeros(n + 1)
    for i in range(n):
        total[i + 1] = total[i] + z[i]
    # White noise exceeds it in one record of a hundred: fourth differences of means have a variance of 70, and the
    # probability of t deviations is below exp(-t^2 / 2) in each of n differences.
    limit = math.sqrt(70.0 * 2.0 * math.log(100.0 * n))
    for octave in range(int(math.log2(n / 5.0)), 1, -1):
        size, done = 2**octave, 0
        for i in range(0, n + 1 - 5 * size, size // 2):
            a, b, c, d, e, f = total[i : i + 5 * size + 1 : size]
            if abs(f - a - 5.0 * (e - b) + 10.0 * (d - c)) > limit * math.sqrt(size):
                end = (i + 5 * size + LEAF - 1) // LEAF
                found[max(i // LEAF, done) : end] = 0.625 * size
                done = end
    # A long stretch that ends just inside a short one would otherwise bring its coarse knots there.
    for i in range(1, found.size):
        found[i] = min(found[i], found[i - 1] + _SLOPE * LEAF)
    for i in range(found.size - 2, -1, -1):
        found[i] = min(found[i], found[i + 1] + _SLOPE * LEAF)
    return found


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
def expanded(knots: Floats, first: Integers) -> Floats:
    """Return the B-splines of intervals between ``knots`` (m + 6,): Cox and de Boor on polynomials.

    ``first`` (interval,) is the first coefficient that counts in one; the result (interval, 6, 6) holds, by power of
    the distance from its middle over its length, the factors of the six coefficients.
    """
    basis = np.zeros((first.size, DEGREE + 1, DEGREE + 1))
    for s in range(first.size):
        k, b = first[s] + DEGREE, basis[s]
        middle, b[0, 0] = 0.5 * (knots[k] + knots[k + 1]), 1.0
        for p in range(1, DEGREE + 1):
            for i in range(p - 1, -1, -1):
                left, right = knots[k + 1 + i - p], knots[k + 1 + i]
                over = 1.0 / (right - left)
                falls, rises, slope = (right - middle) * over, (middle - left) * over, (knots[k + 1] - knots[k]) * over
                for q in range(p, -1, -1):
                    below = slope * b[q - 1, i] if q else 0.0
                    b[q, i + 1] += rises * b[q, i] + below
                    b[q, i] = falls * b[q, i] - below
    return basis


@lean(fastmath=_FAST)
def normal_equations(
    x: Floats, z: Floats, breaks: Floats, basis: Floats, first: Integers
) -> tuple[Floats, Floats, Floats]:
    """Return what samples and roughness contribute to the normal matrix, and the right-hand side (m + 5,).

    ``x`` (n,) increases; ``breaks`` (interval + 1,); ``basis`` and ``first`` belong to :func:`expanded`. Of the
    samples' part (interval, 6, 6) the upper triangle is filled; the roughness of an interval is the sum of the squares
    of two products (interval, 2, 6) with its coefficients, which stays precise where these are large.
    """
    normal, rough = np.empty(basis.shape), np.empty((first.size, 2, DEGREE + 1))
    right, row, stop = np.zeros(first[-1] + 2 * DEGREE + 1), np.empty(DEGREE + 1), 0
    powers, products = np.empty(2 * DEGREE + 1), np.empty(DEGREE + 1)
    for s in range(first.size):
        middle, over, begin = 0.5 * (breaks[s] + breaks[s + 1]), 1.0 / (breaks[s + 1] - breaks[s]), stop
        while stop < x.size and (x[stop] < breaks[s + 1] or s == first.size - 1):
            stop += 1
        b, scale = basis[s], over**3.5
        for k in range(DEGREE + 1):
            low = high = mixed = 0.0
            for n in range(begin, stop):
                place = (x[n] - middle) * over
                power = place**k
                low, high, mixed = low + power, high + power * place**DEGREE, mixed + power * z[n]
            powers[k], powers[k + DEGREE], products[k] = low, high, mixed
        for i in range(DEGREE + 1):
            # the fourth derivative is linear: 24 and 120 times the highest powers; place^2 is 1/12 in the mean
            rough[s, 0, i], rough[s, 1, i] = 24.0 * scale * b[4, i], 120.0 / math.sqrt(12.0) * scale * b[5, i]
            row[:] = 0.0
            for p in range(DEGREE + 1):
                right[first[s] + i] += b[p, i] * products[p]
                for q in range(DEGREE + 1):
                    row[q] += b[p, i] * powers[p + q]
            for j in range(i, DEGREE + 1):
                normal[s, i, j] = 0.0
                for q in range(DEGREE + 1):
                    normal[s, i, j] += row[q] * b[q, j]
    return normal, rough, right


@lean(fastmath=_FAST)
def followed(
    breaks: Floats, basis: Floats, first: Integers, coefficients: Floats, band: Floats, x: Floats, order: int
) -> tuple[Floats, Floats]:
    """Return a spline and its derivatives up to an order at increasing ``x`` (n,), and their u (order + 1, n).

    ``breaks``, ``basis`` and ``first`` are those of :func:`expanded`; ``band`` is that of the coefficients' covariance.
    """
    value, u, stop = np.empty((order + 1, x.size)), np.empty((order + 1, x.size)), 0
    factors, covariance, variances = np.zeros(DEGREE + 2), np.zeros((DEGREE + 2, DEGREE + 2)), np.empty(2 * DEGREE + 1)
    for s in range(first.size):
        middle, over, begin = 0.5 * (breaks[s] + breaks[s + 1]), 1.0 / (breaks[s + 1] - breaks[s]), stop
        while stop < x.size and (x[stop] < breaks[s + 1] or s == first.size - 1):
            stop += 1
        # the polynomial of the interval, with the covariance of its factors
        factors[:], covariance[:] = 0.0, 0.0
        b, c = basis[s], band[first[s] : first[s] + DEGREE + 1]
        for p in range(DEGREE + 1):
            for i in range(DEGREE + 1):
                along = 0.0
                for j in range(DEGREE + 1):
                    along += b[p, j] * c[min(i, j), abs(i - j)]
                factors[p] += b[p, i] * coefficients[first[s] + i]
                for q in range(DEGREE + 1):
                    covariance[p, q] += along * b[q, i]
        for derivative in range(order + 1):
            variances[:] = 0.0
            for p in range(DEGREE + 1):
                for q in range(DEGREE + 1):
                    variances[p + q] += covariance[p, q]
            for n in range(begin, stop):
                place = min(max((x[n] - middle) * over, -0.5), 0.5)  # the ends continue
                found, variance = factors[DEGREE], variances[2 * DEGREE]
                for k in range(DEGREE - 1, -1, -1):
                    found = found * place + factors[k]
                for k in range(2 * DEGREE - 1, -1, -1):
                    variance = variance * place + variances[k]
                value[derivative, n], u[derivative, n] = found, math.sqrt(max(variance, 0.0))
            for p in range(DEGREE + 1):
                factors[p] = (p + 1) * over * factors[p + 1]
                for q in range(DEGREE + 1):
                    covariance[p, q] = (p + 1) * (q + 1) * over**2 * covariance[p + 1, q + 1]
    return value, u


@lean(fastmath=_FAST)
def penalised(
    normal: Floats, right: Floats, rough: Floats, length: Floats, first: Integers
) -> tuple[Floats, Floats, int]:
    """Fit a spline whose roughness costs as much as the samples say (Fellner and Schall's update).

    ``normal``, ``rough`` and ``right`` are those of :func:`normal_equations`; ``length`` (interval,). Returned are the
    coefficients (m + 5,), the band (m + 5, 6) of their covariance, and the number of solves. No penalty is so large
    that the rounding of the coefficients costs as much as a sample that deviates by its noise.
    """
    power, octave = length**7, np.round(np.log2(length)).astype(np.int64)
    octave -= octave.min()
    penalty, used, energy, rigid = 10.0 * power, np.empty(power.size), np.empty(power.size), np.empty(power.size)
    band = np.empty((right.size, DEGREE + 1))
    inverse, n_solves, has_settled = np.empty(band.shape), 0, False
    while True:
        n_solves += 1
        coefficients = right.copy()
        band[:] = 0.0
        for s in range(power.size):
            for i in range(DEGREE + 1):
                bend, tilt = penalty[s] * rough[s, 0, i], penalty[s] * rough[s, 1, i]
                for j in range(DEGREE + 1 - i):
                    band[first[s] + i, j] += normal[s, i, i + j] + bend * rough[s, 0, i + j] + tilt * rough[s, 1, i + j]
        solved(band, coefficients, inverse)
        if has_settled or n_solves > _UPDATES:
            return coefficients, inverse, n_solves
        for s in range(power.size):
            spread = energy[s] = rounding = 0.0
            for part in rough[s]:
                size = most = 0.0
                for i in range(DEGREE + 1):
                    size += part[i] * coefficients[first[s] + i]
                    most += abs(part[i] * coefficients[first[s] + i])
                    for j in range(DEGREE + 1 - i):
                        spread += part[i] * part[i + j] * inverse[first[s] + i, j] * (2.0 if j else 1.0)
                energy[s] += size**2
                rounding += np.finfo(np.float64).eps * most**2
            used[s], rigid[s] = max(1.0 - penalty[s] * spread, 1e-4), min(1e8 * power[s], 1.0 / rounding)
        # Parameters used per roughness, both pooled over neighbours (a triangular window) and all of equal length.
        alike, has_settled = np.bincount(octave, energy) / np.bincount(octave, used), True
        for s in range(power.size):
            local_used, local_energy = _SHARED, _SHARED * alike[octave[s]]
            for o in range(max(s - _POOL, 0), min(s + _POOL + 1, power.size)):
                weight = 1.0 - abs(o - s) / (_POOL + 1.0)
                local_used += weight * used[o]
                local_energy += weight * energy[o]
            wanted = local_used / max(local_energy, 1e-250)
            wanted = min(max(wanted, penalty[s] / 100.0), penalty[s] * 100.0)
            # beyond, the penalty is off, or the spline rigid
            wanted = min(max(wanted, 1e-8 * power[s]), rigid[s])
            has_settled = has_settled and abs(math.log(wanted / penalty[s])) < _SETTLED
            penalty[s] = wanted

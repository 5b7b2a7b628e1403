"""The compiled loops of the smoothing spline: bases, sums over samples, variances.

In each interval between knots the B-splines are polynomials of the distance from its middle, so
that a sample costs Horner's rule and no recursion; samples are met once for each choice of knots.
The variance of a spline needs only those entries of the inverse of its normal matrix that lie inside the band, which
follow from the factor from the last row to the first (Takahashi, Fagan & Chin, Proc. 8th PICA Conf. (1973) 63; see
Erisman & Tinney, Comm. ACM 18 (1975) 177, doi:10.1145/360680.360704). Plain loops over arrays that the caller made
compile in a third of the time that numpy's functions take. Importing this imports numba.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean

DEGREE = 5
PENALTY_ORDER = 4
"""Penalising the fourth derivative suits impacts: their acceleration is smooth, only large."""

_WIDTH = DEGREE + 1
_FAST = {"reassoc", "contract", "nsz"}
Indices = NDArray[np.int64]


class Intervals(NamedTuple):
    """Intervals between knots: fields (interval,).

    ``first`` is the first coefficient that counts in one, ``low`` where it begins, ``octave`` the
    rounded binary logarithm of its ``length`` above the smallest, ``power`` its length to the
    power in which a penalty grows. ``basis`` (interval, 6, 6) holds, by power of the distance from
    the middle over the length, the factors of the six coefficients.
    """

    first: Indices
    low: Floats
    length: Floats
    power: Floats
    octave: Indices
    basis: Floats


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


@lean(fastmath=_FAST)
def expand(knots: Floats, intervals: Intervals) -> None:
    """Fill in the ``basis`` of intervals between ``knots`` (m + 6,): Cox and de Boor on polynomials."""
    for s in range(intervals.low.size):
        k, b = intervals.first[s] + DEGREE, intervals.basis[s]
        middle = intervals.low[s] + 0.5 * intervals.length[s]
        for q in range(_WIDTH):
            for i in range(_WIDTH):
                b[q, i] = 0.0
        b[0, 0] = 1.0
        for p in range(1, _WIDTH):
            for i in range(p - 1, -1, -1):
                left = k + 1 + i - p
                over = 1.0 / (knots[left + p] - knots[left])
                falls, rises = (knots[left + p] - middle) * over, (middle - knots[left]) * over
                slope = intervals.length[s] * over
                for q in range(p, -1, -1):
                    below = slope * b[q - 1, i] if q else 0.0
                    b[q, i + 1] += rises * b[q, i] + below
                    b[q, i] = falls * b[q, i] - below


@inner(fastmath=_FAST)
def _place(intervals: Intervals, x: float, s: int) -> int:
    """Interval of ``x``, beginning to look at the interval ``s``."""
    while s < intervals.low.size - 1 and x >= intervals.low[s + 1]:
        s += 1
    while s > 0 and x < intervals.low[s]:
        s -= 1
    return s


@lean(fastmath=_FAST)
def followed(intervals: Intervals, polynomials: Floats, x: Floats, value: Floats) -> None:
    """Fill in the values (n,) at ``x`` (n,) of ``polynomials`` (interval, power) about the middles."""
    s = 0
    for n in range(x.size):
        s = _place(intervals, x[n], s)
        u = (x[n] - intervals.low[s]) / intervals.length[s] - 0.5
        total = 0.0
        for q in range(polynomials.shape[1] - 1, -1, -1):
            total = total * u + polynomials[s, q]
        value[n] = total


@lean(fastmath=_FAST)
def variances(intervals: Intervals, basis: Floats, inverse: Floats, x: Floats, row: Floats, variance: Floats) -> None:
    """Fill in the variance (n,) of a derivative of the spline at ``x`` (n,).

    ``basis`` (interval, power, 6) is that of the derivative, ``inverse`` (m, 6) the band of the
    coefficients' covariance, ``row`` (6,) work space.
    """
    s = 0
    for n in range(x.size):
        s = _place(intervals, x[n], s)
        _row(basis, s, (x[n] - intervals.low[s]) / intervals.length[s] - 0.5, row)
        first, total = intervals.first[s], 0.0
        for i in range(_WIDTH):
            part = 0.5 * row[i] * inverse[first + i, 0]
            for j in range(1, _WIDTH - i):
                part += row[i + j] * inverse[first + i, j]
            total += 2.0 * row[i] * part
        variance[n] = max(total, 0.0)


@inner(fastmath=_FAST)
def _row(basis: Floats, s: int, u: float, row: Floats) -> None:
    """Fill in the factors of the six coefficients that count in an interval."""
    last = basis.shape[1] - 1
    for i in range(_WIDTH):
        row[i] = basis[s, last, i]
    for q in range(last - 1, -1, -1):
        for i in range(_WIDTH):
            row[i] = u * row[i] + basis[s, q, i]


@lean(fastmath=_FAST)
def gather(x: Floats, z: Floats, intervals: Intervals, row: Floats, normal: Floats, right: Floats) -> None:
    """Add all samples to the normal matrix (m + 5, 6) and the right-hand side (m + 5,)."""
    s = 0
    for n in range(x.size):
        s = _place(intervals, x[n], s)
        _row(intervals.basis, s, (x[n] - intervals.low[s]) / intervals.length[s] - 0.5, row)
        first = intervals.first[s]
        for i in range(_WIDTH):
            right[first + i] += z[n] * row[i]
            for j in range(_WIDTH - i):
                normal[first + i, j] += row[i] * row[i + j]

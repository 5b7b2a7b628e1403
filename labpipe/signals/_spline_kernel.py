"""The compiled loops of the smoothing spline: bases, the penalised fit, variances.

In each interval between knots the B-splines are polynomials of the distance from its middle, so
that a sample costs Horner's rule and no recursion; samples are met once for each choice of knots.
All else works on one band of the normal matrix, in time linear in the coefficients: the variance of a
spline needs only those entries of the inverse that lie inside the band, which follow from the factor from the
last row to the first (Takahashi, Fagan & Chin, Proc. 8th PICA Conf. (1973) 63; see Erisman & Tinney, Comm. ACM 18
(1975) 177, doi:10.1145/360680.360704). The band is as wide as a quintic spline's, a constant. Plain loops
over arrays that the caller made compile in a third of the time that numpy's functions take.
Importing this imports numba.
"""

import math
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
OCTAVES = 2100
"""All that the lengths of intervals can differ by."""


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


class Update(NamedTuple):
    """How penalties follow the record, see :mod:`._smoothing_spline`; bounds relative to ``power``."""

    most: int
    settled: float
    pool: int
    shared_weight: float
    no_energy: float
    lowest: float
    highest: float


class Space(NamedTuple):
    """Work space of a fit: (interval,) and (interval, 6, 6); sums over octaves (OCTAVES,)."""

    penalty: Floats
    used: Floats
    energy: Floats
    bands: Floats
    octave_used: Floats
    octave_energy: Floats
    system: Floats


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


@lean(fastmath=_FAST)
def penalised(
    normal: Floats,
    right: Floats,
    intervals: Intervals,
    update: Update,
    space: Space,
    coefficients: Floats,
    inverse: Floats,
) -> int:
    """Fit a spline whose roughness costs as much as the samples say.

    ``normal`` (m + 5, 6) and ``right`` (m + 5,) are from :func:`gather`, ``space`` is work space;
    ``coefficients`` (m + 5,) and ``inverse`` (m + 5, 6), the band of their covariance, are filled. Returns the
    solves of the band system, 0 when a penalised matrix was not positive definite.
    """
    m, count = right.size - DEGREE, intervals.low.size
    for s in range(count):
        space.penalty[s] = 10.0 * intervals.power[s]
        # the fourth derivative is linear: 24 and 120 times the highest powers, and u^2 is 1/12 in the mean
        for i in range(_WIDTH):
            for j in range(_WIDTH - i):
                space.bands[s, i, j] = (
                    576.0 * intervals.basis[s, 4, i] * intervals.basis[s, 4, i + j]
                    + 1200.0 * intervals.basis[s, 5, i] * intervals.basis[s, 5, i + j]
                ) / intervals.power[s]
    has_settled, n_solves = False, 0
    while True:
        n_solves += 1
        _load(normal, right, intervals, space, coefficients)
        if not factored(space.system, m):
            return 0
        solve(space.system, coefficients, m)
        inverse_of_factor(space.system, inverse, m)
        if has_settled or n_solves > update.most:
            return n_solves
        for s in range(count):
            spread = fourth = fifth = 0.0
            first = intervals.first[s]
            for i in range(_WIDTH):
                fourth += intervals.basis[s, 4, i] * coefficients[first + i]
                fifth += intervals.basis[s, 5, i] * coefficients[first + i]
                part = 0.5 * space.bands[s, i, 0] * inverse[first + i, 0]
                for j in range(1, _WIDTH - i):
                    part += space.bands[s, i, j] * inverse[first + i, j]
                spread += 2.0 * part
            space.energy[s] = (576.0 * fourth**2 + 1200.0 * fifth**2) / intervals.power[s]
            space.used[s] = max(1.0 - space.penalty[s] * spread, 1e-4)
        has_settled = _update(intervals, update, space)


@inner(fastmath=_FAST)
def _load(normal: Floats, right: Floats, intervals: Intervals, space: Space, coefficients: Floats) -> None:
    """Add the penalty of every interval to the normal matrix; begin with the right-hand side."""
    for j in range(right.size):
        coefficients[j] = right[j]
        for d in range(_WIDTH):
            space.system[j, d] = normal[j, d]
    for s in range(intervals.low.size):
        for i in range(_WIDTH):
            for j in range(_WIDTH - i):
                space.system[intervals.first[s] + i, j] += space.penalty[s] * space.bands[s, i, j]


@inner(fastmath=_FAST)
def _update(intervals: Intervals, update: Update, space: Space) -> bool:
    """Set penalties to parameters used per roughness; return True where they hardly changed.

    Both are pooled over neighbours (a triangular window) and over all intervals of equal length.
    """
    count, octave = intervals.low.size, intervals.octave
    for o in range(OCTAVES):
        space.octave_used[o] = space.octave_energy[o] = 0.0
    whole_used = whole_energy = 0.0
    for s in range(count):
        space.octave_used[octave[s]] += space.used[s]
        space.octave_energy[octave[s]] += space.energy[s]
        whole_used += space.used[s]
        whole_energy += space.energy[s]
    has_settled = True
    for s in range(count):
        local_used, local_energy = whole_used, whole_energy
        if count >= 2 * update.pool + 1:
            local_used = local_energy = 0.0
            for o in range(max(s - update.pool, 0), min(s + update.pool + 1, count)):
                weight = 1.0 - abs(o - s) / (update.pool + 1.0)
                local_used += weight * space.used[o]
                local_energy += weight * space.energy[o]
        shared = space.octave_used[octave[s]] / max(space.octave_energy[octave[s]], update.no_energy)
        least = max(local_energy + update.shared_weight / shared, update.no_energy)
        wanted = (local_used + update.shared_weight) / least
        wanted = min(max(wanted, space.penalty[s] / 100.0), space.penalty[s] * 100.0)
        wanted = min(max(wanted, update.lowest * intervals.power[s]), update.highest * intervals.power[s])
        has_settled = has_settled and abs(math.log(wanted / space.penalty[s])) < update.settled
        space.penalty[s] = wanted
    return has_settled

"""The compiled loops of the smoothing spline: bases, the penalised fit, variances.

All work on one band of the normal matrix, from samples to variances, in time linear in samples and
coefficients. Plain loops over arrays that the caller made compile in a third of the time that
numpy's functions take. Importing this imports numba.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import compiled
from labpipe.signals._banded import cholesky, inverse_of_factor, solve

DEGREE = 5
_WIDTH = DEGREE + 1
Indices = NDArray[np.int64]
_OCTAVES = 2100  # all that the lengths of intervals can differ by


class Intervals(NamedTuple):
    """Intervals between knots: fields (interval,).

    ``start`` is the knot at which one begins, ``octave`` the rounded binary logarithm of its
    ``length`` above the smallest, ``power`` its length to the power in which a penalty grows.
    """

    start: Indices
    length: Floats
    power: Floats
    octave: Indices


class Update(NamedTuple):
    """How penalties follow the record, see :mod:`._smoothing`; bounds relative to ``power``."""

    order: int
    most: int
    settled: float
    pool: int
    shared_weight: float
    no_energy: float
    lowest: float
    highest: float


@compiled(error_model="numpy")
def _place(knots: Floats, x: float, k: int) -> int:
    """Interval of ``x``, beginning to look at the interval ``k``."""
    last = knots.size - _WIDTH - 1
    while k < last and x >= knots[k + 1]:
        k += 1
    while k > DEGREE and (x < knots[k] or knots[k] == knots[k + 1]):
        k -= 1
    return k


def reciprocals_of(knots: Floats) -> Floats:
    """One over the length (5, m + 6) from each knot to the p-th after it; 0 where that is 0."""
    found = np.zeros((DEGREE, knots.size))
    for p in range(1, DEGREE + 1):
        length = knots[p:] - knots[:-p]
        np.divide(1.0, length, out=found[p - 1, :-p], where=length > 0.0)
    return found


@compiled(error_model="numpy")
def _row(knots: Floats, reciprocals: Floats, k: int, x: float, derivative: int, row: Floats) -> None:
    """Values (6,) of a derivative of the B-splines that are not 0 in the interval ``k``."""
    row[0] = 1.0
    for p in range(1, DEGREE - derivative + 1):  # Cox and de Boor
        carried = 0.0
        for i in range(p):
            left = k + 1 + i - p
            share = row[i] * reciprocals[p - 1, left]
            row[i] = carried + (knots[left + p] - x) * share
            carried = (x - knots[left]) * share
        row[p] = carried
    for p in range(DEGREE - derivative + 1, DEGREE + 1):
        # The derivative's coefficient i is p (c[i] - c[i-1]) / (knots[i+p] - knots[i]).
        carried = 0.0
        for i in range(p):
            share = p * row[i] * reciprocals[p - 1, k + 1 + i - p]
            row[i] = carried - share
            carried = share
        row[p] = carried


@compiled(error_model="numpy")
def evaluated(
    knots: Floats,
    reciprocals: Floats,
    coefficients: Floats,
    inverse: Floats,
    x: Floats,
    derivative: int,
    value: Floats,
    variance: Floats,
) -> None:
    """Fill in value and variance (n,) of a derivative of the spline at ``x`` (n,).

    ``coefficients`` (m,) and the band (6, m) of their covariance belong to the ``knots`` (m + 6,).
    """
    row, k = np.empty(_WIDTH), DEGREE
    for n in range(x.size):
        k = _place(knots, x[n], k)
        _row(knots, reciprocals, k, x[n], derivative, row)
        value[n] = _product(row, coefficients, k - DEGREE)
        variance[n] = _form(row, inverse, k - DEGREE)


@compiled(error_model="numpy")
def _product(row: Floats, coefficients: Floats, first: int) -> float:
    total = 0.0
    for i in range(_WIDTH):
        total += row[i] * coefficients[first + i]
    return total


@compiled(error_model="numpy")
def _form(row: Floats, inverse: Floats, first: int) -> float:
    """``row A^-1 row`` of a row with six neighbouring non-zeros."""
    total = 0.0
    for i in range(_WIDTH):
        part = 0.5 * row[i] * inverse[0, first + i]
        for j in range(i):
            part += row[j] * inverse[i - j, first + j]
        total += 2.0 * row[i] * part
    return max(total, 0.0)


@compiled(error_model="numpy")
def _add(band: Floats, row: Floats, first: int, weight: float) -> None:
    for i in range(_WIDTH):
        for j in range(i + 1):
            band[i - j, first + j] += weight * row[i] * row[j]


@compiled(error_model="numpy")
def penalised(
    x: Floats,
    z: Floats,
    knots: Floats,
    reciprocals: Floats,
    intervals: Intervals,
    nodes: Floats,
    weights: Floats,
    update: Update,
    coefficients: Floats,
    inverse: Floats,
    residual: Floats,
) -> tuple[float, int]:
    """Fit a spline whose roughness costs as much as the samples say.

    Parameters
    ----------
    x, z : array (n,)
        Rising abscissa; samples of standard deviation 1.
    knots, reciprocals : array (m + 6,), (5, m + 6)
        Of the quintic spline, the first and the last six-fold; see :func:`reciprocals_of`.
    intervals : Intervals
        Between the knots.
    nodes, weights : array (q,)
        Gauss' rule on 0 to 1, exact for the square of the penalised derivative.
    update : Update
        How the penalties are found.
    coefficients, inverse, residual : array (m,), (6, m), (n,)
        Filled: the spline, the band of its covariance, and what it leaves of the samples.

    Returns
    -------
    freedom : float
        Effective number of parameters.
    n_solves : int
        Of the band system; 0 when a penalised matrix was not positive definite.
    """
    m, count = coefficients.size, intervals.start.size
    rows, places = np.empty((x.size, _WIDTH)), np.empty(x.size, np.int64)
    normal, right = np.zeros((_WIDTH, m)), np.zeros(m)
    system = np.empty((_WIDTH, m))
    k = DEGREE
    for n in range(x.size):
        k = _place(knots, x[n], k)
        places[n] = k - DEGREE
        _row(knots, reciprocals, k, x[n], 0, rows[n])
        _add(normal, rows[n], k - DEGREE, 1.0)
        for i in range(_WIDTH):
            right[k - DEGREE + i] += z[n] * rows[n, i]
    rough = np.empty((count, nodes.size, _WIDTH))
    bands = np.zeros((count, _WIDTH, _WIDTH))  # of one interval each, at penalty 1
    penalty, used, energy = np.empty(count), np.empty(count), np.empty(count)
    for s in range(count):
        k = intervals.start[s]
        penalty[s] = 10.0 * intervals.power[s]
        for q in range(nodes.size):
            _row(knots, reciprocals, k, knots[k] + intervals.length[s] * nodes[q], update.order, rough[s, q])
            _add(bands[s], rough[s, q], places[0], intervals.length[s] * weights[q])
    has_settled, n_solves = False, 0
    while True:
        n_solves += 1
        _load(system, normal, bands, intervals.start, penalty)
        if not cholesky(system):
            return 0.0, 0
        solve(system, right, coefficients)
        inverse_of_factor(system, inverse)
        if has_settled or n_solves > update.most:
            break
        for s in range(count):
            spread, energy[s] = 0.0, 0.0
            for q in range(nodes.size):
                share = intervals.length[s] * weights[q]
                energy[s] += share * _product(rough[s, q], coefficients, intervals.start[s] - DEGREE) ** 2
                spread += share * _form(rough[s, q], inverse, intervals.start[s] - DEGREE)
            used[s] = max(1.0 - penalty[s] * spread, 1e-4)
        has_settled = _update(penalty, used, energy, intervals, update)
    freedom = 0.0
    for n in range(x.size):
        residual[n] = z[n] - _product(rows[n], coefficients, places[n])
        freedom += _form(rows[n], inverse, places[n])
    return freedom, n_solves


@compiled(error_model="numpy")
def _load(system: Floats, normal: Floats, bands: Floats, start: Indices, penalty: Floats) -> None:
    """Add the penalty of every interval to the normal matrix (6, m)."""
    for d in range(_WIDTH):
        for j in range(normal.shape[1]):
            system[d, j] = normal[d, j]
    for s in range(start.size):
        first = start[s] - DEGREE
        for d in range(_WIDTH):
            for j in range(_WIDTH - d):
                system[d, first + j] += penalty[s] * bands[s, d, j]


@compiled(error_model="numpy")
def _update(penalty: Floats, used: Floats, energy: Floats, intervals: Intervals, update: Update) -> bool:
    """Set penalties to parameters used per roughness; tell whether they hardly changed.

    Both are pooled over neighbours (a triangular window) and over all intervals of equal length.
    """
    count, octave = penalty.size, intervals.octave
    all_used, all_energy = np.zeros(_OCTAVES), np.zeros(_OCTAVES)
    whole_used = whole_energy = 0.0
    for s in range(count):
        all_used[octave[s]] += used[s]
        all_energy[octave[s]] += energy[s]
        whole_used += used[s]
        whole_energy += energy[s]
    has_settled = True
    for s in range(count):
        local_used, local_energy = whole_used, whole_energy
        if count >= 2 * update.pool + 1:
            local_used = local_energy = 0.0
            for o in range(max(s - update.pool, 0), min(s + update.pool + 1, count)):
                weight = 1.0 - abs(o - s) / (update.pool + 1.0)
                local_used += weight * used[o]
                local_energy += weight * energy[o]
        shared = all_used[octave[s]] / max(all_energy[octave[s]], update.no_energy)
        least = max(local_energy + update.shared_weight / shared, update.no_energy)
        wanted = (local_used + update.shared_weight) / least
        wanted = min(max(wanted, penalty[s] / 100.0), penalty[s] * 100.0)
        wanted = min(max(wanted, update.lowest * intervals.power[s]), update.highest * intervals.power[s])
        has_settled = has_settled and abs(math.log(wanted / penalty[s])) < update.settled
        penalty[s] = wanted
    return has_settled

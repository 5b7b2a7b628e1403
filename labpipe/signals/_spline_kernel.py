"""The compiled loops of the smoothing spline: bases, the penalised fit, variances.

All work on one band of the normal matrix, from samples to variances, in time linear in samples and
coefficients. They stand in one file because compiled code is cached by file. Importing it imports
numba.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import compiled
from labpipe.signals._banded import cholesky, inverse_of_factor, solve

DEGREE = 5
_WIDTH = DEGREE + 1
Indices = NDArray[np.int64]


@compiled()
def _place(knots: Floats, x: float, k: int) -> int:
    """Interval of ``x``, beginning to look at the interval ``k``."""
    last = knots.size - _WIDTH - 1
    while k < last and x >= knots[k + 1]:
        k += 1
    while k > DEGREE and (x < knots[k] or knots[k] == knots[k + 1]):
        k -= 1
    return k


@compiled()
def _reciprocals(knots: Floats) -> Floats:
    """One over the length (5, m + 6) from each knot to the p-th after it; 0 where that is 0."""
    found = np.zeros((DEGREE, knots.size))
    for p in range(1, DEGREE + 1):
        for k in range(knots.size - p):
            length = knots[k + p] - knots[k]
            found[p - 1, k] = 1.0 / length if length > 0.0 else 0.0
    return found


@compiled()
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


@compiled()
def evaluated(
    knots: Floats, coefficients: Floats, inverse: Floats, x: Floats, derivative: int
) -> tuple[Floats, Floats]:
    """Value and variance (n,) of a derivative of the spline at ``x`` (n,).

    ``coefficients`` (m,) and the band (6, m) of their covariance belong to the ``knots`` (m + 6,).
    """
    value, variance, row = np.empty(x.size), np.empty(x.size), np.empty(_WIDTH)
    reciprocals, k = _reciprocals(knots), DEGREE
    for n in range(x.size):
        k = _place(knots, x[n], k)
        _row(knots, reciprocals, k, x[n], derivative, row)
        value[n] = _product(row, coefficients, k - DEGREE)
        variance[n] = _form(row, inverse, k - DEGREE)
    return value, variance


@compiled()
def _product(row: Floats, coefficients: Floats, first: int) -> float:
    total = 0.0
    for i in range(_WIDTH):
        total += row[i] * coefficients[first + i]
    return total


@compiled()
def _form(row: Floats, inverse: Floats, first: int) -> float:
    """``row A^-1 row`` of a row with six neighbouring non-zeros."""
    total = 0.0
    for i in range(_WIDTH):
        part = 0.5 * row[i] * inverse[0, first + i]
        for j in range(i):
            part += row[j] * inverse[i - j, first + j]
        total += 2.0 * row[i] * part
    return max(total, 0.0)


@compiled()
def _add(band: Floats, row: Floats, first: int, weight: float) -> None:
    for i in range(_WIDTH):
        for j in range(i + 1):
            band[i - j, first + j] += weight * row[i] * row[j]


@compiled()
def penalised(
    x: Floats,
    z: Floats,
    knots: Floats,
    order: int,
    nodes: Floats,
    weights: Floats,
    limits: tuple[float, float],
    updates: int,
    settled: float,
    pool: int,
    shared_weight: float,
    no_energy: float,
) -> tuple[Floats, Floats, Floats, float, int]:
    """Fit a spline whose roughness costs as much as the samples say.

    Parameters
    ----------
    x, z : array (n,)
        Rising abscissa; samples of standard deviation 1.
    knots : array (m + 6,)
        Of the quintic spline, the first and the last six-fold.
    order : int
        Of the derivative that is penalised.
    nodes, weights : array (q,)
        Gauss' rule on -1 to 1, exact for the square of that derivative.
    limits : (float, float)
        Of the penalty, relative to the length of an interval to the power ``2 order - 1``.
    updates, settled, pool, shared_weight, no_energy
        Of the update of the penalties; see :mod:`._smoothing`.

    Returns
    -------
    coefficients : array (m,)
    inverse : array (6, m)
        Band of their covariance.
    residual : array (n,)
    freedom : float
        Effective number of parameters.
    n_solves : int
        Of the band system; 0 when a penalised matrix was not positive definite.
    """
    m = knots.size - _WIDTH
    rows = np.empty((x.size, _WIDTH))
    places = np.empty(x.size, np.int64)
    normal, right = np.zeros((_WIDTH, m)), np.zeros(m)
    reciprocals, k = _reciprocals(knots), DEGREE
    for n in range(x.size):
        k = _place(knots, x[n], k)
        places[n] = k - DEGREE
        _row(knots, reciprocals, k, x[n], 0, rows[n])
        _add(normal, rows[n], k - DEGREE, 1.0)
        for i in range(_WIDTH):
            right[k - DEGREE + i] += z[n] * rows[n, i]
    starts = np.flatnonzero(np.diff(knots[: m + 1]) > 0.0)
    count = starts.size
    length = knots[starts + 1] - knots[starts]
    octave = np.empty(count, np.int64)
    for s in range(count):
        octave[s] = round(math.log2(length[s]))
    octave -= octave.min()
    rough = np.empty((count, nodes.size, _WIDTH))
    bands = np.zeros((count, _WIDTH, _WIDTH))  # of one interval each, at penalty 1
    for s in range(count):
        low = knots[starts[s]]
        for q in range(nodes.size):
            _row(knots, reciprocals, starts[s], low + 0.5 * length[s] * (nodes[q] + 1.0), order, rough[s, q])
            _add(bands[s], rough[s, q], 0, 0.5 * length[s] * weights[q])
    power = length ** (2 * order - 1)
    penalty = 10.0 * power
    used, energy = np.empty(count), np.empty(count)
    has_settled, n_solves = False, 0
    coefficients, inverse = right, normal
    while True:
        n_solves += 1
        system = _loaded(normal, bands, starts, penalty)
        if not cholesky(system):
            return coefficients, inverse, z, 0.0, 0
        coefficients = solve(system, right)
        inverse = inverse_of_factor(system)
        if has_settled or n_solves > updates:
            break
        for s in range(count):
            share = 0.5 * length[s] * weights
            used[s], energy[s] = _use(rough[s], share, coefficients, inverse, starts[s] - DEGREE)
            used[s] = max(1.0 - penalty[s] * used[s], 1e-4)
        has_settled = _update(penalty, used, energy, octave, power, limits, settled, pool, shared_weight, no_energy)
    residual, freedom = np.empty(x.size), 0.0
    for n in range(x.size):
        residual[n] = z[n] - _product(rows[n], coefficients, places[n])
        freedom += _form(rows[n], inverse, places[n])
    return coefficients, inverse, residual, freedom, n_solves


@compiled()
def _loaded(normal: Floats, bands: Floats, starts: Indices, penalty: Floats) -> Floats:
    """Add the penalty of every interval to the normal matrix (6, m)."""
    system = normal.copy()
    for s in range(starts.size):
        first = starts[s] - DEGREE
        for d in range(_WIDTH):
            for j in range(_WIDTH - d):
                system[d, first + j] += penalty[s] * bands[s, d, j]
    return system


@compiled()
def _use(rough: Floats, share: Floats, coefficients: Floats, inverse: Floats, first: int) -> tuple[float, float]:
    """Variance and square of the penalised derivative, integrated over one interval."""
    spread = energy = 0.0
    for q in range(share.size):
        energy += share[q] * _product(rough[q], coefficients, first) ** 2
        spread += share[q] * _form(rough[q], inverse, first)
    return spread, energy


@compiled()
def _update(
    penalty: Floats,
    used: Floats,
    energy: Floats,
    octave: Indices,
    power: Floats,
    limits: tuple[float, float],
    settled: float,
    pool: int,
    shared_weight: float,
    no_energy: float,
) -> bool:
    """Set penalties to parameters used per roughness; tell whether they hardly changed.

    Both are pooled over neighbours (a triangular window) and over all intervals of equal length.
    """
    count = penalty.size
    all_used, all_energy = np.zeros(octave.max() + 1), np.zeros(octave.max() + 1)
    for s in range(count):
        all_used[octave[s]] += used[s]
        all_energy[octave[s]] += energy[s]
    is_short = count < 2 * pool + 1
    whole_used, whole_energy = used.sum(), energy.sum()
    has_settled = True
    for s in range(count):
        local_used, local_energy = whole_used, whole_energy
        if not is_short:
            local_used = local_energy = 0.0
            for o in range(max(s - pool, 0), min(s + pool + 1, count)):
                weight = 1.0 - abs(o - s) / (pool + 1.0)
                local_used += weight * used[o]
                local_energy += weight * energy[o]
        shared = all_used[octave[s]] / max(all_energy[octave[s]], no_energy)
        wanted = (local_used + shared_weight) / max(local_energy + shared_weight / shared, no_energy)
        wanted = min(max(wanted, penalty[s] / 100.0), penalty[s] * 100.0)
        wanted = min(max(wanted, limits[0] * power[s]), limits[1] * power[s])
        has_settled = has_settled and abs(math.log(wanted / penalty[s])) < settled
        penalty[s] = wanted
    return has_settled

r"""First estimates of the shifts, one neighbouring pair of isotherms at a time.

Two independent ways, because the joint objective can have several minima in a glass:

- *scan*: for every trial step both isotherms are fitted by one small non-negative spectrum; the
  best step has the least misfit. Storage and loss are tied by the spectrum (Kramers-Kronig), so
  this works even where the pair does not overlap;
- *overlap*: the step that continues the storage modulus, difference over slope; it ignores the
  loss modulus and with it every fault of the phase.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar, nnls

from labpipe.arrays import Floats
from labpipe.materials.spectrum import NNLS_STEPS_PER_COLUMN, moduli_of_terms
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._parameters import (
    CHANGE,
    CHANGE_SHARE,
    LEAST_SPACING,
    STEP_PER_KELVIN,
    STEP_SPREAD,
    STEP_SPREAD_PER_KELVIN,
)

_LN10 = float(np.log(10.0))
# Trial steps from an isotherm to its warmer neighbour, in decades of frequency; the best few of
# them are followed into dips that may be narrower, down to the finest move that counts.
_STEPS = np.arange(-1.0, 6.01, 0.5)
# Further steps than so many are tried only where the near ones show no dip far below their ends:
# two sweeps that are torn apart fit as well as any, and say nothing.
_NEAR, _CLEAR = 10, 0.3
_MOST_DIPS, _FINEST = 2, 0.02
_TERMS_PER_DECADE, _MARGIN_DECADES = 2, 0.7
_FLAT_SLOPE = 2e-3  # d ln E'/d ln ω, below which the storage modulus of a pair is too flat to be matched


def scanned_shifts(points: Points, temperature: Floats, ln_bT: Floats) -> Floats:
    """Return log10 a_T (isotherm,) from scans of all pairs together, zero at the warmest.

    A step of one pair alone may be ambiguous: two sweeps without loss in common fit at any
    distance. So every pair keeps all its dips, and the chain of steps is taken that fits best
    and changes gradually, as the expectation of :mod:`._parameters` has it.
    """
    order = np.argsort(temperature, kind="stable")
    pairs = list(pairwise(order.tolist()))
    scans = [_scanned(*_pair(points, ln_bT, *pair), float(np.diff(temperature[list(pair)])[0])) for pair in pairs]
    # the least sum of scores and of changes from pair to pair, by dynamic programming over the trial steps (Viterbi)
    spacing = np.maximum(np.diff(temperature[order]), LEAST_SPACING)
    total, back = scans[0][1], []
    for k in range(1, len(scans)):
        mean = 0.5 * (spacing[k - 1] + spacing[k])
        before = scans[k - 1][0][:, None] / spacing[k - 1] * mean
        after = scans[k][0][None, :] / spacing[k] * mean
        change = CHANGE + CHANGE_SHARE * np.minimum(np.abs(before), np.abs(after))
        joined = total[:, None] + ((before - after) / change) ** 2
        back.append(np.argmin(joined, axis=0))
        total = np.min(joined, axis=0) + scans[k][1]
    chosen = [int(np.argmin(total))]
    for previous in reversed(back):
        chosen.append(int(previous[chosen[-1]]))
    return _summed(order, [float(steps[i]) for (steps, _), i in zip(scans, reversed(chosen), strict=True)])


def overlapped_shifts(points: Points, temperature: Floats, ln_bT: Floats) -> Floats:
    """Chain the steps that continue the storage modulus (mean difference of ln E' over the mean slope)."""
    order = np.argsort(temperature, kind="stable")
    steps = []
    for cold, warm in pairwise(order.tolist()):
        sweeps = _pair(points, ln_bT, cold, warm)
        slopes = [np.polyfit(x, np.log(E), 1)[0] if x.size > 1 else 0.0 for x, E, _ in sweeps]
        slope = max(float(np.mean(slopes)), _FLAT_SLOPE)
        (x1, y1), (x2, y2) = ((float(np.mean(x)), float(np.mean(np.log(E)))) for x, E, _ in sweeps)
        mean, spread = _expected(float(temperature[warm] - temperature[cold]))
        steps.append(float(np.clip(((y1 - y2) / slope - x1 + x2) / _LN10, mean - 3 * spread, mean + 3 * spread)))
    return _summed(order, steps)


_Sweep = tuple[Floats, Floats, Floats]
"""ln ω, storage and loss of an isotherm, its vertical factor taken out."""


def _pair(points: Points, ln_bT: Floats, cold: int, warm: int) -> tuple[_Sweep, _Sweep]:
    masks, factor = (points.isotherm == cold, points.isotherm == warm), np.exp(-ln_bT[points.isotherm])
    first, second = ((np.log(points.omega[m]), (points.storage * factor)[m], (points.loss * factor)[m]) for m in masks)
    return first, second


def _summed(order: NDArray[np.intp], steps: Sequence[float]) -> Floats:
    """Add up the steps from the warmest isotherm to colder ones."""
    shifts = np.zeros(order.size)
    shifts[order[:-1]] = np.cumsum(steps[::-1])[::-1]
    return shifts


def _expected(difference: float) -> tuple[float, float]:
    """Return mean and spread of the step of polymers over a difference of temperature."""
    return STEP_PER_KELVIN * difference, STEP_SPREAD + STEP_SPREAD_PER_KELVIN * difference


def _scanned(cold: _Sweep, warm: _Sweep, difference: float) -> tuple[Floats, Floats]:
    """Return trial steps of a pair and their scores, in units of twice the log-likelihood.

    A score is the misfit of one spectrum to both isotherms.
    """
    low = min(cold[0].min(), warm[0].min() - _STEPS[-1] * _LN10) - _MARGIN_DECADES * _LN10
    high = max(cold[0].max(), warm[0].max() - _STEPS[0] * _LN10) + _MARGIN_DECADES * _LN10
    ln_time = np.arange(-high, -low, _LN10 / _TERMS_PER_DECADE)
    scale = float(np.sqrt(cold[1].mean() * warm[1].mean()))
    fixed, tries = _rows(cold, ln_time) * scale, list[tuple[float, float, int]]()

    def misfit(step: float) -> float:
        design = np.vstack([fixed, _rows((warm[0] - step * _LN10, *warm[1:]), ln_time) * scale])
        weight, rest = nnls(design, np.ones(design.shape[0]), maxiter=NNLS_STEPS_PER_COLUMN * design.shape[1])
        tries.append((step, float(rest) ** 2, int(np.count_nonzero(weight))))
        return tries[-1][1]

    costs = np.array([misfit(step) for step in _STEPS[:_NEAR].tolist()])
    # the best trial step must lie inside them, far below both ends
    if not np.min(costs[1:-1]) < _CLEAR * min(costs[0], costs[-1]):
        costs = np.append(costs, [misfit(step) for step in _STEPS[_NEAR:].tolist()])
    # where trial steps are better than both neighbours, the best few are followed into their dips
    inner = np.flatnonzero((costs[1:-1] <= costs[:-2]) & (costs[1:-1] <= costs[2:])) + 1
    for k in inner[np.argsort(costs[inner], kind="stable")[:_MOST_DIPS]]:
        minimize_scalar(misfit, bounds=_STEPS[[k - 1, k + 1]], method="bounded", options={"xatol": _FINEST})
    steps, costs, terms = np.array(tries).T
    rows = 2.0 * (cold[0].size + warm[0].size)
    noise = max(float(np.min(costs / np.maximum(rows - terms, 1.0))), float(np.finfo(float).tiny))
    mean, spread = _expected(difference)
    # Isotherms that are torn apart have a spectrum each: the gain by more terms is not the step's.
    return steps, costs / noise + 2.0 * terms + ((steps - mean) / spread) ** 2


def _rows(sweep: _Sweep, ln_time: Floats) -> Floats:
    """Return the design of one isotherm, divided by its measured moduli."""
    ln_omega, storage, loss = sweep
    return moduli_of_terms(ln_omega, ln_time) / np.concatenate([storage, loss])[:, None]

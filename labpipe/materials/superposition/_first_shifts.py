r"""First estimates of the shifts, one neighbouring pair of isotherms at a time.

Two independent ways, because the joint objective can have several minima in a glass:

- *scan*: for every trial step both isotherms are fitted by one small non-negative spectrum; the
  best step has the least misfit. Storage and loss are tied by the spectrum (Kramers-Kronig), so
  this works even where the pair does not overlap;
- *overlap*: the step that continues the storage modulus, difference over slope; it ignores the
  loss modulus and with it every fault of the phase.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from labpipe.arrays import Floats
from labpipe.materials.spectrum import maxwell_shapes
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
_MOST_DIPS, _DESCENTS, _MOST_MOVE, _FINEST = 2, 4, 0.3, 0.01
_TERMS_PER_DECADE = 2
_MARGIN_DECADES = 0.7
# Slope d ln E'/d ln ω below which the storage modulus of a pair is too flat to be matched.
_FLAT_SLOPE = 2e-3
_NNLS_STEPS_PER_COLUMN = 40


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two neighbouring isotherms, colder first, as rows relative to the measured values."""

    ln_omega: tuple[Floats, Floats]
    storage: tuple[Floats, Floats]
    loss: tuple[Floats, Floats]
    difference: float


@dataclass(frozen=True, slots=True)
class _Scan:
    """Trial steps of one pair and their scores, in units of twice the log-likelihood."""

    step: Floats
    score: Floats


def scanned_shifts(points: Points, temperature: Floats, ln_bT: Floats) -> Floats:
    """Return log10 a_T (isotherm,) from scans of all pairs together, zero at the warmest.

    A step of one pair alone may be ambiguous: two sweeps without loss in common fit at any
    distance. So every pair keeps all its dips, and the chain of steps is taken that fits best
    and changes gradually, as the expectation of :mod:`._parameters` has it.
    """
    order = np.argsort(temperature, kind="stable")
    scans = [_scanned(_pair(points, temperature, ln_bT, cold, warm)) for cold, warm in pairwise(order.tolist())]
    return _summed(order, _best_chain(scans, np.diff(temperature[order])))


def overlapped_shifts(points: Points, temperature: Floats, ln_bT: Floats) -> Floats:
    """Chain the steps that continue the storage modulus; zero at the warmest isotherm."""
    order = np.argsort(temperature, kind="stable")
    steps = [_overlapped_step(_pair(points, temperature, ln_bT, cold, warm)) for cold, warm in pairwise(order.tolist())]
    return _summed(order, steps)


def _summed(order: NDArray[np.intp], steps: Sequence[float]) -> Floats:
    """Add up the steps from the warmest isotherm to colder ones."""
    shifts = np.zeros(order.size)
    shifts[order[:-1]] = np.cumsum(steps[::-1])[::-1]
    return shifts


def _pair(points: Points, temperature: Floats, ln_bT: Floats, cold: int, warm: int) -> _Pair:
    masks = [points.isotherm == cold, points.isotherm == warm]
    scales = [np.exp(-ln_bT[k]) for k in (cold, warm)]
    return _Pair(
        ln_omega=(np.log(points.omega[masks[0]]), np.log(points.omega[masks[1]])),
        storage=(points.storage[masks[0]] * scales[0], points.storage[masks[1]] * scales[1]),
        loss=(points.loss[masks[0]] * scales[0], points.loss[masks[1]] * scales[1]),
        difference=float(temperature[warm] - temperature[cold]),
    )


def _expected(difference: float) -> tuple[float, float]:
    return STEP_PER_KELVIN * difference, STEP_SPREAD + STEP_SPREAD_PER_KELVIN * difference


def _overlapped_step(pair: _Pair) -> float:
    """Mean difference of ln E' over the mean slope, kept within what polymers do."""
    (cold_x, warm_x), (cold_y, warm_y) = pair.ln_omega, [np.log(s) for s in pair.storage]
    mean, spread = _expected(pair.difference)
    slopes = [np.polyfit(x, y, 1)[0] if x.size > 1 else 0.0 for x, y in ((cold_x, cold_y), (warm_x, warm_y))]
    slope = max(float(np.mean(slopes)), _FLAT_SLOPE)
    jump = float(np.mean(cold_y) - np.mean(warm_y)) - slope * float(np.mean(cold_x) - np.mean(warm_x))
    return float(np.clip(jump / slope / _LN10, mean - 3 * spread, mean + 3 * spread))


def _scanned(pair: _Pair) -> _Scan:
    """Judge trial steps by the misfit of one spectrum to both isotherms."""
    trial = _Trial(pair)
    tries = [trial.at(float(step)) for step in _STEPS[:_NEAR]]
    costs = np.array([one.cost for one in tries])
    # the best trial step must lie inside them, far below both ends
    if not np.min(costs[1:-1]) < _CLEAR * min(costs[0], costs[-1]):
        tries += [trial.at(float(step)) for step in _STEPS[_NEAR:]]
        costs = np.array([one.cost for one in tries])
    # where trial steps are better than both neighbours, the best few, ends left out
    inner = np.flatnonzero((costs[1:-1] <= costs[:-2]) & (costs[1:-1] <= costs[2:])) + 1
    for k in inner[np.argsort(costs[inner], kind="stable")[:_MOST_DIPS]]:
        tries += trial.descended(tries[k])
    steps, costs, terms = (np.array([getattr(one, name) for one in tries]) for name in ("step", "cost", "terms"))
    rows = 2.0 * (pair.ln_omega[0].size + pair.ln_omega[1].size)
    noise = max(float(np.min(costs / np.maximum(rows - terms, 1.0))), float(np.finfo(float).tiny))
    mean, spread = _expected(pair.difference)
    # Isotherms that are torn apart have a spectrum each: what more terms gain is not the step's.
    return _Scan(steps, costs / noise + 2.0 * terms + ((steps - mean) / spread) ** 2)


@dataclass(frozen=True, slots=True)
class _Tried:
    """One trial step: its misfit, and the weights of the terms with their design."""

    step: float
    cost: float
    weight: Floats
    design: Floats

    @property
    def terms(self) -> int:
        """Number of terms that are not zero."""
        return int(np.count_nonzero(self.weight))


class _Trial:
    """The small fits of one pair."""

    def __init__(self, pair: _Pair) -> None:
        self.pair = pair
        self.ln_time, self.scale = _pair_terms(pair)
        cold = (pair.ln_omega[0], pair.storage[0], pair.loss[0])
        self.fixed = _relative_rows(*cold, self.ln_time) * self.scale

    def at(self, step: float) -> _Tried:
        """Fit one spectrum to both isotherms."""
        design = np.vstack([self.fixed, self._moving(step, _relative_rows)])
        most = _NNLS_STEPS_PER_COLUMN * self.scale.size
        weight, rest = nnls(design, np.ones(design.shape[0]), maxiter=most)
        return _Tried(step, float(rest) ** 2, weight, design)

    def _moving(self, step: float, rows: "Callable[[Floats, Floats, Floats, Floats], Floats]") -> Floats:
        ln_omega = self.pair.ln_omega[1] - step * _LN10
        return rows(ln_omega, self.pair.storage[1], self.pair.loss[1], self.ln_time) * self.scale

    def move(self, tried: _Tried) -> float:
        """Return the step of Gauss and Newton, the terms following (Kaufman)."""
        active = tried.design[:, tried.weight > 0]
        change = np.zeros(active.shape[0])
        slopes = self._moving(tried.step, _slope_rows)
        change[self.fixed.shape[0] :] = -_LN10 * (slopes @ tried.weight)
        followed = change - active @ np.linalg.lstsq(active, change, rcond=None)[0]
        size = float(followed @ followed)
        residual = 1.0 - tried.design @ tried.weight
        return float(followed @ residual) / size if size > 0 else 0.0

    def descended(self, first: _Tried) -> list[_Tried]:
        """Follow the moves from a trial step into its dip, which may be far narrower."""
        found, best = [], first
        for _ in range(_DESCENTS):
            move = float(np.clip(self.move(best), -_MOST_MOVE, _MOST_MOVE))
            if abs(move) < _FINEST:
                break
            found.append(self.at(best.step + move))
            if found[-1].cost >= best.cost:
                break
            best = found[-1]
        return found


def _best_chain(scans: Sequence[_Scan], spacing: Floats) -> list[float]:
    """Return the steps with the least sum of scores and of changes from pair to pair.

    Dynamic programming over the trial steps of all pairs (Viterbi).
    """
    spacing = np.maximum(spacing, LEAST_SPACING)
    total, back = scans[0].score, []
    for k in range(1, len(scans)):
        before, after = scans[k - 1].step[:, None], scans[k].step[None, :]
        mean = 0.5 * (spacing[k - 1] + spacing[k])
        before, after = before / spacing[k - 1] * mean, after / spacing[k] * mean
        change = CHANGE + CHANGE_SHARE * np.minimum(np.abs(before), np.abs(after))
        joined = total[:, None] + ((before - after) / change) ** 2
        back.append(np.argmin(joined, axis=0))
        total = np.min(joined, axis=0) + scans[k].score
    at = int(np.argmin(total))
    chosen = [at]
    for previous in reversed(back):
        at = int(previous[at])
        chosen.append(at)
    return [float(scan.step[i]) for scan, i in zip(scans, reversed(chosen), strict=True)]


def _pair_terms(pair: _Pair) -> tuple[Floats, Floats]:
    """Return a grid of times that covers every trial step, and the unit of the weights."""
    cold, warm = pair.ln_omega
    low = min(cold.min(), warm.min() - _STEPS[-1] * _LN10) - _MARGIN_DECADES * _LN10
    high = max(cold.max(), warm.max() - _STEPS[0] * _LN10) + _MARGIN_DECADES * _LN10
    ln_time = np.arange(-high, -low, _LN10 / _TERMS_PER_DECADE)
    typical = float(np.sqrt(pair.storage[0].mean() * pair.storage[1].mean()))
    return ln_time, np.full(ln_time.size + 1, typical)


def _relative_rows(ln_omega: Floats, storage: Floats, loss: Floats, ln_time: Floats) -> Floats:
    """Design rows of one isotherm divided by its measured moduli."""
    storage_shape, loss_shape = maxwell_shapes(ln_omega, ln_time)
    upper = np.column_stack([storage_shape, np.ones(ln_omega.size)]) / storage[:, None]
    lower = np.column_stack([loss_shape, np.zeros(ln_omega.size)]) / loss[:, None]
    return np.vstack([upper, lower])


def _slope_rows(ln_omega: Floats, storage: Floats, loss: Floats, ln_time: Floats) -> Floats:
    """Slopes of the same rows over ln ω: 2 L² and L (1 − 2 S)."""
    first, second = maxwell_shapes(ln_omega, ln_time)
    none = np.zeros(ln_omega.size)
    upper = np.column_stack([2.0 * second**2, none]) / storage[:, None]
    lower = np.column_stack([second * (1.0 - 2.0 * first), none]) / loss[:, None]
    return np.vstack([upper, lower])

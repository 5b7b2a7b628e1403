r"""First estimates of the shifts, one neighbouring pair of isotherms at a time.

Two independent ways, because the joint objective can have several minima in a glass:

- *scan*: for every trial step both isotherms are fitted by one small non-negative spectrum; the
  best step has the least misfit. Storage and loss are tied by the spectrum (Kramers-Kronig), so
  this works even where the pair does not overlap;
- *overlap*: the step that continues the storage modulus, difference over slope; it ignores the
  loss modulus and with it every fault of the phase.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from labpipe.materials.joint_fit import Points
from labpipe.materials.outer_model import (
    STEP_PER_KELVIN,
    STEP_SPREAD,
    STEP_SPREAD_PER_KELVIN,
)
from labpipe.materials.spectrum import maxwell_shapes

Array = NDArray[np.float64]

_LN10 = float(np.log(10.0))
# Trial steps from an isotherm to its warmer neighbour, in decades of frequency; the best one and
# its neighbours half a step away then carry a parabola.
_COARSE = 0.5
_STEPS = np.arange(-1.0, 6.01, _COARSE)
_TERMS_PER_DECADE = 2
_MARGIN_DECADES = 0.7
# Slope d ln E'/d ln ω below which the storage modulus of a pair is too flat to be matched.
_FLAT_SLOPE = 2e-3
_NNLS_STEPS_PER_COLUMN = 40


@dataclass(frozen=True, slots=True)
class _Pair:
    """Two neighbouring isotherms, colder first, as rows relative to the measured values."""

    ln_omega: tuple[Array, Array]
    storage: tuple[Array, Array]
    loss: tuple[Array, Array]
    difference: float


def scanned_shifts(points: Points, temperature: Array, ln_bT: Array) -> Array:
    """Chain the pairwise scans into log10 a_T (isotherm,), zero at the warmest isotherm."""
    return _chained(points, temperature, ln_bT, _scanned_step)


def overlapped_shifts(points: Points, temperature: Array, ln_bT: Array) -> Array:
    """Chain the steps that continue the storage modulus; zero at the warmest isotherm."""
    return _chained(points, temperature, ln_bT, _overlapped_step)


def _chained(
    points: Points, temperature: Array, ln_bT: Array, step: "Callable[[_Pair], float]"
) -> Array:
    """Add up the steps from the warmest isotherm to colder ones."""
    order = np.argsort(temperature)
    steps = [
        step(_pair(points, temperature, ln_bT, cold, warm))
        for cold, warm in pairwise(order.tolist())
    ]
    shifts = np.zeros(temperature.size)
    shifts[order[:-1]] = np.cumsum(steps[::-1])[::-1]
    return shifts


def _pair(points: Points, temperature: Array, ln_bT: Array, cold: int, warm: int) -> _Pair:
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
    slopes = [
        np.polyfit(x, y, 1)[0] if x.size > 1 else 0.0
        for x, y in ((cold_x, cold_y), (warm_x, warm_y))
    ]
    slope = max(float(np.mean(slopes)), _FLAT_SLOPE)
    jump = float(np.mean(cold_y) - np.mean(warm_y)) - slope * float(
        np.mean(cold_x) - np.mean(warm_x)
    )
    return float(np.clip(jump / slope / _LN10, mean - 3 * spread, mean + 3 * spread))


def _scanned_step(pair: _Pair) -> float:
    """Return the step with the least misfit of one spectrum to both isotherms."""
    ln_time, scale = _pair_terms(pair)
    fixed = _relative_rows(pair.ln_omega[0], pair.storage[0], pair.loss[0], ln_time) * scale
    mean, spread = _expected(pair.difference)

    def fitted(step: float) -> tuple[float, int]:
        ln_omega = pair.ln_omega[1] - step * _LN10
        moving = _relative_rows(ln_omega, pair.storage[1], pair.loss[1], ln_time) * scale
        design = np.vstack([fixed, moving])
        steps = _NNLS_STEPS_PER_COLUMN * scale.size
        weight, rest = nnls(design, np.ones(design.shape[0]), maxiter=steps)
        return float(rest) ** 2, int(np.count_nonzero(weight))

    runs = [fitted(step) for step in _STEPS]
    costs, terms = (np.array(column) for column in zip(*runs, strict=True))
    rows = 2.0 * (pair.ln_omega[0].size + pair.ln_omega[1].size)
    noise = max(float(np.min(costs / np.maximum(rows - terms, 1.0))), float(np.finfo(float).tiny))
    # Isotherms that are torn apart have a spectrum each: what more terms gain is not the step's.
    k = int(np.argmin(costs / noise + 2.0 * terms + ((_STEPS - mean) / spread) ** 2))
    fine = _STEPS[k] + _COARSE * np.array([-0.5, 0.0, 0.5])
    score = np.array([fitted(fine[0])[0], costs[k], fitted(fine[2])[0]]) / noise
    return _vertex(fine, score + ((fine - mean) / spread) ** 2)


def _vertex(x: Array, y: Array) -> float:
    """Return where the parabola through three equally spaced points is lowest, inside them."""
    curvature = y[0] - 2.0 * y[1] + y[2]
    if curvature <= 0:
        return float(x[np.argmin(y)])
    move = 0.5 * (y[0] - y[2]) / curvature
    return float(x[1] + np.clip(move, -1.0, 1.0) * (x[1] - x[0]))


def _pair_terms(pair: _Pair) -> tuple[Array, Array]:
    """Return a grid of times that covers every trial step, and the unit of the weights."""
    cold, warm = pair.ln_omega
    low = min(cold.min(), warm.min() - _STEPS[-1] * _LN10) - _MARGIN_DECADES * _LN10
    high = max(cold.max(), warm.max() - _STEPS[0] * _LN10) + _MARGIN_DECADES * _LN10
    ln_time = np.arange(-high, -low, _LN10 / _TERMS_PER_DECADE)
    typical = float(np.sqrt(pair.storage[0].mean() * pair.storage[1].mean()))
    return ln_time, np.full(ln_time.size + 1, typical)


def _relative_rows(ln_omega: Array, storage: Array, loss: Array, ln_time: Array) -> Array:
    """Design rows of one isotherm divided by its measured moduli."""
    storage_shape, loss_shape = maxwell_shapes(ln_omega, ln_time)
    upper = np.column_stack([storage_shape, np.ones(ln_omega.size)]) / storage[:, None]
    lower = np.column_stack([loss_shape, np.zeros(ln_omega.size)]) / loss[:, None]
    return np.vstack([upper, lower])

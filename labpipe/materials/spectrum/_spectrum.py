r"""One non-negative, smooth relaxation spectrum through complex moduli.

The unknowns are weights of Prony terms on a fixed logarithmic grid of times, and the relaxed
modulus. Three things keep the answer stable:

- rows are divided by the expected size of their noise, so that a rubbery plateau counts as much
  as the glassy one;
- every weight is measured in units of the loss modulus at ω = 1/τ, so that the penalty on second
  differences acts on numbers of order one and does not flatten the weak end of the spectrum;
- weights are not negative (thermodynamics), and the strength of the penalty is chosen by
  generalised cross-validation, never fixed.

The tall system is compressed by a QR factorisation once; each strength of the penalty then costs
one small non-negative least squares.

References
----------
Golub, Heath & Wahba, Technometrics 21 (1979) 215, doi:10.1080/00401706.1979.10489751.
Baumgaertel & Winter, Rheol. Acta 28 (1989) 511, doi:10.1007/BF01332922.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from labpipe.arrays import Floats

#: Terms per decade. One is too coarse (3-4 % on the loss of a broad material), two serve for use,
#: three leave no error on any broad material; each further one costs a factor 8 in condition.
TERMS_PER_DECADE = 3
#: Terms reach this many decades beyond the covered frequencies at either end. A loss that goes on as
#: flat as it ends, as that of a glass, has the share (2/π) 10^-d from times more than d decades
#: beyond: 13 % for 0.7 decades, by which the spectrum was wrong near its ends; 2 % for 1.5.
MARGIN_DECADES = 1.5
# The smoothing strengths that cross-validation looks at first (residuals in units of the noise):
# from hardly any to a straight line; then it walks by half decades.
_STRENGTHS = tuple(float(s) for s in np.logspace(-4.0, 5.0, 10))
_STRENGTH_STEP = 10.0**0.5
_MAX_WALK = 12
#: Lawson-Hanson needs about one step per column; the bound only guards against cycling.
NNLS_STEPS_PER_COLUMN = 40
# Exchanges of zero weights before a nearby problem counts as a new one, and the relative size of
# a gradient that counts as zero.
_MAX_EXCHANGES = 8
_KKT_TOLERANCE = 1e-9
_LN10 = float(np.log(10.0))


@dataclass(frozen=True, slots=True)
class Grid:
    """The times of the terms, the units of their weights, and the penalty.

    ``ln_time`` (term,): Natural logarithm of the relaxation times in s, ascending. ``scale`` (term + 1,) [Pa]: Unit
    of every weight; the last entry is the unit of the relaxed modulus. ``penalty`` (row, term + 1): Second
    differences over neighbouring terms.
    """

    ln_time: Floats
    scale: Floats
    penalty: Floats


@dataclass(frozen=True, slots=True)
class Solution:
    """Solution of one penalised non-negative least-squares problem.

    ``coefficient`` (column,): In the units of the grid. ``strength``: Weight of the penalty. ``misfit``: Sum of
    squared residuals of the data. ``roughness``: Penalty paid, strength included; misfit + roughness is what was
    minimised. ``freedom``: Effective number of coefficients: trace of the influence of the data on the fit.
    """

    coefficient: Floats
    strength: float
    misfit: float
    roughness: float
    freedom: float


def maxwell_shapes(ln_omega: Floats, ln_time: Floats) -> tuple[Floats, Floats]:
    """Return storage x²/(1+x²) and loss x/(1+x²) of every term at every frequency, x = ωτ."""
    exponent = ln_omega[:, None] + ln_time[None, :]
    small = np.exp(-np.abs(exponent))
    share = 1.0 / (1.0 + small * small)
    return np.where(exponent > 0, share, 1.0 - share), small * share


def moduli_of_terms(ln_omega: Floats, ln_time: Floats) -> Floats:
    """Return storage and, below it, loss (2 point, term + 1) of every term and of the relaxed modulus at weight one."""
    storage, loss = maxwell_shapes(ln_omega, ln_time)
    constant = np.ones((ln_omega.size, 1))
    return np.vstack([np.hstack([storage, constant]), np.hstack([loss, 0.0 * constant])])


def make_grid(ln_omega: Floats, storage: Floats, loss: Floats, terms_per_decade: float = TERMS_PER_DECADE) -> Grid:
    """Lay terms over the covered frequencies, in any order, and scale them by the local loss modulus."""
    step = _LN10 / terms_per_decade
    low = -float(np.max(ln_omega)) - MARGIN_DECADES * _LN10
    high = -float(np.min(ln_omega)) + MARGIN_DECADES * _LN10
    count = int(np.ceil((high - low) / step)) + 1
    middle = 0.5 * (low + high)
    ln_time = np.asarray(middle + step * (np.arange(count) - 0.5 * (count - 1)))
    # The logarithm of the loss, averaged in a Gaussian window; far outside, the nearest points count.
    square = (ln_time[:, None] + ln_omega[None, :]) ** 2 / (2.0 * (1.5 * step) ** 2)
    weight = np.exp(-(square - square.min(axis=1, keepdims=True)))
    scale = np.exp((weight @ np.log(loss)) / weight.sum(axis=1))
    scale, penalty = np.append(scale, np.min(storage)), second_differences(count, count + 1, terms_per_decade)
    return Grid(ln_time, scale, penalty)


def second_differences(terms: int, columns: int, terms_per_decade: float) -> Floats:
    """Second differences of the weights, times ppd^1.5 so that the strength keeps its meaning."""
    rows = np.arange(max(terms - 2, 0))
    matrix = np.zeros((rows.size, columns))
    matrix[rows, rows] = 1.0
    matrix[rows, rows + 1] = -2.0
    matrix[rows, rows + 2] = 1.0
    return matrix * terms_per_decade**1.5


def compress(rows: Floats, target: Floats) -> tuple[Floats, Floats, float]:
    """Reduce a tall system to a triangular one with the same solutions, and the sum of squares that none reduces."""
    columns = rows.shape[1]
    factor = np.asarray(np.linalg.qr(np.column_stack([rows, target]), mode="r"))
    remainder = float(np.sum(factor[columns:, columns] ** 2))
    return factor[:columns, :columns], factor[:columns, columns], remainder


def solve(triangle: Floats, projected: Floats, remainder: float, penalty: Floats, strength: float) -> Solution:
    """Solve one penalised problem of a compressed system."""
    root = np.sqrt(strength)
    stacked = np.vstack([triangle, root * penalty])
    target = np.concatenate([projected, np.zeros(penalty.shape[0])])
    coefficient, _ = nnls(stacked, target, maxiter=NNLS_STEPS_PER_COLUMN * stacked.shape[1])
    active = coefficient > 0
    misfit = remainder + float(np.sum((projected - triangle @ coefficient) ** 2))
    roughness = strength * float(np.sum((penalty @ coefficient) ** 2))
    data = triangle[:, active].T @ triangle[:, active]
    total = data + strength * penalty[:, active].T @ penalty[:, active]
    freedom = float(np.trace(solve_normal(total, data)))
    return Solution(coefficient, strength, misfit, roughness, freedom)


def solve_nearby(rows: Floats, target: Floats, gram: Floats, penalty: Floats, guess: Solution) -> Solution | None:
    """Solve a problem like one solved before, exchanging only few of its zero weights.

    The conditions of the optimum are checked in full; None when they are not met within a few
    exchanges, and the problem has to be solved from nothing. Saves nine tenths of the time.
    ``gram`` is rows.T @ rows.
    """
    projected = rows.T @ target
    total = gram + guess.strength * penalty.T @ penalty
    active = guess.coefficient > 0
    tolerance = _KKT_TOLERANCE * float(np.max(np.abs(projected)))
    for _ in range(_MAX_EXCHANGES):
        coefficient = np.zeros(active.size)
        coefficient[active] = solve_normal(total[np.ix_(active, active)], projected[active])
        negative = active & (coefficient <= 0)
        wanted = ~active & (projected - total @ coefficient > tolerance)
        if negative.any():
            active = active & ~negative
        elif wanted.any():
            active = active | wanted
        else:
            data = gram[np.ix_(active, active)]
            return Solution(
                coefficient,
                guess.strength,
                float(np.sum((target - rows @ coefficient) ** 2)),
                guess.strength * float(np.sum((penalty @ coefficient) ** 2)),
                float(np.trace(solve_normal(total[np.ix_(active, active)], data))),
            )
    return None


def solve_normal(matrix: Floats, right: Floats) -> Floats:
    """Solve a symmetric system; of a singular one the shortest solution."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


def solve_by_cross_validation(
    triangle: Floats, projected: Floats, remainder: float, penalty: Floats, rows: int, near: float | None = None
) -> Solution:
    """Choose the strength of the penalty by generalised cross-validation.

    ``rows``: number of data before the compression; ``near``: a strength to walk downhill from, without which all
    decades are looked at first.
    """

    def scored(strength: float) -> tuple[float, Solution]:
        found = solve(triangle, projected, remainder, penalty, strength)
        return found.misfit / max(rows - found.freedom, 1.0) ** 2, found

    start = [near] if near else _STRENGTHS
    best, solution = min((scored(s) for s in start), key=lambda pair: pair[0])
    for factor in (_STRENGTH_STEP, 1.0 / _STRENGTH_STEP):
        for _ in range(_MAX_WALK):
            score, candidate = scored(solution.strength * factor)
            if score >= best:
                break
            best, solution = score, candidate
    return solution

r"""Exact conversion between the relaxation and the retardation terms of one material.

The two families of a linear viscoelastic solid are tied by :math:`E^*(s)\,J^*(s) = 1`. The poles
of one are the zeros of the other, and zeros and poles alternate along the time axis. With the
rates :math:`z = 1/\tau` and :math:`p_j = 1/\rho_j` the zeros of the modulus solve

.. math:: c_0 - c_1 z + \sum_j w_j \frac{z}{z - p_j} = 0

(:math:`c_0` the relaxed modulus, :math:`c_1` the viscosity of a parallel dashpot). The zeros of
the compliance solve *the same* equation in times instead of rates, with the unrelaxed compliance
for :math:`c_0` and the fluidity for :math:`c_1`, so one solver serves both directions.

Why offsets. A weak term moves its zero by as little as :math:`10^{-13}` of the pole, and the
weight of the converted term is proportional to that distance. Storing a root as a number loses
the distance; here each root is kept as (nearest pole, offset), the offset is what is solved for,
and the weights are sums of positive numbers in it, so that nothing cancels.

References
----------
Park & Schapery, Int. J. Solids Struct. 36 (1999) 1653, doi:10.1016/S0020-7683(98)00060-2.
Li, LAPACK Working Note 89 (1993), for the secular equation and its rational steps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats

# The rational steps converge quadratically (5 to 12 in practice); the bisection that guards them
# halves a logarithm, so that this bound is never met by admissible terms.
_MAX_STEPS = 200
# While nothing is known below, the guard looks this much nearer to the pole.
_INWARD = 1e-3
# Relative distance below which two times are one; a modulus changes by half of that at most.
_SAME_TIME = 1e-10
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, slots=True)
class Relaxation:
    """Relaxation family: E(t) = relaxed + Σ weight exp(−t/time), and a parallel dashpot.

    Attributes
    ----------
    relaxed : float [Pa]
        Long-time modulus; 0 for a liquid.
    weight : array (term,) [Pa]
    time : array (term,) [s]
        Relaxation times, ascending.
    viscosity : float [Pa s]
        Dashpot in parallel with everything; not zero only when the instantaneous compliance is.
    """

    relaxed: float
    weight: Floats
    time: Floats
    viscosity: float = 0.0


@dataclass(frozen=True, slots=True)
class Retardation:
    """Retardation family: J(t) = unrelaxed + Σ weight (1 − exp(−t/time)) + fluidity t.

    Attributes
    ----------
    unrelaxed : float [1/Pa]
        Instantaneous compliance; 0 for a material without an instantaneous answer.
    weight : array (term,) [1/Pa]
    time : array (term,) [s]
        Retardation times, ascending.
    fluidity : float [1/(Pa s)]
        Flow at long times; not zero only when the relaxed modulus is zero.
    """

    unrelaxed: float
    weight: Floats
    time: Floats
    fluidity: float = 0.0


def merged(weight: Floats, time: Floats) -> tuple[Floats, Floats]:
    """Sort terms by time, drop zero weights, and add up the weights of equal times.

    Times that agree to :data:`_SAME_TIME` are equal: no modulus tells them apart, while the digits
    in which they differ would be all that the converted weights rest on.

    Examples
    --------
    >>> merged(np.array([1.0, 0.0, 2.0, 3.0]), np.array([5.0, 7.0, 1.0, 5.0]))
    (array([2., 4.]), array([1., 5.]))
    """
    kept = np.flatnonzero(weight > 0)
    order = kept[np.argsort(time[kept], kind="stable")]
    ordered = time[order]
    begins = np.concatenate([[True], np.diff(ordered) > _SAME_TIME * ordered[1:]])[: ordered.size]
    starts = np.flatnonzero(begins)
    if starts.size == 0:
        return np.zeros(0), np.zeros(0)
    return np.add.reduceat(weight[order], starts), ordered[starts]


def creep_from_relaxation(family: Relaxation) -> Retardation:
    """Convert relaxation terms to retardation terms.

    Parameters
    ----------
    family : Relaxation
        Positive weights over distinct ascending times (see :func:`merged`).

    Returns
    -------
    Retardation
        One term per interlaced gap. A relaxed modulus of zero gives one term fewer and a flow.

    Examples
    --------
    >>> solid = Relaxation(1.0, np.array([1.0]), np.array([2.0]))
    >>> creep_from_relaxation(solid)
    Retardation(unrelaxed=0.5, weight=array([0.5]), time=array([4.]), fluidity=0.0)
    """
    rate_order = slice(None, None, -1)
    if family.time.size == 0:
        return Retardation(*_spring_and_dashpot(family.relaxed, family.viscosity, rate=True))
    weight, time = family.weight[rate_order], family.time[rate_order]
    # Ratios of rates are ratios of times upside down, so no rate is ever rounded.
    relative = time[None, :] / time[:, None]
    offset_ratio = (time[None, :] - time[:, None]) / time[:, None]
    root = _zeros(family.relaxed, family.viscosity, weight, 1.0 / time, relative, offset_ratio)
    stiffness = family.relaxed + float(np.sum(family.weight))
    flow = family.viscosity + float(family.weight @ family.time)
    return Retardation(
        unrelaxed=0.0 if family.viscosity > 0 else 1.0 / stiffness,
        weight=root.weight[rate_order],
        time=(time[root.origin] / root.place)[rate_order],
        fluidity=0.0 if family.relaxed > 0 else 1.0 / flow,
    )


def relaxation_from_creep(family: Retardation) -> Relaxation:
    """Convert retardation terms to relaxation terms.

    Parameters
    ----------
    family : Retardation
        Positive weights over distinct ascending times (see :func:`merged`).

    Returns
    -------
    Relaxation
        One term per interlaced gap. An unrelaxed compliance of zero gives one term fewer and a
        parallel dashpot.

    Examples
    --------
    >>> solid = Retardation(0.5, np.array([0.5]), np.array([4.0]))
    >>> relaxation_from_creep(solid)
    Relaxation(relaxed=1.0, weight=array([1.]), time=array([2.]), viscosity=0.0)
    """
    time = family.time
    if time.size == 0:
        return Relaxation(*_spring_and_dashpot(family.unrelaxed, family.fluidity, rate=False))
    relative = time[:, None] / time[None, :]
    offset_ratio = (time[:, None] - time[None, :]) / time[None, :]
    root = _zeros(family.unrelaxed, family.fluidity, family.weight, time, relative, offset_ratio)
    softness = family.unrelaxed + float(np.sum(family.weight))
    spread = family.fluidity + float(np.sum(family.weight / time))
    return Relaxation(
        relaxed=0.0 if family.fluidity > 0 else 1.0 / softness,
        weight=root.weight,
        time=time[root.origin] * root.place,
        viscosity=0.0 if family.unrelaxed > 0 else 1.0 / spread,
    )


@dataclass(frozen=True, slots=True)
class _Roots:
    """Zeros of the secular equation as ``place`` × the pole ``origin``, and converted weights."""

    origin: NDArray[np.intp]
    place: Floats
    weight: Floats


@dataclass(slots=True)
class _Gaps:
    """One row per root: where it lies, in units of its nearest pole.

    The root is ``scale (base + sign distance)``; pole j lies at ``scale (base + pole[row, j])``;
    ``scale`` is the pole number ``origin``.
    """

    origin: NDArray[np.intp]
    scale: Floats
    base: Floats
    sign: Floats
    pole: Floats
    left: Flags  # (row, j): pole j lies below the root
    upper: Floats  # the distance is at most this


def _zeros(
    constant: float, slope: float, weight: Floats, poles: Floats, relative: Floats, offset_ratio: Floats
) -> _Roots:
    """Solve constant − slope x + Σ w x/(x − p) = 0 for all x > 0 (poles ascending).

    ``relative[j, o]`` is p_j/p_o and ``offset_ratio[j, o]`` is p_j/p_o − 1, each rounded once.
    """
    gaps = _gaps(constant, slope, weight, poles, relative, offset_ratio)
    distance = _solve(constant, slope, weight, gaps)
    place = gaps.base + gaps.sign * distance
    # Distances from the poles straight from the offsets: this is where the digits are saved.
    away = (gaps.sign * distance)[:, None] - gaps.pole
    pole_place = gaps.base[:, None] + gaps.pole
    total = np.sum(weight * place[:, None] * pole_place / away**2, axis=1)
    return _Roots(gaps.origin, place, 1.0 / (total + slope * poles[gaps.origin] * place))


def _spring_and_dashpot(constant: float, slope: float, *, rate: bool) -> tuple[float, Floats, Floats, float]:
    """Convert a family without terms: a spring, a dashpot, or both side by side."""
    if constant > 0 and slope > 0:
        time = slope / constant if rate else constant / slope
        return 0.0, np.array([1.0 / constant]), np.array([time]), 0.0
    nothing = np.empty(0)
    return ((1.0 / constant if constant > 0 else 0.0), nothing, nothing, (1.0 / slope if slope > 0 else 0.0))


def _gaps(
    constant: float, slope: float, weight: Floats, poles: Floats, relative: Floats, offset_ratio: Floats
) -> _Gaps:
    """Choose for every root the nearer end of its gap as origin."""
    n = poles.size
    # A relaxed modulus of zero puts the first root at x = 0: it is the flow, not a term.
    first = 0 if constant > 0 else 1
    upper_pole = np.arange(first, n)
    is_first = upper_pole == 0
    below = np.maximum(upper_pole - 1, 0)
    base = np.where(is_first, 0.0, 1.0)
    # Sign of the function in the middle of each gap, seen from the left end.
    left_origin = np.where(is_first, 0, below)
    pole = np.where(is_first[:, None], relative[:, left_origin].T, offset_ratio[:, left_origin].T)
    scale = poles[left_origin]
    rows = np.arange(upper_pole.size)
    half = 0.5 * pole[rows, upper_pole]
    place = base + half
    middle = np.sum(weight * place[:, None] / (half[:, None] - pole), axis=1)
    middle += constant - slope * scale * place
    is_right = middle > 0
    index = np.arange(n)
    origin = np.where(is_right, upper_pole, left_origin)
    gaps = _Gaps(
        origin=origin,
        scale=poles[origin],
        base=np.where(is_right, 1.0, base),
        sign=np.where(is_right, -1.0, 1.0),
        pole=np.where(is_right[:, None], offset_ratio[:, upper_pole].T, pole),
        left=index[None, :] < upper_pole[:, None],
        upper=np.where(is_right, -0.5 * offset_ratio[below, upper_pole], half),
    )
    # The first gap begins at zero, where there is no pole.
    gaps.upper = np.where(is_right & is_first, 0.5, gaps.upper)
    return _with_last_gap(gaps, constant, slope, weight, poles, offset_ratio) if slope > 0 else gaps


def _with_last_gap(
    gaps: _Gaps, constant: float, slope: float, weight: Floats, poles: Floats, offset_ratio: Floats
) -> _Gaps:
    """Append the root beyond the last pole, which a parallel dashpot (or a flow) brings."""
    last = poles[-1]
    reach = max(1.0, 2.0 * (constant + 2.0 * float(np.sum(weight))) / (slope * last))
    return _Gaps(
        origin=np.append(gaps.origin, poles.size - 1),
        scale=np.append(gaps.scale, last),
        base=np.append(gaps.base, 1.0),
        sign=np.append(gaps.sign, 1.0),
        pole=np.vstack([gaps.pole, offset_ratio[:, -1][None, :]]),
        left=np.vstack([gaps.left, np.ones((1, poles.size), dtype=bool)]),
        upper=np.append(gaps.upper, reach),
    )


def _solve(constant: float, slope: float, weight: Floats, gaps: _Gaps) -> Floats:
    """Find the distance of every root from its origin to full relative accuracy."""
    low = np.zeros(gaps.scale.size)
    high = gaps.upper.copy()
    distance = _first_guess(constant, slope, weight, gaps)
    for _ in range(_MAX_STEPS):
        value, step = _rational_step(constant, slope, weight, gaps, distance)
        # The function falls with x: positive means that the root lies further up.
        outward = (value > 0) == (gaps.sign > 0)
        low = np.where(outward, distance, low)
        high = np.where(outward, high, distance)
        inside = (step > low) & (step < high)
        middle = np.where(low > 0, np.sqrt(low) * np.sqrt(high), _INWARD * high)
        proposal = np.where(inside, step, middle)
        settled = (np.abs(step - distance) <= 2 * _EPS * distance) | (value == 0)
        settled |= high - low <= 2 * _EPS * high
        distance = np.where(settled, distance, proposal)
        if settled.all():
            break
    return distance


def _first_guess(constant: float, slope: float, weight: Floats, gaps: _Gaps) -> Floats:
    """Balance the pole at the origin against everything else, taken at the origin.

    Exact in the limit of a weak pole, however weak, where a step from afar would cancel.
    """
    rows = np.arange(gaps.scale.size)
    at_zero = gaps.base == 0
    line = slope * gaps.scale
    others = gaps.pole.copy()
    others[rows[~at_zero], gaps.origin[~at_zero]] = np.inf
    # From a pole: w/distance against the rest. From zero: the constant against the rest's slope.
    rest = np.abs(constant - np.sum(weight * gaps.base[:, None] / others, axis=1) - line)
    rise = np.sum(weight / others, axis=1) + line
    top = np.where(at_zero, constant, weight[gaps.origin])
    bottom = np.where(at_zero, rise, rest)
    guess = top / np.where(bottom > 0, bottom, 1.0)
    return np.where((guess > 0) & (guess < gaps.upper), guess, 0.5 * gaps.upper)


def _rational_step(
    constant: float, slope: float, weight: Floats, gaps: _Gaps, distance: Floats
) -> tuple[Floats, Floats]:
    """Evaluate the function, and the root of its two-pole model that matches value and slope.

    The poles below are lumped into r + s/(x − pole), those above likewise. The model's root
    solves a quadratic, written for the *correction*: its coefficients then do not cancel.
    """
    offset = gaps.sign * distance
    place = gaps.base + offset
    away = offset[:, None] - gaps.pole
    term = weight * place[:, None] / away
    fall = weight * (gaps.base[:, None] + gaps.pole) / away**2
    line = slope * gaps.scale
    value = constant + np.sum(term, axis=1) - line * place
    fall_below = np.sum(np.where(gaps.left, fall, 0.0), axis=1)
    fall_above = np.sum(np.where(gaps.left, 0.0, fall), axis=1) + line
    # Distances to the poles that enclose the gap; the first gap begins at zero.
    to_lower = offset - np.max(np.where(gaps.left, gaps.pole, -gaps.base[:, None]), axis=1)
    upper = np.min(np.where(gaps.left, np.inf, gaps.pole), axis=1)
    has_upper = np.isfinite(upper)
    to_upper = np.where(has_upper, upper - offset, 1.0)
    below, above = fall_below * to_lower, fall_above * to_upper
    a = np.where(has_upper, below - above - value, -line)
    b = np.where(
        has_upper, value * (to_upper - to_lower) - below * to_upper - above * to_lower, value - below - line * to_lower
    )
    reach = np.where(has_upper, to_upper, np.inf)
    correction = _root_between(a, b, value * to_lower * to_upper, -to_lower, reach)
    return value, distance + gaps.sign * correction


def _root_between(a: Floats, b: Floats, c: Floats, lower: Floats, upper: Floats) -> Floats:
    """Return the smaller root of a x² + b x + c inside (lower, upper), NaN if there is none."""
    with np.errstate(all="ignore"):
        q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(b * b - 4 * a * c, 0.0)), b))
        small, large = c / q, q / a
    found = np.where((large > lower) & (large < upper), large, np.nan)
    return np.where((small > lower) & (small < upper), small, found)

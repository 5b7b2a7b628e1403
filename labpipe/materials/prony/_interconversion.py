r"""Exact conversion between the relaxation and the retardation terms of one material.

The two families of a linear viscoelastic solid are tied by :math:`E^*(s)\,J^*(s) = 1`. The poles
of one are the zeros of the other, and zeros and poles alternate along the time axis. The retardation
times :math:`y` of a relaxation family solve, with :math:`p_j = \rho_j`,

.. math:: c_0 - \frac{c_1}{y} + \sum_j w_j \frac{p_j}{p_j - y} = 0

(:math:`c_0` the relaxed modulus, :math:`c_1` the viscosity of a parallel dashpot). The rates
:math:`y = 1/\rho` of a retardation family solve *the same* equation with :math:`p_j = 1/\tau_j`, with the
unrelaxed compliance for :math:`c_0` and the fluidity for :math:`c_1`, so one solver serves both directions:
LAPACK's of the secular equation.

A weak term moves its zero by as little as :math:`10^{-13}` of the pole, and the
weight of the converted term is proportional to that distance. Storing a root as a number loses
the distance; here each root is kept as (nearest pole, offset), the offset is refined by Newton's method,
and the weights are sums of positive numbers in it, so that nothing cancels.

References
----------
Park & Schapery, Int. J. Solids Struct. 36 (1999) 1653, doi:10.1016/S0020-7683(98)00060-2.
Li, LAPACK Working Note 89 (1993), for the secular equation.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dlasd4
from scipy.optimize import brentq

from labpipe.arrays import Floats

# Relative distance below which two times are one; a modulus changes by half of that at most.
_SAME_TIME = 1e-10
# Newton's steps from LAPACK's roots, which are those of poles rounded to their square roots, and the distance from a
# pole, of that to the next one, below which all others hardly change up to the root.
_STEPS, _WEAK = 3, 1e-6


@dataclass(frozen=True, slots=True)
class Relaxation:
    """Relaxation family: E(t) = relaxed + Σ weight exp(−t/time), and a parallel dashpot, in SI units.

    ``relaxed`` is 0 for a liquid; ``time`` (term,) ascends; ``viscosity`` is not zero only when the instantaneous
    compliance is.
    """

    relaxed: float
    weight: Floats
    time: Floats
    viscosity: float = 0.0


@dataclass(frozen=True, slots=True)
class Retardation:
    """Retardation family: J(t) = unrelaxed + Σ weight (1 − exp(−t/time)) + fluidity t, in SI units.

    ``unrelaxed`` is 0 for a material without an instantaneous answer; ``time`` (term,) ascends; ``fluidity`` is not
    zero only when the relaxed modulus is.
    """

    unrelaxed: float
    weight: Floats
    time: Floats
    fluidity: float = 0.0


def merged(weight: Floats, time: Floats) -> tuple[Floats, Floats]:
    """Sort terms by time, drop zero weights, and add up the weights of equal times.

    Times that agree to :data:`_SAME_TIME` are equal: no modulus distinguishes them, while the digits
    in which they differ would be all that the converted weights rest on.
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
    """Convert relaxation terms, positive over distinct ascending times (:func:`merged`), to retardation terms.

    There is one per interlaced gap. A relaxed modulus of zero gives one term fewer and a flow.
    """
    time = family.time
    offset = (time[:, None] - time[None, :]) / time[None, :]
    weight, scale, place = _zeros(family.relaxed, family.viscosity, family.weight, time, offset)
    stiffness = family.relaxed + float(np.sum(family.weight))
    flow = family.viscosity + float(family.weight @ time)
    return Retardation(
        unrelaxed=0.0 if family.viscosity > 0 else 1.0 / stiffness,
        weight=weight,
        time=scale * place,
        fluidity=0.0 if family.relaxed > 0 else 1.0 / flow,
    )


def relaxation_from_creep(family: Retardation) -> Relaxation:
    """Convert retardation terms, positive over distinct ascending times (:func:`merged`), to relaxation terms.

    There is one per interlaced gap. An unrelaxed compliance of zero gives one term fewer and a parallel dashpot.
    """
    time = family.time[::-1]
    # Ratios of rates are ratios of times upside down, so that no rate is rounded.
    offset = (time[None, :] - time[:, None]) / time[:, None]
    weight, scale, place = _zeros(family.unrelaxed, family.fluidity, family.weight[::-1], 1.0 / time, offset)
    softness = family.unrelaxed + float(np.sum(family.weight))
    spread = family.fluidity + float(np.sum(family.weight / family.time))
    return Relaxation(
        relaxed=0.0 if family.fluidity > 0 else 1.0 / softness,
        weight=weight[::-1],
        time=(1.0 / scale / place)[::-1],
        viscosity=0.0 if family.unrelaxed > 0 else 1.0 / spread,
    )


def _zeros(
    constant: float, slope: float, weight: Floats, poles: Floats, offset: Floats
) -> tuple[Floats, Floats, Floats]:
    """Solve constant - slope / y + sum of w p / (p - y) = 0 for all y > 0 (poles ascending).

    ``offset[j, o]`` is p_j / p_o - 1, rounded once. Returns the converted weights, and every root as a pole times a
    place.
    """
    # A parallel dashpot is a pole at zero; every pole has a root above it.
    first = int(slope > 0)
    every = kept = np.append(np.zeros(first), poles)
    strength = np.append(np.full(first, slope), weight * poles)
    if constant > 0:
        strength = strength / constant
    else:
        # One root is at infinity; the equation over its last term has the others.
        kept, share = every[:-1], strength[:-1] / strength[-1]
        strength = share * (every[-1] - kept) / (1.0 + float(np.sum(share)))
    count, total = kept.size, float(np.sum(strength))
    away = np.empty((count, count))  # p_j - y of every root
    for i in range(count - 1):
        below, _, above, _ = dlasd4(i, np.sqrt(kept), np.sqrt(strength / total), total)
        away[i] = below * above
    if count:
        # The last root lies beyond all poles, by any number of decades.
        ends = float(strength[-1]), total
        from_last = kept[-1] - kept

        def missing(u: float) -> float:
            return 1.0 - float(np.sum(strength / (from_last + u)))

        is_alone = missing(ends[0]) >= 0.0 or missing(total) <= 0.0
        away[-1] = -from_last - (ends[0] if is_alone else brentq(missing, *ends, xtol=1e-300, rtol=1e-12, maxiter=2000))
    if count and not constant > 0:
        away = np.column_stack([away, every[-1] - kept[-1] + away[:, -1]])
    rows, nearest = np.arange(count), np.argmin(np.abs(away), axis=1) if count else np.zeros(0, dtype=int)
    # Places count from the nearest pole, in its own units; from zero in those of the first pole.
    base, origin = (nearest >= first).astype(float), np.maximum(nearest - first, 0)
    scale = poles[origin] if poles.size else np.ones(count)
    far = offset[:, origin].T if poles.size else np.zeros((count, 0))
    relative, s = poles / scale[:, None], -away[rows, nearest] / scale
    if poles.size:
        # A weak pole balances all others, taken at its place.
        others = far.copy()
        others[rows, origin] = np.inf
        weak = weight[origin] / (constant - slope / scale + np.sum(weight * relative / others, axis=1))
        s = np.where((base > 0) & (np.abs(s) < _WEAK * np.min(np.abs(others), axis=1, initial=1.0)), weak, s)
    for _ in range(_STEPS):
        gap = np.where(base[:, None] > 0, far, relative) - s[:, None]
        value = constant - slope / (scale * (base + s)) + np.sum(weight * relative / gap, axis=1)
        rise = slope / (scale * (base + s) ** 2) + np.sum(weight * relative / gap**2, axis=1)
        s = s - s * value / (value + s * rise)
    gap = np.where(base[:, None] > 0, far, relative) - s[:, None]
    place = base + s
    squares = np.sum(weight * place[:, None] * relative / gap**2, axis=1) + slope / (scale * place)
    return 1.0 / squares, scale, place

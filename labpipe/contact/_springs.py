r"""Nested contact as a bed of independent springs: no linear solve, no iteration, no FFT per step.

As long as the contact is one interval (or disc) around a fixed centre, at all times, the hereditary
contact problem separates. With the influence matrix ordered from the centre outwards and factored
once, M = L Lᵀ, each row j of the factor is a spring with its own length and stiffness,

.. math::
    J^* * q_j = \delta - g_j \ \text{while in contact}, \quad q_j \ge 0, \qquad
    F = \sum_j \Delta S_j q_j, \qquad
    g = \frac{L^{-1} w f}{L^{-1} w}, \quad \Delta S = \Delta x\,(L^{-1} w)^2,

where f is the profile and w counts how often a strip occurs in the period (the half period is
folded). The spring of a strip opens exactly when the strip's pressure as last of the contact
vanishes, so the sign of q is the active-set test. Pressures are needed for output only:
p = L⁻ᵀ (L⁻¹w · q). A sphere has the same structure with closed forms (method of dimensionality
reduction), see :func:`sphere_bed`; so has the half-plane, see :mod:`labpipe.contact.line`.

Two corrections make the bed fourth-order accurate in the strip width where a plain sum of strips
is first order in the contact width (staircase) and second order in force:

- *edge*: the force is the Euler-Maclaurin sum over the springs with the edge located between two of
  them (second Bernoulli polynomial of the edge's position), so force and width are continuous;
- *profile*: collocation at the strip's centre sees a curved profile Δx² f″/48 too low (half way to
  the strip's mean Δx² f″/24); found against the closed form, where the error left is 4e-6 in force
  at 20 strips per half width and 4e-8 at 100.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean
from labpipe.errors import InputError

# The edge of the contact lies this fraction of a strip inside the strip whose pressure vanishes
# (limit of many strips; calibrated on the closed form of the parabola).
EDGE_OFFSET = 0.17464
# Loads may differ from nested order by rounding only; relative tolerance of a displacement that carries a given force.
_NESTED_TOLERANCE, _EDGE_TOLERANCE = 1e-9, 1e-13


class NotNestedError(Exception):
    """The contact is not one growing and shrinking interval."""


class Answer(NamedTuple):
    """Solution of one step: the load of every spring, and its sum.

    ``force`` and ``half_width`` belong to one tip (per unit depth for a line contact).
    """

    load: Floats
    force: float
    displacement: float
    half_width: float


@dataclass(frozen=True, slots=True)
class SpringBed:
    """Springs in the order in which they come into contact, for E* = 1.

    ``gap`` (spring,) [m]: approach at which the spring is first touched (elastic contact), ascending; ``stiffness``
    (spring,): its part of the stiffness, ΔS: dimensionless for a line, m for a sphere; ``edge`` (spring,) [m]: contact
    half width (radius) at which it is first touched; ``open_springs``: the contact must leave so many springs open, 0
    where full contact is allowed; ``limit``: the message when it does not; ``full_width`` [m]: contact half width with
    every spring in contact.
    """

    gap: Floats
    stiffness: Floats
    edge: Floats
    open_springs: int
    limit: str
    full_width: float = np.nan

    @property
    def size(self) -> int:
        """Number of springs."""
        return int(self.gap.size)

    def inner(self, left: Floats, right: Floats) -> Floats:
        """Energy products (...,) of load vectors (..., spring)."""
        return np.asarray((left * right) @ self.stiffness)

    def press(self, history: Floats, compliance: float, displacement: float, before: float) -> Answer:
        """Solve at a prescribed displacement.

        ``history`` (spring,) [m] is the displacement that the springs would show now without load, ``compliance``
        [1/Pa] that of this step; ``displacement`` and ``before`` [m], the approach now and at the start of the step,
        determine whether the contact grows. A spring that is touched before one nearer to the centre, or carries more,
        raises NotNestedError, a contact that reaches the end of the bed InputError.
        """
        load = np.empty(self.size)
        springs = (self.gap, self.stiffness, self.edge)
        shrinks = displacement < before
        touched, force, half_width = pressed(*springs, history, compliance, displacement, shrinks, load)
        if touched < 0:
            raise NotNestedError
        if touched > self.size - self.open_springs:
            raise InputError(self.limit)
        return Answer(load, force, displacement, self.full_width if touched == self.size else half_width)

    def push(self, history: Floats, compliance: float, force: float, before: float) -> Answer:
        """Solve at a prescribed force; at zero force the indenter just touches.

        The displacement is found by the secant method within a bracket; the force is continuous and made of a plain
        sum, which is piecewise linear, and the edge's small part. It begins where the plain sum alone carries the
        force, with the slope of that sum. Errors are those of :meth:`press`.
        """
        threshold = history + self.gap
        if force <= 0.0:
            return Answer(np.zeros(self.size), 0.0, float(threshold.min()), 0.0)
        if np.any(np.diff(threshold) < -_NESTED_TOLERANCE * np.abs(threshold).max()):
            raise NotNestedError
        threshold = np.maximum.accumulate(threshold)
        stiffness = np.cumsum(self.stiffness)
        moment = np.cumsum(self.stiffness * threshold)
        target = force * compliance

        def excess(displacement: float) -> tuple[float, float]:
            touched = max(int(np.searchsorted(threshold, displacement)), 1)
            slope = float(stiffness[touched - 1])
            plain = slope * displacement - float(moment[touched - 1])
            if touched < self.size:
                plain += smooth_edge_force(self.gap, self.stiffness, self.edge, displacement - threshold, touched)
            return plain - target, slope

        low, high = float(threshold[0]), np.inf
        plain = stiffness[:-1] * threshold[1:] - moment[:-1]  # as each next spring is just touched
        last = int(np.searchsorted(plain, target))
        displacement = (target + float(moment[last])) / float(stiffness[last])
        old, old_miss = np.nan, np.nan
        for _ in range(100):
            miss, slope = excess(displacement)
            if abs(miss) <= _EDGE_TOLERANCE * target:
                break
            if (miss - old_miss) * (displacement - old) > 0.0:
                slope = (miss - old_miss) / (displacement - old)
            old, old_miss = displacement, miss
            low, high = (displacement, high) if miss < 0.0 else (low, displacement)
            displacement -= miss / slope
            if not low < displacement < high:
                displacement = 0.5 * (low + high) if np.isfinite(high) else 2.0 * low
            if np.isfinite(high) and high - low <= _EDGE_TOLERANCE * abs(high):
                break
        return self.press(history, compliance, displacement, before)._replace(force=force)


def sphere_bed(radius: float, reach: float, springs: int, gap: Callable[[Floats], Floats] | None = None) -> SpringBed:
    """Springs of a sphere on a half-space by the method of dimensionality reduction, for E* = 1.

    ``radius`` [m]: Of the sphere. ``reach`` [m]: Largest contact radius that will be asked for. ``springs``: Number
    of springs within the reach. ``gap``: Approach [m] of an elastic contact of radius b [m]; the default is b²/R
    (parabola).

    References
    ----------
    Popov and Heß, Method of Dimensionality Reduction in Contact Mechanics and Friction, Springer
    2015, https://doi.org/10.1007/978-3-642-53876-6.

    Examples
    --------
    >>> bed = sphere_bed(1.0, 0.2, 100)
    >>> rest = np.zeros(bed.size)
    >>> answer = bed.press(rest, 1.0, 0.01, 0.0)
    >>> round(answer.force / (4 / 3 * 0.01**1.5), 5), round(answer.half_width, 6)
    (1.0, 0.1)
    """
    spacing = reach / springs
    # Two springs beyond the reach locate an edge that lies exactly on it.
    position = spacing * np.arange(springs + 2, dtype=float)
    stiffness = np.full(position.size, 2.0 * spacing)
    stiffness[0] = spacing
    gaps = position**2 / radius if gap is None else gap(position)
    limit = "the contact reaches the end of the springs; give a larger reach"
    return SpringBed(gaps, stiffness, position, 1, limit)


@lean()
def pressed(
    gap: Floats,
    stiffness: Floats,
    edge: Floats,
    history: Floats,
    compliance: float,
    displacement: float,
    shrinks: bool,
    load: Floats,
) -> tuple[int, float, float]:
    """Press a bed of springs to a displacement [m] and write their ``load`` (spring,).

    Returns the number of springs in contact, -1 if they are not nested; their force (per reduced modulus, and depth of
    a line); and the contact half width [m], NaN where every spring is in contact.
    """
    size, touched = gap.size, 0
    for j in range(size):
        load[j] = (displacement - history[j] - gap[j]) / compliance
        if load[j] > 0.0:
            touched += 1
    force, half_width = 0.0, 0.0
    for j in range(touched):
        if load[j] <= 0.0 or (j > 0 and load[j] - load[j - 1] > _NESTED_TOLERANCE * load[0]):
            return -1, force, half_width
        force += stiffness[j] * load[j]
    if touched == size:
        half_width = math.nan
    elif touched > 0:
        share = _share(gap, load, touched, shrinks)
        force += _edge_force(gap, stiffness, edge, load, touched, share)
        half_width = _width(edge, touched, share)
    for j in range(touched, size):
        load[j] = 0.0
    return touched, force, half_width


@lean()
def smooth_edge_force(gap: Floats, stiffness: Floats, edge: Floats, trial: Floats, touched: int) -> float:
    """Force of the edge as :func:`pressed` adds it, but continuous as springs come and go.

    The share is the place between the inner and the outer spring where the loads of either side,
    linear in the gap, reach zero; the two add up to the cell in a contact that neither relaxes nor
    recovers. Less accurate than the share of one side, which jumps where springs come and go.
    """
    inside, outside = touched - 1, touched
    if touched < 2 or outside + 1 == gap.size:
        share = trial[inside] / (trial[inside] - trial[outside])
    else:
        before = _rest(gap, trial, inside - 1, inside)
        behind = -_rest(gap, trial, outside, outside + 1)
        share = before / max(before + behind, 1e-300)
    return _edge_force(gap, stiffness, edge, trial, touched, share)


@inner()
def _share(gap: Floats, trial: Floats, touched: int, shrinks: bool) -> float:
    """Where between two springs (0 to 1 in the gap) the load, linear in the gap, reaches zero.

    While the contact grows, the springs outside tell (those inside have just begun to relax,
    at different rates); while it shrinks, the springs inside do (those outside have just begun
    to recover).
    """
    inside, outside = touched - 1, touched
    cell = gap[outside] - gap[inside]
    if cell <= 0.0:
        share = trial[inside] / (trial[inside] - trial[outside])
    elif shrinks and inside > 0:
        share = _rest(gap, trial, inside - 1, inside) / cell
    elif outside + 1 < gap.size:
        share = 1.0 + _rest(gap, trial, outside, outside + 1) / cell
    else:
        share = _rest(gap, trial, inside, outside) / cell
    return min(max(share, 0.0), 1.0)


@inner()
def _width(edge: Floats, touched: int, share: float) -> float:
    """Contact half width of an edge between two springs; the gap grows with its square."""
    inside, outside = edge[touched - 1] ** 2, edge[touched] ** 2
    return math.sqrt(inside + share * (outside - inside))


@inner()
def _edge_force(gap: Floats, stiffness: Floats, edge: Floats, trial: Floats, touched: int, share: float) -> float:
    """Force between the plain sum over the springs of a smooth profile and the integral up to the edge.

    Continuous as springs come and go, if ``share`` is.
    """
    if touched < 2:
        return 0.0
    inside, outside = touched - 1, touched
    place = (_width(edge, touched, share) - edge[inside]) / (edge[outside] - edge[inside])
    weight = (1.0 - place) * stiffness[inside] + place * stiffness[outside]
    half_bernoulli = 0.5 * (place * (place - 1.0) + 1.0 / 6.0) * weight
    if touched == 2:
        # It comes in without a jump of force.
        half_bernoulli *= share
    # Loads inside, continued outwards: springs outside answer with the step's own compliance.
    cell = gap[outside] - gap[inside]
    slope = (trial[inside - 1] - trial[inside]) / (gap[inside] - gap[inside - 1])
    return half_bernoulli * ((1.0 - share) * slope * cell + trial[inside])


@inner()
def _rest(gap: Floats, trial: Floats, first: int, second: int) -> float:
    """Gap [m] from the pair's nearer end to where its loads, on one line, are zero."""
    near = second if trial[second] > 0.0 else first
    return trial[near] * (gap[second] - gap[first]) / max(trial[first] - trial[second], 1e-300)

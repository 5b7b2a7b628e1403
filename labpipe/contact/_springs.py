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
reduction), see :func:`sphere_bed`; so have rings (:mod:`labpipe.contact.impact._rings`).

Two corrections make the bed fourth-order accurate in the strip width: the force is the Euler-Maclaurin sum over the
springs with the edge located between two of them (second Bernoulli polynomial of the edge's position); and collocation
at the strip's centre sees a curved profile Δx² f″/48 too low. Against the closed form the error left is 4e-6 in force
at 20 strips per half width and 4e-8 at 100.
"""

import math
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean

# The edge of the contact lies this fraction of a strip inside the strip whose pressure vanishes
# (limit of many strips; calibrated on the closed form of the parabola).
EDGE_OFFSET = 0.17464
# In place of the number of springs in contact: a spring is touched before one nearer to the centre, or carries more;
# the contact reaches the end of the bed.
OUTGROWN, NOT_NESTED = range(-2, 0)
# Loads may differ from nested order by rounding only; relative tolerance of a displacement that carries a given force.
_NESTED_TOLERANCE, _EDGE_TOLERANCE = 1e-9, 1e-13


class SpringBed(NamedTuple):
    """Springs in the order in which they come into contact, for E* = 1.

    ``gap`` and ``edge`` (spring,) [m]: approach, and contact half width (radius), at which the spring is first touched
    (elastic contact); ``stiffness`` (spring,): its part, dimensionless for a line, m for a sphere; ``open_springs``: so
    many the contact must leave open; ``full_width`` [m]: contact half width with every spring in contact.
    """

    gap: Floats
    stiffness: Floats
    edge: Floats
    open_springs: int = 1
    full_width: float = math.nan

    @property
    def size(self) -> int:
        """Number of springs."""
        return int(self.gap.size)


def sphere_bed(radius: float, reach: float, springs: int, profile: str = "parabola") -> SpringBed:
    """Springs of a sphere on a half-space up to a contact radius ``reach`` [m] and two more, for E* = 1.

    By the method of dimensionality reduction (Popov and Heß 2015, https://doi.org/10.1007/978-3-642-53876-6): an
    elastic contact of radius b has an approach of b²/R, for the exact sphere of b artanh(b/R).
    """
    spacing = reach / springs
    # Two springs beyond the reach locate an edge that lies exactly on it.
    position = spacing * np.arange(springs + 2, dtype=float)
    stiffness = np.full(position.size, 2.0 * spacing)
    stiffness[0] = spacing
    gap = position * np.arctanh(position / radius) if profile == "sphere" else position**2 / radius
    return SpringBed(gap, stiffness, position)


@lean()
def press(
    bed: SpringBed, threshold: Floats, compliance: float, displacement: float, shrinks: bool, load: Floats
) -> tuple[int, float, float]:
    """Press a bed of springs to a displacement [m] and write their ``load`` (spring,).

    ``threshold`` (spring,) [m] is the displacement that touches each spring now; ``compliance`` [1/Pa] that of this
    step. Returns the number of springs in contact, or NOT_NESTED or OUTGROWN; their force (per reduced modulus, and
    depth of a line); and the contact half width [m].
    """
    size, touched = load.size, 0
    for j in range(size):
        load[j] = (displacement - threshold[j]) / compliance
        touched += load[j] > 0.0
    force, half_width = 0.0, 0.0
    for j in range(touched):
        if load[j] <= 0.0 or (j > 0 and load[j] - load[j - 1] > _NESTED_TOLERANCE * load[0]):
            return NOT_NESTED, force, half_width
        force += bed.stiffness[j] * load[j]
    for j in range(touched, size):
        load[j] = 0.0
    if touched > size - bed.open_springs:
        return OUTGROWN, force, half_width
    if touched == size:
        half_width = bed.full_width
    elif touched > 0:
        share = _share(bed, threshold, displacement, touched, shrinks)
        force += _edge_force(bed, threshold, displacement, touched, share) / compliance
        half_width = _width(bed, touched, share)
    return touched, force, half_width


@lean()
def balance(bed: SpringBed, threshold: Floats, pull: float, target: float, carried: float) -> tuple[float, float]:
    """Displacement [m] at which the springs carry a force and a spring that pulls to a target, and their force.

    Forces, and the stiffness ``pull`` of that spring, are times the step compliance; without a force the indenter just
    touches. By the secant method within a bracket, from where the plain sum without the edge's part carries the force.
    """
    size = threshold.size
    if carried <= 0.0 and pull * (target - threshold[0]) <= 0.0:
        return (target if pull > 0.0 else threshold.min()), 0.0
    stiffness, moment, touched, highest = bed.stiffness[0], bed.stiffness[0] * threshold[0], 1, threshold[0]
    while touched < size:
        highest = max(highest, threshold[touched])
        if stiffness * highest - moment + pull * (highest - target) >= carried:
            break
        stiffness += bed.stiffness[touched]
        moment += bed.stiffness[touched] * threshold[touched]
        touched += 1
    low, high = threshold[0], math.inf
    displacement = (carried + pull * target + moment) / (stiffness + pull)
    old = old_miss = math.nan
    force = 0.0
    for _ in range(100):
        while touched < size and threshold[touched] < displacement:
            stiffness += bed.stiffness[touched]
            moment += bed.stiffness[touched] * threshold[touched]
            touched += 1
        while touched > 1 and threshold[touched - 1] >= displacement:
            touched -= 1
            stiffness -= bed.stiffness[touched]
            moment -= bed.stiffness[touched] * threshold[touched]
        force = stiffness * displacement - moment
        if touched < size:
            force += _smooth_edge_force(bed, threshold, displacement, touched)
        miss = force + pull * (displacement - target) - carried
        slope = stiffness + pull
        if (miss - old_miss) * (displacement - old) > 0.0:
            slope = (miss - old_miss) / (displacement - old)
        change = miss / slope
        # with gaps that are much larger than the approach, the sum itself is not known better
        is_exact = abs(miss) <= _EDGE_TOLERANCE * (carried + abs(moment))
        if is_exact or abs(change) <= _EDGE_TOLERANCE * (displacement - low):
            break
        old, old_miss = displacement, miss
        if miss < 0.0:
            low = displacement
        else:
            high = displacement
        displacement -= change
        if not low < displacement < high:
            displacement = 0.5 * (low + high) if high < math.inf else 2.0 * old - threshold[0]
        if high - low <= _EDGE_TOLERANCE * abs(high):
            break
    return displacement, force


@inner()
def _smooth_edge_force(bed: SpringBed, threshold: Floats, displacement: float, touched: int) -> float:
    """Force of the edge as :func:`press` adds it, but continuous as springs come and go.

    The share is the place between two springs where the loads of either side, linear in the gap, reach zero. Less
    accurate than the share of one side, which jumps where springs come and go.
    """
    inside, outside = touched - 1, touched
    if touched < 2 or outside + 1 == threshold.size:
        share = (displacement - threshold[inside]) / (threshold[outside] - threshold[inside])
    else:
        before = _rest(bed, threshold, displacement, inside - 1, inside)
        behind = -_rest(bed, threshold, displacement, outside, outside + 1)
        share = before / max(before + behind, 1e-300)
    return _edge_force(bed, threshold, displacement, touched, share)


@inner()
def _share(bed: SpringBed, threshold: Floats, displacement: float, touched: int, shrinks: bool) -> float:
    """Where between two springs (0 to 1 in the gap) the load, linear in the gap, reaches zero.

    It follows from the springs outside while the contact grows, and from those inside while it shrinks, but never
    lies beyond where the surface outside meets the indenter.
    """
    inside, outside = touched - 1, touched
    cell = bed.gap[outside] - bed.gap[inside]
    if cell <= 0.0:
        share = (displacement - threshold[inside]) / (threshold[outside] - threshold[inside])
    elif outside + 1 < threshold.size:
        share = 1.0 + _rest(bed, threshold, displacement, outside, outside + 1) / cell
    else:
        share = _rest(bed, threshold, displacement, inside, outside) / cell
    if shrinks and inside > 0 and cell > 0.0:
        share = min(share, _rest(bed, threshold, displacement, inside - 1, inside) / cell)
    return min(max(share, 0.0), 1.0)


@inner()
def _width(bed: SpringBed, touched: int, share: float) -> float:
    """Contact half width of an edge between two springs; the gap grows with its square."""
    inside, outside = bed.edge[touched - 1] ** 2, bed.edge[touched] ** 2
    return math.sqrt(inside + share * (outside - inside))


@inner()
def _edge_force(bed: SpringBed, threshold: Floats, displacement: float, touched: int, share: float) -> float:
    """Force, times the compliance, between the plain sum over springs and the integral up to the edge."""
    if touched < 2:
        return 0.0
    inside, outside = touched - 1, touched
    place = (_width(bed, touched, share) - bed.edge[inside]) / (bed.edge[outside] - bed.edge[inside])
    weight = (1.0 - place) * bed.stiffness[inside] + place * bed.stiffness[outside]
    half_bernoulli = 0.5 * (place * (place - 1.0) + 1.0 / 6.0) * weight
    if touched == 2:
        # It comes in without a jump of force.
        half_bernoulli *= share
    # Loads inside, continued outwards: springs outside answer with the step's own compliance.
    cell = bed.gap[outside] - bed.gap[inside]
    slope = (threshold[inside] - threshold[inside - 1]) / (bed.gap[inside] - bed.gap[inside - 1])
    return half_bernoulli * ((1.0 - share) * slope * cell + displacement - threshold[inside])


@inner()
def _rest(bed: SpringBed, threshold: Floats, displacement: float, first: int, second: int) -> float:
    """Gap [m] from the pair's nearer end to where its loads, on one line, are zero."""
    near = second if displacement > threshold[second] else first
    span = (displacement - threshold[near]) * (bed.gap[second] - bed.gap[first])
    return span / max(threshold[second] - threshold[first], 1e-300)

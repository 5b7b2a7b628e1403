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

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError

# The edge of the contact lies this fraction of a strip inside the strip whose pressure vanishes
# (limit of many strips; calibrated on the closed form of the parabola).
EDGE_OFFSET = 0.17464
# Second Bernoulli number, B2 = B2(0).
_B2 = 1.0 / 6.0
# Pressures may differ from nested order by rounding only.
_NESTED_TOLERANCE = 1e-9
# Iterations and relative tolerance of a displacement that carries a given force.
_EDGE_ITERATIONS = 100
_EDGE_TOLERANCE = 1e-13
# The edge's share of the force needs so many springs in contact.
_EDGE_SPRINGS = 2


class NotNestedError(Exception):
    """The contact is not one growing and shrinking interval; the general solver has to do it."""


class Answer(NamedTuple):
    """Solution of one step: the load of every spring (or strip) and what it amounts to.

    ``force`` and ``half_width`` belong to one tip (per unit depth for a line contact).
    """

    load: Floats
    force: float
    displacement: float
    half_width: float


class Contact(Protocol):
    """What the time stepper needs of a spatial discretisation."""

    @property
    def size(self) -> int:
        """Length of a load vector."""

    @property
    def weights(self) -> Floats:
        """Force per unit load (size,)."""

    def press(self, history: Floats, compliance: float, displacement: float, before: float) -> Answer:
        """Solve at a prescribed displacement."""

    def push(self, history: Floats, compliance: float, force: float, before: float) -> Answer:
        """Solve at a prescribed force."""

    def inner(self, left: Floats, right: Floats) -> Floats:
        """Energy products (...,) of load vectors (..., size): force times displacement."""


@dataclass(frozen=True, slots=True)
class SpringBed:
    """Springs in the order in which they come into contact, for E* = 1.

    Attributes
    ----------
    gap : array (spring,) [m]
        Approach at which the spring is first touched (elastic contact), ascending.
    stiffness : array (spring,)
        What it adds to the stiffness, ΔS: dimensionless for a line, m for a sphere.
    edge : array (spring,) [m]
        Contact half width (radius) at which it is first touched.
    is_smooth : bool
        The profile is smooth, so that the edge correction applies.
    open_springs : int
        The contact must leave so many springs open; 0 where full contact is allowed.
    limit : str
        What to say when it does not.
    full_width : float [m]
        Contact half width with every spring in contact.
    """

    gap: Floats
    stiffness: Floats
    edge: Floats
    is_smooth: bool
    open_springs: int
    limit: str
    full_width: float = np.nan

    @property
    def size(self) -> int:
        """Number of springs."""
        return int(self.gap.size)

    @property
    def weights(self) -> Floats:
        """Force per unit load (spring,)."""
        return self.stiffness

    def inner(self, left: Floats, right: Floats) -> Floats:
        """Energy products (...,) of load vectors (..., spring)."""
        return np.asarray((left * right) @ self.stiffness)

    def press(self, history: Floats, compliance: float, displacement: float, before: float) -> Answer:
        """Solve at a prescribed displacement.

        Parameters
        ----------
        history : array (spring,) [m]
            Displacement that the springs would show now without load.
        compliance : float [1/Pa]
            Of this step.
        displacement : float [m]
            Approach of the indenter.
        before : float [m]
            Approach at the start of the step: tells whether the contact grows or shrinks.

        Raises
        ------
        NotNestedError
            A spring is touched before one that is nearer to the centre, or carries more.
        InputError
            The contact reaches the end of the bed.
        """
        trial = (displacement - history - self.gap) / compliance
        load = np.maximum(trial, 0.0)
        touched = int(np.count_nonzero(trial > 0.0))
        if touched == 0:
            return Answer(load, 0.0, displacement, 0.0)
        self._require_nested(load, touched)
        self._require_open(touched)
        force = float(self.stiffness[:touched] @ load[:touched])
        if touched == self.size:
            return Answer(load, force, displacement, self.full_width)
        share = self._share(trial, touched, shrinks=displacement < before)
        force += self._edge_force(trial, touched, share)
        return Answer(load, force, displacement, self._width(touched, share))

    def push(self, history: Floats, compliance: float, force: float, before: float) -> Answer:
        """Solve at a prescribed force; at zero force the indenter just touches.

        Raises
        ------
        NotNestedError
            See :meth:`press`.
        InputError
            No contact within the bed carries the force.
        """
        threshold = history + self.gap
        if force <= 0.0:
            return Answer(np.zeros(self.size), 0.0, float(threshold.min()), 0.0)
        if np.any(np.diff(threshold) < -_NESTED_TOLERANCE * np.abs(threshold).max()):
            raise NotNestedError
        threshold = np.maximum.accumulate(threshold)
        answer = self.press(history, compliance, self._inverse(threshold, compliance, force), before)
        return answer._replace(force=force)

    def _inverse(self, threshold: Floats, compliance: float, force: float) -> float:
        """Displacement at which springs with these thresholds carry the force.

        The secant method within a bracket; the force is continuous and made of a plain sum, which is
        piecewise linear, and the edge's small part. It begins where the plain sum alone carries the
        force, with the slope of that sum.
        """
        stiffness = np.cumsum(self.stiffness)
        moment = np.cumsum(self.stiffness * threshold)
        target = force * compliance

        def excess(displacement: float) -> tuple[float, float]:
            touched = max(int(np.searchsorted(threshold, displacement)), 1)
            slope = float(stiffness[touched - 1])
            plain = slope * displacement - float(moment[touched - 1])
            if touched < self.size:
                trial = displacement - threshold
                share = self._smooth_share(trial, touched)
                plain += self._edge_force(trial, touched, share)
            return plain - target, slope

        low, high = float(threshold[0]), np.inf
        plain = stiffness[:-1] * threshold[1:] - moment[:-1]  # as each next spring is just touched
        last = int(np.searchsorted(plain, target))
        displacement = (target + float(moment[last])) / float(stiffness[last])
        old, old_miss = np.nan, np.nan
        for _ in range(_EDGE_ITERATIONS):
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
        return displacement

    def _smooth_share(self, trial: Floats, touched: int) -> float:
        """Where between two springs the edge lies, continuous as springs come and go.

        The distances from the inner and the outer spring to where the loads of either side, linear
        in the gap, reach zero; they add up to the cell in a contact that neither relaxes nor
        recovers. Less accurate than :meth:`_share`, which jumps where springs come and go.
        """
        inner, outer = touched - 1, touched
        if touched < _EDGE_SPRINGS or outer + 1 == self.size:
            return float(trial[inner] / (trial[inner] - trial[outer]))
        inside = self._rest(trial, inner - 1, inner)
        outside = -self._rest(trial, outer, outer + 1)
        return inside / max(inside + outside, 1e-300)

    def _share(self, trial: Floats, touched: int, *, shrinks: bool) -> float:
        """Where between two springs (0 to 1 in the gap) the load, linear in the gap, reaches zero.

        While the contact grows, the springs outside tell (those inside have just begun to relax,
        at different rates); while it shrinks, the springs inside do (those outside have just begun
        to recover).
        """
        inner, outer = touched - 1, touched
        cell = float(self.gap[outer] - self.gap[inner])
        if not self.is_smooth or cell <= 0.0:
            share = float(trial[inner] / (trial[inner] - trial[outer]))
        elif shrinks and inner > 0:
            share = self._rest(trial, inner - 1, inner) / cell
        elif outer + 1 < self.size:
            share = 1.0 + self._rest(trial, outer, outer + 1) / cell
        else:
            share = self._rest(trial, inner, outer) / cell
        return min(max(share, 0.0), 1.0)

    def _width(self, touched: int, share: float) -> float:
        """Contact half width of an edge between two springs; the gap grows with its square."""
        inner, outer = self.edge[touched - 1 : touched + 1] ** 2
        return float(np.sqrt(inner + share * (outer - inner)))

    def _edge_force(self, trial: Floats, touched: int, share: float) -> float:
        """Force between the plain sum over the springs and the integral up to the edge.

        Continuous as springs come and go, if ``share`` is.
        """
        if not self.is_smooth or touched < _EDGE_SPRINGS:
            return 0.0
        inner, outer = touched - 1, touched
        length = float(self.edge[outer] - self.edge[inner])
        place = (self._width(touched, share) - float(self.edge[inner])) / length
        weight = (1.0 - place) * self.stiffness[inner] + place * self.stiffness[outer]
        half_bernoulli = 0.5 * (place * (place - 1.0) + _B2) * float(weight)
        if touched == _EDGE_SPRINGS:
            # It comes in without a jump of force.
            half_bernoulli *= share
        # Loads inside, continued outwards: springs outside answer with the step's own compliance.
        cell = float(self.gap[outer] - self.gap[inner])
        slope = (trial[inner - 1] - trial[inner]) / float(self.gap[inner] - self.gap[inner - 1])
        return half_bernoulli * ((1.0 - share) * float(slope) * cell + float(trial[inner]))

    def _rest(self, trial: Floats, first: int, second: int) -> float:
        """Gap (m) from the pair's nearer end to where its loads, on one line, are zero."""
        drop = float(trial[first] - trial[second])
        near = second if trial[second] > 0.0 else first
        return float(trial[near]) * float(self.gap[second] - self.gap[first]) / max(drop, 1e-300)

    def _require_nested(self, load: Floats, touched: int) -> None:
        inside = load[:touched]
        if inside.min() <= 0.0:
            raise NotNestedError
        if (inside[1:] - inside[:-1]).max(initial=0.0) > _NESTED_TOLERANCE * inside[0]:
            raise NotNestedError

    def _require_open(self, touched: int) -> None:
        if touched > self.size - self.open_springs:
            raise InputError(self.limit)


def sphere_bed(
    radius: float,
    reach: float,
    springs: int,
    gap: Callable[[Floats], Floats] | None = None,
    limit: str = "the contact reaches the end of the springs; give a larger reach",
) -> SpringBed:
    """Springs of a sphere on a half-space by the method of dimensionality reduction, for E* = 1.

    Parameters
    ----------
    radius : float [m]
        Of the sphere.
    reach : float [m]
        Largest contact radius that will be asked for.
    springs : int
        Number of springs within the reach.
    gap : callable, optional
        Approach [m] of an elastic contact of radius b [m]; the default is b²/R (parabola).
    limit : str
        Message when the contact outgrows the reach.

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
    return SpringBed(gaps, stiffness, position, True, 1, limit)

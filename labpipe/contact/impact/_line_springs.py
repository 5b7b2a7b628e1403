"""A sphere on a flat by the method of dimensionality reduction: independent springs on a line.

The disc contact of a viscoelastic sphere, advancing, receding and returning, is exactly a row of
one-dimensional springs at ``x``, which a profile ``g(x)`` presses [1]_ [2]_::

    J* conv q(x) = approach - g(x) while touched, q >= 0 ;   F = 2 int_0^a q dx

with ``g = x^2/R`` for the parabola and ``g = (x/2) ln((R+x)/(R-x))`` for the exact sphere.
Inside a cell ``q`` is taken linear in ``x^2``, and the edge is found the same way: exact for Hertz
at any resolution, and the force is a smooth, convex function of the approach.

References
----------
.. [1] V. L. Popov, M. Hess, E. Willert, Handbook of Contact Mechanics (2019),
   doi:10.1007/978-3-662-58709-6
.. [2] T. C. T. Ting, J. Appl. Mech. 33 (1966) 845, doi:10.1115/1.3625192
"""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Literal

import numpy as np

from labpipe.contact.impact._motion import PlainSprings
from labpipe.contact.memory import Array
from labpipe.errors import InputError

Profile = Literal["parabola", "sphere"]

# Nodes are spaced evenly in asinh(x / core): evenly near the axis, then by a constant ratio, so
# that every later and smaller contact is resolved as finely as the first.


@dataclass(frozen=True, slots=True)
class LineSprings:
    """Springs at the nodes of a graded line; see :func:`line_springs`.

    Attributes
    ----------
    position : array (spring,) [m]
        Distance from the axis; the first is 0.
    gap : array (spring,) [m]
        Approach at which an unloaded spring touches.
    weight : array (spring,) [m]
        Force per load of each node when its neighbours are in contact too.
    """

    radius_of_sphere: float
    core: float
    per_radius: float
    profile: Profile
    position: Array
    gap: Array
    weight: Array
    _squares: list[float]
    _positions: list[float]
    _inner: list[float]
    _totals: list[float]

    def force(self, approach: float, reach: Array, moments: Array) -> tuple[float, float]:
        """Force and its slope, both times the step compliance, at an approach.

        Parameters
        ----------
        approach : float [m]
            Trial approach of the bodies.
        reach : array (spring,) [m]
            Approach at which each spring would carry no load, increasing outwards.
        moments : array (spring + 1,) [m2]
            Running sum of ``weight * reach``, starting with 0.
        """
        count = int(reach.searchsorted(approach))
        if count == 0:
            return 0.0, 0.0
        last = count - 1
        excess = approach - reach.item(last)
        x = self._positions[last]
        edge = self._edge(last, approach, reach)
        if edge + x > 0.0:
            partial = 2.0 * (edge - x) * (2.0 * edge + x) / (3.0 * (edge + x))
        else:
            partial = 0.0
        inside = approach * self._totals[last] - moments.item(last)
        return inside + excess * (self._inner[last] + partial), 2.0 * edge

    def contact_radius(self, approach: float, reach: Array) -> float:
        """Radius in m where the load falls to zero.

        An advancing edge meets springs that were free until now, so that the surface outside,
        continued inwards, tells where it is; behind it the surface has a kink. A receding edge
        lies between its neighbours.
        """
        count = int(reach.searchsorted(approach))
        if count == 0:
            return 0.0
        between = self._edge(count - 1, approach, reach)
        if count + 1 >= reach.size:
            return between
        squares = self._squares
        outer = reach.item(count)
        slope = (reach.item(count + 1) - outer) / (squares[count + 1] - squares[count])
        continued = squares[count] - (outer - approach) / slope
        return sqrt(max(continued, between**2))

    def covering(self, radius: float) -> int:
        """Return how many springs reach out to a radius [m] (at least two)."""
        return max(2, int(np.searchsorted(self.position, radius)) + 1)

    def pressure(self, load: Array, edge: float, radius: Array) -> Array:
        """Pressure (radius,) in Pa at given radii, from the loads (spring,) of the inner springs.

        ``p(r) = -1/pi int_r^a q'(x) / sqrt(x^2 - r^2) dx`` with ``q`` linear in ``x^2`` up to the
        edge, cell by cell in closed form.
        """
        loaded = int(np.count_nonzero(load))
        squares = np.append(self.position[:loaded] ** 2, edge**2)
        slopes = np.diff(np.append(load[:loaded], 0.0)) / np.maximum(np.diff(squares), 1e-300)
        roots = np.sqrt(np.maximum(squares - radius[:, None] ** 2, 0.0))
        return -2.0 / pi * np.diff(roots, axis=1) @ slopes

    def surface(self, displacement: Array, radius: Array) -> Array:
        """Displacement (radius,) in m of the surface, from that of the inner springs.

        ``u(r) = 2/pi int_0^r w(x) / sqrt(r^2 - x^2) dx`` with ``w`` linear in ``x^2``.
        """
        squares = self.position[: displacement.size] ** 2
        slopes = np.diff(displacement) / np.diff(squares)
        starts = displacement[:-1] - slopes * squares[:-1]
        r = np.maximum(radius, 1e-300)[:, None]
        share = np.minimum(self.position[: displacement.size] / r, 1.0)
        angle = np.arcsin(share)
        moment = 0.5 * r**2 * (angle - share * np.sqrt(1.0 - share**2))
        inside = np.diff(angle, axis=1) @ starts + np.diff(moment, axis=1) @ slopes
        return np.where(radius > 0.0, 2.0 / pi * inside, displacement[0])

    def plain(self, count: int) -> PlainSprings:
        """Return the inner springs as plain arrays."""
        inner, total = np.array(self._inner[:count]), np.array(self._totals[: count + 1])
        return PlainSprings(inner, total, True, 0.0)

    def extended(self, radius: float) -> "LineSprings":
        """Return the same springs and further ones out to a radius [m]."""
        return line_springs(self.radius_of_sphere, radius, self.core, self.per_radius, self.profile)

    def _edge(self, last: int, approach: float, reach: Array) -> float:
        """Edge behind the last touched spring; the row itself ends no later than its last one."""
        if last + 1 == reach.size:
            return self._positions[last]
        start = reach.item(last)
        fraction = (approach - start) / (reach.item(last + 1) - start)
        inner, outer = self._squares[last], self._squares[last + 1]
        return sqrt(inner + fraction * (outer - inner))


def line_springs(
    radius_of_sphere: float,
    reach: float,
    core: float,
    per_radius: float,
    profile: Profile = "parabola",
) -> LineSprings:
    """Lay springs along the line.

    Parameters
    ----------
    radius_of_sphere : float [m]
        R.
    reach : float [m]
        The outermost spring lies at or beyond this radius, if the sphere does.
    core : float [m]
        Up to about here the spacing is even (``core / per_radius``).
    per_radius : float
        Springs per contact radius: the spacing at ``x`` is ``x / per_radius`` beyond the core.
    profile : "parabola" or "sphere"
        Shape of the gap.
    """
    if profile not in ("parabola", "sphere"):
        message = f'profile is "{profile}", expected "parabola" or "sphere"'
        raise InputError(message)
    count = int(np.ceil(np.arcsinh(reach / core) * per_radius)) + 2
    position = core * np.sinh(np.arange(count) / per_radius)
    if profile == "sphere":
        position = position[position < radius_of_sphere]
        gap = position * np.arctanh(position / radius_of_sphere)
    else:
        gap = position**2 / radius_of_sphere
    squares = position**2
    width = np.diff(position)
    # 2 * int of (x^2 - x_i^2)/(x_j^2 - x_i^2) over a cell: the share of its outer node.
    total = position[1:] + position[:-1]
    outer = 2.0 * width * (position[1:] + 2.0 * position[:-1]) / (3.0 * total)
    inner = 2.0 * width - outer
    weight = np.concatenate([inner, [0.0]]) + np.concatenate([[0.0], outer])
    return LineSprings(
        radius_of_sphere=radius_of_sphere,
        core=core,
        per_radius=per_radius,
        profile=profile,
        position=position,
        gap=gap,
        weight=weight,
        _squares=squares.tolist(),
        _positions=position.tolist(),
        _inner=[0.0, *outer.tolist()],
        _totals=[0.0, *np.cumsum(weight).tolist()],
    )

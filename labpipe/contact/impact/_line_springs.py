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
from math import nan, pi
from typing import Literal

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError

Profile = Literal["parabola", "sphere"]

# Nodes are spaced evenly in asinh(x / core): evenly near the axis, then by a constant ratio, so
# that every later and smaller contact is resolved as finely as the first.


@dataclass(frozen=True, slots=True)
class LineSprings:
    """Springs at the nodes of a graded line; see :func:`line_springs`.

    ``position`` (spring,) [m]: distance from the axis; the first is 0; ``gap`` (spring,) [m]: approach at which an
    unloaded spring touches; ``weight`` (spring,) [m]: force per load of each node when its neighbours are in contact
    too; ``last_weight`` (spring,) [m]: the same without the cell beyond the node; ``edge_bias``: NaN: the edge of the
    contact cuts a cell.
    """

    radius_of_sphere: float
    core: float
    per_radius: float
    profile: Profile
    position: Floats
    gap: Floats
    weight: Floats
    last_weight: Floats
    edge_bias: float = nan

    def covering(self, radius: float) -> int:
        """Return how many springs reach out to a radius [m] (at least two)."""
        return max(2, int(np.searchsorted(self.position, radius)) + 1)

    def pressure(self, load: Floats, edge: float, radius: Floats) -> Floats:
        """Pressure (radius,) in Pa at given radii, from the loads (spring,) of the inner springs.

        ``p(r) = -1/pi int_r^a q'(x) / sqrt(x^2 - r^2) dx`` with ``q`` linear in ``x^2`` up to the
        edge, cell by cell in closed form.
        """
        loaded = int(np.count_nonzero(load))
        squares = np.append(self.position[:loaded] ** 2, edge**2)
        slopes = np.diff(np.append(load[:loaded], 0.0)) / np.maximum(np.diff(squares), 1e-300)
        roots = np.sqrt(np.maximum(squares - radius[:, None] ** 2, 0.0))
        return -2.0 / pi * np.diff(roots, axis=1) @ slopes

    def surface(self, displacement: Floats, radius: Floats) -> Floats:
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

    def pole(self, displacement: Floats) -> Floats:
        """Displacement (element,) in m of the surface on the axis: that of the central spring."""
        return np.ascontiguousarray(displacement[:, 0])

    def extended(self, radius: float) -> "LineSprings":
        """Return the same springs and further ones out to a radius [m]."""
        return line_springs(self.radius_of_sphere, radius, self.core, self.per_radius, self.profile)


def line_springs(
    radius_of_sphere: float, reach: float, core: float, per_radius: float, profile: Profile = "parabola"
) -> LineSprings:
    """Lay springs along the line.

    ``radius_of_sphere`` [m]: R. ``reach`` [m]: The outermost spring lies at or beyond this radius, if the sphere
    does. ``core`` [m]: Up to about here the spacing is even (``core / per_radius``). ``per_radius``: Springs per
    contact radius: the spacing at ``x`` is ``x / per_radius`` beyond the core. ``profile``: Shape of the gap.
    """
    if profile not in ("parabola", "sphere"):
        raise InputError(f'profile is "{profile}", expected "parabola" or "sphere"')
    count = int(np.ceil(np.arcsinh(reach / core) * per_radius)) + 2
    position = core * np.sinh(np.arange(count) / per_radius)
    if profile == "sphere":
        position = position[position < radius_of_sphere]
        gap = position * np.arctanh(position / radius_of_sphere)
    else:
        gap = position**2 / radius_of_sphere
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
        last_weight=np.concatenate([[0.0], outer]),
    )

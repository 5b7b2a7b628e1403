r"""A sphere on a flat by axisymmetric boundary elements: rings of constant pressure.

The displacement at ``r`` under a unit pressure on a disc of radius ``c`` (thesis, eq. 3.5) is, for
a unit compliance ``(1 - nu^2)/E``,

.. math:: U(r, c) = \frac{4}{\pi}\begin{cases} c\,E(r/c) & r \le c\\
          r\,[E(c/r) - (1 - c^2/r^2)\,K(c/r)] & r > c\end{cases}

with the complete elliptic integrals K (first kind) and E (second kind) of the *modulus*; scipy
takes the parameter, the modulus squared. A ring is the difference of two discs, collocated at its
middle radius.

Nothing is solved in time. With the influence matrix factored once from the centre outwards,
``G = L U`` without pivoting, and ``y = U p``, the leading block of every contact disc is factored
too, and each ``y_j`` is a spring of its own: ``J* conv y_j = approach (L^-1 1)_j - (L^-1 g)_j``. It
lets go when ``y_j`` would become negative, which is when the pressure at the edge would.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, pi
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import ellipe, ellipk

from labpipe.arrays import Floats
from labpipe.contact.impact._line_springs import Profile
from labpipe.errors import InputError

# The edge between the last loaded and the next ring, found by the sign of the load, lies outside
# the true edge by this part of a ring's width: measured on Hertz from 10 to 320 rings per radius.
_EDGE_BIAS = 0.1765
# The factors are n x n: more than this would take minutes and gigabytes.
_MOST_RINGS = 4000
_BLOCK = 64


def disc_displacement(r: Floats, c: Floats) -> Floats:
    """Displacement at ``r`` under unit pressure on a disc of radius ``c``, at unit compliance.

    ``r``, ``c`` [m]: broadcast against each other; ``r`` is positive. Returns ``U(r, c)``; multiply by ``(1 -
    nu**2)/E`` and the pressure.
    """
    r, c = np.broadcast_arrays(np.asarray(r, dtype=float), np.asarray(c, dtype=float))
    larger = np.maximum(r, c)
    parameter = (np.minimum(r, c) / larger) ** 2
    second = ellipe(parameter)
    # K is infinite at the rim of the disc, where its factor is zero.
    first = np.where(parameter < 1.0, (1.0 - parameter) * ellipk(np.where(parameter < 1.0, parameter, 0.0)), 0.0)
    return 4.0 / pi * np.where(r <= c, larger * second, larger * (second - first))


def influence(n_rings: int) -> Floats:
    """Displacement at the middle of each ring by unit pressure on each (thesis, eq. 3.4).

    Shape (ring, ring), for rings of unit width and unit compliance.
    """
    rim = np.linspace(0.0, n_rings, n_rings + 1)
    discs = disc_displacement(rim[:-1, None] + 0.5, rim[None, :])
    return np.diff(discs, axis=1)


class Factors(NamedTuple):
    """Factors of the influence matrix of rings of unit width; shared by all widths."""

    lower: Floats
    upper: Floats


@lru_cache(maxsize=4)
def factors(n_rings: int) -> Factors:
    """Factor the influence matrix of ``n_rings`` rings of unit width, from the centre outwards."""
    matrix = influence(n_rings)
    lower = np.eye(n_rings)
    for start in range(0, n_rings, _BLOCK):
        stop = min(start + _BLOCK, n_rings)
        _factor_block(matrix[start:stop, start:stop], lower[start:stop, start:stop])
        corner = matrix[start:stop, start:stop]
        matrix[start:stop, stop:] = solve_triangular(
            lower[start:stop, start:stop], matrix[start:stop, stop:], lower=True, unit_diagonal=True
        )
        below = solve_triangular(corner, matrix[stop:, start:stop].T, trans="T").T
        lower[stop:, start:stop] = below
        matrix[stop:, start:stop] = 0.0
        matrix[stop:, stop:] -= below @ matrix[start:stop, stop:]
    lower.flags.writeable = matrix.flags.writeable = False
    return Factors(lower, matrix)


def _factor_block(matrix: Floats, lower: Floats) -> None:
    """Gaussian elimination without pivoting, in place; the diagonal dominates."""
    for i in range(matrix.shape[0] - 1):
        multiplier = matrix[i + 1 :, i] / matrix[i, i]
        lower[i + 1 :, i] = multiplier
        matrix[i + 1 :, i:] -= multiplier[:, None] * matrix[i, i:]
        matrix[i + 1 :, i] = 0.0


def surface_gap(r: Floats, radius_of_sphere: float, profile: Profile) -> Floats:
    """Distance (ring,) in m of the undeformed sphere from the flat when its pole touches."""
    if profile == "sphere":
        return r**2 / (radius_of_sphere + np.sqrt(radius_of_sphere**2 - r**2))
    return 0.5 * r**2 / radius_of_sphere


@dataclass(frozen=True, slots=True)
class RingSprings:
    """Springs equivalent to rings; see :func:`ring_springs`.

    ``position`` (spring,) [m]: middle radius of each ring; ``gap`` (spring,) [m]: approach at which an unloaded spring
    touches; ``weight`` (spring,) [m]: force per load of each spring; ``unit`` (spring,): displacement of each spring
    per approach, ``L^-1 1``; loads are per unit.
    """

    radius_of_sphere: float
    width: float
    profile: Profile
    position: Floats
    gap: Floats
    weight: Floats
    unit: Floats

    def pressure(self, load: Floats, edge: float, radius: Floats) -> Floats:
        """Pressure (radius,) in Pa at given radii, from the loads (spring,) of the inner springs.

        Linear between the middles of the rings, and zero beyond the edge.
        """
        _, upper = factors(self.position.size)
        known = np.zeros(self.position.size)
        known[: load.size] = load * self.unit[: load.size]
        on_rings = solve_triangular(upper, known) / self.width
        return np.where(radius < edge, np.interp(radius, self.position, on_rings), 0.0)

    def surface(self, displacement: Floats, radius: Floats) -> Floats:
        """Displacement (radius,) in m of the surface, from that of the inner springs."""
        lower, _ = factors(self.position.size)
        known = np.zeros(self.position.size)
        known[: displacement.size] = displacement * self.unit[: displacement.size]
        return np.asarray(np.interp(radius, self.position, lower @ known))

    def pole(self, displacement: Floats) -> Floats:
        """Displacement (element,) in m of the innermost ring, to which its own spring adds alone."""
        return np.asarray(displacement[:, 0] * self.unit[0])

    def covering(self, radius: float) -> int:
        """Return how many springs reach out to a radius [m] (at least two)."""
        return max(2, ceil(radius / self.width) + 1)

    @property
    def last_weight(self) -> Floats:
        """Weight of the last spring in contact: a ring counts whole."""
        return self.weight

    @property
    def edge_bias(self) -> float:
        """Length in m to take off the edge between the last loaded and the next ring."""
        return _EDGE_BIAS * self.width

    def extended(self, radius: float) -> "RingSprings":
        """Return the same springs and further ones out to a radius [m]."""
        return ring_springs(self.radius_of_sphere, radius, self.width, self.profile)


def ring_springs(radius_of_sphere: float, reach: float, width: float, profile: Profile = "parabola") -> RingSprings:
    """Cover a disc with rings and turn them into springs.

    ``radius_of_sphere`` [m]: R. ``reach`` [m]: The outermost ring lies beyond this radius, if the sphere does.
    ``width`` [m]: Width of a ring (the thesis's lambda). ``profile``: Shape of the gap. Raises InputError: The rings
    are so narrow that there would be more than 4000.
    """
    count = ceil(reach / width) + 2
    if profile == "sphere":
        count = min(count, int(radius_of_sphere / width))
    if not 2 < count <= _MOST_RINGS:
        raise InputError(
            f"rings of {width:.3g} m on a contact of {reach:.3g} m: {count} rings, expected 3 to "
            f"{_MOST_RINGS}; choose another ring width"
        )
    middle = np.linspace(0.5, count - 0.5, count) * width
    gap = surface_gap(middle, radius_of_sphere, profile)
    lower, upper = factors(count)
    unit = solve_triangular(lower, np.ones(count), lower=True, unit_diagonal=True)
    shape = solve_triangular(lower, gap, lower=True, unit_diagonal=True)
    area = pi * (2.0 * np.arange(count) + 1.0)
    weight = width * solve_triangular(upper, area, trans="T") * unit
    return RingSprings(
        radius_of_sphere=radius_of_sphere,
        width=width,
        profile=profile,
        position=middle,
        gap=shape / unit,
        weight=weight,
        unit=unit,
    )

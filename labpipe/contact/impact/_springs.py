r"""A sphere on a flat as independent springs: dimensionality reduction, and rings of constant pressure.

The disc contact of a viscoelastic sphere, advancing, receding and returning, is exactly a row of
one-dimensional springs at ``x``, which a profile ``g(x)`` presses [1]_ [2]_::

    J* conv q(x) = approach - g(x) while touched, q >= 0 ;   F = 2 int_0^a q dx

with ``g = x^2/R`` for the parabola and ``g = (x/2) ln((R+x)/(R-x))`` for the exact sphere.
Inside a cell ``q`` is taken linear in ``x^2``, and the edge is found the same way: exact for Hertz
at any resolution, and the force is a smooth, convex function of the approach.

Boundary elements have the same structure. The displacement at ``r`` under a unit pressure on a disc of
radius ``c`` (thesis, eq. 3.5) is, for a unit compliance ``(1 - nu^2)/E``,

.. math:: U(r, c) = \frac{4}{\pi}\begin{cases} c\,E(r/c) & r \le c\\
          r\,[E(c/r) - (1 - c^2/r^2)\,K(c/r)] & r > c\end{cases}

with the complete elliptic integrals K (first kind) and E (second kind) of the *modulus*; scipy
takes the parameter, the modulus squared. A ring is the difference of two discs, collocated at its
middle radius. With the influence matrix factored from the centre outwards, ``G = L U`` without
pivoting, each ``y_j`` of ``y = U p`` is a spring: ``J* conv y_j = approach (L^-1 1)_j - (L^-1 g)_j``. It
lets go when ``y_j`` would become negative, which is when the pressure at the edge would.

References
----------
.. [1] V. L. Popov, M. Hess, E. Willert, Handbook of Contact Mechanics (2019),
   doi:10.1007/978-3-662-58709-6
.. [2] T. C. T. Ting, J. Appl. Mech. 33 (1966) 845, doi:10.1115/1.3625192
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from math import ceil, nan, pi
from typing import Literal

import numpy as np
from scipy.linalg import lu_factor, solve_triangular
from scipy.special import ellipe, ellipk

from labpipe.arrays import Floats
from labpipe.errors import InputError, LabpipeError

Profile = Literal["parabola", "sphere"]

# The edge between the last loaded and the next ring, found by the sign of the load, lies outside
# the true edge by this part of a ring's width: measured on Hertz from 10 to 320 rings per radius.
_EDGE_BIAS = 0.1765
# The factors are n x n: more than this would take minutes and gigabytes.
_MOST_RINGS = 4000


@dataclass(frozen=True, slots=True)
class Springs:
    """Nested springs, all (spring,).

    ``position`` [m]: distance from the axis; ``gap`` [m]: approach at which each unloaded spring touches;
    ``weight`` [m]: force per load, ``last_weight`` that of the last in contact, without its outer cell;
    ``edge_bias`` [m]: to take off the interpolated edge, NaN where the edge cuts a cell; ``out_to``: the same springs
    and further ones out to a radius [m].
    """

    position: Floats
    gap: Floats
    weight: Floats
    last_weight: Floats
    edge_bias: float
    out_to: Callable[[float], "Springs"]


def line_springs(
    reach: float, radius_of_sphere: float, core: float, per_radius: float, profile: Profile = "parabola"
) -> Springs:
    """Lay springs along the line, by dimensionality reduction.

    ``reach`` [m]: the outermost spring lies at or beyond this radius, if the sphere does; ``core`` [m]: up to about
    here the spacing is even, ``core / per_radius``, and beyond ``x / per_radius``, so that every later and smaller
    contact is resolved as finely as the first.
    """
    count = int(np.ceil(np.arcsinh(reach / core) * per_radius)) + 2
    position = core * np.sinh(np.arange(count) / per_radius)
    if profile == "sphere":
        position = position[position < radius_of_sphere]
        gap = position * np.arctanh(position / radius_of_sphere)
    else:
        gap = position**2 / radius_of_sphere
    # 2 * int of (x^2 - x_i^2)/(x_j^2 - x_i^2) over a cell: the share of its outer node.
    width, total = np.diff(position), position[1:] + position[:-1]
    outer = 2.0 * width * (position[1:] + 2.0 * position[:-1]) / (3.0 * total)
    last = np.concatenate([[0.0], outer])
    weight = np.concatenate([2.0 * width - outer, [0.0]]) + last
    further = partial(
        line_springs, radius_of_sphere=radius_of_sphere, core=core, per_radius=per_radius, profile=profile
    )
    return Springs(position, gap, weight, last, nan, further)


def ring_springs(reach: float, radius_of_sphere: float, width: float, profile: Profile = "parabola") -> Springs:
    """Cover a disc with rings of a width [m] (the thesis's lambda), at most 4000, and turn them into springs."""
    count = ceil(reach / width) + 2
    if profile == "sphere":
        count = min(count, int(radius_of_sphere / width))
    if not 2 < count <= _MOST_RINGS:
        raise InputError(
            f"rings of {width:.3g} m on a contact of {reach:.3g} m: {count} rings, expected 3 to "
            f"{_MOST_RINGS}; choose another ring width"
        )
    middle = np.linspace(0.5, count - 0.5, count) * width
    factors = _factors(count)
    both = np.stack([np.ones(count), surface_gap(middle, radius_of_sphere, profile)], axis=1)
    unit, shape = solve_triangular(factors, both, lower=True, unit_diagonal=True).T
    area = pi * (2.0 * np.arange(count) + 1.0)
    weight = width * solve_triangular(factors, area, trans="T") * unit
    further = partial(ring_springs, radius_of_sphere=radius_of_sphere, width=width, profile=profile)
    return Springs(middle, shape / unit, weight, weight, _EDGE_BIAS * width, further)


def disc_displacement(r: Floats, c: Floats) -> Floats:
    """Displacement at ``r`` under unit pressure on a disc of radius ``c``, at unit compliance.

    ``r``, ``c`` [m]: broadcast against each other; ``r`` is positive. Returns ``U(r, c)``; multiply by
    ``(1 - nu**2)/E`` and the pressure.
    """
    r, c = np.broadcast_arrays(np.asarray(r, dtype=float), np.asarray(c, dtype=float))
    larger = np.maximum(r, c)
    parameter = (np.minimum(r, c) / larger) ** 2
    second = ellipe(parameter)
    # K is infinite at the rim of the disc, where its factor is zero.
    first = np.where(parameter < 1.0, (1.0 - parameter) * ellipk(np.where(parameter < 1.0, parameter, 0.0)), 0.0)
    return 4.0 / pi * np.where(r <= c, larger * second, larger * (second - first))


def influence(n_rings: int) -> Floats:
    """Displacement (ring, ring) at the middle of each ring by unit pressure on each (thesis, eq. 3.4).

    For rings of unit width and unit compliance.
    """
    rim = np.linspace(0.0, n_rings, n_rings + 1)
    return np.diff(disc_displacement(rim[:-1, None] + 0.5, rim[None, :]), axis=1)


@lru_cache(maxsize=4)
def _factors(n_rings: int) -> Floats:
    """Both factors (ring, ring) of the influence matrix, from the centre outwards, in one array.

    A ring moves its own middle most, so that no rows are exchanged: the leading block of every smaller contact is
    factored too.
    """
    both, exchanged = lu_factor(influence(n_rings), overwrite_a=True)
    if np.any(exchanged != np.arange(n_rings)):
        raise LabpipeError("the influence matrix of the rings was factored in another order than from the centre")
    both.flags.writeable = False
    return np.asarray(both)


def surface_gap(r: Floats, radius_of_sphere: float, profile: Profile) -> Floats:
    """Distance (ring,) in m of the undeformed sphere from the flat when its pole touches."""
    if profile == "sphere":
        return r**2 / (radius_of_sphere + np.sqrt(radius_of_sphere**2 - r**2))
    return 0.5 * r**2 / radius_of_sphere

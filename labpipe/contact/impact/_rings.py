r"""A sphere on a flat by boundary elements: rings of constant pressure, as independent springs.

The displacement at ``r`` under a unit pressure on a disc of radius ``c`` (thesis, eq. 3.5) is, for a unit
compliance ``(1 - nu^2)/E``,

.. math:: U(r, c) = \frac{4}{\pi}\begin{cases} c\,E(r/c) & r \le c\\
          r\,[E(c/r) - (1 - c^2/r^2)\,K(c/r)] & r > c\end{cases}

with the complete elliptic integrals K and E of the *modulus*; scipy takes its square. A ring is the difference of two
discs, collocated at its middle radius. With the influence matrix factored from the centre outwards, ``G = L U`` without
pivoting, each ``y_j`` of ``y = U p`` is a spring: ``J* conv y_j = approach (L^-1 1)_j - (L^-1 g)_j``. The gap of a ring
is the mean over its width: the force of an elastic contact is good to 1e-6 at 20 rings, 4e-8 at 60.
"""

from functools import lru_cache
from math import ceil, pi
from typing import Literal

import numpy as np
from scipy.linalg import lu_factor, solve_triangular
from scipy.special import ellipe, ellipk

from labpipe.arrays import Floats
from labpipe.contact._springs import SpringBed
from labpipe.errors import InputError

Profile = Literal["parabola", "sphere"]

# The edge between the last loaded and the next ring, found by the sign of the load, lies outside
# the true edge by this part of a ring's width: measured on Hertz from 10 to 320 rings per radius.
_EDGE_BIAS = 0.1765
# The factors are n x n: more than this would take minutes and gigabytes.
_MOST_RINGS = 4000


def ring_bed(reach: float, radius: float, width: float, profile: Profile = "parabola") -> SpringBed:
    """Cover a disc with rings of a width [m] (the thesis's lambda), at most 4000, and turn them into springs."""
    count = ceil(reach / width) + 2
    if profile == "sphere":
        count = min(count, int(radius / width))
    if not 2 < count <= _MOST_RINGS:
        raise InputError(f"{count} rings of {width:.3g} m, expected 3 to {_MOST_RINGS}; choose another ring width")
    middle = np.linspace(0.5, count - 0.5, count) * width
    factors = _factors(count)
    heights = surface_gap(middle, radius, profile) + width**2 / (24.0 * radius)
    both = np.stack([np.ones(count), heights], axis=1)
    unit, shape = solve_triangular(factors, both, lower=True, unit_diagonal=True).T
    area = pi * (2.0 * np.arange(count) + 1.0)
    stiffness = width * solve_triangular(factors, area, trans="T") * unit
    return SpringBed(shape / unit, stiffness, middle - _EDGE_BIAS * width)


def disc_displacement(r: Floats, c: Floats) -> Floats:
    """Displacement ``U(r, c)`` [m] at ``r`` under unit pressure on a disc of radius ``c`` [m], at unit compliance."""
    r, c = np.broadcast_arrays(np.asarray(r, dtype=float), np.asarray(c, dtype=float))
    larger = np.maximum(r, c)
    parameter = (np.minimum(r, c) / larger) ** 2
    second = ellipe(parameter)
    # K is infinite at the rim of the disc, where its factor is zero.
    first = np.where(parameter < 1.0, (1.0 - parameter) * ellipk(np.where(parameter < 1.0, parameter, 0.0)), 0.0)
    return 4.0 / pi * np.where(r <= c, larger * second, larger * (second - first))


def influence(n_rings: int) -> Floats:
    """Displacement (ring, ring) of the middle of rings of unit width by unit pressure on each (thesis, eq. 3.4)."""
    rim = np.linspace(0.0, n_rings, n_rings + 1)
    return np.diff(disc_displacement(rim[:-1, None] + 0.5, rim[None, :]), axis=1)


@lru_cache(maxsize=4)
def _factors(n_rings: int) -> Floats:
    """Both factors (ring, ring) of the influence matrix, from the centre outwards, in one array."""
    both, exchanged = lu_factor(influence(n_rings), overwrite_a=True)
    # A ring moves its own middle most, so that no rows are exchanged.
    assert np.array_equal(exchanged, np.arange(n_rings))  # noqa: S101
    both.flags.writeable = False
    return np.asarray(both)


def surface_gap(r: Floats, radius_of_sphere: float, profile: Profile) -> Floats:
    """Distance (ring,) in m of the undeformed sphere from the flat when its pole touches."""
    if profile == "sphere":
        return r**2 / (radius_of_sphere + np.sqrt(radius_of_sphere**2 - r**2))
    return 0.5 * r**2 / radius_of_sphere

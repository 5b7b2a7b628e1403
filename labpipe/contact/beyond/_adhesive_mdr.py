r"""Adhesion of any axisymmetric indenter, by the method of dimensionality reduction.

A profile f(r) becomes the one-dimensional one, g(x) = x ∫₀^x f′(r)/√(x² − r²) dr; springs under it
carry q = E*(δ − g). Heß's rule [1]_: with adhesion the springs at the edge are stretched by

.. math:: \Delta l(a) = \sqrt{2\pi a w/E^*}, \qquad \delta = g(a) - \Delta l(a),

which is JKR for every profile. With a finite cohesive stress σ₀ out to c (Dugdale, [2]_) the
attraction itself is q = −2σ₀√(c² − x²) beyond a, no stress is singular, and c is where
σ₀ times the gap is w:

.. math::
    \delta = g(a) - \frac{2\sigma_0}{E^*}\sqrt{c^2 - a^2}, \qquad
    F = 2E^*\int_0^a (\delta - g)\,dx - 2\sigma_0\left(c^2\arccos\frac ac - a\sqrt{c^2-a^2}\right).

Validity: elastic half-space, one contact disc, f convex enough that the contact stays a disc.

References
----------
.. [1] M. Heß, Über die exakte Abbildung ausgewählter dreidimensionaler Kontakte auf Systeme mit
   niedrigerer räumlicher Dimension (2011); V. L. Popov, M. Heß, E. Willert, Handbook of Contact
   Mechanics (2019), chapter 3, https://doi.org/10.1007/978-3-662-58709-6.
.. [2] D. Maugis, J. Colloid Interface Sci. 150 (1992) 243,
   https://doi.org/10.1016/0021-9797(92)90285-T.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar

from labpipe.arrays import Floats
from labpipe.contact.beyond._adhesion import AdhesiveContact
from labpipe.errors import InputError
from labpipe.units import require_positive

Slope = Callable[[Floats], Floats]

_POINTS = 64
_LEGENDRE = np.polynomial.legendre.leggauss(_POINTS)
_NODES, _WEIGHTS = 0.5 * (_LEGENDRE[0] + 1.0), 0.5 * _LEGENDRE[1]
"""Of an integral over [0, 1]."""
_WIDEST = 1e4  # times the contact radius: a cohesive zone that wide is no contact any more


def slope_of(shape: str, size: float) -> Slope:
    """Slope f′(r) of a named indenter.

    ``shape``; ``size``: radius [m] of parabola and sphere; slope (tangent of the angle to the surface) of the cone; of
    no meaning for a flat end. Raises InputError: the name is unknown.
    """
    slopes: dict[str, Slope] = {
        "parabola": lambda r: r / size,
        "sphere": lambda r: r / np.sqrt(size**2 - r**2),
        "cone": lambda r: np.full_like(r, size),
        "flat": np.zeros_like,
    }
    if shape not in slopes:
        raise InputError(f'shape "{shape}" is unknown; use one of {", ".join(slopes)}')
    return slopes[shape]


def adhesive_indentation(
    slope: Slope, contact_radius: ArrayLike, reduced_modulus: float, work: float, stress: float | None = None
) -> AdhesiveContact:
    """States of an adhesive contact of any profile.

    Parameters
    ----------
    slope : callable
        f′(r) of the profile, array [m] to array; smooth between 0 and the contact radius (up to
        the cohesive radius with a stress). See :func:`slope_of`.
    contact_radius : array (state,) [m]
        Positive.
    reduced_modulus : float [Pa]
        E*.
    work : float [J/m2]
        Of adhesion; 0 is a contact without it.
    stress : float [Pa], optional
        Cohesive stress of Dugdale; without it that of JKR, infinite.

    Returns
    -------
    AdhesiveContact
        Arrays (state,).

    Raises
    ------
    InputError
        A value is out of range, or the cohesive zone has no end.

    Examples
    --------
    A cone of slope 1 at its pull-off, 54 w²/(π E*):

    >>> edge = 18.0 * 0.05 / (np.pi * 1e6)
    >>> state = adhesive_indentation(slope_of("cone", 1.0), [edge], 1e6, 0.05)
    >>> round(float(state.force[0]) / (54.0 * 0.05**2 / (np.pi * 1e6)), 12)
    -1.0
    """
    radii = np.atleast_1d(np.asarray(contact_radius, dtype=float))
    require_positive("Pa", reduced_modulus=reduced_modulus, stress=stress or 1.0)
    if not (np.all(radii > 0.0) and np.all(np.isfinite(radii)) and work >= 0.0):
        raise InputError(f"contact radii {radii} m and work {work} J/m2; expected positive, and from 0 up")
    rows = [_state(slope, float(a), reduced_modulus, work, stress) for a in radii]
    force, indentation, reach = np.array(rows).T
    return AdhesiveContact(radii, force, indentation, reach)


def adhesive_pull_off(
    slope: Slope, reduced_modulus: float, work: float, bounds: tuple[float, float], stress: float | None = None
) -> float:
    """Largest force [N] with which a contact pulls, over contact radii within bounds [m]."""

    def force(log_radius: float) -> float:
        state = adhesive_indentation(slope, [np.exp(log_radius)], reduced_modulus, work, stress)
        return float(state.force[0])

    ends = np.log(bounds)
    best = minimize_scalar(force, bounds=ends, method="bounded", options={"xatol": 1e-10})
    return -min(float(best.fun), force(float(ends[0])), force(float(ends[1])))


def line_profile(slope: Slope, position: Floats) -> Floats:
    """One-dimensional profile g(x) [m] = x ∫₀^{π/2} f′(x sin φ) dφ at positions (n,) [m]."""
    sines = np.sin(0.5 * np.pi * _NODES)
    return np.asarray(position * 0.5 * np.pi * (slope(position[:, None] * sines) @ _WEIGHTS))


def _state(slope: Slope, a: float, modulus: float, work: float, stress: float | None) -> tuple[float, float, float]:
    edge = float(line_profile(slope, np.array([a]))[0])
    # E* ∫(δ − g) over the contact is a δ less the area under g.
    area = a * float(line_profile(slope, a * _NODES) @ _WEIGHTS)
    if stress is None or work == 0.0:
        indentation = edge - np.sqrt(2.0 * np.pi * a * work / modulus)
        return float(2.0 * modulus * (indentation * a - area)), float(indentation), a
    reach = _cohesive_radius(slope, a, edge, modulus, work, stress)
    root = np.sqrt(reach**2 - a**2)
    indentation = edge - 2.0 * stress / modulus * root
    pull = 2.0 * stress * (reach**2 * np.arccos(a / reach) - a * root)
    return float(2.0 * modulus * (indentation * a - area) - pull), float(indentation), reach


def _cohesive_radius(slope: Slope, a: float, edge: float, modulus: float, work: float, stress: float) -> float:
    """Radius at which the gap times the stress is the work of adhesion."""

    def excess(log_width: float) -> float:
        reach = a * (1.0 + np.exp(log_width))
        indentation = edge - 2.0 * stress / modulus * np.sqrt(reach**2 - a**2)
        height = reach * float(slope(reach * _NODES) @ _WEIGHTS)
        # Surface outside: u(c) = (2/π) ∫ q/(E* √(c² − x²)) dx, with x = c sin φ.
        span = np.arcsin(a / reach)
        under = indentation - line_profile(slope, reach * np.sin(span * _NODES))
        raised = 2.0 / np.pi * (span * (under @ _WEIGHTS) - 2.0 * stress / modulus * (reach - a))
        return float(stress * (height - indentation + raised) / work - 1.0)

    low, high = np.log(1e-12), np.log(_WIDEST)
    if not excess(low) < 0.0 < excess(high):
        raise InputError(
            f"the cohesive zone around a contact of {a:g} m has no end within {_WIDEST:g} of its "
            "radius; the profile ends before that, or the stress is too small"
        )
    return float(a * (1.0 + np.exp(brentq(excess, low, high, xtol=1e-14))))

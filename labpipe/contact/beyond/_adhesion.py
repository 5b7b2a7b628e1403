r"""Adhesion of an elastic sphere to a rigid flat: JKR, DMT, and Maugis–Dugdale between them.

Notation: reduced modulus E* = E/(1 − ν²), sphere radius R, work of adhesion w (the energy of both
surfaces less that of the interface), contact radius a. Forces are positive when they press.

Validity: elastic, smooth, quasi-static, a ≪ R. A viscoelastic solid sticks more firmly when it is
pulled off fast, at most by E_unrelaxed/E_relaxed [4]_, and real roughness reduces w by orders of
magnitude: the numbers here are upper bounds for a rough surface. Adhesion with memory (a crack that
moves while the bulk relaxes) has no closed form that could check a solver and is not offered.

References
----------
.. [1] K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. A 324 (1971) 301,
   https://doi.org/10.1098/rspa.1971.0141.
.. [2] D. Maugis, J. Colloid Interface Sci. 150 (1992) 243,
   https://doi.org/10.1016/0021-9797(92)90285-T.
.. [3] K. L. Johnson, J. A. Greenwood, J. Colloid Interface Sci. 192 (1997) 326,
   https://doi.org/10.1006/jcis.1997.4984.
.. [4] B. N. J. Persson, E. A. Brener, Phys. Rev. E 71 (2005) 036123,
   https://doi.org/10.1103/PhysRevE.71.036123.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.units import require_positive

Theory = Literal["jkr", "dmt", "maugis"]

EQUILIBRIUM_DISTANCE = 0.3e-9
"""m; distance of two surfaces at which their attraction vanishes, of about an atom."""

# Lennard-Jones attraction at its strongest, in units of w/z0: 16/(9√3) = 1.026.
_STRONGEST = 16.0 / (9.0 * np.sqrt(3.0))
# Johnson and Greenwood's map: DMT below, JKR above, the transition between.
_DMT_BELOW, _JKR_ABOVE = 0.1, 5.0
# Halvings of an angle below π/2 down to rounding.
_HALVINGS = 60
# Contact radii, in units of (πwR²/K)^{1/3}, among which a contact parts: it does at 1 at most.
_LEAST_RADIUS, _MOST_RADIUS = 1e-6, 20.0


class AdhesiveContact(NamedTuple):
    """States of an adhesive contact; every member has the shape of the contact radius.

    Attributes
    ----------
    contact_radius : array [m]
        Of the intimate contact.
    force : array [N]
        Positive when it presses.
    indentation : array [m]
        Approach, negative where the surface is drawn out.
    cohesive_radius : array [m]
        Up to here the surfaces attract each other; the contact radius itself in JKR.
    """

    contact_radius: Floats
    force: Floats
    indentation: Floats
    cohesive_radius: Floats


def jkr(contact_radius: ArrayLike, radius: float, reduced_modulus: float, work: float) -> AdhesiveContact:
    """State at a contact radius: F = 4E*a³/3R − √(8πwE*a³), δ = a²/R − √(2πaw/E*).

    Parameters
    ----------
    contact_radius : array [m]
        Not negative. Below that of :func:`pull_off` a state cannot be kept.
    radius : float [m]
        Of the sphere.
    reduced_modulus : float [Pa]
        E*.
    work : float [J/m2]
        Of adhesion, w; 0 is Hertz.

    Raises
    ------
    InputError
        A value is out of range.

    Examples
    --------
    >>> state = jkr(1e-3, radius=0.01, reduced_modulus=1e6, work=0.05)
    >>> round(float(state.force), 5), round(float(state.indentation) * 1e6, 3)
    (0.09788, 82.275)
    """
    a = _checked(contact_radius, radius, reduced_modulus, work)
    force = 4.0 * reduced_modulus * a**3 / (3.0 * radius)
    force = force - np.sqrt(8.0 * np.pi * work * reduced_modulus * a**3)
    indentation = a**2 / radius - np.sqrt(2.0 * np.pi * a * work / reduced_modulus)
    return AdhesiveContact(a, force, indentation, a)


def dmt(contact_radius: ArrayLike, radius: float, reduced_modulus: float, work: float) -> AdhesiveContact:
    """State of a stiff small sphere: Hertz, and the attraction 2πwR around it.

    See :func:`jkr` for the parameters.
    """
    a = _checked(contact_radius, radius, reduced_modulus, work)
    force = 4.0 * reduced_modulus * a**3 / (3.0 * radius) - 2.0 * np.pi * work * radius
    return AdhesiveContact(a, force, a**2 / radius, a)


def jkr_at_force(force: ArrayLike, radius: float, reduced_modulus: float, work: float) -> AdhesiveContact:
    """Stable state under a load: a³ = (3R/4E*)(F + 3πwR + √(6πwRF + (3πwR)²)).

    Raises
    ------
    InputError
        A force pulls harder than the contact holds, or a value is out of range.

    Examples
    --------
    >>> state = jkr_at_force(0.0, radius=0.01, reduced_modulus=1e6, work=0.05)
    >>> round(float(state.contact_radius) * 1e3, 4)
    0.4135
    """
    load = np.asarray(force, dtype=float)
    _checked(0.0, radius, reduced_modulus, work)
    scale = 3.0 * np.pi * work * radius
    least = -0.5 * scale
    if not np.all(load >= least * (1.0 + 1e-12)):
        raise InputError(f"force is {load} N; the contact holds {-least:.4g} N and no more")
    root = np.sqrt(np.maximum(2.0 * scale * load + scale**2, 0.0))
    a = np.cbrt(0.75 * radius / reduced_modulus * (load + scale + root))
    return jkr(a, radius, reduced_modulus, work)._replace(force=load)


def tabor(
    radius: float, reduced_modulus: float, work: float, equilibrium_distance: float = EQUILIBRIUM_DISTANCE
) -> float:
    """Tabor's parameter μ = (R w²/(E*² z₀³))^{1/3}: height of the neck over the reach of forces.

    Above 5 JKR holds, below 0.1 DMT, :func:`maugis` everywhere (Johnson and Greenwood, 10.1006/jcis.1997.4984).

    Examples
    --------
    >>> round(tabor(9.525e-3, 3.6e9, 0.05), 1)
    40.8
    """
    _checked(0.0, radius, reduced_modulus, work)
    require_positive("m", equilibrium_distance=equilibrium_distance)
    reach = (radius * (work / reduced_modulus) ** 2) ** (1.0 / 3.0)
    return float(reach / equilibrium_distance)


def regime(tabor_parameter: float) -> str:
    """Name the theory that holds: ``"JKR"``, ``"DMT"``, or ``"Maugis"`` between them."""
    if tabor_parameter >= _JKR_ABOVE:
        return "JKR"
    return "DMT" if tabor_parameter <= _DMT_BELOW else "Maugis"


def cohesive_stress(work: float, equilibrium_distance: float = EQUILIBRIUM_DISTANCE) -> float:
    """Dugdale's constant attraction [Pa]: the strongest of a Lennard-Jones force, 1.03 w/z₀."""
    require_positive("m", equilibrium_distance=equilibrium_distance)
    return _STRONGEST * work / equilibrium_distance


def maugis_parameter(radius: float, reduced_modulus: float, work: float, stress: float) -> float:
    """Maugis's parameter λ = σ₀ (9R/(2πwE*²))^{1/3}, which is 1.16 μ.

    Parameters
    ----------
    radius, reduced_modulus, work : float
        See :func:`jkr`.
    stress : float [Pa]
        Attraction of the surfaces, see :func:`cohesive_stress`.
    """
    _checked(0.0, radius, reduced_modulus, work)
    require_positive("J/m2", work=work)
    require_positive("Pa", stress=stress)
    return float(stress * (9.0 * radius / (2.0 * np.pi * work * reduced_modulus**2)) ** (1 / 3))


def maugis(
    contact_radius: ArrayLike, radius: float, reduced_modulus: float, work: float, stress: float
) -> AdhesiveContact:
    """State after Maugis: a constant attraction σ₀ acts between a and c, where the gap is w/σ₀.

    Parameters
    ----------
    contact_radius : array [m]
        Positive.
    radius, reduced_modulus, work : float
        See :func:`jkr`; work positive.
    stress : float [Pa]
        σ₀, see :func:`cohesive_stress`.

    Notes
    -----
    Maugis (10.1016/0021-9797(92)90285-T), equations (6.16) to (6.18), with m = c/a = 1/cos θ.
    Solved to rounding; JKR is the limit λ → ∞, DMT is λ → 0.

    Examples
    --------
    >>> scale = (np.pi * 0.05 * 0.75 / 1e6 * 0.01**2) ** (1 / 3)
    >>> state = maugis(scale, 0.01, 1e6, 0.05, 1e9)
    >>> near = jkr(scale, 0.01, 1e6, 0.05)
    >>> abs(float(state.force / near.force) - 1) < 2e-3
    True
    """
    a = _checked(contact_radius, radius, reduced_modulus, work)
    rate = maugis_parameter(radius, reduced_modulus, work, stress)
    if not np.all(a > 0.0):
        raise InputError(f"contact_radius is {a} m; Maugis's theory needs more than 0")
    stiffness = 4.0 * reduced_modulus / 3.0
    width = (np.pi * work * radius**2 / stiffness) ** (1.0 / 3.0)
    A = a / width
    angle = _neck(A, rate)
    force, indentation = _maugis_state(A, rate, angle)
    depth = (np.pi * work / stiffness) ** (2.0 / 3.0) * radius ** (1.0 / 3.0)
    return AdhesiveContact(a, np.pi * work * radius * force, depth * indentation, a / np.cos(angle))


def pull_off(
    radius: float, reduced_modulus: float, work: float, theory: Theory = "jkr", stress: float | None = None
) -> float:
    """Force [N] that parts the surfaces, positive.

    3/2 πwR in JKR, 2πwR in DMT, and between them (found numerically) in Maugis's theory.

    Parameters
    ----------
    radius, reduced_modulus, work : float
        See :func:`jkr`.
    theory : "jkr", "dmt" or "maugis"
    stress : float [Pa], optional
        Of Maugis; by default :func:`cohesive_stress`.

    Examples
    --------
    >>> round(pull_off(9.525e-3, 3.6e9, 0.05) * 1e3, 3)
    2.244
    """
    _checked(0.0, radius, reduced_modulus, work)
    scale = np.pi * work * radius
    if theory in ("jkr", "dmt") or work == 0.0:
        return float(scale * (1.5 if theory == "jkr" else 2.0))
    if theory != "maugis":
        raise InputError(f'theory "{theory}" is unknown; use "jkr", "dmt" or "maugis"')
    rate = maugis_parameter(radius, reduced_modulus, work, cohesive_stress(work) if stress is None else stress)

    def force(log_radius: float) -> float:
        A = np.asarray(np.exp(log_radius))
        return float(_maugis_state(A, rate, _neck(A, rate))[0])

    # Stiff contacts part at a point, soft ones at A = 1/2^{1/3}…1: one minimum, maybe at the end.
    ends = (np.log(_LEAST_RADIUS), np.log(_MOST_RADIUS))
    best = minimize_scalar(force, bounds=ends, method="bounded", options={"xatol": 1e-10})
    return float(-scale * min(best.fun, force(ends[0])))


def lost_energy(radius: float, reduced_modulus: float, work: float) -> float:
    """Energy [J] that closing and opening a JKR contact costs: 7.09 (w⁵R⁴/E*²)^{1/3}.

    The surfaces jump together at δ = 0 and part where dF/dδ is infinite; between the two the work
    ∫F dδ is lost to waves and heat.

    Examples
    --------
    >>> round(lost_energy(1.0, 1.0, 1.0), 3)
    7.092
    """
    _checked(0.0, radius, reduced_modulus, work)

    def integral(cube: float) -> float:
        """∫F dδ up to a³ = cube, in units of (w⁵R⁴/E*²)^{1/3}."""
        a = cube ** (1.0 / 3.0)
        bend = 4.0 / 3.0 * np.sqrt(2.0 * np.pi) * a**3.5
        return float(8.0 / 15.0 * a**5 - bend + np.pi * a**2)

    scale = (work**5 * radius**4 / reduced_modulus**2) ** (1.0 / 3.0)
    return float(scale * (integral(np.pi / 8.0) - integral(2.0 * np.pi)))


def _neck(A: Floats, rate: float) -> Floats:
    """Angle θ with c/a = 1/cos θ at which the gap at c is w/σ₀, by halving: it is monotone."""
    low, high = np.zeros_like(A), np.full_like(A, 0.5 * np.pi)
    for _ in range(_HALVINGS):
        angle = 0.5 * (low + high)
        tangent = np.tan(angle)
        rise = 2.0 * np.sin(0.5 * angle) ** 2 / np.cos(angle)  # 1/cos θ − 1
        opening = tangent - angle + tangent**2 * angle
        gap = 0.5 * rate * A**2 * opening
        gap = gap + 4.0 / 3.0 * rate**2 * A * (tangent * angle - rise)
        low, high = np.where(gap < 1.0, angle, low), np.where(gap < 1.0, high, angle)
    return np.asarray(0.5 * (low + high))


def _maugis_state(A: Floats, rate: float, angle: Floats) -> tuple[Floats, Floats]:
    """Force over πwR and indentation over (π²w²R/K²)^{1/3}."""
    tangent = np.tan(angle)
    force = A**3 - rate * A**2 * (tangent + angle * (1.0 + tangent**2))
    return force, A**2 - 4.0 / 3.0 * rate * A * tangent


def _checked(contact_radius: ArrayLike, radius: float, modulus: float, work: float) -> Floats:
    require_positive("m", radius=radius)
    require_positive("Pa", reduced_modulus=modulus)
    if not (np.isfinite(work) and work >= 0.0):
        raise InputError(f"work is {work} J/m2, expected a number from 0 up")
    a = np.asarray(contact_radius, dtype=float)
    if not np.all((a >= 0.0) & np.isfinite(a)):
        raise InputError(f"contact_radius is {a} m, expected numbers from 0 up")
    return a

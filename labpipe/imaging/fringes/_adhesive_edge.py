"""The edge of a contact that adhesion holds, from the Hertz gap that its fringes show.

Adhesion opens the gap beside a contact by that of a flat punch, √(2πaw/E*) (2/π) arccos(a/r). The
derivative of Hertz's gap by its radius, -4a arccos(a/r)/(πR), has the same shape: fringes cannot
tell an adhesive contact from a Hertz contact that is smaller by R √(πw/(2aE*)). The fitted radius
is therefore that of the Hertz gap, and the edge follows from it with w and E*.

The two shapes part where the shift s is no longer small against the distance d of the first bright ring
from the edge: to second order they are alike for a shift of s (1 + s/(4d)).
"""

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError

#: Work of adhesion (J/m²) where none is stated: a clean smooth polymer on glass or sapphire, the
#: most to expect; roughness and dust take away most of it.
USUAL_WORK = 0.05
#: The closed form holds to this share of the difference, and to as much of it again as it is of the radius.
_CLOSED_FORM = 0.03
#: How far apart (m) surfaces still attract each other, at most: a third of a nanometre where they are clean and smooth,
#: and about one over roughness.
_REACH = 1e-9
#: Images of contacts whose attraction is the same up to its reach (Dugdale's, as in D. Maugis's theory) show an edge
#: that lies inside JKR's by the share r/(r + this) of the difference, to 0.05, with r as in :func:`edge_shift`.
_BY_REACH = 2.4
#: Rounds of the fixed point; each at least halves the error.
_ROUNDS = 40


def adhesive_edge(
    hertz_radius: ArrayLike,
    sphere_radius: float,
    reduced_modulus: float,
    work_of_adhesion: float = USUAL_WORK,
    wavelength: float | None = None,
) -> Floats:
    """Radius of a JKR contact whose fringes are those of a Hertz contact.

    Parameters
    ----------
    hertz_radius : array [m]
        Hertz-equivalent radius, as :func:`.contact_radius` finds it; NaN stays NaN.
    sphere_radius : float [m]
        Effective radius of the sphere.
    reduced_modulus : float [Pa]
        E* = E/(1 - ν²) of both bodies together.
    work_of_adhesion : float, optional [J/m²]
        w; 0 is Hertz. By default that of a clean smooth polymer.
    wavelength : float, optional [m]
        Of the light; with it the second order is added, which tells of 5 to 10 % of the difference where
        this is 1 % of the radius.

    Returns
    -------
    array [m]
        a = a_Hertz + s (1 + s/(4d)) with s = R √(πw/(2aE*)), and d the distance of the first bright ring
        from the edge; without a wavelength a = a_Hertz + s. On images of exact JKR contacts (E* 1 to
        5 GPa, w 2 to 50 mJ/m², difference up to 1.8 % of the radius) right to 2 % of the difference.

    Raises
    ------
    InputError
        A value out of its range.

    References
    ----------
    K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. A 324 (1971) 301,
    https://doi.org/10.1098/rspa.1971.0141

    Examples
    --------
    >>> round(float(adhesive_edge(300e-6, 9.525e-3, 5e9, 2e-3)) * 1e6, 2)
    300.44
    """
    found = np.asarray(hertz_radius, float)
    if not (np.isfinite(sphere_radius) and sphere_radius > 0.0):
        message = f"sphere_radius must be positive, found {sphere_radius} m"
        raise InputError(message)
    if not (np.isfinite(reduced_modulus) and reduced_modulus > 0.0):
        message = f"reduced_modulus must be positive, found {reduced_modulus} Pa"
        raise InputError(message)
    if not (np.isfinite(work_of_adhesion) and work_of_adhesion >= 0.0):
        message = f"work_of_adhesion must be 0 or more, found {work_of_adhesion} J/m2"
        raise InputError(message)
    if np.any(found <= 0.0):
        message = "hertz_radius must be positive"
        raise InputError(message)
    scale = sphere_radius * np.sqrt(0.5 * np.pi * work_of_adhesion / reduced_modulus)
    edge = found + 0.0
    for _ in range(_ROUNDS):
        edge = found + scale / np.sqrt(edge)
    if wavelength is not None:
        # Hertz's gap opens as 8 √2/(3π) a²/R (r/a - 1)^(3/2), and is a quarter of a wavelength in the bright ring
        ring = found * (3.0 * np.pi * sphere_radius * wavelength / (32.0 * np.sqrt(2.0) * found**2)) ** (2.0 / 3.0)
        edge = edge + (edge - found) ** 2 / (4.0 * ring)
    return np.asarray(edge)


def edge_of_spot(
    half_radius: ArrayLike, sphere_radius: float, reduced_modulus: float, work_of_adhesion: float, wavelength: float
) -> Floats:
    """Radius of a JKR contact of whose spot only the circle of half brightness is known.

    Parameters
    ----------
    half_radius : array [m]
        Where the gap is an eighth of a wavelength.
    sphere_radius, reduced_modulus, work_of_adhesion, wavelength : float [m, Pa, J/m², m]

    Returns
    -------
    array [m]
    """
    r = np.asarray(half_radius, float)
    low, high = 0.01 * r, r
    for _ in range(_ROUNDS):
        a = 0.5 * (low + high)
        beyond = np.sqrt(2.0 * np.pi * a * work_of_adhesion / reduced_modulus) * (2.0 / np.pi) * np.arccos(a / r)
        hertz = (a * np.sqrt(r**2 - a**2) - (2.0 * a**2 - r**2) * np.arccos(a / r)) / (np.pi * sphere_radius)
        is_wide = hertz + beyond > wavelength / 8.0
        low, high = np.where(is_wide, a, low), np.where(is_wide, high, a)
    return np.asarray(0.5 * (low + high))


def edge_shift(
    shift: Floats, radius: Floats, reduced_modulus: float, work: float | None, u_work: float = 0.0
) -> tuple[Floats, Floats]:
    """Return how far an edge lies outside Hertz's radius, and the standard uncertainty of that.

    Parameters
    ----------
    shift, radius : array [m]
        Distance for the work of adhesion, or for :data:`USUAL_WORK`, by JKR; Hertz's radius.
    reduced_modulus : float [Pa]
    work : float or None [J/m²]
        As it is stated; None: the edge lies anywhere up to the distance.
    u_work : float [J/m²]

    Notes
    -----
    Around a stiff body that sticks little, surfaces attract each other across a ring of width πE*z²/(4w) when
    they do so up to a distance z: with r² this width over the shift, the edge lies nearer to Hertz's, as in
    the theory of Derjaguin, Muller and Toporov, from r = 2 on more so than to JKR's.
    """
    if work is None:
        return 0.5 * shift, shift / np.sqrt(12.0)
    if work == 0.0:
        return shift, 0.0 * shift
    r = _REACH * np.sqrt(np.pi * reduced_modulus / (4.0 * work * np.maximum(shift, 1e-15)))
    # of what lies evenly on one side, the root mean square
    shares = (np.full_like(shift, _CLOSED_FORM), shift / radius, r / (r + _BY_REACH) / np.sqrt(3.0))
    return shift, shift * np.sqrt((0.5 * u_work / work) ** 2 + sum(share**2 for share in shares))

"""The edge of a contact that adhesion holds, from the Hertz gap that its fringes show.

Adhesion opens the gap beside a contact by that of a flat punch, √(2πaw/E*) (2/π) arccos(a/r). The derivative of
Hertz's gap by its radius, -4a arccos(a/r)/(πR), has the same shape: fringes do not distinguish an adhesive contact from
a Hertz contact that is smaller by s = R √(πw/(2aE*)). The fitted radius is that of the Hertz gap, and the edge follows
from it with w and E*. To second order the shapes are equal for a shift of s (1 + s/(4d)), d being the distance of the
first bright ring from the edge.
"""

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError

#: Wavelength (m) where none is stated: the middle of white light.
NOMINAL_WAVELENGTH = 550e-9
#: Work of adhesion (J/m²) where none is stated: a clean smooth polymer on glass or sapphire, the most to expect.
USUAL_WORK = 0.05
#: The closed form holds to this share of the difference, and to as much of it again as it is of the radius.
_CLOSED_FORM = 0.03
#: The same where the edge of a dark spot determined the radius: exact JKR contacts of 3 to 10 MPa lie within it.
_BY_SPOT = 0.3
#: How far apart (m) surfaces still attract each other, at most: a third of a nanometre where they are clean and smooth,
#: and about one over roughness.
_REACH = 1e-9
#: Images of contacts whose attraction is the same up to its reach (Dugdale's, as in D. Maugis's theory) show an edge
#: that lies inside JKR's by the share r/(r + this) of the difference, to 0.05, with r as in :func:`edge_shift`.
_BY_REACH = 2.4


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
        Of the light; with it the second order is added, 5 to 10 % of a difference of 1 % of the radius.

    Returns
    -------
    array [m]
        a = a_Hertz + s (1 + s/(4d)); without a wavelength a = a_Hertz + s. On images of exact JKR contacts (E* 1 to
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
    given = {"sphere_radius": (sphere_radius, "m"), "reduced_modulus": (reduced_modulus, "Pa")}
    for name, (value, unit) in given.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be positive, found {value} {unit}")
    if not (np.isfinite(work_of_adhesion) and work_of_adhesion >= 0.0):
        raise InputError(f"work_of_adhesion must be 0 or more, found {work_of_adhesion} J/m2")
    if np.any(found <= 0.0):
        raise InputError("hertz_radius must be positive")
    scale = sphere_radius * np.sqrt(0.5 * np.pi * work_of_adhesion / reduced_modulus)
    edge = found + 0.0
    for _ in range(np.finfo(float).nmant):  # each round at least halves the error
        edge = found + scale / np.sqrt(edge)
    if wavelength is not None:
        # where Hertz's gap, 8 √2/(3π) a²/R (r/a - 1)^(3/2), is a quarter of a wavelength
        ratio = 3.0 * np.pi * sphere_radius * wavelength / (32.0 * np.sqrt(2.0) * found**2)
        first_ring = found * ratio ** (2.0 / 3.0)
        edge = edge + (edge - found) ** 2 / (4.0 * first_ring)
    return np.asarray(edge)


def edge_shift(
    radius: Floats,
    sphere_radius: float,
    reduced_modulus: float,
    work: float | None,
    u_work: float,
    wavelength: float | None,
    is_spot: ArrayLike = False,
) -> tuple[Floats, Floats]:
    """Return how far an edge lies outside Hertz's radius, and the standard uncertainty of that.

    ``radius`` [m] is Hertz-equivalent, ``work`` [J/m²] as stated, or None: the edge then lies anywhere up to where
    :data:`USUAL_WORK` puts it. ``is_spot`` tells where the edge of a dark spot determined the radius instead of rings.

    Notes
    -----
    Around a stiff body that sticks little, surfaces attract each other across a ring of width πE*z²/(4w) when
    they do so up to a distance z: with r² this width over the shift, the edge lies nearer to Hertz's, as in
    the theory of Derjaguin, Muller and Toporov, from r = 2 on more so than to JKR's.
    """
    w, light = USUAL_WORK if work is None else work, wavelength or NOMINAL_WAVELENGTH
    bodies = sphere_radius, reduced_modulus, w, light
    shift = adhesive_edge(radius, *bodies) - radius
    if work is None:
        return 0.5 * shift, shift / np.sqrt(12.0)
    if work == 0.0:
        return 0.0 * radius, 0.0 * radius
    r = _REACH * np.sqrt(np.pi * reduced_modulus / (4.0 * w * np.maximum(shift, 1e-15)))
    # of what lies evenly on one side, the root mean square
    form = np.where(is_spot, _BY_SPOT, np.hypot(_CLOSED_FORM, shift / radius))
    shares = (np.full_like(shift, 0.5 * u_work / w), form, r / (r + _BY_REACH) / np.sqrt(3.0))
    return shift, shift * np.sqrt(sum(share**2 for share in shares))

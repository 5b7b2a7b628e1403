"""The edge of a contact that adhesion holds, from the Hertz gap that its fringes show.

Adhesion opens the gap beside a contact by that of a flat punch, √(2πaw/E*) (2/π) arccos(a/r). The
derivative of Hertz's gap by its radius, -4a arccos(a/r)/(πR), has the same shape: fringes cannot
tell an adhesive contact from a Hertz contact that is smaller by R √(πw/(2aE*)). The fitted radius
is therefore that of the Hertz gap, and the edge follows from it with w and E*.
"""

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError

#: Work of adhesion (J/m²) where none is stated: a clean smooth polymer on glass or sapphire, the
#: most to expect; roughness and dust take away most of it.
USUAL_WORK = 0.05
#: The closed form holds to this share of the difference: beyond the first order the shapes differ.
CLOSED_FORM = 0.03
#: Rounds of the fixed point; each at least halves the error.
_ROUNDS = 40


def adhesive_edge(
    hertz_radius: ArrayLike, sphere_radius: float, reduced_modulus: float, work_of_adhesion: float = USUAL_WORK
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

    Returns
    -------
    array [m]
        a = a_Hertz + R √(πw/(2aE*)), right to 3 % of the difference while this is below 1 % of a.

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
    return np.asarray(edge)

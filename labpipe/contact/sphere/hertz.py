r"""Elastic contact of a sphere: static state and impact.

Notation: reduced modulus E* = E/(1 − ν²) of an elastic body on a rigid one, radius R, mass m,
impact speed v. Gravity is neglected in the impacts (it is a small shift).

References
----------
.. [1] H. Hertz, J. reine angew. Math. 92 (1882) 156; K. L. Johnson, Contact Mechanics, 1985,
   sections 4.2 and 11.4, https://doi.org/10.1017/CBO9781139171731.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import beta

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.units import require_positive

CONTACT_TIME = float(0.8 * beta(0.4, 0.5))
"""Duration of an elastic impact in units of (largest approach)/(impact speed): 2.9432751843."""


class SphereContact(NamedTuple):
    """A static state: approach and contact radius [m], force [N], mean and peak pressure [Pa], arrays of one shape."""

    approach: Floats
    contact_radius: Floats
    force: Floats
    mean_pressure: Floats
    peak_pressure: Floats


class Impact(NamedTuple):
    """An elastic impact: peak approach [m], force [N] and contact radius [m], and its duration [s], of one shape."""

    peak_approach: Floats
    peak_force: Floats
    peak_contact_radius: Floats
    contact_duration: Floats


def static_load(force: ArrayLike, radius: float, reduced_modulus: float) -> SphereContact:
    """State under a load: a³ = 3FR/(4E*), δ = a²/R, p0 = 3F/(2πa²).

    Parameters
    ----------
    force : array [N]
        At least 0.
    radius : float [m]
        Of the sphere.
    reduced_modulus : float [Pa]
        E* = E/(1 − ν²).

    Raises
    ------
    InputError
        A force is negative or NaN, or the radius or modulus is not positive.

    Examples
    --------
    >>> state = static_load(0.505 * 9.81, 9.525e-3, 3.2e9 / (1 - 0.35**2))
    >>> round(float(state.contact_radius) * 1e3, 3)
    0.213
    """
    load = _not_negative("force", force, "N")
    require_positive(radius=radius, reduced_modulus=reduced_modulus)
    a = np.cbrt(0.75 * load * radius / reduced_modulus)
    return _state(a, radius, load)


def static_approach(approach: ArrayLike, radius: float, reduced_modulus: float) -> SphereContact:
    """State at an approach [m]: F = (4/3) E* √R δ^{3/2}, a = √(Rδ).

    Raises
    ------
    InputError
        An approach is negative or NaN, or the radius or modulus is not positive.

    Examples
    --------
    >>> round(float(static_approach(69e-6, 9.525e-3, 3.2e9).contact_radius) * 1e3, 2)
    0.81
    """
    depth = _not_negative("approach", approach, "m")
    require_positive(radius=radius, reduced_modulus=reduced_modulus)
    force = 4.0 / 3.0 * reduced_modulus * np.sqrt(radius) * depth**1.5
    return _state(np.sqrt(radius * depth), radius, force)


def impact(speed: ArrayLike, radius: float, mass: float, reduced_modulus: float) -> Impact:
    """Elastic impact without gravity: δ_max = (15 m v²/(16 E* √R))^{2/5}.

    Parameters
    ----------
    speed : array [m/s]
        At first touch; see :func:`drop_speed`.
    radius : float [m]
    mass : float [kg]
        Everything that falls, the holder included.
    reduced_modulus : float [Pa]
        E* = E/(1 − ν²).

    Raises
    ------
    InputError
        A speed or another argument is not positive.

    Examples
    --------
    >>> found = impact(drop_speed(1.5e-3), 9.525e-3, 0.505, 3.2e9 / (1 - 0.35**2))
    >>> round(float(found.peak_approach) * 1e6), round(float(found.contact_duration) * 1e3, 2)
    (69, 1.18)
    """
    v = _not_negative("speed", speed, "m/s")
    if np.any(v == 0.0):
        raise InputError("the impact speed is 0; a sphere put down gently does not bounce")
    require_positive(radius=radius, mass=mass, reduced_modulus=reduced_modulus)
    depth = (15.0 * mass * v**2 / (16.0 * reduced_modulus * np.sqrt(radius))) ** 0.4
    state = static_approach(depth, radius, reduced_modulus)
    return Impact(depth, state.force, state.contact_radius, CONTACT_TIME * depth / v)


def drop_speed(height: ArrayLike, gravity: float = 9.81) -> Floats:
    """Speed √(2gh) [m/s] after a fall through ``height`` [m].

    Examples
    --------
    >>> round(float(drop_speed(1.5e-3)), 4)
    0.1716
    """
    return np.asarray(np.sqrt(2.0 * gravity * _not_negative("height", height, "m")))


def _state(contact_radius: Floats, radius: float, force: Floats) -> SphereContact:
    area = np.pi * contact_radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(area > 0.0, force / area, 0.0)
    return SphereContact(contact_radius**2 / radius, contact_radius, force, mean, 1.5 * mean)


def _not_negative(name: str, values: ArrayLike, unit: str) -> Floats:
    array = np.asarray(values, dtype=float)
    if not np.all(array >= 0.0):
        raise InputError(f"{name} is {array} {unit}, expected numbers from 0 up")
    return array

"""Interference of light in the gap around a Hertz contact: gap, phase, radial tables.

Lengths in this module are in one unit of the caller's choice (the fit uses pixels); the strength
of the interference is one number, ``phase_scale`` = 4π px² / (λ R), which turns the square of a
length in pixels into a phase.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError

#: Samples of the radial tables per pixel: fringes are at least two pixels wide, so that linear
#: interpolation between samples is right to 0.3 % of the modulation.
SAMPLES_PER_PIXEL = 16
#: What the second beam does to the first, over the square of the ratio of harmonics: (1 - ϱ)/ϱ, where the window's
#: face reflects a share ϱ of 0.04 (glass) to 0.08 (sapphire).
BETWEEN_BEAMS = 15.7
#: Highest harmonic, and what keeps a second one that is small beside the third from telling those beyond.
HIGHEST, _BY_POWER = 6, 1.0 / 256.0
#: Gaussian blur reaches this many standard deviations.
_BLUR_REACH = 3.5
#: Least width (px) of the part of a ring inside the contact.
_LEAST_INSIDE = 8.0
#: Gauss–Legendre nodes of the exposure average: at least, at most, and per fringe passed.
_LEAST_NODES, _MOST_NODES, _NODES_PER_FRINGE = 2, 24, 5
#: Tables of a blur that are kept: trials come back to the same few.
_KEPT = 24
#: Halvings that locate a slope of the phase to 1e-12 of the bracket; steps that locate a gap at most, to
#: this share of it.
_HALVINGS, _STEPS, _SAME_GAP = 40, 40, 1e-12


@dataclass(frozen=True)
class Optics:
    """What the interference pattern of a contact depends on besides the contact.

    Attributes
    ----------
    phase_scale : float [1/px²]
        4π px² / (λ R).
    phase : float [rad]
        Phase in the contact: π where the contact is dark, 0 where it is bright.
    blur : float [px]
        Standard deviation of the image of a point.
    flat : float [px]
        Radius of a flat worn into the sphere; 0 for a whole one.
    disc : float
        Share of the variance of that image which is a disc's, as of a lens out of focus; the rest is a
        Gaussian's.
    by_camera : bool
        Whether harmonics arise in a camera that is not linear, behind the lens that blurs, and not between
        many beams before it.
    colour : (float, float)
        Wavenumber of a second colour over that of the first, and its share of the fringes.
    spread : float
        Variance of the wavenumbers in the light, relative to the square of their mean.
    skew : float
        Whether that band is even in wavenumbers (0), in wavelengths (1) or between.
    focus : float
        Distance over which light that the gap has bent runs on to where it is in focus, over the sphere's radius.
    halo : (float, float)
        Times which a camera that sharpens its images adds what they differ by from blurred ones, and the standard
        deviation of that blur [px].
    """

    phase_scale: float
    phase: float = math.pi
    blur: float = 0.0
    flat: float = 0.0
    disc: float = 0.0
    by_camera: bool = False
    colour: tuple[float, float] = (1.0, 0.0)
    spread: float = 0.0
    skew: float = 0.5
    focus: float = 0.0
    halo: tuple[float, float] = (0.0, 0.0)

    @property
    def before_sharpening(self) -> tuple["Optics", "Optics"]:
        """What a camera sharpens, and the blurred image that it takes from that."""
        sharp, blur = replace(self, halo=(0.0, 0.0)), math.hypot(self.blur, self.halo[1])
        return sharp, replace(sharp, blur=blur, disc=self.disc * (self.blur / blur) ** 2)


def make_optics(pixel_size: float, sphere_radius: float, wavelength: float, phase: float = math.pi) -> Optics:
    """Optics of a sphere on a flat in air, at normal incidence.

    Parameters
    ----------
    pixel_size : float [m]
        Width of a pixel in the plane of the contact.
    sphere_radius : float [m]
        Effective radius of the sphere.
    wavelength : float [m]
        Wavelength of the light in the gap.
    phase : float, optional [rad]
        Phase in the contact.
    """
    return Optics(4.0 * math.pi * pixel_size**2 / (wavelength * sphere_radius), phase)


def hertz_gap(distance: ArrayLike, contact_radius: float, sphere_radius: float) -> Floats:
    """Gap between a sphere and a flat around their Hertz contact.

    Parameters
    ----------
    distance : array [m]
        Distance from the centre of the contact.
    contact_radius : float [m]
        Radius of the contact; 0 for a sphere that touches without load.
    sphere_radius : float [m]
        Effective radius of the sphere.

    Returns
    -------
    array [m]
        The gap; 0 inside the contact.

    Raises
    ------
    InputError
        A negative contact radius, or a sphere radius that is not positive.

    Notes
    -----
    g = [a √(r² - a²) - (2a² - r²) arccos(a/r)] / (π R) for r > a: it opens like (r - a)^(3/2),
    so that the image shows no edge at r = a. For a = 0 it is the parabola r²/2R.

    References
    ----------
    K. L. Johnson, Contact Mechanics (1985), section 4.2, https://doi.org/10.1017/CBO9781139171731

    Examples
    --------
    >>> gap = hertz_gap([0.0, 800e-6, 807.9e-6], 800e-6, 9.525e-3)
    >>> [float(value) for value in (gap * 1e9).round(1)]
    [0.0, 0.0, 79.2]
    """
    if contact_radius < 0.0 or sphere_radius <= 0.0:
        message = (
            "contact_radius must be 0 or more and sphere_radius positive, found "
            f"{contact_radius} m and {sphere_radius} m"
        )
        raise InputError(message)
    return scaled_gap(np.asarray(distance, float), contact_radius) / sphere_radius


#: A contact reaches beyond the flat: the flat counts as this share of the contact at most.
_MOST_FLAT = 0.995


def scaled_gap(distance: Floats, contact_radius: ArrayLike, flat: float = 0.0) -> Floats:
    """Gap times the sphere's radius, in the square of the unit of length.

    Notes
    -----
    With a flat of radius b the springs of the method of dimensionality reduction stand on the
    profile x √(x² - b²) beyond b. With s = √(a² - b²) the gap is
    (r² - b²)(1 - 2A/π)/2 - a s (1 - 2 arcsin(a/r)/π) + s √(r² - a²)/π, where
    A = arccos √((r² - a²)/(r² - b²)); Hertz's for b = 0. See V. L. Popov, M. Heß, Method of
    Dimensionality Reduction in Contact Mechanics and Friction (2015), section 3.2,
    https://doi.org/10.1007/978-3-642-53876-6.
    """
    if flat > 0.0:
        return _flat_gap(distance, contact_radius, flat)
    a = np.asarray(contact_radius, float)
    r = np.maximum(distance, a)
    root = np.sqrt(r * r - a * a)
    angle = np.arctan2(root, a)
    return np.where(r > a, (a * root - (2.0 * a * a - r * r) * angle) / np.pi, 0.0)


def flat_parts(
    distance: Floats, contact_radius: ArrayLike, flat: float
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Radius, distance beyond it, b², s, √(r² - a²) and the angle A of :func:`scaled_gap`."""
    a = np.asarray(contact_radius, float)
    r = np.maximum(distance, a)
    square = np.asarray(np.minimum(flat, _MOST_FLAT * a) ** 2)
    s = np.sqrt(a * a - square)
    root = np.sqrt(r * r - a * a)
    return a, r, square, s, root, np.arctan2(s, root)


def _flat_gap(distance: Floats, contact_radius: ArrayLike, flat: float) -> Floats:
    """Gap of :func:`scaled_gap` beside a flat."""
    a, r, square, s, root, angle = flat_parts(distance, contact_radius, flat)
    gap = 0.5 * (r * r - square) * (1.0 - 2.0 * angle / np.pi)
    gap += (s * root - 2.0 * a * s * np.arctan2(root, a)) / np.pi
    return np.where(r > a, gap, 0.0)


def distance_at_phase(phase_change: float, contact_radius: float, optics: Optics) -> float:
    """Distance from the centre (px) where the gap has changed the phase by ``phase_change``.

    2π is one fringe: half a wavelength of gap.
    """
    a, wanted = contact_radius, phase_change / optics.phase_scale
    # The gap is never below that of the sphere less its approach a²/R, and convex: Newton's steps from
    # there lead inwards without passing it.
    r = math.sqrt(2.0 * wanted + 2.0 * a**2)
    for _ in range(_STEPS):
        root = math.sqrt(max(r * r - a * a, 0.0))
        angle = math.atan2(root, a)
        beyond = (a * root - (2.0 * a * a - r * r) * angle) / math.pi - wanted
        if beyond <= _SAME_GAP * wanted:
            break
        r -= beyond * math.pi / (2.0 * (a * root / r + r * angle))
    return r


def outer_distance(contact_radius: float, optics: Optics, fringes: float, least_spacing: float) -> float:
    """Distance from the centre up to which fringes are used.

    Parameters
    ----------
    contact_radius : float [px]
        Radius of the contact.
    optics : Optics
        The interference.
    fringes : float
        Number of fringes wanted, half a wavelength of gap each.
    least_spacing : float [px]
        Finest fringes that may be used; the slope of the phase grows outwards.
    """
    outer = distance_at_phase(2.0 * math.pi * fringes, contact_radius, optics)
    steepest = 2.0 * math.pi / least_spacing
    if phase_slope(outer, contact_radius, optics) <= steepest:
        return outer
    low, high = contact_radius, outer
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_coarse = phase_slope(middle, contact_radius, optics) < steepest
        low, high = (middle, high) if is_coarse else (low, middle)
    return low


def ring_limits(contact_radius: float, optics: Optics, fringes: float, least_spacing: float) -> tuple[float, float]:
    """Inner and outer distance (px) of the ring around a contact that is compared with fringes.

    Inside the contact it is as wide as outside: the dark there tells the visibility.
    """
    outer = outer_distance(contact_radius, optics, fringes, least_spacing)
    return max(0.0, contact_radius - max(outer - contact_radius, _LEAST_INSIDE)), outer


def part_limits(contact_radius: float, inner: float, outer: float, optics: Optics) -> Floats:
    """Distances (px) that cut a ring into quarters of fringes, and the contact inside it in two."""
    quarters = [contact_radius]
    while quarters[-1] < outer - 0.5:
        quarters.append(distance_at_phase(0.5 * math.pi * len(quarters), contact_radius, optics))
    inside = [inner, 0.5 * (inner + contact_radius)] if inner < contact_radius - 1.0 else []
    return np.array([*inside, *quarters[:-1], math.inf])


def phase_slope(distance: float, contact_radius: float, optics: Optics) -> float:
    """Change of the phase per pixel outwards [rad/px]."""
    r, a = distance, contact_radius
    if r <= a:
        return 0.0
    root = math.sqrt(r * r - a * a)
    return optics.phase_scale * 2.0 * (a * root / r + r * math.atan2(root, a)) / math.pi


@dataclass(frozen=True)
class RadialTable:
    """The interference term at equal steps of distance, as a pixel sees it.

    Attributes
    ----------
    start : float [px]
        Distance of the first sample; the following are 1 / :data:`SAMPLES_PER_PIXEL` apart.
    values : array (5, 9, 10 or 11, sample)
        The term (cosine), its derivatives by distance, contact radius and phase, and by the
        travel of the contact radius during the exposure; rich tables also those by the square of
        the blur and by the harmonics, and then by the spread of wavenumbers and by the focus.
    """

    start: float
    values: Floats

    def sharpened(self, soft: "RadialTable", share: float) -> "RadialTable":
        """Return the table with a share of what it differs by from a soft one added."""
        return RadialTable(self.start, self.values + share * (self.values - soft.values))


def exposure_nodes(travel: float, spacing: float) -> tuple[Floats, Floats]:
    """Positions (-1 .. 1) and weights that average over the exposure.

    Parameters
    ----------
    travel : float [px]
        How far the contact radius moves in the exposure.
    spacing : float [px]
        Finest fringes in the table.
    """
    if travel == 0.0:
        return np.zeros(1), np.ones(1)
    wanted = _LEAST_NODES + math.ceil(_NODES_PER_FRINGE * abs(travel) / spacing)
    return _gauss(min(wanted, _MOST_NODES))


@lru_cache(maxsize=_MOST_NODES)
def _gauss(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights of a mean by Gauss's rule: every fit asks for the same few."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    weights *= 0.5
    for array in (nodes, weights):
        array.setflags(write=False)
    return nodes, weights


@lru_cache(maxsize=_KEPT)
def pixel_weights(blur: float, disc: float = 0.0, ring: float = math.inf) -> Floats:
    """Weights over samples of a radial table: one pixel wide, convolved with the blur.

    Of a disc of radius ρ the part of its light in each sample counts. Across a ring of radius r, light
    at x from its middle reaches over a chord, and lies farther out by (ρ² - x²)/6r in the mean: that is
    (ρ² - 4x²)/24r more than the whole does, which :func:`table_distances` allows for.
    """
    half = SAMPLES_PER_PIXEL // 2
    weights = np.ones(2 * half + 1)
    weights[[0, -1]] = 0.5
    weights /= weights.sum()
    bell, radius = blur * math.sqrt(1.0 - disc), 2.0 * blur * math.sqrt(disc)
    if bell > 0.0:
        reach = math.ceil(_BLUR_REACH * bell * SAMPLES_PER_PIXEL)
        steps = np.arange(-reach, reach + 1) / SAMPLES_PER_PIXEL
        light = np.exp(-0.5 * (steps / bell) ** 2)
        weights = np.convolve(weights, light / light.sum())
    if radius > 0.0:
        reach = math.ceil(radius * SAMPLES_PER_PIXEL) + 2
        places = (np.arange(-reach, reach + 2) - 0.5) / SAMPLES_PER_PIXEL
        edges = np.clip((places - (radius**2 - 4.0 * places**2) / (24.0 * ring)) / radius, -1.0, 1.0)
        weights = np.convolve(weights, np.diff(edges * np.sqrt(1.0 - edges**2) + np.arcsin(edges)) / math.pi)
    weights.setflags(write=False)
    return weights


@lru_cache(maxsize=_KEPT)
def table_distances(inner: float, outer: float, blur: float, margin: int) -> tuple[float, Floats]:
    """First distance of a table that covers ``inner .. outer``, and the samples it is made of.

    The samples start before and end after the table by ``margin``, half the width of the pixel weights. They
    are moved outwards by the curvature of the rings: the mean over a pixel of a function of the
    distance r is its mean along the radius at r + 1/24r (blur: + σ²/2r).
    """
    step = 1.0 / SAMPLES_PER_PIXEL
    first = math.floor(inner * SAMPLES_PER_PIXEL) - 1
    last = math.ceil(outer * SAMPLES_PER_PIXEL) + 1
    samples = step * np.arange(first - margin, last + margin + 1)
    shift = (1.0 / 24.0 + 0.5 * blur**2) / np.maximum(np.abs(samples), 1.0)
    distances = np.abs(samples + np.copysign(shift, samples))
    distances.setflags(write=False)
    return first * step, distances


def beyond_third(second: float, third: float) -> Floats:
    """Fourth to highest harmonic beyond those of many beams, and their derivatives.

    By the ratio of the second harmonic to the first, and by what the third has beside its square.

    Two harmonics of (1 + bz)^g tell b and g, and those all others. Many beams are g = -1; of a camera whose grey levels
    go with a power of the light this is right to a twentieth of each.
    """
    found = np.empty((HIGHEST - 3, 3))
    square = second**4 + 1e-12 + _BY_POWER * third**2
    ratio = third * second**3 / square
    by_second = third * (3.0 * second**2 - 4.0 * second**6 / square) / square
    by_third = second**3 / square - 2.0 * _BY_POWER * third * ratio / square
    value, slope, steep = second**2 + third, 2.0 * second, 1.0
    for k in range(3, HIGHEST):
        # from harmonic to harmonic by b (g - k) / (k + 1)
        step, along, across = ((k + 1) * second + 3 * (k - 1) * ratio), (k + 1) + 3 * (k - 1) * by_second, 3 * (k - 1)
        slope, steep = (slope * step + value * along) / (k + 1), (steep * step + value * across * by_third) / (k + 1)
        value *= step / (k + 1)
        found[k - 3] = value - second**k, slope - k * second ** (k - 1), steep
    return found

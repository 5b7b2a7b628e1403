"""Interference of light in the gap around a Hertz contact: gap, phase, and the limits of a ring.

Lengths are in one unit of the caller's choice (the fit uses pixels); the strength of the interference is one
number, ``phase_scale`` = 4π px² / (λ R), which turns the square of a length in pixels into a phase.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from labpipe.arrays import Floats

#: Samples of the radial tables per pixel: fringes are at least two pixels wide, so that linear interpolation
#: between samples is right to 0.3 % of the modulation.
SAMPLES_PER_PIXEL = 16


@dataclass(frozen=True)
class Optics:
    """Properties of the light and the sphere that all contacts of a film share.

    ``phase_scale`` [1/px²]: 4π px² / (λ R). ``phase`` [rad]: in the contact, π where it is dark, 0 where it is bright.
    ``blur`` [px]: standard deviation of the image of a point (defocus). ``beams``: ratio of each harmonic of the
    fringes to the one before, 0 for two beams. ``spread``: relative variance of the wavenumber; the
    contrast falls as exp(-spread phase²/2) (partial coherence). ``flat`` [px]: radius of a flat worn into the sphere.
    """

    phase_scale: float
    phase: float = math.pi
    blur: float = 0.0
    beams: float = 0.0
    spread: float = 0.0
    flat: float = 0.0

    @property
    def newton_spot(self) -> float:
        """Radius (px) at half brightness of the central spot of a sphere that touches without load."""
        return math.sqrt(math.pi / self.phase_scale)


def make_optics(pixel_size: float, sphere_radius: float, wavelength: float, phase: float = math.pi) -> Optics:
    """Return the optics of a sphere (radius in m) on a flat in air at normal incidence, in pixels of a size (m)."""
    return Optics(4.0 * math.pi * pixel_size**2 / (wavelength * sphere_radius), phase)


def phase_of_gap(distance: float, contact_radius: float, optics: Optics) -> tuple[float, float]:
    """Phase (rad) that the gap adds at a distance (px), and its slope (rad/px).

    Hertz's gap is [a √(r² - a²) - (2a² - r²) arccos(a/r)] / (π R) for r > a, r²/2R for a = 0 (K. L. Johnson, Contact
    Mechanics (1985), section 4.2, https://doi.org/10.1017/CBO9781139171731).
    """
    r, a = distance, contact_radius
    if r <= a:
        return 0.0, 0.0
    root = math.sqrt(r * r - a * a)
    angle = math.atan2(root, a)
    scale = optics.phase_scale / math.pi
    return scale * (a * root - (2.0 * a * a - r * r) * angle), 2.0 * scale * (a * root / r + r * angle)


def distance_at_phase(phase_change: float, contact_radius: float, optics: Optics) -> float:
    """Distance from the centre (px) where the gap has changed the phase by so much; 2π is one fringe."""
    # The gap is never below that of the sphere less its approach a²/R.
    high = math.sqrt(2.0 * phase_change / optics.phase_scale + 2.0 * contact_radius**2) + contact_radius + 1.0
    return float(brentq(lambda r: phase_of_gap(r, contact_radius, optics)[0] - phase_change, contact_radius, high))


def ring_limits(contact_radius: float, optics: Optics, fringes: float, least_spacing: float) -> tuple[float, float]:
    """Inner and outer distance (px) of the ring around a contact that is compared with fringes.

    It reaches over so many fringes, but not to where they are finer than the least spacing (px). Inside the contact
    it is as wide as outside: the dark there determines the visibility.
    """
    outer = distance_at_phase(2.0 * math.pi * fringes, contact_radius, optics)
    steepest = 2.0 * math.pi / least_spacing
    if phase_of_gap(outer, contact_radius, optics)[1] > steepest:
        outer = float(brentq(lambda r: phase_of_gap(r, contact_radius, optics)[1] - steepest, contact_radius, outer))
    return max(0.0, contact_radius - max(outer - contact_radius, 8.0)), outer


def edge_width(radius: float, optics: Optics) -> float:
    """Distance (px) from the edge of a contact to the first ring of opposite brightness."""
    return distance_at_phase(math.pi, radius, optics) - radius


def has_resolved_fringes(radius: float, optics: Optics, least_spacing: float) -> bool:
    """Tell whether the pixels resolve the first fringe around a contact."""
    outer = distance_at_phase(0.9 * math.pi, radius, optics)
    return phase_of_gap(outer, radius, optics)[1] <= 2.0 * math.pi / least_spacing


def exposure_nodes(travel: float, spacing: float) -> tuple[Floats, Floats]:
    """Positions (-1 .. 1) and weights of a mean over the exposure, for a travel and a fringe spacing (px)."""
    if travel == 0.0:
        return np.zeros(1), np.ones(1)
    return _gauss(min(4 + math.ceil(5.0 * abs(travel) / spacing), 24))


@lru_cache(maxsize=32)
def _gauss(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights of a mean by Gauss's rule: every fit asks for the same few."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    weights *= 0.5
    for array in (nodes, weights):
        array.setflags(write=False)
    return nodes, weights


@lru_cache(maxsize=32)
def pixel_weights(blur: float) -> Floats:
    """Weights over samples of a radial table: one pixel wide, convolved with a Gaussian blur (px)."""
    half = SAMPLES_PER_PIXEL // 2
    box = np.ones(2 * half + 1)
    box[[0, -1]] = 0.5
    box /= box.sum()
    if blur <= 0.0:
        return box
    reach = math.ceil(3.5 * blur * SAMPLES_PER_PIXEL)
    steps = np.arange(-reach, reach + 1) / SAMPLES_PER_PIXEL
    bell = np.exp(-0.5 * (steps / blur) ** 2)
    return np.convolve(box, bell / bell.sum())


def table_distances(inner: float, outer: float, blur: float) -> tuple[float, Floats]:
    """First distance of a table that covers ``inner .. outer``, and the samples it is made of.

    The samples start before and end after the table by half the width of the pixel weights. They are moved outwards
    by the curvature of the rings: the mean over a pixel of a function of the distance r is its mean along the radius
    at r + 1/24r (blur: + σ²/2r).
    """
    step = 1.0 / SAMPLES_PER_PIXEL
    first = math.floor(inner * SAMPLES_PER_PIXEL) - 1
    last = math.ceil(outer * SAMPLES_PER_PIXEL) + 1
    margin = len(pixel_weights(blur)) // 2
    samples = step * np.arange(first - margin, last + margin + 1)
    shift = (1.0 / 24.0 + 0.5 * blur**2) / np.maximum(np.abs(samples), 1.0)
    return first * step, np.abs(samples + np.copysign(shift, samples))

"""Contacts as microscopes show them: gaps integrated numerically, and what disturbs the light.

Nothing here uses the package. A gap follows from the profile of the body and the springs of the
method of dimensionality reduction, whose integral for the surface is taken by Gauss–Legendre; the
optics are those of :mod:`.fringe_film`, and what is added to them here.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import brentq
from scipy.special import j1

from labpipe.arrays import Floats
from tests.labpipe.imaging.fringe_film import Scene, expose, intensity_of_gap, over_pixels

_nodes, _weights = np.polynomial.legendre.leggauss(32)  # of 96 no gap differs by more than 2e-15 m
#: Nodes from 0 to 1 of the integral for the surface, and their weights.
_SHARE, _WEIGHT = 0.5 * (_nodes + 1.0), 0.5 * _weights
#: Samples of the radial light per pixel, and along the side of a pixel.
_FINE, _SAMPLES = 100, 4


def surface(r: Floats, a: float, spring: Callable[[Floats], Floats], kink: float = 0.0) -> Floats:
    """Surface displacement (2/π) ∫ u(r sin θ) dθ up to the last spring that is pressed.

    In two pieces where the springs have a kink, at which their profile may rise as a square root.
    """
    first, last = (np.arcsin(np.minimum(1.0, x / np.maximum(r, 1e-12)))[:, None] for x in (kink, a))
    theta = first + (last - first) * _SHARE**2
    total = (spring(r[:, None] * np.sin(theta)) * 2.0 * _SHARE * _WEIGHT).sum(axis=1) * (last - first)[:, 0]
    if kink:
        total += (spring(r[:, None] * np.sin(first * _SHARE)) * _WEIGHT).sum(axis=1) * first[:, 0]
    return np.asarray(2.0 / math.pi * total)


def gap_of_jkr(r: Floats, a: float, radius: float, modulus: float, work: float) -> Floats:
    """Gap around a contact of radius a held together by adhesion (modulus reduced)."""
    depth = a * a / radius - math.sqrt(2.0 * math.pi * a * work / modulus)
    gap = r**2 / (2.0 * radius) - depth + surface(r, a, lambda x: depth - x**2 / radius)
    return np.where(r > a, np.maximum(gap, 0.0), 0.0)


def gap_of_dugdale(r: Floats, a: float, radius: float, modulus: float, work: float, reach: float) -> Floats:
    """Gap around a contact of radius a whose surfaces attract each other with work/reach up to that distance.

    Maugis's contact: springs are drawn out to the circle at which the gap is the reach.
    """
    stress = work / reach / modulus

    def beside(x: Floats, c: float) -> Floats:
        depth = a * a / radius - 2.0 * stress * math.sqrt(c * c - a * a)

        def spring(u: Floats) -> Floats:
            return np.where(u < a, depth - u**2 / radius, -2.0 * stress * np.sqrt(np.maximum(c * c - u**2, 0.0)))

        return np.asarray(x**2 / (2.0 * radius) - depth + surface(x, c, spring, a))

    c = float(brentq(lambda c: float(beside(np.array([c]), c)[0]) - reach, a * (1.0 + 1e-9), 2.0 * a))
    return np.where(r > a, np.maximum(beside(r, c), 0.0), 0.0)


def gap_of_worn_flat(r: Floats, a: float, radius: float, flat: float) -> Floats:
    """Gap around a sphere with a flat of radius ``flat`` worn into it, pressed to a > flat."""

    def equal(x: Floats) -> Floats:
        return np.where(x > flat, x * np.sqrt(np.maximum(x**2 - flat**2, 0.0)) / radius, 0.0)

    depth = float(equal(np.array(a)))
    body = np.maximum(r**2 - flat**2, 0.0) / (2.0 * radius)
    return np.where(r > a, np.maximum(body - depth + surface(r, a, lambda x: depth - equal(x), flat), 0.0), 0.0)


def airy(gap: Floats, scene: Scene, reflectivity: float) -> Floats:
    """Light of many beams between two faces of equal reflectivity, about 1 in the mean."""
    finesse = 4.0 * reflectivity / (1.0 - reflectivity) ** 2
    square = np.sin(2.0 * np.pi * gap / scene.wavelength + 0.5 * (scene.phase - np.pi)) ** 2
    light = finesse * square / (1.0 + finesse * square)
    return np.asarray(0.1 + 1.5 * light)


@dataclass(frozen=True)
class Disturbed:
    """A scene with what :class:`.Scene` does not know; amplitudes relative to the light.

    ``speckle`` has grains of ``grain`` px; ``parasitic`` fringes a period (px), and a direction
    (rad); ``defocus`` is the radius (px) of a disc that every point becomes; ``stretch`` and ``turn``
    (rad) make circles ellipses of equal area; ``gradient`` is a slope along a direction of 0.6 rad,
    with ``vignette`` towards the corners.
    """

    optics: Scene = field(default_factory=lambda: Scene(rows=320, columns=420))
    speckle: float = 0.0
    grain: float = 2.0
    parasitic: float = 0.0
    period: float = 23.0
    direction: float = 0.7
    drift: float = 0.0
    ellipse: float = 0.0
    turn: float = 0.4
    gradient: float = 0.0
    reflectivity: float = 0.0
    defocus: float = 0.0


def image_of(scene: Disturbed, r: Floats, gap: Floats, centre: tuple[float, float], seed: int, frame: int) -> Floats:
    """Mean grey levels of one frame; ``r`` and ``gap`` (m) tabulate the contact."""
    optics = scene.optics
    fine = np.arange(0.0, math.hypot(optics.columns + abs(centre[0]), optics.rows + abs(centre[1])) + 4.0, 1.0 / _FINE)
    gaps = np.interp(fine * optics.pixel_size, r, gap)
    line = airy(gaps, optics, scene.reflectivity) if scene.reflectivity else intensity_of_gap(gaps, optics)
    half = math.sqrt(1.0 + scene.ellipse)
    c, s = math.cos(scene.turn), math.sin(scene.turn)
    form = (c * c / half**2 + s * s * half**2, c * s * (half**-2 - half**2), s * s / half**2 + c * c * half**2)
    (light,) = over_pixels([line], _FINE, optics, centre, _SAMPLES, form if scene.ellipse else (1.0, 0.0, 1.0))
    light = light * light_of(scene)
    if scene.parasitic:
        light = light * (1.0 + scene.parasitic * _stripes(scene, frame))
    if scene.speckle:
        light = light * (1.0 + scene.speckle * _grains(scene, seed))
    grey = optics.mean * light
    if optics.blur:
        grey = gaussian_filter(grey, optics.blur, mode="nearest")
    if scene.defocus:
        grey = out_of_focus(grey, scene.defocus)
    if optics.gamma != 1.0:
        grey = optics.white * (np.clip(grey, 0.0, None) / optics.white) ** optics.gamma
    return np.asarray(grey)


def out_of_focus(grey: Floats, radius: float) -> Floats:
    """Spread every point evenly over a disc (px), by the disc's own transform."""
    edge = math.ceil(2.0 * radius)
    wide = np.pad(grey, edge, mode="reflect")
    turns = np.hypot(np.fft.fftfreq(wide.shape[0])[:, None], np.fft.rfftfreq(wide.shape[1]))
    z = np.maximum(2.0 * np.pi * radius * turns, 1e-9)
    spread = np.fft.irfft2(np.fft.rfft2(wide) * 2.0 * j1(z) / z, wide.shape)
    return np.asarray(spread[edge:-edge, edge:-edge])


def light_of(scene: Disturbed) -> Floats:
    """Illumination without interference."""
    optics = scene.optics
    across = (2.0 * np.arange(optics.columns) / optics.columns - 1.0)[None, :]
    down = (2.0 * np.arange(optics.rows) / optics.rows - 1.0)[:, None]
    slope = math.cos(0.6) * across + math.sin(0.6) * down
    return np.asarray((1.0 + 0.5 * scene.gradient * slope) * (1.0 - 0.5 * optics.vignette * (across**2 + down**2)))


def _stripes(scene: Disturbed, frame: int) -> Floats:
    y, x = np.mgrid[: scene.optics.rows, : scene.optics.columns]
    along = math.cos(scene.direction) * x + math.sin(scene.direction) * y
    return np.asarray(np.cos(2.0 * np.pi * (along / scene.period + scene.drift * frame) + 0.3))


def _grains(scene: Disturbed, seed: int) -> Floats:
    """A field of unit variance whose grains stand still from frame to frame."""
    rng = np.random.default_rng(1000 + seed)
    rough = gaussian_filter(rng.standard_normal((scene.optics.rows, scene.optics.columns)), 0.5 * scene.grain)
    return np.asarray(rough / rough.std())


def film_of(
    scene: Disturbed,
    gap_of: Callable[[Floats, float], Floats],
    radii: list[float],
    centre: tuple[float, float] = (208.3, 161.2),
    seed: int = 0,
) -> NDArray[np.integer]:
    """A film (frame, row, column): one contact radius (m) in every frame, and new noise."""
    optics = scene.optics
    rng = np.random.default_rng(seed)
    reach = math.hypot(optics.rows, optics.columns) * 1.2 * optics.pixel_size
    frames = []
    for k, a in enumerate(radii):
        r = np.concatenate([np.linspace(0.0, a, 20)[:-1], a + (reach - a) * np.linspace(0.0, 1.0, 3000) ** 2])
        frames.append(expose(image_of(scene, r, gap_of(r, a), centre, seed, k), optics, rng))
    return np.stack(frames)

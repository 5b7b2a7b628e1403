"""Films of a contact seen through interference, with truth: every pixel is supersampled.

Nothing here uses the package: the gap is the closed form of Hertz's contact (written anew), or that of a rigid
sphere above the flat.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from labpipe.arrays import Floats


@dataclass(frozen=True)
class Scene:
    """The optics of a film: lengths in m, grey levels as the camera counts them."""

    pixel_size: float = 2.17e-6
    sphere_radius: float = 9.525e-3
    wavelength: float = 633e-9
    rows: int = 480
    columns: int = 1280
    mean: float = 120.0
    visibility: float = 0.8
    phase: float = np.pi
    slope_x: float = 0.0
    slope_y: float = 0.0
    vignette: float = 0.0
    gamma: float = 1.0
    blur: float = 0.0
    coherence: float = np.inf
    beams: float = 0.0  # what both faces reflect, where more than two beams interfere
    stretch: float = 0.0
    noise: float = 5.0
    shot_noise: float = 0.0
    white: float = 255.0

    def change(self, **values: float) -> "Scene":
        """Return the scene with some values changed."""
        return replace(self, **values)


def gap_of_hertz(r: Floats, a: float, radius: float) -> Floats:
    """Gap outside a Hertz contact (Johnson 1985), 0 inside; a parabola for a = 0."""
    if a == 0.0:
        return r * r / (2.0 * radius)
    rho = np.maximum(r / a, 1.0)
    return a * a / radius * (np.sqrt(rho**2 - 1.0) + (rho**2 - 2.0) * np.arccos(1.0 / rho)) / np.pi


def surface_gap(distance: Floats, radius: float, sphere: float, flat: float = 0.0) -> Floats:
    """Gap (m) around a contact of a sphere that is worn flat, by the springs of dimensionality reduction.

    They are pressed in by g(a) - g(x) up to a, with g(x) = x √(x² - f²) / R beyond the flat's radius f; the surface
    at r is (2/π) ∫ u(r sin θ) dθ by Gauss–Legendre, in whose variable a square makes the profile's root at f smooth.
    """
    nodes, weights = np.polynomial.legendre.leggauss(48)
    share, weight = 0.5 * (nodes + 1.0), 0.5 * weights

    def profile(x: Floats) -> Floats:
        return np.where(x > flat, x * np.sqrt(np.maximum(x**2 - flat**2, 0.0)) / sphere, 0.0)

    depth = float(profile(np.array(radius)))
    first, last = (np.arcsin(np.minimum(1.0, x / np.maximum(distance, 1e-12)))[:, None] for x in (flat, radius))
    spring = depth - profile(distance[:, None] * np.sin(first + (last - first) * share**2))
    surface = first[:, 0] * depth + (spring * 2.0 * share * weight).sum(axis=1) * (last - first)[:, 0]
    body = np.maximum(distance**2 - flat**2, 0.0) / (2.0 * sphere)
    return np.where(distance > radius, np.maximum(body - depth + 2.0 / np.pi * surface, 0.0), 0.0)


def intensity_of_gap(gap: Floats, scene: Scene) -> Floats:
    """Relative intensity of a gap, by two beams or by many (Airy)."""
    if scene.beams:
        wave = np.exp(4j * np.pi * gap / scene.wavelength)
        return 0.1 + 1.5 * scene.beams * np.abs(1.0 - wave) ** 2 / np.abs(1.0 - scene.beams * wave) ** 2
    envelope = np.exp(-((gap / scene.coherence) ** 2))
    return 1.0 + scene.visibility * envelope * np.cos(4.0 * np.pi * gap / scene.wavelength + scene.phase)


def clean_image(
    scene: Scene,
    a: float,
    centre: tuple[float, float],
    gap: float = 0.0,
    travel: float = 0.0,
    samples: int = 5,
    profile: tuple[Floats, Floats] | None = None,
) -> Floats:
    """Mean grey level of every pixel of a contact at ``centre`` (px).

    ``gap`` lifts a rigid sphere (a = 0); ``travel`` is the change of a (m) during the exposure; ``profile`` tabulates
    another gap.
    """
    moments = (np.arange(25) + 0.5) / 25 - 0.5 if travel else np.zeros(1)
    return exposed_image(scene, [(a + moment * travel, gap) for moment in moments], centre, samples, profile)


def exposed_image(
    scene: Scene,
    states: Sequence[tuple[float, float]],
    centre: tuple[float, float],
    samples: int,
    profile: tuple[Floats, Floats] | None = None,
) -> Floats:
    """Mean grey level of every pixel over radii and gaps (m) in the exposure, each pixel at ``samples`` squared places.

    The pattern is a function of the distance, which is tabulated 200 times in each pixel.
    """
    finely = 200
    largest = np.hypot(scene.columns + abs(centre[0]), scene.rows + abs(centre[1])) + 2.0
    metres = np.arange(0.0, largest, 1.0 / finely) * scene.pixel_size
    gaps = [gap_of_hertz(metres, a, scene.sphere_radius) + gap for a, gap in states]
    if profile is not None:
        gaps = [np.interp(metres, *profile)]
    line = np.mean([intensity_of_gap(one, scene) for one in gaps], axis=0)
    total = np.zeros((scene.rows, scene.columns))
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    for oy, ox in itertools.product(steps, steps):
        y = np.arange(scene.rows)[:, None] + (oy - centre[1])
        x = (np.arange(scene.columns) + (ox - centre[0])) / (1.0 + scene.stretch)
        total += line.take(np.rint(finely * np.hypot(x, y)).astype(np.int32))
    return lit(total / samples**2, scene)


def lit(relative: Floats, scene: Scene) -> Floats:
    """Apply illumination, blur and the camera's curve to relative intensities."""
    across = (np.arange(scene.columns) - 0.5 * scene.columns) / (0.5 * scene.columns)
    down = ((np.arange(scene.rows) - 0.5 * scene.rows) / (0.5 * scene.rows))[:, None]
    light = 1.0 + scene.slope_x * across + scene.slope_y * down
    square = across**2 + (down * scene.rows / scene.columns) ** 2
    light = light * (1.0 - scene.vignette * square)
    grey = scene.mean * relative * light
    if scene.blur:
        grey = gaussian_filter(grey, scene.blur, mode="nearest")
    if scene.gamma != 1.0:
        grey = scene.white * (grey / scene.white) ** scene.gamma
    return grey


def expose(grey: Floats, scene: Scene, rng: np.random.Generator) -> NDArray[np.integer]:
    """Add noise and digitise."""
    deviation = np.sqrt(scene.noise**2 + scene.shot_noise * np.maximum(grey, 0.0))
    noisy = grey + deviation * rng.standard_normal(grey.shape)
    kind = np.uint8 if scene.white <= 255.0 else np.uint16
    return np.clip(np.rint(noisy), 0.0, scene.white).astype(kind)


def fringe_film(
    scene: Scene, radii: list[float], centres: list[tuple[float, float]], seed: int = 0
) -> NDArray[np.integer]:
    """A film (frame, row, column) of contacts at rest."""
    rng = np.random.default_rng(seed)
    return np.stack([expose(clean_image(scene, a, c), scene, rng) for a, c in zip(radii, centres, strict=True)])

"""Contact radius: error against run time, compared with the edge of the spot and static formulas.

Images are made from the spring picture of Hertz's contact, whose surface follows by an integral
that is taken numerically, with several samples in every pixel; the formula for the gap by which
the fit works is not used. The bound is that of the same pixels with the same unknowns.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from labpipe.arrays import Floats
from labpipe.imaging import contact_radius
from pipelines.bench.measure import OURS, Bound, Calls, Extra, Point, Suite, Timing, race

Film = NDArray[np.uint8]

_MICROMETRE = 1e-6
_MEAN, _VISIBILITY, _NOISE = 120.0, 0.8, 5.0
#: Step of the radial table of light (px), and samples along a pixel's side.
_TABLE_STEP, _SAMPLES = 0.01, 4
#: Nodes of the integral for the surface, and moments of an exposure.
_NODES, _MOMENTS = 48, 15
#: Places from the edge of the contact outwards at which its gap is integrated.
_PLACES = 4000
_DEFAULT = "3 fringes"
#: The thesis's other ways to a radius: laser reading and modulus as well as they are known (1).
_LASER, _MODULUS = 1e-6, 0.05


@dataclass(frozen=True, slots=True)
class Scene:
    """A contact and its camera; lengths in m, places in px."""

    rows: int = 480
    columns: int = 1280
    radius: float = 434e-6
    centre: tuple[float, float] = (640.3, 240.2)
    pixel: float = 2.17e-6
    sphere: float = 9.525e-3
    wavelength: float = 633e-9
    travel: float = 0.0
    blur: float = 0.0
    slope: float = 0.0
    stretch: float = 0.0
    phase: float = math.pi
    beams: float = 0.0
    flat: float = 0.0


def run(quick: bool) -> list[Suite]:
    """Measure error and time of every setting on an ideal film.

    Parameters
    ----------
    quick : bool
        Smaller frames and fewer of them.
    """
    scene = Scene()
    if quick:
        scene = replace(scene, rows=240, columns=320, radius=200e-6, centre=(158.3, 121.2))
    frames, repeats = (8, 2) if quick else (24, 5)
    film = make_film(scene, frames, 1)
    contenders = _contenders(film, scene)
    bounds = {count: cramer_rao(scene, count) for count in (1.0, 3.0)}

    def judge(name: str, timings: Mapping[str, Timing]) -> tuple[float, Extra]:
        error = (np.asarray(timings[name].value, float) - scene.radius) / _MICROMETRE
        rms = float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else math.nan
        return rms, {
            "bias (µm)": float(np.nanmean(error)) if np.isfinite(rms) else None,
            "scatter (µm)": float(np.nanstd(error, ddof=1)) if np.isfinite(rms) else None,
            "RMS / bound of 3 fringes": rms / bounds[3.0],
        }

    rows = race(contenders, repeats, judge, _DEFAULT, budget=60.0, per=frames) + _static(scene)
    suite = Suite(
        "contact-radius",
        f"Radius of a contact of {scene.radius / _MICROMETRE:g} µm, {frames} frames of "
        f"{scene.columns} × {scene.rows} px, noise of {_NOISE:g} grey levels",
        "RMS error of the radius (µm)",
        rows,
        [Bound(f"Cramér–Rao, {n:g} fringe{'s' if n > 1 else ''}", b) for n, b in bounds.items()],
        (
            "images from the springs of Hertz's contact, 16 samples in every pixel",
            f"Hertz's formulas: laser to {_LASER / _MICROMETRE:g} µm, modulus to {100 * _MODULUS:g} %; "
            "not timed, their error is that of their input",
        ),
        time_label="run time per frame (s)",
    )
    return [suite]


_PEER = "edge of the spot"


def _contenders(film: Film, scene: Scene) -> Calls:
    fit = partial(_fitted, film, scene)
    return {
        "1 fringe": (OURS, partial(fit, fringes=1.0)),
        _DEFAULT: (OURS, fit),
        "5 fringes": (OURS, partial(fit, fringes=5.0)),
        "10 fringes": (OURS, partial(fit, fringes=10.0)),
        "3 fringes, free ellipse": (OURS, partial(fit, shape="ellipse")),
        "Otsu's threshold, circle of equal area": (_PEER, lambda: np.array([*map(area_radius, film)]) * scene.pixel),
    }


def _fitted(film: Film, scene: Scene, **options: Any) -> Floats:
    return np.asarray(contact_radius(film, scene.pixel, scene.sphere, scene.wavelength, **options)["radius"].values)


def area_radius(image: Film) -> float:
    """Radius (px) of the circle that has the area of the dark spot."""
    smooth = cv2.GaussianBlur(image, (5, 5), 1.2)
    _, mask = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if count < 2:
        return math.nan
    # By pixels, not by the area within: dark rings enclose the spot.
    label = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    contours, _ = cv2.findContours((labels == label).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return math.sqrt(max(map(cv2.contourArea, contours)) / math.pi)


def _static(scene: Scene) -> list[Point]:
    """Radius from the approach, a = √(R δ), and from the load, a ~ E^(-1/3)."""
    approach = scene.radius**2 / scene.sphere
    a = scene.radius / _MICROMETRE
    return [
        Point("√(R δ), δ by laser", 0.5 * a * _LASER / approach, math.nan, "thesis"),
        Point("Hertz's static radius from the load", a * _MODULUS / 3.0, math.nan, "thesis"),
    ]


def surface_gap(distance: Floats, radius: float, sphere: float, flat: float = 0.0) -> Floats:
    """Gap (m) around a contact from the springs of the method of dimensionality reduction.

    The springs of a sphere that is worn flat up to a radius f are pressed in by g(a) - g(x) up to a, with
    g(x) = x √(x² - f²) / R beyond f; the surface at r follows as (2/π) ∫ u(r sin θ) dθ, taken by Gauss–Legendre
    up to the last spring that is pressed. Their profile rises from the edge of the flat as a square root,
    which a square in the variable of the integral makes smooth.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    share, weight = 0.5 * (nodes + 1.0), 0.5 * weights

    def profile(x: Floats) -> Floats:
        return np.where(x > flat, x * np.sqrt(np.maximum(x**2 - flat**2, 0.0)) / sphere, 0.0)

    depth = float(profile(np.array(radius)))
    first, last = (np.arcsin(np.minimum(1.0, x / np.maximum(distance, 1e-12)))[:, None] for x in (flat, radius))
    theta = first + (last - first) * share**2
    spring = depth - profile(distance[:, None] * np.sin(theta))
    surface = first[:, 0] * depth + (spring * 2.0 * share * weight).sum(axis=1) * (last - first)[:, 0]
    body = np.maximum(distance**2 - flat**2, 0.0) / (2.0 * sphere)
    return np.where(distance > radius, np.maximum(body - depth + 2.0 / math.pi * surface, 0.0), 0.0)


def make_image(scene: Scene) -> Floats:
    """Mean grey level of every pixel, supersampled."""
    x, y = scene.centre
    reach = math.hypot(scene.columns + abs(x), scene.rows + abs(y)) + 2.0
    r = np.arange(0.0, reach, _TABLE_STEP) * scene.pixel
    moments = (np.arange(_MOMENTS) + 0.5) / _MOMENTS - 0.5 if scene.travel else np.zeros(1)
    radii: Sequence[float] = [scene.radius + float(m) * scene.travel for m in moments]
    light = np.zeros_like(r)
    for radius in radii:
        # The gap rises as a power of 1.5 beyond the edge, where the places lie close together.
        places = radius + (r[-1] - radius) * np.linspace(0.0, 1.0, _PLACES) ** 2
        gap = np.interp(r, places, surface_gap(places, radius, scene.sphere, scene.flat))
        light += _interference(4.0 * math.pi * gap / scene.wavelength + scene.phase, scene.beams) / len(radii)
    total = np.zeros((scene.rows, scene.columns))
    steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    for dy in steps:
        down = ((np.arange(scene.rows)[:, None] - y + dy) / _TABLE_STEP) ** 2
        for dx in steps:
            across = ((np.arange(scene.columns) - x + dx) / (1.0 + scene.stretch) / _TABLE_STEP) ** 2
            total += light.take(np.rint(np.sqrt(across + down)).astype(np.int32))
    across = 2.0 * np.arange(scene.columns) / scene.columns - 1.0
    grey = _MEAN * total / _SAMPLES**2 * (1.0 + scene.slope * across)
    return np.asarray(gaussian_filter(grey, scene.blur, mode="nearest") if scene.blur else grey)


def _interference(phase: Floats, reflectance: float) -> Floats:
    """Light, about 1 in the mean, of two beams, or of many between faces that reflect alike (Airy)."""
    if not reflectance:
        return 1.0 + _VISIBILITY * np.cos(phase)
    wave = np.exp(1j * (phase - math.pi))
    return np.asarray(0.1 + 1.5 * reflectance * np.abs(1.0 - wave) ** 2 / np.abs(1.0 - reflectance * wave) ** 2)


def make_film(scene: Scene, frames: int, seed: int) -> Film:
    """Film (frame, row, column) of a contact at rest, with new noise in every frame."""
    rng = np.random.default_rng(seed)
    image = make_image(scene)
    noisy = image + _NOISE * rng.standard_normal((frames, *image.shape))
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def cramer_rao(scene: Scene, fringes: float) -> float:
    """Least possible standard deviation of the radius (µm).

    Unknown are radius, centre, gain, visibility and two slopes of the light; slopes of the image
    follow from differences of images.
    """
    x, y = scene.centre
    step, shift = 0.05 * _MICROMETRE, 0.05

    def slope(one: Scene, other: Scene, width: float) -> Floats:
        return (make_image(one) - make_image(other)) / width

    image = make_image(scene)
    down, across = np.mgrid[: scene.rows, : scene.columns]
    a = scene.radius
    slopes = [
        slope(replace(scene, radius=a + step), replace(scene, radius=a - step), 2 * step),
        slope(replace(scene, centre=(x + shift, y)), replace(scene, centre=(x - shift, y)), 2 * shift),
        slope(replace(scene, centre=(x, y + shift)), replace(scene, centre=(x, y - shift)), 2 * shift),
        image,
        image - _MEAN,
        image * (across - x),
        image * (down - y),
    ]
    beyond = a * (1.0 + np.linspace(0.0, 2.0, 20_001))
    gap = surface_gap(beyond, a, scene.sphere)
    reach = float(beyond[np.searchsorted(gap, 0.5 * fringes * scene.wavelength)]) - a
    used = np.abs(np.hypot(across - x, down - y) * scene.pixel - a) < reach
    matrix = np.stack([one[used] for one in slopes])
    scale = np.sqrt((matrix**2).sum(axis=1))
    inverse = np.linalg.inv(matrix @ matrix.T / np.outer(scale, scale))
    deviation = math.sqrt(float(inverse[0, 0])) / float(scale[0])
    return deviation * math.hypot(_NOISE, 12.0**-0.5) / _MICROMETRE

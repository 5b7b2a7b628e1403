"""Contact radius: error against run time, compared with the edge of the spot and static formulas.

Images are those of the virtual rig's camera under the disc, of the springs of Hertz's contact; the formula for the
gap by which the fit works is not used. The bound is that of the same pixels with the same unknowns.
"""

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging import contact_radius
from pipelines.bench.measure import OURS, Bound, Calls, Extra, Point, Suite, race
from pipelines.rig.film_under import FULL_SIZE, UnderCamera, interference, reach_of, surface_matrix, taken, view_of

Film = NDArray[np.uint8]

_MICROMETRE = 1e-6
_DEFAULT = "3 fringes"


@dataclass(frozen=True, slots=True)
class Scene:
    """A contact at rest and its camera; lengths in m.

    ``laser`` [m] and ``modulus`` (relative) are the uncertainties of the input of the thesis's other ways to a radius.
    """

    camera: UnderCamera = field(
        default_factory=partial(replace, FULL_SIZE, vignette=0.0, tilt=0.0, blur=0.0, noise=5.0)
    )
    radius: float = 434e-6
    sphere: float = 9.525e-3
    laser: float = 1e-6
    modulus: float = 0.05


def run(quick: bool) -> list[Suite]:
    """Measure error and time of every setting on an ideal film.

    Parameters
    ----------
    quick : bool
        Smaller frames and fewer of them.
    """
    scene = Scene()
    if quick:
        scene = replace(scene, camera=replace(scene.camera, rows=240, columns=320), radius=200e-6)
    frames, repeats = (8, 2) if quick else (24, 5)
    film = make_film(scene, frames, 1)
    optics = scene.camera.pixel_size, scene.sphere, scene.camera.wavelength
    fit = partial(contact_radius, film, *optics)
    contenders: Calls = {
        "1 fringe": (OURS, partial(fit, fringes=1.0)),
        _DEFAULT: (OURS, fit),
        "5 fringes": (OURS, partial(fit, fringes=5.0)),
        "10 fringes": (OURS, partial(fit, fringes=10.0)),
        "3 fringes, free ellipse": (OURS, partial(fit, shape="ellipse")),
        "Otsu's threshold, circle of equal area": (
            "edge of the spot",
            lambda: {"radius": np.array([*map(area_radius, film)]) * scene.camera.pixel_size},
        ),
    }
    bounds = {count: cramer_rao(scene, count) for count in (1.0, 3.0)}

    def judge(_: str, found: Any) -> tuple[float, Extra]:
        error = (np.asarray(found["radius"], float) - scene.radius) / _MICROMETRE
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
        f"{scene.camera.columns} × {scene.camera.rows} px, noise of {scene.camera.noise:g} grey levels",
        "RMS error of the radius (µm)",
        rows,
        [Bound(f"Cramér–Rao, {n:g} fringe{'s' if n > 1 else ''}", b) for n, b in bounds.items()],
        (
            "images from the springs of Hertz's contact, 16 samples in every pixel",
            f"Hertz's formulas: laser to {scene.laser / _MICROMETRE:g} µm, modulus to {100 * scene.modulus:g} %; "
            "not timed, their error is that of their input",
        ),
        time_label="run time per frame (s)",
    )
    return [suite]


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
        Point("√(R δ), δ by laser", 0.5 * a * scene.laser / approach, math.nan, "thesis"),
        Point("Hertz's static radius from the load", a * scene.modulus / 3.0, math.nan, "thesis"),
    ]


def gap_of(scene: Scene) -> tuple[Floats, Floats]:
    """Return places from the edge of the contact outwards, and the gap there [m].

    The springs of the contact are pressed in by (a² - x²) / R.
    """
    a, sphere = scene.radius, scene.sphere
    places = a + (reach_of(scene.camera) - a) * np.linspace(0.0, 1.0, 1000) ** 2  # it rises as a power of 1.5
    position = a * (np.arange(500) + 0.5) / 499.5  # the last one at the edge
    dent = surface_matrix(np.asarray(position), np.asarray(places)) @ (a**2 - position**2) / sphere
    return np.asarray(places), np.maximum(0.5 * places**2 / sphere - a**2 / sphere + dent, 0.0)


def make_image(scene: Scene) -> Floats:
    """Mean grey level of every pixel."""
    distance, view = view_of(scene.camera)
    return view(interference(np.interp(distance, *gap_of(scene)), scene.camera.wavelength))


def make_film(scene: Scene, frames: int, seed: int) -> Film:
    """Film (frame, row, column) of a contact at rest, with new noise in every frame."""
    rng, image = np.random.default_rng(seed), make_image(scene)
    return np.stack([taken(image, scene.camera.noise, rng) for _ in range(frames)])


def cramer_rao(scene: Scene, fringes: float) -> float:
    """Least possible standard deviation of the radius (µm).

    Unknown are radius, centre, gain, visibility and two slopes of the light; slopes of the image
    follow from differences of images.
    """
    camera, a = replace(scene.camera, samples=2), scene.radius  # slopes need no more
    scene = replace(scene, camera=camera)
    x, y = camera.centre
    step, shift = 0.05 * _MICROMETRE, 0.05

    def slope(width: float, *ends: Scene) -> Floats:
        one, other = map(make_image, ends)
        return (one - other) / width

    def moved(x: float, y: float) -> Scene:
        return replace(scene, camera=replace(camera, centre=(x, y)))

    image = make_image(scene)
    down, across = np.mgrid[: camera.rows, : camera.columns]
    across, down = across - (0.5 * (camera.columns - 1) + x), down - (0.5 * (camera.rows - 1) + y)
    slopes = [
        slope(2 * step, replace(scene, radius=a + step), replace(scene, radius=a - step)),
        slope(2 * shift, moved(x + shift, y), moved(x - shift, y)),
        slope(2 * shift, moved(x, y + shift), moved(x, y - shift)),
        image,
        image - camera.mean,
        image * across,
        image * down,
    ]
    places, gap = gap_of(scene)
    reach = float(np.interp(0.5 * fringes * camera.wavelength, gap, places)) - a
    used = np.abs(np.hypot(across, down) * camera.pixel_size - a) < reach
    matrix = np.stack([one[used] for one in slopes])
    scale = np.sqrt((matrix**2).sum(axis=1))
    inverse = np.linalg.inv(matrix @ matrix.T / np.outer(scale, scale))
    deviation = math.sqrt(float(inverse[0, 0])) / float(scale[0])
    return deviation * math.hypot(camera.noise, 12.0**-0.5) / _MICROMETRE

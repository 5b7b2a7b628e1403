"""Films of an impact and of a hovering sphere, drawn from closed formulas without the package, with truth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.frames import ArrayFrames

FRAME_RATE = 10_000.0


@dataclass(frozen=True)
class Camera:
    """A camera under the disc: lengths in m, grey levels of 8 bit; ``coherence`` is where the contrast is 1/e."""

    rows: int = 400
    columns: int = 560
    pixel_size: float = 4.34e-6
    sphere_radius: float = 9.525e-3
    wavelength: float = 633e-9
    mean: float = 110.0
    visibility: float = 0.7
    noise: float = 2.5
    coherence: float = np.inf
    slope: tuple[float, float] = (0.0, 0.0)
    vignette: float = 0.0


@dataclass(frozen=True)
class Film:
    """Frames with the radius in the middle of the exposure, and the largest one in it [m]."""

    frames: ArrayFrames
    camera: Camera
    radius: Floats
    largest: Floats


def _light(gap: Floats, camera: Camera) -> Floats:
    fade = np.exp(-((gap / camera.coherence) ** 2))
    return np.asarray(1.0 - camera.visibility * fade * np.cos(4.0 * np.pi * gap / camera.wavelength))


def _gap(r: Floats, a: float, hover: float, radius: float) -> Floats:
    if a <= 0.0:
        return r**2 / (2.0 * radius) + hover
    rho = np.maximum(r / a, 1.0)
    return np.asarray(a * a / (np.pi * radius) * (np.sqrt(rho**2 - 1.0) + (rho**2 - 2.0) * np.arccos(1.0 / rho)))


def _frame(
    states: Sequence[tuple[float, float]], centre: tuple[float, float], camera: Camera, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Mean over contact radii and hovering gaps in the exposure, each pixel over 3 x 3 places, with noise."""
    reach = 2.0 * np.hypot(camera.rows, camera.columns)
    r = np.arange(0.0, reach, 0.01)
    line = np.zeros_like(r)
    for a, hover in states:
        line += _light(_gap(r * camera.pixel_size, a, hover, camera.sphere_radius), camera) / len(states)
    y, x = np.arange(camera.rows)[:, None] - centre[1], np.arange(camera.columns) - centre[0]
    image = np.zeros((camera.rows, camera.columns))
    for dy in (-1 / 3, 0.0, 1 / 3):
        for dx in (-1 / 3, 0.0, 1 / 3):
            image += line[(100.0 * np.hypot(x + dx, y + dy) + 0.5).astype(np.int32)] / 9.0
    across = (2.0 * np.arange(camera.columns) / camera.columns - 1.0)[None, :]
    down = (2.0 * np.arange(camera.rows) / camera.rows - 1.0)[:, None]
    shade = 1.0 + camera.slope[0] * across + camera.slope[1] * down - camera.vignette * (across**2 + down**2)
    grey = camera.mean * image * shade + camera.noise * rng.standard_normal(image.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def impact(camera: Camera, exposure: float, seed: int, centre: tuple[float, float] | None = None) -> Film:
    """An impact of 2 ms with a largest radius of 0.8 mm, the approach a sine; three frames before, four after."""
    rng = np.random.default_rng(seed)
    largest, duration = 0.8e-3, 2e-3
    speed = np.pi / duration
    depth = largest**2 / camera.sphere_radius
    time = (np.arange(27) - 3 + rng.uniform()) / FRAME_RATE
    middle = (camera.columns / 2 + rng.uniform(-4.0, 4.0), camera.rows / 2 + rng.uniform(-4.0, 4.0))

    def state(t: float) -> tuple[float, float]:
        if 0.0 < t < duration:
            return largest * float(np.sqrt(np.sin(speed * t))), 0.0
        return 0.0, depth * speed * (-t if t <= 0.0 else t - duration)

    moments = ((np.arange(15) + 0.5) / 15 - 0.5) * exposure
    states = [[state(t + m) for m in moments] for t in time.tolist()]
    images = np.stack([_frame(each, centre or middle, camera, rng) for each in states])
    radius = np.array([state(t)[0] for t in time.tolist()])
    seen = np.array([max(a for a, _ in each) for each in states])
    return Film(ArrayFrames(images, time, exposure), camera, radius, seen)


def hovering(camera: Camera, gaps: Floats, speed: float, exposure: float, seed: int) -> Film:
    """A sphere above the flat at given gaps (m), moving at a speed (m/s) in the exposure."""
    rng = np.random.default_rng(seed)
    centre = (camera.columns / 2 + 1.3, camera.rows / 2 - 0.6)
    moments = ((np.arange(5) + 0.5) / 5 - 0.5) * exposure * speed
    images = [_frame([(0.0, abs(gap + m)) for m in moments], centre, camera, rng) for gap in gaps.tolist()]
    none = np.zeros(len(gaps))
    return Film(ArrayFrames(np.stack(images), np.arange(len(gaps)) / FRAME_RATE, exposure), camera, none, none)

"""Films of an impact and of a hovering sphere with truth, and how measured radii compare with it."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.frames import ArrayFrames
from tests.labpipe.imaging.fringe_film import Scene, expose, exposed_image

FRAME_RATE = 10_000.0
CAMERA = Scene(rows=400, columns=560, pixel_size=4.34e-6, mean=110.0, visibility=0.7, noise=2.5)


@dataclass(frozen=True)
class Film:
    """Frames with the radius in the middle of the exposure, and the largest one in it [m]."""

    frames: ArrayFrames
    radius: Floats
    largest: Floats


def impact(scene: Scene, exposure: float, seed: int, centre: tuple[float, float] | None = None) -> Film:
    """An impact of 2 ms with a largest radius of 0.8 mm, the approach a sine; three frames before, four after."""
    rng = np.random.default_rng(seed)
    largest, duration = 0.8e-3, 2e-3
    speed = np.pi / duration
    depth = largest**2 / scene.sphere_radius
    time = (np.arange(27) - 3 + rng.uniform()) / FRAME_RATE
    middle = (scene.columns / 2 + rng.uniform(-4.0, 4.0), scene.rows / 2 + rng.uniform(-4.0, 4.0))

    def state(t: float) -> tuple[float, float]:
        if 0.0 < t < duration:
            return largest * float(np.sqrt(np.sin(speed * t))), 0.0
        return 0.0, depth * speed * (-t if t <= 0.0 else t - duration)

    moments = ((np.arange(15) + 0.5) / 15 - 0.5) * exposure
    states = [[state(t + m) for m in moments] for t in time.tolist()]
    images = np.stack([expose(exposed_image(scene, each, centre or middle, 3), scene, rng) for each in states])
    radius = np.array([state(t)[0] for t in time.tolist()])
    return Film(ArrayFrames(images, time, exposure), radius, np.array([max(a for a, _ in each) for each in states]))


def hovering(scene: Scene, gaps: Floats, speed: float, exposure: float, seed: int) -> ArrayFrames:
    """A sphere above the flat at given gaps (m), moving at a speed (m/s) in the exposure."""
    rng = np.random.default_rng(seed)
    centre = (scene.columns / 2 + 1.3, scene.rows / 2 - 0.6)
    moments = ((np.arange(5) + 0.5) / 5 - 0.5) * exposure * speed
    states = [[(0.0, abs(gap + m)) for m in moments] for gap in gaps.tolist()]
    images = np.stack([expose(exposed_image(scene, each, centre, 3), scene, rng) for each in states])
    return ArrayFrames(images, np.arange(len(gaps)) / FRAME_RATE, exposure)


@dataclass(frozen=True)
class Score:
    """Errors of the contacts that are measured [m], their ratio to u, and frames that are wrongly decided."""

    errors: Floats
    ratios: Floats
    false: list[int]
    missed: list[int]

    @property
    def covered(self) -> float:
        """Share within 2 u."""
        return float(np.mean(np.abs(self.ratios) < 2.0))


def score(found: xr.Dataset, truth: Floats, largest: Floats, other_u: float | Floats | xr.DataArray = 0.0) -> Score:
    """Compare with the radius in the middle of the exposure, where that is above ``least_radius``.

    A contact that begins or ends within the exposure may be missed: half of the frame shows none. ``other_u`` is
    added to the random uncertainty.
    """
    seen, radius = found.in_contact.values.astype(bool), found.radius.values
    is_large = truth > found.attrs["least_radius"]
    measured = np.flatnonzero(seen & is_large & np.isfinite(radius) & (found.method.values != 2))
    errors = radius[measured] - truth[measured]
    ratios = errors / np.hypot(found.u_radius.values, other_u)[measured]
    clear = is_large & (largest < 1.3 * truth)
    return Score(
        errors, ratios, np.flatnonzero(seen & (largest <= 0.0)).tolist(), np.flatnonzero(~seen & clear).tolist()
    )

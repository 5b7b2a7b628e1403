"""The camera under the disc: interference of the true gap, written as a .cine.

The gap is that of the rig's own reference contact. Its springs u(x, t) are turned into the
surface displacement of the sphere by the inverse Abel transform of the method of dimensionality
reduction, u_z(r) = (2/π) ∫₀^r u(x)/√(r² − x²) dx, so that dents that still recover show too. The
closed formula of Hertz, by which the analysis measures, is used nowhere here.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from instruments import phantom
from labpipe.arrays import Floats
from pipelines.rig.apparatus import SPHERE, VIEWS
from pipelines.rig.drops import Body
from pipelines.rig.film_front import film_recording
from pipelines.rig.reference_drop import Springs
from pipelines.rig.session_text import from_library, section, write_truth

UNDER_HEIGHT = SPHERE.heights[0]
FULL_TIMES = np.arange(9367, dtype=np.float64) / 10_000
"""Of the frames of a film of full size [s], as the thesis's films have them."""


@dataclass(frozen=True, slots=True)
class UnderCamera:
    """The camera, its light, and the disturbances of the images.

    ``centre`` is the contact's place relative to the middle of the image (px); ``tilt`` the
    angle (rad) of the camera to the normal, which shortens x by its cosine; ``samples`` are
    taken per pixel side, ``moments`` per exposure. ``release`` is the release in the film's time. ``grid`` is the
    spacing of the radial table in m: 1/50 of the finest fringe that matters.
    """

    rows: int = 160
    columns: int = 416
    pixel_size: float = 2 * VIEWS.under_pixel
    exposure: float = 2e-6
    release: float = 2e-3
    wavelength: float = 633e-9
    mean: float = 120.0
    visibility: float = 0.8
    vignette: float = 0.15
    tilt: float = 0.02
    blur: float = 0.5
    noise: float = 3.0
    centre: tuple[float, float] = (4.3, -2.6)
    samples: int = 4
    moments: int = 3
    grid: float = 0.2e-6


FULL_SIZE = UnderCamera(rows=480, columns=1280, pixel_size=VIEWS.under_pixel, release=5e-3)


@dataclass(frozen=True, slots=True)
class Bursts:
    """When a small film has its frames; s.

    ``spacing`` apart from ``before`` to ``after`` each of the first three touches, as at 10,000
    frames a second; ``slow`` apart otherwise, until the third; and ``rest`` after it, when the last
    bounces of acrylic from 1.5 mm are over, ``at_rest`` apart.
    """

    spacing: float = 1e-4
    before: float = 0.4e-3
    after: float = 1.4e-3
    slow: float = 5e-3
    rest: float = 0.62
    frames_at_rest: int = 8
    at_rest: float = 5e-3


def write_under(folder: Path, stem: str, body: Body, camera: UnderCamera, time: Floats, seed: int) -> str:
    """Film a drop through the disc, with frames at increasing times [s]; returns the film's name in the session.

    The truth is ``time``, ``contact_radius`` (m; resolved to ``resolution``) of every frame, the centre (px) and the
    optics.
    """
    name = f"film/{stem}.cine"
    nodes, weights = np.polynomial.legendre.leggauss(camera.moments)
    moments = (time[:, None] - camera.release + 0.5 * camera.exposure * nodes).ravel()
    motion = body.fall(float(moments[-1]) + 1e-4, np.maximum(moments, 0.0))  # it is held until its release
    if motion.springs is None:
        raise RuntimeError("the reference handed out no springs")
    states, shape = motion.springs, (len(time), camera.rows, camera.columns)
    recording = film_recording(round(1 / float(np.min(np.diff(time)))), camera.exposure, "view under the disc")
    images = _images(states, body, camera, weights / 2, len(time), seed)
    phantom.write(folder / name, images, shape, time, recording)
    radius = states.contact_radius.reshape(len(time), -1)
    truth = {
        "view": "under",
        "pixel_size": camera.pixel_size,
        "wavelength": camera.wavelength,
        "exposure": camera.exposure,
        "centre": list(_centre(camera)),
        "release_time": camera.release,
        "touch_time": (camera.release + motion.touch).tolist(),
        "resolution": states.resolution,
        "peak_contact_radius": float(motion.contact_radius.max()),
        "time": time.tolist(),
        "contact_radius": np.round(radius @ (weights / 2), 10).tolist(),
    }
    write_truth(folder, stem, truth, indent=None)
    return name


def burst_times(body: Body, release: float, bursts: Bursts, impacts: int = 3) -> Floats:
    """Choose the times of a small film: bursts around the first impacts, few frames else, and rest.

    Real cameras record so too (image-based triggering, or a film cut to the impacts).
    """
    # Each flight is shorter than the first.
    longest = 1.2 * impacts * np.sqrt(8 * body.height / SPHERE.gravity)
    touches = release + body.fall(float(longest)).touch[:impacts]
    pieces = [np.arange(t - bursts.before, t + bursts.after, bursts.spacing) for t in touches]
    slow = np.arange(0.0, touches[-1], bursts.slow)
    apart = np.min(np.abs(slow[:, None] - touches[None, :]), axis=1) > bursts.after
    last = touches[-1] + bursts.rest + bursts.at_rest * np.arange(bursts.frames_at_rest)
    times = np.unique(np.concatenate([*pieces, slow[apart], last]).round(7))
    return np.asarray(times)


def under_section(
    film: str, name: str = "acrylic_film", height: float = UNDER_HEIGHT, *, extra: str = "", source: str = ""
) -> str:
    """Return the table of a film under the disc; ``source`` as for :func:`.drop_section`."""
    source = source or from_library("acrylic")
    return section("contact_area", name=name, film=film, height=height, extra=extra, source=source)


def _centre(camera: UnderCamera) -> tuple[float, float]:
    """Contact's centre in px, x and y."""
    dx, dy = camera.centre
    return 0.5 * (camera.columns - 1) + dx, 0.5 * (camera.rows - 1) + dy


def reach_of(camera: UnderCamera) -> float:
    """Return the distance [m] of the contact's centre from the farthest corner of the image, and a little more."""
    x0, y0 = _centre(camera)
    return float(camera.pixel_size * np.hypot(max(x0, camera.columns - x0) + 2, max(y0, camera.rows - y0) + 2))


def surface_matrix(position: Floats, r: Floats) -> Floats:
    """Return the matrix that turns springs into the surface displacement at the radii ``r``.

    ``position`` (spring,) [m]: evenly spaced, the first half a spacing from the axis; ``r`` (radius,) [m]. Returns the
    matrix: u is linear between springs, even across the axis, and 0 beyond the last one; the integral of each piece is
    exact.
    """
    nodes = np.concatenate([[0.0], position])
    low, high = nodes[:-1], nodes[1:]
    ratio_low = np.minimum(low / np.maximum(r[:, None], 1e-12), 1.0)
    ratio_high = np.minimum(high / np.maximum(r[:, None], 1e-12), 1.0)
    angle = np.arcsin(ratio_high) - np.arcsin(ratio_low)
    first = r[:, None] * (np.sqrt(1 - ratio_low**2) - np.sqrt(1 - ratio_high**2))
    rising = (first - low * angle) / (high - low)  # weight of the piece's upper end
    matrix = np.zeros((len(r), len(nodes)))
    matrix[:, 1:] += rising
    matrix[:, :-1] += angle - rising
    matrix[:, 1] += matrix[:, 0]  # the axis has the displacement of the first spring
    return 2.0 / np.pi * matrix[:, 1:]


def view_of(camera: UnderCamera) -> tuple[Floats, Callable[[Floats], Floats]]:
    """Return at which distances [m] from the centre a camera samples the gap, and the view of a pattern over them.

    A pattern (distance,) is the light about its mean, over its amplitude; the view are grey levels (row, column)
    without noise.
    """
    (x0, y0), fine = _centre(camera), np.arange(0.0, reach_of(camera), camera.grid)
    half = 0.5 * camera.columns  # light falls off towards the corners of the image's long side
    across, down = np.arange(camera.columns) - half, np.arange(camera.rows)[:, None] - 0.5 * camera.rows
    light = 1.0 - camera.vignette * (across**2 + down**2) / half**2
    # samples (row, in it, column, in it) of the pattern, spread over every pixel
    spread = (np.arange(camera.samples) + 0.5) / camera.samples - 0.5
    x = (np.arange(camera.columns)[:, None] - x0 + spread) * camera.pixel_size / np.cos(camera.tilt)
    y = (np.arange(camera.rows)[:, None] - y0 + spread) * camera.pixel_size
    place = np.hypot(x, y[:, :, None, None]) / camera.grid
    inner = np.minimum(place.astype(np.int64), fine.size - 2)
    share = np.minimum(place - inner, 1.0)

    def view(pattern: Floats) -> Floats:
        relative = (pattern.take(inner) + share * np.diff(pattern).take(inner)).mean(axis=(1, 3))
        grey = camera.mean * (1 + camera.visibility * relative) * light
        return gaussian_filter(grey, camera.blur, mode="nearest") if camera.blur else grey

    return fine, view


def interference(gap: Floats, wavelength: float) -> Floats:
    """Return the light behind a gap [m] about its mean, over its amplitude: dark where there is contact."""
    return np.asarray(np.cos(4 * np.pi * gap / wavelength + np.pi))


def taken(grey: Floats, noise: float, generator: np.random.Generator) -> NDArray[np.uint8]:
    """Return an image of 8 bits with a camera's noise (grey levels)."""
    return np.clip(np.rint(grey + noise * generator.standard_normal(grey.shape)), 0, 255).astype(np.uint8)


def _images(
    springs: Springs, body: Body, camera: UnderCamera, weights: Floats, count: int, seed: int
) -> Iterator[NDArray[np.uint8]]:
    generator = np.random.default_rng(seed)
    fine, view = view_of(camera)
    coarse = np.linspace(0.0, reach_of(camera), 2000)
    matrix = surface_matrix(springs.position, coarse)
    profile = fine**2 / (body.radius + np.sqrt(body.radius**2 - fine**2))  # of a sphere
    for frame in range(count):
        pattern = np.zeros_like(fine)
        for k, weight in enumerate(weights):
            n = frame * len(weights) + k
            dent = np.interp(fine, coarse, matrix @ springs.displacement[n])
            gap = np.maximum(profile - springs.approach[n] + dent, 0.0)
            pattern += weight * interference(gap, camera.wavelength)
        yield taken(view(pattern), camera.noise, generator)

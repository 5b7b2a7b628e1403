"""The front camera: a speckled holder that falls and bounces, written as a .cine."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instruments import phantom
from labpipe.arrays import Floats
from pipelines.rig.apparatus import SPHERE, VIEWS
from pipelines.rig.drops import DropRig
from pipelines.rig.reference_drop import Trajectory
from pipelines.rig.session_text import height_name, section, write_truth
from pipelines.rig.solids import specimen_of
from pipelines.rig.speckle import Holder, Pose, draw, make_holder

FRONT_HEIGHT = SPHERE.heights[2]


@dataclass(frozen=True, slots=True)
class FrontCamera:
    """The camera and the disturbances of its images; SI and px.

    ``duration`` is the length of the film, ``release`` the time of release in it. ``exposure`` is
    averaged over two moments, which is exact to second order in the motion. ``photons`` is the
    number of electrons per grey level (shot noise), ``noise`` the read noise in grey levels.
    ``rotation`` is the amplitude of one swing of the holder (rad) at ``swing`` Hz that begins with
    the fall, ``drift`` the relative change of the light over the film. An image that moves by less than ``still`` px is
    not drawn again.
    """

    rows: int = 128
    columns: int = 96
    frame_rate: int = 4000
    duration: float = 0.14
    release: float = 0.01
    pixel_size: float = VIEWS.front_pixel
    exposure: float = 5e-6
    defocus: float = 0.4
    photons: float = 60.0
    noise: float = 1.2
    rotation: float = 1.5e-3
    swing: float = 9.0
    drift: float = 0.02
    holder_width: float | None = None
    still: float = 1e-5


FULL_SIZE = FrontCamera(rows=480, columns=1280, frame_rate=10_000, duration=0.9367, release=0.05, holder_width=1180.0)


def film_recording(rate: int, exposure: float, view: str) -> phantom.Recording:
    """Return the settings of a camera that says of itself that it is drawn; it triggers on 14 May 2024, 9:30 UTC."""
    text, name = f"SYNTHETIC: drawn by labpipe's virtual rig, {view}", "labpipe virtual camera"
    return phantom.Recording(rate, exposure, bits=8, trigger=1_715_679_000, camera=name, description=text)


def write_front(
    folder: Path, material: str, height: float, camera: FrontCamera, seed: int, rig: DropRig | None = None
) -> str:
    """Film the holder that falls from ``height`` [m]; returns the film's name in the session.

    The truth holds ``time`` (s, trigger 0 at the first image), ``dx``, ``dy`` (px of the holder's pivot) and
    ``rotation`` (rad) of every frame, and the camera's numbers. The motion is that from release on; the holder is there
    in the first image.
    """
    body = (rig or DropRig()).body(specimen_of(material), height)
    trajectory, name = body.fall(camera.duration - camera.release + 1e-3), f"film/{material}_front.cine"
    count = round(camera.duration * camera.frame_rate)
    time = np.arange(count) / camera.frame_rate
    fall = height / camera.pixel_size
    holder = make_holder(camera.rows, camera.columns, fall + 8, seed, camera.holder_width)
    shape = (count, camera.rows, camera.columns)
    recording = film_recording(camera.frame_rate, camera.exposure, "front view")
    images = _images(holder, trajectory, height, camera, time, seed + 1)
    phantom.write(folder / name, images, shape, time, recording)
    poses = [_pose(t, trajectory, height, camera) for t in time]
    truth = {
        "view": "front",
        "pixel_size": camera.pixel_size,
        "release_time": camera.release,
        "first_contact_time": camera.release + float(trajectory.touch[0]),
        "touch_time": (camera.release + trajectory.touch).tolist(),
        "pivot": list(poses[0].pivot),
        "time": time.tolist(),
        "dx": [round(p.dx, 6) for p in poses],
        "dy": [round(p.dy, 6) for p in poses],
        "rotation": [round(p.rotation, 9) for p in poses],
    }
    write_truth(folder, f"{material}_front", truth, indent=None)
    return name


def front_section(film: str, camera: FrontCamera, height: float = FRONT_HEIGHT) -> str:
    """Return the table of the front film in session.toml."""
    # The body falls through the image; above and below it stays the same share of what is left.
    row = 0.4 * (camera.rows - height / camera.pixel_size)
    subset = 2 * int(min(row - 3, 100)) + 1
    middle = 0.5 * (camera.columns - 1)
    small = 31 if camera.rows > 200 else min(21, 2 * (camera.columns // 6) + 1)
    places = {"middle": middle, "row": f"{row:.1f}", "left": small, "right": camera.columns - 1 - small}
    sizes = {"body_subset": subset, "points": 50 if camera.rows > 200 else 6, "subset": small}
    return section("dic_validation", film=film, height_name=height_name(height), **places, **sizes)


def _pose(time: float, trajectory: Trajectory, height: float, camera: FrontCamera) -> Pose:
    since = time - camera.release
    fallen, rotation = 0.0, 0.0
    if since > 0:
        fallen = height - float(trajectory.at(np.array([since]))[0])
    if 0 < since < 1 / camera.swing:
        # the swing begins and ends without a jump of its rate
        rotation = camera.rotation * (1 - np.cos(2 * np.pi * camera.swing * since)) / 2
    pivot = (0.5 * (camera.columns - 1), 0.25 * (camera.rows - 1))
    return Pose(0.0, fallen / camera.pixel_size, rotation, pivot)


def _images(
    holder: Holder, trajectory: Trajectory, height: float, camera: FrontCamera, time: Floats, seed: int
) -> Iterator[NDArray[np.uint8]]:
    generator = np.random.default_rng(seed)
    nodes = np.array([-1.0, 1.0]) * camera.exposure / (2 * np.sqrt(3.0))  # Gauss's two points
    rows = np.linspace(-1.0, 1.0, camera.rows)[:, None]
    last: tuple[Pose, Floats] | None = None
    for t in time:
        poses = [_pose(t + n, trajectory, height, camera) for n in nodes]
        if last is None or poses[0].distance(last[0]) > camera.still:
            clean = sum(draw(holder, camera.rows, camera.columns, p, camera.defocus) for p in poses)
            last = poses[0], np.asarray(clean) / len(poses)
        light = 1.0 + camera.drift * t / camera.duration + 0.03 * rows
        grey = last[1] * light
        sigma = np.sqrt(camera.noise**2 + grey / camera.photons)
        noisy = grey + sigma * generator.standard_normal(grey.shape)
        yield np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

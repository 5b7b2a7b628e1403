"""The virtual cameras: what they draw agrees with the truth they hand out."""

import json
from pathlib import Path

import numpy as np
import pytest

import instruments
from labpipe import imaging
from pipelines.rig.drops import Body
from pipelines.rig.film_front import FrontCamera, write_front
from pipelines.rig.film_under import UnderCamera, surface_matrix, write_under
from pipelines.rig.reference_drop import reference_drop
from pipelines.rig.solids import Viscoelastic
from tests.labpipe.imaging.fringe_film import gap_of_hertz

R, MASS = 9.525e-3, 0.505


def drop(duration: float, snapshots: np.ndarray | None = None, **form):
    solid, body = Viscoelastic((), 3.2e9, 0.35), {"radius": R, "mass": MASS, "height": 1.5e-3}
    return reference_drop(solid, **body, duration=duration, snapshots=snapshots, **form)


@pytest.mark.parametrize("time", [0.0177, 0.0184])
def test_the_gap_of_an_elastic_contact_is_that_of_hertz(time: float) -> None:
    springs = drop(0.0186, np.array([time]), profile=lambda x, radius: x**2 / radius).springs
    a = np.sqrt(R * springs.approach[0])
    assert springs.contact_radius[0] == pytest.approx(a, abs=2 * springs.resolution)
    r = np.linspace(0, 1.2e-3, 300)
    dent = surface_matrix(springs.position, r) @ springs.displacement[0]
    gap = r**2 / (2 * R) - springs.approach[0] + dent
    assert np.abs(gap - gap_of_hertz(r, a, R)).max() < 3e-9  # 1/200 of a wavelength


def test_the_front_film_shows_the_motion_that_its_truth_tells(tmp_path: Path) -> None:
    camera = FrontCamera(rows=96, columns=64, frame_rate=1000, duration=0.024, release=0.004, pixel_size=1e-4)
    film = instruments.read(tmp_path / write_front(tmp_path, "ptfe", 1.5e-3, camera, 5))
    truth = json.loads((tmp_path / "truth/ptfe_front.json").read_text("utf-8"))
    x, y = truth["pivot"]
    found = imaging.track(film, [(x, y)], subset=31, static_frames=4)
    expected = np.array(truth["dy"]) - np.mean(truth["dy"][:4])
    assert truth["dy"][-1] > 10
    assert np.abs(found["dy"].values[:, 0] - expected).max() < 0.03
    assert np.abs(found["dx"].values[:, 0]).max() < 0.03


def test_a_film_shows_the_fringes_of_a_whole_sphere(tmp_path: Path) -> None:
    """Held 3 µm over the disc; a paraboloid is a third of a fringe off at the image's ends."""
    camera = UnderCamera(rows=4, columns=416, vignette=0.0, tilt=0.0, blur=0.0, noise=0.0, samples=16, moments=1)
    body = Body(Viscoelastic((), 3.2e9, 0.35), 3e-6, radius=R)
    name = write_under(tmp_path, "held", body, camera, np.array([0.0, 2.2e-3]), 4)
    seen = np.asarray(instruments.read(tmp_path / name)[0], dtype=float)
    x0, y0 = (0.5 * (n - 1) + d for n, d in zip((camera.columns, camera.rows), camera.centre, strict=True))
    fine = (np.arange(16) + 0.5) / 16 - 0.5
    x, y = np.arange(camera.columns)[:, None] + fine - x0, np.arange(camera.rows)[:, None] + fine - y0
    square = camera.pixel_size**2 * (x**2 + y[:, :, None, None] ** 2)
    gaps = {"sphere": R - np.sqrt(R**2 - square), "paraboloid": square / (2 * R)}
    off = {}
    for form, gap in gaps.items():
        light = np.cos(4 * np.pi * (gap + 3e-6) / camera.wavelength + np.pi).mean(axis=(1, 3))
        off[form] = np.abs(seen - camera.mean * (1 + camera.visibility * light)).max()
    assert off["sphere"] < 1.5
    assert off["paraboloid"] > 20.0

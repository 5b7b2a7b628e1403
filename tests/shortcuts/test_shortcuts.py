"""Every shortcut against the full computation: the same answer within its stated tolerance, for less work."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from instruments import phantom
from labpipe import contact, imaging, materials
from labpipe.materials import Prony
from pipelines.bench.dic import make_film
from pipelines.experiments.dic_validation import measured as dic_validation
from pipelines.experiments.dic_validation.settings import DicValidation, Tracking
from tests.labpipe.imaging.fringe_film import gap_of_hertz

SPHERE, MASS, HEIGHT = 9.525e-3, 0.505, 1.5e-3
ACRYLIC = materials.load("acrylic")
MANY_TERMS = Prony(5e8, np.full(80, 2.5e9 / 80), np.geomspace(1e-12, 1e8, 80), nu=0.35)


def work(found: xr.Dataset, *names: str) -> float:
    counts = json.loads(found.attrs["work"])
    return sum(float(counts.get(name, 0)) for name in names)


def drop(height: float = HEIGHT, duration: float = 0.1, solid: Prony = ACRYLIC, **options: object) -> xr.Dataset:
    return contact.drop(solid, SPHERE, MASS, height, duration, **options)


@pytest.mark.parametrize(
    ("case", "count"),
    [
        pytest.param({"solid": MANY_TERMS, "duration": 0.03}, "terms", id="terms far outside the time scale"),
        pytest.param({"height": 10e-3, "duration": 0.15}, "solver_steps", id="collocated contacts"),
    ],
)
def test_a_shortcut_of_the_simulator_keeps_the_restitution(case, count) -> None:
    fast, full = drop(**case), drop(**case, full=True)
    ratio = fast["restitution"] / full["restitution"] - 1.0
    assert np.abs(ratio).max() < 1e-4  # rtol
    assert work(fast, count) < work(full, count)


def test_rest_is_followed_in_few_steps() -> None:
    times = np.linspace(0.0, 0.4, 501)
    fast, full = (drop(2e-5, 0.4, times=times, full=full) for full in (False, True))
    apart = np.abs(fast["displacement"] - full["displacement"])[times > float(fast["rest_time"])].max()
    assert apart < 1e-4 * abs(full["displacement"][-1])  # rtol, of the sag
    assert work(fast, "solver_steps") < work(full, "solver_steps")


def test_a_collision_ends_behind_the_impacts_that_are_asked_for() -> None:
    few, all_of_them = (
        contact.collision(SPHERE, MASS, HEIGHT, damping=1500.0, duration=0.2, impacts=impacts, rtol=1e-7)
        for impacts in (4, None)
    )
    np.testing.assert_allclose(few["restitution"], all_of_them["restitution"][:4], atol=1e-12)
    assert few["restitution"].size < all_of_them["restitution"].size


@pytest.mark.slow
def test_few_frames_of_a_film_at_rest_are_read(tmp_path: Path) -> None:
    frame = np.arange(400)
    sway = 3.0 * np.exp(-frame / 16.0) * np.cos(2 * np.pi * frame / 20.0)
    y, x = np.mgrid[:96, :96].astype(float)
    waves = np.random.default_rng(1).uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 6.3], (60, 3))
    noise = np.random.default_rng(2).normal(0.0, 2.0, (frame.size, 96, 96))

    def picture(shift: float) -> np.ndarray:
        return sum(np.cos(kx * x + ky * (y - shift) + phase) for kx, ky, phase in waves)

    levels = np.stack([128.0 + 8.0 * picture(shift) for shift in sway - sway[0]]) + noise
    path = tmp_path / "holder.cine"
    images = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    phantom.write(path, images, images.shape, frame / 1e4, phantom.Recording(10_000, 5e-6, bits=8))
    tracking = Tracking(body=(48.0, 48.0), body_subset=41, static_frames=1)
    settings = DicValidation(kind="dic_validation", film=str(path), camera="unused", tracking=tracking)
    short, whole = (dic_validation.track(path, settings=settings, full=full) for full in (False, True))
    same = whole.sel(frame=short["frame"])
    assert np.abs(short["dy"] - same["dy"]).max() <= same["u_dy"].median()
    read = "frames_read", "coarse_frames_read"
    assert work(short, *read) < work(whole, *read)


@pytest.mark.slow
def test_frames_without_contact_are_hardly_read() -> None:
    y, x = np.mgrid[:128, :144].astype(float)
    r = 4.34e-6 * np.hypot(x - 70.3, y - 62.6)
    generator = np.random.default_rng(2)
    film = np.empty((112, *r.shape), np.uint8)
    for k in range(112):
        phase = 16.0 * (k / 112 - 0.5)  # one contact in the middle eighth
        if abs(phase) < 1.0:
            gap = gap_of_hertz(r, 150e-6 * np.cos(0.5 * np.pi * phase) + 30e-6, SPHERE)
        else:
            gap = r**2 / (2 * SPHERE) + 1e-4 * (abs(phase) - 1.0) + 1e-6
        # rings of a wide gap run through the exposure and are smeared out
        fringes = 0.8 * np.exp(-((gap / 2e-5) ** 2)) * np.cos(4 * np.pi * gap / 633e-9)
        film[k] = np.clip(np.rint(120.0 * (1.0 - fringes) + 3.0 * generator.standard_normal(r.shape)), 0, 255)
    short, whole = (imaging.contact_radius(film, 4.34e-6, SPHERE, 633e-9, full=full) for full in (False, True))
    np.testing.assert_array_equal(short["in_contact"], whole["in_contact"])
    assert whole["in_contact"].any()
    assert np.nanmax(np.abs(short["radius"] - whole["radius"])) <= 1e-8
    assert work(short, "pixels_read") < work(whole, "pixels_read")


@pytest.mark.slow
def test_subsets_are_followed_as_if_alone() -> None:
    film, _ = make_film(256, 5, 2.0)
    axis = np.arange(30.0, 226.0, 14.0)
    field = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    wanted = np.array([0, len(axis) - 1, len(field) // 2, len(field) - 1])
    few, many = imaging.track(film, field[wanted]), imaging.track(film, field)
    assert np.abs(few["dx"].values - many["dx"].values[:, wanted]).max() <= 1e-4
    assert work(few, "subsets_solved") < work(many, "subsets_solved")

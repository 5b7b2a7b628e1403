"""The benchmark's images follow from springs, and its rows hold what they promise."""

import numpy as np
import pytest

from labpipe.imaging import contact_radius
from pipelines.bench import contact_radius as bench
from tests.labpipe.imaging.fringe_film import Scene, clean_image, expose, gap_of_hertz, surface_gap


def test_gap_from_springs_is_that_of_hertz() -> None:
    scene = bench.Scene()
    places, gap = bench.gap_of(scene)
    assert gap == pytest.approx(gap_of_hertz(places, scene.radius, scene.sphere), abs=3e-11)


@pytest.mark.slow
def test_rows_reach_the_bound_and_beat_the_edge() -> None:
    (settings,) = bench.run(quick=True)
    rows = {point.setting: point for point in settings.points}
    bound = min(b.error for b in settings.bounds if b.error is not None)
    default = next(point for point in settings.points if point.is_default)
    assert bound * 0.4 < default.error < 0.01
    assert rows["Otsu's threshold, circle of equal area"].error > 100.0 * default.error
    assert {point.group for point in settings.points} >= {"", "thesis"}


SCENE, RADIUS, CENTRE = Scene(rows=240, columns=320), 200e-6, (158.3, 121.2)
DISTURBED = {  # the scene, and the largest root-mean-square error (µm); what is determined less well has more
    "ideal": (SCENE, 0.02),
    "radius moves 20 µm in the exposure": (SCENE, 0.1),
    "blur of 5 px": (SCENE.change(blur=5.0), 0.2),
    "sphere 2 % larger than stated": (SCENE.change(sphere_radius=1.02 * SCENE.sphere_radius), 0.02),
    "centre at the border": (SCENE, 0.02),
    "wavelength stated as 532 nm": (SCENE, 0.02),
    "many beams, faces that reflect 30 %": (SCENE.change(beams=0.3), 0.02),
    "sphere worn flat, 120 µm": (SCENE, 0.02),
    "ellipse, 4 %": (SCENE.change(stretch=0.04), 0.02),
    "ellipse, blur, sloping light": (SCENE.change(stretch=0.04, blur=2.0, slope_x=0.4), 0.06),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::UserWarning")  # disturbed films are measured on purpose
@pytest.mark.parametrize("name", DISTURBED)
def test_errors_stay_small_and_within_three_u_where_images_are_not_ideal(name: str) -> None:
    case, limit = DISTURBED[name]
    wavelength = 532e-9 if name.startswith("wavelength") else SCENE.wavelength
    centre = (CENTRE[0], 2.4) if "border" in name else CENTRE
    r = np.arange(0.0, 900e-6, 1e-8)
    worn = (r, surface_gap(r, RADIUS, case.sphere_radius, 120e-6)) if "flat" in name else None
    image = clean_image(case, RADIUS, centre, travel=20e-6 * ("moves" in name), profile=worn)
    random = np.random.default_rng(2)
    film = np.stack([expose(image, case, random) for _ in range(3)])
    found = contact_radius(film, SCENE.pixel_size, SCENE.sphere_radius, wavelength)
    error = found["radius"].values - RADIUS * np.sqrt(1.0 + case.stretch)
    u = np.hypot(found["u_radius"].values, found["radius_systematic"].values)
    assert np.sqrt(np.mean(error**2)) < limit * 1e-6
    assert np.all(np.abs(error) < 3.0 * u)

"""Contact radii against stored and computed truth: errors, coverage, false and missed contacts."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import instruments
from labpipe.imaging import contact_radius
from pipelines.rig import sample
from tests.labpipe.imaging.fringe_film import Scene
from tests.labpipe.imaging.impact_film import CAMERA, Film, Score, hovering, impact, score

SAMPLES = Path(__file__).parents[3] / "sample_data"
BUNDLED = sorted(SAMPLES.glob("*/film/*under.cine"))


def of_film(film: Film, scene: Scene = CAMERA) -> Score:
    given = scene.pixel_size, scene.sphere_radius, scene.wavelength
    return score(contact_radius(film.frames, *given), film.radius, film.largest)


pytestmark = [
    pytest.mark.filterwarnings("ignore:.*measured by the edge of the spot:UserWarning"),
    pytest.mark.filterwarnings("ignore:.*(frames dropped|recorded in bursts|recording pauses):UserWarning"),
]


@cache
def impacts(exposure: float, seed: int) -> Score:
    return of_film(impact(CAMERA, exposure, seed))


@pytest.mark.parametrize(
    ("exposure", "most", "median"), [(2e-6, 0.005e-6, 0.002e-6), (20e-6, 0.04e-6, 0.004e-6), (90e-6, 2e-6, 0.1e-6)]
)
def test_an_impact_is_measured_within_its_uncertainty(exposure: float, most: float, median: float) -> None:
    # at 90 µs the mean over the exposure lies 0.33 µm below the largest radius
    found = impacts(exposure, 1)
    assert (found.false, found.missed) == ([], [])
    assert np.abs(found.errors).max() < most
    assert np.median(np.abs(found.errors)) < median
    assert np.abs(found.ratios).max() < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("exposure", [2e-6, 20e-6, 90e-6])
def test_nineteen_of_twenty_radii_lie_within_two_uncertainties(exposure: float) -> None:
    ratios = np.concatenate([impacts(exposure, seed).ratios for seed in range(1, 7)])
    # of 120 radii with 95 % chance each, 90 to 99 % are within three standard deviations
    assert 0.90 <= np.mean(np.abs(ratios) < 2.0) <= 0.99
    assert np.abs(ratios).max() < 5.0


def test_a_contact_off_the_centre_in_uneven_light_is_measured() -> None:
    scene = CAMERA.change(slope_x=0.3, slope_y=-0.15, vignette=0.2)
    found = of_film(impact(scene, 20e-6, 11, centre=(190.3, 130.7)), scene)
    assert (found.false, found.missed) == ([], [])
    assert np.abs(found.errors).max() < 0.06e-6
    assert found.covered >= 0.85
    assert np.abs(found.ratios).max() < 4.0


@pytest.mark.parametrize(
    ("coherence", "count"), [(np.inf, 60), pytest.param(np.inf, 600, marks=pytest.mark.slow),
                             (8e-6, 60), pytest.param(8e-6, 600, marks=pytest.mark.slow)]
)  # fmt: skip
def test_a_hovering_sphere_is_no_contact(coherence: float, count: int) -> None:
    scene = CAMERA.change(rows=200, columns=280, coherence=coherence)
    rng = np.random.default_rng(3)
    third = count // 3
    gaps = np.concatenate(
        [rng.uniform(0.0, 1e-6, third), rng.uniform(0.0, 200e-6, third), np.linspace(0.0, 0.4e-6, third)]
    )
    film = hovering(scene, gaps, 0.03, 2e-6, 5)
    found = contact_radius(film, scene.pixel_size, scene.sphere_radius, scene.wavelength)
    assert np.flatnonzero(found.in_contact).tolist() == []


def test_a_dark_disc_of_constant_size_is_a_contact_only_where_that_is_stated() -> None:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:96, :120]
    disc = np.clip(np.hypot(x - 60.3, y - 48.1) - 28.0, 0.0, 1.0) * 80.0 + 30.0
    film = np.stack([(disc + 2.0 * rng.standard_normal(disc.shape)).astype(np.uint8) for _ in range(3)])
    with pytest.warns(UserWarning, match="neither grow nor shrink"):
        found = contact_radius(film, 4.34e-6, 9.525e-3, 633e-9)
    assert not found.in_contact.any()
    with pytest.warns(UserWarning, match="edge of the spot"):
        found = contact_radius(film, 4.34e-6, 9.525e-3, 633e-9, any_disc=True)
    assert found.in_contact.all()


def check_session(path: Path) -> None:
    """Compare with the truth next to a film, which is resolved to the rings of its simulator.

    The rings are the sphere's, not those of the paraboloid: 0.03 % of a radius of a ninth of the sphere's. They are
    1.0 to 1.5 µm wide, and the simulator errs by 0.6 to 0.9 µm itself.
    """
    truth = json.loads((path.parents[1] / "truth" / f"{path.stem}.json").read_text())
    film, given = instruments.read(path), (truth["pixel_size"], 9.525e-3, truth["wavelength"])
    data = contact_radius(film, *given, u_pixel_size=truth["pixel_size"] / 461, u_sphere_radius=5e-6)
    radius = np.array(truth["contact_radius"])
    found = score(data, radius, radius, np.hypot(truth["resolution"] / np.sqrt(3.0), 3e-4 * radius))
    assert (found.false, found.missed) == ([], [])
    assert np.sqrt(np.mean(found.errors**2)) < 0.70e-6
    assert found.covered >= 0.92
    assert np.nanmax(data.radius_systematic) < 3e-6
    assert not (data.method == 2).any()


@pytest.mark.parametrize("path", BUNDLED, ids=lambda path: path.stem)
def test_bundled_films(path: Path) -> None:
    check_session(path)


@pytest.mark.slow
def test_the_campaign_at_its_default_size(tmp_path: Path) -> None:
    sample("thesis", tmp_path)
    films = sorted((tmp_path / "film").glob("*under.cine"))
    assert len(films) == 5
    for path in films:
        check_session(path)

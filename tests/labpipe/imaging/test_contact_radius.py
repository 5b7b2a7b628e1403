import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.frames import ArrayFrames
from labpipe.imaging import contact_radius
from labpipe.imaging.fringes._arguments import FilmOptions, check_film
from pipelines.bench.contact_radius import Scene as Ideal, cramer_rao
from tests.by_day import by_day
from tests.labpipe.imaging.fringe_film import (
    Scene,
    clean_image,
    expose,
    exposed_image,
    fringe_film,
    gap_of_hertz,
    intensity_of_gap,
    lit,
)

SMALL = Scene(rows=240, columns=320)
UNEVEN = SMALL.change(slope_x=-0.2, slope_y=0.2, vignette=0.3, visibility=0.4)
FULL = Scene()
UM = 1e-6

NIGHTLY = pytest.mark.nightly
pytestmark = pytest.mark.filterwarnings("ignore:.*(measured by the edge of the spot|neither grow nor):UserWarning")


def measure(film: np.ndarray | ArrayFrames, scene: Scene, **options: object) -> xr.Dataset:
    given = scene.pixel_size, scene.sphere_radius, scene.wavelength
    return contact_radius(film, *given, **options)  # type: ignore[arg-type]


def still_film(
    scene: Scene, a: float, count: int, centre: tuple[float, float], samples: int = 3, seed: int = 0
) -> np.ndarray:
    """The same contact with new noise in every frame."""
    rng = np.random.default_rng(seed)
    image = clean_image(scene, a, centre, samples=samples)
    return np.stack([expose(image, scene, rng) for _ in range(count)])


def check_ideal(scene: Scene, micrometres: int, count: int, centre: tuple[float, float]) -> None:
    a = micrometres * UM
    found = measure(still_film(scene, a, count, centre, samples=5), scene)
    error = found.radius.values - a
    place = centre[0] - 0.5 * (scene.columns - 1), centre[1] - 0.5 * (scene.rows - 1)
    ideal = replace(Ideal().camera, rows=scene.rows, columns=scene.columns, centre=place)
    bound = cramer_rao(Ideal(ideal, a), 3.0) * UM
    scatter, told = error.std(ddof=1), found.u_radius.values.mean()
    by_chance = 1.0 / np.sqrt(2.0 * count)
    assert (found.method == 1).all()
    assert abs(error.mean()) <= max(0.01 * UM, 3.0 * bound / np.sqrt(count))
    assert told <= 1.3 * bound
    assert scatter <= 1.3 * bound * (1.0 + 2.0 * by_chance)
    assert told == pytest.approx(scatter, rel=0.2 + 2.0 * by_chance)
    assert found.residual_ratio.values == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("micrometres", [60, 150])
def test_ideal_film_reaches_the_bound(micrometres: int) -> None:
    check_ideal(SMALL, micrometres, 16, (155.3, 118.2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("micrometres", "centre"),
    [
        (200, (640.3, 240.2)),
        (1194, (640.3, 240.2)),
        (800, (640.2, -60.3)),  # cut by the frame, as is the next
        (1194, (420.3, 120.2)),
        *(
            pytest.param(*case, marks=NIGHTLY)
            for case in ((434, (640.3, 240.2)), (800, (640.3, 240.2)), (800, (420.2, 120.1)), (800, (100.1, 400.2)))
        ),
    ],
)
def test_ideal_full_size_film_reaches_the_bound(micrometres: int, centre: tuple[float, float]) -> None:
    check_ideal(FULL, micrometres, 40, centre)


OTHER_FILMS = {  # the scene, the radius and the largest error (µm)
    "bright contact": (SMALL.change(phase=0.0), 150.0, 0.01),
    "phase off by 0.2": (SMALL.change(phase=np.pi + 0.2), 150.0, 0.02),
    "phase off by 0.5": (SMALL.change(phase=np.pi - 0.5), 150.0, 0.02),
    "phase neither dark nor bright": (SMALL.change(phase=0.5 * np.pi), 150.0, 0.02),
    "slopes": (SMALL.change(mean=80.0, slope_x=0.3, slope_y=0.2), 150.0, 0.01),
    "vignette": (SMALL.change(vignette=0.4), 150.0, 0.01),
    "faint and noisy": (SMALL.change(visibility=0.3, noise=15.0), 150.0, 0.05),
    "shot noise": (SMALL.change(noise=1.0, shot_noise=0.3), 150.0, 0.01),
    "gamma": (SMALL.change(gamma=0.8), 150.0, 0.02),
    "blur of 1 px": (SMALL.change(blur=1.0), 200.0, 0.05),
    "blur of 2 px": (SMALL.change(blur=2.0), 200.0, 0.05),
    "low coherence": (SMALL.change(coherence=1e-6), 150.0, 0.15),
    "12 bit": (SMALL.change(mean=1900.0, noise=60.0, white=4095.0), 150.0, 0.01),
    "radius 2 % larger than given": (SMALL.change(sphere_radius=9.7155e-3), 150.0, 0.02),
    "wavelength 1 % longer than given": (SMALL.change(wavelength=639.33e-9), 150.0, 0.02),
    "small sphere": (SMALL.change(sphere_radius=3e-3), 200.0, 0.02),
    "large sphere": (SMALL.change(sphere_radius=30e-3), 150.0, 0.02),
    "coarse pixels": (SMALL.change(pixel_size=5e-6), 350.0, 0.02),
    "fine pixels": (SMALL.change(pixel_size=0.8e-6), 70.0, 0.02),
    "blue light": (SMALL.change(wavelength=450e-9), 150.0, 0.02),
    "infrared": (SMALL.change(wavelength=850e-9), 150.0, 0.02),
    "fringes alias far out": (UNEVEN.change(sphere_radius=2.8e-3, wavelength=570e-9), 185.0, 0.02),
    "bright contact in uneven light": (UNEVEN.change(sphere_radius=2.8e-3, phase=0.0), 190.0, 0.02),
    "fringes of two pixels": (SMALL.change(sphere_radius=1.6e-3, pixel_size=2.75e-6), 190.0, 0.02),
    "large pixels": (SMALL.change(sphere_radius=8e-3, pixel_size=6e-6, wavelength=497e-9), 380.0, 0.03),
    "faint, 60 um": (SMALL.change(visibility=0.3), 60.0, 0.06),
    "faint and bright, 75 um": (SMALL.change(visibility=0.3, phase=0.0), 75.0, 0.06),
    "faint, 140 um": (SMALL.change(visibility=0.3), 140.0, 0.06),
}


@pytest.mark.parametrize("case", by_day(OTHER_FILMS, 14))
def test_light_and_optics_hardly_move_the_radius(case: str) -> None:
    scene, micrometres, limit = OTHER_FILMS[case]
    film = still_film(scene, micrometres * UM, 3, (155.3, 118.2), samples=5)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = measure(film, SMALL if "than given" in case else scene)
    assert (found.method == 1).all()
    assert np.abs(found.radius.values - micrometres * UM).max() <= limit * UM
    assert bool(caught) == ("than given" in case)
    if "phase" in case or "blur" in case:
        turns = (found.attrs["phase"] - scene.phase) / (2.0 * np.pi)
        assert abs(turns - round(turns)) * 2.0 * np.pi < 0.02
        assert (found.residual_ratio < 1.1).all()


def test_given_phase_is_kept() -> None:
    film = still_film(SMALL, 150 * UM, 2, (155.3, 118.2))
    with pytest.warns(UserWarning, match="show a phase of 3.14"):
        found = measure(film, SMALL, phase=np.pi + 0.2)
    assert found.attrs["phase"] == np.pi + 0.2
    assert 0.3 * UM < abs(float(found.radius[0]) - 150 * UM) < 1.5 * UM


def ramp_film(step: float, travel: float) -> tuple[ArrayFrames, np.ndarray, float]:
    """A contact that grows by ``step`` a frame, blurred by ``travel``; exposure goes with it."""
    rng = np.random.default_rng(0)
    radii = 120 * UM + step * np.arange(5)
    images = [expose(clean_image(SMALL, a, (155.3, 118.2), travel=travel, samples=2), SMALL, rng) for a in radii]
    return ArrayFrames(np.stack(images), 1e-4 * np.arange(5)), radii, 1e-4 * travel / step


@pytest.mark.parametrize(("travel", "limit"), by_day([(10.0, 0.1), (5.0, 0.02), (20.0, 0.3)], 1))
@pytest.mark.parametrize("is_exposure_known", [True, False])
def test_motion_in_the_exposure_is_allowed_for(travel: float, limit: float, is_exposure_known: bool) -> None:
    film, radii, exposure = ramp_film(25.0 * UM, travel * UM)
    found = measure(film, SMALL, exposure=exposure if is_exposure_known else None)
    assert (found.method == 1).all()
    assert np.abs(found.radius.values - radii).max() <= limit * UM
    assert found.travel.values == pytest.approx(travel * UM, rel=0.05)


def test_ellipse_leaves_the_mean_radius_and_costs_little_where_it_is_free() -> None:
    scene = SMALL.change(stretch=0.015)
    film = still_film(scene, 200 * UM, 4, (155.3, 118.2), samples=5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = measure(film, SMALL)
    assert found.radius.values == pytest.approx(200 * UM * np.sqrt(1.015), abs=0.1 * UM)
    assert found.semi_axis_major.values == pytest.approx(203 * UM, abs=0.1 * UM)
    assert found.semi_axis_minor.values == pytest.approx(200 * UM, abs=0.1 * UM)
    assert found.axis_angle.values == pytest.approx(0.0, abs=0.02)
    free = measure(still_film(SMALL, 200 * UM, 3, (155.3, 118.2), samples=5), SMALL, shape="ellipse")
    assert free.radius.values == pytest.approx(200 * UM, abs=0.02 * UM)
    assert (free.u_radius < 0.005 * UM).all()


def no_contacts() -> dict[str, np.ndarray]:
    """Relative brightness of scenes that show no contact."""
    y, x = np.mgrid[: SMALL.rows, : SMALL.columns]
    r, beside = np.hypot(x - 160.0, y - 120.0), np.hypot(x + 20.0, y - 120.0)

    def rings(gap: float, spread: float = 0.0) -> np.ndarray:
        states = [(0.0, (gap + spread * moment) * UM) for moment in np.linspace(-0.5, 0.5, 15)]
        return exposed_image(SMALL, states, (160.3, 118.1), 2) / 120.0

    return {
        "flat": 1.0 + 0.0 * r,
        "dark": 0.02 + 0.0 * r,
        "white": 3.0 + 0.0 * r,
        "gradient": 1.0 + 0.5 * (x - 160.0) / 160.0,
        "vignette": 1.0 - 0.5 * (r / 200.0) ** 2,
        "shadow cut by the frame": 1.0 - 0.7 * np.exp(-0.5 * ((beside / 25.0) ** 2)),
        "stripes": 1.0 + 0.7 * np.cos(x / 3.0),
        **{f"soft shadow {w}": 1.0 - 0.7 * np.exp(-0.5 * (r / w) ** 2) for w in (15, 40, 80)},
        **{f"soft disc {w}": 1.0 - 0.7 / (1.0 + np.exp(np.clip((r - 80) / w, -50, 50))) for w in (10, 40)},
        **{f"rings at {g} um": rings(g) for g in (0.0, 0.05, 0.08, 0.16, 0.24, 0.32, 1.0)},
        **{f"moving rings {w} um": rings(0.3, w) for w in (0.05, 0.1, 0.2, 0.3)},
    }


def test_no_contact_is_seen_where_there_is_none() -> None:
    rng = np.random.default_rng(5)
    images = no_contacts()
    film = np.stack([expose(120.0 * image, SMALL, rng) for image in images.values()])
    found = measure(film, SMALL)
    wrong = [name for name, seen in zip(images, found.in_contact.values, strict=True) if seen]
    assert wrong == []
    assert np.isnan(found.radius.values).all()
    assert (found.method == 0).all()


def test_disc_without_fringes_falls_back_to_its_edge_with_its_own_error_bar() -> None:
    y, x = np.mgrid[: SMALL.rows, : SMALL.columns]
    disc = np.where(np.hypot(x - 160.0, y - 120.0) < 80.0, 24.0, 120.0)
    found = measure(expose(disc, SMALL, np.random.default_rng(6))[None], SMALL, any_disc=True)
    assert int(found.method[0]) == 2
    assert 2.0 * UM < float(found.u_radius[0]) < 15.0 * UM
    assert abs(float(found.radius[0]) - 80.0 * SMALL.pixel_size) < 2.5 * float(found.u_radius[0])


@pytest.mark.parametrize(("micrometres", "travel"), by_day([(130.0, 60.0), (200.0, 80.0), (200.0, 150.0)], 1))
def test_long_motion_in_the_exposure_widens_the_error_bar(micrometres: float, travel: float) -> None:
    rng = np.random.default_rng(7)
    centre = (160.3, 118.1)
    a, step = micrometres * UM, 0.8 * travel * UM
    smear = clean_image(SMALL, a, centre, travel=travel * UM, samples=2)
    images = [smear, *(clean_image(SMALL, a + step + more, centre) for more in (0.0, 10.0 * UM))]
    film = np.stack([expose(image, SMALL, rng) for image in images])
    found = measure(film, SMALL)
    assert found.in_contact.values.tolist() == [True, True, True]
    error = abs(float(found.radius[0]) - a)
    assert error < 2.5 * float(found.u_radius[0]) < 20.0 * UM


@pytest.mark.parametrize("phase", [np.pi, 0.0])
def test_spot_with_fringes_beyond_resolution_is_an_edge(phase: float) -> None:
    scene = SMALL.change(sphere_radius=1.8e-3, pixel_size=5e-6, wavelength=557e-9, phase=phase)
    with pytest.warns(UserWarning, match="finer than two pixels"):
        found = measure(still_film(scene, 300 * UM, 1, (160.3, 118.1), samples=9), scene, any_disc=True, phase=phase)
    assert int(found.method[0]) == 2
    assert abs(float(found.radius[0]) - 300 * UM) < 2.0 * float(found.u_radius[0])


def film_of_open_gap(scene: Scene, factor: float, curve: float) -> tuple[np.ndarray, list[float]]:
    """Two contacts under load, and three that recede from a dent: their gap opens more slowly.

    The gap is ``factor`` times that of Hertz, with a further term (r - a)^(5/2) of the share
    ``curve`` one tenth of the radius outside.
    """
    radii = [190.0, 200.0, 185.0, 165.0, 140.0]
    r = np.linspace(0.0, 1200 * UM, 60_001)
    images = []
    for index, radius in enumerate(radii):
        a = radius * UM
        gap = gap_of_hertz(r, a, scene.sphere_radius)
        if index > 1:
            gap = gap * factor * (1.0 + curve * np.maximum(r - a, 0.0) / (0.1 * a))
        images.append(clean_image(scene, a, (160.3, 118.1), samples=4, profile=(r, gap)))
    rng = np.random.default_rng(9)
    return np.stack([expose(image, scene, rng) for image in images]), radii


@pytest.mark.parametrize(("factor", "curve"), by_day([(0.7, 0.05), (0.9, 0.0), (0.5, 0.0), (0.5, 0.1)], 1))
def test_gap_that_still_recovers_is_fitted_with_its_own_factor(factor: float, curve: float) -> None:
    film, radii = film_of_open_gap(SMALL, factor, curve)
    found = measure(film, SMALL)
    error = np.abs(found.radius.values - np.array(radii) * UM)
    assert found.method.values.tolist() == [1, 1, 5, 5, 5]
    assert (error < 3.0 * found.u_radius.values + 0.01 * UM).all()
    assert error.max() < (0.1 if curve == 0.0 else 4.0) * UM
    if curve == 0.0:
        assert found.gap_factor.values[2:] == pytest.approx(factor, rel=0.01)


def test_rings_of_a_sphere_that_leaves_are_not_fitted_as_contacts() -> None:
    """Coarse pixels make moiré rings of the fringes of a sphere far from the flat."""
    scene = SMALL.change(rows=120, columns=200, pixel_size=9.1e-6, noise=3.0)
    centre, rng = (103.8, 56.9), np.random.default_rng(4)
    images = [clean_image(scene, a * UM, centre, samples=5) for a in (560.0, 430.0, 209.0)]
    images += [clean_image(scene, 0.0, centre, gap=gap * UM, samples=5) for gap in (0.4, 2.1, 8.3, 17.7, 29.6, 44.2)]
    found = measure(np.stack([expose(image, scene, rng) for image in images]), scene)
    assert found.in_contact.values.tolist() == [True] * 3 + [False] * 6


def test_white_light_gives_the_edge_and_says_so() -> None:
    scene, a, centre = SMALL, 200 * UM, (160.3, 118.1)
    y, x = np.mgrid[: scene.rows, : scene.columns]
    r = np.hypot(x - centre[0], y - centre[1]) * scene.pixel_size
    gap = gap_of_hertz(r, a, scene.sphere_radius)
    colours = [intensity_of_gap(gap, scene.change(wavelength=w)) for w in np.linspace(450e-9, 650e-9, 21)]
    image = lit(np.mean(colours, axis=0), scene)
    film = np.stack([expose(image, scene, np.random.default_rng(8))] * 2)
    with pytest.warns(UserWarning, match="no wavelength is given"):
        found = contact_radius(film, scene.pixel_size, scene.sphere_radius, None, any_disc=True)
    assert (found.method == 2).all()
    assert "wavelength not given" in found.attrs["note"]
    assert np.abs(found.radius.values - a).max() < 2.0 * found.u_radius.values.max()


def test_contact_wider_than_the_frame_is_a_contact_without_radius() -> None:
    scene = SMALL.change(rows=160, columns=200)
    radii = [100 * UM, 180 * UM, 300 * UM, 320 * UM, 190 * UM]
    found = measure(fringe_film(scene, radii, [(99.0, 80.0)] * 5), scene)
    assert found.in_contact.values.all()
    assert found.method.values.tolist() == [1, 1, 4, 4, 1]
    assert np.isnan(found.radius.values[2:4]).all()


def test_budget_follows_from_the_uncertainties_given() -> None:
    film = still_film(SMALL, 150 * UM, 1, (155.3, 118.2))
    pixel = SMALL.pixel_size
    found = measure(
        film, SMALL, u_pixel_size=3e-4 * pixel, u_sphere_radius=0.02 * SMALL.sphere_radius,
        u_phase=0.05,
    )  # fmt: skip
    parts = found.systematic_part.sel(source=["pixel_size", "sphere_radius", "phase"]).values[0]
    # The film itself tells large errors of R and of the phase; the budget is for small ones.
    with pytest.warns(UserWarning, match="narrower"):
        shifted = measure(film, SMALL.change(sphere_radius=1.02 * SMALL.sphere_radius))
    assert shifted.radius.values == pytest.approx(150 * UM, abs=0.02 * UM)
    wrong_pixel = measure(film, SMALL.change(pixel_size=(1.0 + 3e-4) * pixel))
    assert parts[0] == pytest.approx(abs(float(wrong_pixel.radius[0] - found.radius[0])), rel=0.1)
    assert 0.3 * UM < parts[1] < 1.2 * UM
    total = float(found.radius_systematic[0])
    assert total == pytest.approx(float(np.sqrt((found.systematic_part.values**2).sum())))


def test_damaged_frames_are_flagged_and_the_others_measured() -> None:
    film = still_film(SMALL, 150 * UM, 4, (155.3, 118.2)).astype(np.float32)
    film[2, 100, 100] = np.nan
    with pytest.warns(UserWarning, match="1 damaged"):
        found = measure(film, SMALL)
    assert found.valid.values.tolist() == [True, True, False, True]
    assert found.method.values.tolist() == [1, 1, 0, 1]
    assert np.isnan(found.radius.values[2])


def test_every_variable_says_what_it_is_and_is_the_same_again() -> None:
    film = still_film(SMALL, 150 * UM, 2, (155.3, 118.2))
    found = measure(film, SMALL)
    xr.testing.assert_identical(found, measure(film.copy(), SMALL))
    for name, variable in found.data_vars.items():
        assert {"units", "long_name"} <= variable.attrs.keys(), name
    assert json.loads(found.attrs["work"])["frames_read"] == 2
    flags = found.method.attrs
    assert len(flags["flag_values"]) == len(flags["flag_meanings"].split())


RANGES = {"pixel_size": (1e-9, 1e-3), "sphere_radius": (1e-6, 10.0), "wavelength": (100e-9, 20e-6),
          "fringes": (0.5, 20.0)}  # fmt: skip
GIVEN = {"pixel_size": 1e-5, "sphere_radius": 1e-2, "wavelength": 532e-9}
BLACK = ArrayFrames(np.zeros((3, 16, 16), np.uint8), np.arange(3.0))


@pytest.mark.parametrize("name", RANGES)
def test_both_ends_of_a_range_belong_to_it_and_nothing_beyond(name: str) -> None:
    low, high = RANGES[name]
    for value in (low, high):
        check_film(BLACK, FilmOptions(**(GIVEN | {name: value})))
    for value in (0.999 * low, 1.001 * high, np.nan, -low):
        with pytest.raises(InputError, match=name):
            contact_radius(BLACK, **(GIVEN | {name: value}))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"shape": "square"}, "shape must be"),
        ({"phase": np.inf}, "phase must be a finite angle"),
        ({"exposure": -1e-9}, "not negative"),
        ({"exposure": np.zeros(2)}, r"one per frame \(3\)"),
        ({"frames": np.zeros((3, 15, 16), np.uint8)}, "16 x 16"),
        ({"frames": np.zeros((0, 16, 16), np.uint8)}, "no frames"),
    ],
)
def test_wrong_arguments_are_refused(changes: dict[str, object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        contact_radius(**({"frames": BLACK} | GIVEN | changes))  # type: ignore[arg-type]

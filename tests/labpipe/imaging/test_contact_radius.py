import json
import warnings

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.frames import ArrayFrames
from labpipe.imaging import contact_radius
from tests.by_day import by_day
from tests.labpipe.imaging.fringe_film import (
    Scene,
    clean_image,
    expose,
    fringe_film,
    gap_of_hertz,
    intensity_of_gap,
    lit,
)

SMALL = Scene(rows=240, columns=320)
FULL = Scene()
UM = 1e-6

NIGHTLY = pytest.mark.nightly
pytestmark = pytest.mark.filterwarnings("ignore:.*(measured by the edge of the spot|neither grow nor):UserWarning")


def measure(film: np.ndarray | ArrayFrames, scene: Scene, **options: object) -> xr.Dataset:
    return contact_radius(
        film,
        scene.pixel_size,
        scene.sphere_radius,
        scene.wavelength,
        **options,  # type: ignore[arg-type]
    )


def still_film(
    scene: Scene, a: float, count: int, centre: tuple[float, float], samples: int = 3, seed: int = 0
) -> np.ndarray:
    """The same contact with new noise in every frame."""
    rng = np.random.default_rng(seed)
    image = clean_image(scene, a, centre, samples=samples)
    return np.stack([expose(image, scene, rng) for _ in range(count)])


def cramer_rao(scene: Scene, a: float, centre: tuple[float, float], reach: float) -> float:
    """Least possible standard deviation of a (m), from differences of supersampled images.

    Unknown are a, the centre, gain, visibility and two slopes of the light; used are the pixels
    up to ``reach`` (m) from the edge of the contact on both sides.
    """
    x, y = centre
    step, shift = 0.05 * UM, 0.05
    plus = (clean_image(scene, a + step, centre), clean_image(scene, a, (x + shift, y)),
            clean_image(scene, a, (x, y + shift)))  # fmt: skip
    minus = (clean_image(scene, a - step, centre), clean_image(scene, a, (x - shift, y)),
             clean_image(scene, a, (x, y - shift)))  # fmt: skip
    image = clean_image(scene, a, centre)
    rows, columns = np.mgrid[: scene.rows, : scene.columns]
    slopes = [(one - other) / 2.0 for one, other in zip(plus, minus, strict=True)]
    slopes[0] /= step
    slopes += [image, image - scene.mean, image * (columns - x), image * (rows - y)]
    r = np.hypot(columns - x, rows - y) * scene.pixel_size
    used = np.abs(r - a) < reach
    matrix = np.stack([slope[used] for slope in slopes])
    scale = np.sqrt((matrix**2).sum(axis=1))
    inverse = np.linalg.inv(matrix @ matrix.T / np.outer(scale, scale))
    return float(np.sqrt(inverse[0, 0])) / scale[0] * np.hypot(scene.noise, 12.0**-0.5)


#: Width of the first three fringes by radius (um).
REACH = {60: 92.0, 150: 71.0, 200: 65.5, 434: 50.9, 800: 41.5, 1194: 36.3}


def check_ideal(scene: Scene, micrometres: int, count: int, centre: tuple[float, float]) -> None:
    a = micrometres * UM
    found = measure(still_film(scene, a, count, centre, samples=5), scene)
    error = found.radius.values - a
    bound = cramer_rao(scene, a, centre, REACH[micrometres] * UM)
    scatter, told = error.std(ddof=1), found.u_radius.values.mean()
    by_chance = 1.0 / np.sqrt(2.0 * count)
    assert (found.method == 1).all()
    assert abs(error.mean()) <= 0.01 * UM
    assert told <= 1.3 * bound
    assert scatter <= 1.3 * bound * (1.0 + 2.0 * by_chance)
    assert told == pytest.approx(scatter, rel=0.2 + 2.0 * by_chance)
    assert found.residual_ratio.values == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("micrometres", [60, 150])
def test_ideal_film_reaches_the_bound(micrometres: int) -> None:
    check_ideal(SMALL, micrometres, 16, (155.3, 118.2))


@pytest.mark.slow
@pytest.mark.parametrize("micrometres", [200, 1194, *(pytest.param(a, marks=NIGHTLY) for a in (434, 800))])
def test_ideal_full_size_film_reaches_the_bound(micrometres: int) -> None:
    check_ideal(FULL, micrometres, 40, (640.3, 240.2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("micrometres", "centre"),
    [
        (800, (640.2, -60.3)),
        (1194, (420.3, 120.2)),
        pytest.param(800, (420.2, 120.1), marks=NIGHTLY),
        pytest.param(800, (100.1, 400.2), marks=NIGHTLY),
    ],
)
def test_contact_cut_by_the_frame_reaches_the_bound(micrometres: int, centre: tuple[float, float]) -> None:
    a = micrometres * UM
    found = measure(still_film(FULL, a, 24, centre, samples=5), FULL)
    error = found.radius.values - a
    bound = cramer_rao(FULL, a, centre, REACH[micrometres] * UM)
    assert abs(error.mean()) <= max(0.01 * UM, 3.0 * bound / np.sqrt(24))
    assert error.std(ddof=1) <= 1.3 * bound * 1.3
    assert found.u_radius.values.mean() <= 1.3 * bound


OTHER_LIGHT = {
    "bright contact": (SMALL.change(phase=0.0), 0.01),
    "phase off by 0.2": (SMALL.change(phase=np.pi + 0.2), 0.02),
    "phase off by 0.5": (SMALL.change(phase=np.pi - 0.5), 0.02),
    "neither dark nor bright": (SMALL.change(phase=0.5 * np.pi), 0.02),
    "slopes": (SMALL.change(mean=80.0, slope_x=0.3, slope_y=0.2), 0.01),
    "vignette": (SMALL.change(vignette=0.4), 0.01),
    "faint and noisy": (SMALL.change(visibility=0.3, noise=15.0), 0.05),
    "shot noise": (SMALL.change(noise=1.0, shot_noise=0.3), 0.01),
    "gamma": (SMALL.change(gamma=0.8), 0.02),
    "blur": (SMALL.change(blur=1.0), 0.06),
    "low coherence": (SMALL.change(coherence=1e-6), 0.15),
    "12 bit": (SMALL.change(mean=1900.0, noise=60.0, white=4095.0), 0.01),
    "radius 2 % larger than given": (SMALL.change(sphere_radius=9.7155e-3), 0.02),
    "wavelength 1 % longer than given": (SMALL.change(wavelength=639.33e-9), 0.02),
}


@pytest.mark.parametrize("case", by_day(sorted(OTHER_LIGHT), 5))
def test_light_and_optics_hardly_move_the_radius(case: str) -> None:
    scene, limit = OTHER_LIGHT[case]
    film = still_film(scene, 150.0 * UM, 4, (155.3, 118.2))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = measure(film, SMALL)
    assert (found.method == 1).all()
    assert np.abs(found.radius.values - 150.0 * UM).max() <= limit * UM
    assert bool(caught) == ("than given" in case)
    if "phase" in case or "contact" in case:
        turns = (found.attrs["phase"] - scene.phase) / (2.0 * np.pi)
        assert abs(turns - round(turns)) * 2.0 * np.pi < 0.02


def test_given_phase_is_kept() -> None:
    film = still_film(SMALL, 150 * UM, 2, (155.3, 118.2))
    with pytest.warns(UserWarning, match="show a phase of 3.14"):
        found = measure(film, SMALL, phase=np.pi + 0.2)
    assert found.attrs["phase"] == np.pi + 0.2
    assert 0.3 * UM < abs(float(found.radius[0]) - 150 * UM) < 1.5 * UM


OTHER_FILMS = {
    "small sphere": (SMALL.change(sphere_radius=3e-3), 200.0),
    "large sphere": (SMALL.change(sphere_radius=30e-3), 150.0),
    "coarse pixels": (SMALL.change(pixel_size=5e-6), 350.0),
    "fine pixels": (SMALL.change(pixel_size=0.8e-6), 70.0),
    "blue light": (SMALL.change(wavelength=450e-9), 150.0),
    "infrared": (SMALL.change(wavelength=850e-9), 150.0),
}


@pytest.mark.parametrize("case", sorted(OTHER_FILMS))
def test_other_films_are_measured_to_their_stated_uncertainty(case: str) -> None:
    scene, micrometres = OTHER_FILMS[case]
    a = micrometres * UM
    found = measure(still_film(scene, a, 4, (155.3, 118.2), samples=5), scene)
    assert (found.method == 1).all()
    error = np.abs(found.radius.values - a)
    assert (error < 4.0 * found.u_radius.values + 0.005 * UM).all()


def smeared(scene: Scene, a: float, travel: float, centre: tuple[float, float]) -> np.ndarray:
    return clean_image(scene, a, centre, travel=travel, exposures=25, samples=2)


def ramp_film(step: float, travel: float, seed: int = 0) -> tuple[ArrayFrames, np.ndarray, float]:
    """A contact that grows by ``step`` a frame, blurred by ``travel``; exposure goes with it."""
    rng = np.random.default_rng(seed)
    radii = 120 * UM + step * np.arange(5)
    centre = (155.3, 118.2)
    images = [expose(smeared(SMALL, a, travel, centre), SMALL, rng) for a in radii]
    return ArrayFrames(np.stack(images), 1e-4 * np.arange(5)), radii, 1e-4 * travel / step


@pytest.mark.parametrize(("travel", "limit"), by_day([(10.0, 0.1), (5.0, 0.02), (20.0, 0.3)], 1))
@pytest.mark.parametrize("is_exposure_known", [True, False])
def test_motion_in_the_exposure_is_allowed_for(travel: float, limit: float, is_exposure_known: bool) -> None:
    film, radii, exposure = ramp_film(25.0 * UM, travel * UM)
    found = measure(film, SMALL, exposure=exposure if is_exposure_known else None)
    assert (found.method == 1).all()
    assert np.abs(found.radius.values - radii).max() <= limit * UM
    assert found.travel.values == pytest.approx(travel * UM, rel=0.05)


def test_ellipse_leaves_the_mean_radius() -> None:
    scene = SMALL.change(stretch=0.015)
    film = still_film(scene, 200 * UM, 4, (155.3, 118.2), samples=5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = measure(film, SMALL)
    assert found.radius.values == pytest.approx(200 * UM * np.sqrt(1.015), abs=0.1 * UM)
    assert found.semi_axis_major.values == pytest.approx(203 * UM, abs=0.1 * UM)
    assert found.semi_axis_minor.values == pytest.approx(200 * UM, abs=0.1 * UM)
    assert found.axis_angle.values == pytest.approx(0.0, abs=0.02)


def test_ellipse_free_in_every_frame_costs_little() -> None:
    film = still_film(SMALL, 200 * UM, 3, (155.3, 118.2), samples=5)
    found = measure(film, SMALL, shape="ellipse")
    assert found.radius.values == pytest.approx(200 * UM, abs=0.02 * UM)
    assert (found.u_radius < 0.005 * UM).all()


def rings(gap: float, spread: float = 0.0) -> np.ndarray:
    """A rigid sphere above the flat; the gap may move during the exposure."""
    steps = gap + spread * (np.arange(15) / 14.0 - 0.5) if spread else np.array([gap])
    images = [clean_image(SMALL, 0.0, (160.3, 118.1), gap=g, samples=2) for g in steps]
    return np.mean(images, axis=0)


def no_contacts() -> dict[str, np.ndarray]:
    y, x = np.mgrid[: SMALL.rows, : SMALL.columns]
    r = np.hypot(x - 160.0, y - 120.0)
    r2 = np.hypot(x + 20.0, y - 120.0)
    flat = np.full(r.shape, 120.0)
    shadows = {f"soft shadow {w}": flat * (1.0 - 0.7 * np.exp(-0.5 * (r / w) ** 2)) for w in (15, 40, 80)}
    discs = {
        f"soft disc {w}": flat * (1.0 - 0.7 / (1.0 + np.exp(np.clip((r - 80) / w, -50, 50)))) for w in (10, 20, 40)
    }
    return {
        "flat": flat,
        "dark": 0.0 * flat + 2.0,
        "white": 0.0 * flat + 255.0,
        "gradient": flat * (1.0 + 0.5 * (x - 160.0) / 160.0),
        "vignette": flat * (1.0 - 0.5 * (r / 200.0) ** 2),
        **shadows,
        **discs,
        **{f"rings at {g} um": rings(g * UM) for g in (0.0, 0.05, 0.08, 0.16, 0.24, 0.32, 1.0)},
        "shadow cut by the frame": flat * (1.0 - 0.7 * np.exp(-0.5 * ((r2 / 25.0) ** 2))),
        "stripes": flat * (1.0 + 0.7 * np.cos(x / 3.0)),
        **{f"moving rings {w} um": rings(0.3 * UM, w * UM) for w in (0.05, 0.1, 0.2, 0.3)},
    }


def test_no_contact_is_seen_where_there_is_none() -> None:
    rng = np.random.default_rng(5)
    images = no_contacts()
    film = np.stack([expose(image, SMALL, rng) for image in images.values()])
    found = measure(film, SMALL)
    wrong = [name for name, seen in zip(images, found.in_contact.values, strict=True) if seen]
    assert wrong == []
    assert np.isnan(found.radius.values).all()
    assert (found.method == 0).all()


@pytest.mark.parametrize("phase", [np.pi, 0.0])
@pytest.mark.parametrize("micrometres", [60, 75, 100, 140])
def test_small_faint_contacts_are_not_missed(micrometres: int, phase: float) -> None:
    scene = SMALL.change(visibility=0.3, phase=phase)
    found = measure(still_film(scene, micrometres * UM, 2, (90.3, 70.7)), scene)
    assert (found.method == 1).all()
    assert found.radius.values == pytest.approx(micrometres * UM, abs=0.06 * UM)


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
    smear = smeared(SMALL, a, travel * UM, centre)
    images = [smear, *(clean_image(SMALL, a + step + more, centre) for more in (0.0, 10.0 * UM))]
    film = np.stack([expose(image, SMALL, rng) for image in images])
    found = measure(film, SMALL)
    assert found.in_contact.values.tolist() == [True, True, True]
    error = abs(float(found.radius[0]) - a)
    assert error < 2.5 * float(found.u_radius[0]) < 20.0 * UM


def uneven_scene(**values: float) -> Scene:
    return SMALL.change(slope_x=-0.2, slope_y=0.2, vignette=0.3, visibility=0.4, **values)


UNEVEN = {
    "fringes alias far out": (uneven_scene(sphere_radius=2.8e-3, wavelength=570e-9), 185.0, 0.02),
    "bright contact": (uneven_scene(sphere_radius=2.8e-3, phase=0.0), 190.0, 0.02),
    "fringes of two pixels": (SMALL.change(sphere_radius=1.6e-3, pixel_size=2.75e-6), 190.0, 0.02),
    "large pixels": (SMALL.change(sphere_radius=8e-3, pixel_size=6e-6, wavelength=497e-9), 380.0,
                     0.03),
}  # fmt: skip


@pytest.mark.parametrize("case", sorted(UNEVEN))
def test_contacts_in_uneven_light_and_between_fine_fringes_are_found(case: str) -> None:
    scene, micrometres, limit = UNEVEN[case]
    found = measure(still_film(scene, micrometres * UM, 2, (205.4, 81.6), samples=7), scene)
    assert (found.method == 1).all()
    assert found.radius.values == pytest.approx(micrometres * UM, abs=limit * UM)


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


@pytest.mark.parametrize("blur", [1.0, 2.0])
def test_blur_of_the_lens_is_told_from_the_film(blur: float) -> None:
    scene = SMALL.change(blur=blur)
    found = measure(still_film(scene, 200 * UM, 3, (160.3, 118.4), samples=4), SMALL)
    assert (found.method == 1).all()
    assert found.radius.values == pytest.approx(200 * UM, abs=0.05 * UM)
    assert (found.residual_ratio < 1.1).all()


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


def test_fringes_finer_than_pixels_leave_the_edge() -> None:
    scene = SMALL.change(pixel_size=12e-6)
    with pytest.warns(UserWarning, match="finer than two pixels"):
        found = measure(still_film(scene, 900 * UM, 2, (160.3, 118.1), samples=7), scene, any_disc=True)
    assert (found.method == 2).all()
    assert np.abs(found.radius.values - 900 * UM).max() < 2.0 * found.u_radius.values.max()


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


def test_same_film_gives_the_same_numbers() -> None:
    film = still_film(SMALL, 150 * UM, 3, (155.3, 118.2))
    xr.testing.assert_identical(measure(film, SMALL), measure(film.copy(), SMALL))


def test_every_variable_says_what_it_is() -> None:
    found = measure(still_film(SMALL, 150 * UM, 2, (155.3, 118.2)), SMALL)
    for name, variable in found.data_vars.items():
        assert {"units", "long_name"} <= variable.attrs.keys(), name
    assert json.loads(found.attrs["work"])["frames_read"] == 2
    flags = found.method.attrs
    assert len(flags["flag_values"]) == len(flags["flag_meanings"].split())


BAD: dict[str, dict[str, object]] = {
    "pixel_size": {"pixel_size": 0.0},
    "sphere_radius": {"sphere_radius": -1.0},
    "wavelength": {"wavelength": 633.0},
    "exposure": {"exposure": -1e-6},
    "exposure must": {"exposure": np.ones(3)},
    "shape": {"shape": "square"},
    "fringes": {"fringes": 0.0},
    "phase": {"phase": np.nan},
    "grey images": {"frames": np.zeros((2, 8, 8), np.uint8)},
}


@pytest.mark.parametrize("word", sorted(BAD))
def test_wrong_arguments_are_refused(word: str) -> None:
    arguments = {
        "frames": np.zeros((2, 64, 64), np.uint8),
        "pixel_size": 2e-6,
        "sphere_radius": 1e-2,
        "wavelength": 633e-9,
    }
    with pytest.raises(InputError, match=word):
        contact_radius(**(arguments | BAD[word]))  # type: ignore[arg-type]

"""What stands before the specimen: a subset that it partly covers is uncertain, the others are not."""

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from labpipe.arrays import Floats
from labpipe.imaging import track
from labpipe.imaging.dic._misfit import misfit_factor
from labpipe.imaging.dic._standing import unstated_box
from pipelines.bench import film_scenes
from pipelines.bench.film_scenes import Film, View, digitised, from_spectrum
from tests.by_day import by_day, crossed
from tests.labpipe.imaging.speckle import grid

SIZE, SUBSET = 240, 31
FALL = tuple(View((0.0, 0.12 * k**2)) for k in range(6))
DRIFT = tuple(View((0.4 * k, -0.3 * k)) for k in range(6))


def cover(kind: str, seed: int) -> Floats:
    """Share (row, column) of the light that comes from what stands before the specimen."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    if kind == "wire":
        angle = rng.uniform(0.0, np.pi)
        across = np.abs((x - SIZE / 2) * np.cos(angle) + (y - SIZE / 2) * np.sin(angle))
        return 1.0 / (1.0 + np.exp(2.0 * (across - 4.0)))
    places = rng.uniform(30.0, SIZE - 30.0, (5, 2))
    return np.max([1.0 / (1.0 + np.exp(2.0 * (np.hypot(x - a, y - b) - 10.0))) for a, b in places], axis=0)


def films(kind: str, views: tuple[View, ...], seed: int) -> Iterator[tuple[np.ndarray, Floats]]:
    """Films with an even and with a grained obstacle, and its share in and around every subset."""
    pattern, grain = (film_scenes.random_field(SIZE, width, seed + k) for k, width in enumerate((1.9, 1.5)))
    hidden = cover(kind, seed)
    points = grid((SIZE, SIZE), 34, 11)
    half = SUBSET // 2 + 5  # a subset moves
    share = np.array([hidden[y - half : y + half + 1, x - half : x + half + 1].mean() for x, y in points.astype(int)])
    for contrast in (0.0, 0.7):
        before = 70.0 + contrast * grain
        frames = [(1.0 - hidden) * from_spectrum(pattern, view) + hidden * before for view in views]
        yield digitised(frames, 2.0, seed), share


@pytest.mark.parametrize(("kind", "views"), by_day([("discs", FALL), ("wire", DRIFT), ("wire", FALL)], 1, 1))
def test_a_subset_behind_an_obstacle_is_uncertain(kind: str, views: tuple[View, ...]) -> None:
    for film, share in films(kind, views, seed=3):
        points = grid((SIZE, SIZE), 34, 11)
        found = track(film, points, SUBSET)
        truth = np.stack([view.displacement(points, SIZE) for view in views])
        there = np.hypot(found.dx - truth[..., 0], found.dy - truth[..., 1]).values
        still = np.hypot(found.dx, found.dy).values  # where it follows the obstacle
        u = np.hypot(found.u_dx, found.u_dy).values
        wrong = found.valid.values & (np.minimum(there, still) > 5.0 * u + 0.002)
        # Where the specimen has moved by a quarter of a pixel, hardly anything shows.
        assert wrong.mean() < 0.02
        free = share < 1e-3
        assert found.valid.values[:, free].mean() >= 0.995
        assert (there[1:, free] < 5.0 * u[1:, free] + 0.002).all()
        assert np.sqrt(np.mean(u[1:, free] ** 2) / np.mean(there[1:, free] ** 2)) == pytest.approx(1.0, abs=0.4)


def behind_a_rod(
    angle: float, width: float, tone: float, texture: float, opaque: float, views: tuple[View, ...], seed: int
) -> tuple[Film, Floats]:
    """Film of a random field behind a rod through the middle, and the polygon around the rod."""
    pattern, grain = (film_scenes.random_field(SIZE, feature, seed + k) for k, feature in enumerate((1.9, 1.5)))
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    normal, middle = np.array([np.cos(angle), np.sin(angle)]), np.full(2, SIZE / 2)
    across = np.abs((x - middle[0]) * normal[0] + (y - middle[1]) * normal[1])
    along, aside = SIZE * np.array([-normal[1], normal[0]]), (0.5 * width + 1.0) * normal
    ends = [middle + a * along + b * aside for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    share, rod = opaque / (1.0 + np.exp(3.0 * (across - 0.5 * width))), tone + texture * grain
    frames = [(1.0 - share) * from_spectrum(pattern, view) + share * rod for view in views]
    return digitised(frames, 2.0, seed + 1), np.array(ends)


RODS = [(4.0, 20.0, 0.0, 1.0), (12.0, 235.0, 0.0, 1.0), (12.0, 110.0, 0.8, 1.0), (7.0, 230.0, 0.0, 0.4)]


@pytest.mark.parametrize("views", [FALL, DRIFT], ids=["fall", "drift"])
@pytest.mark.parametrize(("width", "tone", "texture", "opaque"), by_day(RODS, 2))
def test_a_stated_obstruction_is_left_out_where_it_stands(
    width: float, tone: float, texture: float, opaque: float, views: tuple[View, ...]
) -> None:
    film, polygon = behind_a_rod(0.4 + width / 10.0, width, tone, texture, opaque, views, 40)
    points = grid((SIZE, SIZE), 34, 11)
    found = track(film, points, SUBSET, obstructions=[polygon])
    truth = np.stack([view.displacement(points, SIZE) for view in views])
    error = (np.stack([found.dx, found.dy], axis=-1) - truth)[1:]
    u = np.stack([found.u_dx, found.u_dy], axis=-1)[1:]
    is_part = found.hidden.values[1:] > 0.0
    assert "stands still" not in found.attrs["note"]
    assert found.valid.values[1:][is_part].mean() > 0.98
    assert np.hypot(*(error[is_part] / u[is_part]).T).max() < 5.5
    # some forty points, which share the noise of the reference over all frames: they tell it to a tenth
    assert np.sqrt(np.mean(u[is_part] ** 2) / np.mean(error[is_part] ** 2)) == pytest.approx(1.0, abs=0.25)


def test_an_obstruction_beside_what_it_should_cover_is_told() -> None:
    film, polygon = behind_a_rod(0.4, 12.0, 235.0, 0.0, 1.0, FALL, 60)
    found = track(film, grid((SIZE, SIZE), 34, 11), SUBSET, obstructions=[polygon + np.array([20.0, 0.0])])
    assert "what is stated may lie beside what it should cover" in found.attrs["note"]


def test_a_border_of_what_is_stated_is_not_told_as_something_else() -> None:
    stated, found = np.zeros((2, 60, 60), bool)
    stated[:, 20:30] = True
    found[10:40, 15:36] = True
    assert unstated_box(found | stated, stated, 3) == []
    found[10:20, 50:54] = True
    assert unstated_box(found | stated, stated, 3) == [50, 53, 10, 19]
    assert unstated_box(found, None, 3) == [15, 53, 10, 39]


@pytest.mark.parametrize(("width", "tone", "texture", "opaque", "motion"), crossed(RODS, ["fall", "drift"], 1, 4))
def test_what_nobody_stated_is_found_and_left_out(
    width: float, tone: float, texture: float, opaque: float, motion: str
) -> None:
    views = {"fall": FALL, "drift": DRIFT}[motion]
    film, _ = behind_a_rod(1.1 + width / 10.0, width, tone, texture, opaque, views, 50)
    points = grid((SIZE, SIZE), 34, 11)
    found = track(film, points, SUBSET)
    truth = np.stack([view.displacement(points, SIZE) for view in views])
    error = np.hypot(found.dx - truth[..., 0], found.dy - truth[..., 1]).values[1:]
    u, is_valid = np.hypot(found.u_dx, found.u_dy).values[1:], found.valid.values[1:]
    assert (error[is_valid] < 5.0 * u[is_valid]).all()
    assert is_valid.mean() > 0.9
    if opaque == 1.0:
        assert "something stands still before the specimen" in found.attrs["note"]
        is_part = is_valid & (found.hidden.values[1:] > 0.0)
        assert is_part.mean() > 0.05
        assert np.sqrt(np.mean(u[is_part] ** 2) / np.mean(error[is_part] ** 2)) == pytest.approx(1.0, abs=0.3)


def test_what_stands_before_a_slow_specimen_is_found() -> None:
    views = tuple(View((0.13 * k, -0.08 * k)) for k in range(7))  # 0.9 px
    film, _ = behind_a_rod(0.7, 12.0, 235.0, 0.0, 1.0, views, 70)
    points = grid((SIZE, SIZE), 34, 11)
    found = track(film, points, SUBSET)
    truth = np.stack([view.displacement(points, SIZE) for view in views])
    error = np.hypot(found.dx - truth[..., 0], found.dy - truth[..., 1]).values[1:]
    # not all of the rod: most of what tells it from the specimen comes with the last frames
    assert "something stands still before the specimen" in found.attrs["note"]
    assert (found.hidden.values > 0.0).mean() > 0.02
    across = np.abs((points - SIZE / 2) @ (np.cos(0.7), np.sin(0.7)))
    is_free = across > 6.0 + SUBSET  # of a rod of 12 px
    assert found.valid.values[:, is_free].all()
    assert (error[:, is_free] < 5.0 * np.hypot(found.u_dx, found.u_dy).values[1:, is_free]).all()


def test_what_holds_a_faint_pattern_back_is_found_by_those_that_move() -> None:
    pattern = 0.35 * film_scenes.random_field(SIZE, 2.5, 71)
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    share = 1.0 / (1.0 + np.exp(3.0 * (np.abs((x - SIZE / 2) * np.cos(0.5) + (y - SIZE / 2) * np.sin(0.5)) - 2.0)))
    views = [View((0.05 * k, 0.03 * k)) for k in range(8)]  # 0.4 px
    film = digitised([(1.0 - share) * from_spectrum(pattern, view) + 190.0 * share for view in views], 1.0, 72)
    points = grid((SIZE, SIZE), 34, 11)
    found = track(film, points, SUBSET)
    assert "something stands still before the specimen" in found.attrs["note"]
    truth = np.stack([view.displacement(points, SIZE) for view in views])
    error = np.hypot(found.dx - truth[..., 0], found.dy - truth[..., 1]).values[1:]
    assert found.valid.values.mean() > 0.98
    assert (error < 5.0 * np.hypot(found.u_dx, found.u_dy).values[1:]).all()  # up to 30 where it hid nothing


def test_what_holds_a_part_of_a_body_back_is_no_obstacle_where_the_body_bends() -> None:
    pattern = film_scenes.random_field(SIZE, 2.5, 73)
    y, x = np.mgrid[:SIZE, :SIZE].astype(float)
    bent = np.clip((x - 60.0) / 120.0, 0.0, 1.0) ** 2
    still = from_spectrum(pattern, View())
    frames = [map_coordinates(still, [y, x - 0.2 * k * bent], order=5, mode="grid-wrap") for k in range(8)]
    found = track(digitised(frames, 1.0, 74), grid((SIZE, SIZE), 34, 11), SUBSET)
    assert found.attrs["note"] == ""
    assert not found.hidden.values.any()


def test_nothing_is_hidden_where_nothing_stands_before_the_specimen() -> None:
    pattern = film_scenes.random_field(SIZE, 1.9, 60)
    film = digitised([from_spectrum(pattern, view) for view in FALL], 2.0, 61)
    found = track(film, grid((SIZE, SIZE), 34, 11), SUBSET)
    assert not found.hidden.values.any()
    assert found.attrs["note"] == ""


@pytest.mark.parametrize("defocus", [0.6, 1.1])
def test_light_that_slopes_across_a_subset_hides_nothing(defocus: float) -> None:
    pattern = film_scenes.random_field(SIZE, 3.0, 62)
    views = [View((0.5 * k, -0.3 * k), light=(0.9, 0.0016, -0.0012), defocus=defocus) for k in range(1, 6)]
    film = digitised([from_spectrum(pattern, view) for view in (View(defocus=0.6), *views)], 1.0, 63)
    found = track(film, grid((SIZE, SIZE), 34, 11), SUBSET)
    assert found.attrs["note"] == ""
    assert found.valid.values.all()


def test_a_subset_that_moves_wholly_behind_an_obstruction_is_found_again_beyond_it() -> None:
    film, polygon = behind_a_rod(0.0, 60.0, 20.0, 0.0, 1.0, tuple(View((8.0 * k, 0.3 * k)) for k in range(18)), 44)
    points = [(62.0, y) for y in (60.0, 90.0, 120.0, 150.0, 180.0)]
    found = track(film, points, 21, obstructions=[polygon])
    names = np.array(str(found.status.attrs["flag_meanings"]).split())[found.status.values]
    assert not found.valid.values[7].any()
    assert "covered" in names
    assert found.valid.values[[0, 1, 2, 16, 17]].all()
    assert np.abs(found.dx.values[-1] - 136.0).max() < 0.05


def test_brighter_places_are_noisier_without_a_misfit() -> None:
    rng = np.random.default_rng(1)
    grey, pixels = rng.uniform(20.0, 220.0, 60), np.full(60, 961.0)
    noise = (1.0 + 0.05 * grey) * rng.normal(1.0, 0.05, (40, 60))
    is_static = np.arange(40) == 0
    # a single static frame, in which fine texture passes for noise
    rest = (
        (noise[0] * rng.uniform(1.0, 9.0, 60), np.full(60, 12.0)),
        np.full(noise.shape, 1e5),
        np.zeros(noise.shape, bool),
    )
    assert (misfit_factor(noise, is_static, pixels, grey, *rest) == 1.0).mean() > 0.99
    noise[:, 7] *= 4.0  # one that misfits in every frame
    factor = misfit_factor(noise, is_static, pixels, grey, *rest)
    assert (factor[1:, 7] > 4.0).all()
    assert factor[0, 7] == 1.0
    assert (np.delete(factor, 7, axis=1) == 1.0).mean() > 0.99


def test_nothing_but_static_frames_has_no_misfit() -> None:
    noise = np.full((3, 2), 4.0)
    ones = np.ones((3, 2))
    rest = np.full(2, 441.0), np.full(2, 90.0), (noise[0], np.full(2, 2.0)), 1e5 * ones, ones < 0.0
    assert (misfit_factor(noise, np.ones(3, bool), *rest) == ones).all()
    noise[1:] = np.nan
    assert (misfit_factor(noise, np.arange(3) == 0, *rest) == ones).all()


def test_what_most_points_misfit_by_all_do_and_a_noise_that_grows_is_none() -> None:
    rng = np.random.default_rng(2)
    pixels, grey = np.full(50, 961.0), np.full(50, 90.0)
    noise = 4.0 * rng.normal(1.0, 0.03, (5, 50))
    is_static = np.arange(5) < 2
    rest = (noise[:2].mean(axis=0), np.ones(50)), np.full(noise.shape, 6e4), np.zeros(noise.shape, bool)
    assert (misfit_factor(1.8 * noise, is_static, pixels, grey, *rest) == 1.0).all()
    noise[2:, 20:] += 30.0  # of 50 points, 20 show no misfit
    factor = misfit_factor(noise, is_static, pixels, grey, *rest)
    shift = factor[2:] * np.sqrt(noise[2:] / 6e4)
    assert shift.min() > 0.7 * shift.max()

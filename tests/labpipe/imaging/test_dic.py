"""Image correlation on speckle films whose every pixel is known from a formula."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.frames import ArrayFrames
from labpipe.imaging import track
from tests.by_day import by_day, crossed
from tests.labpipe.imaging.speckle import Motion, cramer_rao_bound, digitise, grey_levels, grid, make_speckle, render

SIZE = (260, 280)
SHIFTS = tuple(Motion(0.1 * k, 0.05 * k) for k in range(11))
TURN = Motion(0.3, 0.4, np.deg2rad(2.0), (140, 130))


def make_film(kind: str, motions: tuple[Motion, ...], noise: float = 0.0, size: tuple[int, int] = SIZE) -> np.ndarray:
    speckle = make_speckle(kind, size)
    return np.stack([render(speckle, size, m, noise, seed) for seed, m in enumerate(motions)])


def error(found: xr.Dataset, motions: tuple[Motion, ...]) -> np.ndarray:
    points = np.stack([found.x, found.y], axis=1)
    truth = np.stack([motion.displacement(points) for motion in motions])
    return np.stack([found.dx, found.dy], axis=-1) - truth


def stays_inside(points: np.ndarray, motion: Motion, subset: int) -> np.ndarray:
    reach = (subset // 2) * (1 + abs(motion.angle)) + 1
    moved = motion.move(points)
    return ((moved >= reach) & (moved <= np.array(SIZE[::-1]) - 1 - reach)).all(axis=1)


class Recorder(ArrayFrames):
    """A film that remembers what was asked of it and may be damaged in places."""

    def __init__(self, images: np.ndarray, damaged: tuple[int, ...] = ()) -> None:
        super().__init__(images)
        self._damaged = damaged
        self.asked: list[int] = []

    @property
    def valid(self) -> np.ndarray:
        flags = np.ones(len(self), bool)
        flags[list(self._damaged)] = False
        return flags

    def __getitem__(self, index: int) -> np.ndarray:
        assert index not in self._damaged
        self.asked.append(index)
        return super().__getitem__(index)

    def roi(self, rows: slice, columns: slice) -> "Recorder":
        part = Recorder(self._images[:, rows, columns], self._damaged)
        part.asked = self.asked
        return part


@pytest.mark.parametrize(
    ("kind", "shape", "order", "limit"),
    [("medium", "rigid", 5, 0.0003), ("medium", "affine", 5, 0.0003), ("fine", "rigid", 5, 0.0015),
     ("medium", "rigid", 3, 0.0012)],
)  # fmt: skip
def test_bias_over_a_pixel_is_below_its_limit(kind: str, shape: str, order: int, limit: float) -> None:
    found = track(make_film(kind, SHIFTS), grid(SIZE, 22, 12) + np.array([0.5, -0.4]), shape=shape, order=order)
    assert found.valid.all()
    assert np.abs(error(found, SHIFTS).mean(axis=1)).max() <= limit


@pytest.mark.parametrize("subset", by_day([21, 31], 1))
@pytest.mark.parametrize("shape", ["rigid", "affine"])
def test_error_reaches_the_cramer_rao_bound_and_is_predicted(subset: int, shape: str) -> None:
    motions = SHIFTS[::2]
    speckle = make_speckle("medium", SIZE)
    greys = [grey_levels(speckle, SIZE, motion) for motion in motions]
    points = grid(SIZE, 22, 14)
    errors, predicted = [], []
    for seed in range(8):
        film = np.stack([digitise(g, 2.0, 100 * seed + k) for k, g in enumerate(greys)])
        found = track(film, points, subset, shape)
        assert found.valid.all()
        errors.append(error(found, motions)[1:])
        predicted.append(np.stack([found.u_dx, found.u_dy], axis=-1)[1:])
    scatter = np.sqrt(np.mean(np.square(errors)))
    bound = cramer_rao_bound(digitise(greys[0], 0.0, 0), points, subset, shape, 2.0)
    assert scatter <= 1.05 * np.sqrt(np.mean(bound**2))
    assert np.sqrt(np.mean(np.square(predicted))) == pytest.approx(scatter, rel=0.1)
    assert np.abs(np.mean(errors, axis=(0, 2))).max() < 0.0006


def test_one_large_rigid_subset_reaches_the_bound_and_tells_the_rotation() -> None:
    size = (216, 216)
    centre = np.array([(108.0, 108.0)])
    speckle = make_speckle("medium", size)
    still = grey_levels(speckle, size)
    motions = tuple(Motion(0.37 * k, -0.21 * k, 1e-3 * k, (108, 108)) for k in range(8))
    greys = [grey_levels(speckle, size, motion) for motion in motions]
    repeats = 25
    film = np.stack(
        [digitise(still, 2.0, k) for k in range(64)] + [digitise(greys[k % 8], 2.0, 64 + k) for k in range(8 * repeats)]
    )
    truth = (Motion(),) * 64 + motions * repeats
    found = track(film, centre, 201, "rigid", static_frames=64)
    assert found.valid.all()
    assert np.abs(found.dx[:64].mean("frame")).max() < 1e-12
    wrong = error(found, truth)[64:]
    bound = cramer_rao_bound(digitise(still, 0.0, 0), centre, 201, "rigid", 2.0, 64)
    assert np.sqrt((wrong**2).mean()) <= 1.05 * np.sqrt((bound**2).mean())
    angle = found.rotation.values[64:, 0] - np.array([m.angle for m in motions * repeats])
    assert np.sqrt((angle**2).mean()) == pytest.approx(float(found.u_rotation[64:].mean()), rel=0.1)


@pytest.mark.parametrize(
    ("kind", "shape", "motion"),
    crossed(
        [(kind, shape) for shape in ("rigid", "affine") for kind in ("fine", "medium", "coarse")],
        [Motion(0.3, 90.4), TURN, Motion(3.3, -2.6), Motion(-33.3, 20.2, np.deg2rad(5.0), (140, 130))],
        6,
        6,
    ),
)
def test_no_point_is_lost_in_a_jump_or_a_turn(kind: str, shape: str, motion: Motion) -> None:
    motions = (Motion(), motion, motion)
    points = grid(SIZE, 22, 12)
    points = points[stays_inside(points, motion, 21)]
    found = track(make_film(kind, motions, noise=2.0), points, 21, shape)
    assert found.valid.all()
    wrong = np.abs(error(found, motions)[1:])
    assert wrong.max() < 8 * max(float(found.u_dx.max()), float(found.u_dy.max()))
    assert np.abs(found.rotation[1:].mean() - motion.angle) < 0.001
    assert (found.zncc[1:] > 0.98).all()


def test_two_bodies_are_followed_each_on_its_own() -> None:
    left, right = make_speckle("medium", SIZE, 1), make_speckle("medium", SIZE, 2)
    frames = []
    for k in range(6):
        image = render(left, SIZE, Motion(0.0, 0.0), 2.0, k)
        image[:, 140:] = render(right, SIZE, Motion(0.0, 3.0 * k), 2.0, 50 + k)[:, 140:]
        frames.append(image)
    points = grid(SIZE, 40, 25)
    points = points[np.abs(points[:, 0] - 140) > 16]
    found = track(np.stack(frames), points, 31)
    expected = np.where(found.x > 140, 3.0, 0.0)[None, :] * np.arange(6)[:, None]
    assert found.valid.all()
    assert np.abs(found.dy.values - expected).max() < 0.05


def test_steady_motion_needs_two_evaluations_and_no_search() -> None:
    motions = tuple(Motion(0.4 * k, 0.5 * k) for k in range(12))
    found = track(make_film("medium", motions, 2.0), grid(SIZE, 40, 20))
    assert found.iterations[2:].mean() < 2.5
    assert json.loads(found.attrs["work"])["reseeds"] == 0


def reason(found: xr.Dataset, frame: int, point: int) -> str:
    code = int(found.status[frame, point])
    return str(found.status.attrs["flag_meanings"]).split()[code]


def test_points_at_and_over_the_border_are_flagged() -> None:
    film = make_film("medium", SHIFTS[:3], 2.0)
    points = [(15, 15), (14, 100), (-50, 20), (1e6, 1e6), (264, 100), (265, 100), (140, 130)]
    found = track(film, points, 31)
    assert found.valid[0].values.tolist() == [True, False, False, False, True, False, True]
    assert reason(found, 1, 1) == reason(found, 1, 3) == "outside"
    assert np.isnan(found.dx.values[:, [1, 2, 3, 5]]).all()
    assert np.isnan(found.u_dx.values[:, [1, 2, 3, 5]]).all()


def test_a_subset_that_leaves_the_frame_is_invalid_only_meanwhile() -> None:
    path = np.concatenate([np.linspace(0, 30, 11), np.linspace(30, 0, 11)])
    motions = tuple(Motion(0.0, -dy) for dy in path)
    film = make_film("medium", motions, 2.0)
    points = np.array([(60.0, 35.0), (120.0, 35.0), (120.0, 150.0)])
    for chosen in (points, points[:1]):
        found = track(film, chosen, 31)
        inside = 35 - path >= 15
        assert (found.valid[:, 0].values == inside).all()
        gone = int(np.flatnonzero(~inside)[0])
        assert np.isnan(found.dx[gone, 0])
        assert reason(found, gone, 0) == "outside"
        assert np.nanmax(np.abs(error(found, motions)[inside])) < 0.03


def test_saturated_flat_noisy_and_striped_subsets_have_no_value() -> None:
    film = make_film("medium", SHIFTS[:3], 2.0).astype(int)
    rng = np.random.default_rng(5)
    film[:, 20:80, 20:80] = 255
    film[:, 20:80, 100:160] = 120
    film[:, 20:80, 180:240] = 120 + rng.normal(0, 2, (3, 60, 60)).round()
    film[:, 120:180, 20:80] = (120 + 60 * np.sin(0.6 * np.arange(60))).round()
    points = [(50, 50), (130, 50), (210, 50), (50, 150), (150, 150)]
    found = track(np.clip(film, 0, 255).astype(np.uint8), points, 31)
    assert found.valid.values.tolist() == [[False, False, False, False, True]] * 3
    assert reason(found, 1, 0) == "saturated"
    assert {reason(found, 1, n) for n in (1, 2, 3)} == {"textureless"}


def test_damaged_frames_are_rows_of_nan_and_never_read() -> None:
    motions = tuple(Motion(0.3 * k, 0.5 * k) for k in range(10))
    film = Recorder(make_film("medium", motions, 2.0), damaged=(1, 4, 5))
    found = track(film, grid(SIZE, 40, 40), static_frames=2)
    assert np.isnan(found.dx.values[[1, 4, 5]]).all()
    assert reason(found, 4, 0) == "frame_damaged"
    good = [0, 2, 3, 6, 7, 8, 9]
    assert found.valid.values[good].all()
    assert np.abs(error(found, motions)[good]).max() < 0.03
    assert not set(film.asked) & {1, 4, 5}
    with_nan = make_film("medium", motions[:4]).astype(np.float32)
    with_nan[2, 100, 100] = np.nan
    assert track(with_nan, grid(SIZE, 40, 40)).valid.all("point").values.tolist() == [True, True, False, True]


def test_the_grey_scale_of_the_camera_does_not_matter() -> None:
    film = make_film("medium", SHIFTS[:4], 2.0)
    points = grid(SIZE, 40, 30)
    plain = track(film, points)
    for other in (film.astype(np.uint16) * 16, film.astype(np.float64) * 100.0 - 5000.0):
        found = track(other, points)
        assert np.abs(plain.dx - found.dx).max() < 1e-4
        assert np.abs(plain.u_dx - found.u_dx).max() < 1e-4


def test_the_correlation_is_that_of_the_pixels() -> None:
    film = make_film("medium", (Motion(), Motion()), noise=20.0)
    found = track(film, [(140, 130)], 31, blur=0.0)
    first, second = film[:, 115:146, 125:156].reshape(2, -1)
    assert float(found.zncc[1, 0]) == pytest.approx(np.corrcoef(first, second)[0, 1], abs=1e-3)


def test_changing_light_does_not_move_points() -> None:
    film = make_film("medium", SHIFTS[:4], 0.0)
    dimmed = np.rint(film * np.array([1.0, 0.7, 0.5, 0.9])[:, None, None] + 10).astype(np.uint8)
    found = track(dimmed, grid(SIZE, 22, 14))
    assert np.abs(error(found, SHIFTS[:4])).max() < 0.012
    assert found.valid.all()


def test_only_the_rectangle_around_the_points_is_read() -> None:
    motions = tuple(Motion(0.4 * k, 0.2 * k) for k in range(30))
    film = make_film("medium", motions, 2.0)
    few = track(film, [(60, 60)], 21)
    work = json.loads(few.attrs["work"])
    assert work["pixels_read"] < 0.5 * work["pixels_total"]
    many = track(film, [(60, 60), (230, 200), (30, 220)], 21)
    assert np.abs(few.dx[:, 0] - many.dx[:, 0]).max() < 1e-5


def test_only_selected_and_static_frames_are_read() -> None:
    motions = (Motion(),) * 4 + tuple(Motion(0.2 * k, 0.3 * k) for k in range(20))
    film = Recorder(make_film("medium", motions, 2.0))
    chosen = [8, 9, 10, 15, 20]
    part = track(film, grid(SIZE, 40, 40), static_frames=4, select=chosen)
    assert set(film.asked) == {0, 1, 2, 3, *chosen}
    assert part.frame.values.tolist() == chosen
    whole = track(film, grid(SIZE, 40, 40), static_frames=4)
    assert np.abs(part.dx - whole.dx.sel(frame=chosen)).max() < 2e-4
    sliced = track(film, grid(SIZE, 40, 40), static_frames=4, select=slice(8, 11))
    assert np.abs(sliced.dx - whole.dx.sel(frame=[8, 9, 10])).max() < 2e-4


def test_sizes_and_shapes_may_differ_by_point() -> None:
    film = make_film("medium", SHIFTS[:3], 2.0)
    points = [(140, 130), (60, 60), (200, 200)]
    mixed = track(film, points, [151, 21, 31], ["rigid", "affine", "rigid"])
    alone = track(film, points[1:2], 21, "affine")
    assert np.abs(mixed.dx[:, 1] - alone.dx[:, 0]).max() < 1e-4
    assert mixed.subset.values.tolist() == [151, 21, 31]


def test_a_result_is_the_same_again_says_its_units_and_survives_a_file(tmp_path: Path) -> None:
    film = make_film("medium", (Motion(), TURN, Motion(5.0, 40.0)), 2.0)
    found = track(film, grid(SIZE, 60, 60))
    xr.testing.assert_identical(found, track(film, grid(SIZE, 60, 60)))
    for name in found.variables:
        assert {"units", "long_name"} <= set(found[name].attrs), name
    found.to_netcdf(tmp_path / "found.nc")
    with xr.open_dataset(tmp_path / "found.nc") as again:
        np.testing.assert_array_equal(again.dx.values, found.dx.values)


def test_static_frames_that_move_are_reported() -> None:
    motions = tuple(Motion(0.2 * k, 0.0) for k in range(8))
    with pytest.warns(UserWarning, match=r"the 6 static frames move by 1\.0\d px"):
        track(make_film("medium", motions, 2.0), grid(SIZE, 60, 40), static_frames=6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"subset": 30}, "subset must be odd"),
        ({"subset": 5}, "at least 9"),
        ({"subset": [21, 21]}, "one per point"),
        ({"shape": "quadratic"}, '"auto", "rigid" or "affine"'),
        ({"order": 4}, "order must be 5"),
        ({"static_frames": 0}, "static_frames must be between 1"),
        ({"static_frames": 9}, "static_frames must be between 1"),
        ({"points": [(np.nan, 1.0)]}, "finite"),
        ({"points": [1.0, 2.0, 3.0]}, "shape"),
        ({"select": [3, 2]}, "increasing"),
        ({"select": [0.5]}, "whole frame numbers"),
        ({"select": []}, "one or more"),
        ({"blur": -1.0}, "blur"),
        ({"min_zncc": 1.0}, "min_zncc"),
    ],
)
def test_settings_out_of_range_are_refused(arguments: dict[str, object], message: str) -> None:
    film = np.zeros((8, 60, 60), np.uint8)
    with pytest.raises(InputError, match=message):
        track(film, **({"points": [(30, 30)], **arguments}))


def test_films_without_a_usable_reference_are_refused_and_black_ones_have_no_value() -> None:
    film = Recorder(make_film("medium", SHIFTS[:3]), damaged=(0, 1))
    with pytest.raises(InputError, match="first 2 frames are damaged"):
        track(film, [(100, 100)], static_frames=2)
    with pytest.raises(InputError, match="no frames"):
        track(np.zeros((0, 60, 60), np.uint8), [(30, 30)])
    black = track(np.zeros((3, 60, 60), np.uint8), [(30, 30)])
    assert not black.valid.any()
    assert black.sizes == {"frame": 3, "point": 1}

"""The compiled solver against its numpy and scipy twin, and against exact motions."""

import numpy as np
import pytest

from labpipe.imaging.spline import node_gradients, prefilter
from labpipe.imaging.subset_solver import (
    LEFT_WINDOW,
    NO_TEXTURE,
    NOT_CONVERGED,
    SOLVED,
    Solution,
    Subsets,
    cut_subsets,
    solve,
    solve_oracle,
)
from tests.labpipe.imaging.speckle import Motion, grid, make_speckle, render

SIZE = (120, 140)
WINDOW = (-0.5, 139.5, -0.5, 119.5)


def prepare(
    reference: np.ndarray, points: np.ndarray, half: int, is_rigid: bool, order: int
) -> Subsets:
    slopes = node_gradients(prefilter(reference, order), order)
    return cut_subsets(
        reference.astype(np.float32),
        *slopes,
        points.astype(np.int64),
        np.full(len(points), half),
        np.full(len(points), is_rigid),
    )


def match(subsets: Subsets, image: np.ndarray, order: int, start: np.ndarray) -> Solution:
    return solve(
        subsets,
        prefilter(image, order),
        order,
        np.arange(len(subsets)),
        start,
        origin=(0, 0),
        window=WINDOW,
    )


@pytest.mark.parametrize("order", [3, 5])
@pytest.mark.parametrize("is_rigid", [True, False])
@pytest.mark.parametrize("kind", ["fine", "medium"])
def test_compiled_solver_agrees_with_scipy_to_a_ten_thousandth(
    order: int, is_rigid: bool, kind: str
) -> None:
    speckle = make_speckle(kind, SIZE)
    motion = Motion(0.3, -0.4, 0.02, (70, 60))
    reference, image = render(speckle, SIZE), render(speckle, SIZE, motion, noise=2.0)
    points = np.array([(40.0, 40.0), (90.0, 70.0)])
    start = np.zeros((2, 6))
    start[:, [0, 3]] = motion.displacement(points).round()
    found = match(prepare(reference, points, 12, is_rigid, order), image, order, start)
    for n, point in enumerate(points.astype(int)):
        centre = (int(point[0]), int(point[1]))
        expected, zncc = solve_oracle(reference, image, centre, 12, is_rigid, order, start[n])
        assert np.abs(found.motion[n] - expected).max() < 1e-4
        assert found.zncc[n] == pytest.approx(zncc, abs=1e-5)


def test_rigid_and_affine_find_a_turn() -> None:
    speckle = make_speckle("medium", SIZE)
    motion = Motion(0.3, 0.4, np.deg2rad(2.0), (70, 60))
    points = grid(SIZE, 25, 20)
    start = np.zeros((len(points), 6))
    start[:, [0, 3]] = motion.displacement(points).round()
    for is_rigid in (True, False):
        subsets = prepare(render(speckle, SIZE), points, 12, is_rigid, 5)
        found = match(subsets, render(speckle, SIZE, motion), 5, start)
        assert (found.code == SOLVED).all()
        assert np.abs(found.motion[:, [0, 3]] - motion.displacement(points)).max() < 0.006
        assert np.abs(found.motion[:, 4] - np.sin(motion.angle)).max() < 0.001
        if is_rigid:
            assert found.motion[:, 4] == pytest.approx(-found.motion[:, 2])
            assert found.motion[:, 1] == pytest.approx(np.cos(np.arcsin(found.motion[:, 4])) - 1)


def test_gain_and_offset_of_the_light_change_nothing() -> None:
    speckle = make_speckle("medium", SIZE)
    points = grid(SIZE, 25, 20)
    subsets = prepare(render(speckle, SIZE), points, 10, False, 5)
    image = render(speckle, SIZE, Motion(0.4, 0.2)).astype(float)
    plain = match(subsets, image, 5, np.zeros((len(points), 6)))
    dimmed = match(subsets, 0.6 * image + 25.0, 5, np.zeros((len(points), 6)))
    assert np.abs(plain.motion - dimmed.motion).max() < 2e-5
    assert dimmed.gain == pytest.approx(plain.gain / 0.6, rel=1e-4)


def test_an_unmoved_image_is_found_in_one_evaluation() -> None:
    image = render(make_speckle("medium", SIZE), SIZE)
    points = grid(SIZE, 25, 20)
    found = match(prepare(image, points, 10, True, 5), image, 5, np.zeros((len(points), 6)))
    assert np.abs(found.motion).max() < 1e-5
    assert (found.iterations == 1).all()
    assert (found.zncc > 1 - 1e-6).all()


def test_codes_tell_what_went_wrong() -> None:
    image = render(make_speckle("medium", SIZE), SIZE)
    other = render(make_speckle("medium", SIZE, seed=9), SIZE)
    flat = np.full(SIZE, 100, np.uint8)
    point = np.array([(60.0, 60.0)])
    start = np.zeros((1, 6))
    assert match(prepare(flat, point, 10, True, 5), image, 5, start).code[0] == NO_TEXTURE
    far = np.array([[75.0, 0, 0, 0, 0, 0]])
    assert match(prepare(image, point, 10, True, 5), image, 5, far).code[0] == LEFT_WINDOW
    stranger = match(prepare(image, point, 10, True, 5), other, 5, start)
    assert stranger.code[0] == NOT_CONVERGED or stranger.zncc[0] < 0.6
    assert match(prepare(image, point, 10, True, 5), flat, 5, start).code[0] == NOT_CONVERGED


def test_an_edge_in_one_direction_determines_no_motion() -> None:
    x = np.arange(SIZE[1])
    stripes = np.broadcast_to(100 + 50 * np.sin(0.5 * x), SIZE)
    subsets = prepare(stripes, np.array([(60.0, 60.0)]), 10, True, 5)
    assert (subsets.inverse == 0).all()


def test_nan_in_the_frame_is_never_a_result() -> None:
    image = render(make_speckle("medium", SIZE), SIZE).astype(float)
    damaged = image.copy()
    damaged[60, 60] = np.nan
    found = match(
        prepare(image, np.array([(60.0, 60.0)]), 10, True, 5), damaged, 5, np.zeros((1, 6))
    )
    assert found.code[0] != SOLVED

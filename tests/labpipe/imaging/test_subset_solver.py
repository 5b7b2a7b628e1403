"""The compiled solver against its numpy and scipy twin, and against exact motions."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from labpipe.imaging.dic._kernels import AFFINE, RIGID, _gauss_newton_step, _sample_run
from labpipe.imaging.dic._solver import Solution, solve
from labpipe.imaging.dic._spline import node_gradients, prefilter
from labpipe.imaging.dic._subsets import Subsets, cut_subsets
from tests.labpipe.imaging.oracles import solve_oracle
from tests.labpipe.imaging.speckle import Motion, grid, make_speckle, render

SIZE = (120, 140)
WINDOW = (-0.5, 139.5, -0.5, 119.5)


def prepare(reference: np.ndarray, points: np.ndarray, half: int, is_rigid: bool, order: int) -> Subsets:
    slopes = node_gradients(prefilter(reference, order), order)
    return cut_subsets(
        reference.astype(np.float32),
        *slopes,
        points.astype(np.int64),
        np.full(len(points), half),
        np.full(len(points), RIGID if is_rigid else AFFINE, np.int8),
    )


def match(subsets: Subsets, image: np.ndarray, order: int, start: np.ndarray) -> Solution:
    return solve(subsets, prefilter(image, order), order, np.arange(len(subsets)), start, origin=(0, 0), window=WINDOW)


@pytest.mark.parametrize(("order", "is_rigid", "kind"), [(3, True, "medium"), (5, True, "fine"), (5, False, "medium")])
def test_compiled_solver_agrees_with_scipy_to_a_tenth_of_the_noise(order: int, is_rigid: bool, kind: str) -> None:
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
        assert np.abs(found.motion[n] - expected).max() < 0.1 * np.sqrt(found.covariance[n, :2].min())
        assert found.zncc[n] == pytest.approx(zncc, abs=1e-5)


def test_gain_and_offset_of_the_light_change_nothing() -> None:
    speckle = make_speckle("medium", SIZE)
    points = grid(SIZE, 25, 20)
    subsets = prepare(render(speckle, SIZE), points, 10, False, 5)
    image = render(speckle, SIZE, Motion(0.4, 0.2)).astype(float)
    plain = match(subsets, image, 5, np.zeros((len(points), 6)))
    dimmed = match(subsets, 0.6 * image + 25.0, 5, np.zeros((len(points), 6)))
    assert np.abs(plain.motion - dimmed.motion).max() < 2e-5
    assert dimmed.quality[:, 0] == pytest.approx(plain.quality[:, 0] / 0.6, rel=1e-4)


def test_normal_equations_are_those_of_slopes_without_mean_and_texture() -> None:
    """JᵀJ of the slopes of the six motions, light and contrast projected out, by least squares."""
    image = render(make_speckle("medium", SIZE), SIZE)
    x, y, half = 60, 50, 7
    subsets = prepare(image, np.array([(x, y)]), half, False, 5)
    cut = np.s_[y - half : y + half + 1, x - half : x + half + 1]
    slope_x, slope_y = (s[cut].ravel() for s in node_gradients(prefilter(image, 5), 5))
    dy, dx = (d.ravel() for d in np.mgrid[-half : half + 1, -half : half + 1])
    J = np.stack([slope_x, slope_x * dx, slope_x * dy, slope_y, slope_y * dx, slope_y * dy], 1)
    known = np.column_stack([np.ones(dx.size), image[cut].ravel().astype(float)])
    left = J - known @ np.linalg.lstsq(known, J, rcond=None)[0]
    normal = left.T @ left
    scale = np.sqrt(np.outer(np.diag(normal), np.diag(normal)))
    assert np.abs((subsets.normal[0, :6, :6] - normal) / scale).max() < 1e-5
    identity = subsets.inverse[0] @ normal
    assert np.abs(identity * scale / np.diag(normal)[:, None] - np.eye(6)).max() < 1e-3


def test_step_gain_and_residual_are_those_of_least_squares() -> None:
    """A frame that is a little off: gain, offset and step together leave the least squares."""
    random = np.random.default_rng(7)
    n, J = 81, np.random.default_rng(8).standard_normal((81, 6))
    texture = random.standard_normal(n)
    texture -= texture.mean()
    frame = 0.8 * (texture + 0.2 * J @ random.standard_normal(6)) + 5.0
    frame += 0.05 * random.standard_normal(n)
    known = np.column_stack([np.ones(n), texture])
    free = J - known @ np.linalg.lstsq(known, J, rcond=None)[0]
    energy, normal = float(texture @ texture), free.T @ free
    gain = energy / float(frame @ texture)
    right = gain * (frame - frame.mean()) - texture
    expected, squares, *_ = np.linalg.lstsq(free, right, rcond=None)
    sums = np.concatenate([[frame.sum(), frame @ frame, frame @ texture], frame @ J])
    moments = np.stack([J.sum(axis=0), texture @ J])
    step, quality = np.zeros(6), np.zeros(4)
    inverse = np.linalg.inv(normal)
    fall = _gauss_newton_step(sums, np.array([0.0, energy, n]), moments, inverse, step, quality)
    assert fall == pytest.approx(right @ right - squares[0])
    np.testing.assert_allclose(step, expected, rtol=1e-9)
    np.testing.assert_allclose(quality[:2], [gain, squares[0]], rtol=1e-9)
    assert quality[2] == pytest.approx(np.sqrt(energy / (energy + squares[0])))


@pytest.mark.parametrize("fx", [0.02, 0.93])
@pytest.mark.parametrize("fy", [0.04, 0.98])
@pytest.mark.parametrize("order", [3, 5])
def test_samples_are_sums_of_splines(order: int, fx: float, fy: float) -> None:
    """Every coefficient has its weight, the corners too: the product of B-splines by scipy."""
    random, lanes = np.random.default_rng(order), 4
    coefficients = random.uniform(10.0, 200.0, (8, 14)).astype(np.float32)
    spline = BSpline.basis_element(np.arange(order + 2.0))
    dx, dy = 0.02, -0.01
    out = np.zeros(lanes, np.float32)
    place = (np.float32(v) for v in (fx, fy, dx, dy))
    first = (5 - order) // 2
    _sample_run(coefficients, order, 1 - first, 2 - first, *place, np.uint64(lanes), out)
    for k in range(lanes):
        a, b = (spline(np.arange(order, -1, -1) + f + d * k) for f, d in ((fx, dx), (fy, dy)))
        exact = b @ coefficients[1 : order + 2, 2 + k : order + 3 + k].astype(float) @ a
        assert out[k] == pytest.approx(exact, rel=2e-6)

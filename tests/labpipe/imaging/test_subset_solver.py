"""The compiled solver against its numpy and scipy twin, and against exact motions."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from labpipe.imaging.dic._kernels import AFFINE, RIGID, _sample_run
from labpipe.imaging.dic._solver import Solution, solve
from labpipe.imaging.dic._spline import node_gradients, prefilter
from labpipe.imaging.dic._subsets import Subsets, cut_subsets
from tests.labpipe.imaging.oracles import solve_oracle
from tests.labpipe.imaging.speckle import Motion, make_speckle, render

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


@pytest.mark.parametrize(("order", "fx", "fy"), [(3, 0.02, 0.98), (5, 0.93, 0.04), (5, 0.02, 0.04)])
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

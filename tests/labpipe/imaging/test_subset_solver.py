"""The compiled solver against its numpy and scipy twin, and against exact motions."""

import numpy as np
import pytest

from labpipe.imaging.dic._kernels import AFFINE, RIGID
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

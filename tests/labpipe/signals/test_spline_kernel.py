"""The compiled loops against dense linear algebra and SciPy's B-splines."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from labpipe.signals._spline_kernel import DEGREE, expanded, followed, normal_equations, solved
from tests.rounding import rounding


@pytest.mark.parametrize("n", [1, 6, 7, 101])
def test_solution_and_inverse_in_the_band_equal_the_dense_ones(n):
    random, dense = np.random.default_rng(n), np.zeros((n, n))
    band = np.zeros((n + DEGREE, DEGREE + 1))
    for d in range(min(DEGREE, n - 1) + 1):
        band[: n - d, d] = random.standard_normal(n - d) if d else 4 * DEGREE + 1 + random.random(n)
        dense += np.diag(band[: n - d, d], -d) + (np.diag(band[: n - d, d], d) if d else 0.0)
    right, exact = random.standard_normal(n), np.linalg.inv(dense)
    found, inverse, negative = np.append(right, np.full(DEGREE, np.nan)), np.full(band.shape, np.nan), -band
    solved(band, found, inverse)
    np.testing.assert_allclose(found[:n], exact @ right, atol=rounding(10 * n, 1.0))
    for d in range(min(DEGREE, n - 1) + 1):
        np.testing.assert_allclose(inverse[: n - d, d], np.diag(exact, -d), atol=rounding(10 * n, np.abs(exact).max()))
    solved(negative, found, inverse)
    assert np.isnan(found[:n]).any()


def test_normal_equations_and_derivatives_are_those_of_scipys_splines():
    random = np.random.default_rng(0)
    breaks = np.cumsum(random.uniform(0.5, 3.0, 12))
    knots, first = np.pad(breaks, DEGREE, mode="edge"), np.arange(len(breaks) - 1)
    basis, count = expanded(knots, first), len(knots) - DEGREE - 1
    x, z, coefficients = np.sort(random.uniform(breaks[0], breaks[-1], 300)), *random.standard_normal((2, 300))
    band = np.zeros((count, DEGREE + 1))
    band[:, 0] = 4.0  # variances of coefficients that are not correlated
    value, u = followed(breaks, basis, first, coefficients[:count], band, x, 3)
    for order in range(4):
        each = BSpline(knots, np.eye(count), DEGREE)(x, order)
        np.testing.assert_allclose(value[order], each @ coefficients[:count], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(u[order], 2.0 * np.linalg.norm(each, axis=1), rtol=1e-9)
    normal, rough, right = normal_equations(x, z, breaks, basis, first)
    design = BSpline(knots, np.eye(count), DEGREE)(x)
    np.testing.assert_allclose(right[:count], design.T @ z, atol=1e-9)
    assert np.sum([np.trace(each) for each in normal]) == pytest.approx(np.sum(design**2), rel=1e-9)
    spline, length = BSpline(knots, coefficients[:count], DEGREE), np.diff(breaks)
    bend, tilt = (spline(0.5 * (breaks[1:] + breaks[:-1]), order) for order in (4, 5))
    found = [np.sum((part @ coefficients[s : s + DEGREE + 1]) ** 2) for s, part in enumerate(rough)]
    np.testing.assert_allclose(found, length * (bend**2 + (length * tilt) ** 2 / 12.0), rtol=1e-9)

"""The compiled band solver against dense linear algebra."""

import numpy as np
import pytest

from labpipe.signals._spline_kernel import DEGREE, solved
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

"""The compiled band solver against dense linear algebra."""

import numpy as np
import pytest

from labpipe.signals._spline_kernel import DEGREE as WIDTH, factored, inverse_of_factor, solve
from tests.rounding import rounding


@pytest.mark.parametrize("n", [1, 5, 6, 7, 12, 31, 101])
def test_solution_and_inverse_in_the_band_equal_the_dense_ones(n):
    random, dense = np.random.default_rng(n), np.zeros((n, n))
    band = np.zeros((n + WIDTH, WIDTH + 1))
    for d in range(min(WIDTH, n - 1) + 1):
        band[: n - d, d] = random.standard_normal(n - d) if d else 4 * WIDTH + 1 + random.random(n)
        dense += np.diag(band[: n - d, d], -d) + (np.diag(band[: n - d, d], d) if d else 0.0)
    right, exact, inverse = random.standard_normal(n), np.linalg.inv(dense), np.full(band.shape, np.nan)
    assert factored(band, n)
    found = np.append(right, np.full(WIDTH, np.nan))
    solve(band, found, n)
    np.testing.assert_allclose(found[:n], exact @ right, atol=rounding(10 * n, 1.0))
    inverse_of_factor(band, inverse, n)
    for d in range(min(WIDTH, n - 1) + 1):
        np.testing.assert_allclose(inverse[: n - d, d], np.diag(exact, -d), atol=rounding(10 * n, np.abs(exact).max()))
    band[0, 0] = -1.0
    assert not factored(band, n)

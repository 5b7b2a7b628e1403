import numpy as np
import pytest

from labpipe.signals._spline_kernel import DEGREE as WIDTH, inverse_of_factor
from tests.rounding import rounding


@pytest.mark.parametrize("n", [1, 2, 6, 7, 12, 31, 101])
def test_entries_in_the_band_equal_the_dense_inverse(n):
    random = np.random.default_rng(0)
    dense = np.diag(4 * WIDTH + 1 + random.random(n))
    for d in range(1, min(WIDTH, n - 1) + 1):
        side = np.diag(random.standard_normal(n - d), -d)
        dense += side + side.T
    root = np.linalg.cholesky(dense)
    factor, found = np.zeros((2, n + WIDTH, WIDTH + 1))
    factor[:n, 0] = np.diag(root) ** -2.0
    for d in range(1, min(WIDTH, n - 1) + 1):
        factor[: n - d, d] = np.diag(root / np.diag(root), -d)
    inverse_of_factor(factor, found, n)
    inverse = np.linalg.inv(dense)
    for d in range(min(WIDTH, n - 1) + 1):
        np.testing.assert_allclose(
            found[: n - d, d], np.diag(inverse, -d), atol=rounding(10 * n, np.abs(inverse).max())
        )

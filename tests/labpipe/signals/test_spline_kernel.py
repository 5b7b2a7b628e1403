import numpy as np
import pytest

from labpipe.signals._spline_kernel import DEGREE as WIDTH, factored, inverse_of_factor, solve
from tests.rounding import rounding


def random_band(n, seed=0):
    random = np.random.default_rng(seed)
    band = np.zeros((n + WIDTH, WIDTH + 1))
    band[:n, 0] = 4 * WIDTH + 1 + random.random(n)
    dense = np.diag(band[:n, 0])
    for d in range(1, min(WIDTH, n - 1) + 1):
        band[: n - d, d] = random.standard_normal(n - d)
        dense += np.diag(band[: n - d, d], -d) + np.diag(band[: n - d, d], d)
    return band, dense


def selected_inverse(band):
    factor, n = band.copy(), len(band) - WIDTH
    assert factored(factor, n)
    inverse = np.full(band.shape, np.nan)
    inverse_of_factor(factor, inverse, n)
    return inverse


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 10, 11, 12, 30, 31, 64, 101])
def test_entries_in_the_band_equal_the_dense_inverse(n):
    band, dense = random_band(n)
    inverse = np.linalg.inv(dense)
    found = selected_inverse(band)
    left = rounding(10 * n, np.abs(inverse).max())
    for d in range(min(WIDTH, n - 1) + 1):
        np.testing.assert_allclose(found[: n - d, d], np.diag(inverse, -d), atol=left)


@pytest.mark.parametrize("n", [1, 3, 40])
def test_solution_equals_the_dense_one(n):
    band, dense = random_band(n)
    right = np.random.default_rng(1).standard_normal(n)
    assert factored(band, n)
    found = np.append(right, np.full(WIDTH, np.nan))
    solve(band, found, n)
    np.testing.assert_allclose(found[:n], np.linalg.solve(dense, right), atol=rounding(10 * n, 1.0))


def test_a_matrix_that_is_not_positive_definite_is_told():
    band, _ = random_band(12)
    band[7, 0] = -1.0
    assert not factored(band, 12)

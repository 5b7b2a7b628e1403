import numpy as np
import pytest

from labpipe.signals._banded import cholesky, inverse_of_factor, solve
from tests.rounding import rounding


def random_band(n, width, seed=0):
    random = np.random.default_rng(seed)
    band = np.zeros((width + 1, n))
    band[0] = 4 * width + 1 + random.random(n)
    dense = np.diag(band[0])
    for d in range(1, min(width, n - 1) + 1):
        band[d, : n - d] = random.standard_normal(n - d)
        dense += np.diag(band[d, : n - d], -d) + np.diag(band[d, : n - d], d)
    return band, dense


def selected_inverse(band):
    factor = band.copy()
    assert cholesky(factor)
    inverse = np.full(band.shape, np.nan)
    inverse_of_factor(factor, inverse)
    return inverse


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 10, 11, 12, 30, 31, 64, 101])
@pytest.mark.parametrize("width", [0, 1, 5])
def test_entries_in_the_band_equal_the_dense_inverse(n, width):
    band, dense = random_band(n, width)
    inverse = np.linalg.inv(dense)
    found = selected_inverse(band)
    left = rounding(10 * n, np.abs(inverse).max())
    for d in range(min(width, n - 1) + 1):
        np.testing.assert_allclose(found[d, : n - d], np.diag(inverse, -d), atol=left)


@pytest.mark.parametrize(("n", "width"), [(1, 0), (3, 5), (40, 5)])
def test_solution_equals_the_dense_one(n, width):
    band, dense = random_band(n, width)
    right = np.random.default_rng(1).standard_normal(n)
    assert cholesky(band)
    found = np.empty(n)
    solve(band, right, found)
    np.testing.assert_allclose(found, np.linalg.solve(dense, right), atol=rounding(10 * n, 1.0))


def test_a_matrix_that_is_not_positive_definite_is_told():
    band, _ = random_band(12, 5)
    band[0, 7] = -1.0
    assert not cholesky(band)


@pytest.mark.parametrize(("n", "width"), [(1, 5), (3, 5), (7, 5), (4, 1)])
def test_what_stands_beyond_the_ends_of_the_diagonals_means_nothing(n, width):
    band, _ = random_band(n, width)
    spoilt = band.copy()
    for d in range(1, width + 1):
        spoilt[d, max(n - d, 0) :] = 7.0
    found = selected_inverse(spoilt)
    np.testing.assert_array_equal(found, selected_inverse(band))
    for d in range(1, width + 1):
        assert not found[d, max(n - d, 0) :].any()

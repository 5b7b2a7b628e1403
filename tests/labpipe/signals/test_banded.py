import numpy as np
import pytest

from labpipe.signals._banded import quadratic_form, selected_inverse
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


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 10, 11, 12, 30, 31, 64, 101])
@pytest.mark.parametrize("width", [0, 1, 5])
def test_entries_in_the_band_equal_the_dense_inverse(n, width):
    band, dense = random_band(n, width)
    inverse = np.linalg.inv(dense)
    found = selected_inverse(band)
    left = rounding(10 * n, np.abs(inverse).max())
    for d in range(min(width, n - 1) + 1):
        np.testing.assert_allclose(found[d, : n - d], np.diag(inverse, -d), atol=left)


def test_quadratic_form_of_narrow_rows():
    band, dense = random_band(40, 5)
    random = np.random.default_rng(1)
    first = random.integers(0, 34, 20)
    rows = random.standard_normal((20, 6))
    full = np.zeros((20, 40))
    for i, start in enumerate(first):
        full[i, start : start + 6] = rows[i]
    expected = np.einsum("ij,jk,ik->i", full, np.linalg.inv(dense), full)
    np.testing.assert_allclose(quadratic_form(first, rows, selected_inverse(band)), expected)


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

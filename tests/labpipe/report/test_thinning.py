"""Thinning keeps extremes, gaps, and every sample of the named windows."""

import numpy as np
from hypothesis import given, strategies as st

from labpipe.report._thinning import kept_samples


@given(st.integers(0, 2**32 - 1), st.integers(50, 400))
def test_extremes_survive_and_the_limit_holds(seed, limit):
    rng = np.random.default_rng(seed)
    n = 5000
    curves = [rng.normal(size=n), rng.normal(size=n)]
    curves[0][rng.integers(n)] = 50.0
    curves[1][rng.integers(n)] = -50.0
    kept = kept_samples(np.arange(float(n)), curves, limit)
    assert kept.size <= limit + 2
    assert (np.diff(kept) > 0).all()
    assert {0, n - 1} <= set(kept.tolist())
    for curve in curves:
        assert curve[kept].max() == curve.max()
        assert curve[kept].min() == curve.min()
    curves[0][n // 3] = np.nan  # a gap of one sample stays a gap
    assert np.isnan(curves[0][kept_samples(np.arange(float(n)), curves, limit)]).sum() == 1


def test_all_samples_of_the_windows_are_kept_the_narrowest_first():
    x = np.arange(1_000_000) / 50_000
    windows = [(0.0, 20.0), (3.0, 3.001), (7.0, 7.01)]
    kept = kept_samples(x, [np.sin(x)], 5000, windows)
    for start, stop in windows[1:]:
        inside = np.flatnonzero((x >= start) & (x <= stop))
        assert np.isin(inside, kept).all()
    assert kept.size <= 5002
    # A quarter of the samples still describes the rest.
    assert np.count_nonzero((x[kept] < 3.0) | (x[kept] > 7.01)) > 500

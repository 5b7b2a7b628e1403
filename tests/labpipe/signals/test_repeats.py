"""Repeats on a common time: alignment, band, outliers, and what is refused."""

import numpy as np
import pytest
import xarray as xr

from labpipe.errors import InputError
from labpipe.signals.repeats import combine_repeats


def record(start: float, offset: float = 0.0, length: int = 400) -> xr.DataArray:
    time = np.arange(length) * 1e-3
    values = np.sin(20 * (time - start)) + offset
    attrs = {"units": "m", "long_name": "height"}
    return xr.DataArray(values, dims="time", coords={"time": time}, attrs=attrs, name="x")


def test_repeats_are_aligned_at_their_starts() -> None:
    starts = [0.0503, 0.0811, 0.1207]
    made = combine_repeats([record(s) for s in starts], starts)
    shared = made["x"].dropna("time")
    np.testing.assert_allclose(shared, np.broadcast_to(np.sin(20 * shared["time"]), shared.shape),
                               atol=6e-5)  # fmt: skip
    assert float(made["time"][np.argmin(np.abs(made["time"].values))]) == 0.0


def test_mean_and_band_are_those_of_the_repeats() -> None:
    made = combine_repeats([record(0.1, o) for o in (-1.0, 0.0, 1.0)], [0.1] * 3)
    np.testing.assert_allclose(made["x_sd"], 1.0, atol=1e-12)
    np.testing.assert_allclose(made["x_mean"], made["x"].sel(repeat=2), atol=1e-12)
    assert set(made["n"].values) == {3.0}


def test_where_a_repeat_is_missing_the_others_count() -> None:
    made = combine_repeats([record(0.1), record(0.1, length=200)], [0.1, 0.1])
    assert made["n"].values.max() == 2
    assert made["n"].values.min() == 1
    assert np.isnan(made["x_sd"].values[-1])
    assert np.isfinite(made["x_mean"].values).all()


def test_an_outlier_is_flagged_and_kept() -> None:
    offsets = [0.001, -0.001, 0.0005, 0.3, -0.0004]
    made = combine_repeats([record(0.1, o) for o in offsets], [0.1] * 5)
    assert list(made["is_outlier"].values) == [False, False, False, True, False]
    assert float(made["x_mean"].mean() - made["x"].sel(repeat=1).mean()) > 0.05  # not dropped


def test_ordinary_scatter_is_no_outlier() -> None:
    generator = np.random.default_rng(0)
    flagged = sum(
        combine_repeats([record(0.1, o) for o in generator.normal(0, 1e-3, 5)], [0.1] * 5)[
            "is_outlier"
        ].values.any()
        for _ in range(40)
    )
    assert flagged <= 6


def test_identical_repeats_are_no_outliers() -> None:
    made = combine_repeats([record(0.1)] * 5, [0.1] * 5)
    assert not made["is_outlier"].values.any()


def test_inputs_stay_as_they_are() -> None:
    one = record(0.1)
    before = one.copy(deep=True)
    combine_repeats([one, one], [0.1, 0.2])
    xr.testing.assert_identical(one, before)


def test_what_does_not_belong_together_is_refused() -> None:
    with pytest.raises(InputError, match="0 records"):
        combine_repeats([], [])
    with pytest.raises(InputError, match="one quantity"):
        combine_repeats([record(0.1), record(0.1).rename("y")], [0.1, 0.1])
    with pytest.raises(InputError, match="no start"):
        combine_repeats([record(0.1), record(0.1)], [0.1, np.nan])

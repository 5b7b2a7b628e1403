"""The charts of a ball drop: bands, repeats, and windows that show one impact."""

import numpy as np
import pytest
import xarray as xr

from labpipe.report import Band, Series
from pipelines.experiments.ball_drop.page import impact_views, motion


def repeats(count: int) -> xr.Dataset:
    time = np.linspace(-0.01, 0.09, 201)
    position = np.abs(np.sin(60 * time)) * 1e-3
    each = np.stack([position + 1e-6 * i for i in range(count)])
    return xr.Dataset(
        {
            "displacement": (("repeat", "time"), each),
            "displacement_mean": ("time", each.mean(axis=0)),
            "displacement_sd": ("time", each.std(axis=0)),
            "velocity": (("repeat", "time"), each * 60),
            "velocity_mean": ("time", each.mean(axis=0) * 60),
            "velocity_sd": ("time", each.std(axis=0) * 60),
            "is_outlier": ("repeat", np.arange(count) == 2),
            "touch_time": ("impact", [0.0, 0.05, np.nan, 0.08]),
            "contact_duration": ("impact", [0.002, np.nan, 0.002, 0.002]),
        },
        coords={"repeat": np.arange(1, count + 1), "time": time, "impact": np.arange(1, 5)},
    )


def test_a_view_is_a_little_longer_than_its_contact_and_never_that_of_a_missing_touch() -> None:
    views = impact_views(repeats(3))
    assert [name for name, _, _ in views] == ["impact 1", "impact 2"]
    assert views[0][1:] == pytest.approx((-0.6, 2.6))  # ms
    assert views[1][1:] == pytest.approx((49.7, 51.3))  # 1 ms where no duration was found


def test_each_repeat_shows_on_hover_behind_a_band_of_all_and_an_outlier_is_named() -> None:
    chart = motion(repeats(3), None, None).blocks[0]
    band, *single, mean = chart.series
    assert isinstance(band, Band)
    assert [s.name for s in single] == ["repeat 1", "repeat 2", "repeat 3 (outlier)"]
    assert all(isinstance(s, Series) and s.on_hover for s in single)
    assert not mean.on_hover
    spread = 2 * repeats(3)["displacement_sd"].values * 1e3
    assert np.allclose(band.curves[1] - mean.y, spread)
    assert "point at the chart" in chart.caption

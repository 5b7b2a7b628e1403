"""Windows of a ball drop's charts show one impact each."""

import numpy as np
import pytest
import xarray as xr

from pipelines.experiments.ball_drop.page import _apart, impact_views


def test_a_view_is_a_little_longer_than_its_contact_and_never_that_of_a_missing_touch() -> None:
    touched, lasted = [0.0, 0.05, np.nan, 0.08], [0.002, np.nan, 0.002, 0.002]
    repeats = xr.Dataset(
        {"touch_time": ("impact", touched), "contact_duration": ("impact", lasted)},
        coords={"time": np.linspace(-0.01, 0.09, 201), "impact": np.arange(1, 5)},
    )
    views = impact_views(repeats)
    assert [name for name, _, _ in views] == ["impact 1", "impact 2"]
    assert views[0][1:] == pytest.approx((-0.6, 2.6))  # ms
    assert views[1][1:] == pytest.approx((49.7, 51.3))  # 1 ms where no duration was found


def test_an_outlier_says_in_which_quantity() -> None:
    fell = [xr.Dataset({"drop_height": h, "restitution": ("impact", [0.9])}) for h in (1.5e-3, 4.996e-3, 1.5e-3)]
    assert _apart(fell, 1) == "outlier: fall 4.996 mm, others 1.500 mm"

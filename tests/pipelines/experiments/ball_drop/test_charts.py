"""Windows of a ball drop's charts show one impact each."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from pipelines.experiments.ball_drop.page import _tables
from pipelines.experiments.shared.pages import impact_views


def test_a_view_is_a_little_longer_than_its_contact_and_never_that_of_a_missing_touch() -> None:
    views = impact_views(np.array([0.0, 0.05, np.nan, 0.08]), np.array([0.002, np.nan, 0.002, 0.002]))
    assert [name for name, _, _ in views] == ["impact 1", "impact 2"]
    assert views[0][1:] == pytest.approx((-0.6e-3, 2.6e-3))
    assert views[1][1:] == pytest.approx((49.7e-3, 51.3e-3))  # 1 ms where no duration was found


def test_an_outlier_says_in_which_quantity() -> None:
    times = ("release_time", "first_contact_time", "settling_time", "rest_time", "u_rest_time")
    known = {name: ((), 0.1, {"units": "s"}) for name in times} | {"restitution": ("impact", [0.9])}
    fell = [xr.Dataset(known | {"drop_height": ((), h, {"units": "m"})}) for h in (1.5e-3, 4.996e-3, 1.5e-3)]
    repeats = xr.Dataset({"is_outlier": ("repeat", [False, True, False]), "impact": [1], "n_repeats": ("impact", [3])})
    shown = repr(list(_tables(SimpleNamespace(laser=["a", "b", "c"]), fell, repeats)))
    assert shown.count("outlier: ") == shown.count("outlier: fall 4.996 mm, others 1.500 mm") == 1

"""How far a drop on a vibrating plate is compared with its model."""

import json

import numpy as np
import pytest
import xarray as xr

from pipelines.experiments.ball_drop.comparison import foreseen


@pytest.mark.parametrize(
    ("u", "plate", "count"),
    [
        ((0.0, 2.0e-4, 3.4e-4), {"frequency": 180.0}, 2),  # 0.23 and 0.38 rad of the plate
        ((0.0, 2.5e-4, 6.3e-4), None, 20),  # a floor at rest returns the same whenever it is touched
        ((0.0, 2.5e-3, 6.3e-4), None, 1),  # 6 % of the flight before
    ],
)
def test_impacts_are_compared_while_their_times_are_known(u, plate, count):
    times, later = 0.04 * np.arange(1, 21), np.zeros(17)
    made = xr.Dataset(
        {"impact_time": ("impact", times), "u_impact_time": ("impact", np.concatenate([u, later]))},
        attrs={"plate": json.dumps(plate)},
    )
    assert foreseen(made) == count

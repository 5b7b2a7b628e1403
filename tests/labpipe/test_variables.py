"""Variables with their units, names and uncertainties."""

import numpy as np
import xarray as xr

from labpipe.variables import from_rows, with_u


def test_an_uncertainty_says_of_what_and_from_what_it_is() -> None:
    made = xr.Dataset(with_u("work", (), 2.0, 0.5, "J", "work per cycle", "from first touch"))
    assert float(made["u_work"]) == 0.5
    assert made["u_work"].attrs == {"units": "J", "long_name": "standard uncertainty from first touch: work per cycle"}
    assert made["work"].attrs["long_name"] == "work per cycle"


def test_rows_become_columns_and_bring_the_uncertainties_that_they_hold() -> None:
    rows = [{"force": 1.0, "u_force": 0.1, "speed": 3.0, "other": 7.0}, {"force": 2.0, "u_force": 0.2, "speed": 4.0}]
    made = xr.Dataset(from_rows("ramp", rows, {"force": ("N", "largest force"), "speed": ("m/s", "speed")}))
    assert set(made.variables) == {"force", "u_force", "speed"}
    np.testing.assert_array_equal(made["u_force"].values, [0.1, 0.2])
    assert made["speed"].dims == ("ramp",)
    assert xr.Dataset(from_rows("ramp", [], {"force": ("N", "largest force")}))["force"].shape == (0,)

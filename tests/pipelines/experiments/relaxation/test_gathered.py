"""Tests of other lengths are gathered in one table."""

import json

import numpy as np
import xarray as xr

from pipelines.experiments.relaxation.measured import tests as gathered
from pipelines.experiments.relaxation.settings import Relaxation


def _compared(effects: list[str]) -> xr.Dataset:
    over = {name: ("uncertain", np.ones(len(effects))) for name in ("input_value", "input_u")}
    units = {"input_unit": ("uncertain", np.array(["1"] * len(effects)))}
    slopes = {"slope_plateau_force": (("ramp", "uncertain"), np.ones((1, len(effects))), {"units": "1"})}
    return xr.Dataset(over | units | slopes, {"uncertain": np.array(effects)})


def test_a_shorter_hold_depends_on_fewer_modes_and_not_at_all_on_the_others() -> None:
    ramps = [xr.Dataset({"depth": ("ramp", [depth], {"units": "m"})}) for depth in (1e-4, 2e-4)]
    settings = Relaxation(kind="relaxation", mach1=["a.txt", "b.txt"])
    compared = [_compared(["DMA, mode 1", "radius"]), _compared(["DMA, mode 1", "DMA, mode 2", "radius"])]
    made = gathered(ramps, [xr.Dataset(), xr.Dataset()], compared, settings=settings)
    assert json.loads(made.attrs["names"]) == ["a", "b"]
    assert made["slope_plateau_force"].sel(uncertain="DMA, mode 2").values.tolist() == [0.0, 1.0]
    assert made["input_u"].values.tolist() == [1.0, 1.0, 1.0]

"""The indentation simulated with the measured displacement."""

from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.variables import variable
from pipelines.experiments.relaxation.measured import Hold, find
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.model_inputs import table_of
from pipelines.experiments.shared.punch_model import NOTHING_NAMED, TOUCH, along, modelled

SLOPES = "slope_plateau_force"
_NODES = 40  # along a ramp and its hold, where the effects of the inputs are given
_SHORTEST = 0.02  # s; the fastest part of a ramp that shows in a force


def model(
    loads: xr.Dataset, ramps: xr.Dataset, material_file: Path | None, fitted: xr.Dataset | None, *, settings: Relaxation
) -> xr.Dataset:
    """Simulate the whole file with the measured displacement.

    Without punch, substrate and first touch there is nothing to simulate; the result says so.
    """
    if settings.punch is None or settings.substrate is None:
        return xr.Dataset(attrs={"absent": NOTHING_NAMED})
    touch = mach1_readings.touch_of(ramps)
    if not np.isfinite(touch.value):
        return xr.Dataset(attrs={"absent": ramps.attrs["contact"]})
    longest = float(ramps["duration"].max())
    _, effects, made = modelled(loads, touch, settings, material_file, fitted, (_SHORTEST, longest))
    # each file has a first touch of its own: what the files have in common is the punch and the solid
    shared = {name: effect for name, effect in effects.items() if name != TOUCH}
    time, block = loads["time"].values, loads["block"].values
    ends = zip(*(ramps[name].values for name in ("block", "plateau_begin", "last")), strict=True)
    at_end = [(block == int(number)) & (time >= begin) & (time <= last) for number, begin, last in ends]
    slopes = [[float(e.change[where].mean()) / e.step for e in shared.values()] for where in at_end]
    nodes = np.array([_nodes(loads, hold) for hold in find(loads)])
    table = {
        "node": variable(("ramp", "stretch"), nodes, "1", "sample at which the effects of the inputs are given"),
        **along(effects, [np.split(one, one.size) for one in nodes], "ramp"),
        SLOPES: variable(("ramp", "uncertain"), slopes, "1", "change of the plateau's force with an input, SI"),
    }
    made = made.assign(table).assign_coords(ramp=ramps["ramp"])
    return made.merge(table_of({name: effect.given for name, effect in shared.items()}))


def _nodes(loads: xr.Dataset, hold: Hold) -> NDArray[np.int64]:
    """Return samples along a ramp, and ever fewer along its hold."""
    first, last = hold.rows.start, hold.rows.stop - 1
    time = loads["time"].values[hold.rows]
    begin, end = first + np.searchsorted(time, (hold.begin, hold.end))
    end = min(int(end), last - 1)
    ramp = np.linspace(begin, end, _NODES // 2)
    held = end + np.geomspace(1.0, last - end, _NODES - ramp.size)
    return np.concatenate([ramp, held]).astype(np.int64)

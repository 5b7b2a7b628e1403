"""The indentation simulated with the measured displacement."""

from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.units import Quantity
from labpipe.variables import variable
from pipelines.experiments.relaxation.moduli import BINS_PER_DECADE
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import ramps_and_holds
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.shared.model_inputs import table_of
from pipelines.experiments.shared.punch_model import TOUCH, Geometry, along, simulated
from pipelines.experiments.shared.ramps_and_holds import Hold

SLOPES = "slope_plateau_force"
_NODES = 40  # along a ramp and its hold, where the effects of the inputs are given
_SHORTEST = 0.02  # s; the fastest part of a ramp that shows in a force


def model(
    loads: xr.Dataset, ramps: xr.Dataset, material_file: Path | None, fitted: xr.Dataset | None, *, settings: Relaxation
) -> xr.Dataset:
    """Simulate the whole file with the measured displacement.

    Without punch, substrate and first touch there is nothing to simulate; the result says so.
    """
    touch = float(ramps["contact_position"])
    if settings.punch is None or settings.substrate is None:
        reason = "session.toml names no punch and no substrate, so nothing was simulated"
        return xr.Dataset(attrs={"absent": reason})
    if not np.isfinite(touch):
        return xr.Dataset(attrs={"absent": ramps.attrs["contact"]})
    solid = resolve(settings.substrate, material_file, fitted)
    geometry = Geometry.of(settings.punch, settings.substrate, settings.model, float(solid.nu))
    at = Quantity(touch, float(ramps["u_contact_position"]), "m")
    longest = float(ramps["duration"].max())
    others = variations(settings.substrate, material_file, fitted, (_SHORTEST, longest))
    force, effects, attrs = simulated(loads, at, solid, geometry, others)
    u_force = np.sqrt(np.sum(np.square([e.by_u() for e in effects.values()]), axis=0))
    # each file has a first touch of its own: what the files have in common is the punch and the solid
    shared = {name: effect for name, effect in effects.items() if name != TOUCH}
    time, block = loads["time"].values, loads["block"].values
    ends = zip(*(ramps[name].values for name in ("block", "plateau_begin", "last")), strict=True)
    at_end = [(block == int(number)) & (time >= begin) & (time <= last) for number, begin, last in ends]
    slopes = [[float(e.change[where].mean()) / e.step for e in shared.values()] for where in at_end]
    text = "simulated force, before the cell's filter"
    nodes = np.array([_nodes(loads, hold) for hold in ramps_and_holds.find(loads)])
    interval = float(loads["sampling_interval"][0])
    elapsed = np.geomspace(interval, longest, int(np.log10(longest / interval) * BINS_PER_DECADE))
    return xr.Dataset(
        {
            "force": variable("sample", force, "N", text),
            "u_force": variable("sample", u_force, "N", "standard uncertainty from first touch, punch and solid"),
            "reduced_modulus": variable(
                (), float(solid.E_relaxed) / (1 - float(solid.nu) ** 2), "Pa", "relaxed reduced modulus of the material"
            ),
            "relaxation_modulus": variable(
                "elapsed",
                np.asarray(solid.relaxation(elapsed)) / (1 - float(solid.nu) ** 2),
                "Pa",
                "reduced relaxation modulus of the material",
            ),
            "node": variable(("ramp", "stretch"), nodes, "1", "sample at which the effects of the inputs are given"),
            **along(effects, [np.split(one, one.size) for one in nodes], "ramp"),
            SLOPES: variable(("ramp", "uncertain"), slopes, "1", "change of the plateau's force with an input, SI"),
        },
        coords={"ramp": ramps["ramp"], "elapsed": variable("elapsed", elapsed, "s", "time since a step of strain")},
        attrs=attrs,
    ).merge(table_of({name: effect.given for name, effect in shared.items()}))


def _nodes(loads: xr.Dataset, hold: Hold) -> NDArray[np.int64]:
    """Return samples along a ramp, and ever fewer along its hold."""
    first, last = hold.rows.start, hold.rows.stop - 1
    time = loads["time"].values[hold.rows]
    begin, end = first + np.searchsorted(time, (hold.begin, hold.end))
    end = min(int(end), last - 1)
    ramp = np.linspace(begin, end, _NODES // 2)
    held = end + np.geomspace(1.0, last - end, _NODES - ramp.size)
    return np.concatenate([ramp, held]).astype(np.int64)

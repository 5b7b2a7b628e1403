"""The drop simulated as long as the record lasts, with the uncertainty of its path."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.variables import variable
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.drop_model import simulated_drop

FOLLOWED = 20
"""Impacts whose sensitivities are found, and that are compared with the model one by one.

Three are compared; PEEK bounces a hundred times, and each impact costs a contact for every input.
"""
_CURVE_STEP = 5e-5  # s, spacing of the model's curve; contacts of 1 ms get twenty points


def model(
    repeats: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    *,
    settings: BallDrop,
    full: bool = False,
) -> xr.Dataset:
    """Simulate the drop as long as the record lasts, with the uncertainty of its inputs.

    ``full`` disables the simulator's shortcuts; the numbers stay the same within ``rtol``.
    """
    fall = np.sqrt(2 * settings.height.value / settings.model.gravity.value)
    made = simulated_drop(
        settings,
        material_file,
        fitted,
        plate,
        float(fall + repeats["time"].max()),
        _CURVE_STEP,
        followed=FOLLOWED,
        of_budget="restitution",
        full=full,
    )
    squares = np.full(made["time"].shape, 0.0 if made.sizes["impact"] else np.nan)
    for moved in path_by_input(made):
        squares += np.square(moved)
    text = "standard uncertainty from the inputs, from first contact on: displacement"
    return made.assign(u_displacement=variable("time", np.sqrt(squares), "m", text))


def path_by_input(made: xr.Dataset) -> Iterator[Floats]:
    """Yield the effect of one standard uncertainty of each uncertain input on the displacement (time,) [m].

    Times count from the first contact; NaN after the last impact whose sensitivities were found.
    """
    of_contact = ("impact_time", "contact_duration", "penetration")
    time, path = made["time"].values, made["displacement"].values
    touches, durations, depths = (made[name].values for name in of_contact)
    for i, u in enumerate(made["input_u"].values):
        if u > 0.0 and touches.size:
            slope, longer, deeper = (made[f"slope_{name}"].values[i][:FOLLOWED] for name in of_contact)
            whole = np.isfinite(durations[: slope.size] + depths[: slope.size] + longer + deeper)
            count = int(np.cumprod(whole).sum())  # a contact that the end of the record cuts has neither
            pairs = (touches, durations), (slope, longer)
            nodes, later = (np.stack((a[:count], a[:count] + b[:count]), axis=1).ravel() for a, b in pairs)
            deeper = deeper[:count] / depths[:count]
            faster = float(made["slope_impact_speed"].values[i][0])
            fall = np.where(time < touches[0], faster * (touches[0] - time), 0.0)
            up, down = (_moved(time, path, nodes, by * later, by * deeper) + by * fall for by in (u, -u))
            yield 0.5 * (up - down)


def _moved(time: Floats, path: Floats, nodes: Floats, later: Floats, deeper: Floats) -> Floats:
    """Return the path (time,) whose touches and lift-offs (2 impact,) come later; contacts are deeper by a share."""
    moved = nodes + later
    # a shift as long as a flight says nothing of the path any more
    if not moved.size or not np.all(np.diff(moved) > 0.0):
        return np.full(time.shape, np.nan)
    last = np.searchsorted(moved, time, side="right") - 1
    found = np.interp(np.where(last < 0, time, np.interp(time, moved, nodes, right=np.nan)), time, path)
    higher = np.square(np.diff(moved) / np.diff(nodes))
    higher[::2] = 1.0 + deeper
    return np.where(last < 0, found, found * np.append(higher, 1.0)[last])

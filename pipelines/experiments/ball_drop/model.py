"""The drop simulated as long as the record lasts, with the uncertainty of its path."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.drop_model import simulated_drop

FOLLOWED = 20
"""Impacts whose sensitivities are found, and that are compared with the model one by one.

Three are compared; PEEK bounces a hundred times, and each impact costs a contact for every input.
"""
_OF_CONTACT = ("impact_time", "contact_duration", "penetration")


def model(
    repeats: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    *,
    settings: BallDrop,
    full: bool = False,
    step: float = 5e-5,
) -> xr.Dataset:
    """Simulate the drop as long as the record lasts, with the uncertainty of its inputs.

    The curve has a point each ``step`` [s], contacts of 1 ms twenty. ``full`` disables the simulator's shortcuts; the
    numbers stay the same within ``rtol``.
    """
    fall = np.sqrt(2 * settings.height.value / settings.model.gravity.value)
    return simulated_drop(
        settings,
        material_file,
        fitted,
        plate,
        float(fall + repeats["time"].max()),
        step,
        followed=FOLLOWED,
        of_budget="restitution",
        full=full,
    )


def path_limits(made: xr.Dataset, coverage: float = 2.0) -> tuple[Floats, Floats]:
    """Return the lowest and the highest displacement (time,) [m] within ``coverage`` standard uncertainties.

    The path comes earlier or later by the uncertainty of its touches, after the last one whose sensitivities were found
    in proportion to time. A flight that lasts longer is higher by the square; a contact is deeper by its penetration.
    """
    time, path = made["time"].values, made["displacement"].values
    touches, durations, depths = (made[name].values for name in _OF_CONTACT)
    moved, longer = (made[f"slope_{name}"].values * made["input_u"].values[:, None] for name in _OF_CONTACT[:2])
    count = int(np.isfinite(durations + np.linalg.norm(moved + longer, axis=0)).sum())
    if count < 2:
        return path, path
    # touches and lift-offs one after the other, and what each input's uncertainty makes of them
    pairs = (touches, durations), (moved, longer)
    nodes, shifts = (np.stack((a, a + b), axis=-1)[..., :count, :].reshape(*a.shape[:-1], -1) for a, b in pairs)
    u_nodes = np.linalg.norm(shifts, axis=0)
    stretched = coverage * np.linalg.norm(np.diff(shifts), axis=0) / np.diff(nodes)
    deeper = coverage * (made["u_penetration"].values / depths)[:count]
    at = np.clip(np.searchsorted(nodes[::2], time) - 1, 0, count - 2)
    higher, deeper = np.where(time > nodes[0], stretched[1::2][at], 0.0), deeper[at]
    fall = coverage * float(made["u_impact_speed"][0]) * np.maximum(nodes[0] - time, 0.0)
    grown = np.maximum((time - nodes[0]) / (nodes[-1] - nodes[0]), 1.0)
    reach = coverage * grown * np.interp(time, nodes, u_nodes)
    low = np.where(path > 0.0, path * np.maximum(1.0 - higher, 0.0) ** 2, path * (1.0 + deeper)) - fall
    high = np.where(path > 0.0, path * (1.0 + higher) ** 2, path * (1.0 - deeper)) + fall
    # of each moment the extremes between its earliest and its latest place on the path
    early, late = time - reach, time + reach
    between = np.stack((np.searchsorted(time, early), np.searchsorted(time, late, side="right")), axis=1).ravel()
    lowest, highest = (
        find.reduceat(np.append(values, values[-1]), between)[::2]
        for find, values in ((np.minimum, low), (np.maximum, high))
    )
    for end in (early, late):  # between the samples
        lowest, highest = np.fmin(lowest, np.interp(end, time, low)), np.fmax(highest, np.interp(end, time, high))
    return lowest, highest


def path_by_input(made: xr.Dataset) -> Iterator[Floats]:
    """Yield the effect of one standard uncertainty of each uncertain input on the displacement (time,) [m].

    Times count from the first contact; NaN after the last impact whose sensitivities were found.
    """
    time, path, speed = (made[name].values for name in ("time", "displacement", "velocity"))
    touches, durations, depths = (made[name].values for name in _OF_CONTACT)
    for i, u in enumerate(made["input_u"].values):
        if u > 0.0 and touches.size:
            slope, longer, deeper = (u * made[f"slope_{name}"].values[i][:FOLLOWED] for name in _OF_CONTACT)
            whole = np.isfinite(durations[: slope.size] + depths[: slope.size] + longer + deeper)
            count = int(np.cumprod(whole).sum())  # a contact that the end of the record cuts has neither
            pairs = (touches, durations), (slope, longer)
            nodes, later = (np.stack((a[:count], a[:count] + b[:count]), axis=1).ravel() for a, b in pairs)
            # all comes later by as much as touch and lift-off do; a flight that lasts longer is higher by the square
            higher = np.full(nodes.size + 1, np.nan)
            higher[1:-1] = 2.0 * np.diff(later) / np.diff(nodes)
            higher[1::2] = deeper[:count] / depths[:count]
            faster = u * float(made["slope_impact_speed"].values[i][0])
            shift = np.interp(time, nodes, later) if count else np.nan
            moved = path * higher[np.searchsorted(nodes, time)] - speed * shift
            yield np.where(time < touches[0], faster * (touches[0] - time), moved)

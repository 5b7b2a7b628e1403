"""Bounces measured by laser, as data for identification."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.identification import Bounces
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.material_evidence import MaterialEvidence, nuisance, of_drop


def evidence(
    bounces: Sequence[xr.Dataset],
    repeats: xr.Dataset,
    plate: xr.Dataset | None,
    file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: BallDrop,
    name: str,
    impacts: int,
    least: float = 5e-5,
) -> MaterialEvidence | str:
    """Gather times of touch and durations of contact, the mean of the repeats.

    The shape of the pulse that was fitted to the contacts is the same for all of them: it moves
    all durations by one unknown, and leaves the times between touches as they are. These are known to the ``least``
    share at best, by the clocks of simulation and record.
    """
    count = min(impacts + 1, *(b.sizes["impact"] for b in bounces))
    if count < 2:
        return "fewer than two impacts were seen"

    touch, u_touch, shared_u_touch, shared_u_duration = (
        np.array([b[variable].values[:count] for b in bounces])
        for variable in ("touch_time", "u_touch_time", "shared_u_touch_time", "shared_u_contact_duration")
    )
    touch = touch - touch[:, :1]
    own = np.sqrt(np.maximum(u_touch**2 - shared_u_touch**2, 0.0).mean(axis=0))
    if len(bounces) > 2:  # the scatter of times between repeats that their heights do not explain
        mean = touch.mean(axis=0)
        rest = touch - (touch @ mean / (mean @ mean))[:, None] * mean
        own = np.maximum(own, np.linalg.norm(rest, axis=0) / np.sqrt(len(bounces) - 1))
    own /= np.sqrt(len(bounces))
    own = np.maximum(own, least * touch.mean(axis=0))
    unknowns = {
        "trigger": nuisance(f"{name} trigger", 0.0, float(own[0]), "s", "delay of the first contact"),
        "pulse": nuisance("pulse shape", 0.0, 1.0, "1", "shape of the force pulse, in standard uncertainties"),
    }
    none, shared = np.full(count, np.nan), (shared_u_duration**2).mean(axis=0)
    duration, u_duration = (repeats[f"{u}contact_duration"].values[:count] for u in ("", "u_"))
    u_duration = np.sqrt(np.maximum(u_duration**2 - shared, 0.0))
    seen = Bounces(touch.mean(axis=0), own, duration, u_duration, none, none, np.sqrt(shared))
    heights = [float(b["drop_height"]) for b in bounces]
    return of_drop(name, settings, seen, unknowns, plate, file, fitted, heights)

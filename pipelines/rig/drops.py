"""A series of ball drops as the virtual rig records them, with true values."""

import json
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from instruments import keyence
from labpipe import files
from pipelines.rig.fall import DropRig, let_go
from pipelines.rig.laser_sensor import record_drop
from pipelines.rig.reference_drop import Trajectory
from pipelines.rig.solids import Truth, solid_of, truth_of_solid


@dataclass(frozen=True, slots=True)
class Drop:
    """One recorded drop: readings in m and the motion that made them."""

    readings: np.ndarray[Any, np.dtype[np.float64]]
    trajectory: Trajectory
    height: float
    release: float


def drop_once(rig: DropRig, material: Truth, height: float, seed: int) -> Drop:
    """Drop a sphere once and record it; everything random comes from ``seed``."""
    begun = let_go(rig, material, height, seed)
    readings = record_drop(
        begun.motion, rig.sensor, duration=rig.duration, release=begun.time, generator=begun.generator
    )
    return Drop(readings, begun.motion, begun.height, begun.time)


def truth_of(drop: Drop, rig: DropRig) -> dict[str, Any]:
    """Return what really happened, for the file beside the recording."""
    motion = drop.trajectory
    complete = len(motion.liftoff)
    return {
        "synthetic": True,
        "height": drop.height,
        "release_time": drop.release,
        "first_contact_time": drop.release + float(motion.touch[0]),
        "inclination": rig.sensor.inclination,
        "noise": rig.sensor.noise,
        "step": rig.sensor.step,
        "floor": asdict(rig.floor),
        "touch_time": (drop.release + motion.touch).tolist(),
        "liftoff_time": (drop.release + motion.liftoff).tolist(),
        "incoming_speed": motion.incoming_speed.tolist(),
        "outgoing_speed": motion.outgoing_speed.tolist(),
        "restitution": (motion.outgoing_speed / motion.incoming_speed[:complete]).tolist(),
        "peak_force": float(motion.force.max()),
        "peak_contact_radius": float(motion.contact_radius.max()),
    }


def write_drops(
    folder: Path, stem: str, rig: DropRig, material: Truth, height: float, repeats: int, seed: int, start: datetime
) -> list[str]:
    """Write the recordings of one height and their truth; returns the file names.

    Parameters
    ----------
    folder : Path
        The session folder; recordings go to ``laser/``, truth to ``truth/``.
    stem : str
        First part of the file names.
    seed : int
        Seed of the first repeat; the others follow.
    start : datetime
        Clock time of the first drop.
    """
    names = []
    for repeat in range(repeats):
        drop = drop_once(rig, material, height, seed + repeat)
        name = f"laser/{stem}_{repeat + 1}.csv"
        recording = keyence.make_recording(
            {1: drop.readings}, cycle=rig.sensor.cycle, start=start + timedelta(minutes=2 * repeat), decimals=4
        )
        keyence.write(folder / name, recording)
        truth = json.dumps(truth_of(drop, rig) | {"solid": truth_of_solid(solid_of(material))}, indent=1)
        files.write_text(folder / f"truth/{stem}_{repeat + 1}.json", truth + "\n")
        names.append(name)
    return names

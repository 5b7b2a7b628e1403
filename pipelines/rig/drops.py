"""A series of ball drops as the virtual rig records them, with true values."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from instruments import keyence
from labpipe import files
from labpipe.arrays import Floats
from pipelines.rig.fall import DropRig, let_go
from pipelines.rig.laser_sensor import record_drop
from pipelines.rig.reference_drop import Trajectory
from pipelines.rig.solids import Truth, solid_of, truth_of_solid


@dataclass(frozen=True, slots=True)
class Drop:
    """One recorded drop: readings in m and the motion that made them."""

    readings: Floats
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
    """Return the true values, for the file of the recording's truth."""
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
        "disc_compliance": rig.disc,
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
    """Write the recordings of one height and their truth; returns the file names, which begin with the stem.

    Recordings go to ``laser/`` of the session folder, truth to ``truth/``. The seed is that of the first repeat, the
    others follow; ``start`` is the clock time of the first drop.
    """
    drops = (drop_once(rig, material, height, seed + repeat) for repeat in range(repeats))
    solid = {"solid": truth_of_solid(solid_of(material))}
    recorded = ((drop.readings, truth_of(drop, rig) | solid) for drop in drops)
    return write_recordings(folder, "laser", stem, rig, recorded, start, decimals=4)


def write_recordings(
    folder: Path,
    place: str,
    stem: str,
    rig: DropRig,
    recorded: Iterable[tuple[Floats, dict[str, Any]]],
    start: datetime,
    *,
    decimals: int,
) -> list[str]:
    """Write readings and the truth of each; returns the file names, which begin with ``place``."""
    names = []
    for repeat, (readings, truth) in enumerate(recorded):
        name = f"{place}/{stem}_{repeat + 1}.csv"
        begun = start + timedelta(minutes=2 * repeat)
        recording = keyence.make_recording({1: readings}, cycle=rig.sensor.cycle, start=begun, decimals=decimals)
        keyence.write(folder / name, recording)
        files.write_text(folder / f"truth/{stem}_{repeat + 1}.json", json.dumps(truth, indent=1) + "\n")
        names.append(name)
    return names

"""A series of ball drops as the virtual rig records them, with true values."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from instruments import keyence
from labpipe.arrays import Floats
from pipelines.rig.fall import Body, DropRig, fall
from pipelines.rig.reference_drop import Trajectory
from pipelines.rig.session_text import write_truth
from pipelines.rig.solids import Truth, solid_of, truth_of_solid


@dataclass(frozen=True, slots=True)
class Drop:
    """One recorded drop: readings in m, the motion that made them, its height, and the release in the record's time."""

    readings: Floats
    trajectory: Trajectory
    height: float
    release: float


def drop_once(
    rig: DropRig,
    material: Truth,
    height: float,
    seed: int,
    seen: Callable[[Trajectory, Floats], Floats] = Trajectory.at,
) -> Drop:
    """Drop a sphere once and record what the sensor has ``seen`` over the times since the release, by default itself.

    Everything random comes from ``seed``. The record begins any fraction of a cycle before the release.
    """
    generator, sensor = np.random.default_rng(seed), rig.sensor
    true_height = height + generator.normal(0.0, rig.height_scatter)
    release = rig.release + abs(generator.normal(0.0, rig.release_jitter))
    body = Body(material, true_height, rig.radius, rig.mass, rig.floor, rig.disc)
    motion = fall(body, rig.duration - release + 1e-3)  # s by which it outlasts the record
    time = np.arange(round(rig.duration / sensor.cycle), dtype=np.float64) * sensor.cycle
    noise = generator.normal(0.0, sensor.noise, time.size)
    return Drop(sensor.readings(seen(motion, time - release), noise), motion, true_height, release)


def truth_of(drop: Drop, rig: DropRig) -> dict[str, Any]:
    """Return the true values, for the file of the recording's truth."""
    motion = drop.trajectory
    complete = len(motion.liftoff)
    return {
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
        keyence.write(folder / name, {1: readings}, cycle=rig.sensor.cycle, start=begun, decimals=decimals)
        write_truth(folder, f"{stem}_{repeat + 1}", truth)
        names.append(name)
    return names

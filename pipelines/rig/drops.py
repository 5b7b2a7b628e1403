"""A series of ball drops as the virtual rig records them, with the truth of every one."""

import json
from dataclasses import asdict, dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from instruments import keyence
from labpipe import files
from labpipe.materials import Prony
from pipelines.rig.laser_sensor import LaserSensor, record_drop
from pipelines.rig.reference_drop import Floor, Trajectory, reference_drop


@dataclass(frozen=True, slots=True)
class DropRig:
    """The rig: sphere, sensor, floor, and how much one drop differs from the next.

    ``height_scatter`` is the standard deviation of the release height over repeats,
    ``release_jitter`` that of the release time within the record.
    """

    radius: float = 9.525e-3
    mass: float = 0.505
    sensor: LaserSensor = field(
        default_factory=lambda: LaserSensor(inclination=float(np.deg2rad(12.07)))
    )
    floor: Floor = field(default_factory=lambda: Floor(mass=1500.0))
    duration: float = 0.5
    release: float = 0.02
    release_jitter: float = 2e-3
    height_scatter: float = 4e-6


@dataclass(frozen=True, slots=True)
class Drop:
    """One recorded drop: readings in m and the motion that made them."""

    readings: np.ndarray[Any, np.dtype[np.float64]]
    trajectory: Trajectory
    height: float
    release: float


def drop_once(rig: DropRig, material: Prony, height: float, seed: int) -> Drop:
    """Drop a sphere once and record it; everything random comes from ``seed``."""
    generator = np.random.default_rng(seed)
    true_height = height + generator.normal(0.0, rig.height_scatter)
    release = rig.release + abs(generator.normal(0.0, rig.release_jitter))
    trajectory = reference_drop(
        material.E_relaxed, np.asarray(material.E), np.asarray(material.rho), float(material.nu),
        radius=rig.radius, mass=rig.mass, height=true_height,
        duration=rig.duration - release + 1e-3, floor=rig.floor,
    )  # fmt: skip
    readings = record_drop(
        trajectory, rig.sensor, duration=rig.duration, release=release, generator=generator
    )
    return Drop(readings, trajectory, true_height, release)


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
    folder: Path,
    stem: str,
    rig: DropRig,
    material: Prony,
    height: float,
    repeats: int,
    seed: int,
    start: datetime,
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
            {1: drop.readings}, cycle=rig.sensor.cycle, start=start + timedelta(minutes=2 * repeat),
            decimals=4,
        )  # fmt: skip
        keyence.write(folder / name, recording)
        truth = json.dumps(truth_of(drop, rig), indent=1)
        files.write_text(folder / f"truth/{stem}_{repeat + 1}.json", truth + "\n")
        names.append(name)
    return names

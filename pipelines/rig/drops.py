"""The rig that drops a sphere, and a series of drops as its laser records them, with true values."""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from instruments import keyence
from labpipe.arrays import Floats
from pipelines.rig.apparatus import SPHERE
from pipelines.rig.reference_drop import Floor, Trajectory, reference_drop
from pipelines.rig.session_text import write_truth
from pipelines.rig.solids import SAPPHIRE, Truth, solid_of, truth_of_solid


@dataclass(frozen=True, slots=True)
class Body:
    """The falling body: radius, moving mass, height, material; the floor, and the compliance of the disc [1/Pa]."""

    material: Truth
    height: float
    radius: float = SPHERE.radius
    mass: float = SPHERE.mass
    floor: Floor | None = None
    disc: float = SAPPHIRE

    def fall(self, duration: float, snapshots: Floats | None = None) -> Trajectory:
        """Return the reference motion for ``duration`` s after release."""
        solid, where = solid_of(self.material), {"radius": self.radius, "mass": self.mass, "height": self.height}
        given: dict[str, Any] = where | {"floor": self.floor, "disc": self.disc}
        return reference_drop(solid, duration=duration, snapshots=snapshots, **given)


@dataclass(frozen=True, slots=True)
class LaserSensor:
    """A laser displacement sensor that looks at a moving part under an angle: its errors, in m, rad and s."""

    inclination: float
    cycle: float = 50e-6
    noise: float = 1.0e-6
    step: float = 0.1e-6
    zero: float = 2.5e-3

    def readings(self, moved: Floats, errors: Floats) -> Floats:
        """Return the readings (n,) of a motion (n,) upwards, with the errors of each, in m."""
        along = moved * np.cos(self.inclination) + self.zero + errors
        return np.round(along / self.step) * self.step


@dataclass(frozen=True, slots=True)
class DropRig:
    """The rig: sphere, sensor, floor, and how much one drop differs from the next.

    ``height_scatter`` is the standard deviation of the release height over repeats,
    ``release_jitter`` that of the release time within the record; ``disc`` [1/Pa] the compliance of the disc.
    """

    radius: float = SPHERE.radius
    mass: float = SPHERE.mass
    sensor: LaserSensor = field(default_factory=lambda: LaserSensor(inclination=float(np.deg2rad(12.07))))
    floor: Floor = field(default_factory=lambda: Floor(mass=1500.0))
    duration: float = 0.5
    release: float = 0.02
    release_jitter: float = 2e-3
    height_scatter: float = 4e-6
    disc: float = SAPPHIRE

    def body(self, material: Truth, height: float) -> Body:
        """Return the sphere of a material at a height."""
        return Body(material, height, self.radius, self.mass, self.floor, self.disc)


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
    motion = rig.body(material, true_height).fall(rig.duration - release + 1e-3)  # s by which it outlasts the record
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

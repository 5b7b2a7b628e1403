"""The laser on the plate while a sphere falls near it, with the true vibration.

The plate's motion is that of the reference drop's own floor, which is stepped with the sphere;
the analysis fits a damped oscillation to its readings.
"""

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from labpipe.arrays import Floats
from pipelines.rig.drops import DropRig, LaserSensor, drop_once, write_recordings
from pipelines.rig.reference_drop import Floor, Trajectory
from pipelines.rig.session_text import from_dma, height_name, section
from pipelines.rig.solids import specimen_of

PLATE = Floor(mass=30.0, frequency=180.0, damping_ratio=0.03)
"""A plate that rings by a few micrometres, as light as to be felt in the rebound."""


PLATE_RIG = DropRig(
    sensor=LaserSensor(inclination=float(np.deg2rad(4.96)), noise=0.3e-6, step=0.02e-6, zero=-1.2e-3),
    floor=PLATE,
    duration=0.2,
)
"""The rig with the laser on the plate, close to the disc; the sensor averages and sees 0.3 µm."""


def floor_at(motion: Trajectory, time: Floats) -> Floats:
    """Height of the floor at any time, by a cubic spline; 0 before release."""
    kept, first = np.unique(motion.time, return_index=True)
    spline = CubicSpline(kept, motion.floor[first])
    return np.where(time > 0, spline(np.maximum(time, 0.0)), 0.0)


def true_ringing(motion: Trajectory, floor: Floor) -> tuple[float, float]:
    """Envelope [m] and time [s] of the blow of no duration behind the first free ringing."""
    begin = motion.liftoff[0]
    end = motion.touch[1] if len(motion.touch) > 1 else np.inf
    inside = (motion.time >= begin) & (motion.time < end)
    s = motion.time[inside] - begin
    omega = 2 * np.pi * floor.frequency
    rate, damped = floor.damping_ratio * omega, omega * np.sqrt(1 - floor.damping_ratio**2)
    waves = np.exp(-rate * s)[:, None] * np.stack([np.sin(damped * s), np.cos(damped * s)], 1)
    (sine, cosine), *_ = np.linalg.lstsq(waves, motion.floor[inside], rcond=None)
    period = 2 * np.pi / damped
    # Where the motion leaves its rest position downwards, nearest to the middle of the contact.
    back = (np.pi - np.arctan2(cosine, sine)) / damped
    middle = 0.5 * (motion.touch[0] - begin)
    back += np.round((middle - back) / period) * period
    return float(np.hypot(sine, cosine) * np.exp(-rate * back)), float(begin + back)


def write_ringing(
    folder: Path, rig: DropRig, material: str, height: float, repeats: int, seed: int, start: datetime
) -> str:
    """Record the plate under repeated drops of one material and height, with their truth; returns their table."""
    stem = f"plate_{material}_{height_name(height)}"
    solid = specimen_of(material)
    known = {
        "mass": rig.floor.mass,
        "natural_frequency": rig.floor.frequency,
        "damping_ratio": rig.floor.damping_ratio,
        "inclination": rig.sensor.inclination,
        "noise": rig.sensor.noise,
    }
    recorded = []
    for repeat in range(repeats):
        drop = drop_once(rig, solid, height, seed + repeat, floor_at)
        amplitude, blow = true_ringing(drop.trajectory, rig.floor)
        truth = known | {"amplitude": amplitude, "blow_time": drop.release + blow, "height": drop.height}
        recorded.append((drop.readings, truth))
    recordings = write_recordings(folder, "laser_plate", stem, rig, recorded, start, decimals=5)
    return section("plate_drops", material=material, source=from_dma(material), height=height, recordings=recordings)


def plate_section(drops: Sequence[str]) -> str:
    """Return the tables of the plate's vibration in session.toml."""
    return section("plate_vibration", drops=drops)

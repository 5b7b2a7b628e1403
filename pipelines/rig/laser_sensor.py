"""A laser displacement sensor that looks at the holder under an angle.

It samples a known motion, projects it on its line of sight, adds the errors of real sensors (noise,
an unknown zero, a late or early trigger) and rounds to its display step.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from pipelines.rig.reference_drop import Trajectory


@dataclass(frozen=True, slots=True)
class LaserSensor:
    """Errors of a sensor; lengths in m, angle in rad, times in s."""

    inclination: float
    cycle: float = 50e-6
    noise: float = 1.0e-6
    step: float = 0.1e-6
    zero: float = 2.5e-3


def record_drop(
    trajectory: Trajectory, sensor: LaserSensor, *, duration: float, release: float, generator: np.random.Generator
) -> Floats:
    """Return the readings of one drop in m, ``release`` s after the record begins.

    The motion's time is 0 at release; the record is ``duration`` s long and begins any fraction of a cycle before it.
    """
    time = np.arange(round(duration / sensor.cycle), dtype=np.float64) * sensor.cycle
    along = trajectory.at(np.asarray(time - release)) * np.cos(sensor.inclination) + sensor.zero
    noisy = along + generator.normal(0.0, sensor.noise, time.size)
    return np.round(noisy / sensor.step) * sensor.step

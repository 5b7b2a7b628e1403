"""A laser displacement sensor that looks at a moving part under an angle.

It projects a known motion on its line of sight, adds the errors of real sensors (noise, an unknown zero) and rounds to
its display step.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats


@dataclass(frozen=True, slots=True)
class LaserSensor:
    """Errors of a sensor; lengths in m, angle in rad, times in s."""

    inclination: float
    cycle: float = 50e-6
    noise: float = 1.0e-6
    step: float = 0.1e-6
    zero: float = 2.5e-3

    def readings(self, moved: Floats, errors: Floats) -> Floats:
        """Return the readings (n,) of a motion (n,) upwards, with the errors of each, in m."""
        along = moved * np.cos(self.inclination) + self.zero + errors
        return np.round(along / self.step) * self.step

"""The falling body, the rig that drops it, and the laser that looks at it, common to all synthetic recordings."""

from dataclasses import dataclass, field

import numpy as np

from labpipe.arrays import Floats
from pipelines.rig.reference_drop import Floor, Trajectory, reference_drop
from pipelines.rig.solids import SAPPHIRE, Truth, solid_of


@dataclass(frozen=True, slots=True)
class Body:
    """The falling body: radius, moving mass, height, material; the floor, and the compliance of the disc [1/Pa]."""

    material: Truth
    height: float
    radius: float = 9.525e-3
    mass: float = 0.505
    floor: Floor | None = None
    disc: float = SAPPHIRE


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

    radius: float = 9.525e-3
    mass: float = 0.505
    sensor: LaserSensor = field(default_factory=lambda: LaserSensor(inclination=float(np.deg2rad(12.07))))
    floor: Floor = field(default_factory=lambda: Floor(mass=1500.0))
    duration: float = 0.5
    release: float = 0.02
    release_jitter: float = 2e-3
    height_scatter: float = 4e-6
    disc: float = SAPPHIRE


def fall(body: Body, duration: float, snapshots: Floats | None = None) -> Trajectory:
    """Return the reference motion of a body for ``duration`` s after release."""
    return reference_drop(
        solid_of(body.material),
        radius=body.radius,
        mass=body.mass,
        height=body.height,
        duration=duration,
        floor=body.floor,
        snapshots=snapshots,
        disc=body.disc,
    )

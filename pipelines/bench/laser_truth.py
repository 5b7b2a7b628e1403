"""Laser records of bouncing spheres with known true values, for the benchmarks of signals."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.arrays import Floats
from pipelines.rig.drops import drop_once
from pipelines.rig.fall import DropRig
from pipelines.rig.laser_sensor import LaserSensor

_HEIGHT = 1.5e-3  # m, the lowest of the thesis: the most bounces in a record
_SEED = 5
#: Half a step of the central difference (s) that gives the true velocity: far below a sample.
_TINY = 1e-6


@dataclass(frozen=True, slots=True)
class Record:
    """One record: what the sensor gave, and what really happened.

    ``level`` is the reading (m) at first touch; ``velocity`` (time,) m/s at the samples;
    ``touch``, ``liftoff`` (impact,) s in the record; ``restitution`` (impact,) of the impacts
    that were left again.
    """

    displacement: xr.DataArray
    level: float
    velocity: Floats
    touch: Floats
    liftoff: Floats
    restitution: Floats


def record(material: str, duration: float, cycle: float = 50e-6) -> Record:
    """Drop a sphere of the library once in the virtual rig; record it for ``duration`` s, a sample each ``cycle`` s."""
    # a sensor that looks straight down: its scale is no matter of the derivative
    rig = DropRig(duration=duration, sensor=LaserSensor(inclination=0.0, cycle=cycle))
    drop = drop_once(rig, materials.load(material), _HEIGHT, _SEED)
    time = np.arange(len(drop.readings)) * cycle
    since = time - drop.release
    motion = drop.trajectory
    before, after = motion.at(np.asarray(since - _TINY)), motion.at(np.asarray(since + _TINY))
    complete = len(motion.liftoff)
    return Record(
        xr.DataArray(drop.readings, {"time": time}, ["time"], attrs={"units": "m"}),
        rig.sensor.zero,
        np.asarray((after - before) / (2 * _TINY)),
        drop.release + motion.touch,
        drop.release + motion.liftoff,
        motion.outgoing_speed / motion.incoming_speed[:complete],
    )

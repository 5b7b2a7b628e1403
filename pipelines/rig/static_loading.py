"""A sphere under manually added loads, recorded by the laser every few seconds."""

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from instruments import keyence
from pipelines.rig.laser_sensor import LaserSensor
from pipelines.rig.reference_static import reference_static
from pipelines.rig.session_text import from_dma, from_library, write_truth
from pipelines.rig.solids import SAPPHIRE, Truth, solid_of, specimen_of, truth_of_solid


@dataclass(frozen=True, slots=True)
class StaticRig:
    """Sphere, loads and sensor; SI.

    ``times`` are when the loads are to be put on, ``late`` by how much a hand is late or early
    (standard deviation). ``drift`` is the standard deviation of the zero's wandering over the
    record, ``touched`` the disturbance of the reading next to a step. The sensor averages over
    many of its cycles between two readings, which leaves it little noise. ``disc`` [1/Pa] is the compliance
    of the disc.
    """

    radius: float = 9.525e-3
    masses: tuple[float, ...] = (0.5, 2.5, 3.5, 4.5, 5.5)
    times: tuple[float, ...] = (0.0, 153.0, 1092.0, 1986.0, 2853.0)
    duration: float = 3780.0
    cycle: float = 5.0
    gravity: float = 9.81
    sensor: LaserSensor = field(default_factory=lambda: LaserSensor(inclination=float(np.deg2rad(12.07)), noise=0.3e-6))
    late: float = 3.0
    drift: float = 0.1e-6
    touched: float = 4e-6
    disc: float = SAPPHIRE


def write_static(folder: Path, name: str, rig: StaticRig, material: Truth, seed: int, start: datetime) -> str:
    """Write one record of the laser and its truth; returns the file's name."""
    generator = np.random.default_rng(seed)
    late = np.concatenate([[-1e-3], generator.normal(0.0, rig.late, len(rig.times) - 1)])
    begins = np.array(rig.times) + late
    time = np.arange(round(rig.duration / rig.cycle), dtype=np.float64) * rig.cycle
    loading = {"load_times": begins, "loads": np.array(rig.masses) * rig.gravity, "time": time}
    approach = reference_static(solid_of(material), radius=rig.radius, disc=rig.disc, **loading)
    drift = generator.normal(0.0, rig.drift) * time / rig.duration
    errors = generator.normal(0.0, rig.sensor.noise, time.size)
    for begin in begins[1:]:
        errors[np.searchsorted(time, begin)] += generator.normal(0.0, rig.touched)
    readings = rig.sensor.readings(drift - approach, errors)
    file = f"laser/{name}.csv"
    keyence.write(folder / file, {1: readings}, cycle=rig.cycle, start=start)
    truth = {
        "solid": truth_of_solid(solid_of(material)),
        "zero": rig.sensor.zero,
        "inclination": rig.sensor.inclination,
        "disc_compliance": rig.disc,
        "load_times": begins.tolist(),
        "masses": list(rig.masses),
        "time": time.tolist(),
        "approach": approach.tolist(),
    }
    write_truth(folder, name, truth)
    return file


def record_static(folder: Path, name: str, start: datetime, rig: StaticRig | None = None, seed: int = 0) -> str:
    """Record PTFE under the loads of a rig, by default the stated one; returns its section."""
    file = write_static(folder, name, rig or StaticRig(), specimen_of("ptfe"), seed + 90, start)
    return static_section(name, file, StaticRig(), "ptfe", from_dma("ptfe"))


def static_section(name: str, file: str, rig: StaticRig, material: str, source: str = "") -> str:
    """Return the tables of a static loading in session.toml."""
    loads = "".join(
        f'  {{ mass = "{mass:g} ± 0.0005 kg", time = "{begin / 60:.2f} min" }},\n'
        for mass, begin in zip(rig.masses, rig.times, strict=True)
    )
    return f"""
[experiments.{name}]
kind = "static_loading"
laser = "{file}"
calibration = "calibration/laser.toml"
loads = [
{loads}]

[experiments.{name}.sphere]
radius = "{rig.radius * 1e3:g} ± 0.005 mm"
{source or from_library(material)}
[experiments.{name}.steps]
drift = "{rig.drift * 1e6:g} um"
"""

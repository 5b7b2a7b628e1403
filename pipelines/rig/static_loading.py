"""A sphere under manually added loads, recorded by the laser every few seconds.

The rig's own creep inverts the Laplace transform of the true creep compliance numerically and puts it into the closed
form of Lee and Radok for a contact that only grows (J. Appl. Mech. 27 (1960) 438, https://doi.org/10.1115/1.3644020),

    a³(t) = (3R/4) Σ ΔF_i J*(t − t_i),     δ = a²/R,

where the bundled simulator marches springs through exponential memory.
"""

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from instruments import keyence
from labpipe.arrays import Floats
from pipelines.rig.apparatus import SPHERE
from pipelines.rig.drops import LaserSensor
from pipelines.rig.session_text import from_library, section, write_truth
from pipelines.rig.solids import SAPPHIRE, Truth, Viscoelastic, solid_of, truth_of_solid


@dataclass(frozen=True, slots=True)
class StaticRig:
    """Sphere, loads and sensor; SI.

    ``times`` are when the loads are to be put on, ``late`` by how much a hand is late or early
    (standard deviation). ``drift`` is the standard deviation of the zero's wandering over the
    record, ``touched`` the disturbance of the reading next to a step. The sensor averages over
    many of its cycles between two readings, which leaves it little noise. ``disc`` [1/Pa] is the compliance
    of the disc.
    """

    radius: float = SPHERE.radius
    masses: tuple[float, ...] = (0.5, 2.5, 3.5, 4.5, 5.5)
    times: tuple[float, ...] = (0.0, 153.0, 1092.0, 1986.0, 2853.0)
    duration: float = 3780.0
    cycle: float = 5.0
    gravity: float = SPHERE.gravity
    sensor: LaserSensor = field(default_factory=lambda: LaserSensor(inclination=float(np.deg2rad(12.07)), noise=0.3e-6))
    late: float = 3.0
    drift: float = 0.1e-6
    touched: float = 4e-6
    disc: float = SAPPHIRE


def reference_static(
    solid: Viscoelastic, *, radius: float, load_times: Floats, loads: Floats, time: Floats, disc: float = 0.0
) -> Floats:
    """Approach (n,) [m] of a sphere on a flat under loads that are only added to; 0 before the first load.

    ``load_times`` and ``loads`` (load,) [s], [N] say when each load begins, and its whole force; ``disc`` [1/Pa] is the
    compliance (1 − ν²)/E of the flat, 0 for a rigid one.
    """
    compliance = np.zeros(time.size)
    for begin, step in zip(load_times, np.diff(loads, prepend=0.0), strict=True):
        after = time > begin
        compliance[after] += step * ((1 - solid.nu**2) * solid.creep(time[after] - begin) + disc)
    cube = 0.75 * radius * compliance
    return np.asarray(cube ** (2 / 3) / radius)


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


def static_section(name: str, file: str, rig: StaticRig, material: str, source: str = "") -> str:
    """Return the tables of a static loading in session.toml."""
    given = {"radius": rig.radius, "drift": rig.drift, "loads": list(zip(rig.masses, rig.times, strict=True))}
    return section("static_loading", name=name, file=file, source=source or from_library(material), **given)

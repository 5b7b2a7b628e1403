"""Clean sessions of all kinds are believed: no check fails by chance.

What a session states lies off the truth by its stated uncertainty; noise, speeds, depths, materials
and temperatures differ from session to session. At most 2 % may be doubtful, none impossible.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from labpipe import files, materials
from labpipe.arrays import Floats
from pipelines.rig import mach1_tester
from pipelines.rig.dma import Protocol, write_dma
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import Body, DropRig, fall
from pipelines.rig.film_front import FrontCamera, write_front_film
from pipelines.rig.film_session import Bursts, burst_times, front_section, under_section, write_under
from pipelines.rig.film_under import UnderCamera
from pipelines.rig.indentation_session import oscillation_section, relaxation_section
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.plate import PLATE_RIG, write_ringing
from pipelines.rig.plate_session import plate_section
from pipelines.rig.reference_drop import Floor
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.session_text import (
    cell_record,
    dma_section,
    drop_section,
    from_library,
    front_record,
    laser_record,
    plate_laser_record,
    session_head,
    under_record,
)
from pipelines.rig.solids import SOLIDS
from pipelines.session import verdict
from tests.mistakes import static_rows
from tests.mistakes.recordings import values

START = datetime(2024, 5, 14, 9, 30)


def _session(folder: Path, section: str) -> None:
    files.write_text(folder / "calibration/load_cell.toml", cell_record())
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section)


def _drawn(dice: np.random.Generator) -> tuple[Specimen, Specimen, mach1_tester.Tester]:
    """Return what is stated of a punch, what it is, and a tester."""
    stated = Specimen(materials.load("nbr"), tips=int(dice.integers(1, 6)))
    size = {"tip_radius": 2e-6, "period": 2e-6, "depth": 6e-6}
    true = replace(stated, **{n: getattr(stated, n) + dice.normal(0.0, u) for n, u in size.items()})
    tester = replace(
        TESTER,
        force_gain=float(dice.normal(1.0, 1e-3)),
        force_noise=float(dice.uniform(0.003, 0.015)),
        force_offset=float(dice.uniform(-0.5, 0.5)),
        filter_cutoff=20.0 * (1 + float(dice.normal(0.0, 0.2 / 15.9))),
        frequency_error=float(dice.uniform(-0.006, 0.0)),
        amplitude_error=float(dice.uniform(0.0, 0.03)),
        second_harmonic=float(dice.uniform(0.0, 0.006)),
    )
    return stated, true, tester


def _oscillation(folder: Path, number: int) -> tuple[str, ...]:
    dice = np.random.default_rng(number)
    stated, true, tester = _drawn(dice)
    slow, fast = sorted(float(f) for f in dice.choice([0.5, 1.0, 2.0, 5.0], 2, replace=False))
    protocol = Harmonic(
        mean=float(dice.uniform(0.05e-3, 0.2e-3)), amplitude=float(dice.uniform(8e-6, 20e-6)), hold=5.0,
        frequencies=(slow, fast), cycles=7,
    )  # fmt: skip
    write_harmonic(folder, "nbr", true, protocol, tester, 900 + number, START)
    _session(folder, oscillation_section("nbr", stated))
    return ("hold", "oscillations")


def _holds(folder: Path, number: int) -> tuple[str, ...]:
    dice = np.random.default_rng(5000 + number)
    stated, true, tester = _drawn(dice)
    depths = tuple(sorted(float(d) for d in dice.choice([0.5e-4, 1e-4, 1.5e-4, 2e-4, 3e-4], 2, replace=False)))
    names = write_relaxation(folder, "nbr", true, Relaxation(depths=depths, hold=12.0), tester, 900 + number, START)
    _session(folder, relaxation_section("nbr", names, stated))
    return ("ramps",)


def _sweeps(folder: Path, number: int) -> tuple[str, ...]:
    dice = np.random.default_rng(9000 + number)
    name = str(dice.choice(sorted(SOLIDS)))
    cold = float(dice.choice([-60.0, -40.0, -20.0]))
    protocol = Protocol(
        temperatures=tuple(cold + float(dice.choice([10.0, 15.0, 20.0])) * np.arange(5)),
        frequencies=tuple(np.geomspace(10.0, 0.1, int(dice.integers(5, 12))).tolist()),
        ramp=(0.0, 5.0),
    )
    folder.mkdir(parents=True, exist_ok=True)
    export = write_dma(folder, name, SOLIDS[name], protocol, 900 + number)
    section = dma_section(name, export, SOLIDS[name]).replace("T_ref", "# T_ref")
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section)
    return ("readings",)


def _plate(folder: Path, number: int) -> tuple[str, ...]:
    """Two polymers from two heights, with hum and drift, under a sensor whose angle and gain are known by their u."""
    dice = np.random.default_rng(31000 + number)
    angle, gain = float(dice.uniform(3.0, 25.0)), float(dice.normal(1.0, 5e-4))
    sensor = PLATE_RIG.sensor
    sensor = replace(sensor, inclination=float(np.deg2rad(angle)), noise=sensor.noise * float(dice.uniform(0.5, 1.5)))
    mass, radius = 0.505 + float(dice.normal(0.0, 5e-4)), 9.525e-3 + float(dice.normal(0.0, 5e-6))
    rig = replace(PLATE_RIG, duration=0.12, sensor=sensor, mass=mass, radius=radius)
    heights = sorted(float(h) for h in dice.choice([1.5e-3, 3e-3, 5e-3, 8e-3], 2, replace=False))
    drops = []
    for material in map(str, dice.choice(["acrylic", "nylon", "ptfe", "peek"], 2, replace=False)):
        for height in heights:
            true, seed = height + float(dice.normal(0.0, 5e-6)), int(dice.integers(1, 2**31))
            names = write_ringing(folder, f"{material}_{height * 1e6:.0f}", rig, material, true, 2, seed, START)
            hum, drift, phase = dice.uniform(0.0, 2e-5), dice.normal(0.0, 2e-5), dice.uniform(0.0, 6.0)
            values(partial(_disturbed, gain, hum, drift, phase), tuple(names), decimals=5)(folder)
            listed = ", ".join(f'"{name}"' for name in names)
            drops.append(
                f'\n[[experiments.plate.drops]]\nmaterial = "{material}"\nheight = "{height * 1e3:g} ± 0.005 mm"\n'
                f"laser = [{listed}]\n"
            )
    record = plate_laser_record().replace('"5.00 ±', f'"{angle + dice.normal(0.0, 0.1):.2f} ±')
    files.write_text(folder / "calibration/laser_plate.toml", record)
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + plate_section(drops))
    return ("comparison",)


def _disturbed(gain: float, hum: float, drift: float, phase: float, x: Floats) -> Floats:
    """Return readings [mm] with mains and a slow drift, at 50 µs."""
    t = 50e-6 * np.arange(x.size)
    return np.asarray(x * gain + hum * np.sin(2 * np.pi * 50 * t + phase) + drift * t)


def _under(folder: Path, number: int) -> tuple[str, ...]:
    """A film of a contact whose scale, height, noise and sharpness are drawn."""
    dice = np.random.default_rng(41000 + number)
    height, material = float(dice.uniform(1.2e-3, 3e-3)), str(dice.choice(["acrylic", "peek", "nylon"]))
    camera = UnderCamera(
        rows=32, columns=640, centre=(float(dice.uniform(-8, 8)), float(dice.uniform(-3, 3))),
        noise=float(dice.uniform(1.5, 4.0)), blur=float(dice.uniform(0.3, 0.7)),
        visibility=float(dice.uniform(0.6, 0.9)), pixel_size=2 / 461e3 * (1 + float(dice.normal(0.0, 1 / 461))),
    )  # fmt: skip
    body = Body(materials.load(material), height + float(dice.normal(0.0, 5e-6)), floor=Floor(mass=1400.0))
    bursts = Bursts(spacing=1e-4, before=3e-4, after=1.9e-3, slow=20e-3, frames_at_rest=6)
    name = write_under(folder, "under", body, camera, burst_times(body, camera.release, bursts), 137 + number)
    files.write_text(folder / "calibration/camera_under.toml", under_record())
    section = under_section(name, "film", height=height, source=from_library(material))
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section)
    return ("comparison",)


def _front(folder: Path, number: int) -> tuple[str, ...]:
    """A film of the holder and drops before the laser, whose angle, scale, height and light are drawn."""
    dice = np.random.default_rng(51000 + number)
    height, material = float(dice.choice([1.5e-3, 2.5e-3, 4e-3])), str(dice.choice(["ptfe", "nylon", "acrylic"]))
    camera = FrontCamera(
        rows=60 if height < 3e-3 else 90, columns=56, frame_rate=2000, duration=0.07,
        noise=float(dice.uniform(0.8, 1.6)), defocus=float(dice.uniform(0.2, 0.6)),
        drift=float(dice.uniform(0.0, 0.03)), rotation=float(dice.uniform(0.0, 2e-3)),
        pixel_size=0.03 / 386 * (1 + float(dice.normal(0.0, 1.5 / 386))),
    )  # fmt: skip
    rig, solid = DropRig(duration=0.12), materials.load(material)
    angle = float(np.deg2rad(dice.normal(12.0, 0.1)))
    rig = replace(rig, sensor=replace(rig.sensor, inclination=angle))
    laser = write_drops(folder, "drop", rig, solid, height, 2, 9000 + 10 * number, START)
    body = Body(solid, height + float(dice.normal(0.0, 4e-6)), floor=rig.floor)
    name = "film/front.cine"
    motion = fall(body, camera.duration - camera.release + 1e-3)
    write_front_film(folder / name, motion, height, camera, 131 + number)
    section = re.sub(r'laser_experiment = ".*"', 'laser_experiment = "drop"', front_section(name, camera, height))
    files.write_text(folder / "calibration/laser.toml", laser_record())
    files.write_text(folder / "calibration/camera_front.toml", front_record())
    drops = drop_section("drop", laser, height, material)
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section + drops)
    return ("comparison",)


def _drops(folder: Path, number: int) -> tuple[str, ...]:
    """Three drops of a polymer, with hum and drift, whose angle, height, mass and gain are drawn."""
    dice = np.random.default_rng(number)
    angle = float(dice.uniform(8.0, 25.0))
    material = str(dice.choice(["acrylic", "peek", "nylon", "ptfe"]))
    height = float(dice.choice([1.5e-3, 3e-3, 5e-3, 10e-3]))
    stated_height = round((height + dice.normal(0.0, 5e-6)) * 1e3, 4)
    rig = DropRig(duration=0.2)
    sensor = replace(rig.sensor, inclination=float(np.deg2rad(angle)), noise=float(dice.uniform(0.3e-6, 2e-6)))
    rig = replace(rig, sensor=sensor, mass=0.505 + float(dice.normal(0.0, 5e-4)))
    names = write_drops(folder, "drop", rig, materials.load(material), height, 3, 7000 + 10 * number, START)
    hum, drift, phase = float(dice.uniform(0.0, 1e-3)), float(dice.normal(0.0, 1e-3)), float(dice.uniform(0.0, 6.0))
    gain = float(dice.normal(1.0, 5e-4))

    def disturbed(x: Floats) -> Floats:
        t = np.arange(x.size) * sensor.cycle
        return x * gain + hum * np.sin(2 * np.pi * 50 * t + phase) + drift * t

    values(disturbed, tuple(names))(folder)
    record = laser_record().replace('"12.00 ±', f'"{angle + dice.normal(0.0, 0.1):.2f} ±')
    files.write_text(folder / "calibration/laser.toml", record)
    section = drop_section("drop", names, height, material)
    section = section.replace(f'"{height * 1e3:g} ±', f'"{stated_height:g} ±')
    files.write_text(folder / "session.toml", session_head("Clean (synthetic)") + section)
    return ("bounces",)


def _steps(folder: Path, number: int) -> tuple[str, ...]:
    """A sphere under five loads whose masses, radius and angle are drawn."""
    static_rows.drawn(folder, number)
    return ("comparison",)


_BY_DAY = [pytest.param(write, 2) for write in (_oscillation, _holds, _sweeps)]
_SLOW = [(_drops, 8), (_steps, 6)]
_BY_NIGHT = [
    (_drops, 200),
    (_steps, 200),
    (_oscillation, 200),
    (_holds, 200),
    (_sweeps, 200),
    (_plate, 60),
    (_front, 60),
    (_under, 20),
]


@pytest.mark.parametrize(
    ("write", "sessions"),
    [
        *_BY_DAY,
        *(pytest.param(*each, marks=pytest.mark.slow) for each in _SLOW),
        *(pytest.param(*each, marks=pytest.mark.nightly) for each in _BY_NIGHT),
    ],
)
def test_clean_sessions_are_believed(
    write: Callable[[Path, int], tuple[str, ...]], sessions: int, tmp_path: Path
) -> None:
    off: dict[int, list[tuple[str, str]]] = {}
    for number in range(sessions):
        folder = tmp_path / str(number)
        found = verdict(folder, write(folder, number), jobs=0).experiments
        told = [(str(f.level), f.message) for v in found for f in v.findings if f.level != "note"]
        if told or any(v.believable != "yes" for v in found):
            off[number] = told
    assert [n for n, told in off.items() if any(level == "impossible" for level, _ in told)] == [], off
    assert len(off) <= 0.02 * sessions, off

"""Sessions of random materials as the virtual rig records them: raw files and session.toml.

Everything that session.toml and the calibration records state with an uncertainty is wrong by a
normal draw of it; readings carry their noise, their steps, and a release or an approach that is
never twice the same. All of it follows from kind and seed.
"""

import json
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from labpipe import files
from labpipe.errors import InputError
from pipelines.rig.drops import write_drops
from pipelines.rig.fall import DropRig
from pipelines.rig.indentation_session import oscillation_section, relaxation_section
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.laser_sensor import LaserSensor
from pipelines.rig.mach1_tester import Tester
from pipelines.rig.plate import PLATE
from pipelines.rig.reference_drop import GRAVITY, Floor
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.session_text import cell_record, drop_section, laser_record, session_head
from pipelines.rig.solids import Viscoelastic
from tests.labpipe.identification.random_rubbers import random_solid

KINDS = ("drop", "rubber", "hold")
"""A glassy ball on a floor; a rubber held and oscillated; a rubber held."""

RIGID = Floor()

DEPTH = 0.1e-3
"""m; to which the punch is pressed in."""

_FIRST_SEED, _APART = 90_000, 1000  # of the truths of a kind, and between two kinds
_START = datetime(2024, 5, 14, 9, 30)
_REPEATS = 2
_HEIGHTS = (1.5e-3, 10e-3)  # m, between which a height is drawn evenly
_FALLS = 13.2  # falls from the first height that a record lasts: six bounces of a good ball
_BEFORE, _AFTER = 0.02, 0.02  # s
_ON_PLATE = (3, 6)  # of eight seeds: one smooth and one coarse material
_INCLINATION, _U_INCLINATION = 12.0, 0.1  # degrees; this and what follows is what sessions state
_U_SCALE = 5e-4  # of laser_record
_U_RADIUS, _U_MASS, _U_HEIGHT = 5e-6, 5e-4, 5e-6  # m, kg, m; of drop_section
_U_PLATE = (0.3, 6e-3, 4e-5)  # kg, Hz, 1; frequency and damping as a plate's own record gives them
_U_TIP, _U_PERIOD, _U_LENGTH = 2e-6, 2e-6, 6e-6  # m; of punch_section
_U_GAIN = 1e-3  # of cell_record
_DELAY, _U_DELAY = 15.915, 0.2  # ms; a Butterworth's of third order and 20 Hz, and of cell_record
_TARE = 0.3  # N: what an untared cell shows
_SURFACE = 1e-5  # m: where a specimen begins
_HELD = Relaxation(depths=(DEPTH,), hold=600.0)
_SHORTER = Relaxation(depths=(DEPTH,), hold=120.0)
_WAVES = Harmonic(mean=DEPTH, hold=60.0, frequencies=(0.2, 0.7, 2.5), cycles=7)


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of a random session.

    Attributes
    ----------
    kind : str
        Of :data:`KINDS`.
    seed : int
    solid : Viscoelastic
        The material.
    height : float [m]
        Of a drop as session.toml states it.
    mean_height : float [m]
        About which the rig's heights scatter.
    rig : DropRig
        Of a drop: true sphere, sensor, floor.
    specimen : Specimen
        Of an indentation: true punch and surface.
    tester : Tester
    stated_delay : float [ms]
        Of the load cell's filter.
    """

    kind: str
    seed: int
    solid: Viscoelastic
    height: float
    mean_height: float
    rig: DropRig
    specimen: Specimen
    tester: Tester
    stated_delay: float

    @property
    def is_on_plate(self) -> bool:
        """Whether a ball falls on the ringing plate."""
        return self.kind == "drop" and bool(np.isfinite(self.rig.floor.mass))

    @property
    def delay_error(self) -> float:
        """Stated minus true delay of the load cell's filter, in its stated uncertainties."""
        return (self.stated_delay - _DELAY) / _U_DELAY


def drawn(kind: str, number: int) -> Truth:
    """Draw the truth of a session.

    Parameters
    ----------
    kind : str
        Of :data:`KINDS`.
    number : int
        Of the session, from 0; even ones have symmetric dispersions, odd ones skewed ones.

    Raises
    ------
    InputError
        There is no such kind.
    """
    if kind not in KINDS:
        message = f'there is no kind "{kind}" of random sessions; known are {", ".join(KINDS)}'
        raise InputError(message)
    seed = _FIRST_SEED + _APART * KINDS.index(kind) + number
    solid = random_solid(seed, is_rubber=kind != "drop")
    rng = np.random.default_rng((seed, 1))
    height = round(rng.uniform(*_HEIGHTS), 5)
    mean_height = height + rng.normal(0.0, _U_HEIGHT)
    rig = _rig(rng, height, is_on_plate=number % 8 in _ON_PLATE)
    specimen, tester = _indenter(rng, solid)
    delay = _DELAY + rng.normal(0.0, _U_DELAY)
    return Truth(kind, seed, solid, height, mean_height, rig, specimen, tester, delay)


def _rig(rng: np.random.Generator, height: float, *, is_on_plate: bool) -> DropRig:
    best = DropRig()
    angle = np.deg2rad(_INCLINATION + rng.normal(0.0, _U_INCLINATION))
    # a sensor that shows too much by a factor is one that is inclined by less
    shown = float(np.cos(angle) * (1.0 + rng.normal(0.0, _U_SCALE)))
    stated = PLATE.mass, PLATE.frequency, PLATE.damping_ratio
    floor = Floor(*(rng.normal(*pair) for pair in zip(stated, _U_PLATE, strict=True)))
    return replace(
        best,
        radius=best.radius + rng.normal(0.0, _U_RADIUS),
        mass=best.mass + rng.normal(0.0, _U_MASS),
        sensor=LaserSensor(inclination=float(np.arccos(shown))),
        floor=floor if is_on_plate else RIGID,
        duration=round(_BEFORE + _FALLS * float(np.sqrt(2.0 * height / GRAVITY)) + _AFTER, 3),
        release=_BEFORE,
    )


def _indenter(rng: np.random.Generator, solid: Viscoelastic) -> tuple[Specimen, Tester]:
    stated = Specimen(solid)
    specimen = replace(
        stated,
        tip_radius=stated.tip_radius + rng.normal(0.0, _U_TIP),
        period=stated.period + rng.normal(0.0, _U_PERIOD),
        depth=stated.depth + rng.normal(0.0, _U_LENGTH),
        surface=stated.surface + rng.normal(0.0, _SURFACE),
    )
    gain = 1.0 / (1.0 + rng.normal(0.0, _U_GAIN))
    return specimen, replace(TESTER, force_gain=gain, force_offset=rng.normal(0.0, _TARE))


def write(truth: Truth, folder: Path) -> None:
    """Write the recordings, records and session.toml of a session; what is there stays.

    Parameters
    ----------
    truth : Truth
        From :func:`drawn`.
    folder : Path
        Of the session; one that holds a session.toml is taken as written.
    """
    if (folder / "session.toml").exists():
        return
    sections = _drop(truth, folder) if truth.kind == "drop" else _indentations(truth, folder)
    # written last: with it the session is complete
    files.write_text(folder / "session.toml", session_head("Random truth (synthetic)") + sections)


def _drop(truth: Truth, folder: Path) -> str:
    names = write_drops(folder, "drop", truth.rig, truth.solid, truth.mean_height, _REPEATS, 10 * truth.seed, _START)
    files.write_text(folder / "calibration/laser.toml", laser_record())
    extra = ""
    if truth.is_on_plate:
        mass, frequency, damping = _U_PLATE
        extra = (
            f'plate = {{ mass = "{PLATE.mass:g} ± {mass:g} kg", '
            f'frequency = "{PLATE.frequency:g} ± {frequency:g} Hz", '
            f'damping_ratio = "{PLATE.damping_ratio:g} ± {damping:g}" }}\n'
        )
    # of the library's material only Poisson's ratio is used
    return drop_section("drop", names, truth.height, "acrylic", extra)


def _indentations(truth: Truth, folder: Path) -> str:
    """Write one or two files on one specimen; only Poisson's ratio is used of the library's."""
    stated, is_joint = Specimen(truth.solid), truth.kind == "rubber"
    held = _SHORTER if is_joint else _HELD
    names = write_relaxation(folder, "relaxation", truth.specimen, held, truth.tester, 10 * truth.seed, _START)
    delay = f'"{truth.stated_delay:.4f} ± {_U_DELAY:g} ms"'
    record = cell_record().replace('"15.9 ± 0.2 ms"', delay)
    files.write_text(folder / "calibration/load_cell.toml", record)
    sections = relaxation_section("relaxation", names, stated)
    if not is_joint:
        return sections
    write_harmonic(
        folder, "harmonic", truth.specimen, _WAVES, truth.tester, 10 * truth.seed + 5, _START + timedelta(hours=1)
    )
    return sections + oscillation_section("harmonic", stated)


def recorded(folder: Path) -> list[dict[str, Any]]:
    """Return what the rig wrote of the truth of every recording, by name of the file."""
    found = sorted((folder / "truth").glob("*.json"))
    return [json.loads(path.read_text(encoding="utf-8")) for path in found]

"""Mistakes that laboratories make with a static loading: the edit, and what must be said."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe import files, materials
from labpipe.arrays import Floats
from pipelines.rig.session_text import laser_record, session_head
from pipelines.rig.static_loading import StaticRig, static_section, write_static
from tests.mistakes.drop_rows import Mistake
from tests.mistakes.recordings import Edit, setting, values

FILE = "laser/static.csv"
FILES = (FILE,)
RECORD = "calibration/laser.toml"
RIG = StaticRig()
START = datetime(2024, 5, 14, 9, 30)
_TOML = "session.toml"
_CYCLE = 5.0  # s


def write(folder: Path, seed: int = 21, material: str = "ptfe", rig: StaticRig = RIG) -> Path:
    """Write the clean session: PTFE under five loads in an hour."""
    file = write_static(folder, "static", rig, materials.load(material), seed, START)
    files.write_text(folder / RECORD, laser_record())
    text = session_head("Mistakes (synthetic)") + static_section("static", file, rig, material)
    files.write_text(folder / _TOML, text)
    return folder


def _ramp(way: float, begin: float, end: float) -> Callable[[Floats], Floats]:
    """Return what lets the reading drift by so much [mm] between two times [s], downwards positive."""

    def change(x: Floats) -> Floats:
        t = np.arange(x.size) * _CYCLE
        return x - way * np.clip((t - begin) / (end - begin), 0.0, 1.0)

    return change


def _mass(old: str, new: str) -> Edit:
    return setting(f'mass = "{old} ± 0.0005 kg"', f'mass = "{new}"')


def _all(*edits: Edit) -> Edit:
    def edit(folder: Path) -> None:
        for one in edits:
            one(folder)

    return edit


def _every_mass(change: Callable[[float], str]) -> Edit:
    return _all(*(_mass(f"{m:g}", change(m)) for m in RIG.masses))


def _line(mass: float) -> str:
    number = RIG.masses.index(mass)
    return f'  {{ mass = "{mass:g} ± 0.0005 kg", time = "{RIG.times[number] / 60:.2f} min" }},\n'


ROWS = (
    # loads
    Mistake("a load left out, times given", setting(_line(3.5), ""), "impossible", ("missing", "1098"), _TOML),
    Mistake("the third load 3.0 kg", _mass("3.5", "3.0 ± 0.0005 kg"), "impossible", ("load 3", "not 3 kg"), _TOML),
    Mistake("kg for g", _every_mass(lambda m: f"{1e3 * m:g} ± 0.5 kg"), "impossible", ("masses", "1000"), _TOML),
    Mistake("g for kg", _every_mass(lambda m: f"{m:g} ± 0.0005 g"), "impossible", ("masses", "factor of 1000"), _TOML),
    Mistake(
        "time of a load", setting('"18.20 min"', '"13.20 min"'), "impossible", ("time of load 3", "1098"), _TOML, "13.2"
    ),
    # sphere
    Mistake(
        "diameter for radius",
        setting('"9.525 ± 0.005 mm"', '"19.05 ± 0.005 mm"'),
        "doubtful",
        ("sphere.radius", "9.5", "diameter"),
        _TOML,
    ),
    Mistake("nylon is acrylic", setting('material = "ptfe"', 'material = "nbr"'), "impossible", ("stated sphere",)),
    # time
    # length
    # drift
    Mistake("warming under the third load", values(_ramp(6e-3, 1200.0, 1900.0), FILES), "impossible", ("load 3",)),
)

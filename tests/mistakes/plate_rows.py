"""Mistakes that laboratories make with a plate under drops: the edit, and what must be said."""

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe import files
from labpipe.arrays import Floats
from pipelines.rig.campaign import SMALL
from pipelines.rig.plate import PLATE_RIG
from pipelines.rig.plate_session import write_plate
from pipelines.rig.samples import session_head, sweeps
from pipelines.rig.session_text import from_dma, plate_laser_record
from tests.mistakes.drop_rows import Mistake
from tests.mistakes.recordings import Edit, cells, header, setting, values

ACRYLIC, PTFE = "laser_plate/plate_acrylic_1p5mm_1.csv", "laser_plate/plate_ptfe_5mm_1.csv"
ALL = (ACRYLIC, "laser_plate/plate_acrylic_5mm_1.csv", "laser_plate/plate_ptfe_1p5mm_1.csv", PTFE)
RECORD = "calibration/laser_plate.toml"
START = datetime(2024, 5, 14, 9, 30)
_TOML = "session.toml"
_CYCLE = "Sampling cycle,50us"
_SPHERE = "[experiments.plate.sphere]"


def write(folder: Path) -> Path:
    """Write the clean session: acrylic and PTFE from two heights, one recording of each."""
    rig = replace(PLATE_RIG, duration=0.12)
    text = write_plate(folder, rig, ("acrylic", "ptfe"), (1.5e-3, 5e-3), 1, START)
    text += sweeps(folder, "acrylic", "ptfe", "nbr", protocol=SMALL.dma)
    files.write_text(folder / RECORD, plate_laser_record())
    files.write_text(folder / _TOML, session_head("Mistakes (synthetic)") + text)
    return folder


def _exchanged(folder: Path) -> None:
    first, second = folder / ALL[0], folder / ALL[1]
    kept = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(kept)


def _second_in_um(folder: Path) -> None:
    """Add a second recording of one drop, whose header says another unit."""
    second = PTFE.replace("_1.csv", "_2.csv")
    (folder / second).write_bytes((folder / PTFE).read_bytes())
    noise = np.random.default_rng(4)
    values(lambda x: x + noise.normal(0.0, 3e-5, x.size), (second,), decimals=5)(folder)
    header("Unit,mm", "Unit,um", (second,))(folder)
    setting(f'"{PTFE}",', f'"{PTFE}",\n  "{second}",')(folder)


def _height(material: str, old: str, new: str) -> Edit:
    named = f'material = "{material}"\n{from_dma(material)}height = '
    return setting(f'{named}"{old} ', f'{named}"{new} ')


def _upside_down(x: Floats) -> Floats:
    return 2 * x[0] - x


def _scaled(k: float) -> Callable[[Floats], Floats]:
    return lambda x: x[0] + k * (x - x[0])


def _changed(change: Callable[[Floats], Floats], names: tuple[str, ...] = ALL) -> Edit:
    return values(change, names, decimals=5)


def _jump(x: Floats) -> Floats:
    return x + 0.02 * (np.arange(x.size) > 1500)


def _noise(x: Floats) -> Floats:
    return x[0] + np.random.default_rng(1).normal(0.0, 3e-4, x.size)


def _clipped(x: Floats) -> Floats:
    """Cut the lower half of the ringing off."""
    return np.maximum(x, np.median(x) - 0.003)


def _ends_early(folder: Path) -> None:
    cells(lambda texts: texts[:1000], (PTFE,))(folder)


def _struck(x: Floats) -> Floats:
    """Let the table ring from 5 ms on, before the blow."""
    since = np.clip(np.arange(x.size) - 100, 0, None) * 50e-6
    return np.asarray(x + 4e-3 * np.exp(-since / 4e-3) * np.sin(2 * np.pi * 300 * since))


def _struck_lightly(x: Floats) -> Floats:
    """Let a hit of a tenth of the blow follow it by 8 ms."""
    since = np.arange(x.size) * 50e-6 - 60.6e-3
    return x + np.where(since > 0, 1e-3 * np.exp(-since / 0.02) * np.sin(2 * np.pi * 390 * since), 0.0)


def _ten_times(folder: Path) -> None:
    for old, new in (("1.5", "15"), ("5", "50")) * 2:
        setting(f'height = "{old} ±', f'height = "{new} ±')(folder)


ROWS = (
    Mistake("table struck before the blow", _changed(_struck, (PTFE,)), "impossible", ("struck the bench",), PTFE),
    Mistake(
        "table struck lightly while the plate rings",
        _changed(_struck_lightly, (PTFE,)),
        "note",
        ("struck the plate or its table lightly",),
        PTFE,
    ),
    Mistake(
        "hum of 180 Hz under all readings",
        _changed(lambda x: x + 3e-4 * np.sin(2 * np.pi * 180 * 50e-6 * np.arange(x.size))),
        "doubtful",
        ("swing at 1", "another sensor, a lamp or a supply"),
        ACRYLIC,
    ),
    Mistake("all heights ten times", _ten_times, "doubtful", ("stated too large", "60.0 ms"), _TOML, "15 ±"),
    # what the session states
    Mistake("height 50 for 5 mm", _height("ptfe", "5", "50"), "impossible", ("height of ptfe", "drops[3]"), _TOML),
    Mistake("height 15 for 1.5 mm", _height("acrylic", "1.5", "15"), "impossible", ("height of acrylic",), _TOML),
    Mistake("height 10 for 5 mm", _height("acrylic", "5", "10"), "impossible", ("height of acrylic",), _TOML),
    Mistake("uncertainty 5 mm", setting("5 ± 0.005 mm", "5 ± 5 mm"), "doubtful", ("uncertainty",), _TOML),
    Mistake("acrylic is said to be rubber", setting('"acrylic_dma"', '"nbr_dma"'), "impossible", (), _TOML),
    Mistake(
        "mass ten times too large", setting("505.0 ± 0.5 g", "5.05 ± 0.005 kg"), "doubtful", ("sphere.mass",), _TOML
    ),
    Mistake("mass in kg", setting("505.0 ± 0.5 g", "505.0 ± 0.5 kg"), "impossible", ("sphere.mass",), _TOML),
    Mistake("mass in mg", setting("505.0 ± 0.5 g", "505.0 ± 0.5 mg"), "impossible", ("sphere.mass",), _TOML),
    Mistake(
        "radius in cm", setting('"9.525 ± 0.005 mm"', '"9.525 ± 0.005 cm"'), "impossible", ("sphere.radius",), _TOML
    ),
    Mistake(
        "radius with a slipped decimal",
        setting('"9.525 ±', '"0.9525 ±'),
        "doubtful",
        ("radius is probably 9.5",),
        _TOML,
    ),
    Mistake(
        "mass of the ball without its holder",
        setting("505.0 ± 0.5 g", "28.20 ± 0.05 g"),
        "doubtful",
        ("moving mass is probably",),
        _TOML,
    ),
    Mistake(
        "direction reversed",
        setting(_SPHERE, f"[experiments.plate.sensor]\ndirection = -1\n\n{_SPHERE}"),
        "impossible",
        ("direction",),
        _TOML,
    ),
    # time
    Mistake("cycle 100 for 50 us", header(_CYCLE, "Sampling cycle,100us", ALL), "impossible", ("sampling interval",)),
    Mistake("cycle 20 for 50 us", header(_CYCLE, "Sampling cycle,20us", ALL), "impossible", ("sampling interval",)),
    Mistake(
        "cycle 100 for 50 us in one file",
        header(_CYCLE, "Sampling cycle,100us", (PTFE,)),
        "impossible",
        ("sampling interval",),
        PTFE,
    ),
    Mistake("60 rows lost", cells(lambda t: t[:1200] + t[1260:], (PTFE,)), "impossible", (), PTFE),
    Mistake("pasted together", cells(lambda t: t + t, (PTFE,)), "impossible", ("twice",), PTFE),
    Mistake("begins after the blow", cells(lambda t: t[1100:], (PTFE,)), "impossible", (), PTFE),
    Mistake("ends after the blow", cells(lambda t: t[:1120], (PTFE,)), "impossible", ("ends",), PTFE),
    # length
    Mistake("unit um", header("Unit,mm", "Unit,um", ALL), "doubtful", ("unit",), _TOML),
    Mistake(
        "unit um in one file", header("Unit,mm", "Unit,um", (PTFE,)), "impossible", ("unit", "factor of 1000"), PTFE
    ),
    Mistake("unit um in one of two repeats", _second_in_um, "impossible", ("factor 1000", "unit")),
    Mistake("display x10 in one file", _changed(_scaled(10.0), (PTFE,)), "impossible", ("10 times",), PTFE),
    Mistake("record expired", setting("2025-04-30", "2024-05-05", RECORD), "impossible", ("calibration record",)),
    Mistake(
        "inclination 50 for 5 deg",
        setting('"5.00 ±', '"50.0 ±', RECORD),
        "doubtful",
        ("inclination", "lost decimal point"),
        RECORD,
        13,
    ),
    # sensor
    Mistake("upside down readings", _changed(_upside_down), "impossible", ("direction",)),
    Mistake("noise only", _changed(_noise, (PTFE,)), "impossible", ("no ringing",), PTFE),
    Mistake("constant", _changed(lambda x: np.full(x.size, x[0]), (PTFE,)), "impossible", ("channel",), PTFE),
    Mistake("clipped below", _changed(_clipped, (PTFE,)), "impossible", ("equal readings", "clipped"), PTFE),
    Mistake("record ends before the blow", _ends_early, "impossible", ("ends before the impact",), PTFE),
    Mistake("level jump", _changed(_jump, (PTFE,)), "impossible", ("jump",), PTFE),
    # recordings
    Mistake("two heights exchanged", _exchanged, "impossible", ("height",)),
)

"""Mistakes that laboratories make with a plate under drops: the edit, and what must be said."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np

from labpipe import files
from labpipe.arrays import Floats
from pipelines.rig.campaign import SMALL
from pipelines.rig.dma import sweeps
from pipelines.rig.plate import PLATE_RIG
from pipelines.rig.session_text import from_dma, plate_laser_record, session_head
from tests.mistakes.drop_rows import Mistake
from tests.mistakes.recordings import Edit, header, setting, values
from tests.pipelines.small import write_plate

ACRYLIC, PTFE = "laser_plate/plate_acrylic_1p5mm_1.csv", "laser_plate/plate_ptfe_5mm_1.csv"
ALL = (ACRYLIC, "laser_plate/plate_acrylic_5mm_1.csv", "laser_plate/plate_ptfe_1p5mm_1.csv", PTFE)
RECORD = "calibration/laser_plate.toml"
START = datetime(2024, 5, 14, 9, 30)
_TOML = "session.toml"


def write(folder: Path) -> Path:
    """Write the clean session: acrylic and PTFE from two heights, one recording of each."""
    rig = replace(PLATE_RIG, duration=0.12)
    text = write_plate(folder, rig, ("acrylic", "ptfe"), (1.5e-3, 5e-3), 1, START)
    text += sweeps(folder, "acrylic", "ptfe", "nbr", protocol=SMALL.dma)
    files.write_text(folder / RECORD, plate_laser_record())
    files.write_text(folder / _TOML, session_head("Mistakes (synthetic)") + text)
    return folder


def _exchanged(one: int, other: int) -> Edit:
    def edit(folder: Path) -> None:
        first, second = folder / ALL[one], folder / ALL[other]
        kept = first.read_bytes()
        first.write_bytes(second.read_bytes())
        second.write_bytes(kept)

    return edit


def _struck(x: Floats) -> Floats:
    """Let the record begin again, stronger, before its end."""
    late, x = int(0.85 * x.size), x - x[0]
    first = int(np.argmax(np.abs(x) > 0.3 * np.abs(x).max()))
    x[late:] += 1.5 * x[first - 20 : first - 20 + x.size - late]
    return x


def _height(material: str, old: str, new: str) -> Edit:
    named = f'material = "{material}"\n{from_dma(material)}height = '
    return setting(f'{named}"{old} ', f'{named}"{new} ')


ROWS = (
    # what the session states
    Mistake("height 50 for 5 mm", _height("ptfe", "5", "50"), "impossible", ("height of ptfe", "drops no. 4"), _TOML),
    Mistake("acrylic is said to be rubber", setting('"acrylic_dma"', '"nbr_dma"'), "impossible", (), _TOML),
    Mistake(
        "mass ten times too large", setting("505.0 ± 0.5 g", "5.05 ± 0.005 kg"), "doubtful", ("sphere.mass",), _TOML
    ),
    Mistake("mass in kg", setting("505.0 ± 0.5 g", "505.0 ± 0.5 kg"), "impossible", ("sphere.mass",), _TOML),
    # time
    Mistake("cycle doubled in one", header("cycle,50us", "cycle,25us", (PTFE,)), "impossible", ("interval of", PTFE)),
    # length
    Mistake("unit um", header("Unit,mm", "Unit,um", ALL), "doubtful", ("unit",), _TOML),
    # recordings
    Mistake("head upside down", values(lambda x: 2 * x[0] - x, (ACRYLIC,), 5), "impossible", ("sign of",), ACRYLIC),
    Mistake("table struck", values(_struck, (PTFE,), 5), "doubtful", ("something else struck",), PTFE),
    Mistake("two heights exchanged", _exchanged(0, 1), "impossible", ("recordings of acrylic, 1.5 mm", "exchanged")),
    Mistake("two materials exchanged", _exchanged(0, 2), "doubtful", ("ptfe, 1.5 mm", "exchanged")),
)

"""The small synthetic session that the tests of the pipelines share."""

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

from labpipe import files, materials
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.indentations import Harmonic, Specimen, oscillation_section, write_harmonic
from pipelines.rig.mach1_tester import Tester
from pipelines.rig.plate import plate_section, write_ringing
from pipelines.rig.samples import STATED_FLOOR
from pipelines.rig.session_text import drop_section, laser_record, session_head

START = datetime(2024, 5, 14, 9, 30)


def write_small(folder: Path) -> Path:
    """Two drops of acrylic over 0.15 s and a short indentation of NBR; not processed."""
    rig = DropRig(duration=0.15)
    names = write_drops(folder, "drop", rig, materials.load("acrylic"), 1.5e-3, 2, 11, START)
    specimen = Specimen(materials.load("nbr"))
    protocol = Harmonic(hold=5.0, frequencies=(1.0, 2.0), cycles=7)
    write_harmonic(folder, "nbr", specimen, protocol, Tester(), 5, START)
    files.write_text(folder / "calibration/laser.toml", laser_record())
    text = session_head("Small (synthetic)") + drop_section("drop", names, 1.5e-3, "acrylic", STATED_FLOOR)
    files.write_text(folder / "session.toml", text + oscillation_section("nbr", specimen, is_calibrated=False))
    return folder


def write_plate(
    folder: Path, rig: DropRig, names: Sequence[str], heights: Sequence[float], repeats: int, start: datetime
) -> str:
    """Record the plate under drops from heights [m]; returns its section, which needs the DMA of the solids."""
    drops = []
    for number, material in enumerate(names):
        for place, height in enumerate(heights):
            begun = start + timedelta(minutes=20 * (number * len(heights) + place))
            seed = 90_000 + 1000 * sum(map(ord, material)) + 100 * place
            drops.append(write_ringing(folder, rig, material, height, repeats, seed, begun))
    return plate_section(drops)

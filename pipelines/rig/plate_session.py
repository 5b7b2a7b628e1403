"""A synthetic session with the ringing plate, and a drop whose model takes the plate from it."""

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

from pipelines.rig.fall import DropRig
from pipelines.rig.plate import write_ringing
from pipelines.rig.session_text import from_dma


def write_plate(
    folder: Path, rig: DropRig, names: Sequence[str], heights: Sequence[float], repeats: int, start: datetime
) -> str:
    """Record the plate under drops of solids of the rig from heights [m], the first at ``start``; returns its section.

    The solids are those of DMA experiments, which the session must hold.
    """
    drops = []
    for number, material in enumerate(names):
        for place, height in enumerate(heights):
            begun = start + timedelta(minutes=20 * (number * len(heights) + place))
            seed = 90_000 + 1000 * sum(map(ord, material)) + 100 * place
            drops.append(write_ringing_of(folder, rig, material, height, repeats, seed, begun))
    return plate_section(drops)


def write_ringing_of(
    folder: Path, rig: DropRig, material: str, height: float, repeats: int, seed: int, start: datetime
) -> str:
    """Record the plate under repeated drops of one material and height; returns their table."""
    stem = f"plate_{material}_{height * 1e3:g}mm".replace(".", "p")
    recordings = write_ringing(folder, stem, rig, material, height, repeats, seed, start)
    listed = "".join(f'  "{name}",\n' for name in recordings)
    return f"""
[[experiments.plate.drops]]
material = "{material}"
{from_dma(material)}height = "{height * 1e3:g} ± 0.005 mm"
laser = [
{listed}]
"""


def plate_section(drops: Sequence[str]) -> str:
    """Return the tables of the plate's vibration in session.toml."""
    return f"""
[experiments.plate]
kind = "plate_vibration"
calibration = "calibration/laser_plate.toml"

[experiments.plate.sphere]
radius = "9.525 ± 0.005 mm"
mass = "505.0 ± 0.5 g"
{"".join(drops)}"""

"""Text that ``init`` writes for indentations by a punch."""

from pathlib import Path

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals

_BLOCKS = ("Sinusoid", "Stress Relaxation")


def blocks(path: Path) -> set[str]:
    """Return which of the blocks that make an experiment a Mach-1 file holds."""
    data = path.read_bytes()
    return {name for name in _BLOCKS if f"<{name}>".encode() in data}


def tables(found: Found, head: str, name: str) -> str:
    """Return the tables of an experiment that begins with some lines."""
    record = next(iter(found.of("record:load_cell")), None)
    word = proposals.material_word(name) or "nbr"
    measured = proposals.dma_of(word, found)
    solid = f'material = "{word}"' if measured is None else f'material_from = "{measured}"'
    cell = "" if record is None else f'\n[experiments.{name}.load_cell]\nrecord = "{record}"'
    return f"""[experiments.{name}]
{head}
# For the simulation, state punch and substrate:
# [experiments.{name}.punch]
# radius = "2 mm"      # of a cylindrical tip
# period = "8 mm"      # distance of neighbouring tips
# depth = "6 mm"       # length of one tip
# tips = 3
# [experiments.{name}.substrate]
# {solid}{cell}"""

"""Mistakes that only a session as a whole can tell, each as an edit of its folder."""

from datetime import timedelta
from pathlib import Path

from labpipe import files, materials
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.samples import STATED_FLOOR
from pipelines.rig.session_text import drop_section, laser_record, session_head
from tests.mistakes.drop_rows import RECORD, START
from tests.mistakes.recordings import Edit, setting
from tests.mistakes.rows import Mistake

TOML, STEPS = "session.toml", "references and processing steps"
_FIRST, _SECOND = "laser/acrylic_low_1.csv", "laser/acrylic_high_1.csv"
_PAIR = f'laser = [\n  "{_FIRST}",\n'


def write(folder: Path) -> Path:
    """Write the clean session: acrylic from three heights, PTFE from one; a recording each."""
    rig, text = DropRig(duration=0.08), session_head("Mistakes of a session (synthetic)")
    drops = (("acrylic_low", "acrylic", 1.5e-3), ("acrylic_high", "acrylic", 1.7e-3), ("acrylic_top", "acrylic", 2e-3))
    for number, (name, material, height) in enumerate((*drops, ("ptfe_low", "ptfe", 1.5e-3))):
        start = START + timedelta(minutes=20 * number)
        names = write_drops(folder, name, rig, materials.load(material), height, 1, 40 + number, start)
        text += drop_section(name, names, height, material, STATED_FLOOR)
    files.write_text(folder / RECORD, laser_record())
    files.write_text(folder / TOML, text)
    return folder


def _named(name: str) -> Edit:
    """Let the second experiment name the first one's recording in another way."""
    return setting(f'"{_SECOND}"', f'"{name}"')


def _copied(folder: Path) -> None:
    (folder / _SECOND).write_bytes((folder / _FIRST).read_bytes())


def _another(folder: Path) -> None:
    write_drops(folder, "forgotten", DropRig(duration=0.08), materials.load("acrylic"), 3e-3, 1, 77, START)


def _in(experiment: str, old: str, new: str) -> Edit:
    """Replace a text behind the head of an experiment."""

    def edit(folder: Path) -> None:
        head, mark, tail = (folder / TOML).read_text("utf-8").partition(f"[experiments.{experiment}]")
        assert old in tail
        (folder / TOML).write_text(head + mark + tail.replace(old, new, 1), "utf-8")

    return edit


_TWICE, _BODY, _UNUSED = "same bytes twice", "one body, two values", "files that no experiment uses"
_RADIUS = "9.525 ± 0.005 mm"
_PTFE, _HEAVY = 'material = "ptfe"', _in("acrylic_high", "505.0 ± 0.5 g", "5.05 ± 0.005 kg")
_KELVIN = _in("acrylic_top", f'{_RADIUS}"', f'{_RADIUS}"\ntemperature = "293.2 degC"')
_COPIED = _in("ptfe_low", _PTFE, 'material = "acrylic"')
_MISSPELT, _KNOWN = _in("ptfe_low", _PTFE, 'material = "pfte"'), ("pfte", "misspelt", "known are nbr, acrylic")
_DIAMETER = _in("acrylic_top", _RADIUS, "19.05 ± 0.005 mm")
_EXPIRED = setting("2025-04-30", "2024-05-10", RECORD)
_INSTRUMENT = setting("LK-G5001", "LK-G3001", RECORD)

ROWS = (
    Mistake("copy under another name", _copied, "doubtful", ("same bytes", "copy"), _SECOND, None, _TWICE),
    Mistake("recording of another experiment", _named(_FIRST), "doubtful", ("acrylic_low",), _FIRST, None, _TWICE),
    Mistake("listed twice", setting(_PAIR, f'{_PAIR}  "{_FIRST}",\n'), "refused", ("twice",), TOML),
    Mistake("recording forgotten", _another, "note", ("forgotten_1.csv",), "laser/forgotten_1.csv", None, _UNUSED),
    Mistake("one mass 5.05 kg", _HEAVY, "doubtful", ("505.0 g", "a factor 10"), TOML, "5.05", _BODY),
    Mistake("one radius is the diameter", _DIAMETER, "doubtful", ("9.525", "diameter"), TOML, "19.05", _BODY),
    Mistake("kelvin for degrees", _KELVIN, "doubtful", ("293.2 K = 20",), TOML, "293.2", "unit of the temperature"),
    Mistake("material copied", _COPIED, "doubtful", ("ptfe",), TOML, 'material = "acrylic"', "name of the material"),
    Mistake("name of a material misspelt", _MISSPELT, "impossible", _KNOWN, TOML, '"pfte"', STEPS),
    Mistake("record expired", _EXPIRED, "impossible", ("expired",), RECORD, "valid_until", STEPS),
    Mistake("record of another instrument", _INSTRUMENT, "impossible", ("LK-G3001",), RECORD, "instrument", STEPS),
)

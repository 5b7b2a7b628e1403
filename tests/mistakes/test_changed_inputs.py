"""Inputs of a session changed one at a time: the true cause is named first."""

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from pipelines.session import Verdict
from tests.mistakes.recordings import setting
from tests.mistakes.rows import judged

SAMPLE = Path(__file__).parents[2] / "sample_data/thesis-small"
TOML = "session.toml"
LASER, UNDER, FRONT = (f"calibration/{name}.toml" for name in ("laser", "camera_under", "camera_front"))


@dataclass(frozen=True, slots=True)
class Change:
    """One change of the session; the first cause on the experiment must contain one of the words."""

    name: str
    experiment: str
    edit: Callable[[Path], None]
    words: tuple[str, ...]


def _stated(experiment: str, key: str, value: str) -> Callable[[Path], None]:
    """Return what states another value in the tables of an experiment."""

    def edit(folder: Path) -> None:
        text = (folder / TOML).read_text("utf-8")
        begin = text.index(f"[experiments.{experiment}]")
        changed, count = re.subn(rf'(?m)^{key} = ".*"', f'{key} = "{value}"', text[begin:], count=1)
        assert count == 1
        (folder / TOML).write_text(text[:begin] + changed, "utf-8")

    return edit


def _exchanged(*pairs: tuple[str, str]) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        for first, second in pairs:
            a, b = (folder / "laser" / f"{name}.csv" for name in (first, second))
            kept = a.read_bytes()
            a.write_bytes(b.read_bytes())
            b.write_bytes(kept)

    return edit


CHANGES = (
    Change("height of a drop", "nylon_1p5mm", _stated("nylon_1p5mm", "height", "1.6 ± 0.005 mm"), ("drop height",)),
    Change(
        "height of a film", "acrylic_1p5mm_film", _stated("acrylic_1p5mm_film", "height", "2 ± 0.005 mm"), ("height",)
    ),
    Change("angle of the laser", "peek_1p5mm", setting("12.00 ±", "14.00 ±", LASER), ("inclination",)),
    Change("scale under the disc", "acrylic_1p5mm_film", setting("461 ±", "440 ±", UNDER), ("scale",)),
    Change("scale of the front view", "ptfe_film", setting("386 ±", "394 ±", FRONT), ("scale",)),
    Change("polymer", "peek_1p5mm", _stated("peek_1p5mm", "material_from", "nylon_dma"), ("of peek_dma",)),
    Change(
        "temperature of a drop",
        "acrylic_1p5mm_39C",
        _stated("acrylic_1p5mm_39C", "temperature", "20.0 ± 0.5 degC"),
        ("temperature",),
    ),
    Change(
        "temperature of a film",
        "acrylic_1p5mm_39C_film",
        _stated("acrylic_1p5mm_39C_film", "temperature", "20.0 ± 0.5 degC"),
        ("temperature",),
    ),
    Change(
        "one repeat exchanged",
        "nylon_1p5mm",
        _exchanged(("nylon_1p5mm_2", "ptfe_1p5mm_2")),
        ("another drop", "another height or another body"),
    ),
    Change(
        "all files exchanged",
        "nylon_1p5mm",
        _exchanged(("nylon_1p5mm_1", "ptfe_1p5mm_1"), ("nylon_1p5mm_2", "ptfe_1p5mm_2")),
        ("of ptfe_dma",),
    ),
    Change("mass", "ptfe_1p5mm", _stated("ptfe_1p5mm", "mass", "455.0 ± 0.5 g"), ("mass",)),
    Change("digit", "nylon_1p5mm", _stated("nylon_1p5mm", "mass", "305.0 ± 0.5 g"), ("mass is 305.0 g here (line",)),
    Change("tip", "nbr_relaxation", _stated("nbr_relaxation", "radius", "4 ± 0.002 mm"), ("radius is 4.000 mm here",)),
)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The session as it is; an experiment is processed when it is first asked for."""
    folder = tmp_path_factory.mktemp("changed") / "session"
    shutil.copytree(SAMPLE, folder)
    return folder


def _first(found: Verdict) -> str:
    return found.cause or next(iter(found.suspects), "")


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.name)
def test_the_true_cause_is_named_first(session: Path, tmp_path: Path, change: Change) -> None:
    unchanged = judged(session, "judgement", experiment=change.experiment)
    assert (unchanged.believable, unchanged.model) == ("yes", "agrees"), unchanged
    folder = tmp_path / "session"
    shutil.copytree(session, folder)
    change.edit(folder)
    found = judged(folder, "judgement", experiment=change.experiment)
    assert found.believable != "yes" or found.model == "differs"
    assert any(word in _first(found) for word in change.words), (_first(found), found.suspects)

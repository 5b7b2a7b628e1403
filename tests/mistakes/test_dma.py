"""Mistakes of a laboratory with a rheometer are noticed and named; a foreign shift table too."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from labpipe import files
from pipelines.rig.solids import SOLIDS
from pipelines.session import Verdict
from tests.mistakes.dma_rows import FIRST, ROWS, TOML, write
from tests.mistakes.rows import Mistake, hold, judged


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean session, read."""
    folder = write(tmp_path_factory.mktemp("clean"))
    judged(folder, "readings")
    return folder


def test_clean_session_is_believed(clean: Path) -> None:
    found = judged(clean, "readings")
    assert (found.believable, found.findings) == ("yes", ())
    assert 6 < found.checks <= 12


@pytest.mark.parametrize("mistake", ROWS, ids=lambda row: row.name)
def test_mistake_is_noticed_and_named(clean: Path, tmp_path: Path, mistake: Mistake) -> None:
    hold(clean, tmp_path / "session", mistake, "readings")


@pytest.fixture(scope="module")
def attached(clean: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Verdict]:
    """Judge the clean session with the shifts of a solid attached as a published table."""
    folder = tmp_path_factory.mktemp("attached") / "session"
    shutil.copytree(clean, folder)
    given = (folder / TOML).read_text("utf-8")

    def judge(material: str, name: str) -> Verdict:
        shifts = [(T, float(SOLIDS[material].log10_aT(T))) for T in (-40.0, -20.0, 0.0, 20.0, 40.0)]
        rows = "".join(f"{T:g},{a:.4f}\n" for T, a in shifts)
        files.write_text(folder / name, f"T,log_aT\nC,-\n{rows}")
        table = f'\n[experiments.acrylic.published]\nshifts = "{name}"\n'
        files.write_text(folder / TOML, given + table)
        return judged(folder, "published")

    return judge


def test_a_shift_table_of_another_material_is_named(attached: Callable[[str, str], Verdict]) -> None:
    """By what it makes of the readings, and by its name."""
    assert attached("acrylic", "shifts.csv").believable == "yes"
    by_readings = attached("nbr", "shifts.csv")
    assert by_readings.believable == "doubtful"
    (told,) = by_readings.findings
    assert (told.check, told.file) == ("superposition", TOML)
    assert "another material" in told.cause
    by_name = attached("acrylic", "ptfe_shifts.csv")
    assert [f.check for f in by_name.findings] == ["name of the material"]
    assert FIRST not in by_name.findings[0].message

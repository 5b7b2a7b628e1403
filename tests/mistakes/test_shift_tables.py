"""A table of shifts of another material is named."""

from collections.abc import Callable

import pytest

from labpipe import files
from pipelines.rig.solids import SOLIDS
from pipelines.session import Verdict
from tests.mistakes.dma_rows import FIRST, TOML, write
from tests.mistakes.rows import judged


@pytest.fixture(scope="module")
def attached(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, str], Verdict]:
    """Judge the clean session with the shifts of a solid attached as a published table."""
    folder = write(tmp_path_factory.mktemp("attached"))
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

"""Questions for what no file tells, and what is done with the answers."""

import shutil
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from calibration import load_record
from labpipe.errors import InputError
from pipelines.commands.session import init as command
from pipelines.session import Gap, checked, init, open_session, process
from pipelines.session._gaps import filled, gaps


@pytest.mark.parametrize(
    ("key", "unit", "answer", "words"),
    [
        ("radius", "mm", "9.525 g", 'expected for example "12.3 ± 0.1 mm", found "9.525 g"'),
        ("material", "", "steel", "acrylic, nbr, nylon, peek, ptfe"),
        ("mode", "", "tensile", "tension, bending, shear, torsion"),
        ("who", "", 'A "Person"', "without quotes"),
        ("when", "", "14.05.2024", 'expected a day such as 2024-05-14, found "14.05.2024"'),
    ],
)
def test_an_answer_that_does_not_fit_says_what_would(key: str, unit: str, answer: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        checked(Gap(1, "t", key, unit, ""), answer)
    assert words in str(caught.value)


def test_a_specimen_is_asked_for_once_and_nothing_of_it_is_offered_for_another() -> None:
    lines = {"a": 'material_from = "pmma_dma"', "b": 'material = "FILL"', "c": 'material = "ptfe"'}
    spheres = [f'[experiments.{name}.sphere]\nradius = "FILL mm"\n{line}\n' for name, line in lines.items()]
    asked: list[Gap] = []

    def answer(gap: Gap) -> str | None:
        asked.append(gap)
        return {"material": "acrylic", "nu": None}.get(gap.key, f"{len(asked)} mm")

    dma = '[experiments.dma]\nnu = "FILL"\n[experiments.dma2]\nnu = "FILL"\n'
    tables = tomllib.loads(filled({"session.toml": "".join(spheres) + dma}, answer)["session.toml"])["experiments"]
    assert [f"{gap.key} {gap.number}/{gap.of}" for gap in asked] == [
        "material 1/6", "radius 2/5", "radius 3/5", "nu 4/5", "nu 5/5",
    ]  # fmt: skip
    assert asked[1].table == "sphere of acrylic, in a, b"
    assert [tables[name]["sphere"]["radius"] for name in "abc"] == ["2 mm", "2 mm", "3 mm"]
    assert tables["dma"] == tables["dma2"] == {"nu": "FILL"}


@pytest.fixture
def pile(small_session: Path, tmp_path: Path) -> Path:
    """Two laser exports in a folder, without a record of the laser."""
    for number in (1, 2):
        name = f"acrylic_1p5mm_{number}.csv"
        shutil.copy(small_session / f"laser/drop_{number}.csv", tmp_path / name)
    return tmp_path


def test_answered_questions_make_a_session_that_processes(pile: Path) -> None:
    answers = ["9.525 cubits", "9.525 ± 0.005", "505 ± 0.5", "A. Person", "micrometer",
               "12.0 ± 0.1"]  # fmt: skip
    found = init(pile)
    assert [gap.key for gap in gaps(found.path.read_text("utf-8"))] == ["radius", "mass"]
    assert found.records == [pile / "calibration/laser.toml"]
    record = found.records[0].read_text("utf-8")
    assert ('instrument = "LK-G5001"' in record, "valid_from = 2024-05-14" in record) == (True, True)
    done = CliRunner().invoke(command, [str(pile), "--force", "--ask"], input="\n".join(answers) + "\n")
    assert done.exit_code == 0, done.output
    assert "cubits" in done.output
    assert "to fill in" not in done.output
    session = open_session(pile)
    assert list(session.experiments) == ["acrylic_1p5mm"]
    assert load_record(pile / "calibration/laser.toml").who == "A. Person"
    assert process(pile, ["displacement"], jobs=0).exit_code == 0

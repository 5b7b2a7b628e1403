"""Mistakes with relaxation tests, as laboratories make them: level, cause and line."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec
import pytest

from labpipe import files, materials
from labpipe.judging import Judgement
from labpipe.units import Quantity
from pipelines.experiments.relaxation import checks, measured
from pipelines.experiments.shared import judgements, mach1_readings
from pipelines.process import open_session, process, result
from pipelines.rig.indentation_session import relaxation_section
from pipelines.rig.indentations import Specimen
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.session_text import cell_record, session_head
from tests.pipelines.mach1_mistakes import WRONG_COLUMNS, Row, Steps, columns, line_of, said

START = datetime(2024, 5, 14, 9, 30)
RECORD = "calibration/load_cell.toml"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two depths in NBR with a record of the cell; not processed."""
    folder = tmp_path_factory.mktemp("checks")
    specimen = Specimen(materials.load("nbr"))
    names = write_relaxation(folder, "nbr", specimen, Relaxation(depths=(1e-4, 2e-4), hold=12.0), TESTER, 41, START)
    files.write_text(folder / RECORD, cell_record())
    text = session_head("Relaxation (synthetic)") + relaxation_section("nbr", names, specimen)
    files.write_text(folder / "session.toml", text + "elements = 512\n")
    return folder


@pytest.fixture
def judge(session: Path, tmp_path: Path) -> Callable[..., Judgement]:
    """Judge both files after an edit of the text of the first, or of the punch, without a model."""
    given = open_session(session).experiments["nbr"].settings

    def judged(text: str | None = None, **punch: Any) -> Judgement:
        settings = given
        if punch:
            settings = msgspec.structs.replace(given, punch=msgspec.structs.replace(given.punch, **punch))
        step = Steps()
        found: list[list[Any]] = [[], [], []]
        for number, name in enumerate(given.mach1):
            path = tmp_path / name
            is_edited = text is not None and number == 0
            files.write_text(path, text if is_edited and text else (session / name).read_text("utf-8"))

            def of(path: Path = path) -> Any:
                return mach1_readings.readings(path)

            readings = step("readings", of, name)
            loads = step("loads", lambda r=readings: measured.loads(r, session / RECORD, settings=settings), name)
            ramps = None
            if loads is not None:
                ramps = step("ramps", lambda one=loads: measured.ramps(one, settings=settings), name)
            for results, made in zip(found, (readings, loads, ramps), strict=True):
                results.append(made)
        context = step.context("relaxation")
        made = checks.judgement(*found, None, None, settings=settings, context=context)
        return judgements.believed(made)

    return judged


@pytest.fixture
def text(session: Path) -> str:
    return (session / open_session(session).experiments["nbr"].settings.mach1[0]).read_text("utf-8")


@pytest.fixture(scope="module")
def processed(session: Path) -> Path:
    outcome = process(session, jobs=0)
    assert outcome.exit_code == 0, [o.message for o in outcome.failures]
    return session


def test_clean_tests_are_believed_and_their_model_agrees(processed: Path) -> None:
    made = result(processed, "nbr", "judgement")
    judged = judgements.believed(made)
    assert (judged.believable, said(judged)) == ("yes", "")
    assert made.attrs["model"] == "agrees"
    assert 8 < judged.n_made <= 13
    assert float(made["detectable"].sel(input="modulus of the rubber")) < 0.02
    assert "the model agrees" in (processed / "labpipe/reports/nbr.html").read_text("utf-8")


@pytest.mark.parametrize("tips", [30])
def test_thirty_tips_are_told_by_the_force_of_the_named_material(processed: Path, tips: int) -> None:
    """The model then expects ten times the force."""
    given = open_session(processed).experiments["nbr"].settings
    stages = ("readings", "loads", "ramps", "comparison")
    parts = [[result(processed, "nbr", stage, name) for name in given.mach1] for stage in stages]
    for compared in parts[3]:
        compared["plateau_force_model"] = compared["plateau_force_model"] * 10
    wrong = msgspec.structs.replace(given, punch=msgspec.structs.replace(given.punch, tips=tips))
    context = Steps().context("relaxation")
    judged = judgements.believed(checks.judgement(*parts, None, settings=wrong, context=context))
    assert judged.believable == "doubtful"
    found = next(c for c in judged.checks if c.level and c.name == "force for the named material")
    assert "number of tips is probably 3" in found.cause


def test_clean_files_are_believed(judge: Callable[..., Judgement]) -> None:
    judged = judge()
    assert (judged.believable, said(judged)) == ("yes", "")


@pytest.mark.parametrize(
    ("change", "words"),
    [*WRONG_COLUMNS, (lambda t, x, f: (t, x, f - 0.3 * t if t > 2.0 else f), "a force in a hold falls")],
)
def test_a_wrong_column_is_told(
    change: Callable[[float, float, float], Row], words: str, judge: Callable[..., Judgement], text: str
) -> None:
    judged = judge(columns(text, change))
    assert judged.believable == "impossible"
    first = next((f for f in judged.findings if words in f.cause), None)
    assert first is not None, said(judged)
    assert "100um" in first.file
    assert "Time, s" in text.splitlines()[(first.line or 0) - 1]


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("Amplitude, mm:\t0.0980", "Amplitude, mm:\t0.9800", "the declared amplitude is 10 times too large"),
        ("\nVelocity, mm/s:\t1.0000", "\nVelocity, mm/s:\t0.1000", "declared velocity is too small by a factor of 10"),
    ],
)
def test_a_wrong_declaration_is_told_with_its_line(
    right: str, wrong: str, words: str, judge: Callable[..., Judgement], text: str
) -> None:
    judged = judge(text.replace(right, wrong, 1))
    assert judged.believable == "impossible"
    assert words in judged.causes[0], said(judged)
    assert judged.findings[0].line == line_of(text, right.strip(), "<Stress Relaxation>")


@pytest.mark.parametrize(
    ("punch", "level", "setting"),
    [
        ({"tips": 30}, "doubtful", "punch.tips"),
        ({"depth": Quantity(6.0, 0.0, "m")}, "impossible", "punch.depth"),
        ({"period": Quantity(0.8e-3, 0.0, "m")}, "impossible", "punch.period"),
    ],
)
def test_a_punch_typed_wrongly_is_told_with_its_setting(
    punch: dict[str, Any], level: str, setting: str, judge: Callable[..., Judgement]
) -> None:
    judged = judge(**punch)
    assert judged.believable == level
    assert judged.findings[0].setting == setting

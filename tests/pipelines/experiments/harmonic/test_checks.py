"""Mistakes with a harmonic indentation, as laboratories make them: level, cause and line."""

import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec
import pytest

from labpipe import files, materials
from labpipe.judging import Judgement
from labpipe.units import Quantity
from labpipe.workflow.results import Results
from pipelines.experiments.harmonic import checks, measured
from pipelines.experiments.shared import judgements, mach1_readings
from pipelines.process import open_session
from pipelines.rig.indentation_session import oscillation_section
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.relaxations import TESTER
from pipelines.rig.session_text import cell_record, session_head
from pipelines.session import opened
from tests.pipelines.mach1_mistakes import WRONG_COLUMNS, Row, Steps, columns, line_of, said

START = datetime(2024, 5, 14, 9, 30)
RECORD = "calibration/load_cell.toml"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frequencies in NBR with a record of the cell; not processed."""
    folder = tmp_path_factory.mktemp("checks")
    specimen = Specimen(materials.load("nbr"))
    protocol = Harmonic(hold=5.0, frequencies=(1.0, 2.0), cycles=7)
    write_harmonic(folder, "nbr", specimen, protocol, replace(TESTER), 31, START)
    files.write_text(folder / RECORD, cell_record())
    files.write_text(
        folder / "session.toml", session_head("Harmonic (synthetic)") + oscillation_section("nbr", specimen)
    )
    return folder


@pytest.fixture
def judge(session: Path, tmp_path: Path) -> Callable[..., Judgement]:
    """Judge the file after an edit of its text, its record or its punch, without a model."""
    given = open_session(session).experiments["nbr"].settings

    def judged(text: str | None = None, record: str | None = None, **punch: Any) -> Judgement:
        settings = given
        if punch:
            settings = msgspec.structs.replace(given, punch=msgspec.structs.replace(given.punch, **punch))
        path, cell = tmp_path / given.mach1, tmp_path / RECORD
        files.write_text(path, text or (session / given.mach1).read_text("utf-8"))
        files.write_text(cell, record or (session / RECORD).read_text("utf-8"))
        step = Steps()
        readings = step("readings", lambda: mach1_readings.readings(path))
        loads = step("loads", lambda: measured.loads(readings, cell, settings=settings))
        hold = waves = None
        if loads is not None:
            hold = step("hold", lambda: measured.hold(loads, settings=settings))
            waves = step("oscillations", lambda: measured.oscillations(loads, settings=settings))
        context = step.context("harmonic")
        made = checks.judgement(readings, loads, hold, waves, None, None, settings=settings, context=context)
        return judgements.believed(made)

    return judged


@pytest.fixture
def text(session: Path) -> str:
    return (session / open_session(session).experiments["nbr"].settings.mach1).read_text("utf-8")


def test_a_clean_test_is_believed_and_its_stiffness_confirms_the_model(processed_session: Path) -> None:
    results: Results = opened(processed_session)
    made = results.result("nbr", "judgement")
    judged = judgements.believed(made)
    assert (judged.believable, said(judged)) == ("yes", "")
    # without a record of the cell the delay of its filter leaves the work uncertain by a tenth, not the stiffness
    assert made.attrs["model"] == "agrees"
    assert 8 < judged.n_made <= 13
    assert float(made["detectable"].sel(input="modulus of the rubber")) < 0.1
    page = (processed_session / "labpipe/reports/nbr.html").read_text("utf-8")
    assert "The record is believable, and the model agrees with it; " in page
    assert re.search(r"The largest of \d+ deviations: [\w ]+ \([\d.]+ Hz\): \S+", page)
    assert "Errors that would have shown: " in page


def test_a_clean_file_with_a_record_is_believed(judge: Callable[..., Judgement]) -> None:
    judged = judge()
    assert (judged.believable, said(judged)) == ("yes", "")


def test_an_amplitude_near_the_mean_depth_is_no_mistake(
    judge: Callable[..., Judgement], session: Path, tmp_path: Path
) -> None:
    protocol = Harmonic(hold=5.0, frequencies=(1.0,), cycles=7, mean=30e-6, amplitude=40e-6)
    write_harmonic(tmp_path / "tap", "nbr", Specimen(materials.load("nbr")), protocol, TESTER, 32, START)
    name = open_session(session).experiments["nbr"].settings.mach1
    judged = judge((tmp_path / "tap" / name).read_text("utf-8"))
    assert judged.believable == "yes", said(judged)


@pytest.mark.parametrize(("change", "words"), WRONG_COLUMNS)
def test_a_wrong_column_is_told(
    change: Callable[[float, float, float], Row], words: str, judge: Callable[..., Judgement], text: str
) -> None:
    judged = judge(columns(text, change))
    assert judged.believable == "impossible"
    first = judged.findings[0]
    assert words in first.cause, said(judged)
    assert first.file
    assert "Time, s" in text.splitlines()[(first.line or 0) - 1]


@pytest.mark.parametrize(
    ("right", "wrong", "words"),
    [
        ("Amplitude, mm:\t0.0100", "Amplitude, mm:\t0.1000", "the declared amplitude is 10 times too large"),
        ("Frequency, Hz:\t1.0", "Frequency, Hz:\t2.0", "the declared frequency is 2 times too large"),
        ("Amplitude, mm:\t0.0980", "Amplitude, mm:\t0.9800", "the declared amplitude is 10 times too large"),
    ],
)
def test_a_wrong_declaration_is_told_with_its_line(
    right: str, wrong: str, words: str, judge: Callable[..., Judgement], text: str
) -> None:
    judged = judge(text.replace(right, wrong, 1))
    assert judged.believable == "impossible"
    assert words in judged.causes[0]
    assert [f.line for f in judged.findings] == [line_of(text, right)]


@pytest.mark.parametrize("delay", ["159 ± 2 ms", "15.9 ± 0.2 s"])
def test_a_wrong_delay_of_the_filter_is_told(delay: str, judge: Callable[..., Judgement], session: Path) -> None:
    record = (session / RECORD).read_text("utf-8")
    judged = judge(record=record.replace("15.9 ± 0.2 ms", delay))
    assert judged.believable == "impossible"
    assert "probably 15.9 ms" in judged.causes[0]
    assert judged.findings[0].setting == "values.filter_delay"
    assert judged.findings[0].file == RECORD


def test_a_scale_of_ten_is_told_with_its_line(judge: Callable[..., Judgement], session: Path) -> None:
    record = (session / RECORD).read_text("utf-8")
    judged = judge(record=record.replace('scale = "1.0000 ± 0.0010"', 'scale = "10 ± 0.01"'))
    assert judged.believable == "impossible"
    assert (judged.findings[0].file, judged.findings[0].line) == (RECORD, line_of(record, "scale ="))


@pytest.mark.parametrize(
    ("punch", "level", "setting"),
    [
        ({"tips": 30}, "doubtful", "punch.tips"),
        ({"depth": Quantity(6.0, 0.0, "m")}, "impossible", "punch.depth"),
        ({"period": Quantity(0.8e-3, 0.0, "m")}, "impossible", "punch.period"),
        ({"radius": Quantity(2e-6, 0.0, "m")}, "impossible", "punch.radius"),
    ],
)
def test_a_punch_typed_wrongly_is_told_with_its_setting(
    punch: dict[str, Any], level: str, setting: str, judge: Callable[..., Judgement]
) -> None:
    judged = judge(**punch)
    assert judged.believable == level
    assert judged.findings[0].setting == setting


def test_thirty_tips_are_told_by_the_force_of_the_named_material(processed_session: Path) -> None:
    """The model then expects ten times the force."""
    results = opened(processed_session)
    names = ("readings", "loads", "hold", "oscillations", "model", "comparison")
    given = results.experiments["nbr"].settings
    parts = [results.result("nbr", name) for name in names]
    force = float(parts[3]["mean_force"][0])
    parts[5]["bias"] = parts[5]["bias"] - 9 * force
    wrong = msgspec.structs.replace(given, punch=msgspec.structs.replace(given.punch, tips=30))
    made = checks.judgement(*parts, settings=wrong, context=Steps().context("harmonic"))
    judged = judgements.believed(made)
    assert judged.believable == "doubtful"
    found = next(c for c in judged.checks if c.level and c.name == "force for the named material")
    assert "number of tips is probably 3" in found.cause
    assert found.setting == "punch.tips"


def test_a_force_beyond_the_capacity_is_a_note_where_the_named_material_gives_it(processed_session: Path) -> None:
    """A stiff polymer is no mistake, and a cell of that name may do more."""
    results = opened(processed_session)
    names = ("readings", "loads", "hold", "oscillations", "model", "comparison")
    parts = [results.result("nbr", name) for name in names]
    parts[0].attrs["blocks"] = parts[0].attrs["blocks"].replace('"250N', '"5N')
    made = checks.judgement(*parts, settings=results.experiments["nbr"].settings, context=Steps().context("harmonic"))
    judged = judgements.believed(made)
    assert judged.believable == "yes"
    assert [(f.check, f.level) for f in judged.findings] == [("load cell", "note")]
    unknown = checks.judgement(
        *parts[:4], None, None, settings=results.experiments["nbr"].settings, context=Steps().context("harmonic")
    )
    assert judgements.believed(unknown).believable == "impossible"

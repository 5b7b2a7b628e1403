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
from labpipe.workflow.results import Results
from pipelines.experiments.harmonic import checks, measured
from pipelines.experiments.shared import judgements, mach1_readings
from pipelines.process import open_session
from pipelines.rig.indentation_session import oscillation_section
from pipelines.rig.indentations import Harmonic, Specimen, write_harmonic
from pipelines.rig.relaxations import TESTER
from pipelines.rig.session_text import cell_record, session_head
from pipelines.session import opened
from tests.pipelines.mach1_mistakes import Steps, said

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
    assert 6 < judged.n_made <= 12
    assert float(made["detectable"].sel(input="modulus of the rubber")) < 0.1
    page = (processed_session / "labpipe/reports/nbr.html").read_text("utf-8")
    assert "The record is believable, and the model agrees with it; " in page
    assert re.search(r"The largest of \d+ deviations: [\w ]+ \([\d.]+ Hz\): \S+", page)
    assert "Errors that would have shown: " in page


def test_an_amplitude_near_the_mean_depth_is_no_mistake(
    judge: Callable[..., Judgement], session: Path, tmp_path: Path
) -> None:
    protocol = Harmonic(hold=5.0, frequencies=(1.0,), cycles=7, mean=30e-6, amplitude=40e-6)
    write_harmonic(tmp_path / "tap", "nbr", Specimen(materials.load("nbr")), protocol, TESTER, 32, START)
    name = open_session(session).experiments["nbr"].settings.mach1
    judged = judge((tmp_path / "tap" / name).read_text("utf-8"))
    assert judged.believable == "yes", said(judged)


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

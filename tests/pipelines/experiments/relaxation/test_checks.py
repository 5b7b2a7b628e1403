"""Mistakes with relaxation tests, as laboratories make them: level, cause and line."""

from datetime import datetime
from pathlib import Path

import msgspec
import pytest

from labpipe import files, materials
from pipelines.experiments.relaxation import checks
from pipelines.experiments.shared import judgements
from pipelines.process import open_session, process, result
from pipelines.rig.indentation_session import relaxation_section
from pipelines.rig.indentations import Specimen
from pipelines.rig.relaxations import TESTER, Relaxation, write_relaxation
from pipelines.rig.session_text import cell_record, session_head
from tests.pipelines.mach1_mistakes import Steps, said

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
    assert 6 < judged.n_made <= 12
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

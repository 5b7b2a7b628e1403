"""Mistakes that only a session as a whole can tell are in its audit; a clean session has none."""

import json
import shutil
from functools import partial
from pathlib import Path

import pytest
from click.testing import CliRunner

import labpipe as lp
from pipelines.commands.system import doctor
from pipelines.session import process
from tests.mistakes.recordings import setting
from tests.mistakes.rows import Mistake, by_day
from tests.mistakes.session_rows import ROWS, TOML, write


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clean session, audited."""
    folder = write(tmp_path_factory.mktemp("clean"))
    assert lp.doctor(folder).audit is not None
    return folder


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clean session was processed as the command does it; to start processes for each edit takes longer."""
    monkeypatch.setattr("pipelines.session._processing.process", partial(process, jobs=0))


def test_clean_session_has_no_row(clean: Path) -> None:
    audit = lp.doctor(clean).audit
    assert audit is not None
    assert [t for t in audit.troubles if t.level != "note"] == []
    assert 30 < audit.checks < 60


@pytest.mark.parametrize("mistake", by_day(ROWS, 4))
def test_mistake_is_in_the_audit(clean: Path, tmp_path: Path, mistake: Mistake) -> None:
    folder = tmp_path / "session"
    shutil.copytree(clean, folder)
    mistake.edit(folder)
    health = lp.doctor(folder)
    audit = health.audit
    if mistake.level == "refused":
        assert all(word in " ".join(health.session_problems) for word in mistake.words)
        return
    assert audit is not None
    found = [t for t in audit.troubles if mistake.check in t.checks and t.level == mistake.level]
    said = [t for t in found if all(w.lower() in f"{t.message} {t.cause}".lower() for w in mistake.words)]
    assert said, audit.troubles
    assert said[0].file == mistake.file
    if isinstance(mistake.line, str):
        lines = (folder / mistake.file).read_text("utf-8").splitlines()
        assert said[0].line is not None
        assert mistake.line in lines[said[0].line - 1]


def test_the_command_ends_with_1_and_names_the_line(clean: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    shutil.copytree(clean, folder)
    setting('"1.7 ±', '"17 ±')(folder)
    done = CliRunner().invoke(doctor, [str(folder), "--json"])
    first = json.loads(done.output)["findings"][0]
    assert (done.exit_code, first["level"], first["experiments"]) == (1, "impossible", ["acrylic_high"])
    assert '"17 ±' in (folder / TOML).read_text("utf-8").splitlines()[first["line"] - 1]
    assert lp.doctor().audit is None  # without a session only the installation is looked at

"""A run that is stopped by the program or the disk says nothing about a record."""

from pathlib import Path

import pytest

from labpipe.errors import InstallationError
from labpipe.workflow import code
from pipelines.session import process, verdict, verdicts_of
from tests.mistakes.drop_rows import write

_WHY = "home.py was changed while this program ran; start it again"


def test_a_program_changed_under_the_run_is_no_judgement_of_the_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write(tmp_path / "session")

    def refuse(*_: object) -> None:
        raise InstallationError(_WHY)

    monkeypatch.setattr(code, "refuse_changed", refuse)
    (found,) = verdict(folder, "bounces", jobs=0).experiments
    assert (found.state, found.believable) == ("failed", "unknown")
    assert {f.level for f in found.findings} == {"note"}
    assert _WHY in found.findings[0].message
    assert "run it again" in found.findings[0].cause


def test_checks_that_break_are_no_judgement_of_the_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write(tmp_path / "session")

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("nought")

    monkeypatch.setattr("pipelines.experiments.ball_drop.checks.judgement", broken)
    done = process(folder, ["judgement"], jobs=0)
    assert done.exit_code == 1
    (found,) = verdicts_of(done).experiments
    assert (found.state, found.believable) == ("failed", "unknown")
    assert "ZeroDivisionError" in found.findings[0].message

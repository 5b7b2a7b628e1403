"""A run that is stopped by the program or the disk says nothing about a record."""

from pathlib import Path

import pytest

from labpipe.errors import InstallationError, SourceError
from labpipe.materials import load
from labpipe.workflow import code
from labpipe.workflow.context import Context, Failed
from pipelines.experiments.shared.judgements import Scene, believed, failed_steps, judgement, sentence
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


@pytest.mark.parametrize(("is_of_run", "word"), [(True, "Not known"), (False, "Impossible")])
def test_the_sentence_tells_a_stopped_run_from_a_record_that_fails(*, is_of_run: bool, word: str) -> None:
    failures = (Failed("bounces", None, "why", is_of_run),)
    context = Context("drop", "ball_drop", "", "", "", True, failures=failures)
    result = judgement(Scene(failed_steps(context, {})))
    assert believed(result).believable == ("unknown" if is_of_run else "impossible")
    assert sentence(result)[1].startswith(word)


def test_a_file_of_a_material_that_lacks_a_table_is_named_as_the_cause(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text('labpipe_material = 1\nname = "x"\nsummary = "x"\n', "utf-8")
    with pytest.raises(SourceError, match=r"x\.toml:1: poisson: expected a table") as found:
        load(tmp_path / "x.toml")
    failures = (Failed("model", None, str(found.value), reason=found.value.reason),)
    context = Context("drop", "ball_drop", "", "", "", True, failures=failures)
    (check,) = failed_steps(context, {"model": "a temperature is out of range"})
    assert check.cause == "the file of the material lacks a table or holds a wrong value"


def test_a_mistake_of_the_program_is_no_judgement_of_the_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write(tmp_path / "session")

    def broken(*_: object, **__: object) -> None:
        raise KeyError("speed")

    monkeypatch.setattr("pipelines.experiments.ball_drop.measured.displacement", broken)
    done = process(folder, ["bounces"], jobs=0)
    assert done.exit_code == 1
    (found,) = verdicts_of(done).experiments
    assert (found.state, found.believable) == ("failed", "unknown")
    assert "unexpected KeyError" in found.findings[0].message
    assert "tells nothing about the record" in found.findings[0].cause


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

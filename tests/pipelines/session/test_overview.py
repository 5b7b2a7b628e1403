"""The page of a session: states, numbers and pictures of all experiments, made again on change."""

import json
import re
from pathlib import Path

import pytest

from pipelines.session import PAGE, STAGES, open_session, write_overview
from tests.pipelines.command import run
from tests.pipelines.sessions import replaced


def page(folder: Path) -> str:
    return (folder / "labpipe" / PAGE).read_text("utf-8")


def test_every_experiment_is_there_with_link_state_and_picture(processed_session: Path) -> None:
    text = page(processed_session)
    for name in ("drop", "nbr"):
        assert f'<a href="reports/{name}.html">{name}</a>' in text
    assert len(re.findall(r'src="data:image/svg\+xml;base64,', text)) == 2
    assert "first restitution" in text
    assert "largest contact radius" not in text  # no experiment has one
    assert "synthetic data" in text


def test_the_page_is_written_again_only_after_a_change(session_copy: Path) -> None:
    path = session_copy / "labpipe" / PAGE
    before = path.stat().st_mtime_ns, path.read_bytes()
    write_overview(open_session(session_copy), STAGES)
    assert (path.stat().st_mtime_ns, path.read_bytes()) == before
    replaced(session_copy, 'height = "1.5', 'height = "1.6')
    write_overview(open_session(session_copy), STAGES)
    assert re.search(r"\d+ of \d+ steps to do(?! or failed)", page(session_copy))  # nothing has failed


def test_a_file_that_no_experiment_uses_is_a_note_of_the_session(
    session_copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Told by process, in its JSON and on the page; the exit code stays."""
    (session_copy / "laser/forgotten.csv").write_bytes((session_copy / "laser/drop_2.csv").read_bytes())
    code, out, _ = run(capsys, "process", str(session_copy), "--json")
    (note,) = json.loads(out)["findings"]
    assert code == 0
    assert (note["level"], note["file"]) == ("note", "laser/forgotten.csv")
    assert "same bytes as laser/drop_2.csv" in note["cause"]
    code, out, _ = run(capsys, "process", str(session_copy))
    assert (code, "note: no experiment uses laser/forgotten.csv" in out) == (0, True)
    assert "No experiment uses laser/forgotten.csv" in page(session_copy)
    (session_copy / "laser/forgotten.csv").unlink()
    assert run(capsys, "process", str(session_copy))[0] == 0
    assert "forgotten" not in page(session_copy)

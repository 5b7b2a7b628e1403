"""Exclusions and notes: left out of the measurement, counted, with a reason on the page and in the export."""

import json
import tomllib
from datetime import date
from pathlib import Path

import numpy as np
import pytest

import labpipe as lp
from labpipe.errors import InputError, UsageError
from labpipe.workflow import session as sessions
from labpipe.workflow.exclusions import Note
from pipelines.experiments.shared.exclusions import EXCLUDED
from pipelines.session import SETTINGS, open_session, with_note
from tests.pipelines.command import run
from tests.pipelines.sessions import replaced

DROP = "[experiments.drop]\n"


def excluding(folder: Path, *entries: str, head: str = DROP) -> Path:
    replaced(folder, head, f"{head}exclude = [{', '.join(entries)}]\n")
    return folder


def test_readings_are_missing_and_their_reason_is_on_the_page_and_in_the_export(session_copy: Path) -> None:
    whole = lp.result(session_copy, "drop", "readings", "laser/drop_1.csv")
    reason = 'reason = "<script>alert(1)</script> door", who = "J. Doe", on = 2026-11-28'
    excluding(session_copy, f'{{ file = "laser/drop_1.csv", readings = [31, "40-42"], {reason} }}')
    plan = lp.plan(session_copy, "readings", only="drop")
    assert {row.recording: row.state for row in plan.rows} == {
        "laser/drop_1.csv": "will run",
        "laser/drop_2.csv": "cached",
    }
    assert lp.process(session_copy, jobs=0).failures == ()
    read = lp.result(session_copy, "drop", "readings", "laser/drop_1.csv")
    left_out = np.flatnonzero(read[EXCLUDED])
    assert left_out.tolist() == [30, 39, 40, 41]
    assert np.isnan(read["out1"][left_out]).all()
    np.testing.assert_array_equal(read["out1"].drop_isel(time=left_out), whole["out1"].drop_isel(time=left_out))
    assert "range" not in str(lp.verdict(session_copy, jobs=0).experiments[0].findings)
    page = lp.report(session_copy, "drop").html
    assert "Excluded from the measurement: 4 readings (31, 40-42) of laser/drop_1.csv" in page
    assert "Excluded were 4 readings" in page  # the methods text
    assert "<script>alert(1)" not in page
    (table, *_) = lp.export(session_copy, "csv", only="drop", out=session_copy / "out").paths
    assert "door (J. Doe, 2026-11-28)" in table.read_text("utf-8")


def test_a_whole_recording_is_left_out_and_is_no_unused_file(session_copy: Path) -> None:
    excluding(session_copy, '{ file = "laser/drop_2.csv", reason = "not level" }')
    done = lp.process(session_copy, jobs=0)
    assert {o.task.recording for o in done.outcomes if o.task.stage == "bounces"} == {"laser/drop_1.csv"}
    assert lp.result(session_copy, "drop", "repeats").sizes["repeat"] == 1
    assert "drop_2" not in str(lp.verdict(session_copy, jobs=0).notes)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ('{ file = "laser/drop_2.csv" }', "exclude no. 1, reason: missing; expected a reason"),
        ('{ file = "laser/drop_3.csv", reason = "x" }', 'no recording "laser/drop_3.csv"; did you mean'),
        ('{ file = "laser/drop_2.csv", reason = "x", readings = ["9-3"] }', '"9-3" ends before it begins'),
    ],
)
def test_a_wrong_exclusion_is_refused_with_its_line(small_session: Path, entry: str, message: str) -> None:
    text = (small_session / "session.toml").read_text("utf-8").replace(DROP, f"{DROP}exclude = [{entry}]\n")
    line = text[: text.index("exclude =")].count("\n") + 1
    waiting = "\n".join(sessions.load(small_session, SETTINGS, text=text).waiting["drop"])
    assert f"session.toml:{line}: experiments.drop.exclude" in waiting
    assert message in waiting


def test_nothing_left_and_readings_beyond_the_file_are_refused(session_copy: Path) -> None:
    nbr = "[experiments.nbr]\n"
    excluding(session_copy, '{ file = "mach1/nbr.txt", reason = "x" }', head=nbr)
    assert "all that is left of the experiment" in open_session(session_copy).waiting["nbr"][0]
    excluding(session_copy, '{ file = "laser/drop_1.csv", readings = [99999999], reason = "x" }')
    failed = lp.process(session_copy, "readings", "drop", jobs=0).failures
    assert "correct the numbers" in failed[0].message


def test_a_note_is_appended_and_nothing_else_changes(session_copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = session_copy / "session.toml"
    before = path.read_bytes().replace(b"\n", b"\r\n")
    path.write_bytes(before)
    _, out, _ = run(capsys, "note", str(session_copy), "drop", "sphere <b>cleaned</b>", "--who", "Jo", "--json")
    assert json.loads(out)["who"] == "Jo"
    lp.note(session_copy, "drop", "again")
    assert path.read_bytes().startswith(before)
    assert [note.text for note in open_session(session_copy).experiments["drop"].settings.notes] == [
        "sphere <b>cleaned</b>",
        "again",
    ]
    assert {row.stage for row in lp.plan(session_copy, only="drop").to_run} == {"report"}
    lp.process(session_copy, only="drop", jobs=0)
    assert "sphere &lt;b&gt;cleaned&lt;/b&gt;" in lp.report(session_copy, "drop").html
    with pytest.raises(UsageError, match="did you mean"):
        lp.note(session_copy, "dropp", "x")
    with pytest.raises(InputError, match="empty"):
        lp.note(session_copy, "drop", "  ")


def test_a_note_is_appended_to_a_list_as_it_is_written() -> None:
    made = Note(on=date(2026, 11, 28), text='a "b"')
    text = "[experiments.a]\nnotes = [{ on = 2026-11-27 , text = ']' } ]  # ]\nb = [{ on = 2026-11-27 }]\n"
    kept = tomllib.loads(text)["experiments"]["a"]["notes"][0]
    for before in (text, "[experiments.a]\nnotes = [\n  # none\n]\nb = 1  # ]\n"):
        after = with_note(before, "a", made)
        assert after.splitlines()[-1].replace(" ", "") == before.splitlines()[-1].replace(" ", "")
        *others, last = tomllib.loads(after)["experiments"]["a"]["notes"]
        assert others == [kept] * (before is text)
        assert last == {"on": made.on, "text": made.text}
    with pytest.raises(InputError, match="by hand"):
        with_note("experiments.a = { b = 1 }\n", "a", made)

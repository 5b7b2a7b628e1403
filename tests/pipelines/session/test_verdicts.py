"""Verdicts are kept beside the results: said again without NumPy, and never when they are out of date."""

import json
import subprocess
import sys
from pathlib import Path

from pipelines.session import catalogue, compare, open_session, verdict, verdict_on
from pipelines.session._results import opened
from pipelines.session._verdicts import stored_verdicts

_KEPT = "labpipe/store/verdicts.json"


def test_an_unchanged_session_is_processed_and_judged_again_without_numpy(session_copy: Path) -> None:
    expected = [[one.experiment, one.believable, one.model] for one in verdict(session_copy).experiments]
    code = (
        "import json, sys; from pipelines.session import process, verdicts_of; done = process(sys.argv[1])\n"
        "print(json.dumps([[v.experiment, v.believable, v.model] for v in verdicts_of(done).experiments]))\n"
        "sys.exit(bool({'numpy', 'scipy', 'xarray', 'matplotlib'} & sys.modules.keys()))"
    )
    said = subprocess.run([sys.executable, "-c", code, session_copy], capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    assert json.loads(said.stdout) == expected


def test_kept_verdicts_are_those_that_would_be_made_and_damage_is_noticed(session_copy: Path) -> None:
    again = verdict(session_copy)
    assert again["experiments"] == json.loads(json.dumps(again["experiments"]))
    assert (
        again["experiments"][0]["believable"] == again.experiments[0]["believable"] == again.experiments[0].believable
    )
    kept = session_copy / _KEPT
    whole = kept.read_bytes()
    kept.write_bytes(whole.replace(b'"yes"', b'"no"', 1))
    assert verdict(session_copy) == again
    assert kept.read_bytes() == whole
    kept.unlink()
    assert verdict(session_copy) == again


def test_the_verdict_on_an_experiment_that_fails_is_told_wherever_that_of_others_is(session_copy: Path) -> None:
    """It is no result to be read again; a change of its files or settings makes it one of the past."""
    (name, own), *_ = ((n, e) for n, e in open_session(session_copy).experiments.items() if e.kind == "ball_drop")
    laser = session_copy / own.settings.laser[0]
    whole = laser.read_bytes()
    head, rows = whole[: whole.index(b"\n1,") + 1], whole[whole.index(b"\n1,") + 1 :].splitlines()
    at_rest = rows[0].split(b",")[1]
    laser.write_bytes(head + b"".join(b"%d,%b\r\n" % (k, at_rest) for k in range(1, len(rows) + 1)))
    said = {v.experiment: v.believable for v in verdict(session_copy).experiments}
    assert said[name] == "impossible"
    assert {v.experiment: v.believable for v in (verdict_on(session_copy, n) for n in said)} == said
    compare(session_copy)  # writes the index anew
    index = (session_copy / "labpipe/index.html").read_text("utf-8")
    assert "impossible, " in index
    assert f"Impossible: {name}" in index
    table = catalogue(session_copy.parent).table
    assert table.set_index("experiment").loc[name, "believable"] == "impossible"
    laser.write_bytes(whole + b"\r\n")
    assert name not in stored_verdicts(opened(session_copy))
    laser.write_bytes(whole)
    assert stored_verdicts(opened(session_copy))[name].believable == "yes"

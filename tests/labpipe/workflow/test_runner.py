"""A run computes what is missing; failures, kills and other processes leave nothing wrong."""

import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import toy_laboratory as toy

from labpipe import files
from labpipe.errors import InputError, UsageError
from labpipe.workflow import provenance
from labpipe.workflow.results import Event, RunResult
from labpipe.workflow.runner import run, run_all
from labpipe.workflow.session import Session
from labpipe.workflow.store import events
from tests.by_day import by_day

HERE = Path(__file__).parent

DRIVER = f"""
import os, sys
sys.path.insert(0, {str(HERE)!r})
import toy_laboratory as toy
from labpipe.workflow import provenance
from labpipe.workflow.store import events
from labpipe.workflow.runner import run
from labpipe.workflow.session import load
# The state of the repository may change while the tests run; a result must not differ by that.
provenance.git_state = lambda folder: None
jobs = int(sys.argv[2])
print("ready", flush=True)
result = run(load(sys.argv[1], toy.KINDS), toy.STAGES, schemas=toy.SCHEMAS, jobs=jobs)
if jobs:
    assert "numpy" not in sys.modules
print(*(f"{{o.task}}: {{o.state}}" for o in result.outcomes), sep="\\n")
sys.exit(result.exit_code)
"""


def drive(folder: Path, jobs: int = 1, **environment: str) -> "subprocess.Popen[str]":
    """Run a session in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", DRIVER, str(folder), str(jobs)],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: "subprocess.Popen[str]", code: int = 0) -> str:
    out, err = process.communicate(timeout=300)
    assert process.returncode == code, err
    return out


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What an undisturbed run leaves: netCDF files and pages by their names.

    A script without a ``__main__`` guard makes it, and runs once.
    """
    session = toy.make_session(tmp_path_factory.mktemp("undisturbed"))
    script = session.root / "script.py"
    script.write_text(DRIVER)
    command = [sys.executable, str(script), str(session.root), "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.count("ready") == 1
    return toy.contents(session)


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return toy.make_session(tmp_path / "session")


def run_here(session: Session, jobs: int = 0, stages: Any = toy.STAGES, **options: object) -> RunResult:
    return run(session, stages, **{"schemas": toy.SCHEMAS, "jobs": jobs, **options})  # type: ignore[arg-type]


def states(result: RunResult) -> dict[str, str]:
    return {str(outcome.task): outcome.state for outcome in result.outcomes}


def troubled(folder: Path, trouble: str) -> Session:
    """A session whose experiment acrylic has trouble."""
    return toy.make_session(folder, toy.TOML.replace('"9.5 mm"', f'"9.5 mm"\ntrouble = "{trouble}"'))


def test_a_result_that_is_not_up_to_date_is_not_opened(session: Session) -> None:
    with pytest.raises(InputError, match=r"nbr/mean has no up-to-date result \(never run"):
        toy.opened(session, "nbr", "mean")
    run_here(session)
    with pytest.raises(InputError, match="is a page"):
        toy.opened(session, "nbr", "page")
    with pytest.raises(InputError, match=r'name one of them: "laser/r3\.txt"'):
        toy.opened(session, "nbr", "read")
    with pytest.raises(UsageError, match='did you mean "nbr/mean"'):
        toy.opened(session, "nbr", "maen")


def test_a_result_has_its_values_its_origin_its_work_and_a_page(session: Session) -> None:
    told: list[Event] = []
    result = run_here(session, progress=told.append)
    assert result.exit_code == 0
    assert set(states(result).values()) == {"done"}
    opened = toy.opened(session, "nbr", "mean")
    assert opened["z"].to_numpy().tolist() == [3 * k / 7 + 0.005 + 0.25 for k in range(5)]
    found, path = json.loads(opened.attrs["provenance"]), session.root / "laser" / "r3.txt"
    assert found["stage"] == "mean"
    assert found["parameters"] == {"sphere.radius": [0.005, 0.0, "m"]}
    assert set(found["stages"]) == {"read", "scale", "mean", "dma/curve"}
    assert found["inputs"] == [
        {"name": "dma.txt", "size": 4, "sha256": files.digest(session.root / "dma.txt")},
        {"name": "laser/r3.txt", "size": path.stat().st_size, "sha256": files.digest(path)},
    ]
    assert found["program"]["libraries"]["numpy"]
    # work is counted without the clock, and not inherited
    read = toy.opened(session, "nbr", "read", "laser/r3.txt")
    assert read["z"].to_numpy().tolist() == [3 * k / 7 for k in range(5)]
    assert json.loads(read.attrs["work"]) == {"frames_read": 5, "frames_total": 10}
    assert "work" not in toy.opened(session, "nbr", "scale", "laser/r3.txt").attrs
    page = (session.folder / "reports" / "nbr.html").read_text()
    assert "Toys" in page
    assert "LedgerRow(experiment='nbr', stage='read', name='frames_read', done=5, ski" in page
    assert "'inputs': [{'name': 'dma.txt', 'size': 4" in page
    assert page.splitlines()[5:7] == ["()", "()"]  # neither warnings nor failures
    # progress and log tell every task
    assert [e.done for e in told if e.kind == "done"] == list(range(1, 12))
    assert {e.total for e in told} == {11}
    logged = list(events(session))
    assert [e["event"] for e in logged][:2] == ["run started", "started"]
    assert sum(e["event"] == "ended" for e in logged) == 11
    assert logged[-1]["event"] == "run finished"
    assert all("time" in e for e in logged)


def test_warnings_are_kept_with_the_result_and_told_to_the_page(tmp_path: Path) -> None:
    session = troubled(tmp_path, "scale:warn")
    run_here(session)
    # The warnings of a cached stage are told as well.
    later = toy.reload_session(tmp_path, (tmp_path / "session.toml").read_text().replace("9.5", "9.6"))
    assert states(run_here(later))["acrylic/scale [laser/r1.txt]"] == "cached"
    page = (session.folder / "reports" / "acrylic.html").read_text()
    for name in ("r1", "r2"):
        warned = f"Warned(stage='scale', recording='laser/{name}.txt', category='UserWarning', text='the record is sh"
        assert warned in page


SCALE_FAILED = {
    "rubber/curve": "done",
    "nbr/read [laser/r3.txt]": "done",
    "nbr/scale [laser/r3.txt]": "done",
    "nbr/mean": "done",
    "nbr/page": "done",
    "acrylic/read [laser/r1.txt]": "done",
    "acrylic/read [laser/r2.txt]": "done",
    "acrylic/scale [laser/r1.txt]": "failed",
    "acrylic/scale [laser/r2.txt]": "failed",
    "acrylic/mean": "skipped",
    "acrylic/page": "done",
}


def test_a_failure_stops_only_what_depends_on_it_and_the_page_tells(tmp_path: Path) -> None:
    session = troubled(tmp_path, "scale:number")
    result = run_here(session)
    assert result.exit_code == 1
    assert states(result) == SCALE_FAILED
    assert [o.message for o in result.failures] == ["unexpected ZeroDivisionError: by zero"] * 2
    told = [line["details"] for line in events(session) if line.get("state") == "failed"]
    assert [o.details for o in result.failures] == told  # the log says where
    assert "toy_laboratory.py" in told[0]
    page = (session.folder / "reports" / "acrylic.html").read_text()
    assert "[None, None]\nmissing" in page
    assert "message='unexpected ZeroDivisionError: by zero'" in page
    assert "stage='mean', recording=None, state='skipped'" in page
    # The next run tries again, and a repaired session gives a page without failures.
    assert states(run_here(session))["acrylic/scale [laser/r1.txt]"] == "failed"
    repaired = toy.reload_session(tmp_path)
    assert run_here(repaired).exit_code == 0
    assert "Outcome" not in (session.folder / "reports" / "acrylic.html").read_text()


@pytest.mark.parametrize(
    ("trouble", "says"),
    [
        ("scale:units", 'toy: variable "z" is missing'),
        ("scale:give a list", "acrylic: scale: must return a Dataset, returned list"),
        ("read:some text", "unexpected ValueError: some text"),
    ],
)
def test_a_result_that_is_not_one_is_a_failure(tmp_path: Path, trouble: str, says: str) -> None:
    assert {o.message for o in run_here(troubled(tmp_path, trouble)).failures} == {says}


@pytest.mark.parametrize(("how", "state"), [("refuse", "done"), ("number", "skipped")])
def test_a_stage_does_without_what_it_may_lack_unless_the_run_was_at_fault(
    tmp_path: Path, how: str, state: str
) -> None:
    session = toy.make_session(tmp_path, toy.TOML.replace('"dma.txt"', f'"dma.txt"\ntrouble = "sweep:{how}"'))
    page, mean, *others = toy.DROP
    stages = {"drop": (page, replace(mean, may_lack=("other:material/curve",)), *others), "dma": toy.DMA}
    assert states(run_here(session, stages=stages))["nbr/mean"] == state
    assert states(run_here(toy.reload_session(tmp_path), stages=stages))["nbr/mean"] == "done"


def test_what_a_run_cannot_begin_with_is_refused_before_anything_runs(session: Session) -> None:
    with pytest.raises(InputError, match="jobs must be at least 0"):
        run_here(session, -1)
    if importlib.util.find_spec("distributed"):
        with pytest.raises(UsageError, match="no Dask scheduler answers at nonsense"):
            run_here(session, cluster="nonsense://127.0.0.1:1")
    assert not session.folder.exists()


@pytest.mark.parametrize("how", by_day(["die", "exit"], 1))
def test_a_process_that_dies_takes_only_its_task_with_it(tmp_path: Path, how: str) -> None:
    session = troubled(tmp_path, f"scale:{how}")
    result = run_here(session, 2)
    found = states(result)
    for task in [task for task, state in found.items() if state == "cached"]:
        found[task] = "done"  # stored by a call that the death cut short, before it could say so
    assert found == SCALE_FAILED
    expected = "was the memory full" if how == "die" else "unexpected SystemExit|was the memory full"
    assert all(re.search(expected, o.message) for o in result.failures)


def test_a_task_whose_worker_was_killed_is_tried_once_more_and_nothing_is_lost(tmp_path: Path) -> None:
    calls, session = tmp_path / "calls", troubled(tmp_path / "s", "scale:die once")
    process = drive(session.root, 2, TOY_DIED=str(tmp_path / "died"), TOY_CALLS=str(calls))
    out = finish(process)
    assert out.count(": done") + out.count(": cached") == 11  # cached: stored by a call that the death cut short
    assert len(calls.read_text().split()) in (12, 13)  # one of the other experiment may have been under way


def test_sessions_side_by_side_each_end_in_their_own_way(tmp_path: Path) -> None:
    told: list[Event] = []
    short = toy.make_session(tmp_path / "short", toy.TOML.split("[experiments.nbr]")[0])  # without the wanted one
    found = [toy.make_session(tmp_path / "whole"), troubled(tmp_path / "troubled", "scale:number"), short]
    options = {"schemas": toy.SCHEMAS, "jobs": 3, "only": ["nbr"], "progress": told.append}
    ended = {one.root.name: done for one, done in run_all(found, toy.STAGES, **options)}  # type: ignore[arg-type]
    assert isinstance(ended["short"], UsageError)
    for name in ("whole", "troubled"):
        done = ended[name]
        assert isinstance(done, RunResult)
        assert list(states(done).values()) == ["done"] * 5
    assert {event.session.name for event in told} == {"whole", "troubled"}
    assert [run_here(session).exit_code for session in found[:2]] == [0, 1]


@pytest.mark.slow
def test_a_cluster_gives_the_same_bytes_though_a_worker_is_killed(
    tmp_path: Path, undisturbed: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two sessions; the first worker dies over one task, which another one does again."""
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    for name, value in {"PYTHONPATH": str(HERE), "PATH": "", "TOY_DELAY": "0.05"}.items():
        monkeypatch.setenv(name, value)  # of the workers: without a path there is no git
    monkeypatch.setattr(provenance, "git_state", lambda folder: None)
    killed: list[int] = []
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, host="127.0.0.1", dashboard_address=":0"
    ) as cluster:

        def kill_one(event: Event) -> None:
            if event.kind == "done" and event.done == 2 and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        made = [toy.make_session(tmp_path / name) for name in "ab"]
        options = {"schemas": toy.SCHEMAS, "cluster": cluster.scheduler_address}
        ended = list(run_all(made, toy.STAGES, progress=kill_one, **options))  # type: ignore[arg-type]
        again = list(run_all(made, toy.STAGES, **options))  # type: ignore[arg-type]
    assert killed
    assert len(ended) == len(again) == 2
    for (_, one), (_, other) in zip(ended, again, strict=True):
        assert isinstance(one, RunResult)
        assert isinstance(other, RunResult)
        assert set(states(one).values()) == {"done"}
        assert set(states(other).values()) == {"cached"}
    assert [toy.contents(session) for session in made] == [undisturbed] * 2


def test_no_space_is_said_before_a_stage_with_the_bytes_needed(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(session.root)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage)
    result = run_here(session)
    assert result.exit_code == 5
    assert "1572864 bytes are needed and 1000 are free" in result.failures[0].message
    monkeypatch.undo()
    assert run_here(session).exit_code == 0


def test_an_input_that_changes_while_it_is_read_is_refused_and_read_by_the_next_run(tmp_path: Path) -> None:
    session = troubled(tmp_path, "read:written once")
    failures = run_here(session).failures
    assert {o.message.partition(":")[2][:25] for o in failures} == {" still being written: its"}
    assert {o.exit_code for o in failures} == {3}
    assert run_here(session).exit_code == 0
    values = toy.opened(session, "acrylic", "read", "laser/r1.txt")["z"].to_numpy().tolist()
    assert (len(values), values[-1]) == (6, 9.0)


@pytest.mark.parametrize(
    ("jobs", "environment"),
    by_day(
        [
            (3, {"TZ": "Asia/Tokyo", "LC_ALL": "tr_TR.UTF-8", "PYTHONHASHSEED": "8"}),
            (2, {"PYTHONHASHSEED": "7"}),
            (1, {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2", "TOY_DELAY": "0.01"}),
        ],
        1,
    ),
)
def test_results_do_not_depend_on_how_they_are_made(
    session: Session, undisturbed: dict[str, bytes], jobs: int, environment: dict[str, str]
) -> None:
    finish(drive(session.root, jobs, **environment))
    assert toy.contents(session) == undisturbed


@pytest.mark.slow
def test_a_session_gives_the_same_results_wherever_it_lies(
    tmp_path: Path, undisturbed: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = toy.make_session(tmp_path / "another folder ü")
    monkeypatch.chdir(session.root)
    finish(drive(Path()))
    assert toy.contents(session) == undisturbed
    moved = session.root.rename(tmp_path / "moved")
    assert finish(drive(moved)).count(": cached") == 11


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_workers_end_with_the_process_that_started_them(tmp_path: Path, undisturbed: dict[str, bytes]) -> None:
    session = troubled(tmp_path / "s", "scale:sleep")
    process = drive(session.root)
    until = time.monotonic() + 120
    while "scale" not in (e["stage"] for e in events(session) if e["event"] == "started"):
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < until
        time.sleep(0.02)
    process.kill()
    process.communicate(timeout=60)
    lock = session.folder / "store" / "locks" / "acrylic.lock"
    until = time.monotonic() + 20
    is_free = False
    while not is_free:  # the lock of a worker that went on would stay
        assert time.monotonic() < until
        time.sleep(0.05)
        with files.lock(lock, wait=False) as is_free:
            pass
    finish(drive(toy.reload_session(session.root).root))
    after = toy.contents(session)
    assert {name: after[name] for name in undisturbed} == undisturbed

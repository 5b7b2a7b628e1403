"""Ctrl-C, an order to end and a closed terminal leave a clean session that goes on where it was."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipelines.session import process
from tests.by_day import by_day
from tests.pipelines.stored import assert_same


def started(folder: Path) -> int:
    log = folder / "labpipe/run.jsonl"
    return log.read_text("utf-8").count('"started"') if log.is_file() else 0


def children(pid: int) -> list[int]:
    path = Path(f"/proc/{pid}/task/{pid}/children")
    return [int(word) for word in path.read_text().split()] if path.is_file() else []


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
@pytest.mark.parametrize(("name", "code"), by_day([("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)], 1))
def test_an_interrupted_run_leaves_no_worker_no_part_and_goes_on(
    small_session: Path, pristine_session: Path, tmp_path: Path, name: str, code: int
) -> None:
    folder = tmp_path / "session"
    shutil.copytree(small_session, folder)
    child = subprocess.Popen(
        [sys.executable, "-m", "labpipe", "process", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while started(folder) < 3 and child.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    workers = children(child.pid)
    child.send_signal(signal.Signals[name])
    out, err = child.communicate(timeout=60)
    assert child.returncode == code, err
    assert "Traceback" not in err
    assert out == ""
    assert ("interrupted; results that were complete are kept" in err) == (code == 130)
    for pid in workers:  # the server of new processes may end a moment later, on its own
        wait_until_gone(pid)
    assert not list(folder.rglob(".*.part"))
    last = json.loads((folder / "labpipe/run.jsonl").read_text("utf-8").splitlines()[-1])
    assert last["event"] == "run interrupted"
    if name != "SIGINT":
        return  # what is left is the same; that it goes on is shown once
    assert process(folder, jobs=0).exit_code == 0
    assert_same(folder, pristine_session)


def wait_until_gone(pid: int) -> None:
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return
        if state == "Z":
            return
        time.sleep(0.05)
    pytest.fail(f"process {pid} is still there")

"""Processes that want the same result at the same time: one makes it, none reads half of it."""

import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from labpipe.workflow import provenance, runner
from tests.faults.crashes import at_once
from tests.labpipe.workflow import toy_laboratory as toy

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

Amount = Callable[[int, int], int]


@pytest.fixture(autouse=True)
def laboratory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "toy_laboratory", toy)
    monkeypatch.setattr(provenance, "git_state", lambda folder: None)


def run_toys(folder: Path, delay: float = 0.0) -> str:
    """Process a session; return how many results were made."""
    time.sleep(delay)
    session = toy.load(folder, toy.KINDS)
    done = runner.run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    assert done.exit_code == 0, [o.message for o in done.failures]
    return str(sum(outcome.state == "done" for outcome in done.outcomes))


def test_two_runs_of_one_session_make_every_result_once(tmp_path: Path, amount: Amount) -> None:
    calm = toy.make_session(tmp_path / "calm", toy.SMALL)
    total = int(run_toys(calm.root))
    expected = toy.contents(calm)
    for n in range(amount(2, 200)):
        session = toy.make_session(tmp_path / str(n), toy.SMALL)
        late = 0.01 * (n % 20)
        made = at_once(
            [
                lambda root=session.root: run_toys(root),  # type: ignore[misc]
                lambda root=session.root, late=late: run_toys(root, late),  # type: ignore[misc]
            ]
        )
        assert sum(map(int, made)) == total, n
        assert toy.contents(session) == expected, n
        assert not list(session.folder.rglob(".*.part")), n
        shutil.rmtree(session.root)

"""Calls side by side: every task has one answer, whoever dies, and only what is asked for runs."""

import contextlib
import os
import random
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from labpipe.errors import UsageError
from labpipe.workflow import provenance
from labpipe.workflow.engines import Died, choose, elsewhere, side_by_side


def double(number: int) -> int:
    if number < 0:
        raise ValueError("negative")
    return 2 * number


def deadly() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def threads() -> str:
    return os.environ["OMP_NUM_THREADS"] + os.environ["OPENBLAS_NUM_THREADS"]


def naps(number: int, folder: Path) -> int:
    """Tell who computes, and take a moment."""
    (folder / f"{os.getpid()}").touch()
    time.sleep(0.02)
    return number


@pytest.mark.parametrize("jobs", [0, 2])
def test_every_task_has_one_answer_and_an_error_is_raised(jobs: int) -> None:
    found = list(side_by_side(choose(jobs), double, {f"n{i}": (i,) for i in range(20)}))
    assert len(found) == 20
    assert dict(found) == {f"n{i}": 2 * i for i in range(20)}
    with pytest.raises(ValueError, match="negative"):
        dict(side_by_side(choose(jobs), double, {0: (1,), 1: (-1,)}))


def test_workers_killed_at_any_moment_neither_stop_the_others_nor_lose_a_task(
    tmp_path: Path, amount: Callable[[int, int], int]
) -> None:
    """A worker may be killed while it waits, computes or answers, and while another one starts."""
    done, generator = threading.Event(), random.Random(3)

    def kill() -> None:
        while not done.wait(generator.uniform(0.3, 1.0)):
            workers = [int(path.name) for path in tmp_path.iterdir()]
            if workers:
                (tmp_path / str(victim := generator.choice(workers))).unlink()
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        tasks = {i: (i, tmp_path) for i in range(amount(40, 400))}
        found = list(side_by_side(choose(3), naps, tasks))
    finally:
        done.set()
        killer.join()
    assert sorted(key for key, _ in found) == sorted(tasks)
    assert all(answer == key or isinstance(answer, Died) for key, answer in found)


def test_a_call_elsewhere_computes_with_one_thread_or_tells_of_its_death(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert elsewhere(threads) == "11"  # one thread for each library
    assert os.environ["OMP_NUM_THREADS"] == "7"
    with pytest.raises(Died, match="was the memory full"):
        elsewhere(deadly)


@pytest.mark.slow
def test_a_cluster_of_another_installation_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra cluster is not installed")
    here = provenance.program()
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=":0"
    ) as cluster:
        monkeypatch.setattr(provenance, "program", lambda: here | {"python": "2.7"})
        with pytest.raises(UsageError, match=r"another installation \(python 3.* there, 2.7 here"):
            dict(side_by_side(choose(0, cluster.scheduler_address), double, {0: (1,)}))

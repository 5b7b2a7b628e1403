"""Calls side by side: every task has one answer, whoever dies, and only what is asked for runs."""

import contextlib
import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from labpipe.workflow.processes import Died, side_by_side


def double(number: int) -> int:
    if number < 0:
        raise ValueError("negative")
    return 2 * number


def deadly(task: tuple[int, Path]) -> int:
    """Kill the worker: once at 3, always at 5."""
    number, marker = task
    if number == 5 or (number == 3 and marker.exists()):
        marker.unlink(missing_ok=True)
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def threads(_: int) -> str:
    return os.environ["OMP_NUM_THREADS"] + os.environ["OPENBLAS_NUM_THREADS"]


def unsendable(number: int) -> object:
    return (lambda: number) if number else number


def naps(task: tuple[int, Path]) -> int:
    """Tell who computes, and take a moment."""
    number, folder = task
    (folder / f"{os.getpid()}").touch()
    time.sleep(0.02)
    return number


class Lazy(Mapping[int, int]):
    """Tasks that say who was asked for."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def __getitem__(self, key: int) -> int:
        self.asked.append(key)
        return key

    def __iter__(self) -> Iterator[int]:
        return iter(range(1000))

    def __len__(self) -> int:
        return 1000


def test_every_task_has_one_answer() -> None:
    found = list(side_by_side(double, {f"n{i}": i for i in range(20)}, 2))
    assert len(found) == 20
    assert dict(found) == {f"n{i}": 2 * i for i in range(20)}


def test_nothing_to_do_starts_nothing() -> None:
    assert list(side_by_side(double, {}, 2)) == []


def test_a_death_costs_nobody_else_his_result(tmp_path: Path) -> None:
    marker = tmp_path / "alive"
    marker.touch()
    found = list(side_by_side(deadly, {i: (i, marker) for i in range(8)}, 2))
    assert sorted(key for key, _ in found) == list(range(8))
    answers = dict(found)
    assert isinstance(answers.pop(5), Died)
    assert answers == {i: 2 * i for i in range(8) if i != 5}


def test_what_a_task_raises_is_raised() -> None:
    with pytest.raises(ValueError, match="negative"):
        dict(side_by_side(double, {0: 1, 1: -1}, 2))


def test_an_answer_that_cannot_be_sent_is_an_error_and_no_death() -> None:
    with pytest.raises(TypeError, match="cannot be sent between processes"):
        dict(side_by_side(unsendable, {0: 0, 1: 1}, 1))


def test_workers_killed_at_any_moment_neither_stop_the_others_nor_lose_a_task(
    tmp_path: Path, amount: Callable[[int, int], int]
) -> None:
    """A worker may be killed while it waits, computes or answers, and while another one starts."""
    done, generator = threading.Event(), random.Random(3)

    def kill() -> None:
        while not done.wait(generator.uniform(0.0, 0.2)):
            workers = [int(path.name) for path in tmp_path.iterdir()]
            if workers:
                (tmp_path / str(victim := generator.choice(workers))).unlink()
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        tasks = {i: (i, tmp_path) for i in range(amount(40, 3000))}
        found = list(side_by_side(naps, tasks, 3))
    finally:
        done.set()
        killer.join()
    assert sorted(key for key, _ in found) == sorted(tasks)
    assert all(answer == key or isinstance(answer, Died) for key, answer in found)


def test_tasks_are_asked_for_when_their_turn_comes() -> None:
    tasks = Lazy()
    answers = side_by_side(double, tasks, 2)
    for _ in range(3):
        next(answers)
    answers.close()
    assert len(tasks.asked) < 10


def test_a_worker_computes_with_one_thread_and_leaves_ours_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert dict(side_by_side(threads, {0: 0}, 1)) == {0: "11"}
    assert os.environ["OMP_NUM_THREADS"] == "7"

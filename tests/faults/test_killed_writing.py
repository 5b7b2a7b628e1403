"""Killed while a page, a figure, a session.toml or a recording is written: nothing is lost."""

import os
import random
import shutil
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

import instruments
from instruments import keyence
from instruments.keyence import Setup, record
from pipelines.figures import make
from pipelines.session import init, process
from tests.faults.crashes import killed_after, moments, operations
from tests.faults.test_failed_inputs import session
from tests.instruments.keyence_emulator import Counting

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

Amount = Callable[[int, int], int]
SETUP = Setup((1,), (4,), ("mm",), 1e-3)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file but what tells of times, and what only saves time."""
    left_out = {"run.jsonl", "hashes.json", "index.json"}
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in left_out and path.suffix != ".lock"
    }


def make_pages(folder: Path) -> None:
    session(folder, b"this is no recording\n")


def write_pages(folder: Path) -> None:
    assert process(folder, jobs=0).exit_code == 3  # nothing can be read: every page says why


def make_nothing(folder: Path) -> None:
    folder.mkdir()


def write_figures(folder: Path) -> None:
    outcomes = make.make(make.Shelf.of(folder / "figures", None), make.chosen(["1.2"]))
    assert all(outcome.state in ("drawn", "up to date") for outcome in outcomes), outcomes


def make_laser(folder: Path) -> None:
    start = datetime(2026, 5, 14)  # storage files know no zone
    for n in range(2):
        readings = {1: np.linspace(0.0, 1e-3 * (n + 1), 50)}
        keyence.write(folder / f"drop_{n}.csv", readings, cycle="50 us", start=start)


def write_configuration(folder: Path) -> None:
    init(folder, replace=True)


PROGRAMS: dict[str, tuple[Callable[[Path], None], Callable[[Path], None]]] = {
    "report": (make_pages, write_pages),
    "figure": (make_nothing, write_figures),
    "configuration": (make_laser, write_configuration),
}
DRAWN = ("report", "figure")  # drawing takes a second


@pytest.mark.parametrize("what", [pytest.param(p, marks=pytest.mark.slow) if p in DRAWN else p for p in PROGRAMS])
def test_killed_before_any_operation_the_next_run_ends_as_an_undisturbed_one(
    tmp_path: Path, what: str, amount: Amount
) -> None:
    prepare, write = PROGRAMS[what]
    folder = tmp_path / "session"  # pages name the folder: always the same one
    prepare(folder)
    write(folder)  # for the first time this process imports modules, which may write their caches
    shutil.rmtree(folder)
    prepare(folder)
    total = operations(folder, lambda: write(folder))
    assert total
    expected = contents(folder)
    usual, killed = 2 if what in DRAWN else 4, 0
    for last in moments(total, amount(usual, 120)):
        shutil.rmtree(folder)
        prepare(folder)
        # one that waits for nothing does fewer operations than were counted, and may end before
        killed += operations(folder, lambda: write(folder), last) is None
        write(folder)
        assert contents(folder) == expected, last
        assert not list(folder.rglob(".*.part")), last
    assert killed


def test_a_recording_killed_at_any_time_is_readable_but_for_the_last_rows(tmp_path: Path, amount: Amount) -> None:
    rng = random.Random(9)
    found = 0
    for n in range(amount(3, 60)):
        target = tmp_path / f"{n}.csv"
        seconds = rng.uniform(0.2, 1.5)
        begun = time.monotonic()
        assert killed_after(
            seconds,
            lambda target=target: record(target, SETUP, Counting, 60.0),  # type: ignore[arg-type]
        )
        assert time.monotonic() - begun >= seconds
        if not target.exists():
            continue  # a busy machine did not come as far as the first rows
        readings = instruments.read(target)["out1"].values
        counted = np.round(readings[np.isfinite(readings)] * 1e7)
        assert counted.tolist() == list(range(1, counted.size + 1))
        found += counted.size
    assert found > 20

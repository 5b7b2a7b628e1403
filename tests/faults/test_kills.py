"""Killed at any operation on files: the next run finishes and equals an undisturbed one."""

import errno
import os
import random
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from labpipe import files
from labpipe.workflow import events, provenance, runner
from labpipe.workflow.watch import Watcher
from tests.by_day import by_day, crossed
from tests.faults.crashes import failing, killed_after, moments, operations
from tests.labpipe.workflow import toy_laboratory as toy

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

Amount = Callable[[int, int], int]


def dataset(value: float, size: int = 50) -> xr.Dataset:
    values = ("time", np.full(size, value), {"units": "m", "long_name": "position"})
    return xr.Dataset({"z": values})


WRITERS: dict[str, Callable[[Path, float], None]] = {
    "chunks": lambda path, value: files.write_bytes(path, [str(value).encode()] * 3, 9),
    "dataset": lambda path, value: files.write_dataset(path, dataset(value)),
}


@pytest.mark.parametrize("kind", by_day(WRITERS, 2))
def test_a_file_is_the_old_or_the_new_one_at_every_moment(tmp_path: Path, kind: str) -> None:
    write = WRITERS[kind]
    path = tmp_path / "there" / "file"
    contents = []
    for value in (1.0, 2.0):
        write(path, value)
        contents.append(path.read_bytes())
    total = operations(tmp_path, lambda: write(path, 2.0))
    assert total
    for last in range(1, total + 1):
        path.write_bytes(contents[0])
        assert operations(tmp_path, lambda: write(path, 2.0), last) is None
        assert path.read_bytes() in contents
        write(path, 2.0)
        assert path.read_bytes() == contents[1]


def test_a_dataset_is_the_old_or_the_new_one_however_long_it_was_written(tmp_path: Path, amount: Amount) -> None:
    path = tmp_path / "result.nc"
    contents = []
    for value in (1.0, 2.0):
        start = time.perf_counter()
        files.write_dataset(path, dataset(value, 200_000))
        took = time.perf_counter() - start
        contents.append(path.read_bytes())
    rng = random.Random(5)
    cut = 0
    for _ in range(amount(6, 600)):
        path.write_bytes(contents[0])
        cut += killed_after(rng.uniform(0.0, took), lambda: files.write_dataset(path, dataset(2.0, 200_000)))
        assert path.read_bytes() in contents
    assert cut


@pytest.fixture
def laboratory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "toy_laboratory", toy)
    # The state of the repository may change while the tests run; a result must not differ by that.
    monkeypatch.setattr(provenance, "git_state", lambda folder: None)
    # Nor by what other tests have left beside the compiled modules.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)


def run_toys(folder: Path) -> None:
    session = toy.load(folder, toy.KINDS)
    result = runner.run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    assert result.exit_code == 0, [o.message for o in result.failures]


def watch_toys(folder: Path) -> None:
    def run_one(session: toy.Session, name: str) -> runner.RunResult:
        return runner.run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0, only=[name])

    watcher = Watcher(folder, toy.KINDS, toy.STAGES, lambda experiment, path: None, run_one)
    for _ in range(6):
        assert all(news.state != "failed" for news in watcher.look())


PROGRAMS = {"process": run_toys, "watch": watch_toys}


@pytest.mark.usefixtures("laboratory")
@pytest.mark.parametrize("program", by_day(PROGRAMS, 1))
def test_a_run_killed_before_any_operation_is_finished_by_the_next(
    tmp_path: Path, program: str, amount: Amount
) -> None:
    """Results, records, pages, the index and the log: each is killed while it is written."""
    run = PROGRAMS[program]
    calm = toy.make_session(tmp_path / "calm", toy.SMALL)
    total = operations(tmp_path, lambda: run(calm.root))
    assert total is not None
    assert total > 50
    expected = toy.contents(calm)
    assert expected
    chosen, killed = moments(total, amount(6, 300)), 0
    for last in chosen:
        session = toy.make_session(tmp_path / str(last), toy.SMALL)
        done = operations(session.root, lambda folder=session.root: run(folder), last)
        # a file is looked at again when it is young, so that a slower run does more
        assert done is None or done < last
        killed += done is None
        run(session.root)
        assert toy.contents(session) == expected, last
        assert not list(session.folder.rglob(".*.part")), last
        assert len(list(events(session))) > 1
        shutil.rmtree(session.root)
    assert killed > len(chosen) // 2


DISKS = {"full": errno.ENOSPC, "read-only": errno.EROFS, "share gone": errno.ESTALE}


def run_and_tell(folder: Path) -> str:
    session = toy.load(folder, toy.KINDS)
    result = runner.run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    texts = [o.message for o in result.failures]
    return f"{result.exit_code} {texts}" if texts else str(result.exit_code)


def damage(session: toy.Session) -> None:
    for path in session.folder.glob("store/??/*.nc"):
        path.write_bytes(path.read_bytes()[:-1])


@pytest.mark.usefixtures("laboratory")
@pytest.mark.parametrize(("disk", "store"), crossed(DISKS, ["empty", "damaged"], 2, 4))
def test_a_disk_that_fails_from_any_operation_on_is_named_and_spoils_nothing(
    tmp_path: Path, disk: str, store: str, amount: Amount
) -> None:
    calm = toy.make_session(tmp_path / "calm", toy.SMALL)
    run_toys(calm.root)
    expected = toy.contents(calm)
    if store == "damaged":
        damage(calm)
    else:
        shutil.rmtree(calm.folder)
    total = operations(tmp_path, lambda: run_toys(calm.root))
    assert total
    for first in moments(total, amount(3, 40)):
        session = toy.make_session(tmp_path / str(first), toy.SMALL)
        if store == "damaged":
            run_toys(session.root)
            damage(session)
        root = session.root
        said = failing(root, lambda folder=root: run_and_tell(folder), first, DISKS[disk])
        assert said == "0" or said.startswith(("5 [", "StorageError: ")), (first, said)
        assert "unexpected" not in said, (first, said)
        run_toys(session.root)
        found = {name: data for name, data in toy.contents(session).items() if "quar" not in name}
        assert found == expected, first
        assert not list(session.folder.rglob(".*.part")), first
        shutil.rmtree(session.root)

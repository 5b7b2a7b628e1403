"""A real disk that is too small: named, and nothing is spoilt."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import instruments
from instruments.keyence import Setup, record, recover
from labpipe.errors import StorageError
from labpipe.workflow import provenance, runner
from tests.faults.crashes import moments
from tests.faults.mounts import resize, small_disk
from tests.instruments.keyence_emulator import Counting
from tests.labpipe.workflow import toy_laboratory as toy

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")

Amount = Callable[[int, int], int]
ROOMY = 64 << 20


@pytest.fixture(autouse=True)
def laboratory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "toy_laboratory", toy)
    monkeypatch.setattr(provenance, "git_state", lambda folder: None)


def run(folder: Path) -> tuple[int, list[str]]:
    session = toy.load(folder, toy.KINDS)
    result = runner.run(session, toy.STAGES, schemas=toy.SCHEMAS, jobs=0)
    return result.exit_code, [o.message for o in result.failures]


def test_a_disk_of_any_size_is_named_as_too_small_or_large_enough(tmp_path: Path, amount: Amount) -> None:
    calm = toy.make_session(tmp_path / "calm", toy.SMALL)
    assert run(calm.root) == (0, [])
    expected = toy.contents(calm)
    used = sum(f.stat().st_size for f in calm.root.rglob("*") if f.is_file())
    sizes = moments(2 * used // 4096, amount(5, 40))
    refused = 0
    for pages in sizes[1:]:
        with small_disk(tmp_path / "disk", ROOMY) as disk:
            session = toy.make_session(disk / "session", toy.SMALL)
            inputs = sum(-(-f.stat().st_size // 4096) + 1 for f in disk.rglob("*"))
            resize(disk, (inputs + pages) * 4096)
            code, texts = run(session.root)
            assert code in (0, 5), texts
            if code:
                refused += 1
                assert all("needed" in text or "full" in text for text in texts), texts
            for name, data in toy.contents(session).items():
                assert expected[name] == data, name
            resize(disk, ROOMY)
            assert run(session.root) == (0, [])
            assert toy.contents(session) == expected
            assert not list(session.folder.rglob(".*.part"))
    assert 0 < refused < len(sizes)


def test_a_disk_that_fills_up_while_a_sensor_is_recorded_keeps_the_readings(tmp_path: Path) -> None:
    setup = Setup((1,), (4,), ("mm",), 2e-4)
    with small_disk(tmp_path / "disk", 16384) as disk:
        with pytest.raises(StorageError, match="no space left"):
            record(disk / "a.csv", setup, Counting, 20.0)  # type: ignore[arg-type]
        resize(disk, ROOMY)
        recover(disk / "a.csv")
        assert instruments.read(disk / "a.csv").sizes["time"] > 50

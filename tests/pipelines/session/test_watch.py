"""Watching a session arrive: never half a file, and in the end what `process` would have made."""

import os
import shutil
from pathlib import Path

import pytest

from labpipe.workflow.watch import ARRIVING, BROKEN, FAILED, PROCESSED, REFUSED, WAITING
from pipelines.session import plan, process, watch
from tests.by_day import by_day
from tests.pipelines.stored import results


class Clock:
    """Gives every write its own modification time, however coarse that of the disk is."""

    def __init__(self) -> None:
        self.now = 1_700_000_000

    def write(self, path: Path, data: bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        self.now += 1
        os.utime(path, (self.now, self.now))


@pytest.mark.slow
@pytest.mark.parametrize("jobs", by_day([0, 1], 1))
def test_a_session_copied_in_pieces_gives_the_bytes_that_process_gives(
    small_session: Path, pristine_session: Path, tmp_path: Path, jobs: int
) -> None:
    """Every file comes in three pieces with looks in between; results are those of one run."""
    folder, clock = tmp_path / "session", Clock()
    folder.mkdir()
    watcher = watch(folder, looks=2, jobs=jobs)
    assert [n.state for n in watcher.look()] == [WAITING]
    names = ["session.toml", "laser/drop_1.csv", "calibration/laser.toml", "mach1/nbr.txt", "laser/drop_2.csv"]
    processed_after = {}
    for name in names:
        data = (small_session / name).read_bytes()
        pieces = [len(data) // 3, 2 * len(data) // 3, len(data)]
        for end in pieces:
            clock.write(folder / name, data[:end])
            for _ in range(3):  # the pause is longer than a file must rest
                for news in watcher.look():
                    assert news.state != FAILED, news.text
                    if news.state == PROCESSED:
                        processed_after[news.experiment] = (name, end == len(data))
    assert processed_after == {"nbr": ("mach1/nbr.txt", True), "drop": ("laser/drop_2.csv", True)}
    assert watcher.is_done
    assert results(folder) == results(pristine_session)
    assert plan(folder).to_run == ()
    assert process(folder, jobs=0).exit_code == 0
    assert results(folder) == results(pristine_session)


def test_a_file_that_rests_half_copied_is_refused_and_said_once(small_session: Path, tmp_path: Path) -> None:
    folder = tmp_path / "session"
    shutil.copytree(small_session, folder)
    data = (folder / "laser/drop_1.csv").read_bytes()
    at_a_line_end = data.rindex(b"\r\n", 0, len(data) // 2) + 2
    (folder / "laser/drop_1.csv").write_bytes(data[:at_a_line_end])
    mach1 = (folder / "mach1/nbr.txt").read_bytes()
    (folder / "mach1/nbr.txt").write_bytes(mach1[: mach1.rindex(b"\r\n", 0, len(mach1) // 2) + 2])
    watcher = watch(folder, looks=2, jobs=0)
    said = [news for _ in range(5) for news in watcher.look()]
    assert [(n.experiment, n.state) for n in said] == [
        ("drop", ARRIVING),
        ("nbr", ARRIVING),
        ("drop", REFUSED),
        ("nbr", REFUSED),
    ]
    assert "rows, the header states" in said[2].text
    assert not (folder / "labpipe").exists()
    assert not watcher.is_done


def test_a_broken_session_file_is_told_and_mended(small_session: Path, tmp_path: Path) -> None:
    clock = Clock()
    clock.write(tmp_path / "session.toml", b"labpipe = 1\n[experiments.a]\nkind = 'nothing'\n")
    watcher = watch(tmp_path, looks=2, jobs=0)
    said = [news for _ in range(3) for news in watcher.look()]
    assert [(n.experiment, n.state) for n in said] == [("", BROKEN)]
    assert "session.toml:3" in said[0].text
    clock.write(tmp_path / "session.toml", (small_session / "session.toml").read_bytes())
    said = [news for _ in range(3) for news in watcher.look()]
    assert {(n.experiment, n.state) for n in said} == {("drop", WAITING), ("nbr", WAITING)}
    assert "0 of 3 files are there; next: laser/drop_1.csv" in said[0].text

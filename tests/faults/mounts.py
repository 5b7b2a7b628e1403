"""Real small disks, and shares that go away: for tests that may mount."""

import contextlib
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest


def _run(*arguments: str) -> str | None:
    """Run a command; None when it went well, or what it said."""
    try:
        done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return f"there is no {arguments[0]}"
    return None if not done.returncode else done.stderr.strip() or "failed"


@contextlib.contextmanager
def small_disk(folder: Path, size: int) -> Iterator[Path]:
    """Mount a disk of some bytes at a folder; skip the test where that is not allowed."""
    folder.mkdir(exist_ok=True)
    said = _run("mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(folder))
    if said:
        pytest.skip(f"mounting a small disk is not allowed here: {said}")
    try:
        yield folder
    finally:
        _run("umount", "-l", str(folder))


def resize(folder: Path, size: int) -> None:
    """Give a small disk another size."""
    assert (said := _run("mount", "-o", f"remount,size={size}", str(folder))) is None, said

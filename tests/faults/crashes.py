"""Kill -9 at a chosen operation on files: every moment of a program can be tried, none by chance.

A child of ``fork`` runs the program and kills itself before its n-th operation that changes a folder (opening for
writing, renaming, deleting, making a folder, flushing); or, from there on, each of them fails as on a full disk.
"""

import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

_CHANGES = {f"os.{name}" for name in ("rename", "remove", "mkdir", "rmdir", "truncate", "link", "symlink")}
_CHANGES |= {"shutil.move", "shutil.rmtree"}


class _Counter:
    """Counts operations below a folder; dies before the one it is told, or lets all fail there."""

    def __init__(self, folder: Path, last: int, error: int = 0) -> None:
        self.folder, self.last, self.count, self.error = str(folder), last, 0, error

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _mode, flags = arguments
            is_change = bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
        else:
            path, is_change = (arguments or ("",))[0], event in _CHANGES
        if is_change and str(path).startswith(self.folder):
            self.note(path)

    def note(self, path: object = None) -> None:
        self.count += 1
        if self.count == self.last and not self.error:
            os.kill(os.getpid(), signal.SIGKILL)
        if self.error and 0 < self.last <= self.count:
            raise OSError(self.error, os.strerror(self.error), path)


def _fork() -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # only this thread goes on in it
        return os.fork()


def _child(folder: Path, last: int, program: Callable[[], object], report: int, error: int) -> None:
    code = 1
    try:
        counter = _Counter(folder, last, error)
        sys.addaudithook(counter)
        flush = os.fsync

        def fsync(handle: int) -> None:
            counter.note()
            flush(handle)

        os.fsync = fsync  # type: ignore[assignment]  # flushing raises no audit event
        said = program()
        os.write(report, str(said if error else counter.count).encode())
        code = 0
    except BaseException as found:
        os.write(report, f"{type(found).__name__}: {found}".encode())
        code = 0 if error else 1
    finally:
        os._exit(code)


def failing(folder: Path, program: Callable[[], object], first: int, error: int) -> str:
    """Run a program in a child where operations fail from number ``first`` on; return its result, or its exception."""
    return _run(folder, program, first, error) or "killed"


def operations(folder: Path, program: Callable[[], object], last: int = -1) -> int | None:
    """Run a program in a child that dies before its operation number ``last``; count operations, None if killed."""
    said = _run(folder, program, last, 0)
    return None if said is None else int(said)


def _run(folder: Path, program: Callable[[], object], last: int, error: int) -> str | None:
    reader, writer = os.pipe()
    pid = _fork()
    if not pid:
        os.close(reader)
        _child(folder, last, program, writer, error)
    os.close(writer)
    with os.fdopen(reader) as stream:
        said = stream.read()
    status = os.waitpid(pid, 0)[1]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL:
        return None
    assert os.waitstatus_to_exitcode(status) == 0, f"the program itself failed: {said}"
    return said


def at_once(programs: Sequence[Callable[[], str]]) -> list[str]:
    """Run programs in a child each, all begun before the first has ended; return what they say."""
    gate, opener = os.pipe()
    children = []
    for program in programs:
        reader, writer = os.pipe()
        pid = _fork()
        if not pid:
            said = "broken off"
            try:
                os.close(opener)
                os.read(gate, 1)  # until the parent closes the other end
                said = program()
            except BaseException as found:
                said = f"{type(found).__name__}: {found}"
            finally:
                os.write(writer, said.encode())
                os._exit(0)
        os.close(writer)
        children.append((pid, reader))
    os.close(opener)
    os.close(gate)
    texts = []
    for pid, reader in children:
        with os.fdopen(reader) as stream:
            texts.append(stream.read())
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0, texts[-1]
    return texts


def killed_after(seconds: float, program: Callable[[], object]) -> bool:
    """Run a program in a child and kill it after a time; tell whether it was still at work."""
    pid = _fork()
    if not pid:
        try:
            program()
        finally:
            os._exit(0)
    time.sleep(seconds)
    os.kill(pid, signal.SIGKILL)
    return os.WIFSIGNALED(os.waitpid(pid, 0)[1])


def moments(total: int, wanted: int) -> list[int]:
    """Spread numbers of operations evenly over 1 … total, the first and the last among them."""
    if wanted >= total:
        return list(range(1, total + 1))
    return sorted({1 + round(k * (total - 1) / (wanted - 1)) for k in range(wanted)})

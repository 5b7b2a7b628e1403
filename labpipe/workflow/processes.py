"""Calls of one function computed side by side in processes, whoever of them dies.

The processes are forked from a server and run the numerical libraries on one thread each, so that
a result does not depend on how many processors there are.
"""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import traceback
import types
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from itertools import islice
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar, cast

Key = TypeVar("Key")
Task = TypeVar("Task")
Result = TypeVar("Result")

ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
    "MPLBACKEND": "Agg",
}
"""Of every worker."""

METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""How processes begin; never a fork of this one, which may run threads."""

_TRIES = 3
PATIENCE = 5.0
"""Seconds that a process gets to end after it was asked to."""


def processors() -> int:
    """Count the processors that this process may use, not those that the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Died(Exception):  # noqa: N818 (an observation about another process)
    """A worker ended without saying so."""


def side_by_side(
    function: Callable[[Task], Result],
    tasks: Mapping[Key, Task],
    workers: int,
    *,
    begin: Callable[[], None] | None = None,
    preload: Sequence[str] = ("numpy", "xarray"),
) -> Generator[tuple[Key, Result | Died]]:
    """Call a function for every task, some at a time.

    A worker that dies takes nothing with it: what it was computing is tried again alone once all
    others have their answers, and what killed three workers is answered by :class:`Died`. Every
    task has one answer. Workers share no queue and no lock that a dead one could keep: each has a
    pipe of its own.

    Parameters
    ----------
    function : callable
        Of a module, not of a script: it is found by its name in the workers.
    tasks : mapping
        Values are asked for when their turn comes, in the mapping's order.
    workers : int
        Processes, at least 1.
    begin : callable, optional
        Called once in every worker before its first task.
    preload : sequence of str
        Modules that the server loads once, not every worker; the first call of a program decides.

    Yields
    ------
    tuple
        A key, and the result or a :class:`Died`, as soon as it is there. What the function raises
        is raised.
    """
    if METHOD == "forkserver":
        multiprocessing.get_context(METHOD).set_forkserver_preload(list(preload))
    suspects = yield from _answers(function, tasks, iter(tasks), workers, begin)
    for key in suspects:
        for _ in range(_TRIES - 1):
            if not (yield from _answers(function, tasks, iter([key]), 1, begin)):
                break
        else:
            yield key, Died(f"{_TRIES} workers died over it")


def _answers(
    function: Callable[[Task], Result],
    tasks: Mapping[Key, Task],
    queue: Iterator[Key],
    workers: int,
    begin: Callable[[], None] | None,
) -> Generator[tuple[Key, Result], None, list[Key]]:
    """Compute all of a queue; return the tasks over which a worker died."""
    lost: list[Key] = []
    idle: list[_Worker] = []
    busy: dict[connection.Connection, tuple[_Worker, Key]] = {}
    try:
        while True:
            for key in islice(queue, workers - len(busy)):
                worker = idle.pop() if idle else _Worker(function, begin)
                if not worker.take(tasks[key]):  # died with nothing to do: nobody's fault
                    worker.stop()
                    worker = _Worker(function, begin)
                    worker.take(tasks[key])
                busy[worker.pipe] = worker, key
            if not busy:
                return lost
            for pipe in connection.wait(list(busy)):
                worker, key = busy[cast(connection.Connection, pipe)]
                try:
                    result = worker.answer()
                except Died:
                    del busy[worker.pipe]
                    worker.stop()
                    lost.append(key)
                    continue
                del busy[worker.pipe]
                idle.append(worker)
                yield key, result
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            worker.stop()


class _Worker:
    """A process that computes one task after another."""

    def __init__(self, function: Callable[[Any], Any], begin: Callable[[], None] | None) -> None:
        context: Any = multiprocessing.get_context(METHOD)
        self.pipe, its_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(its_end, function, begin), daemon=True)
        with clean_start():
            self.process.start()
        its_end.close()  # so that its death closes the pipe

    def take(self, task: Any) -> bool:
        """Hand out a task; False where nobody is there to take it."""
        try:
            self.pipe.send(task)
        except OSError:
            return False
        return True

    def answer(self) -> Any:
        """Return what became of the task, or raise what it raised.

        Raises
        ------
        Died
            The process ended first.
        """
        try:
            is_result, value = self.pipe.recv()
        except (EOFError, OSError):
            raise Died from None
        if not is_result:
            raise value
        return value

    def stop(self) -> None:
        """End the process; what it was computing is lost."""
        end(self.process)
        self.pipe.close()


def _serve(
    pipe: connection.Connection,
    function: Callable[[Any], Any],
    begin: Callable[[], None] | None,
) -> None:
    """Body of a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    os.environ.update(ENVIRONMENT)
    die_with_parent()
    if begin is not None:
        begin()
    with contextlib.suppress(EOFError, OSError):  # the parent is done with us
        while True:
            task = pipe.recv()
            answer: tuple[bool, Any]
            try:
                answer = True, function(task)
            except Exception as error:
                error.add_note(traceback.format_exc())
                answer = False, error
            _send(pipe, answer)


def _send(pipe: connection.Connection, answer: tuple[bool, Any]) -> None:
    """Send an answer; one that cannot be sent is a fault of the function, not a death."""
    try:
        pipe.send(answer)
    except OSError:
        raise
    except Exception as error:
        pipe.send((False, TypeError(f"{answer[1]!r} cannot be sent between processes: {error}")))


def end(process: BaseProcess) -> None:
    """End a process, by force where it does not answer."""
    process.terminate()
    process.join(PATIENCE)
    if process.is_alive():
        process.kill()
        process.join()


def die_with_parent() -> None:
    """End this worker at once when its parent is gone: no orphan keeps computing, or a lock."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextlib.contextmanager
def clean_start() -> Iterator[None]:
    """Start processes with one thread per library, and without the calling script.

    A worker imports what it calls by name. If it ran the script again, a script or notebook
    without the ``__main__`` guard would start itself in every worker.
    """
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    main = sys.modules["__main__"]
    os.environ.update(ENVIRONMENT)
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value

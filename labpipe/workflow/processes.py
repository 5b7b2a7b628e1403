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
import types
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from multiprocessing import connection
from typing import TypeVar

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

    A worker that dies takes nothing with it: whoever was being computed is a suspect and tried
    again alone; who kills three workers is answered by :class:`Died`. Every task has one answer.

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
    deaths: dict[Key, int] = {}
    fresh = iter(tasks)
    while True:
        # After a death nobody knows whose fault it was: each suspect is tried alone.
        queue, count = (iter(list(deaths)), 1) if deaths else (fresh, workers)
        lost = yield from _until_one_dies(function, tasks, queue, count, begin, deaths)
        if not lost and queue is fresh:
            return
        for key in lost:
            deaths[key] = deaths.get(key, 0) + 1
            if deaths[key] >= _TRIES:
                del deaths[key]
                yield key, Died(f"{_TRIES} workers died over it")


def _until_one_dies(
    function: Callable[[Task], Result],
    tasks: Mapping[Key, Task],
    queue: Iterator[Key],
    workers: int,
    begin: Callable[[], None] | None,
    deaths: dict[Key, int],
) -> Generator[tuple[Key, Result | Died], None, list[Key]]:
    """Compute until the queue is empty or a worker dies; return the tasks that were lost then."""
    in_flight = workers if workers == 1 else workers + 1  # one in reserve keeps them busy
    handed_out: list[Key] = []
    running: dict[Future[Result], Key] = {}
    context = multiprocessing.get_context(METHOD)
    with ProcessPoolExecutor(workers, context, _begin_worker, (begin,)) as pool:
        try:
            while True:
                for key in islice(queue, in_flight - len(running)):
                    handed_out.append(key)
                    with clean_start():
                        running[pool.submit(function, tasks[key])] = key
                if not running:
                    return []
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    key = running.pop(future)
                    handed_out.remove(key)
                    deaths.pop(key, None)
                    yield key, result
        except BrokenProcessPool:
            return handed_out


def _begin_worker(begin: Callable[[], None] | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    os.environ.update(ENVIRONMENT)
    die_with_parent()
    if begin is not None:
        begin()


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

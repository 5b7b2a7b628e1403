"""Calls side by side: in this process, in a pool of local processes, or on a Dask cluster.

A :class:`Crew` is given one call after the other and answers each; behind it is an executor of
:mod:`concurrent.futures`. A call is a function without arguments that can be pickled, as :func:`functools.partial` is.
Local processes compute on one thread each, so that an answer does not depend on their number, and end with the crew. A
process that dies breaks the pool, and a new one is started.
"""

import contextlib
import importlib
import multiprocessing
import os
import signal
import sys
import threading
import types
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Any, TypeVar

from labpipe.errors import InputError, LabpipeError, UsageError

Key = TypeVar("Key")
Call = Callable[[], Any]

_ENVIRONMENT = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")} | {
    "VECLIB_MAXIMUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
    "MPLBACKEND": "Agg",
}
"""Of every local process."""
_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""How processes begin; never a fork of this one, which may run threads."""


class Died(Exception):  # noqa: N818 (an observation about another process)
    """A process ended before it answered."""


@dataclass(slots=True)
class Crew:
    """The calls under way, by the keys under which they were given.

    ``start`` returns the future of a call, ``size`` how many may be under way at once. ``imports`` are modules that
    local processes load once for all; those of the first call of a program count. A call that was under way when a
    local process died is tried once more, in a process of its own; after a second death its answer is :class:`Died`.
    """

    start: Callable[[Call, Sequence[str]], "Future[Any]"]
    size: Callable[[], int]
    under_way: "dict[Future[Any], tuple[Any, Call]]" = field(default_factory=dict)

    @property
    def room(self) -> int:
        """Calls that can be given now."""
        return max(self.size() - len(self.under_way), 0)

    def give(self, key: Any, call: Call, imports: Sequence[str] = ()) -> None:
        """Hand out a call under a key."""
        self.under_way[self.start(call, imports)] = key, call

    def ended(self) -> Iterator[tuple[Any, Any]]:
        """Wait 0.1 s for answers; yield key and answer of the calls that have ended, raise the error of one."""
        for future in wait(self.under_way, 0.1, FIRST_COMPLETED).done:
            key, call = self.under_way.pop(future)
            try:
                answer = future.result()
            except BrokenProcessPool:
                try:
                    answer = elsewhere(call)
                except Died as death:
                    answer = death
            except CancelledError as error:
                raise LabpipeError("the Dask scheduler no longer answers; run again to go on") from error
            except Exception as error:
                if type(error).__name__ != "KilledWorker":  # of Dask, which need not be installed
                    raise
                answer = Died("its workers died one after the other; was the memory full?")
            yield key, answer


def choose(jobs: int, cluster: str | None = None) -> AbstractContextManager[Crew]:
    """Open a crew of ``jobs`` local processes, or of the Dask scheduler at the address ``cluster``, for one block.

    Without jobs it computes in this process, for a debugger. Raises InputError where the number is negative.
    """
    if jobs < 0:
        raise InputError(f"jobs must be at least 0, found {jobs}")
    if cluster is not None:
        return _cluster(cluster)
    return _processes(jobs) if jobs else contextlib.nullcontext(Crew(_here, lambda: 1))


def processors() -> int:
    """Count the processors that this process may use, not those that the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def side_by_side(
    engine: AbstractContextManager[Crew],
    function: Callable[..., Any],
    tasks: Mapping[Key, tuple[Any, ...]],
    *,
    imports: Sequence[str] = ("numpy", "xarray"),
) -> Generator[tuple[Key, Any]]:
    """Call a function with the arguments of every task, and yield key and answer in the order of the answers.

    Tasks do not wait for each other and are taken when their turn comes. An error of the function is raised; see
    :class:`Crew`.
    """
    queue = iter(tasks)
    with engine as crew:
        while True:
            for key in islice(queue, crew.room):
                crew.give(key, partial(function, *tasks[key]), imports)
            if not crew.under_way:
                return
            yield from crew.ended()


def elsewhere(call: Call, imports: Sequence[str] = ()) -> Any:
    """Return the answer of a call in a local process of its own; raise its error, or :class:`Died`."""
    with _processes(1) as crew:
        try:
            return crew.start(call, imports).result()
        except BrokenProcessPool:
            raise Died("its process was ended from outside, or crashed; was the memory full?") from None


def _here(call: Call, imports: Sequence[str]) -> "Future[Any]":
    """Compute a call in this process."""
    future: Future[Any] = Future()
    future.set_result(call())
    return future


# --- local processes ---------------------------------------------------------------------------


@contextlib.contextmanager
def _processes(size: int) -> Iterator[Crew]:
    """Open a crew of processes that begin when they are needed and end when this one does, however it ends."""
    context = multiprocessing.get_context(_METHOD)
    watched, held = context.Pipe(duplex=False)
    executor: ProcessPoolExecutor | None = None

    def start(call: Call, imports: Sequence[str]) -> "Future[Any]":
        """Give a call to processes, begun with one thread for each library and without a script that starts itself."""
        nonlocal executor
        before, main = {**os.environ}, sys.modules["__main__"]
        os.environ.update(_ENVIRONMENT)
        sys.modules["__main__"] = types.ModuleType("__main__")
        try:
            if executor is None and _METHOD == "forkserver":
                context.set_forkserver_preload(list(imports))
            while True:
                executor = executor or ProcessPoolExecutor(size, context, _begin, (watched,))
                try:
                    return executor.submit(call)
                except BrokenProcessPool:  # the calls under way find out by their futures
                    executor.shutdown()
                    executor = None
        finally:
            sys.modules["__main__"] = main
            for name in _ENVIRONMENT:
                del os.environ[name]
            os.environ.update(before)

    try:
        yield Crew(start, lambda: size)
    finally:
        held.close()  # ends all processes at once; unfinished results never come to exist
        if executor is not None:
            executor.shutdown(cancel_futures=True)  # waits until their locks are free and nothing is written
        watched.close()


def _begin(watched: Any) -> None:
    """Prepare a worker: quiet, on one thread, and ending when the other end of a pipe is closed."""

    def end() -> None:
        with contextlib.suppress(EOFError, OSError):
            watched.recv()
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    os.environ.update(_ENVIRONMENT)
    # Standard output belongs to the command; what a call or a library prints goes to the errors.
    os.dup2(sys.__stderr__.fileno() if sys.__stderr__ else 2, 1)
    threading.Thread(target=end, daemon=True).start()


# --- a cluster ---------------------------------------------------------------------------------

_ONE_AT_A_TIME = threading.Lock()
"""Of a worker, whose threads would share what is not made for it: HDF5, and caught warnings."""


@contextlib.contextmanager
def _cluster(address: str) -> Iterator[Crew]:
    """Open a crew of the workers of a Dask scheduler, which tries a call three times on workers that die.

    Raises UsageError: the extra ``cluster`` is not installed, or nobody answers at the address.
    """
    from labpipe.workflow.provenance import program

    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError as error:
        raise UsageError("--cluster needs Dask: pip install 'labpipe[cluster]'") from error
    try:
        client = distributed.Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"no Dask scheduler answers at {address} ({error})") from error
    with client:
        executor, here = client.get_executor(pure=False), program()  # a call also writes files
        yield Crew(
            lambda call, imports: executor.submit(_compute_there, call, here),
            lambda: 4 * max(sum(client.nthreads().values()), 4),  # so that no thread waits for this process
        )


def _compute_there(call: Call, program: Mapping[str, Any]) -> Any:
    """Compute on a worker of the cluster; UsageError where its installation is another."""
    from distributed import get_worker

    from labpipe.workflow import provenance

    if (own := provenance.program()) != program:
        there, here = ({**about, **about["libraries"]} for about in (own, program))
        differing = [n for n in here if n != "libraries" and there.get(n) != here[n]]
        listed = ", ".join(f"{n} {there.get(n)} there, {here[n]} here" for n in differing)
        where = f"the worker {get_worker().address} has another installation ({listed})"
        raise UsageError(f"{where}; install the same versions everywhere")
    with _ONE_AT_A_TIME:
        return call()

"""Calls side by side: in this process, in a pool of local processes, or on a Dask cluster.

An engine hires a :class:`Crew`, which is given one :class:`Call` after the other and answers each. Events of a
running call, and the end of every call, arrive in one queue. Local processes are a
:class:`concurrent.futures.ProcessPoolExecutor`; they compute on one thread each, so that an answer does not depend on
their number, and end with the crew. A process that dies breaks the pool: a new one is started, and the calls that
were under way are answered by :class:`Died`.
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
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import count, islice
from multiprocessing.managers import SyncManager
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar
from uuid import uuid4

from labpipe.errors import InputError, LabpipeError, UsageError

Key = TypeVar("Key")
Tell = Callable[[Any], None]
"""Takes events of a call that is under way."""

_TRIES = 3
_ENVIRONMENT = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
    "MPLBACKEND": "Agg",
}
"""Of every local process."""
_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""How processes begin; never a fork of this one, which may run threads."""
_CALLS_PER_THREAD, _FEWEST_CALLS = 4, 16
"""Calls that a cluster holds, so that no thread of it waits for this process."""


class Died(Exception):  # noqa: N818 (an observation about another process)
    """A process ended before it answered."""


@dataclass(frozen=True, slots=True)
class Call:
    """One call of a function.

    Attributes
    ----------
    function : str
        ``module:function``, imported where it runs.
    arguments : tuple
        Anything that can be pickled.
    tells : bool
        Whether the function takes ``tell=``, which hands plain values to the giver of the call while it runs.
    imports : tuple of str
        Modules that local processes load once for all; those of the first call of a program count.
    """

    function: str
    arguments: tuple[Any, ...]
    tells: bool = False
    imports: tuple[str, ...] = ()

    def run(self, tell: Tell) -> Any:
        """Call the function here."""
        module, _, name = self.function.partition(":")
        function = getattr(importlib.import_module(module), name)
        return function(*self.arguments, tell=tell) if self.tells else function(*self.arguments)


class Crew:
    """Computes calls; this one does so one after the other in this process."""

    def __init__(self) -> None:
        self.under_way: dict[int, tuple[Any, Tell, Any]] = {}
        self.numbers = count()

    @property
    def size(self) -> int:
        """Calls that can be under way at once."""
        return 1

    @property
    def room(self) -> int:
        """Calls that can be given now."""
        return self.size - len(self.under_way)

    @property
    def is_idle(self) -> bool:
        """Whether no call is under way."""
        return not self.under_way

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        """Hand out a call under a key; ``hear`` is called here with its events."""
        self.under_way[next(self.numbers)] = key, hear, call

    def ended(self) -> Sequence[tuple[Any, Any]]:
        """Wait for an event or an answer; return key and answer of calls that have ended, raise the error of one."""
        _, (key, hear, call) = self.under_way.popitem()
        return [(key, call.run(hear))]


class Engine(Protocol):
    """Hires crews."""

    def crew(self) -> contextlib.AbstractContextManager[Crew]:
        """Return a crew that ends with the block."""
        ...


def choose(jobs: int, cluster: str | None = None) -> Engine:
    """Return the engine for the options of a command.

    Parameters
    ----------
    jobs : int
        Local processes; 0 computes in this process.
    cluster : str, optional
        Address of a Dask scheduler, which replaces local processes.

    Examples
    --------
    >>> choose(2), choose(0), choose(1, "tcp://head:8786")
    (Processes(workers=2), Serial(), Dask(address='tcp://head:8786'))
    """
    if cluster is not None:
        return Dask(cluster)
    return Processes(jobs) if jobs else Serial()


def processors() -> int:
    """Count the processors that this process may use, not those that the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def side_by_side(
    engine: Engine, function: str, tasks: Mapping[Key, tuple[Any, ...]], *, imports: Sequence[str] = ("numpy", "xarray")
) -> Generator[tuple[Key, Any]]:
    """Call a function with the arguments of every task, which do not wait for each other.

    Parameters
    ----------
    engine : Engine
    function : str
        See :class:`Call`.
    tasks : mapping
        Arguments by key, taken when their turn comes.
    imports : sequence of str
        See :class:`Call`.

    Yields
    ------
    tuple
        A key and its answer, in the order of the answers. A task that was under way when a process died is tried
        again alone after all others; after the third death its answer is :class:`Died`. An error of the
        function is raised.
    """

    def answers(queue: Iterator[Key]) -> Generator[tuple[Key, Any], None, list[Key]]:
        """Yield the answers to a queue; return the tasks over which a process died."""
        lost: list[Key] = []
        while True:
            for key in islice(queue, crew.room):
                crew.give(key, Call(function, tasks[key], imports=tuple(imports)), _ignore)
            if crew.is_idle:
                return lost
            for key, answer in crew.ended():
                if isinstance(answer, Died):
                    lost.append(key)
                else:
                    yield key, answer

    with engine.crew() as crew:
        suspects = yield from answers(iter(tasks))
        for key in suspects:
            for _ in range(_TRIES - 1):
                if not (yield from answers(iter([key]))):
                    break
            else:
                yield key, Died(f"{_TRIES} workers died over it")


def _ignore(_: Any) -> None:
    """Take an event that nobody asked for."""


def elsewhere(call: Call) -> Any:
    """Return the answer of a call in a local process; raise its error, or :class:`Died`."""
    with Processes(1).crew() as crew:
        crew.give(None, call, _ignore)
        while not (ended := crew.ended()):
            pass
    if isinstance(ended[0][1], Died):
        raise ended[0][1]
    return ended[0][1]


@dataclass(frozen=True, slots=True)
class Serial:
    """One call after the other in this process, for a debugger."""

    def crew(self) -> contextlib.AbstractContextManager[Crew]:
        """See :class:`Engine`."""
        return contextlib.nullcontext(Crew())


class _Queue(Protocol):
    def put(self, item: Any, /) -> None: ...
    def get(self) -> Any: ...


class _Elsewhere(Crew):
    """Hands calls to other processes; ``news`` takes (number of a call, whether it ended, event)."""

    news: _Queue

    def start(self, number: int, call: Call) -> Any:
        """Return the future of a call."""
        raise NotImplementedError

    def answer(self, future: Any) -> Any:
        """Return the answer in a future, or :class:`Died`; raise the error of the call."""
        raise NotImplementedError

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        number = next(self.numbers)
        future = self.start(number, call)
        self.under_way[number] = key, hear, future

        def note(_: Any) -> None:
            with contextlib.suppress(OSError, EOFError):  # nobody waits for it any more
                self.news.put((number, True, None))

        future.add_done_callback(note)

    def ended(self) -> Sequence[tuple[Any, Any]]:
        try:
            number, has_ended, event = self.news.get()
        except (OSError, EOFError) as error:
            raise LabpipeError("the process that passes events on was ended from outside; run again") from error
        key, hear, future = self.under_way.get(number, (None, _ignore, None))  # an answer may overtake an event
        if not has_ended:
            hear(event)
            return []
        del self.under_way[number]
        return [(key, self.answer(future))]


# --- local processes ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Processes:
    """Local processes; 0 are as many as there are processors.

    Raises
    ------
    InputError
        The number is negative.
    """

    workers: int = 0

    def __post_init__(self) -> None:
        """Refuse a negative number."""
        if self.workers < 0:
            raise InputError(f"jobs must be at least 0, found {self.workers}")

    @contextlib.contextmanager
    def crew(self) -> Iterator[Crew]:
        """See :class:`Engine`; processes begin when they are needed."""
        crew = _Pool(self.workers or processors())
        try:
            yield crew
        finally:
            crew.end()


class _Pool(_Elsewhere):
    """An executor, started again when it breaks, and the process that holds the queue of its news.

    The queue outlives a worker that is killed while it writes. Workers end with the process that holds it, and
    that one with this one.
    """

    def __init__(self, workers: int) -> None:
        super().__init__()
        self.workers = workers
        self.context: Any = multiprocessing.get_context(_METHOD)
        self.manager = SyncManager(ctx=self.context)
        self.executor: ProcessPoolExecutor | None = None

    @property
    def size(self) -> int:
        return self.workers

    def start(self, number: int, call: Call) -> Any:
        with _clean_start():
            if self.executor is None:
                if _METHOD == "forkserver":
                    self.context.set_forkserver_preload(list(call.imports))
                self.manager.start(_end_with_parent)
                self.news, self.end_of_manager = self.manager.Queue(), self.manager.Event()
                self.executor = self.new_executor()
            try:
                return self.executor.submit(_compute, call, self.news, number)
            except BrokenProcessPool:  # the calls under way find out by their futures
                self.executor.shutdown()
                self.executor = self.new_executor()
                return self.executor.submit(_compute, call, self.news, number)

    def new_executor(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self.workers, mp_context=self.context, initializer=_begin, initargs=(self.end_of_manager,)
        )

    def answer(self, future: Any) -> Any:
        try:
            return future.result()
        except BrokenProcessPool:
            return Died("its process was ended from outside, or crashed; was the memory full?")

    def end(self) -> None:
        """End all processes at once; unfinished results never come to exist."""
        if self.executor is not None:
            self.manager.shutdown()
            self.executor.shutdown(cancel_futures=True)  # waits until their locks are free and nothing is written


@contextlib.contextmanager
def _clean_start() -> Iterator[None]:
    """Start processes with one thread for each library, and without the calling script.

    A script or notebook without the ``__main__`` guard would otherwise start itself in every process.
    """
    before = {name: os.environ.get(name) for name in _ENVIRONMENT}
    main = sys.modules["__main__"]
    os.environ.update(_ENVIRONMENT)
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


def _end_with_parent() -> None:
    """Let the process of the queue end when the one that started it does, however that ends."""
    parent = multiprocessing.parent_process()
    threading.Thread(target=_exit_after, args=(parent.join if parent else _ignore,), daemon=True).start()


def _begin(end_of_manager: Any) -> None:
    """Prepare a worker: quiet, on one thread, and ending with the process of the queue."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    os.environ.update(_ENVIRONMENT)
    # Standard output belongs to the command; what a call or a library prints goes to the errors.
    os.dup2(sys.__stderr__.fileno() if sys.__stderr__ else 2, 1)
    threading.Thread(target=_exit_after, args=(end_of_manager.wait,), daemon=True).start()


def _exit_after(wait: Callable[[], Any]) -> None:
    with contextlib.suppress(EOFError, OSError):
        wait()
    os._exit(1)


def _compute(call: Call, news: _Queue, number: int) -> Any:
    return call.run(lambda event: news.put((number, False, event)))


# --- a cluster ---------------------------------------------------------------------------------

_ONE_AT_A_TIME = threading.Lock()
"""Of a worker, whose threads would share what is not made for it: HDF5, and caught warnings."""


@dataclass(frozen=True, slots=True)
class Dask:
    """Workers of a Dask scheduler, ``tcp://host:port``, with the same installation of labpipe.

    The scheduler tries a call again on another worker when one dies, three times; then it is answered by
    :class:`Died`.
    """

    address: str

    @contextlib.contextmanager
    def crew(self) -> Iterator[Crew]:
        """See :class:`Engine`.

        Raises
        ------
        UsageError
            The extra ``cluster`` is not installed, or nobody answers at the address.
        """
        try:
            distributed: Any = importlib.import_module("distributed")
        except ImportError as error:
            raise UsageError("--cluster needs Dask: pip install 'labpipe[cluster]'") from error
        try:
            client = distributed.Client(self.address, timeout="10s", set_as_default=False)
        except (OSError, ValueError) as error:
            raise UsageError(f"no Dask scheduler answers at {self.address} ({error})") from error
        with client:
            yield _Cluster(client)


class _Cluster(_Elsewhere):
    """Calls on the workers of a Dask client, and their events by a topic of the scheduler."""

    def __init__(self, client: Any) -> None:
        from labpipe.workflow.provenance import program

        super().__init__()
        self.client = client
        self.program = program()
        self.wanted = 0
        self.topic = f"labpipe-{uuid4().hex}"
        self.news = SimpleQueue()
        client.subscribe_topic(self.topic, lambda event: self.news.put((event[1][0], False, event[1][1])))

    @property
    def size(self) -> int:
        if 2 * len(self.under_way) >= self.wanted:
            self.wanted = max(_FEWEST_CALLS, _CALLS_PER_THREAD * sum(self.client.nthreads().values()))
        return self.wanted

    def start(self, number: int, call: Call) -> Any:
        arguments = (call, self.program, self.topic, number)
        return self.client.submit(_compute_there, *arguments, key=f"{self.topic}-{number}")

    def answer(self, future: Any) -> Any:
        from distributed.scheduler import KilledWorker

        if future.status not in ("finished", "error"):
            raise LabpipeError("the Dask scheduler no longer answers; run again to go on")
        try:
            return future.result()
        except KilledWorker:
            return Died("its workers died one after the other; was the memory full?")
        finally:
            future.release()


def _compute_there(call: Call, program: Mapping[str, Any], topic: str, number: int) -> Any:
    """Compute on a worker of the cluster; UsageError where its installation is another."""
    from distributed import get_worker

    from labpipe.workflow import provenance

    worker = get_worker()
    if (own := provenance.program()) != program:
        there, here = ({**about, **about["libraries"]} for about in (own, program))
        differing = [n for n in here if n != "libraries" and there.get(n) != here[n]]
        listed = ", ".join(f"{n} {there.get(n)} there, {here[n]} here" for n in differing)
        raise UsageError(
            f"the worker {worker.address} has another installation ({listed}); install the same versions everywhere"
        )
    with _ONE_AT_A_TIME:
        return call.run(lambda event: worker.log_event(topic, [number, event]))

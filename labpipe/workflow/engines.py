"""Calls side by side: in this process, in a pool of local processes, or on a Dask cluster.

An :class:`Engine` hires a :class:`Crew`, which is given one :class:`Call` after the other and answers each.
Local processes are a :class:`concurrent.futures.ProcessPoolExecutor`. They compute on one thread each, so that an
answer does not depend on their number; they end with the crew, and with the process that started them. A process
that dies breaks the pool: a new one is started, and the calls that were under way are answered by :class:`Died`.
"""

import contextlib
import importlib
import multiprocessing
import multiprocessing.process
import os
import signal
import sys
import threading
import types
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from itertools import count, islice
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
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
_PATIENCE = 10.0
"""Seconds that local processes get to end."""
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


class Crew(Protocol):
    """Computes calls."""

    @property
    def room(self) -> int:
        """Calls that can be given now."""
        ...

    @property
    def is_idle(self) -> bool:
        """Whether no call is under way."""
        ...

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        """Hand out a call under a key; ``hear`` is called here with its events."""
        ...

    def ended(self) -> Sequence[tuple[Any, Any]]:
        """Wait for an event or an answer; return key and answer of calls that have ended, raise what one raised."""
        ...


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
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


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
        again alone after all others; after the third death its answer is :class:`Died`. What the function raises
        is raised.
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


# --- in this process ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Serial:
    """One call after the other in this process, for a debugger."""

    def crew(self) -> contextlib.AbstractContextManager[Crew]:
        """See :class:`Engine`."""
        return contextlib.nullcontext(_Alone())


@dataclass(slots=True)
class _Alone:
    given: list[tuple[Any, Call, Tell]] = field(default_factory=list)

    @property
    def room(self) -> int:
        return 1 - len(self.given)

    @property
    def is_idle(self) -> bool:
        return not self.given

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        self.given.append((key, call, hear))

    def ended(self) -> Sequence[tuple[Any, Any]]:
        key, call, hear = self.given.pop()
        return [(key, call.run(hear))]


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
        crew = _PoolCrew(self.workers or processors())
        try:
            yield crew
        finally:
            crew.end()


def elsewhere(call: Call) -> Any:
    """Return the answer of a call in a local process; raise what it raises, or :class:`Died`."""
    with Processes(1).crew() as crew:
        crew.give(None, call, _ignore)
        while not crew.is_idle:
            for _, answer in crew.ended():
                if isinstance(answer, Died):
                    raise answer
    return answer


class _PoolCrew:
    """A pool, what is under way in it, and one queue of its events and answers."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.pool: _Pool | None = None
        self.news: SimpleQueue[tuple[int, bool, Any]] = SimpleQueue()
        self.numbers = count()
        self.under_way: dict[int, tuple[Any, Tell]] = {}
        self.heard_out: set[int] = set()
        self.answers: dict[int, Future[Any]] = {}

    @property
    def room(self) -> int:
        return self.size - len(self.under_way)

    @property
    def is_idle(self) -> bool:
        return not self.under_way

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        number = next(self.numbers)
        future: Future[Any]
        try:
            future = self._started(call).submit(call, number)
        except BrokenProcessPool as death:
            if self.under_way:  # this call ends with those that were under way
                future = Future()
                future.set_exception(death)
            else:  # a process without a call died
                self.end()
                future = self._started(call).submit(call, number)
        self.under_way[number] = key, hear
        future.add_done_callback(lambda done: self.news.put((number, False, done)))

    def ended(self) -> Sequence[tuple[Any, Any]]:
        number, is_event, value = self.news.get()
        if number not in self.under_way:  # an event that its answer has overtaken
            return []
        key, hear = self.under_way[number]
        if is_event and not isinstance(value, _LastWord):
            hear(value)
            return []
        if is_event:
            self.heard_out.add(number)
        elif isinstance(value.exception(), BrokenProcessPool):
            return self._after_a_death()
        else:
            self.answers[number] = value
        answer = self.answers.get(number)
        if answer is None or not (number in self.heard_out or answer.exception() is not None):
            return []  # events and answers come by two ways: all events are heard before the answer counts
        del self.under_way[number], self.answers[number]
        self.heard_out.discard(number)
        return [(key, answer.result())]

    def _after_a_death(self) -> list[tuple[Any, Any]]:
        """Hear what was still told, end the pool, and answer all calls."""
        self.end()
        ended = [(self.under_way.pop(number)[0], answer.result()) for number, answer in self.answers.items()]
        self.answers.clear()
        self.heard_out.clear()
        with contextlib.suppress(Empty):
            while True:
                number, is_event, value = self.news.get_nowait()
                key, hear = self.under_way.get(number, (None, _ignore))
                if is_event:
                    if not isinstance(value, _LastWord):
                        hear(value)
                elif number in self.under_way and value.exception() is None:
                    del self.under_way[number]
                    ended.append((key, value.result()))
        death = Died("its process was ended from outside, or crashed; was the memory full?")
        ended += [(key, death) for key, _ in self.under_way.values()]
        self.under_way.clear()
        return ended

    def _started(self, call: Call) -> "_Pool":
        self.pool = self.pool or _Pool(self.size, call.imports, self.news)
        return self.pool

    def end(self) -> None:
        """End all processes at once; what they were computing never comes to exist."""
        if self.pool is not None:
            self.pool.end()
            self.pool = None


class _LastWord:
    """Event after which a call tells no more."""


class _Pool:
    """An executor, with a pipe by which its processes tell, and one whose end makes them end.

    ``news`` receives the events with the numbers of their calls.
    """

    def __init__(self, size: int, imports: Sequence[str], news: "SimpleQueue[tuple[int, bool, Any]]") -> None:
        context: Any = multiprocessing.get_context(_METHOD)
        if _METHOD == "forkserver":
            context.set_forkserver_preload(list(imports))
        self.ear, self.mouth = context.Pipe(duplex=False)
        self.held, self.life = context.Pipe(duplex=False)
        given = (self.mouth, context.Lock(), self.held)
        self.processes: set[multiprocessing.process.BaseProcess] = set()
        self.executor = ProcessPoolExecutor(size, mp_context=context, initializer=_begin, initargs=given)
        self.listener = threading.Thread(target=self._listen, args=(news,), daemon=True)
        self.listener.start()

    def submit(self, call: Call, number: int) -> "Future[Any]":
        others = set(multiprocessing.active_children())
        with _clean_start():
            future = self.executor.submit(_compute, call, number)
        self.processes |= set(multiprocessing.active_children()) - others
        return future

    def _listen(self, news: "SimpleQueue[tuple[int, bool, Any]]") -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                number, value = self.ear.recv()
                news.put((number, True, value))

    def end(self) -> None:
        self.life.close()
        self.executor.shutdown(wait=False, cancel_futures=True)
        self.mouth.close()
        self.listener.join(_PATIENCE)  # its pipe ends with the last process
        for process in self.processes:  # whose locks are free, and whose parts nobody writes any more
            process.join(_PATIENCE)
        self.ear.close()
        self.held.close()


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


_mouths: list[Callable[[int, Any], None]] = []
"""Of a local process: its way to send an event of a call."""


def _begin(mouth: Connection, lock: Any, held: Connection) -> None:
    """Prepare a local process: quiet, on one thread, and ending with the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    os.environ.update(_ENVIRONMENT)
    # Standard output belongs to the command; what a call or a library prints goes to the errors.
    os.dup2(sys.__stderr__.fileno() if sys.__stderr__ else 2, 1)

    def end_with_parent() -> None:
        with contextlib.suppress(EOFError, OSError):
            held.recv()
        os._exit(1)

    def tell(number: int, value: Any) -> None:
        with lock:
            mouth.send((number, value))

    threading.Thread(target=end_with_parent, daemon=True).start()
    _mouths.append(tell)


def _compute(call: Call, number: int) -> Any:
    try:
        return call.run(partial(_mouths[0], number))
    finally:
        _mouths[0](number, _LastWord())


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
            yield _ClusterCrew(client)


class _ClusterCrew:
    """What is under way on a cluster, and one queue of events and answers, which other threads fill."""

    def __init__(self, client: Any) -> None:
        from labpipe.workflow.provenance import program

        self.client = client
        self.program = program()
        self.wanted = 0
        self.numbers = count()
        self.topic = f"labpipe-{uuid4().hex}"
        self.news: SimpleQueue[tuple[str, bool, Any]] = SimpleQueue()
        self.under_way: dict[str, tuple[Any, Any, Tell]] = {}
        client.subscribe_topic(self.topic, lambda event: self.news.put((event[1][0], True, event[1][1])))

    @property
    def room(self) -> int:
        if 2 * len(self.under_way) >= self.wanted:
            threads = sum(self.client.nthreads().values())
            self.wanted = max(_FEWEST_CALLS, _CALLS_PER_THREAD * threads)
        return self.wanted - len(self.under_way)

    @property
    def is_idle(self) -> bool:
        return not self.under_way

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        name = f"{self.topic}-{next(self.numbers)}"
        future = self.client.submit(_compute_there, call, self.program, self.topic, name, key=name)
        self.under_way[name] = future, key, hear
        future.add_done_callback(lambda _: self.news.put((name, False, None)))

    def ended(self) -> Sequence[tuple[Any, Any]]:
        from distributed.scheduler import KilledWorker

        name, is_event, value = self.news.get()
        if name not in self.under_way:  # an event that its answer has overtaken
            return []
        future, key, hear = self.under_way[name]
        if is_event:
            hear(value)
            return []
        del self.under_way[name]
        if future.status not in ("finished", "error"):
            raise LabpipeError("the Dask scheduler no longer answers; run again to go on")
        error = future.exception()
        if isinstance(error, KilledWorker):
            return [(key, Died("its workers died one after the other; was the memory full?"))]
        if error is not None:
            raise error
        answer = future.result()
        future.release()
        return [(key, answer)]


def _compute_there(call: Call, program: Mapping[str, Any], topic: str, name: str) -> Any:
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
        return call.run(lambda value: worker.log_event(topic, [name, value]))

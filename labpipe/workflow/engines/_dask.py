"""Workers of a Dask scheduler, on as many machines as there are."""

import importlib
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from queue import SimpleQueue
from typing import Any
from uuid import uuid4

from labpipe.errors import LabpipeError, UsageError
from labpipe.workflow.engines._calls import Call, Crew, Died, Tell

# Calls that a cluster holds: enough that no thread waits for us.
_PER_THREAD, _LEAST_IN_FLIGHT = 4, 16

_ONE_AT_A_TIME = threading.Lock()
"""Of a worker, whose threads would share what is not made for it: HDF5, and caught warnings."""


@dataclass(frozen=True, slots=True)
class Dask:
    """Workers of a Dask scheduler, ``tcp://host:port``; the same labpipe must be installed there.

    A call on a worker that dies is tried again by the scheduler on another one, four in all; then
    it is answered by :class:`Died`.
    """

    address: str

    @contextmanager
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
            yield _Crew(client)


class _Crew:
    """See :class:`Crew`; what the threads of the client learn waits in one queue."""

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

    def _hear(self, event: tuple[float, tuple[str, Any]]) -> None:
        _, (name, value) = event
        self.news.put((name, True, value))

    @property
    def room(self) -> int:
        if 2 * len(self.under_way) >= self.wanted:
            threads = sum(self.client.nthreads().values())
            self.wanted = max(_LEAST_IN_FLIGHT, _PER_THREAD * threads)
        return self.wanted - len(self.under_way)

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        name = f"{self.topic}-{next(self.numbers)}"
        future = self.client.submit(_compute, call, self.program, self.topic, name, key=name)
        self.under_way[name] = future, key, hear
        future.add_done_callback(lambda _: self.news.put((name, False, None)))

    def ended(self) -> Sequence[tuple[Any, Any]]:
        name, is_told, value = self.news.get()
        if name not in self.under_way:  # told on the way, and overtaken by the answer
            return []
        future, key, hear = self.under_way[name]
        if is_told:
            hear(value)
            return []
        del self.under_way[name]
        answer = _answer(future)
        future.release()
        return [(key, answer)]


def _answer(future: Any) -> Any:
    """Return what a call gave, or how its workers died; raise what it raised."""
    from distributed.scheduler import KilledWorker

    if future.status not in ("finished", "error"):
        raise LabpipeError("the Dask scheduler no longer answers; run again to go on")
    error = future.exception()
    if isinstance(error, KilledWorker):
        return Died("its workers died one after the other; was the memory full?")
    if error is not None:
        raise error
    return future.result()


def _compute(call: Call, program: Mapping[str, Any], topic: str, name: str) -> Any:
    """Body of a task on a worker.

    Raises
    ------
    UsageError
        The worker runs other versions than the one that asks: its answer could be another.
    """
    from distributed import get_worker

    from labpipe.workflow import provenance

    worker = get_worker()
    if (own := provenance.program()) != program:
        raise UsageError(
            f"the worker {worker.address} has another installation ({_differences(own, program)}); "
            "install the same versions everywhere"
        )
    with _ONE_AT_A_TIME:
        return call.run(lambda value: worker.log_event(topic, [name, value]))


def _differences(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Name what differs, as it is there and here."""
    flat = [{**about, **about["libraries"]} for about in (there, here)]
    names = [n for n in flat[1] if n != "libraries" and flat[0].get(n) != flat[1][n]]
    return ", ".join(f"{n} {flat[0].get(n)} there, {flat[1][n]} here" for n in names)

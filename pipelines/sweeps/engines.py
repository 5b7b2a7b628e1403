"""Who computes the points of a sweep: this process, local processes, or a Dask cluster.

All hand out the same blocks of points to the same function, so that the answer does not depend on
who computed it. A worker that dies costs its block another try; one that keeps dying with the same
block leaves a reason in place of its results.
"""

import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol

from labpipe.errors import UsageError
from pipelines.sweeps.simulators import SIMULATORS, Outputs, Value

Point = Mapping[str, Value]
Outcome = Outputs | str
"""Numbers, or the reason why there are none."""
Block = Sequence[Point]

_TRIES = 3


def compute(simulator: str, block: Block) -> list[Outcome]:
    """Simulate the points of a block; a point that fails is its message."""
    run = SIMULATORS[simulator].run
    found: list[Outcome] = []
    for point in block:
        try:
            found.append(run(point))
        # A point of a map may lie where there is no answer: that is told and the others go on.
        except Exception as error:
            found.append(f"{type(error).__name__}: {error}")
    return found


class Engine(Protocol):
    """Computes blocks in any order."""

    def run(
        self, simulator: str, blocks: Mapping[str, Block]
    ) -> Iterator[tuple[str, list[Outcome]]]:
        """Yield the key and the outcomes of every block as soon as it is done."""
        ...


@dataclass(frozen=True, slots=True)
class Serial:
    """One block after the other in this process."""

    def run(
        self, simulator: str, blocks: Mapping[str, Block]
    ) -> Iterator[tuple[str, list[Outcome]]]:
        """See :class:`Engine`."""
        for key, block in blocks.items():
            yield key, compute(simulator, block)


@dataclass(frozen=True, slots=True)
class Processes:
    """Local processes; ``jobs`` 0 takes as many as there are processors."""

    jobs: int = 0

    def run(
        self, simulator: str, blocks: Mapping[str, Block]
    ) -> Iterator[tuple[str, list[Outcome]]]:
        """See :class:`Engine`."""
        tries = dict.fromkeys(blocks, 0)
        waiting = dict(blocks)
        all_workers = self.jobs or os.cpu_count() or 1
        while waiting:
            # After a death nobody knows whose block it was: each suspect is tried alone.
            suspects = {key: block for key, block in waiting.items() if tries[key]}
            workers, batch = (1, suspects) if suspects else (all_workers, dict(waiting))
            in_flight = 1 if suspects else workers + 1  # one in reserve keeps the workers busy
            context = multiprocessing.get_context("forkserver")
            with ProcessPoolExecutor(workers, mp_context=context, initializer=_one_thread) as pool:
                for key, outcome in _until_one_dies(pool, simulator, batch, in_flight, tries):
                    del waiting[key]
                    yield key, outcome
            for key in [k for k in waiting if tries[k] >= _TRIES]:
                yield key, ["the worker died"] * len(waiting.pop(key))


def _until_one_dies(
    pool: ProcessPoolExecutor,
    simulator: str,
    blocks: Mapping[str, Block],
    in_flight: int,
    tries: dict[str, int],
) -> Iterator[tuple[str, list[Outcome]]]:
    running: dict[Future[list[Outcome]], str] = {}
    queue = iter(list(blocks))
    while True:
        try:
            while len(running) < in_flight and (key := next(queue, None)) is not None:
                running[pool.submit(compute, simulator, blocks[key])] = key
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                outcome = future.result()
                yield running.pop(future), outcome
        except BrokenProcessPool:
            for key in running.values():
                tries[key] += 1
            return


def _one_thread() -> None:
    """Keep the libraries' own threads from fighting over the processors."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"


@dataclass(frozen=True, slots=True)
class Dask:
    """Workers of a Dask scheduler, ``tcp://host:port``; labpipe must be installed there."""

    address: str

    def run(
        self, simulator: str, blocks: Mapping[str, Block]
    ) -> Iterator[tuple[str, list[Outcome]]]:
        """See :class:`Engine`.

        Raises
        ------
        UsageError
            The extra ``cluster`` is not installed, or nobody answers at the address.
        """
        try:
            from distributed import Client, as_completed
        except ImportError as error:
            message = "--cluster needs Dask: pip install 'labpipe[cluster]'"
            raise UsageError(message) from error
        try:
            client = Client(self.address, timeout="10s", set_as_default=False)
        except (OSError, ValueError) as error:
            message = f"no Dask scheduler answers at {self.address} ({error})"
            raise UsageError(message) from error
        with client:
            futures: dict[Any, str] = {
                client.submit(compute, simulator, list(block), key=f"labpipe-{key}",
                              retries=_TRIES - 1): key
                for key, block in blocks.items()
            }  # fmt: skip
            for future in as_completed(futures, loop=client.loop):
                key = futures[future]
                problem = future.exception()
                if problem is None:
                    yield key, future.result()
                else:
                    yield key, [f"the worker died ({problem})"] * len(blocks[key])
                future.release()

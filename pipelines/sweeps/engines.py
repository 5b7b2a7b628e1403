"""Who computes the points of a sweep: this process, local processes, or a Dask cluster.

All hand out the same blocks of points to the same function, so that the answer does not depend on
who computed it. A worker that dies costs its block another try; one that keeps dying with the same
block leaves a reason in place of its results.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, Protocol

from labpipe.errors import UsageError
from labpipe.workflow.processes import Died, processors, side_by_side
from pipelines.sweeps.parameters import Outputs, Value
from pipelines.sweeps.simulators import SIMULATORS

Point = Mapping[str, Value]
Outcome = Outputs | str
"""Numbers, or the reason why there are none."""
Block = Sequence[Point]

_TRIES = 3
_PRELOADED = ("numpy", "xarray", "labpipe.contact", "pipelines.sweeps.simulators")
# Blocks that a cluster holds: enough that no thread waits for us.
_PER_THREAD, _LEAST_IN_FLIGHT = 4, 16


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
        workers = self.jobs or processors()
        run = partial(compute, simulator)
        for key, found in side_by_side(run, blocks, workers, preload=_PRELOADED):
            if isinstance(found, Died):
                yield key, [str(found)] * len(blocks[key])
            else:
                yield key, found


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
            yield from _as_they_come(client, as_completed, simulator, blocks)


def _as_they_come(
    client: Any, as_completed: Any, simulator: str, blocks: Mapping[str, Block]
) -> Iterator[tuple[str, list[Outcome]]]:
    """Hand out a few blocks per thread of the cluster; the scheduler never holds a whole sweep."""
    queue = iter(blocks)
    keys: dict[Any, str] = {}
    finished = as_completed(loop=client.loop)

    def fill() -> int:
        wanted = max(_LEAST_IN_FLIGHT, _PER_THREAD * sum(client.nthreads().values()))
        for key in islice(queue, wanted - len(keys)):
            future = client.submit(
                compute, simulator, list(blocks[key]), key=f"labpipe-{key}", retries=_TRIES - 1
            )
            keys[future] = key
            finished.add(future)
        return wanted

    wanted = fill()
    for future in finished:
        key = keys.pop(future)
        problem = future.exception()
        if problem is None:
            yield key, future.result()
        else:
            yield key, [f"the worker died ({problem})"] * len(blocks[key])
        future.release()
        if 2 * len(keys) < wanted:
            wanted = fill()

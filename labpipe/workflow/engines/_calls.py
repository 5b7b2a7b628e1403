"""What every engine has in common: calls, crews, and calls that do not wait for each other."""

import importlib
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Protocol, TypeVar

Key = TypeVar("Key")
Tell = Callable[[Any], None]
"""Takes what a call says on the way."""

_TRIES = 3


class Died(Exception):  # noqa: N818 (an observation about another process)
    """A worker ended without saying so; the text says how."""


@dataclass(frozen=True, slots=True)
class Call:
    """All that a worker is sent.

    Attributes
    ----------
    function : str
        ``module:function``; imported by the worker.
    arguments : tuple
        Handed to it; what the standard library and Dask can send.
    tells : bool
        Whether it is also given ``tell=``, which takes plain values (numbers, texts, lists,
        dicts) and hands them to whoever gave the call.
    imports : tuple of str
        Modules that local processes load once for all and not each for itself; those of the
        first call of a program count.
    """

    function: str
    arguments: tuple[Any, ...]
    tells: bool = False
    imports: tuple[str, ...] = ()

    def run(self, tell: Tell) -> Any:
        """Call the function here."""
        module, _, name = self.function.partition(":")
        function = getattr(importlib.import_module(module), name)
        if self.tells:
            return function(*self.arguments, tell=tell)
        return function(*self.arguments)


class Crew(Protocol):
    """Workers that compute calls."""

    @property
    def room(self) -> int:
        """How many more calls to give so that nobody waits for us."""
        ...

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        """Hand out a call under a key; ``hear`` is called here with what it tells."""
        ...

    def ended(self) -> Sequence[tuple[Any, Any]]:
        """Wait until a call tells something or ends.

        Returns
        -------
        sequence of tuple
            Key and answer of every call that has ended; a :class:`Died` where its worker died.
            What a function raises is raised.
        """
        ...


class Engine(Protocol):
    """Hires crews."""

    def crew(self) -> AbstractContextManager[Crew]:
        """Return workers that end with the block."""
        ...


@dataclass(frozen=True, slots=True)
class Serial:
    """One call after the other in this process, where a debugger sees them.

    Equal bytes are promised by the other engines: only a process of its own can hold the libraries
    to one thread.
    """

    def crew(self) -> AbstractContextManager[Crew]:
        """See :class:`Engine`."""
        return nullcontext(_Alone())


@dataclass(slots=True)
class _Alone:
    """See :class:`Crew`."""

    given: list[tuple[Any, Call, Tell]] = field(default_factory=list)

    @property
    def room(self) -> int:
        return 1 - len(self.given)

    def give(self, key: Any, call: Call, hear: Tell) -> None:
        self.given.append((key, call, hear))

    def ended(self) -> Sequence[tuple[Any, Any]]:
        key, call, hear = self.given.pop()
        return [(key, call.run(hear))]


def side_by_side(
    engine: Engine, function: str, tasks: Mapping[Key, tuple[Any, ...]], *, imports: Sequence[str] = ("numpy", "xarray")
) -> Generator[tuple[Key, Any]]:
    """Call a function with the arguments of every task.

    A worker that dies takes nothing with it: what it was computing is tried again alone once all
    others have their answers, and what died three times is answered by :class:`Died`. Every task
    has one answer.

    Parameters
    ----------
    engine : Engine
        Who computes.
    function : str
        See :class:`Call`.
    tasks : mapping
        Arguments by key; they are asked for when their turn comes, in the mapping's order.
    imports : sequence of str
        See :class:`Call`.

    Yields
    ------
    tuple
        A key, and the answer or a :class:`Died`, as soon as it is there. What the function raises
        is raised.
    """

    def answers(queue: Iterator[Key]) -> Generator[tuple[Key, Any], None, list[Key]]:
        """Yield what a queue gives; return the tasks over which a worker died."""
        lost: list[Key] = []
        under_way = 0
        while True:
            for key in islice(queue, crew.room):
                crew.give(key, Call(function, tasks[key], imports=tuple(imports)), _nobody)
                under_way += 1
            if not under_way:
                return lost
            for key, answer in crew.ended():
                under_way -= 1
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


def _nobody(_: Any) -> None:
    """Take what nobody asked for."""

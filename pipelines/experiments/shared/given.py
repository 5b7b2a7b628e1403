"""Results of the steps of an experiment, handed by name to the functions that ask for them.

Rows of a comparison, budgets, checks and sections of a page name the results that they need as their
parameters. A parameter with a default helps and may lack; without one of the others there is
nothing to say, and the function is not called.
"""

import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any


class Given:
    """Results of an experiment by the names of its steps; ``given`` is itself the name of all of them.

    A step gave a Dataset, a list of the results of its recordings, or None where it gave nothing.
    """

    def __init__(self, **known: Any) -> None:
        self._known = {"given": self}
        for name, found in known.items():  # a step may give nothing in any of its recordings
            if found is not None and not (isinstance(found, Sequence) and all(one is None for one in found)):
                self._known[name] = found

    def get(self, name: str) -> Any:
        """Return one result; None where there is none."""
        return self._known.get(name)

    def ask(self, function: Callable[..., Any]) -> Any:
        """Call a function with the results that its parameters name; None where one lacks that it needs."""
        parameters = inspect.signature(function).parameters.values()
        if any(p.default is p.empty and p.name not in self._known for p in parameters):
            return None
        return function(**{p.name: self._known[p.name] for p in parameters if p.name in self._known})

    def each(self, functions: Iterable[Callable[..., Any]]) -> list[Any]:
        """Ask several functions, and return all that they give in one list; None is nothing."""
        found: list[Any] = []
        for answer in map(self.ask, functions):
            if isinstance(answer, Iterable):
                found += answer
            elif answer is not None:
                found.append(answer)
        return found

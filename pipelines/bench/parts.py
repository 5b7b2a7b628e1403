"""The parts of the benchmark by name; a part is imported only when it is run."""

import importlib
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from labpipe.errors import UsageError
from labpipe.workflow.fields import suggest
from pipelines.bench.measure import Suite

#: Name on the command line: module of ``pipelines.bench``, and the measured quantity.
PARTS: Mapping[str, tuple[str, str]] = {
    "velocity": ("velocity", "Velocity from displacement."),
    "dic": ("dic", "Displacement of subsets of a film."),
    "contact-radius": ("contact_radius", "Radius of the contact from interference fringes."),
    "master-curve": ("master_curve", "Time–temperature superposition."),
    "drop": ("drop", "Simulated fall and rebound of a ball."),
    "line": ("line", "Simulated indentation by a periodic punch."),
}


@dataclass(frozen=True, slots=True)
class PartResult:
    """The suites of one part, how long they took together, and on all cores (s)."""

    name: str
    suites: tuple[Suite, ...]
    seconds: float
    processor_seconds: float


@dataclass(frozen=True, slots=True)
class PartFailure:
    """A part without a result, and why."""

    name: str
    message: str


def chosen(names: Sequence[str]) -> tuple[str, ...]:
    """Return the parts asked for, in the order of the table; all without names. An underscore is a hyphen.

    Raises
    ------
    UsageError
        A name is not that of a part; the nearest one is suggested.
    """
    names = [name.replace("_", "-") for name in names]
    for name in names:
        if name not in PARTS:
            raise UsageError(f'there is no benchmark "{name}"{suggest(name, PARTS)}')
    return tuple(name for name in PARTS if not names or name in names)


def load(name: str) -> Callable[[bool], Sequence[Suite]]:
    """Import a part and return its ``run``."""
    run: Callable[[bool], Sequence[Suite]] = importlib.import_module(f"pipelines.bench.{PARTS[name][0]}").run
    return run


def measure_all(
    names: Sequence[str], quick: bool, progress: Callable[[str], None]
) -> tuple[list[PartResult], list[PartFailure]]:
    """Run parts one after the other, reported by name before each; one that fails does not lose the others."""
    results, failures = [], []
    for name in names:
        progress(name)
        start, used = time.perf_counter(), sum(os.times()[:4])
        try:
            suites = tuple(load(name)(quick))
        # Parts call peers of all kinds; whatever breaks is stated in the page and the exit code.
        except Exception as error:
            failures.append(PartFailure(name, f"{type(error).__name__}: {error}"))
        else:
            results.append(PartResult(name, suites, time.perf_counter() - start, sum(os.times()[:4]) - used))
    return results, failures

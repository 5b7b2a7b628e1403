"""The parts of the benchmark by name; a part is imported only when it is run."""

import importlib
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from labpipe.errors import UsageError
from pipelines.bench.measure import Suite

#: Name on the command line: module of ``pipelines.bench`` and what it measures.
PARTS: Mapping[str, tuple[str, str]] = {
    "velocity": ("velocity", "Velocity from displacement."),
    "dic": ("dic", "Displacement of subsets of a film."),
    "contact-radius": ("contact_radius", "Radius of the contact from interference fringes."),
    "master-curve": ("master_curve", "Time–temperature superposition."),
    "drop": ("drop", "Simulated fall and rebound of a ball."),
    "indentation": ("indentation", "Simulated indentation by a periodic punch."),
}

Run = Callable[[bool], Suite | Sequence[Suite]]


@dataclass(frozen=True, slots=True)
class PartResult:
    """The suites of one part, how long they took together, and on all cores (s)."""

    name: str
    suites: tuple[Suite, ...]
    seconds: float
    processor_seconds: float = math.nan


@dataclass(frozen=True, slots=True)
class PartFailure:
    """A part that gave no suite, and why."""

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
            import difflib

            near = difflib.get_close_matches(name, PARTS, n=1, cutoff=0.5)
            hint = f'did you mean "{near[0]}"?' if near else f"there are {', '.join(PARTS)}"
            raise UsageError(f'there is no benchmark "{name}"; {hint}')
    return tuple(name for name in PARTS if not names or name in names)


def load(name: str) -> Run:
    """Import a part and return its ``run``."""
    return importlib.import_module(f"pipelines.bench.{PARTS[name][0]}").run


def measure(name: str, quick: bool) -> PartResult:
    """Run one part, a key of :data:`PARTS`; a quick run has fewer settings and repeats."""
    start, used = time.perf_counter(), sum(os.times()[:4])
    found = load(name)(quick)
    suites = (found,) if isinstance(found, Suite) else tuple(found)
    seconds, processor = time.perf_counter() - start, sum(os.times()[:4]) - used
    return PartResult(name, suites, seconds, processor)


def measure_all(
    names: Sequence[str], quick: bool, progress: Callable[[str], None] | None = None
) -> tuple[list[PartResult], list[PartFailure]]:
    """Run parts one after the other, told by name before each; one that fails does not lose the others."""
    results, failures = [], []
    for name in names:
        if progress is not None:
            progress(name)
        try:
            results.append(measure(name, quick))
        # Parts call peers of all kinds; whatever breaks is stated in the page and the exit code.
        except Exception as error:
            failures.append(PartFailure(name, f"{type(error).__name__}: {error}"))
    return results, failures

"""One shortcut: the two answers, with and without it, and the work that each took."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import xarray as xr

from pipelines.bench.measure import CLOCK


@dataclass(frozen=True, slots=True)
class Shortcut:
    """One shortcut, and the answers that it must not change.

    ``difference`` of the two answers is in units of the stated tolerance; ``work`` counts what
    was done for an answer, in the unit ``counted``. Times are processor times of this process,
    in which a busy machine shows less, unless ``clock`` says otherwise.
    """

    name: str
    short: Callable[[], Any]
    whole: Callable[[], Any]
    difference: Callable[[Any, Any], float]
    tolerance: str
    work: Callable[[Any], float]
    counted: str
    clock: Callable[[], float] = CLOCK


def counted(name: str) -> Callable[[xr.Dataset], float]:
    """Return the function that reads one count from a result's ledger."""
    return lambda found: float(json.loads(found.attrs["work"])[name])


def work_of(found: xr.Dataset, *names: str) -> Iterator[float]:
    """Yield some counts of a result's ledger, 0 where it has none."""
    counts: Mapping[str, float] = json.loads(found.attrs["work"])
    return (float(counts.get(name, 0)) for name in names)

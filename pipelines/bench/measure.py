"""Results of a benchmark, and the measurement of time.

A *part* is a module of ``pipelines.bench`` with ``run(quick)``, which returns suites. A suite is one work–precision
diagram: settings of ours, of the thesis's method and of peers as points of error against run time, with physical
limits as bounds.

Machines are shared and their clocks wander, so contenders run in turn (A, B, C, A, B, C, …) and are compared run by
run: a slow spell hits all of them, and the median of the ratios is steadier than the ratio of two medians.
"""

import math
import os
import platform
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from labpipe.errors import InputError
from labpipe.workflow.engines import processors
from labpipe.workflow.provenance import program

Extra = Mapping[str, float | int | str | bool | None]
Calls = Mapping[str, tuple[str, Callable[[], object]]]
"""Contenders by their setting: the group of each, and what to call."""

#: Groups of points: ours have no name, the thesis's own method has this one, all others are peers.
OURS, THESIS = "", "thesis"

CLOCK = time.process_time if time.get_clock_info("process_time").resolution < 1e-4 else time.perf_counter
"""Processor time of all threads, where the system resolves it (Windows does not)."""


@dataclass(frozen=True, slots=True)
class Point:
    """One setting: its error and its run time.

    ``setting``: in words ("quintic, 31 px"). ``error``: against known truth, in the unit of the suite's
    ``error_label``; NaN: not defined. ``seconds``: median of the warm runs (s); NaN: not timed. ``group``: ``""`` for
    ours, ``"thesis"`` (or a name that starts so) for the thesis's own method, the name of a peer otherwise.
    ``is_default``: the setting that a user gets without asking. ``cold_seconds``: the first run of the process,
    compilation or cache loading included (s). ``samples``: the warm runs in order (s), for ratios run by run.
    ``extra``: further columns of the table, unit in the name
    ("bias (px)").
    """

    setting: str
    error: float
    seconds: float
    group: str = OURS
    is_default: bool = False
    cold_seconds: float | None = None
    extra: Extra = field(default_factory=dict)
    samples: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Bound:
    """A limit ("Cramér–Rao, 31 px") of the error that no setting can pass, in the unit of the suite."""

    label: str
    error: float


@dataclass(frozen=True, slots=True)
class Suite:
    """One work–precision diagram and its table.

    ``name``: short, unique within a run ("dic"); ``title``: the measured quantity and its truth; ``error_label``:
    axis label of the error, with its unit: "RMS error (px)"; ``notes``: data, truth, peers that are not installed;
    ``time_label``: axis label of the time, if it is not that of one whole call.
    """

    name: str
    title: str
    error_label: str
    points: Sequence[Point]
    bounds: Sequence[Bound] = ()
    notes: Sequence[str] = ()
    time_label: str = "run time of a call (s)"


@dataclass(frozen=True, slots=True)
class Timing:
    """Run times of one contender.

    ``seconds``: median of the warm runs (s); ``cold_seconds``: the first run (s); ``samples``: the warm runs in the
    order in which they were made (s); ``value``: the first run's result, so that its error needs no further run.
    """

    seconds: float
    cold_seconds: float
    samples: tuple[float, ...]
    value: object


Judge = Callable[[str, Any], tuple[float, Extra]]
"""Takes a setting and its result; returns its error, and further columns."""


def paired(contenders: Mapping[str, Callable[[], object]], repeats: int, budget: float = math.inf) -> dict[str, Timing]:
    """Time contenders in turn: first each once cold, then ``repeats`` rounds of warm runs.

    Rounds stop early once all warm runs together took longer than ``budget`` (s).

    Raises
    ------
    InputError
        ``repeats`` is not positive.

    Examples
    --------
    >>> timings = paired({"short": lambda: sum(range(10)), "long": lambda: sum(range(9999))}, 5)
    >>> len(timings["long"].samples), timings["long"].value
    (5, 49985001)
    """
    if repeats < 1:
        raise InputError(f"{repeats} repeats give no median; ask for one at least")
    cold = {name: _timed(call) for name, call in contenders.items()}
    samples: dict[str, list[float]] = {name: [] for name in contenders}
    spent = 0.0
    for done in range(repeats):
        if done and spent > budget:
            break
        for name, call in contenders.items():
            samples[name].append(_timed(call)[0])
            spent += samples[name][-1]
    return {name: Timing(median(taken), cold[name][0], tuple(taken), cold[name][1]) for name, taken in samples.items()}


def race(
    calls: Calls, repeats: int, judge: Judge, default: str, *, budget: float = math.inf, per: float = 1.0
) -> list[Point]:
    """Time contenders in turn, and return a point for each.

    ``calls``: the contenders; ``repeats``, ``budget``: as of :func:`paired`; ``default``: the setting that a user gets
    without asking; ``per``: pieces of work in a call; the time is that of one.
    """
    timings = paired({name: call for name, (_, call) in calls.items()}, repeats, budget)
    points = []
    for name, (group, _) in calls.items():
        timing = timings[name]
        error, extra = judge(name, timing.value)
        seconds, cold, is_default = timing.seconds / per, timing.cold_seconds, name == default
        points.append(Point(name, error, seconds, group, is_default, cold, extra, timing.samples))
    return points


def _timed(call: Callable[[], object]) -> tuple[float, object]:
    start = CLOCK()
    value = call()
    return CLOCK() - start, value


def machine() -> dict[str, Any]:
    """Return processor, cores, memory, system, versions and thread settings; neither the machine's name nor a path.

    Examples
    --------
    >>> machine()["cores"] >= 1
    True
    """

    def first(path: str, pattern: str) -> str:
        try:
            found = re.search(pattern, Path(path).read_text("utf-8"), re.MULTILINE)
        except OSError:  # not Linux
            return ""
        return found.group(1).strip() if found else ""

    about = program()
    kilobytes = first("/proc/meminfo", r"^MemTotal:\s*(\d+) kB$")
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    return {
        "processor": first("/proc/cpuinfo", r"^model name\s*:\s*(.+)$") or platform.machine(),
        "cores": processors(),
        "memory_bytes": int(kilobytes) * 1024 if kilobytes else None,
        "system": platform.system(),
        "architecture": platform.machine(),
        "python": about["python"],
        "labpipe": about["labpipe"],
        "commit": about["git"],
        "libraries": about["libraries"],
        "threads": {name: os.environ[name] for name in threads if name in os.environ},
    }

"""Every shortcut that can be switched off: work, time and result with and without it."""

import itertools
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from labpipe import materials
from pipelines import process as verbs
from pipelines.bench import sessions, skipped_frames, skipped_steps
from pipelines.bench.measure import Point, Suite, paired
from pipelines.bench.shortcut import Shortcut

#: Rounds of a shortcut end once its runs together took longer than this (s).
_BUDGET = 10.0


def run(quick: bool) -> Suite:
    """Run everything with each shortcut and without it."""
    with tempfile.TemporaryDirectory() as folder:
        shortcuts = [
            skipped_frames.rest_in_a_film(Path(folder), 600 if quick else 2400),
            skipped_frames.frames_without_contact(128 if quick else 800),
            skipped_frames.rows_outside(Path(folder)),
            skipped_frames.bytes_instead_of_floats(quick),
            skipped_frames.subsets_asked_for(),
            skipped_frames.one_reference(8 if quick else 40),
            _steps_behind_a_target(Path(folder)),
            skipped_steps.flights(0.15 if quick else 0.4),
            skipped_steps.rest(0.5 if quick else 1.0),
            skipped_steps.folded_terms("13 terms of acrylic", materials.load("acrylic")),
            skipped_steps.folded_terms("80 terms over 20 decades", skipped_steps.many_terms()),
            skipped_steps.memory(400 if quick else 1500),
            skipped_steps.impacts_asked_for(0.2 if quick else 0.4),
            _imports(),
        ]
        points = [_measure(shortcut, 1 if quick else 5) for shortcut in shortcuts]
    return Suite(
        "skipping",
        "Shortcuts on, and off as with --full",
        "difference of the results / tolerance",
        points,
        notes=[
            "The run time is that with the shortcut, in processor time. A difference of 1 is the "
            "stated tolerance. The part sessions measures whole sessions with nothing changed.",
            "The camera's 8 bits save memory, eight times, and little time: every frame is converted once either way.",
            "Folding terms and leaving out cells that cannot touch save work in proportion, and "
            "time only where there is much of it: a compiled step of 13 terms and 300 springs "
            "spends most of its time on its force, its ledger and its record.",
        ],
        has_diagram=False,
    )


def _measure(shortcut: Shortcut, repeats: int) -> Point:
    contenders = {"short": shortcut.short, "whole": shortcut.whole}
    timings = paired(contenders, repeats, budget=_BUDGET, clock=shortcut.clock)
    short, whole = timings["short"], timings["whole"]
    ratio, low, high = whole.ratio(short)
    return Point(
        shortcut.name,
        shortcut.difference(short.value, whole.value),
        short.seconds,
        is_default=True,
        cold_seconds=short.cold_seconds,
        extra={
            "without (s)": whole.seconds,
            "times faster": ratio,
            "lowest": low,
            "highest": high,
            "work": shortcut.work(short.value),
            "work without": shortcut.work(whole.value),
            "counted": shortcut.counted,
            "tolerance": shortcut.tolerance,
        },
    )


def _steps_behind_a_target(folder: Path) -> Shortcut:
    """Compute the bounces alone when only they are wanted, not models and reports."""
    original = folder / "quick session"
    sessions.write_quick(original)
    numbers = itertools.count()

    def process(to: str | None) -> tuple[Path, int]:
        copy = folder / f"run {next(numbers)}"
        shutil.copytree(original, copy)
        outcome = verbs.process(copy, None if to is None else [to], jobs=0)
        return copy, sum(o.state == "done" for o in outcome.outcomes)

    def difference(short: tuple[Path, int], whole: tuple[Path, int]) -> float:
        return abs(sessions.restitution_error(short[0]) - sessions.restitution_error(whole[0]))

    return Shortcut(
        "session: the steps behind a target (--to bounces)",
        lambda: process("bounces"),
        lambda: process(None),
        difference,
        "the same numbers",
        lambda found: float(found[1]),
        "steps",
    )


def _imports() -> Shortcut:
    """Answer --help without the numerical libraries."""

    def start(code: str) -> int:
        command = [sys.executable, "-c", code + "; import sys; print(len(sys.modules))"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        return int(done.stdout)

    light = "import pipelines.cli"
    return Shortcut(
        "command line: libraries that the answer does not need",
        lambda: start(light),
        lambda: start(light + ", xarray, scipy.signal, matplotlib, numba, cv2"),
        lambda short, whole: 0.0,
        "the same answer",
        float,
        "modules",
        clock=time.perf_counter,  # the work is done in another process
    )

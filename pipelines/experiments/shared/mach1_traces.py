"""The force of a Mach-1 file by itself: outliers, held readings, levels that jump, hum, drift.

A sample has inertia and the cell has a filter: under a motion that repeats itself, or none, a force does not jump to
another level.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import Check, Level, not_made, stated
from labpipe.report import quantity
from labpipe.signals import quantisation_step
from pipelines.experiments.shared.record_checks import longest_by_chance

SPIKE, JUMP, QUIET = "outliers", "level of the force", "force before contact"
HELD = "held forces"

_MANY = 0.01  # of the readings of a block
_FASTER, _IN_NOISE = 4.0, 8.0
"""Times the largest usual change between two readings, and standard deviations beside it, that a
jump exceeds."""

_AROUND = 8  # readings on either side whose medians must differ too
_SURE = 1e-9  # probability by chance of a line in the noise
_CLEAR = 2.0  # times the noise, or the resolution, of a line that is told
_FEWEST = 40  # readings


@dataclass(frozen=True, slots=True)
class Trace:
    """Time and force of one block, and their place in the file.

    ``first`` is the line of the first row; ``rests`` says from when on the stage holds or only oscillates;
    ``criterion`` [N] is the force by which contact was found, NaN without one; ``outliers`` are the runs of readings
    that were left out.
    """

    file: str
    number: int
    first: int
    time: Floats
    force: Floats
    segment: Floats
    rests: float
    criterion: float
    outliers: tuple[dict[str, Any], ...] = ()

    def line(self, index: int) -> int:
        """Return the line of a reading; segments are parted by a line each."""
        return self.first + index + int(self.segment[index] - self.segment[0])


def checks_of(traces: list[Trace]) -> Iterator[Check]:
    """Make all checks of the blocks of one file, the worst of each."""
    for of_one in (_outliers, _jump, _held, _quiet):
        found = [check for trace in traces for check in of_one(trace)]
        worst = next((c for level in ("impossible", "doubtful", "note") for c in found if c.level == level), None)
        if worst is not None or found:
            yield worst or found[0]


def _noise(values: Floats) -> tuple[float, float]:
    """Return the standard deviation of a reading, from second differences, and the resolution."""
    bend = np.diff(values, 2)
    step = float(quantisation_step(values)) if np.unique(values).size > 1 else 0.0
    return float(1.4826 * np.median(np.abs(bend)) / np.sqrt(6.0)), step


def _step(values: Floats) -> float:
    """Return the smallest step between readings, also of a few of them; 0 where they do not change."""
    moves = np.abs(np.diff(values[np.isfinite(values)]))
    moves = moves[moves > 1e-9 * np.max(moves, initial=0.0)]
    return float(moves.min(initial=np.inf)) if moves.size else 0.0


def _held(trace: Trace) -> Iterator[Check]:
    """Look for a run of equal forces that is longer than noise and resolution let it be."""
    force = trace.force
    if force.size < 2 * _FEWEST or not np.isfinite(force).all() or np.ptp(force) == 0.0:
        yield not_made(HELD, f"{2 * _FEWEST} readings that differ")
        return
    edges = np.flatnonzero(np.diff(force, prepend=np.nan, append=np.nan) != 0.0)
    run = int(np.argmax(np.diff(edges)))
    first, after = int(edges[run]), int(edges[run + 1])
    others = np.concatenate([np.diff(force[:first], 2), np.diff(force[after:], 2)])
    step = _step(force)
    # rounding adds its own to the differences of what lies between two steps
    noise = float(np.sqrt(max(np.mean(np.minimum(others**2, (4 * step) ** 2)) / 6.0 - step**2 / 12.0, 0.0)))
    longest = longest_by_chance(noise, step, force.size)
    if others.size < _FEWEST or after - first <= max(longest, _FEWEST):
        yield stated(HELD, f"{trace.file}: the force is never held", None, file=trace.file)
        return
    until = "until the end of the block" if after == force.size else "and then goes on"
    text = (
        f"{trace.file}, block {trace.number + 1}: from {quantity(float(trace.time[first]), 's')} the force stays at "
        f"{quantity(float(force[first]), 'N')} for {after - first} readings {until}; its noise otherwise allows "
        f"{max(longest, _FEWEST):.0f}"
    )
    line = trace.line(first)
    cause = f"the program or the cell froze and its last value was written on (line {line})"
    yield stated(HELD, text, "doubtful", cause=cause, file=trace.file, line=line)


def _outliers(trace: Trace) -> Iterator[Check]:
    """Name the readings that were left out."""
    if trace.force.size < _FEWEST:
        yield not_made(SPIKE, f"{_FEWEST} readings in a block")
        return
    runs = [run for run in trace.outliers if run["column"] in ("position_z", "force_z")]
    if not runs:
        yield stated(SPIKE, f"{trace.file}: no outliers", None, file=trace.file)
        return
    largest = max(runs, key=lambda run: float(run["by"]))
    column, first, last = str(largest["column"]).removesuffix("_z"), int(largest["first"]), int(largest["last"])
    count = sum(run["last"] - run["first"] + 1 for run in runs)
    line, end = trace.line(first), trace.line(last)
    by = quantity(float(largest["by"]), "m" if column == "position" else "N")
    where = f"line {line}" if line == end else f"lines {line}-{end}"
    text = (
        f"{trace.file}, block {trace.number + 1}: {count} {'reading' if count == 1 else 'readings'} left out as "
        f"outliers, the largest deviation {by} of the {column} in {where}, at {quantity(float(trace.time[first]), 's')}"
    )
    level: Level = "doubtful" if count > _MANY * trace.force.size else "note"
    cause = f"a disturbance, or a value that was edited, in line {line}"
    yield stated(SPIKE, text, level, cause=cause, file=trace.file, line=line)


def _jump(trace: Trace) -> Iterator[Check]:
    rests = trace.time >= trace.rests
    force = trace.force[rests]
    if force.size < _FEWEST or not np.isfinite(force).all():
        yield not_made(JUMP, "a hold or an oscillation")
        return
    noise, step = _noise(force)[0], _step(force)
    moved = np.abs(np.diff(force))
    limit = _FASTER * float(np.quantile(moved, 0.99)) + _IN_NOISE * noise + 2 * step
    for at in np.flatnonzero(moved > limit):
        low, high = force[max(at - _AROUND + 1, 0) : at + 1], force[at + 1 : at + 1 + _AROUND]
        change = float(np.median(high) - np.median(low))
        if min(low.size, high.size) >= _AROUND and abs(change) > 0.5 * float(moved[at]):
            index = int(np.flatnonzero(rests)[at + 1])
            text = (
                f"{trace.file}, block {trace.number + 1}: the force jumps by {quantity(change, 'N')} at "
                f"{quantity(float(trace.time[index]), 's')} while the stage goes on as before"
            )
            cause = (
                f"the cell was tared or knocked, or rows were lost there and the rest numbered anew "
                f"(line {trace.line(index)})"
            )
            yield stated(JUMP, text, "impossible", cause=cause, file=trace.file, line=trace.line(index))
            return
    yield stated(JUMP, f"{trace.file}: no jump of the force", None, file=trace.file)


def _quiet(trace: Trace) -> Iterator[Check]:
    """Look at the approach before contact: the cell then shows noise and its weight."""
    half = trace.force.size // 2
    if not np.isfinite(trace.criterion) or half < _FEWEST or np.ptp(trace.force[:half]) == 0.0:
        return
    t, f = trace.time[:half] - trace.time[0], trace.force[:half]
    slope = float(np.polyfit(t, f, 1)[0])
    _, step = _noise(f)
    rest = f - np.polyval(np.polyfit(t, f, 1), t)
    power = np.abs(np.fft.rfft(rest)) ** 2
    peak = int(np.argmax(power[1:])) + 1
    share = float(power[peak - 1 : peak + 2].sum() / max(power[1:].sum(), 1e-300))
    interval = float(np.median(np.diff(t)))
    clean = stated(QUIET, f"{trace.file}: still before contact", None, file=trace.file)
    # chance that three neighbouring lines of white noise hold that share of its power
    is_line = share > 1 - (_SURE / power.size) ** (2 / max(half - 6, 1))
    amplitude = float(np.sqrt(2.0) * np.std(rest) * np.sqrt(share))
    u_slope = float(np.std(rest)) * np.sqrt(12.0 / half) / float(t[-1])
    drift = slope * float(t[-1])
    if is_line and amplitude > _CLEAR * max(step, float(np.sqrt(max(1 - share, 0.0)) * np.std(rest))):
        hertz = peak / (half * interval)
        text = f"{trace.file}: before contact the force swings by {quantity(amplitude, 'N')} at {hertz:.3g} Hz"
        cause = f"hum or a vibration of {hertz:.3g} Hz (or of a multiple of the sampling rate beside it)"
        yield _weighed(replace(clean, message=text, cause=cause), amplitude, trace)
    elif abs(slope) > 10 * u_slope and abs(drift) > 5 * step:
        text = f"{trace.file}: before contact the force drifts by {quantity(slope, 'N/s')}"
        cause = "the cell drifts (let it warm up), or the approach began in contact"
        yield _weighed(replace(clean, message=text, cause=cause), abs(drift), trace)
    else:
        yield clean


def _weighed(check: Check, size: float, trace: Trace) -> Check:
    """Let a disturbance as large as the force that finds contact count."""
    return replace(check, level="doubtful" if size > trace.criterion else "note", line=trace.first)

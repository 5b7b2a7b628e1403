"""Columns of a Mach-1 file by themselves: outliers, leaps and levels that jump, hum, drift.

A stage and a sample have inertia and the cell has a filter: no reading leaves both its neighbours
by far, a stage goes no faster than it was told, and under a motion that repeats itself, or none, a
force does not jump to another level.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import Check, Level, not_made, stated
from labpipe.report import quantity
from labpipe.signals import quantisation_step
from pipelines.experiments.shared.record_checks import longest_by_chance

SPIKE, JUMP, QUIET = "outliers", "level of the force", "force before contact"
FOUND, ZERO = "force at contact", "zero of the force"
LEAP, HELD, MOVED = "leaps of the stage", "held forces", "position from block to block"

_ALONE = 15.0  # standard deviations of noise, or steps of the resolution
_MANY = 0.01  # of the readings of a block
_FASTER, _IN_NOISE = 4.0, 8.0
"""Times the largest usual change between two readings, and standard deviations beside it, that a
jump exceeds."""

_AROUND = 8  # readings on either side whose medians must differ too
_SURE = 1e-9  # probability by chance of a line in the noise
_CLEAR = 2.0  # times the noise, or the resolution, of a line that is told
_FEWEST = 40  # readings
_EASED, _LEAPS = 1.5, 3.0
"""Times its speed by which a stage may go between two readings, for times that are rounded and
motions that ease, and beyond which it has not gone there at all."""
_PASSED = 0.3  # of the force to look for: the cell's filter lags, and the force falls when the stage stops
_SAME_PLACE, _RELAXES = 2e-6, 0.1
"""m within which a stage stays, and share of the forces of two blocks that relaxes between them."""
_STILL, _FEWEST_STILL, _GOES_ON = 2e-7, 16, 1.5
"""m within which a stage rests at the end of a block, how many readings of that rest show how the force goes on, and
by how much more it may go on than by the logarithm of time."""
_IN_CONTACT = 0.2  # of the largest force of a file
_MATTERS = 0.05  # of a block's travel: less than that spoils nothing that is made of it


@dataclass(frozen=True, slots=True)
class Trace:
    """Columns of one block, and where they stand.

    ``first`` is the line of the first row; ``rests`` says from when on the stage holds or only
    oscillates; ``criterion`` [N] is the force by which contact was found, NaN without one;
    ``fastest`` [m/s] is the speed that the command leads to at most, NaN where it says none;
    ``pause`` [s] is the time from the last row to the next block, NaN where it is not known; ``outliers`` are
    the runs of readings that were left out.
    """

    file: str
    number: int
    first: int
    time: Floats
    position: Floats
    force: Floats
    segment: Floats
    rests: float
    criterion: float
    fastest: float
    pause: float
    outliers: tuple[dict[str, Any], ...] = ()

    def line(self, index: int) -> int:
        """Return the line of a reading; segments are parted by a line each."""
        return self.first + index + int(self.segment[index] - self.segment[0])


def checks_of(traces: list[Trace]) -> Iterator[Check]:
    """Make all checks of the blocks of one file, the worst of each."""
    for of_one in (_outliers, _leap, _jump, _held, _quiet, partial(_found, traces)):
        found = [check for trace in traces for check in of_one(trace)]
        worst = next((c for level in ("impossible", "doubtful", "note") for c in found if c.level == level), None)
        if worst is not None or found:
            yield worst or found[0]
    yield _zeroed(traces)
    yield _moved(traces)


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


def _leap(trace: Trace) -> Iterator[Check]:
    """Hold every step from reading to reading against the speed of the stage."""
    x, interval = trace.position, np.diff(trace.time)
    if x.size < _FEWEST or not (np.isfinite(x).all() and np.isfinite(trace.fastest) and (interval > 0).all()):
        yield not_made(LEAP, "a declared speed, and times that rise")
        return
    moved = np.diff(x)
    rates = np.abs(moved / interval)
    # a declared speed that is too low is another mistake: the stage then goes steadily beyond it
    going = rates[rates > 0.3 * trace.fastest]
    fastest = max(trace.fastest, float(np.median(going)) if going.size else 0.0)
    noise, step = _noise(x)
    allowed, spread = fastest * interval, _ALONE * max(noise, step)
    # what the next reading undoes is one reading that stands alone
    lasts = np.minimum(np.abs(moved[:-1]), np.abs(x[2:] - x[:-2])) * (moved[:-1] * (x[2:] - x[:-2]) > 0)
    beyond = lasts - _EASED * allowed[:-1] - spread
    at = int(np.argmax(beyond))
    if not beyond[at] > 0:
        yield stated(LEAP, f"{trace.file}: the stage goes steadily", None, file=trace.file)
        return
    line = trace.line(at + 1)
    text = (
        f"{trace.file}, block {trace.number + 1}: the stage leaps by {quantity(float(moved[at]), 'm')} in "
        f"{quantity(float(interval[at]), 's')} at {quantity(float(trace.time[at + 1]), 's')}, where its speed of "
        f"{quantity(fastest, 'm/s')} leads to {quantity(float(allowed[at]), 'm')}"
    )
    cause = f"rows were lost there and the rest numbered anew, or the stage slipped or was homed (line {line})"
    is_far = lasts[at] > _LEAPS * allowed[at] + spread and lasts[at] > _MATTERS * float(np.ptp(x))
    yield stated(LEAP, text, "impossible" if is_far else "doubtful", cause=cause, file=trace.file, line=line)


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


def _found(traces: list[Trace], trace: Trace) -> Iterator[Check]:
    """Hold the force at the end of an approach against that by which the stage found contact."""
    half = trace.force.size // 2
    if not np.isfinite(trace.criterion) or half < _FEWEST or not np.isfinite(trace.force).all():
        return
    f = trace.force
    rise = float(np.max(np.abs(f[half:] - np.median(f[:half]))))
    text = (
        f"{trace.file}: the force changes by {quantity(rise, 'N')} at most before the stage stops; it was told to look "
        f"for {quantity(trace.criterion, 'N')}"
    )
    # where no contact is seen in it, the approach has one level alone
    step = max(_step(each.force) for each in traces)
    if step > trace.criterion:
        text = f"{trace.file}: the force goes in steps of {quantity(step, 'N')}; the stage was told to look for "
        text += f"{quantity(trace.criterion, 'N')}"
        cause = "the forces were rounded when the file was written or saved again: take the tester's own file"
        yield stated(FOUND, text, "doubtful", cause=cause, file=trace.file, line=trace.first - 1)
        return
    if rise > _PASSED * trace.criterion:
        yield stated(FOUND, text, None, file=trace.file)
        return
    cause = (
        "the column is not the force that the stage listened to (another axis or cell, or another unit), or contact "
        f"was not found (header of the columns, line {trace.first - 1})"
    )
    yield stated(FOUND, text, "doubtful", cause=cause, file=trace.file, line=trace.first - 1)


def _zeroed(traces: list[Trace]) -> Check:
    """Hold the force at the beginning of a block against that at the end of the one before."""
    stays = [
        (a, b)
        for a, b in pairwise(traces)
        if min(a.force.size, b.force.size) >= _FEWEST
        and np.isfinite([a.force[-1], b.force[0], b.position[0]]).all()
        and abs(b.position[0] - a.position[-1]) <= _SAME_PLACE
    ]
    if not stays:
        return not_made(ZERO, "two blocks between which the stage stays")
    ends = [(float(np.median(a.force[-3:])), float(np.median(b.force[:3]))) for a, b in stays]
    spans = [max(float(np.ptp(a.force)), float(np.ptp(b.force))) for a, b in stays]
    beyond = [
        _off(a, after - before, span) - float(np.nan_to_num(a.criterion))
        for (before, after), span, (a, _) in zip(ends, spans, stays, strict=True)
    ]
    worst = int(np.argmax(beyond))
    (before, after), (_, b) = ends[worst], stays[worst]
    text = (
        f"{b.file}, block {b.number + 1}: the force begins at {quantity(after, 'N')}, the block before it ended at "
        f"{quantity(before, 'N')}, with the stage in one place"
    )
    cause = "the cell was zeroed or knocked between the two blocks: their forces count from two zeros"
    is_off = beyond[worst] > 0.0
    return stated(ZERO, text, "doubtful" if is_off else None, cause=cause, file=b.file, line=b.first)


def _moved(traces: list[Trace]) -> Check:
    """Hold the position at the beginning of a block against that at the end of the one before, in contact."""
    force = np.concatenate([trace.force for trace in traces])
    free = float(np.median(traces[0].force[:_FEWEST]))
    size, travel = float(np.nanmax(np.abs(force - free))), max(float(np.ptp(trace.position)) for trace in traces)
    known = [
        (a, b, float(b.position[0] - a.position[-1]))
        for a, b in pairwise(traces)
        if a.force[-1] - free > _IN_CONTACT * size and abs(b.force[0] - a.force[-1]) < _RELAXES * size
    ]
    if not known or not np.isfinite([size, travel]).all():
        return not_made(MOVED, "two blocks between which a force goes on")
    before, after, by = max(known, key=lambda pair: abs(pair[2]))
    text = (
        f"{after.file}, block {after.number + 1}: the position begins {quantity(by, 'm')} from where the block before "
        f"ended, and the force at {quantity(float(after.force[0]), 'N')} after {quantity(float(before.force[-1]), 'N')}"
    )
    is_far = abs(by) > travel
    cause = f"the position was zeroed between the two blocks, or the stage was homed (line {after.first})"
    return stated(MOVED, text, "impossible" if is_far else None, cause=cause, file=after.file, line=after.first)


def _off(before: Trace, change: float, span: float) -> float:
    """Return by how much a force changes from a block to the next beyond what its rest leads to [N]."""
    level = float(np.median(before.force[-3:]))
    if _IN_CONTACT * level < level + change < level:  # a force in contact that only falls relaxes
        return -np.inf
    noise = max(_noise(before.force))
    moved = np.flatnonzero(np.abs(before.position - before.position[-1]) > _STILL)
    rest = slice((int(moved[-1]) if moved.size else 0) + 1, None)
    time, force = before.time[rest], before.force[rest]
    if not before.pause >= 0.0 or force.size < _FEWEST_STILL or np.isfinite(before.criterion):
        return abs(change) - max(_RELAXES * span, _ALONE * noise)
    # what an oscillation or a ramp left behind fades first; a relaxation slows down with the time since
    last = slice(force.size // 2, None)
    slope, since = float(np.polyfit(time[last], force[last], 1)[0]), float(time[-1] - time[0])
    ahead = _GOES_ON * slope * since * float(np.log1p(before.pause / since))
    return max(change - max(ahead, 0.0), min(ahead, 0.0) - change) - _IN_NOISE * noise


def _weighed(check: Check, size: float, trace: Trace) -> Check:
    """Let a disturbance as large as the force that finds contact count."""
    return replace(check, level="doubtful" if size > trace.criterion else "note", line=trace.first)

"""Checks of what a body with inertia can do: no jumps, no uneven times, no sine in place of a fall."""

from itertools import pairwise
from math import pi

import numpy as np

from labpipe.judging import Check, Level, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.trace_checks._trace import IN_NOISE, QUIET, WRONG_CHANNEL, Trace

SINGLE_ROWS = "lost or doubled rows"
_FASTER = 3.0  # times the largest usual step between two readings, beyond which it is a jump
_LEAST_JUMP = 0.02  # of the travel
_MANY_SPIKES = 0.01  # of all readings
_SINE, _LINE = 0.98, 0.7
"""Of the variance; and of the power in three neighbouring lines, of which a sine has more than 0.8 in any phase."""
_A_PERIOD = 100  # readings of a sine that are enough to know it
_LOUDER, _LATE = 5.0, 0.3  # times the noise at rest, and parts of an interval, of readings at uneven times
_WINDOW, _NOISY, _HALF = 24, 1.5, 0.5
"""Readings in which a jump is looked for, times the noise that a smooth motion leaves, and the part of a step by which
a jump may differ from one."""
_PARTS, _NOISIER = 5, 3.0  # of a record, and ratio of their noise that is reported
_REGULAR = 0.02  # of a period, within which spikes come one each period


def timing(trace: Trace) -> Check:
    """Hold the noise of readings in motion against that at rest: uneven times make positions scatter with speed."""
    name, law = ("times of the readings", "noise is one at rest and in motion where readings come at their times")
    x = trace.reading
    scatter = np.abs(np.diff(x, 4)) / np.sqrt(70.0)
    moves = np.abs(x[4:] - x[:-4]) / 4  # from reading to reading
    moving = moves > 0.5 * float(np.nanquantile(moves, 0.9))
    if moving.sum() < QUIET or not np.isfinite(scatter[:QUIET]).any():
        return not_made(name, law, f"{QUIET} readings at rest and in motion")
    rest, fast = (1.4826 * float(np.nanmedian(part)) for part in (scatter[:QUIET], scatter[moving]))
    late = fast / float(np.median(moves[moving]))
    interval = float(np.median(np.diff(trace.time)))
    text = f"{trace.name}: readings scatter by {quantity(rest, 'm')} at rest and by {quantity(fast, 'm')} in motion"
    is_late = fast > _LOUDER * max(rest, 0.3 * trace.resolution) and late > _LATE
    cause = (
        f"the times of the readings jitter by about {quantity(late * interval, 's')}: they were polled by a program, "
        "or the clock of the sampling is not that of the sensor"
    )
    return stated(name, law, text, "doubtful" if is_late else None, cause=cause, file=trace.name)


def jumps(trace: Trace) -> Check:
    """Look for steps between two readings that no speed of the body explains."""
    title, law = "jumps and spikes", "a body has inertia: it moves no further than its speed allows"
    known = np.flatnonzero(np.isfinite(trace.reading))
    x = trace.reading[known]
    steps = np.diff(x)
    # of three steps in a row the middle one: a spike makes two of them, against each other
    low, high = np.minimum(steps[:-2], steps[1:-1]), np.maximum(steps[:-2], steps[1:-1])
    usual = float(np.quantile(np.abs(np.maximum(low, np.minimum(high, steps[2:]))), 0.995))
    limit = max(_FASTER * usual, _LEAST_JUMP * trace.travel) + IN_NOISE * trace.noise + 2 * trace.resolution
    large = np.flatnonzero((np.abs(steps) > limit) & (np.diff(known) == 1))
    if large.size:
        worst = max(large.tolist(), key=lambda i: abs(float(steps[i])))
        at = f"{trace.at(int(known[worst + 1]))}, {quantity(usual, 'm')} between two readings is usual"
        text = f"{trace.name}: the readings jump by {quantity(float(steps[worst]), 'm')} at {at}"
        cause = (
            "readings were lost there and the rest numbered anew, two recordings were pasted together, or the "
            "sensor was moved"
        )
        for first, after in pairwise(large.tolist()):
            if abs(float(x[after + 1] - x[first])) < 0.5 * abs(float(steps[first])):
                begin, end = int(known[first + 1]), int(known[after])
                text += f"; readings {begin + 1}-{end + 1} leave the record and return to it"
                cause = f"readings {begin + 1}-{end + 1} are a disturbance of the sensor, too long to be left out"
                break
        return stated(title, law, text, "impossible", file=trace.name, cause=cause)
    if trace.outliers:
        first, _, size = max(trace.outliers, key=lambda run: run[2])
        count = sum(end - begin + 1 for begin, end, _ in trace.outliers)
        numbers = ", ".join(
            f"{begin + 1}" if begin == end else f"{begin + 1}-{end + 1}" for begin, end, _ in trace.outliers[:5]
        )
        numbers += ", …" if len(trace.outliers) > 5 else ""
        spikes = "one spike" if len(trace.outliers) == 1 else f"{len(trace.outliers)} spikes"
        text = (
            f"{trace.name}: {spikes} left out (readings {numbers}), the largest of {quantity(size, 'm')} at "
            f"{trace.at(first)}"
        )
        cause = "a disturbance of the sensor, such as a flash of light or a speck of dust"
        gaps = np.diff(trace.time[[begin for begin, _, _ in trace.outliers]])
        period = float(np.median(gaps)) if gaps.size > 2 else np.inf
        if np.isfinite(period) and (np.abs(gaps / period - np.round(gaps / period)) < _REGULAR).all():
            text += f"; they come each {quantity(period, 's')}"
            cause = "what is switched so often, such as a dimmer or a converter at the mains, disturbs the sensor"
        level: Level = "doubtful" if count > _MANY_SPIKES * trace.reading.size else "note"
        return stated(title, law, text, level, file=trace.name, cause=cause)
    return stated(title, law, f"{trace.name}: no jump and no spike", None, file=trace.name)


def single_rows(trace: Trace) -> Check:
    """Look for single rows that are lost or doubled: the motion goes on as if it were one reading later or earlier.

    In a window of 24 readings a parabola and a jump in its middle are fitted; a lost row makes a jump of one step
    between two readings, a doubled row one in the other direction.
    """
    title, law = SINGLE_ROWS, "flights are smooth: no reading comes one interval early or late"
    place = np.arange(_WINDOW) - 0.5 * (_WINDOW - 1)
    design = np.stack([np.ones(_WINDOW), place, place**2, np.sign(place) / 2.0])
    inverse = np.linalg.pinv(design)
    if trace.reading.size < 2 * _WINDOW:
        return not_made(title, law, f"{2 * _WINDOW} readings")
    windows = np.lib.stride_tricks.sliding_window_view(trace.reading, _WINDOW)
    fitted = windows @ inverse
    noise = max(trace.noise, 0.3 * trace.resolution)
    is_smooth = np.std(windows - fitted @ design, axis=1) < _NOISY * noise
    step, jump, u = fitted[:, 1], fitted[:, 3], noise * float(np.linalg.norm(inverse[:, 3]))
    is_seen = is_smooth & (np.abs(jump) > IN_NOISE * u) & (np.abs(np.abs(jump / step) - 1.0) < _HALF)
    # of neighbouring windows the one with the largest jump
    found = [max(run, key=lambda i: abs(jump[i])) for run in _runs(np.flatnonzero(is_seen))]
    lost = sum(bool(jump[i] * step[i] > 0.0) for i in found)
    if not found:
        return stated(title, law, f"{trace.name}: no single row is lost or doubled", None, file=trace.name)
    at = trace.at(int(found[0]) + _WINDOW // 2)
    text = f"{trace.name}: {lost} single rows lost and {len(found) - lost} doubled, the first at {at}"
    cause = "rows were lost or doubled when the file was written or copied, and the others numbered anew"
    return stated(title, law, text, "doubtful", file=trace.name, cause=cause)


def _runs(places: np.ndarray) -> list[np.ndarray]:
    """Part places into runs of neighbours."""
    return np.split(places, np.flatnonzero(np.diff(places) > _WINDOW) + 1) if places.size else []


def steady_noise(trace: Trace) -> Check:
    """Compare the noise of five parts of a record."""
    name, law = "change of the noise", "a sensor has the same noise from the beginning to the end of a record"
    bend = np.abs(np.diff(trace.reading, 4)) / np.sqrt(70.0)
    parts = [part[np.isfinite(part)] for part in np.array_split(bend, _PARTS)]
    if min(part.size for part in parts) < QUIET:
        return not_made(name, law, f"{_PARTS * QUIET} readings")
    sizes = np.maximum([1.4826 * float(np.median(part)) for part in parts], 0.3 * trace.resolution)
    low, high = int(np.argmin(sizes)), int(np.argmax(sizes))
    text = f"{trace.name}: noise of {quantity(sizes[low], 'm')} in part {low + 1} of {_PARTS}, "
    text += f"{quantity(sizes[high], 'm')} in part {high + 1}"
    is_larger = sizes[high] > _NOISIER * sizes[low]
    cause = "light, surface, gain or averaging of the sensor changed while it recorded"
    return stated(name, law, text, "note" if is_larger else None, cause=cause, file=trace.name)


def wave(trace: Trace) -> Check:
    """Look whether all that is seen is one sine."""
    title, law = "shape of the record", "a drop is no sine"
    known = np.isfinite(trace.reading)
    t, x = trace.time[known], trace.reading[known]
    spread = float(np.var(x))
    power = np.abs(np.fft.rfft(x - x.mean()))
    if spread == 0.0 or power.size < 3:
        return not_made(title, law, "readings that differ")
    strongest = 1 + int(np.argmax(power[1:]))
    lines = power[1:] ** 2
    is_line = lines[max(strongest - 2, 0) : strongest + 1].sum() > _LINE * lines.sum()
    peak = strongest / (x.size * float(np.median(np.diff(t))))
    best, at = 0.0, peak
    if is_line:  # which takes no more readings than its periods need
        every = max(1, t.size // (_A_PERIOD * strongest))
        t, x = t[::every], x[::every]
        spread = float(np.var(x))
        tried = np.linspace(0.6 * peak, 1.4 * peak, 33)
        turns = 2 * pi * tried[:, None] * t
        basis = np.stack([np.ones_like(turns), np.cos(turns), np.sin(turns)], axis=2)
        turned = basis.transpose(0, 2, 1)
        fitted = np.linalg.solve(turned @ basis, (turned @ x)[..., None])
        explained = 1 - np.var(x - (basis @ fitted)[..., 0], axis=1) / spread
        best, at = float(explained.max()), float(tried[np.argmax(explained)])
    n_periods = at * float(t[-1] - t[0])
    if best > _SINE and n_periods > 1.5:
        text = f"{trace.name}: {100 * best:.0f} % of what is seen is a sine of {at:.3g} Hz, no fall and no bounces"
        return stated(title, law, text, "impossible", file=trace.name, cause=WRONG_CHANNEL)
    return stated(title, law, f"{trace.name}: not a sine", None, file=trace.name)

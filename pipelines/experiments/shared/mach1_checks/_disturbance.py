"""Checks of what else reaches the cell while the stage oscillates or holds: a hit on the table, a drift, a slip."""

from collections.abc import Sequence

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, Check, Level, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.mach1_checks._parts import (
    OSCILLATION,
    SETTLED,
    Part,
    counted_frequency,
    travel_and_speed,
)
from pipelines.experiments.shared.mach1_checks._titles import DRIFT, KNOCK, STEADY
from pipelines.experiments.shared.ramps_and_holds import RELAXATION

_WINDOW, _FEWEST = 8, 20  # readings of a piece, and pieces that make a usual one
_LOUDER, _LASTS = 6.0, 2  # times the usual piece, and pieces in a row: one alone is a spike
_SMALL, _LARGE = 0.01, 0.05  # of the force's swing, from which on a knock is told, and doubtful
_GROWS = 0.03  # of the force, by which its mean may grow over an oscillation
_SETTLES, _BRAKES, _CYCLES = 2, 1, 2  # cycles left out at either end, and needed between them
_CHANGES = 0.03  # of a stiffness, by which it may change from the first of them to the last


def knocked(name: str, blocks: Sequence[Part]) -> Check:
    """Look for what makes a force tremble for a while, as a hit on the table does."""
    worst: tuple[float, float, float, Part] | None = None
    for part in blocks:
        time, force = _steady(part)
        bends = np.abs(np.diff(force, 2))
        count = bends.size // _WINDOW
        if count < _FEWEST or not np.isfinite(bends).all():
            continue
        pieces = np.median(bends[: count * _WINDOW].reshape(count, _WINDOW), axis=1)
        usual = float(np.quantile(pieces, 0.75))
        loud = np.convolve(pieces > _LOUDER * usual, np.ones(_LASTS), "valid") >= _LASTS
        share = float(pieces.max()) / max(float(np.ptp(part.force)), 1e-300)
        if usual > 0.0 and loud.any() and share > _SMALL and (worst is None or share > worst[0]):
            worst = share, float(pieces.max()), float(time[int(np.argmax(loud)) * _WINDOW]), part
    if worst is None:
        known = any(_steady(part)[0].size >= _FEWEST * _WINDOW for part in blocks)
        text = f"{name}: the force is as smooth in all stretches"
        return stated(KNOCK, text, None, file=name) if known else not_made(KNOCK, "a steady motion")
    share, size, at, part = worst
    text = f"{name}, block {part.number + 1}: about {quantity(at, 's')} the force fluctuates for a while, by "
    text += f"{quantity(size, 'N')} from reading to reading"
    level: Level = "doubtful" if share > _LARGE else "note"
    cause = f"something struck the table or the tester about {quantity(at, 's')}; leave that cycle or hold out"
    return stated(KNOCK, text, level, cause=cause, file=name, line=part.header_line)


def _steady(part: Part) -> tuple[Floats, Floats]:
    """Return time and force while the stage oscillates, or once it holds."""
    if part.function == OSCILLATION:
        return part.time, part.force
    rest = travel_and_speed(part)[2] if part.function == RELAXATION else 0.0
    inside = part.segment == part.segment[0]
    inside &= part.time > float(part.time[inside][-1]) - rest + 2 * SETTLED
    return part.time[inside], part.force[inside]


def mean_grows(name: str, blocks: Sequence[Part]) -> Check:
    """Hold the mean force of an oscillation against relaxation: about a held depth it falls, or stays."""
    found = []
    for part in (p for p in blocks if p.function == OSCILLATION):
        used = np.isfinite(part.position) & np.isfinite(part.force)
        t, x, f = part.time[used], part.position[used], part.force[used]
        if t.size < _FEWEST * _WINDOW or np.ptp(x) == 0.0:
            continue
        rate = np.gradient(x, t)
        columns = (np.ones_like(t), (t - t.mean()) / np.ptp(t), (x - x.mean()) / np.ptp(x), rate / np.abs(rate).max())
        rise = float(np.linalg.lstsq(np.column_stack(columns), f, rcond=None)[0][1])
        found.append((rise / max(abs(float(f.mean())), float(np.ptp(f))), rise, part))
    if not found:
        return not_made(DRIFT, "an oscillation")
    share, rise, part = max(found, key=lambda each: each[0])
    text = (
        f"{name}, block {part.number + 1}: the mean force changes by {quantity(rise, 'N')} while the stage oscillates"
    )
    cause = "the cell or its cable drifts, or the stage creeps into the material: let it warm up, and tare it again"
    level: Level | None = "doubtful" if share > _GROWS else None
    return stated(DRIFT, text, level, cause=cause, file=name, line=part.header_line)


def stiffness_kept(name: str, blocks: Sequence[Part]) -> Check:
    """Hold the cycles of an oscillation against each other: force over motion stays what it is once it has settled."""
    found = []
    for part in (p for p in blocks if p.function == OSCILLATION):
        stiffness, u = _of_cycles(part)
        if stiffness.size >= _CYCLES:
            # a line through them, from the first to the last
            places = np.linspace(-0.5, 0.5, stiffness.size)
            usual = float(stiffness.mean())
            change = float(np.dot(places, stiffness) / np.dot(places, places)) / usual
            found.append((change, float(u.max()) / usual / float(np.dot(places, places)) ** 0.5, part))
    if not found:
        return not_made(STEADY, f"{_SETTLES + _CYCLES + _BRAKES} cycles of an oscillation")
    change, u, part = max(found, key=lambda each: abs(each[0]))
    text = f"{name}, block {part.number + 1}: force over motion changes by {100 * change:+.1f} % from the first cycle "
    text += "that has settled to the last"
    cause = "the specimen slips, creeps away or tears under the punch, or warms up: no one stiffness is measured"
    level: Level | None = "doubtful" if abs(change) > max(_CHANGES, DOUBTFUL * u) else None
    return stated(STEADY, text, level, cause=cause, file=name, line=part.header_line)


def _of_cycles(part: Part) -> tuple[Floats, Floats]:
    """Return force over motion of each cycle that has settled, and its uncertainty [N/m]."""
    used = np.isfinite(part.position) & np.isfinite(part.force)
    t, x, f = part.time[used], part.position[used], part.force[used]
    frequency = counted_frequency(part)[0]
    moving = np.flatnonzero(np.abs(x - np.median(x)) > 0.25 * np.ptp(x))
    found = []
    if np.isfinite(frequency) and moving.size:
        begin, end = t[moving[0]] + _SETTLES / frequency, t[moving[-1]] - _BRAKES / frequency
        for i in range(int((end - begin) * frequency)):
            inside = (t >= begin + i / frequency) & (t < begin + (i + 1) / frequency)
            turn = 2 * np.pi * frequency * t[inside]
            if turn.size < _WINDOW:
                break
            columns = np.column_stack((np.ones_like(turn), turn - turn.mean(), np.cos(turn), np.sin(turn)))
            both = np.column_stack((x[inside], f[inside]))
            waves = np.linalg.lstsq(columns, both, rcond=None)[0]
            left = (both - columns @ waves).std(axis=0) * (2.0 / turn.size) ** 0.5
            motion, force = np.hypot(*waves[2:])
            if motion > 0.0:
                found.append((force / motion, np.hypot(left[1], left[0] * force / motion) / motion))
    stiffness, u = np.array(found).reshape(-1, 2).T
    return stiffness, u

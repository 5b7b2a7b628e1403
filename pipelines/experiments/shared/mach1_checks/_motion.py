"""Checks of the stage of a tester: whether it does what the header declares, in the declared columns."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import hypot, isfinite, log, nan

import numpy as np

from labpipe.judging import Check, Level, bounded, compared, in_words, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.mach1_checks import _titles as titles
from pipelines.experiments.shared.mach1_checks._parts import (
    FIND_CONTACT,
    OSCILLATION,
    Part,
    between,
    counted_frequency,
    moved_by,
    travel_and_speed,
)
from pipelines.experiments.shared.ramps_and_holds import RELAXATION

_STAGE = {
    titles.AMPLITUDE: 0.3,
    titles.FREQUENCY: 0.05,
    titles.TRAVEL: 0.05,
    titles.SPEED: 0.25,
    titles.APPROACH: 0.25,
    titles.HOLD: 0.1,
}
"""By how much, relative, a stage may miss its command: eases, lags, brakes."""
_LATE = 0.5  # s by which a hold, or a clock, may be off
_SWAPPED_BY = 0.3  # relative, within which the other column holds the declared motion
_U_CLOCK = 2.0  # of the logarithm of a block's length over the time until the next: rests lie between


def order_of_columns(name: str, blocks: Sequence[Part]) -> Check:
    votes: list[bool] = []
    where: Part | None = None
    for part in blocks:
        wanted = abs(part.declared("Amplitude")[0])
        if part.function not in (OSCILLATION, RELAXATION) or not wanted > 0.0:
            continue
        # the file's own numbers: mm of the position, whatever of the force
        own = abs(moved_by(part, part.position)) / wanted
        rigid = abs(moved_by(part, part.force)) * 1e-3 / wanted
        is_swapped = abs(rigid - 1.0) < _SWAPPED_BY and not abs(own - 1.0) < _SWAPPED_BY
        if is_swapped:
            where = where or part
        votes.append(is_swapped)
    if not votes:
        return not_made(titles.SWAPPED, "a declared amplitude")
    if where is None or sum(votes) * 2 <= len(votes):
        return stated(titles.SWAPPED, f"{name}: the position makes the declared motion", None, file=name)
    shown = quantity(where.declared("Amplitude")[0], "m")
    text = (
        f"{name}: the column of the force moves by the declared {shown} (as mm), the column of the position by "
        f"{quantity(abs(moved_by(where, where.position)), 'm')}"
    )
    cause = f"the columns of position and force are swapped (header of the columns, line {where.header_line})"
    return stated(titles.SWAPPED, text, "impossible", cause=cause, file=name, line=where.header_line)


def commands_kept(name: str, blocks: Sequence[Part]) -> Iterator[Check]:
    """Hold amplitude, frequency, travel, speed and rest against the declared; the worst of each."""
    found: dict[str, list[tuple[Check, Part]]] = {}

    def hold(title: str, key: str, part: Part, seen: float, u: float, unit: str) -> None:
        wanted, rounding, line = part.declared(key)
        if not (isfinite(seen) and isfinite(wanted)) or wanted == 0.0:
            return
        ratio = in_words(seen / wanted)
        text = f"{name}, block {part.number + 1}: {title} is {quantity(seen, unit)}, declared are "
        text += f"{quantity(wanted, unit)}{'' if ratio == '1' else f' ({ratio} times)'}"
        allowance = _STAGE[title] * wanted + (_LATE if title == titles.HOLD else 0.0)
        small = max(u, 2e-3 * wanted)
        check = compared(title, text, seen, small, wanted, rounding, allowance=allowance, file=name, line=line)
        found.setdefault(title, []).append((check, part))

    for part in blocks:
        if part.function == OSCILLATION:
            hold(titles.AMPLITUDE, "Amplitude", part, moved_by(part, part.position), 1e-8, "m")
            hold(titles.FREQUENCY, "Frequency", part, *counted_frequency(part), "Hz")
        if part.function in (RELAXATION, FIND_CONTACT):
            travel, speed, rest = travel_and_speed(part)
            is_ramp = part.function == RELAXATION
            if is_ramp:
                hold(titles.TRAVEL, "Amplitude", part, abs(travel), 1e-7, "m")
                if part.text("Stop based on").startswith("Fixed"):
                    hold(titles.HOLD, "Fixed Relaxation Time, s".partition(",")[0], part, rest, 0.05, "s")
            key = "Velocity" if is_ramp else "Stage Velocity"
            hold(titles.SPEED if is_ramp else titles.APPROACH, key, part, abs(speed), 0.02 * abs(speed), "m/s")
    hurried = {
        part.number for title in (titles.TRAVEL, titles.SPEED) for check, part in found.get(title, ()) if check.level
    }
    for title, rows in found.items():
        told = [_stopped(c) if title == titles.HOLD and part.number not in hurried else c for c, part in rows]
        yield max(told, key=lambda c: (c.level not in (None, "note"), abs(c.margin) if c.level else -1.0))


def _stopped(check: Check) -> Check:
    """Take a hold that is too short, after a ramp as declared, for one that somebody ended: what was recorded holds."""
    if not check.level or not check.log_ratio < 0.0:
        return check
    cause = "the test was stopped before its hold was over; what was recorded of it is whole"
    return replace(check, level="note", cause=cause, log_ratio=nan, u_log_ratio=nan)


def clock_of_blocks(name: str, blocks: Sequence[Part]) -> Check:
    worst, text, ratio = -np.inf, "", nan
    line = None
    for part, after in pairwise(blocks):
        gap = between(part, after)
        if not isfinite(gap):
            continue
        lasts = float(part.time[-1] - part.time[0])
        u = hypot(0.1, 5e-3 * abs(gap))
        if (lasts - gap) / u > worst:
            worst = (lasts - gap) / u
            text = (
                f"{name}, block {part.number + 1}: its column of time spans {quantity(lasts, 's')}, the next block "
                f"begins after {quantity(gap, 's')}"
            )
            ratio = lasts / gap if gap > 0 else nan
            line = part.header_line
    if not text:
        return not_made(titles.CLOCK, "two blocks with start times")
    check = bounded(titles.CLOCK, text, worst, 1.0, at_most=0.0, file=name, line=line)
    if check.level is None or not ratio > 0:
        return check
    return replace(check, log_ratio=log(ratio), u_log_ratio=_U_CLOCK)


def direction_of_motion(name: str, blocks: Sequence[Part]) -> Check:
    title = titles.DIRECTION
    for part in blocks:
        travel = travel_and_speed(part)[0] if part.function in (RELAXATION, FIND_CONTACT) else 0.0
        wanted = 1.0 if part.text("Direction").startswith("Pos") else -1.0 if part.text("Direction") else nan
        if part.function == RELAXATION:
            wanted = part.declared("Amplitude")[0]
        if abs(travel) < 1e-6 or not isfinite(wanted):
            continue
        is_back = travel * wanted < 0.0
        text = f"{name}, block {part.number + 1}: the stage moves by {quantity(travel, 'm')}"
        text += ", against the declared direction" if is_back else ", as declared"
        cause = f"the sign of the column of the position is wrong (line {part.header_line})"
        level: Level | None = "impossible" if is_back else None
        return stated(title, text, level, cause=cause, file=name, line=part.header_line)
    return not_made(title, "a ramp or an approach with a declared direction")

"""Checks of a Mach-1 file: what its header declares against what its columns hold.

Commands, clock and columns are redundant: the amplitude of a command stands against the position,
its frequency and speed against position and time, the start of the next block against the length
of this one, and the force against the cell's capacity, its sign against the motion. A factor in a
column moves them by different powers, which tells the mistake.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise
from math import hypot, isfinite, log, nan, pi
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.contact.line import westergaard
from labpipe.judging import Cause, Check, Level, bounded, compared, not_made, stated, too_large
from labpipe.report import quantity
from labpipe.signals import quantisation_step
from pipelines.experiments.shared import mach1_readings, mach1_traces
from pipelines.experiments.shared.punch_settings import IndentationModel, LoadCell, Punch, Substrate
from pipelines.experiments.shared.ramps_and_holds import RELAXATION

AMPLITUDE, FREQUENCY = "amplitude of the oscillation", "frequency of the oscillation"
TRAVEL, SPEED = "travel of the ramp", "speed of the ramp"
APPROACH, HOLD = "speed of the approach", "length of the hold"
CLOCK, CAPACITY, MODULUS = "clock of the blocks", "capacity of the cell", "contact modulus"
RATIO, SCALE = "force for the named material", "scale of the cell"
SIGN, FALL, PHASE = "sign of the stiffness", "fall of the force in the hold", "phase lag"
LATE = "force after the ramp"
STAGE, DIRECTION = "position within the stage", "direction of the motion"
SHAPE = "shape of the oscillation"
RESOLVED, CALIBRATED, AXES = "resolution of the position", "date of the cell", "axes"
DELAY, SWAPPED = "delay of the filter", "order of the columns"

_SINUSOID, _APPROACH = "Sinusoid", "Find Contact"
_STAGE = {AMPLITUDE: 0.3, FREQUENCY: 0.05, TRAVEL: 0.05, SPEED: 0.25, APPROACH: 0.25, HOLD: 0.1}
"""By how much, relative, a stage may miss its command: eases, lags, brakes."""
_COARSE, _ROUNDED, _ALL = 0.03, 0.02, 0.9
"""Of a motion, that a position resolves at least; of a step, within which rounded positions lie; and how many do."""
_AT_REST, _EXTREME = 2.5, 0.02
"""Times a sine's share of the readings beside an extreme, beyond which the stage stood; of the amplitude, beside."""
_PARTS, _SWINGS = 40, 0.01  # of a hold, whose means are compared, and of a force, by which none of them rises
_SETTLED = 0.3  # s after a ramp within which the filter of the cell settles
_LATE = 0.5  # s by which a hold, or a clock, may be off
_SWAPPED_BY = 0.3  # relative, within which the other column holds the declared motion
_RUN, _LEAVES = 5, 20.0
"""Readings in a row at an extreme, and steps of the cell by which a force changes in as many before
or after: behind a smooth peak that stays on one step for n readings it changes by 8 in n more."""
_EXPLAINED, _CLEAR = 0.2, 5.0
"""Share of a force that its motion must explain, and its rise over noise, if the cell lives."""
_LARGEST_STAGE = 0.6  # m of position: no stage of the makers is longer
_LARGEST_PUNCH, _LARGE_PUNCH = 0.5, 0.15  # m, either way
_POLYMER = (1e6, 1e10)  # Pa, reduced moduli of whatever is indented
_U_RANGE = 0.25  # of the logarithm of a modulus at the ends of that range
_U_MATERIAL = 0.5  # of the logarithm of the force for a solid that is known by its name
_RIGHT = 1.0  # of that logarithm: no unit is so near to another
_U_LAYER = 2.3  # the same where a thin layer stiffens the contact
_OWN_FACTOR, _WRONG_FACTOR = 1.25, 3.0  # of true over displayed force: worth a doubt, and wrong
_FACTORS = (1e3, 1e-3, 1e6, 1e-6, 10.0, 0.1, 100.0, 0.01, 2.0, 0.5, 60.0, 1 / 60.0)
_U_CLOCK = 2.0  # of the logarithm of a block's length over the time until the next: rests lie between
_GRAM_FORCE = 1e3 / 9.80665


@dataclass(frozen=True, slots=True)
class Part:
    """One block: its columns, and where its header stands in the file.

    ``line`` is the line of ``<INFO>``, ``header_line`` that of the column names.
    """

    number: int
    function: str
    header: dict[str, Any]
    time: Floats
    position: Floats
    force: Floats
    segment: Floats
    line: int
    header_line: int

    def declared(self, name: str) -> tuple[float, float, int | None]:
        """Return a declared value [SI] with the uncertainty of its rounding, and its line."""
        for place, parameter in enumerate(self.header["parameters"]):
            value = parameter["value"]
            if parameter["key"].partition(",")[0] == name and value is not None:
                text = str(parameter["text"])
                written = abs(float(text.replace(",", "."))) if text.strip("-+0., ") else 0.0
                last = 10.0 ** -len(re.sub(r"^.*[.,]", "", text)) if re.search(r"[.,]", text) else 1.0
                factor = abs(value) / written if written else 0.0
                return float(value), last * factor / 12**0.5, self.line + len(self.header["info_lines"]) + 3 + place
        return nan, nan, None

    def text(self, key: str) -> str:
        """Return a parameter as written; empty where there is none."""
        return next((str(p["text"]) for p in self.header["parameters"] if p["key"] == key), "")


def parts(readings: xr.Dataset) -> list[Part]:
    """Return the blocks of a file with their place in it."""
    found, line = [], 2  # after the title
    force = readings.get("force_z")
    position = readings.get("position_z")
    block = readings["block"].values
    for number, header in enumerate(json.loads(readings.attrs["blocks"])):
        where = block == number
        names = line + len(header["info_lines"]) + len(header["parameter_lines"]) + 4
        if header["has_data"] and where.any() and force is not None and position is not None:
            sign = float(header["compression_sign"]) or 1.0
            time, segment = readings["time"].values[where], readings["segment"].values[where]
            x, f = position.values[where], sign * force.values[where]
            found.append(Part(number, header["function"], header, time, x, f, segment, line, names))
        line = names - 1 + (header["rows"] + len(header["dividers"]) + 3 if header["has_data"] else 0)
    return found


def of_file(name: str, readings: xr.Dataset) -> list[Check]:
    """Check one file by itself; where its columns are exchanged nothing else is asked.

    Parameters
    ----------
    name : str
        The file, relative to the session.
    readings : Dataset
        As read.
    """
    blocks = parts(readings)
    if not blocks:
        return [not_made(SWAPPED, "a file holds position and force", "columns of position and force")]
    order = _order(name, blocks)
    if order.level is not None:
        return [order]
    return [
        order,
        *_commands(name, blocks),
        _clock(name, blocks),
        _stage(name, blocks),
        _direction(name, blocks),
        *_signs(name, blocks),
        _shaped(name, blocks),
        _living(name, blocks),
        _saturated(name, blocks),
        _capacity(name, blocks),
        _calibrated(name, blocks),
        _axes(name, blocks),
        _resolved(name, blocks),
        *mach1_traces.checks_of([_trace(name, part) for part in blocks]),
    ]


def _trace(name: str, part: Part) -> mach1_traces.Trace:
    """Return the columns of a block, and from when on its stage holds or only oscillates."""
    rests = -np.inf if part.function == _SINUSOID else np.inf
    if part.function == RELAXATION:
        first = part.segment == part.segment[0]
        lasted = _speed(part)[2]
        rests = float(part.time[first][-1]) - lasted + _SETTLED if lasted > _SETTLED else np.inf
    x, f = part.position, part.force
    criterion = part.declared("Contact Criteria")[0] if part.function == _APPROACH else nan
    return mach1_traces.Trace(
        name, part.number, part.header_line + 1, part.time, x, f, part.segment, rests, criterion, _fastest(part)
    )


def _fastest(part: Part) -> float:
    """Return the speed to which the command of a block leads at most [m/s]; NaN where it says none."""
    if part.function == _SINUSOID:
        return 2 * pi * part.declared("Frequency")[0] * abs(part.declared("Amplitude")[0])
    key = "Velocity" if part.function == RELAXATION else "Stage Velocity"
    return abs(part.declared(key)[0]) if part.function in (RELAXATION, _APPROACH) else nan


def is_swapped(checks: Sequence[Check]) -> bool:
    """Whether the columns of position and force are exchanged."""
    return any(check.name == SWAPPED and check.level is not None for check in checks)


def knows_depth(checks: Sequence[Check]) -> bool:
    """Whether the column of the position tells how deep a punch goes."""
    wrong = (SWAPPED, STAGE, DIRECTION, TRAVEL)
    return not any(check.name in wrong and check.level is not None for check in checks)


def placed(checks: Sequence[Check], *files: str | None) -> list[Check]:
    """Give failed steps the file and line that their message names, where it is one of `files`."""
    found = []
    for check in checks:
        named = re.search(r"(\S+):(\d+): ", check.message)
        file = next((f for f in files if f and named and Path(f).name == Path(named[1]).name), None)
        found.append(replace(check, file=file, line=int(named[2])) if file and named else check)
    return found


def weighed(checks: Sequence[Check]) -> list[Check]:
    """Weigh the checks of a file against each other.

    A wrong sign is the cause of all that it turns round. A force that is that of the named
    material has the right unit: then the cell can do more than its name says, which is a note.
    """
    sign = next((check for check in checks if check.name == SIGN and check.level is not None), None)
    is_right = any(check.name == RATIO and abs(check.log_ratio) < _RIGHT for check in checks)
    found = []
    for check in checks:
        if sign is not None and check.level and check.name in (FALL, LATE, PHASE):
            found.append(replace(check, cause=sign.cause, line=sign.line))
        elif is_right and check.level and check.name == CAPACITY:
            found.append(replace(check, level="note", cause="the name of the cell does not say its capacity"))
        else:
            found.append(check)
    return found


def _moved(part: Part, values: Floats) -> float:
    """Return by how much a column moves as the command of a block means it; NaN without one."""
    if part.function == _SINUSOID:
        low, high = np.nanquantile(values, [0.005, 0.995])
        return 0.5 * float(high - low)
    first = part.segment == part.segment[0]
    inside = values[first]
    return float(np.nanmedian(inside[inside.size // 2 :]) - inside[0])


def _order(name: str, blocks: Sequence[Part]) -> Check:
    law = "the stage, not the force, makes the declared motion, and rests in a hold"
    votes: list[bool] = []
    where: Part | None = None
    for part in blocks:
        wanted = abs(part.declared("Amplitude")[0])
        if part.function not in (_SINUSOID, RELAXATION) or not wanted > 0.0:
            continue
        # the file's own numbers: mm of the position, whatever of the force
        own = abs(_moved(part, part.position)) / wanted
        rigid = abs(_moved(part, part.force)) * 1e-3 / wanted
        is_swapped = abs(rigid - 1.0) < _SWAPPED_BY and not abs(own - 1.0) < _SWAPPED_BY
        if is_swapped:
            where = where or part
        votes.append(is_swapped)
    if not votes:
        return not_made(SWAPPED, law, "a declared amplitude")
    if where is None or sum(votes) * 2 <= len(votes):
        return stated(SWAPPED, law, f"{name}: the position makes the declared motion", None, file=name)
    shown = quantity(where.declared("Amplitude")[0], "m")
    text = (
        f"{name}: the column of the force moves by the declared {shown} (as mm), the column of the position by "
        f"{quantity(abs(_moved(where, where.position)), 'm')}"
    )
    return stated(
        SWAPPED,
        law,
        text,
        "impossible",
        cause=f"the columns of position and force are swapped (header of the columns, line {where.header_line})",
        file=name,
        line=where.header_line,
    )


def _frequency(part: Part) -> tuple[float, float]:
    """Return the frequency of a motion by counting its turns, and its uncertainty [Hz]."""
    x = part.position
    low, high = np.nanquantile(x, [0.01, 0.99])
    middle, band = 0.5 * (low + high), 0.15 * (high - low)
    side = np.where(x > middle + band, 1, np.where(x < middle - band, -1, 0))
    known = np.flatnonzero(side)
    turns = known[1:][np.diff(side[known]) != 0]
    if band <= 0.0 or turns.size < 3:
        return nan, nan
    # one way through the middle only, so that an offset of the level does not count
    rising = turns[side[turns] == side[turns[0]]]
    if rising.size < 2:
        return nan, nan
    lasted = float(part.time[rising[-1]] - part.time[rising[0]])
    interval = float(np.median(np.diff(part.time)))
    value = (rising.size - 1) / lasted
    return value, value * interval / lasted


def _speed(part: Part) -> tuple[float, float, float]:
    """Return travel, speed and duration of the rest of a ramp or an approach [m, m/s, s]."""
    first = part.segment == part.segment[0]
    time, x = part.time[first], part.position[first]
    travel = float(np.nanmedian(x[x.size // 2 :]) - x[0]) if part.function == RELAXATION else float(x[-1] - x[0])
    if part.function == _APPROACH and x.size:
        far = int(np.nanargmax(np.abs(x - x[0])))
        travel = float(x[far] - x[0])
    if travel == 0.0 or x.size < 4:
        return travel, nan, nan
    share = (x - x[0]) / travel
    arrived = int(np.argmax(share > 0.99))
    inside = (share > 0.1) & (share < 0.9) & (np.arange(x.size) <= arrived)
    # the readings on either side of the middle make a rate of two of them too
    speed = float(np.polyfit(time[inside], x[inside], 1)[0]) if inside.sum() >= 3 else nan
    return travel, speed, float(time[-1] - time[arrived])


def _commands(name: str, blocks: Sequence[Part]) -> Iterator[Check]:
    """Hold amplitude, frequency, travel, speed and rest against the declared; the worst of each."""
    found: dict[str, list[tuple[Check, Part]]] = {}

    def hold(title: str, key: str, part: Part, seen: float, u: float, unit: str) -> None:
        wanted, rounding, line = part.declared(key)
        if not (isfinite(seen) and isfinite(wanted)) or wanted == 0.0:
            return
        ratio = seen / wanted
        text = (
            f"{name}, block {part.number + 1}: {title} is {quantity(seen, unit)}, declared are "
            f"{quantity(wanted, unit)} ({ratio:.3g} times)"
        )
        allowance = _STAGE[title] * wanted + (_LATE if title == HOLD else 0.0)
        law = "the stage does what the header declares"
        small = max(u, 2e-3 * wanted)
        check = compared(title, law, text, seen, small, wanted, rounding, allowance=allowance, file=name, line=line)
        found.setdefault(title, []).append((check, part))

    for part in blocks:
        if part.function == _SINUSOID:
            hold(AMPLITUDE, "Amplitude", part, _moved(part, part.position), 1e-8, "m")
            hold(FREQUENCY, "Frequency", part, *_frequency(part), "Hz")
        if part.function in (RELAXATION, _APPROACH):
            travel, speed, rest = _speed(part)
            is_ramp = part.function == RELAXATION
            if is_ramp:
                hold(TRAVEL, "Amplitude", part, abs(travel), 1e-7, "m")
                if part.text("Stop based on").startswith("Fixed"):
                    hold(HOLD, "Fixed Relaxation Time, s".partition(",")[0], part, rest, 0.05, "s")
            key = "Velocity" if is_ramp else "Stage Velocity"
            hold(SPEED if is_ramp else APPROACH, key, part, abs(speed), 0.02 * abs(speed), "m/s")
    for rows in found.values():
        yield max((check for check, _ in rows), key=lambda c: abs(c.margin) if c.level else -1.0)


def _clock(name: str, blocks: Sequence[Part]) -> Check:
    law = "a block ends before the next one begins, by the clock of the tester"
    worst, text, ratio = -np.inf, "", nan
    line = None
    for part, after in pairwise(blocks):
        began, next_began = (str(p.header.get("start") or "") for p in (part, after))
        if not (began and next_began):
            continue
        gap = (datetime.fromisoformat(next_began) - datetime.fromisoformat(began)).total_seconds()
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
        return not_made(CLOCK, law, "two blocks with start times")
    check = bounded(CLOCK, law, text, worst, 1.0, at_most=0.0, file=name, line=line)
    if check.level is None or not ratio > 0:
        return check
    return replace(check, log_ratio=log(ratio), u_log_ratio=_U_CLOCK)


def _stage(name: str, blocks: Sequence[Part]) -> Check:
    law = "a stage moves within its range"
    largest = max(float(np.nanmax(np.abs(p.position))) for p in blocks)
    text = f"{name}: the stage stands as far as {quantity(largest, 'm')}"
    level: Level | None = "impossible" if largest > 3 * _LARGEST_STAGE else None
    if level is None and largest > _LARGEST_STAGE:
        level = "doubtful"
    cause = f"the column of the position is not in the unit it says (line {blocks[0].header_line})" if level else ""
    return stated(STAGE, law, text, level, cause=cause, file=name, line=blocks[0].header_line)


def _direction(name: str, blocks: Sequence[Part]) -> Check:
    title, law = DIRECTION, "the stage moves in the direction that the header declares"
    for part in blocks:
        travel = _speed(part)[0] if part.function in (RELAXATION, _APPROACH) else 0.0
        wanted = 1.0 if part.text("Direction").startswith("Pos") else -1.0 if part.text("Direction") else nan
        if part.function == RELAXATION:
            wanted = part.declared("Amplitude")[0]
        if abs(travel) < 1e-6 or not isfinite(wanted):
            continue
        is_back = travel * wanted < 0.0
        text = f"{name}, block {part.number + 1}: the stage moves by {quantity(travel, 'm')}"
        text += ", against the declared direction" if is_back else ", as declared"
        cause = f"the sign of the column of the position is wrong (line {part.header_line})" if is_back else ""
        level: Level | None = "impossible" if is_back else None
        return stated(title, law, text, level, cause=cause, file=name, line=part.header_line)
    return not_made(title, law, "a ramp or an approach with a declared direction")


def _response(part: Part) -> tuple[float, float, float]:
    """Return stiffness [N/m] of a block, its uncertainty, and the share of force explained."""
    used = np.isfinite(part.position) & np.isfinite(part.force)
    if part.function != _SINUSOID:
        used &= part.segment == part.segment[0]
    x, f, t = part.position[used], part.force[used], part.time[used]
    if x.size < 10 or np.ptp(x) == 0.0:
        return nan, nan, nan
    if part.function == RELAXATION:
        step = x - x[0]
        held = np.abs(step) > 0.9 * np.abs(step).max()
        arrived = int(np.argmax(held))
        soon = f[arrived : arrived + max(10, min(50, f.size // 10))]
        late = f[-max(f.size // 10, 10) :]
        noise = float((late - np.polyval(np.polyfit(np.arange(late.size), late, 1), np.arange(late.size))).std())
        before = f[:1]
        rise = float(soon[np.argmax(np.abs(soon - before[0]))] - before[0])
        travel = float(step[arrived])
        share = 1.0 if abs(rise) > 2 * _CLEAR * noise and rise != 0.0 else 0.0
        return rise / travel, 1.5 * noise / abs(travel), share
    rate = np.gradient(x, t)
    base = np.column_stack([np.ones_like(t), t - t.mean(), x - x.mean(), rate])
    scale = np.maximum(np.abs(base).max(axis=0), 1e-300)
    answer, *_ = np.linalg.lstsq(base / scale, f, rcond=None)
    drift = f - (base[:, :2] / scale[:2]) @ answer[:2]
    rest = drift - (base[:, 2:] / scale[2:]) @ answer[2:]
    variance = float(np.var(drift))
    share = 1.0 - float(np.var(rest)) / variance if variance > 0.0 else 0.0
    u = float(rest.std()) / (float(x.std()) * np.sqrt(x.size / 10))
    return float(answer[2] / scale[2]), u, share


def _signs(name: str, blocks: Sequence[Part]) -> Iterator[Check]:
    title, law = SIGN, "a force grows with the depth"
    found = [(p, *_response(p)) for p in blocks if p.function in (_SINUSOID, RELAXATION)]
    known = [(p, k, u) for p, k, u, share in found if isfinite(k) and share > _EXPLAINED]
    if not known:
        yield not_made(title, law, "a motion in contact, and a force that follows it")
        return
    part, k, u = known[0]
    text = f"{name}, block {part.number + 1}: stiffness {quantity(k, 'N/m')}"
    check = bounded(title, law, text, k, max(u, 1e-3 * abs(k)), at_least=0.0, file=name, line=part.header_line)
    if check.level is not None and _direction(name, blocks).level is None:
        cause = (
            f"the sign of the column of the force is wrong (line {part.header_line}), or the load cell's type "
            f"(line {_info_line(part, 'Load Cell Type')}), which says the sign of compression"
        )
        check = replace(check, cause=cause)
    elif check.level is not None:
        check = replace(check, cause=_direction(name, blocks).cause)
    yield check


def _info_line(part: Part, key: str) -> int:
    lines = part.header["info_lines"]
    return part.line + 1 + next((i for i, text in enumerate(lines) if text.startswith(key)), 0)


def _living(name: str, blocks: Sequence[Part]) -> Check:
    title, law = "response of the cell", "a force follows the motion of the stage"
    found = [(p, _response(p)[2]) for p in blocks if p.function in (_SINUSOID, RELAXATION)]
    known = [(p, share) for p, share in found if isfinite(share)]
    if not known:
        return not_made(title, law, "a motion of the stage")
    share = max(s for _, s in known)
    part = known[0][0]
    if share > _EXPLAINED:
        return stated(title, law, f"{name}: the force follows the motion", None, file=name)
    spread = max(float(np.nanmax(p.force) - np.nanmin(p.force)) for p, _ in known)
    kind = "is constant" if spread == 0.0 else f"scatters over {quantity(spread, 'N')} and"
    text = f"{name}: the force {kind} {'while' if spread == 0.0 else 'does not follow, while'} the stage moves"
    cause = f"the load cell was dead or not connected, or another axis was recorded (line {part.header_line})"
    return stated(title, law, text, "impossible", cause=cause, file=name, line=part.header_line)


def _shaped(name: str, blocks: Sequence[Part]) -> Check:
    """Look for a stage that stands still at the ends of its oscillation."""
    law = "a stage that follows a sine turns at its ends, and does not stand there"
    found = []
    for part in (p for p in blocks if p.function == _SINUSOID):
        x = part.position[np.isfinite(part.position)]
        half = 0.5 * float(np.ptp(x)) if x.size else 0.0
        band = max(_EXTREME * half, 1.5 * float(quantisation_step(x)) if np.unique(x).size > 1 else 0.0)
        if band < 0.5 * half:
            share = max(float(np.mean(x > x.max() - band)), float(np.mean(x < x.min() + band)))
            found.append((share / (np.arccos(1 - band / half) / pi), share, part))
    if not found:
        return not_made(SHAPE, law, "an oscillation that the position resolves")
    ratio, share, part = max(found, key=lambda each: each[0])
    text = f"{name}, block {part.number + 1}: {share:.0%} of the readings lie at one end, {ratio:.2g} times a sine's"
    level: Level | None = "doubtful" if ratio > _AT_REST else None
    cause = (
        "the stage stopped before the end of its way: a limit of travel, force or speed, or another wave than the "
        f"sine that is declared (line {part.line})"
    )
    return stated(SHAPE, law, text, level, cause=cause if level else "", file=name, line=part.line)


def _saturated(name: str, blocks: Sequence[Part]) -> Check:
    title, law = "saturation of the cell", "the extremes of a force are smooth, not flat"
    for part in (p for p in blocks if p.function in (_SINUSOID, RELAXATION)):
        force = part.force[np.isfinite(part.force)]
        steps = np.abs(np.diff(force))
        step = float(np.min(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        if step == 0.0:
            continue
        for extreme in (float(force.max()), float(force.min())):
            at = np.abs(force - extreme) < 0.5 * step
            edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(int)))
            starts, ends = edges[::2], edges[1::2]
            longest = int(np.argmax(ends - starts))
            first, after = int(starts[longest]), int(ends[longest])
            n = after - first
            sides = [force[max(first - n, 0)], force[min(after + n - 1, force.size - 1)]]
            leaves = max(abs(s - extreme) for s in sides)
            wide = max(step, 1e-4 * float(np.ptp(force)))
            if n >= _RUN and leaves > _LEAVES * wide:
                text = (
                    f"{name}, block {part.number + 1}: the force stays at {quantity(extreme, 'N')} for {n} readings "
                    f"from {quantity(float(part.time[first]), 's')}, then changes by {quantity(leaves, 'N')}"
                )
                cause = "the cell or its amplifier was saturated: peaks and work are not measured; use a larger range"
                return stated(title, law, text, "impossible", cause=cause, file=name, line=part.header_line)
    return stated(title, law, f"{name}: no flat extremes", None, file=name)


def _capacity(name: str, blocks: Sequence[Part]) -> Check:
    law = "a cell shows no force far beyond its capacity"
    cell = str((blocks[0].header.get("load_cell") or {}).get("name") or "")
    said = re.search(r"(\d+(?:\.\d+)?)\s*(kg|g|kN|N)\b", cell)
    if said is None:
        return not_made(CAPACITY, law, "a load cell whose name says its capacity")
    capacity = float(said[1]) * {"kg": 9.80665, "g": 9.80665e-3, "N": 1.0, "kN": 1e3}[said[2]]
    largest = max(float(np.nanmax(np.abs(p.force))) for p in blocks)
    text = f"{name}: up to {quantity(largest, 'N')} with a cell of {quantity(capacity, 'N')} ({cell})"
    part = blocks[0]
    check = bounded(
        CAPACITY, law, text, largest, 0.1 * capacity, at_most=1.1 * capacity, file=name, line=part.header_line
    )
    if check.level is None:
        return check
    cause = f"the column of the force is in gf or mN, not in N (header of the columns, line {part.header_line})"
    return replace(check, cause=cause)


def _calibrated(name: str, blocks: Sequence[Part]) -> Check:
    law = "a cell is calibrated before it measures"
    part = blocks[0]
    lines = dict(text.partition(":")[::2] for text in part.header["info_lines"])
    told, began = lines.get("Load Cell Calibration Date", "").strip(), str(part.header.get("start") or "")
    if not (re.fullmatch(r"\d{4}-\d{2}-\d{2}", told) and began):
        return not_made(CALIBRATED, law, "dates of the test and of the cell's calibration")
    text = f"{name}: tested on {began[:10]} with a cell calibrated on {told}"
    level: Level | None = "doubtful" if told > began[:10] else None
    line = _info_line(part, "Load Cell Calibration Date")
    cause = f"the tester's clock, or the date of the calibration (line {line}), is wrong" if level else ""
    return stated(CALIBRATED, law, text, level, cause=cause, file=name, line=line)


def _axes(name: str, blocks: Sequence[Part]) -> Check:
    law = "what a command moves and listens to is what the columns hold"
    for part in blocks:
        for key, column in (("Stage Axis", "Position (z)"), ("Load Cell Axis", "Fz")):
            said = part.text(key)
            if said and not said.strip().lower().rstrip(")").endswith("z"):
                text = f"{name}, block {part.number + 1}: {key.lower()} {said}, read is the column {column}"
                cause = f"the command used another axis, or its header was edited (line {part.line})"
                return stated(AXES, law, text, "doubtful", cause=cause, file=name, line=part.line)
    return stated(AXES, law, f"{name}: commands and columns have one axis", None, file=name)


def _resolved(name: str, blocks: Sequence[Part]) -> Check:
    law = "a position resolves the motion that it measures"
    coarse = (0.0, blocks[0])
    for part in (p for p in blocks if p.function in (_SINUSOID, RELAXATION)):
        x = part.position[np.isfinite(part.position)]
        step = float(quantisation_step(x)) if np.unique(x).size > 1 else 0.0
        # a steady ramp goes in equal steps too, but not from a multiple of them
        if step > 0.0 and np.mean(np.abs(x / step - np.round(x / step)) < _ROUNDED) > _ALL:
            coarse = max(coarse, (step / float(np.ptp(x)), part), key=lambda each: each[0])
    step, part = coarse
    text = f"{name}, block {part.number + 1}: the steps of the position are {step:.1%} of the motion"
    level: Level | None = "doubtful" if step > _COARSE else None
    cause = "the file was written, or saved again by a spreadsheet, with too few decimals" if level else ""
    return stated(RESOLVED, law, text, level, cause=cause, file=name, line=part.header_line)


def of_cell(load_cell: LoadCell, loads: xr.Dataset) -> list[Check]:
    """Check the record of the load cell: its scale, and the delay of its filter."""
    law = "a tester shows forces, so that the record corrects them by little"
    gain, u = float(loads["gain"]), float(np.nan_to_num(float(loads["u_gain"])))
    record = load_cell.record or ""
    found: list[Check] = []
    if not record:
        found.append(not_made(SCALE, law, "a calibration record of the load cell"))
    else:
        off = abs(log(abs(gain))) if gain else np.inf
        level: Level | None = (
            "impossible" if off > log(_WRONG_FACTOR) else "doubtful" if off > log(_OWN_FACTOR) else None
        )
        text = f"{record}: true force is {gain:.4g} times the displayed one"
        cause = f"the scale of the load cell in {record} is wrong: about 1 is expected, not {gain:.4g}" if level else ""
        found.append(stated(SCALE, law, text, level, cause=cause, file=record, setting="values.scale"))
        del u
    law = "order and cutoff of a low-pass say its delay"
    declared = mach1_readings.declared_filter(loads)
    measured = json.loads(loads.attrs.get("filter_delay", "null"))
    if declared is None or measured is None:
        return [*found, not_made(DELAY, law, "a measured delay, and a declared filter")]
    value, u_value = measured
    expected = mach1_readings.filter_delay(loads.assign_attrs(filter_delay="null"))
    text = (
        f"{record}: the delay is {quantity(value, 's')}, a filter of order {int(declared['order'])} and "
        f"{declared['cutoff']:.3g} Hz has about {quantity(expected.value, 's')}"
    )
    check = compared(
        DELAY,
        law,
        text,
        value,
        u_value,
        expected.value,
        0.1 * expected.value,
        allowance=0.6 * expected.value,
        file=record,
        setting="values.filter_delay",
    )
    if check.level is not None:
        wrong = f"the delay of the filter in {record} is probably {quantity(expected.value, 's')}"
        check = replace(check, cause=f"{wrong}, not {quantity(value, 's')}")
    return [*found, check]


def of_punch(punch: Punch | None, substrate: Substrate | None, model: IndentationModel, deepest: float) -> list[Check]:
    """Check the geometry that the session states against itself and the largest depth [m]."""
    title, law = "size of the punch", "a punch fits under the tester"
    if punch is None:
        return [not_made(title, law, "a punch")]
    found = []
    for setting, size, what in (
        ("punch.depth", punch.depth.value, "length of a tip"),
        ("punch.radius", punch.radius.value, "radius of a tip"),
        ("punch.tips", punch.tips * punch.period.value, f"{punch.tips} tips {quantity(punch.period.value, 'm')} apart"),
    ):
        level: Level | None = "impossible" if size > _LARGEST_PUNCH else "doubtful" if size > _LARGE_PUNCH else None
        text = f"{what}: {quantity(size, 'm')}"
        if level is not None:
            cause = f"{setting} in session.toml is wrong: its unit, or its number"
            found.append(stated(title, law, text, level, cause=cause, setting=setting))
    if not found:
        found.append(stated(title, law, f"{punch.tips} tips of {quantity(punch.depth.value, 'm')} fit", None))
    found.append(_valleys(punch, model, deepest))
    found.append(_bottom(punch, substrate, deepest))
    return found


def _valleys(punch: Punch, model: IndentationModel, deepest: float) -> Check:
    title, law = "period of the punch", "tips touch one by one: their contacts are narrower than the period"
    if not deepest > 0.0 or model.profile == "cosine":
        return not_made(title, law, "a depth, and tips that are no waves")
    share = deepest / westergaard.full_contact(punch.radius.value, punch.period.value, "parabola")
    level: Level | None = "impossible" if share > 1.0 else "doubtful" if share > 0.5 else None
    width = 2 * (2 * punch.radius.value * deepest) ** 0.5
    text = (
        f"at a depth of {quantity(deepest, 'm')} a tip of {quantity(punch.radius.value, 'm')} meets the surface over "
        f"{quantity(width, 'm')}; the period is {quantity(punch.period.value, 'm')}"
    )
    cause = "punch.period in session.toml is too small for these tips, or punch.radius is too large" if level else ""
    return stated(title, law, text, level, cause=cause, setting="punch.period")


def _bottom(punch: Punch, substrate: Substrate | None, deepest: float) -> Check:
    title, law = "depth of the indentation", "a tip goes less deep than its radius and than the sheet is thick"
    if not deepest > 0.0:
        return not_made(title, law, "a position of first touch")
    limits = [(punch.radius.value, "the tip's radius", "punch.radius")]
    if substrate is not None and substrate.thickness is not None:
        limits.append((substrate.thickness.value, "the sheet's thickness", "substrate.thickness"))
    limit, what, setting = min(limits)
    level: Level | None = "impossible" if deepest > limit else "doubtful" if deepest > 0.5 * limit else None
    text = f"{quantity(deepest, 'm')} deep; {what} is {quantity(limit, 'm')}"
    cause = f"{setting} in session.toml, or the position of first touch, is wrong" if level else ""
    return stated(title, law, text, level, cause=cause, setting=setting)


def of_force(
    name: str, punch: Punch | None, substrate: Substrate | None, depth: float, force: float, expected: float
) -> list[Check]:
    """Hold a force [N] at a depth [m] against what any polymer, and the named one, would give.

    ``expected`` is the force of the model, NaN where there is none. Both are plausible ranges:
    what lies outside is doubtful, never impossible.
    """
    law = "line contact of a polymer of 1 MPa to 10 GPa"
    found: list[Check] = []
    layer = None if substrate is None else substrate.thickness
    is_thin = layer is not None and punch is not None and layer.value < 5 * (punch.radius.value * depth) ** 0.5
    closed = 0.0 if punch is None else westergaard.full_contact(punch.radius.value, punch.period.value, "parabola")
    if punch is None or not (0.0 < depth < closed and force > 0.0):
        found.append(not_made(MODULUS, law, "a punch, a depth that leaves valleys, and a force in compression"))
    else:
        radius, period, length = punch.radius.value, punch.period.value, punch.depth.value * punch.tips
        state = westergaard.from_displacement(np.array([depth]), radius, period, 1.0, "parabola")
        modulus = force / (float(np.atleast_1d(state.force)[0]) * length)
        text = f"{name}: {quantity(force, 'N')} at {quantity(depth, 'm')} take a reduced modulus of "
        text += quantity(modulus, "Pa")
        u = _U_LAYER if is_thin else _U_RANGE
        ends = [log(end) for end in _POLYMER]
        check = bounded(MODULUS, law, text, log(modulus), u, at_least=ends[0], at_most=ends[1], is_law=False, file=name)
        if check.level is not None:
            cause = "the unit of the column of the force, or punch.tips or punch.depth in session.toml, is wrong"
            check = replace(check, cause=cause)
        found.append(check)
    law = "the force is that of the named material, within a factor that its batches may differ by"
    if not (isfinite(expected) and expected > 0.0 and force > 0.0):
        found.append(not_made(RATIO, law, "a model"))
    else:
        ratio = log(force / expected)
        text = f"{name}: {quantity(force, 'N')} measured, {quantity(expected, 'N')} expected of the named material"
        check = bounded(RATIO, law, text, abs(ratio), _U_MATERIAL, at_most=0.0, is_law=False, file=name)
        found.append(replace(check, log_ratio=ratio, u_log_ratio=_U_MATERIAL))
    return found


def causes(
    name: str, readings: xr.Dataset, punch: Punch | None, load_cell: LoadCell, checks: Sequence[Check] = ()
) -> Iterator[Cause]:
    """Yield the mistakes with a file, a column or a setting that multiply what is seen.

    A factor that all oscillations share is more likely one of a column, one that a single block
    has is one of its header.
    """
    blocks = parts(readings)
    if not blocks:
        return
    names = blocks[0].header_line
    columns = [
        Cause(
            {FREQUENCY: -1.0, SPEED: -1.0, APPROACH: -1.0, HOLD: 1.0, CLOCK: 1.0},
            lambda k: f"the column of the time is {too_large(k)}{_unit_of(k, 'ms', 's')} (line {names})",
            _FACTORS,
            file=name,
            line=names,
        ),
        Cause(
            {AMPLITUDE: 1.0, TRAVEL: 1.0, SPEED: 1.0, APPROACH: 1.0, RATIO: -1.1},
            lambda k: f"the column of the position is {too_large(k)}{_unit_of(k, 'µm', 'mm')} (line {names})",
            _FACTORS,
            file=name,
            line=names,
        ),
    ]
    headers = [
        Cause(
            {check.name: -1.0},
            lambda k, check=check: (  # type: ignore[misc]
                f"the declared {_DECLARED[check.name]} is {too_large(k)} (line {check.line} of {name})"
            ),
            (10.0, 0.1, 2.0, 0.5, 1e3, 1e-3, 100.0, 0.01),
            file=name,
            line=check.line,
        )
        for check in checks
        if check.name in _DECLARED and check.level is not None
    ]
    yield from [*columns, *headers] if _shared(blocks) else [*headers, *columns]
    force = Cause(
        {RATIO: 1.0},
        lambda k: f"the column of the force is {too_large(k)}: {_force_unit(k)} (line {names})",
        tuple(_FORCE_UNITS),
        only_usual=True,
        file=name,
        line=names,
    )
    yield force
    # a record that hardly changes what the tester shows is not where a factor of ten comes from
    is_held = any(check.name == SCALE and check.is_made and check.level is None for check in checks)
    if load_cell.record and not is_held:
        yield Cause(
            {RATIO: 1.0},
            lambda k: f"the scale of the load cell in {load_cell.record} is {too_large(k)}",
            (10.0, 100.0),
            only_usual=True,
            file=load_cell.record,
            setting="values.scale",
        )
    yield Cause(
        {RATIO: 1.0},
        lambda k: f"no slip of a unit explains it: another material, {k:.3g} times as stiff, was pressed or is named",
        setting="substrate.material",
    )
    if punch is None:
        return
    for what, setting, value in (
        ("number of tips", "punch.tips", float(punch.tips)),
        ("length of a tip", "punch.depth", punch.depth.value),
    ):
        unit = "1" if setting == "punch.tips" else "m"
        yield Cause(
            {RATIO: -1.0},
            lambda k, what=what, value=value, unit=unit, setting=setting: (  # type: ignore[misc]
                f"the {what} is probably {quantity(value / k, unit)}, not {quantity(value, unit)} "
                f"({setting} in session.toml)"
            ),
            (10.0, 0.1) if setting == "punch.tips" else (1e3, 1e-3, 100.0, 10.0, 0.1),
            only_usual=True,
            setting=setting,
        )


_DECLARED = {
    AMPLITUDE: "amplitude",
    FREQUENCY: "frequency",
    TRAVEL: "amplitude",
    SPEED: "velocity",
    APPROACH: "stage velocity",
}


_FORCE_UNITS = {
    _GRAM_FORCE: "in gf under N",
    1e3: "in mN under N",
    1 / _GRAM_FORCE: "in N under gf",
    1e-3: "in kN under N",
    1e-3 * _GRAM_FORCE: "in kgf under N",
}


def _force_unit(factor: float) -> str:
    return _FORCE_UNITS[min(_FORCE_UNITS, key=lambda k: abs(log(k / factor)))]


def _unit_of(factor: float, small: str, unit: str) -> str:
    return f": in {small} under {unit}" if abs(factor / 1e3 - 1) < 0.1 else ""


def _shared(blocks: Sequence[Part]) -> bool:
    """Whether all of several oscillations differ from their commands by one factor."""
    rows = [
        (_moved(p, p.position) / p.declared("Amplitude")[0], _frequency(p)[0] / p.declared("Frequency")[0])
        for p in blocks
        if p.function == _SINUSOID
    ]
    if len(rows) < 2:
        return False
    spread = np.ptp(np.log(np.maximum(np.array(rows), 1e-12)), axis=0)
    return bool((spread < 0.2).all())


def falls(name: str, part: Part) -> Check:
    """Hold a force under a held depth against relaxation: it falls, or stays."""
    title, law = FALL, "under a held depth a force never grows"
    travel, _, rest = _speed(part)
    inside = part.segment == part.segment[0]
    time, force = part.time[inside], part.force[inside]
    end = float(time[-1])
    if not (isfinite(rest) and rest > 0.0) or travel * part.declared("Amplitude")[0] < 0.0:
        return not_made(title, law, "a hold after a ramp into the material")
    early = force[(time > end - 0.75 * rest) & (time <= end - 0.5 * rest)]
    late = force[time > end - 0.25 * rest]
    if min(early.size, late.size) < 5:
        return not_made(title, law, "a hold of some seconds")
    rise = float(late.mean() - early.mean())
    size = max(abs(float(late.mean())), float(np.ptp(force)))
    u = hypot(float(late.std()) / (late.size / 10 + 1) ** 0.5, 2e-3 * size)
    text = f"{name}, block {part.number + 1}: the force changes by {quantity(rise, 'N')} in the second half of its hold"
    check = bounded(title, law, text, rise, u, at_most=0.0, file=name, line=part.header_line)
    if check.level is None:
        return _swings(check, name, part, end - rest)
    cause = (
        "the sign of the force is wrong, the rows stand in reverse order, or the stage crept on: a "
        "force in a hold falls"
    )
    return replace(check, cause=cause)


def _swings(check: Check, name: str, part: Part, arrived: float) -> Check:
    """Hold the force in a hold against every earlier one: what swings also rises, though it falls on the whole."""
    settled = (part.segment == part.segment[0]) & (part.time >= arrived + 5 * _SETTLED)
    time, force = part.time[settled], part.force[settled]
    if force.size < 10 * _PARTS or not np.isfinite(force).all():
        return check
    means = np.array([piece.mean() for piece in np.array_split(force, _PARTS)])
    rises = means - np.minimum.accumulate(means)
    at, noise = int(np.argmax(rises)), float(np.median([piece.std() for piece in np.array_split(force, _PARTS)]))
    limit = max(_SWINGS * float(np.abs(means).max()), 8 * noise / (force.size / _PARTS) ** 0.5)
    if rises[at] < limit:
        return check
    began = int(np.argmin(means[: at + 1]))
    times = [quantity(float(np.array_split(time, _PARTS)[i].mean()), "s") for i in (began, at)]
    text = f"{name}, block {part.number + 1}: in its hold the force rises by {quantity(float(rises[at]), 'N')} from "
    text += f"{times[0]} to {times[1]}"
    cause = "the force swings with something else: the temperature of the room, a draught, a step, or a loop of control"
    return replace(check, message=text, level="doubtful", cause=cause)


def late(name: str, part: Part) -> Check:
    """Hold the force after a ramp against its rest: what still grows then comes too late."""
    title, law = LATE, "a force is largest when the stage arrives, but for the delay of the cell's filter"
    travel, _, rest = _speed(part)
    inside = part.segment == part.segment[0]
    time, force = part.time[inside], part.force[inside]
    if not rest > 4 * _SETTLED or travel * part.declared("Amplitude")[0] < 0.0:
        return not_made(title, law, "a hold after a ramp into the material")
    arrived = float(time[-1]) - rest + _SETTLED
    early = force[(time >= arrived) & (time < arrived + _SETTLED / 3)]
    after = force[time >= arrived]
    if early.size < 5 or not np.isfinite(after).all():
        return not_made(title, law, "readings within a third of a second after a ramp")
    means = np.convolve(after, np.full(early.size, 1.0 / early.size), "valid")
    rise, at = float(means.max() - early.mean()), float(time[time >= arrived][int(np.argmax(means))])
    later = means[means.size // 2 :]
    places = np.linspace(-1.0, 1.0, later.size)
    wander = later - np.polyval(np.polyfit(places, later, 1), places)
    # one of so many running means lies four standard deviations off
    u = hypot(2 * float(wander.std()), 2e-3 * float(np.ptp(force)))
    text = (
        f"{name}, block {part.number + 1}: the force grows by {quantity(rise, 'N')} more while the stage stands, until "
        f"{quantity(at, 's')}"
    )
    check = bounded(title, law, text, rise, u, at_most=0.0, is_law=False, file=name, line=part.header_line)
    cause = "the force is late: it was averaged or filtered for longer than its header says, or the stage crept on"
    return replace(check, cause=cause) if check.level else check


def hold_parts(readings: xr.Dataset) -> list[Part]:
    """Return the blocks with a ramp and a hold."""
    return [part for part in parts(readings) if part.function == RELAXATION]


def phase(name: str, lag: float, u: float, frequency: float, record: str | None) -> Check:
    """Hold a phase lag [rad] against 0 to pi/2."""
    title, law = PHASE, "a passive solid stores and dissipates: its loss angle lies between 0 and 90°"
    text = f"{name}: the force leads by {lag * 180 / pi:.2f}° at {frequency:.3g} Hz"
    check = bounded(title, law, text, lag, max(u, 1e-3), at_least=0.0, at_most=pi / 2, file=name)
    if check.level is None:
        return check
    cause = "the columns are swapped, a sign is wrong, or the delay of the cell's filter is not what "
    cause += f"{record} says" if record else "its header says"
    return replace(check, cause=cause)

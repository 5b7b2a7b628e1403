"""Checks of a Mach-1 file: its declared commands compared with its columns, and of the record of its load cell.

Commands, clock and columns are redundant: the amplitude of a command is that of the position,
its frequency and speed against position and time, the start of the next block against the length
of this one, and the force against the cell's capacity, its sign against the motion.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import hypot, isfinite, log, nan, pi
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.judging import Check, Level, bounded, compared, in_words, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.judgements import Title, because, day_known
from pipelines.experiments.shared.mach1_blocks import FIND_CONTACT, OSCILLATION, Part, between, parts
from pipelines.experiments.shared.punch_settings import LoadCell
from pipelines.experiments.shared.ramps_and_holds import RELAXATION
from pipelines.experiments.shared.record_checks import Trace, longest_run, shared_rows

AMPLITUDE, FREQUENCY = "amplitude of the oscillation", "frequency of the oscillation"
TRAVEL, SPEED, CLOCK = "travel of the ramp", "speed of the ramp", "clock of the blocks"
CAPACITY, SCALE, DELAY = "capacity of the cell", "scale of the cell", "delay of the filter"
RATIO, SIGN, PHASE, OUTLIERS = "force for the named material", "sign of the stiffness", "phase lag", "outliers"
DIRECTION, SWAPPED = "direction of the motion", "order of the columns"
ALIGNMENT = "lateral force"

TITLES = {
    "columns": Title(
        "Position and force stand in their columns, with the stage's direction and the cell's sign.",
        (SWAPPED, DIRECTION, SIGN),
    ),
    "commands": Title(
        "The motion has the amplitude, frequency, travel and speed of its command.",
        (AMPLITUDE, FREQUENCY, TRAVEL, SPEED),
    ),
    "clock": Title("Times of the readings and of the blocks are consistent.", (CLOCK,)),
    "load cell": Title(
        "The force stays within the cell's capacity and is scaled once.",
        (CAPACITY, SCALE, DELAY, "response of the cell", "saturation of the cell"),
    ),
    "order of motion and force": Title("Force follows motion: 0 < phase lag < 90°.", (PHASE,)),
    "alignment": Title("The punch presses straight down: lateral forces are small.", (ALIGNMENT,)),
    "punch": Title("The stated punch can be pressed in so far.", ("size of the punch", "period of the punch")),
    "contact modulus": Title(
        "Forces give one modulus, that of the material, at all depths.", (RATIO, "force at other depths")
    ),
    "continuity of the readings": Title(
        "A recording holds every reading once, without outliers.", (OUTLIERS, "readings of another record")
    ),
}

COMMANDS = {
    AMPLITUDE: (OSCILLATION, "Amplitude", "m", 0.3),
    FREQUENCY: (OSCILLATION, "Frequency", "Hz", 0.05),
    TRAVEL: (RELAXATION, "Amplitude", "m", 0.05),
    SPEED: (RELAXATION, "Velocity", "m/s", 0.25),
}
"""Block and name of what is declared, its unit, and by how much, relative, a stage may miss it: eases, lags, brakes."""
FORCES = {"N": 1.0, "gf": 9.80665e-3, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665}
"""Units in which a force may be, whatever its header says, in SI."""
_CELLS = {"kg": "kgf", "g": "gf"}  # spellings of units in the names of load cells
_LATERAL = 0.1  # of the normal force: a tilt of 6 degrees, by which the normal force errs by 0.5 %
_SWAPPED_BY = 0.3  # relative, within which the other column holds the declared motion
_U_CLOCK = 2.0  # of the logarithm of a block's length over the time until the next: rests lie between
_RUN, _LEAVES = 5, 20.0
"""Readings in a row at an extreme, and steps of the cell by which a force changes in as many before
or after: behind a smooth peak that stays on one step for n readings it changes by 8 in n more."""
_SOONER, _LATER = 0.25, 0.6
"""Of the delay that order and cutoff of a Butterworth say, by which another filter may have less or more: three equal
poles have 0.76 times as much, Bessel's 0.88, Chebyshev's more."""
_OWN_FACTOR, _WRONG_FACTOR = 1.25, 3.0  # of true over displayed force: worth a doubt, and wrong
_RIGHT = 1.0  # of the logarithm of a force over the expected one: no unit is so near to another
_MANY = 0.01  # of the readings of a block, left out as outliers


def of_file(name: str, readings: xr.Dataset) -> list[Check]:
    """Check one file by itself; where its columns are exchanged nothing else is asked."""
    blocks = parts(readings)
    if not blocks:
        return [not_made(SWAPPED, "columns of position and force")]
    order = _order_of_columns(name, blocks)
    if order.level is not None:
        return [order]
    evaluations: tuple[Callable[[str, Sequence[Part]], Check], ...] = (
        _clock_of_blocks, _direction_of_motion, _sign_of_stiffness, _response_of_cell, _saturation, _capacity_of_cell,
        _left_out,
    )  # fmt: skip
    found = [order, *_commands_kept(name, blocks), *(evaluate(name, blocks) for evaluate in evaluations)]
    return [*found, _alignment(name, blocks)] if any(part.lateral for part in blocks) else found


def of_files(readings: Mapping[str, xr.Dataset]) -> Check:
    """Look for readings of the force that two files of an experiment share."""
    traces = []
    for name, found in ((name, parts(one)) for name, one in readings.items()):
        time, force = (np.concatenate([getattr(part, of) for part in found] or [[]]) for of in ("time", "force"))
        header = "\n".join(line for part in found for line in part.header["info_lines"])
        traces.append(Trace(name, time, force, header))
    return shared_rows(traces)


def knows_depth(checks: Sequence[Check]) -> bool:
    """Return whether the depth of a punch is known by the column of the position."""
    return not any(check.name in (SWAPPED, DIRECTION, TRAVEL) and check.level is not None for check in checks)


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
    if sign is not None:
        checks = because(checks, sign.cause, PHASE, line=sign.line)
    unsaid = "the name of the cell does not say its capacity" if is_right else ""
    return because(checks, unsaid, CAPACITY, level="note")


def _order_of_columns(name: str, blocks: Sequence[Part]) -> Check:
    wrong, known = [], 0
    for part in blocks:
        wanted = abs(part.declared("Amplitude")[0])
        if part.function in (OSCILLATION, RELAXATION) and wanted > 0.0:
            # the file's own numbers: mm of the position, whatever of the force
            own, other = (abs(part.moved(each)) / wanted for each in (part.position, 1e-3 * part.force))
            known += 1
            wrong += [part] * (abs(other - 1.0) < _SWAPPED_BY <= abs(own - 1.0))
    if not known:
        return not_made(SWAPPED, "a declared amplitude")
    if 2 * len(wrong) <= known:
        return stated(SWAPPED, f"{name}: the position makes the declared motion", None, file=name)
    where = wrong[0]
    text = (
        f"{name}: the column of the force moves by the declared {quantity(where.declared('Amplitude')[0], 'm')} (as "
        f"mm), the column of the position by {quantity(abs(where.moved(where.position)), 'm')}"
    )
    cause = f"the columns of position and force are swapped (header of the columns, line {where.header_line})"
    return stated(SWAPPED, text, "impossible", cause=cause, file=name, line=where.header_line)


def _commands_kept(name: str, blocks: Sequence[Part]) -> list[Check]:
    """Compare amplitude, frequency, travel and speed with the declared ones; the worst of each.

    One that several blocks miss has no line: then their headers are not the fault.
    """
    found: dict[str, list[Check]] = {}
    for part in blocks:
        for title, (function, key, unit, missed) in COMMANDS.items():
            wanted, rounding, line = part.declared(key)
            if part.function != function or not isfinite(wanted) or wanted == 0.0:
                continue
            if title == FREQUENCY:
                value, u = part.frequency
            else:
                value = part.speed if title == SPEED else abs(part.moved(part.position))
                u = 0.02 * value if title == SPEED else 1e-7
            if isfinite(value):
                ratio = in_words(value / wanted)
                text = f"{name}, block {part.number + 1}: {title} is {quantity(value, unit)}, declared are "
                text += f"{quantity(wanted, unit)}{'' if ratio == '1' else f' ({ratio} times)'}"
                u, allowance = max(u, 2e-3 * min(value, wanted)), missed * wanted
                check = compared(title, text, value, u, wanted, rounding, allowance=allowance, file=name, line=line)
                found.setdefault(title, []).append(check)
    worst = [max(rows, key=lambda c: abs(c.margin) if c.level else -1.0) for rows in found.values()]
    several = {rows[0].name for rows in found.values() if sum(c.level is not None for c in rows) > 1}
    return [replace(check, line=None) if check.name in several else check for check in worst]


def _clock_of_blocks(name: str, blocks: Sequence[Part]) -> Check:
    gaps = [(part, between(part, after)) for part, after in pairwise(blocks)]
    known = [(part, float(part.time[-1] - part.time[0]), gap) for part, gap in gaps if isfinite(gap)]
    if not known:
        return not_made(CLOCK, "two blocks with start times")
    beyond = [(lasts - gap) / hypot(0.1, 5e-3 * gap) for _, lasts, gap in known]
    worst = int(np.argmax(beyond))
    part, lasts, gap = known[worst]
    text = (
        f"{name}, block {part.number + 1}: its column of time spans {quantity(lasts, 's')}, the next block begins "
        f"after {quantity(gap, 's')}"
    )
    check = bounded(CLOCK, text, beyond[worst], 1.0, at_most=0.0, file=name, line=part.header_line)
    if check.level is None or not gap > 0.0:
        return check
    return replace(check, log_ratio=log(lasts / gap), u_log_ratio=_U_CLOCK)


def _direction_of_motion(name: str, blocks: Sequence[Part]) -> Check:
    for part in blocks:
        travel = part.moved(part.position) if part.function in (RELAXATION, FIND_CONTACT) else 0.0
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
        return stated(DIRECTION, text, level, cause=cause, file=name, line=part.header_line)
    return not_made(DIRECTION, "a ramp or an approach with a declared direction")


def _sign_of_stiffness(name: str, blocks: Sequence[Part]) -> Check:
    found = ((part, *part.stiffness) for part in blocks if part.function in (OSCILLATION, RELAXATION))
    part, k, u = next(((part, k, u) for part, k, u, follows in found if follows), (blocks[0], nan, nan))
    if not isfinite(k):
        return not_made(SIGN, "a motion in contact, and a force that follows it")
    text = f"{name}, block {part.number + 1}: stiffness {quantity(k, 'N/m')}"
    cause = _direction_of_motion(name, blocks).cause or (
        f"the sign of the column of the force is wrong (line {part.header_line}), or the load cell's type "
        f"(line {part.header_place('Load Cell Type')}), which says the sign of compression"
    )
    return bounded(SIGN, text, k, max(u, 1e-3 * abs(k)), at_least=0.0, cause=cause, file=name, line=part.header_line)


def _response_of_cell(name: str, blocks: Sequence[Part]) -> Check:
    title = "response of the cell"
    known = [part for part in blocks if part.function in (OSCILLATION, RELAXATION) and isfinite(part.stiffness[0])]
    if not known:
        return not_made(title, "a motion of the stage")
    if any(part.stiffness[2] for part in known):
        return stated(title, f"{name}: the force follows the motion", None, file=name)
    spread = max(float(np.nanmax(part.force) - np.nanmin(part.force)) for part in known)
    does = f"scatters over {quantity(spread, 'N')} and does not follow, while" if spread else "is constant while"
    cause = f"the load cell was dead or not connected, or another axis was recorded (line {known[0].header_line})"
    text = f"{name}: the force {does} the stage moves"
    return stated(title, text, "impossible", cause=cause, file=name, line=known[0].header_line)


def _alignment(name: str, blocks: Sequence[Part]) -> Check:
    """Compare the lateral force of a six-axis cell with the normal force: the slopes of Fx and Fy over Fz."""
    worst, u, where = nan, nan, blocks[0]
    for part in (p for p in blocks if p.function in (OSCILLATION, RELAXATION) and p.stiffness[2]):
        slopes, variance = [], 0.0
        for side in part.lateral:
            known = np.isfinite(side) & np.isfinite(part.force)
            slope, offset = np.polyfit(part.force[known], side[known], 1)
            left = side[known] - slope * part.force[known] - offset
            slopes.append(slope)
            variance += float(np.var(left) / (np.var(part.force[known]) * known.sum()))
        if slopes and not hypot(*slopes) <= worst:
            worst, u, where = hypot(*slopes), variance**0.5, part
    if not isfinite(worst):
        return not_made(ALIGNMENT, "a force that follows the motion")
    text = f"{name}, block {where.number + 1}: the lateral force changes by {worst:.2g} of the normal force, at most "
    text += f"{_LATERAL:g} is expected of an aligned punch"
    cause = "the punch or the specimen is tilted, or the punch slides: level the specimen and centre the punch"
    return bounded(
        ALIGNMENT, text, worst, max(u, 1e-3), at_most=_LATERAL, is_law=False, cause=cause, file=name,
        line=where.header_line,
    )  # fmt: skip


def _saturation(name: str, blocks: Sequence[Part]) -> Check:
    title = "saturation of the cell"
    for part in (p for p in blocks if p.function in (OSCILLATION, RELAXATION)):
        force = part.force[np.isfinite(part.force)]
        steps = np.abs(np.diff(force))
        step = float(np.min(steps[steps > 0.0], initial=np.inf))
        for extreme in (float(force.max()), float(force.min())) if np.isfinite(step) else ():
            n, first = longest_run(np.abs(force - extreme) < 0.5 * step)
            sides = [force[max(first - n, 0)], force[min(first + 2 * n - 1, force.size - 1)]]
            leaves = max(abs(s - extreme) for s in sides)
            if n >= _RUN and leaves > _LEAVES * max(step, 1e-4 * float(np.ptp(force))):
                text = (
                    f"{name}, block {part.number + 1}: the force stays at {quantity(extreme, 'N')} for {n} readings "
                    f"from {quantity(float(part.time[first]), 's')}, then changes by {quantity(leaves, 'N')}"
                )
                cause = "the cell or its amplifier was saturated: peaks and work are not measured; use a larger range"
                return stated(title, text, "impossible", cause=cause, file=name, line=part.header_line)
    return stated(title, f"{name}: no flat extremes", None, file=name)


def _capacity_of_cell(name: str, blocks: Sequence[Part]) -> Check:
    """Compare the largest force with the capacity in the name of the cell, such as "25kg SN:1886652"."""
    cell, line = str((blocks[0].header.get("load_cell") or {}).get("name") or ""), blocks[0].header_line
    said = re.search(r"(\d+(?:\.\d+)?)\s*(kg|g|kN|N)\b", cell)
    if said is None:
        return not_made(CAPACITY, "a load cell whose name says its capacity")
    capacity = float(said[1]) * FORCES[_CELLS.get(said[2], said[2])]
    largest = max(float(np.nanmax(np.abs(part.force))) for part in blocks)
    text = f"{name}: up to {quantity(largest, 'N')} with a cell of {quantity(capacity, 'N')} ({cell})"
    cause = f"the column of the force is in gf or mN, not in N (header of the columns, line {line})"
    return bounded(CAPACITY, text, largest, 0.1 * capacity, at_most=1.1 * capacity, cause=cause, file=name, line=line)


def of_cell(load_cell: LoadCell, loads: xr.Dataset) -> list[Check]:
    """Check the record of the load cell: its scale, and the delay of its filter."""
    gain, record = float(loads["gain"]), load_cell.record or ""
    found = [day_known(loads, record)]
    if not record:
        found.append(not_made(SCALE, "a calibration record of the load cell"))
    else:
        off = abs(log(abs(gain))) if gain else np.inf
        level: Level | None = (
            "impossible" if off > log(_WRONG_FACTOR) else "doubtful" if off > log(_OWN_FACTOR) else None
        )
        text = f"{record}: true force is {gain:.4g} times the displayed one"
        cause = f"the scale of the load cell in {record} is wrong: about 1 is expected, not {gain:.4g}"
        found.append(stated(SCALE, text, level, cause=cause, file=record, setting="values.scale"))
    declared = mach1_readings.declared_filter(loads)
    measured = json.loads(loads.attrs.get("filter_delay", "null"))
    if declared is None or measured is None:
        return [*found, not_made(DELAY, "a measured delay, and a declared filter")]
    value, u = measured
    expected = mach1_readings.filter_delay(loads.assign_attrs(filter_delay="null")).value
    text = (
        f"{record}: the delay is {quantity(value, 's')}, a filter of order {int(declared['order'])} and "
        f"{declared['cutoff']:.3g} Hz has about {quantity(expected, 's')}"
    )
    cause = f"the delay of the filter in {record} is probably {quantity(expected, 's')}, not {quantity(value, 's')}"
    allowance, place = (_LATER if value > expected else _SOONER) * expected, "values.filter_delay"
    check = compared(
        DELAY, text, value, u, expected, 0.1 * expected, allowance=allowance, file=record, setting=place, cause=cause
    )
    return [*found, check]


def _left_out(name: str, blocks: Sequence[Part]) -> Check:
    """Name the readings that were left out as outliers, those of the block with the largest deviation."""
    known = [(part, run) for part in blocks for run in part.outliers if run["column"] in ("position_z", "force_z")]
    if not known:
        return stated(OUTLIERS, f"{name}: no outliers", None, file=name)
    part, largest = max(known, key=lambda one: float(one[1]["by"]))
    column, first, last = str(largest["column"]).removesuffix("_z"), int(largest["first"]), int(largest["last"])
    count = sum(run["last"] - run["first"] + 1 for run in part.outliers)
    line, end = part.row_line(first), part.row_line(last)
    by = quantity(float(largest["by"]), "m" if column == "position" else "N")
    where = f"line {line}" if line == end else f"lines {line}-{end}"
    text = (
        f"{name}, block {part.number + 1}: {count} {'reading' if count == 1 else 'readings'} left out as outliers, the "
        f"largest deviation {by} of the {column} in {where}, at {quantity(float(part.time[first]), 's')}"
    )
    level: Level = "doubtful" if count > _MANY * part.force.size else "note"
    cause = f"a disturbance, or a value that was edited, in line {line}"
    return stated(OUTLIERS, text, level, cause=cause, file=name, line=line)


def phase(name: str, lag: float, u: float, frequency: float, record: str | None) -> Check:
    """Compare a phase lag [rad] with 0 to pi/2."""
    text = f"{name}: the force {'lags' if lag < 0.0 else 'leads'} by {abs(lag) * 180 / pi:.2f}° at {frequency:.3g} Hz"
    cause = "the columns are swapped, a sign is wrong, or the delay of the cell's filter is not what "
    cause += f"{record or 'its header'} says{', or the stage has play (backlash)' if lag < 0.0 else ''}"
    return bounded(PHASE, text, lag, max(u, 1e-3), at_least=0.0, at_most=pi / 2, file=name, cause=cause)

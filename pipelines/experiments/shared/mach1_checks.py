"""Checks of a Mach-1 file: its declared commands compared with its columns.

Commands, clock and columns are redundant: the amplitude of a command is that of the position,
its frequency and speed against position and time, the start of the next block against the length
of this one, and the force against the cell's capacity, its sign against the motion. A factor in a
column moves them by different powers, which identifies the mistake.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import hypot, isfinite, log, nan, pi
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.contact.line import westergaard
from labpipe.judging import Cause, Check, Level, bounded, compared, in_words, not_made, stated, too_large
from labpipe.report import quantity
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.judgements import Title, because, day_known
from pipelines.experiments.shared.mach1_blocks import (
    FIND_CONTACT,
    OSCILLATION,
    Part,
    between,
    counted_frequency,
    moved_by,
    parts,
    response_of,
    travel_and_speed,
)
from pipelines.experiments.shared.punch_settings import IndentationModel, LoadCell, Punch
from pipelines.experiments.shared.ramps_and_holds import RELAXATION
from pipelines.experiments.shared.record_checks import Trace, longest_run, shared_rows

AMPLITUDE, FREQUENCY = "amplitude of the oscillation", "frequency of the oscillation"
TRAVEL, SPEED = "travel of the ramp", "speed of the ramp"
APPROACH = "speed of the approach"
CLOCK, CAPACITY = "clock of the blocks", "capacity of the cell"
RATIO, SCALE = "force for the named material", "scale of the cell"
SIGN, PHASE, OUTLIERS = "sign of the stiffness", "phase lag", "outliers"
DIRECTION, DELAY, SWAPPED = "direction of the motion", "delay of the filter", "order of the columns"

TITLES = {
    "columns": Title(
        "Position and force stand in their columns, with the stage's direction and the cell's sign.",
        (SWAPPED, "columns of the file", DIRECTION, SIGN),
    ),
    "commands": Title(
        "The motion has the amplitude, frequency, travel and speed of its command.",
        (AMPLITUDE, FREQUENCY, TRAVEL, SPEED, APPROACH),
    ),
    "clock": Title("Times of the readings and of the blocks are consistent.", (CLOCK,)),
    "load cell": Title(
        "The force stays within the cell's capacity and is scaled once.",
        (CAPACITY, SCALE, DELAY, "response of the cell", "saturation of the cell"),
    ),
    "order of motion and force": Title("Force follows motion: 0 < phase lag < 90°.", (PHASE,)),
    "punch": Title("The stated punch can be pressed in so far.", ("size of the punch", "period of the punch")),
    "contact modulus": Title(
        "Forces give one modulus, that of the material, at all depths.",
        (RATIO, "force at other depths", "relaxation at other depths"),
    ),
    "continuity of the readings": Title(
        "A recording holds every reading once, without outliers.", (OUTLIERS, "readings of another record")
    ),
}

_STAGE = {AMPLITUDE: 0.3, FREQUENCY: 0.05, TRAVEL: 0.05, SPEED: 0.25, APPROACH: 0.25}
"""By how much, relative, a stage may miss its command: eases, lags, brakes."""
_SWAPPED_BY = 0.3  # relative, within which the other column holds the declared motion
_U_CLOCK = 2.0  # of the logarithm of a block's length over the time until the next: rests lie between
_RUN, _LEAVES = 5, 20.0
"""Readings in a row at an extreme, and steps of the cell by which a force changes in as many before
or after: behind a smooth peak that stays on one step for n readings it changes by 8 in n more."""
_EXPLAINED = 0.2  # share of a force that its motion must explain, if the cell lives
_SOONER, _LATER = 0.25, 0.6
"""Of the delay that order and cutoff of a Butterworth say, by which another filter may have less or more: three equal
poles have 0.76 times as much, Bessel's 0.88, Chebyshev's more."""
_OWN_FACTOR, _WRONG_FACTOR = 1.25, 3.0  # of true over displayed force: worth a doubt, and wrong
_LARGEST_PUNCH, _LARGE_PUNCH = 0.5, 0.15  # m, either way
_U_MATERIAL = 0.5  # of the logarithm of the force for a solid that is known by its name
_RIGHT = 1.0  # of that logarithm: no unit is so near to another
_FACTORS = (1e3, 1e-3, 1e6, 1e-6, 10.0, 0.1, 100.0, 0.01, 2.0, 0.5, 60.0, 1 / 60.0)
_GRAVITY = 9.80665
_MANY = 0.01  # of the readings of a block, left out as outliers


def of_file(name: str, readings: xr.Dataset) -> list[Check]:
    """Check one file by itself; where its columns are exchanged nothing else is asked."""
    blocks = parts(readings)
    if not blocks:
        return [not_made(SWAPPED, "columns of position and force")]
    order = _order_of_columns(name, blocks)
    if order.level is not None:
        return [order]
    return [
        order,
        *_commands_kept(name, blocks),
        _clock_of_blocks(name, blocks),
        _direction_of_motion(name, blocks),
        _sign_of_stiffness(name, blocks),
        _response_of_cell(name, blocks),
        _saturation(name, blocks),
        _capacity_of_cell(name, blocks),
        _left_out(name, blocks),
    ]


def of_files(readings: Mapping[str, xr.Dataset]) -> Check:
    """Look for readings of the force that two files of an experiment share."""
    traces = []
    for name, found in ((name, parts(one)) for name, one in readings.items()):
        time, force = (np.concatenate([getattr(part, of) for part in found] or [[]]) for of in ("time", "force"))
        header = "\n".join(line for part in found for line in part.header["info_lines"])
        traces.append(Trace(name, time, force, header))
    return shared_rows(traces)


def is_swapped(checks: Sequence[Check]) -> bool:
    """Return whether the columns of position and force are exchanged."""
    return any(check.name == SWAPPED and check.level is not None for check in checks)


def knows_depth(checks: Sequence[Check]) -> bool:
    """Return whether the depth of a punch is known by the column of the position."""
    wrong = (SWAPPED, DIRECTION, TRAVEL)
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
    if sign is not None:
        checks = because(checks, sign.cause, PHASE, line=sign.line)
    unsaid = "the name of the cell does not say its capacity" if is_right else ""
    return because(checks, unsaid, CAPACITY, level="note")


def _order_of_columns(name: str, blocks: Sequence[Part]) -> Check:
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
        return not_made(SWAPPED, "a declared amplitude")
    if where is None or sum(votes) * 2 <= len(votes):
        return stated(SWAPPED, f"{name}: the position makes the declared motion", None, file=name)
    shown = quantity(where.declared("Amplitude")[0], "m")
    text = (
        f"{name}: the column of the force moves by the declared {shown} (as mm), the column of the position by "
        f"{quantity(abs(moved_by(where, where.position)), 'm')}"
    )
    cause = f"the columns of position and force are swapped (header of the columns, line {where.header_line})"
    return stated(SWAPPED, text, "impossible", cause=cause, file=name, line=where.header_line)


def _commands_kept(name: str, blocks: Sequence[Part]) -> list[Check]:
    """Compare amplitude, frequency, travel and speed with the declared ones; the worst of each."""
    found: dict[str, list[Check]] = {}
    for part in blocks:
        seen: list[tuple[str, str, float, float, str]] = []
        if part.function == OSCILLATION:
            seen.append((AMPLITUDE, "Amplitude", moved_by(part, part.position), 1e-8, "m"))
            seen.append((FREQUENCY, "Frequency", *counted_frequency(part), "Hz"))
        if part.function in (RELAXATION, FIND_CONTACT):
            travel, speed, _ = travel_and_speed(part)
            if part.function == RELAXATION:
                seen.append((TRAVEL, "Amplitude", abs(travel), 1e-7, "m"))
            of = (SPEED, "Velocity") if part.function == RELAXATION else (APPROACH, "Stage Velocity")
            seen.append((*of, abs(speed), 0.02 * abs(speed), "m/s"))
        for title, key, value, u, unit in seen:
            wanted, rounding, line = part.declared(key)
            if not (isfinite(value) and isfinite(wanted)) or wanted == 0.0:
                continue
            ratio = in_words(value / wanted)
            text = f"{name}, block {part.number + 1}: {title} is {quantity(value, unit)}, declared are "
            text += f"{quantity(wanted, unit)}{'' if ratio == '1' else f' ({ratio} times)'}"
            least, missed = max(u, 2e-3 * min(value, wanted)), _STAGE[title] * wanted
            check = compared(title, text, value, least, wanted, rounding, allowance=missed, file=name, line=line)
            found.setdefault(title, []).append(check)
    return [max(rows, key=lambda c: abs(c.margin) if c.level else -1.0) for rows in found.values()]


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
        return stated(DIRECTION, text, level, cause=cause, file=name, line=part.header_line)
    return not_made(DIRECTION, "a ramp or an approach with a declared direction")


def _sign_of_stiffness(name: str, blocks: Sequence[Part]) -> Check:
    found = [(p, *response_of(p)) for p in blocks if p.function in (OSCILLATION, RELAXATION)]
    known = [(p, k, u) for p, k, u, share in found if isfinite(k) and share > _EXPLAINED]
    if not known:
        return not_made(SIGN, "a motion in contact, and a force that follows it")
    part, k, u = known[0]
    text = f"{name}, block {part.number + 1}: stiffness {quantity(k, 'N/m')}"
    direction = _direction_of_motion(name, blocks)
    cause = direction.cause or (
        f"the sign of the column of the force is wrong (line {part.header_line}), or the load cell's type "
        f"(line {part.header_place('Load Cell Type')}), which says the sign of compression"
    )
    u = max(u, 1e-3 * abs(k))
    return bounded(SIGN, text, k, u, at_least=0.0, cause=cause, file=name, line=part.header_line)


def _response_of_cell(name: str, blocks: Sequence[Part]) -> Check:
    title = "response of the cell"
    found = [(p, response_of(p)[2]) for p in blocks if p.function in (OSCILLATION, RELAXATION)]
    known = [(p, share) for p, share in found if isfinite(share)]
    if not known:
        return not_made(title, "a motion of the stage")
    share = max(s for _, s in known)
    part = known[0][0]
    if share > _EXPLAINED:
        return stated(title, f"{name}: the force follows the motion", None, file=name)
    spread = max(float(np.nanmax(p.force) - np.nanmin(p.force)) for p, _ in known)
    kind = "is constant" if spread == 0.0 else f"scatters over {quantity(spread, 'N')} and"
    text = f"{name}: the force {kind} {'while' if spread == 0.0 else 'does not follow, while'} the stage moves"
    cause = f"the load cell was dead or not connected, or another axis was recorded (line {part.header_line})"
    return stated(title, text, "impossible", cause=cause, file=name, line=part.header_line)


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
    cell = str((blocks[0].header.get("load_cell") or {}).get("name") or "")
    capacity = _capacity(cell)
    if capacity is None:
        return not_made(CAPACITY, "a load cell whose name says its capacity")
    largest = max(float(np.nanmax(np.abs(p.force))) for p in blocks)
    text = f"{name}: up to {quantity(largest, 'N')} with a cell of {quantity(capacity, 'N')} ({cell})"
    part = blocks[0]
    check = bounded(CAPACITY, text, largest, 0.1 * capacity, at_most=1.1 * capacity, file=name, line=part.header_line)
    cause = f"the column of the force is in gf or mN, not in N (header of the columns, line {part.header_line})"
    return replace(check, cause=cause)


def _capacity(name: str) -> float | None:
    """Return the force [N] that the name of a cell says, such as "25kg SN:1886652"; None where it says none."""
    said = re.search(r"(\d+(?:\.\d+)?)\s*(kg|g|kN|N)\b", name)
    return None if said is None else float(said[1]) * _FORCES[_CELLS.get(said[2], said[2])]


def of_cell(load_cell: LoadCell, loads: xr.Dataset) -> list[Check]:
    """Check the record of the load cell: its scale, and the delay of its filter."""
    gain = float(loads["gain"])
    record = load_cell.record or ""
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
    value, u_value = measured
    expected = mach1_readings.filter_delay(loads.assign_attrs(filter_delay="null"))
    text = (
        f"{record}: the delay is {quantity(value, 's')}, a filter of order {int(declared['order'])} and "
        f"{declared['cutoff']:.3g} Hz has about {quantity(expected.value, 's')}"
    )
    check = compared(
        DELAY,
        text,
        value,
        u_value,
        expected.value,
        0.1 * expected.value,
        allowance=(_LATER if value > expected.value else _SOONER) * expected.value,
        file=record,
        setting="values.filter_delay",
    )
    if check.level is not None:
        wrong = f"the delay of the filter in {record} is probably {quantity(expected.value, 's')}"
        check = replace(check, cause=f"{wrong}, not {quantity(value, 's')}")
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


def of_punch(punch: Punch | None, model: IndentationModel, deepest: float) -> list[Check]:
    """Check the geometry that the session states against itself and the largest depth [m]."""
    title = "size of the punch"
    if punch is None:
        return [not_made(title, "a punch")]
    found = []
    for setting, size, what in (
        ("punch.depth", punch.depth.value, "length of a tip"),
        ("punch.radius", punch.radius.value, "radius of a tip"),
        ("punch.tips", punch.tips * punch.period.value, f"{punch.tips} tips {quantity(punch.period.value, 'm')} apart"),
    ):
        level = _beyond(size, _LARGE_PUNCH, _LARGEST_PUNCH)
        text = f"{what}: {quantity(size, 'm')}"
        if level is not None:
            cause = f"{setting} in session.toml is wrong: its unit, or its number"
            cause += "; or punch.period is" if setting == "punch.tips" else ""
            found.append(stated(title, text, level, cause=cause, setting=setting))
    if not found:
        found.append(stated(title, f"{punch.tips} tips of {quantity(punch.depth.value, 'm')} fit", None))
    found.append(_valleys(punch, model, deepest))
    return found


def _valleys(punch: Punch, model: IndentationModel, deepest: float) -> Check:
    title = "period of the punch"
    if not deepest > 0.0 or model.profile == "cosine":
        return not_made(title, "a depth, and tips that are no waves")
    share = deepest / westergaard.full_contact(punch.radius.value, punch.period.value, "parabola")
    width = 2 * (2 * punch.radius.value * deepest) ** 0.5
    text = (
        f"at a depth of {quantity(deepest, 'm')} a tip of {quantity(punch.radius.value, 'm')} meets the surface over "
        f"{quantity(width, 'm')}; the period is {quantity(punch.period.value, 'm')}"
    )
    cause = "punch.period in session.toml is too small for these tips, or punch.radius is too large"
    return stated(title, text, _beyond(share, 0.5, 1.0), cause=cause, setting="punch.period")


def _beyond(value: float, large: float, most: float) -> Level | None:
    return "impossible" if value > most else "doubtful" if value > large else None


def of_force(name: str, force: float, expected: float) -> Check:
    """Compare a force [N] with that of the model for the named material, NaN where there is none.

    A solid that is known by its name has a plausible range: a force outside of it is doubtful, never impossible.
    """
    if not (isfinite(expected) and expected > 0.0 and force > 0.0):
        return not_made(RATIO, "a model")
    ratio = log(force / expected)
    text = f"{name}: {quantity(force, 'N')} measured, {quantity(expected, 'N')} expected of the named material"
    check = bounded(RATIO, text, abs(ratio), _U_MATERIAL, at_most=0.0, is_law=False, file=name)
    return replace(check, log_ratio=ratio, u_log_ratio=_U_MATERIAL)


def phase(name: str, lag: float, u: float, frequency: float, record: str | None) -> Check:
    """Compare a phase lag [rad] with 0 to pi/2."""
    text = f"{name}: the force {'lags' if lag < 0.0 else 'leads'} by {abs(lag) * 180 / pi:.2f}° at {frequency:.3g} Hz"
    cause = "the columns are swapped, a sign is wrong, or the delay of the cell's filter is not what "
    cause += f"{record} says" if record else "its header says"
    cause += ", or the stage has play (backlash)" if lag < 0.0 else ""
    return bounded(PHASE, text, lag, max(u, 1e-3), at_least=0.0, at_most=pi / 2, file=name, cause=cause)


def causes(
    name: str, readings: xr.Dataset, punch: Punch | None, load_cell: LoadCell, checks: Sequence[Check] = ()
) -> Iterator[Cause]:
    """Yield the mistakes with a file, a column or a setting that multiply a measured quantity.

    A factor that all oscillations share is more likely one of a column, one that a single block
    has is one of its header.
    """
    blocks = parts(readings)
    if not blocks:
        return
    names = blocks[0].header_line
    position, force_unit = (
        _SPELT.get(text := str(readings[name].attrs["original_unit"]), text) for name in ("position_z", "force_z")
    )
    columns = [
        Cause(
            {FREQUENCY: -1.0, SPEED: -1.0, APPROACH: -1.0, CLOCK: 1.0},
            lambda k: f"the column of the time is {too_large(k)}{_unit_of(k, 's', _TIMES)} (line {names})",
            _FACTORS,
            file=name,
            line=names,
        ),
        Cause(
            {AMPLITUDE: 1.0, TRAVEL: 1.0, SPEED: 1.0, APPROACH: 1.0, RATIO: -1.1},
            lambda k: f"the column of the position is {too_large(k)}{_unit_of(k, position, _LENGTHS)} (line {names})",
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
        lambda k: f"the column of the force is {too_large(k)}{_unit_of(k, force_unit, _FORCES)} (line {names})",
        tuple(_FORCES[force_unit] / size for unit, size in _FORCES.items() if unit != force_unit),
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
        lambda k: (
            f"no slip of a unit explains it: another material, {in_words(k)} times as stiff, was pressed or is named"
        ),
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
            (*(10.0,) * (punch.tips % 10 == 0), 0.1) if setting == "punch.tips" else (1e3, 1e-3, 100.0, 10.0, 0.1),
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
_TIMES = {"s": 1.0, "ms": 1e-3}
_LENGTHS = {"mm": 1e-3, "µm": 1e-6}
_FORCES = {"N": 1.0, "gf": 1e-3 * _GRAVITY, "mN": 1e-3, "kN": 1e3, "kgf": _GRAVITY}
"""Units in which a column may be, whatever its header says, in SI."""
_SPELT, _CELLS = {"um": "µm"}, {"kg": "kgf", "g": "gf"}
"""Spellings of units in the headings of columns, and in the names of load cells."""


def _unit_of(factor: float, header: str, units: Mapping[str, float]) -> str:
    """Say in which unit a column would be that many times too large under its header; "" for none of them."""
    away = {unit: abs(log(factor * size / units[header])) for unit, size in units.items() if unit != header}
    nearest = min(away, key=lambda unit: away[unit])
    return f": in {nearest} under {header}" if away[nearest] < log(1.1) else ""


def _shared(blocks: Sequence[Part]) -> bool:
    """Return whether all of several oscillations differ from their commands by one factor."""
    rows = [
        (moved_by(p, p.position) / p.declared("Amplitude")[0], counted_frequency(p)[0] / p.declared("Frequency")[0])
        for p in blocks
        if p.function == OSCILLATION
    ]
    if len(rows) < 2:
        return False
    spread = np.ptp(np.log(np.maximum(np.array(rows), 1e-12)), axis=0)
    return bool((spread < 0.2).all())

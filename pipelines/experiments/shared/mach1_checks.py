"""Checks of Mach-1 files: commands, clock, columns, cell and punch, and the mistakes that would explain them.

Commands, clock and columns are redundant: the amplitude of a command is that of the position, its frequency and speed
against position and time, the start of the next block against the length of this one, and the force against the
cell's capacity, its sign against the motion, its size against that of the model for the named material.
"""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from math import hypot, isfinite, log, nan
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import linregress

from labpipe.contact.line import westergaard
from labpipe.judging import (
    IMPOSSIBLE,
    SLIPS,
    Cause,
    Check,
    Level,
    bounded,
    compared,
    in_words,
    judge,
    not_made,
    too_large,
)
from labpipe.report import quantity
from labpipe.signals import estimate_noise
from labpipe.workflow.context import Context
from pipelines.experiments.shared import judgements, mach1_readings
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Title
from pipelines.experiments.shared.mach1_blocks import FIND_CONTACT, OSCILLATION, RELAXATION, Part, parts
from pipelines.experiments.shared.mach1_touch import STEP
from pipelines.experiments.shared.model_inputs import inputs_of
from pipelines.experiments.shared.punch_model import TOUCH
from pipelines.experiments.shared.punch_settings import Indentation, LoadCell
from pipelines.experiments.shared.record_checks import FLAT, MANY, break_in, longest_run, placed, step_in

_AMPLITUDE, _FREQUENCY = "amplitude of the oscillation", "frequency of the oscillation"
_TRAVEL, _SPEED, _CLOCK = "travel of the ramp", "speed of the ramp", "clock of the blocks"
_CAPACITY, _SCALE, _DELAY = "capacity of the cell", "scale of the cell", "delay of the filter"
_SATURATION, _RATIO, _RESPONSE = "saturation of the cell", "force for the named material", "response of the cell"
_SWAPPED, ALIGNMENT, LOSS = "order of the columns", "lateral force", "loss stiffness"
_OUTLIERS, _LOST, _STEP, _PUNCH = "outliers", "lost rows", "step of the force", "size of the punch"

TITLES = {
    "columns": Title(
        "Position and force stand in their columns, with the stage's direction and the cell's sign.",
        (_SWAPPED, _RESPONSE, LOSS),
    ),
    "commands": Title(
        "The motion has the amplitude, frequency, travel and speed of its command.",
        (_AMPLITUDE, _FREQUENCY, _TRAVEL, _SPEED),
    ),
    "clock": Title("Times of the readings and of the blocks are consistent.", (_CLOCK,)),
    "load cell": Title(
        "The force stays within the cell's capacity and is scaled once.", (_CAPACITY, _SCALE, _DELAY, _SATURATION)
    ),
    "alignment": Title("The punch presses straight down: lateral forces are small.", (ALIGNMENT,)),
    "punch": Title("The stated punch can be pressed in so far.", (_PUNCH,)),
    "contact modulus": Title("The force is that of the model for the named material.", (_RATIO,)),
    "continuity of the readings": Title(
        "A recording holds every reading, without outliers and without a step of the force.", (_OUTLIERS, _LOST, _STEP)
    ),
}
_NO_TOUCH = "the position of first touch, or the punch in session.toml, is wrong"
_FAILED = {
    "loads": "the file, or the record of its load cell, does not belong to this test",
    "oscillations": "the file does not hold the oscillations that it declares",
    "ramps": "the stage was not moved and held, or its column is wrong",
    **dict.fromkeys(("curves", "model", "theory"), _NO_TOUCH),
}
"""Most likely faults by the step that failed."""

_COMMANDS = {
    _AMPLITUDE: (OSCILLATION, "Amplitude", "m", 0.3),
    _FREQUENCY: (OSCILLATION, "Frequency", "Hz", 0.05),
    _TRAVEL: (RELAXATION, "Amplitude", "m", 0.05),
    _SPEED: (RELAXATION, "Velocity", "m/s", 0.25),
}
"""Block and name of what is declared, its unit, and by how much, relative, a stage may miss it: eases, lags, brakes."""
_FORCES = {"N": 1.0, "gf": 9.80665e-3, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665}
_TIMES, _LENGTHS = {"s": 1.0, "ms": 1e-3}, {"mm": 1e-3, "µm": 1e-6}
"""Units in which a column may be, whatever its header says, in SI."""
_CELLS = {"kg": "kgf", "g": "gf"}  # spellings of units in the names of load cells
_LATERAL = 0.1  # of the normal force: a tilt of 6 degrees, by which the normal force errs by 0.5 %
_U_CLOCK = 2.0  # of the logarithm of a block's length over the time until the next: rests lie between
_LEAVES = 20.0
"""Steps of the cell by which a force changes in as many readings before or after as it stays at an extreme: behind a
smooth peak that stays on one step for n readings it changes by 8 in n more."""
_U_GAIN = 0.1  # of the logarithm of true over displayed force, by age and handling of a cell
_LARGEST_PUNCH = 0.5  # m, either way


def scene(
    touch: str, rows: Callable[..., Iterable[Row]], given: Given, settings: Any, context: Context
) -> judgements.Scene:
    """Check the recordings of an indentation, its cell and its punch, and compare ``rows``.

    ``touch`` is the step that finds first touch. A mistake in one file does not show in the others, so that each has
    causes of its own.
    """
    files = [settings.mach1] if isinstance(settings.mach1, str) else settings.mach1
    found_by = [given.get(step) for step in ("readings", "loads", touch, "comparison")]
    steps = [found if isinstance(found, Sequence) else [found] * len(files) for found in found_by]
    cell = next((loads for loads in steps[1] if loads is not None), None)
    of_cell = [] if cell is None else list(_of_cell(settings.load_cell, cell))
    is_scaled = not any(check.name == _SCALE and check.level for check in of_cell)
    checks, deepest = list[Check](), 0.0
    for name, readings, loads, touched, model in zip(files, *steps, strict=True):
        if readings is None:
            checks.append(not_made(_SWAPPED, "a file that can be read"))
            continue
        found = of_file(name, readings)
        if loads is not None and not any(c.name in (_SWAPPED, _RESPONSE, _TRAVEL) and c.level for c in found):
            position = loads["position_z"].values  # and so the depth of the punch is known
            depth = nan if touched is None else float(np.nanmax(position) - touched["contact_position"])
            deepest = max(deepest, 0.0 if np.isnan(depth) else depth)
            at, force, expected = int(np.nanargmax(position)), 0.0, 0.0
            if loads.attrs["is_tared"] and model is not None and "simulated_force" in model:
                force, expected = float(loads["force"][at]), float(model["simulated_force"][at])
            if is_scaled and force > 0.0 and expected > 0.0:
                text, u = f"{name}: {quantity(force, 'N')} measured", judgements.u_modulus(settings.substrate)
                text += f", {quantity(expected, 'N')} expected of the named material"
                found.append(compared(_RATIO, text, force, 0.0, expected, u * expected, file=name))
            elif is_scaled:
                found.append(not_made(_RATIO, "a model, and forces above 0"))
        checks += judge(found, list(_causes(name, readings, settings, found))).checks
    checks += _of_punch(settings, deepest)
    failed = judgements.failed_steps(context, _FAILED)
    checks += [*of_cell, *(placed(check, *files, settings.load_cell.record) for check in failed)]
    known = {name: value for compared_with in steps[-1] for name, value in inputs_of(compared_with).items()}
    shared = {TOUCH: known.pop(TOUCH)} if TOUCH in known else {}
    source = judgements.measured_by(settings.substrate)
    return judgements.Scene(checks, (), given.each([rows]), known, shared, given.get("basis"), measured_by=source)


def of_file(name: str, readings: xr.Dataset) -> list[Check]:
    """Check one file by itself; where its columns are exchanged nothing else is asked."""
    blocks = parts(name, readings)
    if not blocks:
        return [not_made(_SWAPPED, "columns of position and force")]
    wrong, known, missed = [], 0, _COMMANDS[_AMPLITUDE][-1]
    for part in blocks:
        wanted = abs(part.declared("Amplitude")[0])
        if part.function in (OSCILLATION, RELAXATION) and wanted > 0.0:
            # the file's own numbers: mm of the position, whatever of the force
            own, other = (abs(part.moved(each)) / wanted for each in (part.position, 1e-3 * part.force))
            known += 1
            wrong += [part] * (abs(other - 1.0) < missed <= abs(own - 1.0))
    if 2 * len(wrong) > known:
        where = wrong[0]
        declared, moved = where.declared("Amplitude")[0], abs(where.moved(where.position))
        text = f"{name}: the column of the force moves by the declared {quantity(declared, 'm')} (as mm), the column "
        text += f"of the position by {quantity(moved, 'm')}"
        cause = f"the columns of position and force are swapped (header of the columns, line {where.header_line})"
        return [Check(_SWAPPED, text, "impossible", cause=cause, **where.place)]
    order = Check(_SWAPPED, f"{name}: the position makes the declared motion", file=name)
    outliers, lost, step = _continuity(blocks)
    found = [order if known else not_made(_SWAPPED, "a declared amplitude"), *_commands_kept(blocks), _response(blocks)]
    found = judgements.because(found, lost.cause if lost.level else "", _FREQUENCY, _CLOCK, log_ratio=nan)
    found += [*_range_of_cell(blocks), outliers, lost, step]
    tilts = []
    for part in (part for part in blocks if part.lateral and part.stiffness[-1]):
        lines = [linregress(part.force, side, nan_policy="omit") for side in part.lateral]
        tilts.append((hypot(*(line.slope for line in lines)), hypot(*(line.stderr for line in lines)), part))
    if tilts:
        worst, u, part = max(tilts, key=lambda one: one[0])
        text = f"{part}: the lateral force changes by {worst:.2g} of the normal force, at most {_LATERAL:g} is "
        cause = "the punch or the specimen is tilted, or the punch slides: level the specimen and centre the punch"
        place: dict[str, Any] = {"is_law": False, "cause": cause} | part.place
        text += "expected of an aligned punch"
        found.append(bounded(ALIGNMENT, text, worst, max(u, 1e-3), at_most=_LATERAL, **place))
    return found


def _commands_kept(blocks: Sequence[Part]) -> Iterator[Check]:
    """Compare amplitude, frequency, travel and speed with the declared ones, the worst of each, and times of blocks."""
    # one that several blocks miss has no line: then their headers are not the fault
    for title, (function, key, unit, missed) in _COMMANDS.items():
        found = []
        for part in (part for part in blocks if part.function == function):
            wanted, line = part.declared(key)
            value, u = part.frequency if title == _FREQUENCY else (abs(part.moved(part.position)), STEP)
            if title == _SPEED:
                value, u = part.speed, 0.02 * part.speed
            if isfinite(value) and isfinite(wanted):
                ratio = in_words(value / wanted)
                text = f"{part}: {title} is {quantity(value, unit)}, declared are {quantity(wanted, unit)}"
                text += "" if ratio == "1" else f" ({ratio} times)"
                place: dict[str, Any] = {"allowance": missed * wanted, "file": part.file, "line": line}
                u = max(u, 2e-3 * min(value, wanted))
                found.append(compared(title, text, value, u, wanted, 0.0, **place))
        if found:
            worst = max(found, key=lambda c: abs(c.margin) if c.level else -1.0)
            yield replace(worst, line=None) if sum(c.level is not None for c in found) > 1 else worst
    known = []
    for part, (began, next_began) in zip(
        blocks, pairwise(str(p.header.get("start") or "") for p in blocks), strict=False
    ):
        if began and next_began:
            gap = (datetime.fromisoformat(next_began) - datetime.fromisoformat(began)).total_seconds()
            lasts = float(np.ptp(part.time))
            known.append(((lasts - gap) / hypot(0.1, 5e-3 * gap), part, lasts, gap))
    if not known:
        yield not_made(_CLOCK, "two blocks with start times")
        return
    beyond, part, lasts, gap = max(known, key=lambda one: one[0])
    text = f"{part}: its column of time spans {quantity(lasts, 's')}, the next block begins after {quantity(gap, 's')}"
    check = bounded(_CLOCK, text, beyond, 1.0, at_most=0.0, **part.place)
    by = log(lasts / gap) if check.level and gap > 0.0 else nan
    yield replace(check, log_ratio=by, u_log_ratio=_U_CLOCK)


def _response(blocks: Sequence[Part]) -> Check:
    """Compare the changes of force and position, and the motion with its declared direction."""
    pressed = (part for part in blocks if part.function in (OSCILLATION, RELAXATION))
    known = [(part, *part.stiffness) for part in pressed if isfinite(part.stiffness[0])]
    if not known:
        return not_made(_RESPONSE, "a motion of the stage")
    following = [one for one in known if one[-1]]
    wrong = [one for one in following if one[1] < 0.0]
    part, k, u, follows = next(iter(wrong or following or known))
    if not follows:
        text = (
            f"{part.file}: the force varies by {quantity(float(np.nanmax(part.force) - np.nanmin(part.force)), 'N')} "
        )
        cause = f"the load cell was dead or not connected, or another axis was recorded (line {part.header_line})"
        text += "and does not follow while the stage moves"
        return Check(_RESPONSE, text, "impossible", cause=cause, **part.place)
    moves = [one for one in blocks if one.function in (RELAXATION, FIND_CONTACT) and isfinite(one.direction)]
    is_back = any(one.moved(one.position) * one.direction < -IMPOSSIBLE * STEP for one in moves)
    text = f"{part}: stiffness {quantity(k, 'N/m')}"
    if is_back:
        text += ", and the stage moves against its declared direction"
        cause = f"the sign of the column of the position is wrong (line {part.header_line})"
        return Check(_RESPONSE, text, "impossible", cause=cause, **part.place)
    place = next((i for i, line in enumerate(part.header["info_lines"]) if line.startswith("Load Cell Type")), 0)
    cause = (
        f"the sign of the column of the force is wrong (line {part.header_line}), or the load cell's type "
        f"(line {part.line + 1 + place}), which says the sign of compression"
    )
    if wrong and len(wrong) < len(following):
        right = next(one for one in following if one[1] > 0.0)
        text += f", {quantity(right[1], 'N/m')} in block {right[0].number + 1}"
        cause = f"the sign of the force is reversed in block {part.number + 1} (its column, line {part.header_line})"
        if abs(k) < 0.5 * right[1]:  # a mirrored force would follow as far
            cause = f"the force lags by over a quarter period in block {part.number + 1}: filter or delay of the cell"
            cause += " are not those of its record"
    return bounded(_RESPONSE, text, k, max(u, 1e-3 * abs(k)), at_least=0.0, cause=cause, **part.place)


def _range_of_cell(blocks: Sequence[Part]) -> Iterator[Check]:
    """Look for flat extremes of the force, and compare it with the capacity in the cell's name ("25kg SN:1886652")."""
    flat = list[Check]()
    for part in (part for part in blocks if part.function in (OSCILLATION, RELAXATION)):
        force = part.force[np.isfinite(part.force)]
        steps = np.abs(np.diff(force))
        step = float(np.min(steps[steps > 0.0], initial=np.inf))
        for extreme in (float(force.max()), float(force.min())) if np.isfinite(step) else ():
            n, first = longest_run(np.abs(force - extreme) < 0.5 * step)
            sides = force[[max(first - n, 0), min(first + 2 * n - 1, force.size - 1)]]
            leaves = float(np.abs(sides - extreme).max())
            if n >= FLAT and leaves > _LEAVES * max(step, 1e-4 * float(np.ptp(force))):
                text = f"{part}: the force stays at {quantity(extreme, 'N')} for {n} readings from "
                text += f"{quantity(float(part.time[first]), 's')}, then changes by {quantity(leaves, 'N')}"
                cause = "the cell or its amplifier was saturated: peaks and work are not measured; use a larger range"
                flat.append(Check(_SATURATION, text, "impossible", cause=cause, **part.place))
    part = blocks[0]
    yield flat[0] if flat else Check(_SATURATION, f"{part.file}: no flat extremes", file=part.file)
    cell = str((part.header.get("load_cell") or {}).get("name") or "")
    said = re.search(r"(\d+(?:\.\d+)?)\s*(kg|g|kN|N)\b", cell)
    if said is None:
        yield not_made(_CAPACITY, "a load cell whose name says its capacity")
        return
    capacity = float(said[1]) * _FORCES[_CELLS.get(said[2], said[2])]
    largest = max(float(np.nanmax(np.abs(part.force))) for part in blocks)
    text = f"{part.file}: up to {quantity(largest, 'N')} with a cell of {quantity(capacity, 'N')} ({cell})"
    cause = f"the column of the force is in gf or mN, not in N (header of the columns, line {part.header_line})"
    yield bounded(_CAPACITY, text, largest, 0.1 * capacity, at_most=1.1 * capacity, cause=cause, **part.place)


def _continuity(blocks: Sequence[Part]) -> tuple[Check, Check, Check]:
    """Name the readings that were left out, of the block with the largest deviation, lost rows, and a step of force.

    The step is one in the relaxation of a held punch, or between cycles of an oscillation at equal phase.
    """
    file = blocks[0].file
    outliers, lost = Check(_OUTLIERS, f"{file}: no outliers", file=file), not_made(_LOST, "an oscillation")
    known = [(part, run) for part in blocks for run in part.outliers if run["column"] in ("position_z", "force_z")]
    if known:
        part, largest = max(known, key=lambda one: float(one[1]["by"]))
        column, first = str(largest["column"]).removesuffix("_z"), int(largest["first"])
        count, line = sum(run["last"] - run["first"] + 1 for run in part.outliers), part.row_line(first)
        by, at = quantity(float(largest["by"]), "m" if column == "position" else "N"), quantity(part.time[first], "s")
        text = f"{part}: {count} {'reading' if count == 1 else 'readings'} left out as outliers, the largest deviation "
        text += f"{by} of the {column} in line {line}, at {at}"
        level: Level = "doubtful" if count > MANY * part.force.size else "note"
        cause = f"a disturbance, or a value that was edited, in line {line}"
        outliers = Check(_OUTLIERS, text, level, cause=cause, file=file, line=line)
    for part in (part for part in blocks if part.function == OSCILLATION):
        broken = break_in(part.position, estimate_noise(part.position).sigma)
        if broken is not None:
            line, jump = part.row_line(broken[0]), quantity(broken[1], "m")
            cause = "rows were lost there when the file was written or copied, and the times of the others renewed"
            text = f"{part}: the position jumps by {jump} in line {line}"
            lost = Check(_LOST, text, "doubtful", cause=cause, file=file, line=line)
            return outliers, lost, not_made(_STEP, "every row")
        lost = Check(_LOST, f"{file}: the position does not jump", file=file)
    settling = [(part, first, step_in(force, moving)) for part in blocks for first, force, moving in part.settling()]
    steps = [(part, first + found[0], *found[1:]) for part, first, found in settling if found is not None]
    if not steps:
        return outliers, lost, not_made(_STEP, "a hold, or an oscillation of several cycles")
    part, index, size, times = max(steps, key=lambda one: one[-1])
    if times <= IMPOSSIBLE:
        text = f"{part}: no step of the force, up to {quantity(abs(size), 'N')} by noise"
        return outliers, lost, Check(_STEP, text, file=file)
    when = quantity(float(part.time[index]), "s")
    text = f"{part}: the force {'rises' if size > 0.0 else 'falls'} by {quantity(abs(size), 'N')} at {when}, "
    text += f"{in_words(times, 2)} times its scatter, while it is held or oscillates steadily"
    cause = f"specimen or punch slipped in {part} at {when}, or the cell was knocked: use what precedes, or repeat it"
    return outliers, lost, Check(_STEP, text, "doubtful", cause=cause, file=file, line=part.row_line(index))


def _of_cell(load_cell: LoadCell, loads: xr.Dataset) -> Iterator[Check]:
    """Check the record of the load cell: its scale, and the delay of its filter."""
    gain, record = float(loads["gain"]), load_cell.record or ""
    yield judgements.day_known(loads, record)
    if not record:
        yield not_made(_SCALE, "a calibration record of the load cell")
        return
    text = f"{record}: true force is {gain:.4g} times the displayed one"
    cause = f"the scale of the load cell in {record} is wrong: about 1 is expected, not {gain:.4g}"
    yield compared(_SCALE, text, abs(gain), 0.0, 1.0, _U_GAIN, cause=cause, file=record, setting="values.scale")
    as_declared, measured = loads.assign_attrs(filter_delay="null"), json.loads(loads.attrs["filter_delay"])
    declared = mach1_readings.declared_filter(as_declared)
    if declared is None or measured is None:
        yield not_made(_DELAY, "a measured delay, and a declared filter")
        return
    (value, u), (expected, u_type, _) = measured, mach1_readings.filter_delay(as_declared)
    seen, usual = quantity(value, "s"), quantity(expected, "s")
    text = f"{record}: the delay is {seen}, a filter of order {int(declared['order'])} and {declared['cutoff']:.3g} Hz "
    cause = f"the delay of the filter in {record} is probably {usual}, not {seen}"
    place: dict[str, Any] = {"file": record, "setting": "values.filter_delay", "cause": cause}
    place["allowance"] = 3.0**0.5 * u_type  # the usual types differ from a Butterworth by so much at most
    yield compared(_DELAY, f"{text}has about {usual}", value, u, expected, 0.1 * expected, **place)


def _of_punch(settings: Indentation, deepest: float) -> Iterator[Check]:
    """Check the geometry that the session states against itself and the largest known depth [m]."""
    punch = settings.punch
    if punch is None:
        yield not_made(_PUNCH, "a punch")
        return
    radius, period, depth = (each.value for each in (punch.radius, punch.period, punch.depth))
    sizes = {"punch.depth": depth, "punch.radius": radius, "punch.tips": punch.tips * period}
    setting, largest = max(sizes.items(), key=lambda one: one[1])
    level: Level | None = "impossible" if largest > _LARGEST_PUNCH else None
    cause = f"{setting} in session.toml is wrong: its unit, or its number"
    yield Check(_PUNCH, f"{setting}: {quantity(largest, 'm')} in all", level, cause=cause, setting=setting)
    if deepest > 0.0 and settings.model.profile != "cosine":
        text = f"at a depth of {quantity(deepest, 'm')} a tip of {quantity(radius, 'm')} meets the surface over "
        text += f"{quantity(2 * (2 * radius * deepest) ** 0.5, 'm')}; the period is {quantity(period, 'm')}"
        level = "impossible" if deepest > float(westergaard.full_contact(radius, period, "parabola")) else None
        cause = "punch.period in session.toml is too small for these tips, or punch.radius is too large"
        yield Check(_PUNCH, text, level, cause=cause, setting="punch.period")


def _causes(name: str, readings: xr.Dataset, settings: Indentation, checks: Sequence[Check]) -> Iterator[Cause]:
    """Yield the mistakes with a file, a column or a setting that multiply a measured quantity."""
    blocks = parts(name, readings)
    if not blocks:
        return
    line, punch = blocks[0].header_line, settings.punch
    units = [str(readings[column].attrs["original_unit"]).replace("um", "µm") for column in ("position_z", "force_z")]

    def of_column(of: str, unit: str, units: Mapping[str, float]) -> Callable[[float], str]:
        def say(k: float) -> str:
            away = {other: abs(log(k * size / units[unit])) for other, size in units.items() if other != unit}
            near = min(away, key=lambda other: away[other])
            is_in = f": in {near} under {unit}" if away[near] < log(1.1) else ""
            return f"the column of the {of} is {too_large(k)}{is_in} (line {line})"

        return say

    def of_command(check: Check) -> Callable[[float], str]:
        key = _COMMANDS[check.name][1].lower()
        return lambda k: f"the declared {key} is {too_large(k)} (line {check.line} of {name})"

    for check in (check for check in checks if check.name in _COMMANDS and check.level and check.line):
        yield Cause({check.name: -1.0}, of_command(check), SLIPS["value"], file=name, line=check.line)
    place: dict[str, Any] = {"file": name, "line": line}
    of_time = {_FREQUENCY: -1.0, _SPEED: -1.0, _CLOCK: 1.0}
    yield Cause(of_time, of_column("time", "s", _TIMES), SLIPS["interval"], **place)
    of_length = {_AMPLITUDE: 1.0, _TRAVEL: 1.0, _SPEED: 1.0, _RATIO: -1.1}
    usual = SLIPS["length"] + SLIPS["gain"]
    yield Cause(of_length, of_column("position", units[0], _LENGTHS), usual, **place)
    others = tuple(_FORCES[units[1]] / size for unit, size in _FORCES.items() if unit != units[1])
    yield Cause({_RATIO: 1.0}, of_column("force", units[1], _FORCES), others, only_usual=True, **place)
    other = "no slip of a unit explains it: another material, {} times as stiff, was pressed or is named"
    yield Cause({_RATIO: 1.0}, lambda k: other.format(in_words(k)), setting="substrate.material")
    if punch is not None:
        tips, lengths = (*(10.0,) * (punch.tips % 10 == 0), 0.1), (1e3, 1e-3, 100.0, 10.0, 0.1)
        for what, setting, value, unit, usual in (
            ("number of tips", "punch.tips", float(punch.tips), "1", tips),
            ("length of a tip", "punch.depth", punch.depth.value, "m", lengths),
        ):
            told = judgements.times_over(f"the {what}", value, unit, f"{setting} in session.toml")
            yield Cause({_RATIO: -1.0}, told, usual, only_usual=True, setting=setting)

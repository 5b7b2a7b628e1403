"""Checks of indentations: the punch, the force for the named material, and the mistakes that would explain them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, log, nan
from typing import Any

import xarray as xr

from labpipe.contact.line import westergaard
from labpipe.judging import Cause, Check, Level, bounded, in_words, judge, not_made, stated, too_large
from labpipe.report import quantity
from labpipe.workflow.context import Context
from pipelines.experiments.shared import judgements, mach1_checks
from pipelines.experiments.shared.mach1_blocks import parts
from pipelines.experiments.shared.mach1_checks import (
    AMPLITUDE,
    CLOCK,
    COMMANDS,
    FORCES,
    FREQUENCY,
    RATIO,
    SCALE,
    SPEED,
    SWAPPED,
    TRAVEL,
)
from pipelines.experiments.shared.punch_settings import Indentation, IndentationModel, Punch

OF_LOADS = "the file, or the record of its load cell, does not belong to this test"
NO_TOUCH = "the position of first touch, or the punch in session.toml, is wrong"
"""Most likely faults where the force, and where a model could not be made."""
_LARGEST_PUNCH, _LARGE_PUNCH = 0.5, 0.15  # m, either way
_U_MATERIAL = 0.5  # of the logarithm of the force for a solid that is known by its name
_FACTORS = (1e3, 1e-3, 1e6, 1e-6, 10.0, 0.1, 100.0, 0.01, 2.0, 0.5, 60.0, 1 / 60.0)
_TIMES, _LENGTHS = {"s": 1.0, "ms": 1e-3}, {"mm": 1e-3, "µm": 1e-6}
"""Units in which a column may be, whatever its header says, in SI."""


@dataclass(frozen=True)
class Tested:
    """One recording of an indentation, as far as its steps gave a result.

    Attributes
    ----------
    name : str
    readings, loads : Dataset, optional
    depth, force, expected : float
        Largest depth [m], and the force of one state with that of the model for the named material [N]; NaN where
        there is none.
    own : tuple of Check
        Further checks of the recording.
    """

    name: str
    readings: xr.Dataset | None
    loads: xr.Dataset | None
    depth: float = nan
    force: float = nan
    expected: float = nan
    own: tuple[Check, ...] = ()


def of_tests(
    tests: Sequence[Tested], settings: Indentation, context: Context, reasons: Mapping[str, str]
) -> list[Check]:
    """Check the recordings of an experiment, its cell and its punch; `reasons` are as for :func:`.failed_steps`.

    A mistake in one file does not show in the others, so that each has causes of its own.
    """
    cell = next((test.loads for test in tests if test.loads is not None), None)
    of_cell = [] if cell is None else mach1_checks.of_cell(settings.load_cell, cell)
    checks: list[Check] = []
    for test in tests:
        if test.readings is None:
            checks.append(not_made(SWAPPED, "a file that can be read"))
            continue
        found = [*mach1_checks.of_file(test.name, test.readings), *test.own]
        if mach1_checks.knows_depth(found):
            found.append(_of_force(test))
        causes: list[Cause] = []
        if any(check.level for check in found):
            causes = _causes(test.name, test.readings, settings, [*found, *of_cell])
        checks += judge(mach1_checks.weighed(found), causes).checks
    if mach1_checks.knows_depth(checks):
        depths = [test.depth for test in tests if isfinite(test.depth)]
        checks += _of_punch(settings.punch, settings.model, max(depths, default=nan))
    failed = judgements.failed_steps(context, reasons)
    return [*checks, *of_cell, *mach1_checks.placed(failed, *(t.name for t in tests), settings.load_cell.record)]


def _of_force(test: Tested) -> Check:
    """Compare a force with that of the model for the named material.

    A solid that is known by its name has a plausible range: a force outside of it is doubtful, never impossible.
    """
    if not (isfinite(test.expected) and test.expected > 0.0 and test.force > 0.0):
        return not_made(RATIO, "a model")
    ratio, seen, expected = log(test.force / test.expected), quantity(test.force, "N"), quantity(test.expected, "N")
    text = f"{test.name}: {seen} measured, {expected} expected of the named material"
    check = bounded(RATIO, text, abs(ratio), _U_MATERIAL, at_most=0.0, is_law=False, file=test.name)
    return replace(check, log_ratio=ratio, u_log_ratio=_U_MATERIAL)


def _of_punch(punch: Punch | None, model: IndentationModel, deepest: float) -> list[Check]:
    """Check the geometry that the session states against itself and the largest depth [m]."""
    size, period = "size of the punch", "period of the punch"
    if punch is None:
        return [not_made(size, "a punch")]

    def judged(name: str, setting: str, text: str, value: float, large: float, most: float, cause: str) -> Check:
        level: Level | None = "impossible" if value > most else "doubtful" if value > large else None
        return stated(name, text, level, cause=cause, setting=setting)

    found = []
    for setting, value, what, other in (
        ("punch.depth", punch.depth.value, "length of a tip", ""),
        ("punch.radius", punch.radius.value, "radius of a tip", ""),
        ("punch.tips", punch.tips * punch.period.value, f"{punch.tips} tips together", "; or punch.period is"),
    ):
        cause = f"{setting} in session.toml is wrong: its unit, or its number{other}"
        text = f"{what}: {quantity(value, 'm')}"
        found.append(judged(size, setting, text, value, _LARGE_PUNCH, _LARGEST_PUNCH, cause))
    if not deepest > 0.0 or model.profile == "cosine":
        return [*found, not_made(period, "a depth, and tips that are no waves")]
    share = deepest / westergaard.full_contact(punch.radius.value, punch.period.value, "parabola")
    width = 2 * (2 * punch.radius.value * deepest) ** 0.5
    text = (
        f"at a depth of {quantity(deepest, 'm')} a tip of {quantity(punch.radius.value, 'm')} meets the surface over "
        f"{quantity(width, 'm')}; the period is {quantity(punch.period.value, 'm')}"
    )
    cause = "punch.period in session.toml is too small for these tips, or punch.radius is too large"
    return [*found, judged(period, "punch.period", text, float(share), 0.5, 1.0, cause)]


def _causes(name: str, readings: xr.Dataset, settings: Indentation, checks: Sequence[Check]) -> list[Cause]:
    """Return the mistakes with a file, a column or a setting that multiply a measured quantity."""
    blocks = parts(readings)
    if not blocks:
        return []
    line, record, punch = blocks[0].header_line, settings.load_cell.record, settings.punch

    def unit_of(column: str) -> str:
        return str(readings[column].attrs["original_unit"]).replace("um", "µm")

    def column(of: str, effects: Mapping[str, float], unit: str, units: Mapping[str, float], **more: Any) -> Cause:
        def say(k: float) -> str:
            away = {other: abs(log(k * size / units[unit])) for other, size in units.items() if other != unit}
            near = min(away, key=lambda other: away[other])
            is_in = f": in {near} under {unit}" if away[near] < log(1.1) else ""
            return f"the column of the {of} is {too_large(k)}{is_in} (line {line})"

        return Cause(effects, say, file=name, line=line, **more)

    def declared(check: Check) -> Cause:
        def say(k: float) -> str:
            return f"the declared {COMMANDS[check.name][1].lower()} is {too_large(k)} (line {check.line} of {name})"

        return Cause({check.name: -1.0}, say, (10.0, 0.1, 2.0, 0.5, 1e3, 1e-3, 100.0, 0.01), file=name, line=check.line)

    def of_punch(what: str, setting: str, value: float, unit: str, factors: Sequence[float]) -> Cause:
        def say(k: float) -> str:
            right, given = quantity(value / k, unit), quantity(value, unit)
            return f"the {what} is probably {right}, not {given} ({setting} in session.toml)"

        return Cause({RATIO: -1.0}, say, tuple(factors), only_usual=True, setting=setting)

    of_length = {AMPLITUDE: 1.0, TRAVEL: 1.0, SPEED: 1.0, RATIO: -1.1}
    force = unit_of("force_z")
    of_force = tuple(FORCES[force] / size for unit, size in FORCES.items() if unit != force)
    found = [
        *(declared(check) for check in checks if check.name in COMMANDS and check.level and check.line),
        column("time", {FREQUENCY: -1.0, SPEED: -1.0, CLOCK: 1.0}, "s", _TIMES, usual=_FACTORS),
        column("position", of_length, unit_of("position_z"), _LENGTHS, usual=_FACTORS),
        column("force", {RATIO: 1.0}, force, FORCES, usual=of_force, only_usual=True),
    ]
    # a record that hardly changes what the tester shows is not where a factor of ten comes from
    if record and not any(check.name == SCALE and check.is_made and check.level is None for check in checks):
        said, of_scale = f"the scale of the load cell in {record} is ", "values.scale"
        cause = Cause({RATIO: 1.0}, lambda k: said + too_large(k), (10.0, 100.0), True, file=record, setting=of_scale)
        found.append(cause)
    other = "no slip of a unit explains it: another material, {} times as stiff, was pressed or is named"
    found.append(Cause({RATIO: 1.0}, lambda k: other.format(in_words(k)), setting="substrate.material"))
    if punch is not None:
        tips = (*(10.0,) * (punch.tips % 10 == 0), 0.1)
        found.append(of_punch("number of tips", "punch.tips", float(punch.tips), "1", tips))
        lengths = (1e3, 1e-3, 100.0, 10.0, 0.1)
        found.append(of_punch("length of a tip", "punch.depth", punch.depth.value, "m", lengths))
    return found

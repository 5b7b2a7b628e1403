"""Checks of a sensor that sees the body all the time, in its range and by enough digits."""

import numpy as np

from labpipe.judging import Check, Level, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.trace_checks._trace import (
    FLAT,
    IN_NOISE,
    WRONG_CHANNEL,
    Trace,
    longest_by_chance,
    longest_run,
)

_SLOW = 0.05  # of the largest step, below which a body may rest on one reading
_BESIDE = 4  # readings on either side of equal ones that tell whether the body moves there
_COARSE, _TOO_COARSE = 5e-3, 3e-2  # of the travel
_HELD = (
    "the sensor was out of its range (clipped) or held its last value: the impact is not measured there; "
    "move the sensor or choose a larger range"
)
OUT_OF_RANGE = (
    "the sensor was out of its range, and the controller wrote that in place of a reading: the impact "
    "is not measured there; move the sensor or choose a larger range"
)


def unread(trace: Trace) -> Check:
    """Look for readings that the sensor gave as invalid."""
    title, law = "readings out of range", "a sensor sees the body all the time"
    lost = ~np.isfinite(trace.reading)
    for first, last, _ in trace.outliers:
        lost[first : last + 1] = False
    longest, start = longest_run(lost)
    if not longest:
        return stated(title, law, f"{trace.name}: every reading is valid", None, file=trace.name)
    text = (
        f"{trace.name}: {int(lost.sum())} readings are out of range or invalid, {longest} of them in a row "
        f"from {trace.at(start)}: what the body does there is not measured"
    )
    return stated(title, law, text, "doubtful" if longest >= FLAT else "note", file=trace.name, cause=OUT_OF_RANGE)


def held_readings(trace: Trace) -> Check:
    """Look for a body that stands still on one reading while it should move."""
    title, law = "clipped or held readings", "a moving body gives no equal readings in a row"
    x, step = trace.reading, trace.resolution
    moves = np.abs(np.diff(x))
    usual = float(np.nanquantile(moves, 0.98))
    longest, start = longest_run(np.nan_to_num(moves, nan=np.inf) <= 0.5 * step)
    around = np.abs(x[max(start - _BESIDE, 0) : start + longest + 1 + _BESIDE] - x[start])
    away = float(np.nanmax(around)) if np.isfinite(around).any() else 0.0
    is_moving = usual > 3 * step and away > max(_BESIDE * _SLOW * usual, 3 * step + IN_NOISE * trace.noise)
    # noise does not stay on one reading, least of all on the last one that there is
    is_end = longest > 0 and abs(x[start] - min((np.nanmin(x), np.nanmax(x)), key=lambda v: abs(x[start] - v))) < step
    is_cut = is_end and trace.noise > step and longest > longest_by_chance(trace.noise, step, x.size)
    if longest < FLAT or not (is_moving or is_cut or longest >= x.size - 2):
        return stated(title, law, f"{trace.name}: no clipped or held readings", None, file=trace.name)
    is_tail = start + longest >= x.size - 2
    until = "until the end" if is_tail else "in the middle of motion"
    text = f"{trace.name}: {longest + 1} equal readings in a row from {trace.at(start)}, {until} (clipped or held)"
    cause = _HELD
    if longest >= x.size - 2:
        cause = WRONG_CHANNEL
    elif is_tail and x[start] == 0.0:
        cause = "the end of the file is filled with zeros: the recording or its copy broke off there"
    return stated(title, law, text, "impossible", file=trace.name, cause=cause)


def resolution(trace: Trace) -> Check:
    """Hold the display's step against the travel."""
    title, law = "resolution of the readings", "a record resolves what is measured in it"
    step, travel = trace.resolution, trace.travel
    if step == 0.0 or travel == 0.0:
        return not_made(title, law, "readings that differ")
    text = f"{trace.name}: a resolution of {quantity(step, 'm')} for a travel of {quantity(travel, 'm')}"
    level: Level | None = "doubtful" if step > _TOO_COARSE * travel else "note" if step > _COARSE * travel else None
    cause = "the display shows too few digits: set more decimals in the controller"
    if travel < IN_NOISE * trace.noise:
        cause = "nothing moves in this record: it ends before the impact or begins after it, or " + WRONG_CHANNEL
    return stated(title, law, text, level, file=trace.name, cause=cause)

"""Checks of the force in a motion: it falls in a hold, is there when the stage arrives, and lags as a solid's does."""

from dataclasses import replace
from math import hypot, isfinite, pi

import numpy as np

from labpipe.judging import Check, bounded, not_made
from labpipe.report import quantity
from pipelines.experiments.shared.mach1_checks._parts import SETTLED, Part, travel_and_speed
from pipelines.experiments.shared.mach1_checks._titles import FALL, LATE, PHASE

_PARTS, _SWINGS = 40, 0.01  # of a hold, whose means are compared, and of a force, by which none of them rises


def falls(name: str, part: Part) -> Check:
    """Hold a force under a held depth against relaxation: it falls, or stays."""
    title = FALL
    travel, _, rest = travel_and_speed(part)
    inside = part.segment == part.segment[0]
    time, force = part.time[inside], part.force[inside]
    end = float(time[-1])
    if not (isfinite(rest) and rest > 0.0) or travel * part.declared("Amplitude")[0] < 0.0:
        return not_made(title, "a hold after a ramp into the material")
    early = force[(time > end - 0.75 * rest) & (time <= end - 0.5 * rest)]
    late = force[time > end - 0.25 * rest]
    if min(early.size, late.size) < 5:
        return not_made(title, "a hold of some seconds")
    rise = float(late.mean() - early.mean())
    size = max(abs(float(late.mean())), float(np.ptp(force)))
    u = hypot(float(late.std()) / (late.size / 10 + 1) ** 0.5, 2e-3 * size)
    text = f"{name}, block {part.number + 1}: the force changes by {quantity(rise, 'N')} in the second half of its hold"
    check = bounded(title, text, rise, u, at_most=0.0, file=name, line=part.header_line)
    if check.level is None:
        return _swings(check, name, part, end - rest)
    cause = (
        "the sign of the force is wrong, the rows stand in reverse order, or the stage crept on: a "
        "force in a hold falls"
    )
    return replace(check, cause=cause)


def _swings(check: Check, name: str, part: Part, arrived: float) -> Check:
    """Hold the force in a hold against every earlier one: what swings also rises, though it falls on the whole."""
    settled = (part.segment == part.segment[0]) & (part.time >= arrived + 5 * SETTLED)
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
    title = LATE
    travel, _, rest = travel_and_speed(part)
    inside = part.segment == part.segment[0]
    time, force = part.time[inside], part.force[inside]
    if not rest > 4 * SETTLED or travel * part.declared("Amplitude")[0] < 0.0:
        return not_made(title, "a hold after a ramp into the material")
    arrived = float(time[-1]) - rest + SETTLED
    early = force[(time >= arrived) & (time < arrived + SETTLED / 3)]
    after = force[time >= arrived]
    if early.size < 5 or not np.isfinite(after).all():
        return not_made(title, "readings within a third of a second after a ramp")
    means = np.convolve(after, np.full(early.size, 1.0 / early.size), "valid")
    rise, at = max(float(means.max() - early.mean()), 0.0), float(time[time >= arrived][int(np.argmax(means))])
    later = means[means.size // 2 :]
    places = np.linspace(-1.0, 1.0, later.size)
    wander = later - np.polyval(np.polyfit(places, later, 1), places)
    # one of so many running means lies four standard deviations off
    u = hypot(2 * float(wander.std()), 2e-3 * float(np.ptp(force)))
    text = (
        f"{name}, block {part.number + 1}: the force grows by {quantity(rise, 'N')} more while the stage stands, until "
        f"{quantity(at, 's')}"
    )
    cause = "the force is late: it was averaged or filtered for longer than its header says, or the stage crept on"
    return bounded(title, text, rise, u, at_most=0.0, is_law=False, file=name, line=part.header_line, cause=cause)


def phase(name: str, lag: float, u: float, frequency: float, record: str | None) -> Check:
    """Hold a phase lag [rad] against 0 to pi/2."""
    title = PHASE
    text = f"{name}: the force {'lags' if lag < 0.0 else 'leads'} by {abs(lag) * 180 / pi:.2f}° at {frequency:.3g} Hz"
    cause = "the columns are swapped, a sign is wrong, or the delay of the cell's filter is not what "
    cause += f"{record} says" if record else "its header says"
    cause += ", or the stage has play (backlash)" if lag < 0.0 else ""
    return bounded(title, text, lag, max(u, 1e-3), at_least=0.0, at_most=pi / 2, file=name, cause=cause)

"""Which comes first, the force or the motion that makes it: columns that were moved against each other in time.

While the stage has not moved no force grows, and while it goes on inwards none falls: the filter
of a cell only makes forces later. A position that lags breaks both laws at either end of a motion.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import Check, not_made, stated
from labpipe.report import quantity
from labpipe.signals import quantisation_step
from pipelines.experiments.shared.mach1_checks._parts import OSCILLATION, Part
from pipelines.experiments.shared.mach1_checks._titles import LEADS
from pipelines.experiments.shared.ramps_and_holds import RELAXATION

_STILL, _MOVES = 0.01, 0.02
"""Of its travel: as long as it has not gone so far a stage has not started; by so much it goes on within a reading."""
_FEWEST, _KNOWN = 4, 6  # readings of a motion, and of a rest before it that tell how its force goes on
_COARSE = 0.03  # of the travel, beyond which a step of the position hides its beginning
_SHARE, _IN_NOISE = 0.03, 8.0
"""Of the rise of a force, and standard deviations of its noise: what it may do out of order by averaging and chance."""


class _Motion(NamedTuple):
    """The readings of one ramp and what follows it, in its direction, or of one oscillation."""

    part: Part
    gone: Floats
    force: Floats
    rise: float
    noise: float


def force_follows(name: str, blocks: Sequence[Part]) -> Check:
    """Hold the beginning of each motion, and the end of each ramp, against the force that it makes."""
    motions = [motion for part in blocks if (motion := _motion_of(part)) is not None]
    if not motions:
        return not_made(LEADS, "a motion in the material whose position and force are resolved")
    found = [(each, motion) for motion in motions for each in (_before(motion), _while(motion))]
    (size, word, began, ended), motion = max(found, key=lambda one: one[0][0] / _allowed(one[1]))
    time, number = motion.part.time, motion.part.number + 1
    if size <= _allowed(motion):
        return stated(LEADS, f"{name}, block {number}: the force follows the stage", None, file=name)
    text = f"{name}, block {number}: {word} the force changes by {quantity(size, 'N')} from "
    text += f"{quantity(float(time[began]), 's')} to {quantity(float(time[ended]), 's')}"
    cause = (
        "the column of the position comes later than that of the force: rows of one of the two were moved, or the "
        f"position was filtered (columns of line {motion.part.header_line})"
    )
    line = motion.part.header_line + 1 + began
    return stated(LEADS, text, "impossible", cause=cause, file=name, line=line)


def _motion_of(part: Part) -> _Motion | None:
    if part.function not in (RELAXATION, OSCILLATION):
        return None
    is_ramp = part.function == RELAXATION
    first = part.segment == part.segment[0]
    x, force = part.position[first], part.force[first]
    if x.size <= _FEWEST or not np.isfinite(force + x).all():
        return None
    travel = float(np.median(x[x.size // 2 :]) - x[0]) if is_ramp else float(np.ptp(x))
    if not travel * part.declared("Amplitude")[0] > 0.0:
        return None
    gone = (x - x[0]) / travel
    arrived = int(np.argmax(gone > 1.0 - _STILL)) if is_ramp else x.size
    step = float(quantisation_step(x)) if np.unique(x).size > 1 else 0.0
    if arrived < _FEWEST or step > _COARSE * abs(travel):
        return None
    noise = float(1.4826 * np.median(np.abs(np.diff(force, 2))) / np.sqrt(6.0))
    noise = max(noise, float(quantisation_step(force)) if np.unique(force).size > 1 else 0.0)
    rise = float(force[: 2 * arrived + 2].max() - force[0]) if is_ramp else float(np.ptp(force))
    return _Motion(part, gone, force, rise, noise) if rise > _IN_NOISE * noise / _SHARE**0.5 else None


def _allowed(motion: _Motion) -> float:
    return max(_SHARE * motion.rise, _IN_NOISE * motion.noise)


def _before(motion: _Motion) -> tuple[float, str, int, int]:
    """Return by how much the force grows before the stage has moved."""
    still = int(np.argmax(np.abs(motion.gone) > _STILL))
    known = still - still // 3
    if not still or (motion.part.function == OSCILLATION and known < _KNOWN):
        return 0.0, "", 0, 0
    grown = motion.force[:still] - motion.force[0]
    if motion.part.function == OSCILLATION:
        # a force that relaxes goes on, and that of an oscillation may come with either sign
        rows = np.arange(still)
        grown = np.abs(grown - np.polyval(np.polyfit(rows[:known], grown[:known], 1), rows))
        grown[:known] = 0.0
    at = int(np.argmax(grown))
    began = 0 if motion.part.function == RELAXATION else known
    return float(grown[at]), "before the stage moves", began, at


def _while(motion: _Motion) -> tuple[float, str, int, int]:
    """Return by how much the force falls while each reading still goes on inwards as fast as any."""
    if motion.part.function != RELAXATION:
        return 0.0, "", 0, 0
    steps = np.diff(motion.gone)
    going = steps > max(0.5 * float(np.max(steps)), _MOVES)
    best = (0.0, "while the stage goes on inwards", 0, 0)
    for run in np.split(np.flatnonzero(going), np.flatnonzero(np.diff(np.flatnonzero(going)) > 1) + 1):
        if run.size < 3:
            continue
        force = motion.force[run[0] : run[-1] + 2]
        falls = np.maximum.accumulate(force) - force
        end = int(np.argmax(falls))
        if falls[end] > best[0]:
            best = float(falls[end]), best[1], int(run[0] + np.argmax(force[: end + 1])), int(run[0] + end)
    return best

"""Checks of the order of bounces: each lower than the one before, on a floor that stays."""

from dataclasses import replace
from math import hypot, isfinite

import numpy as np

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, Check, bounded, compared, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.fall_checks._fall import Fall, shown

_SWING = 0.07
"""Largest share of the first impact's speed that a plate, still swinging, adds to a later bounce.

A plate takes (1 + e) m/M of the speed and returns at most twice its own: 0.07 is a plate
55 times as heavy as what falls."""
BACKWARDS = "every bounce gives back more than it took: the record runs backwards in time"
_STAYS = 0.02  # of the fall, by which a plate that swings may be elsewhere when it is hit again


def restitution(fall: Fall) -> Check:
    """Hold every bounce against 0 < e < 1; after the first, a swinging plate may return some speed."""
    name = "coefficients of restitution"
    law = "a bounce gives back less than it took, but for what a plate that still swings returns: 0 < e < 1"
    values, u = fall.values("restitution"), fall.values("u_restitution")
    values = np.where(values > 1.0, np.maximum(values - _returned(fall), np.minimum(values, 1.0)), values)
    known = np.isfinite(values) & np.isfinite(u) & (u > 0)
    if not known.any():
        return not_made(name, law, "a bounce")
    beyond = np.where(known, (np.abs(values - 0.5) - 0.5) / np.where(u > 0, u, 1.0), -np.inf)
    worst = int(np.argmax(beyond))
    seen = float(fall.values("restitution")[worst])
    message = f"{fall.name}: e = {shown(seen, float(u[worst]), '1')} at impact {worst + 1}"
    check = bounded(
        name, law, message, float(values[worst]), float(u[worst]), at_least=0.0, at_most=1.0, file=fall.name
    )
    return _moved_later(check, beyond, worst)


def _moved_later(check: Check, beyond: Floats, worst: int) -> Check:
    """Say what gains height or speed after bounces that lose them, or at every bounce."""
    if beyond.size > 1 and np.all(beyond > DOUBTFUL):
        return replace(check, cause=BACKWARDS)
    if check.level is None or worst == 0 or (beyond[:worst] > DOUBTFUL).any():
        return check
    cause = (
        f"until impact {worst} the body bounces, then something else moves it: it was touched or lifted, or another "
        "drop follows in the record"
    )
    return replace(check, cause=cause)


def _returned(fall: Fall) -> Floats:
    """Return what a swinging plate may add to the restitution of each impact; 0 for the first."""
    into = fall.values("incoming_speed")
    share = _SWING * into[0] / np.where(into > 0, into, np.inf)
    return np.where(np.arange(into.size) > 0, np.nan_to_num(share), 0.0)


def apexes(fall: Fall) -> Check:
    """Hold the heights of all flights against their order; a swinging plate may return some height."""
    name = "heights of the rebounds"
    law = "no flight is higher than the one before it, but for what a plate that still swings returns"
    heights = np.concatenate([[float(fall.values("drop_height"))], fall.values("apex_height")])
    u = np.concatenate([[float(fall.values("u_drop_height"))], fall.values("u_apex_height")])
    # A height goes with the square of the speed.
    given = heights[:-1] * ((1.0 + _returned(fall)) ** 2 - 1.0)
    rises, u_rises = np.diff(heights) - np.nan_to_num(given), np.hypot(u[1:], u[:-1])
    known = np.isfinite(rises) & np.isfinite(u_rises) & (u_rises > 0)
    if not known.any():
        return not_made(name, law, "two flights")
    margin = np.where(known, rises / np.where(known, u_rises, 1.0), -np.inf)
    worst = int(np.argmax(margin))
    message = (
        f"{fall.name}: after impact {worst + 1} the body rises to "
        f"{quantity(float(heights[worst + 1]), 'm')} after {quantity(float(heights[worst]), 'm')}"
    )
    check = bounded(name, law, message, float(rises[worst]), float(u_rises[worst]), at_most=0.0, file=fall.name)
    return _moved_later(check, margin, worst)


def touch_levels(fall: Fall) -> Check:
    """Hold the displacement at every touch against that at the first."""
    name, law = "levels of the touches", "the floor stays where it is: every contact begins at one displacement"
    level, u = fall.values("touch_level"), fall.values("u_touch_level")
    if level.size < 2:
        return not_made(name, law, "two bounces")
    apart = np.abs(level - level[0])
    worst = int(np.argmax(apart))
    allowed = _STAYS * abs(fall.value("drop_height")[0]) + 4 * np.hypot(u, u[0])
    text = (
        f"{fall.name}: touch {worst + 1} lies {quantity(float(level[worst] - level[0]), 'm')} from the first one; "
        f"up to {quantity(float(allowed[worst]), 'm')} is allowed"
    )
    beyond = np.flatnonzero(apart > allowed)
    if not beyond.size:
        return stated(name, law, text, None, file=fall.name)
    at = quantity(float(fall.values("touch_time")[beyond[0]]), "s")
    cause = f"the bench sank, or the sensor, its clamp or the plate was knocked or crept, before {at}"
    return stated(name, law, text, "doubtful", cause=cause, file=fall.name)


def rest_level(fall: Fall, sag: float) -> Check:
    """Hold the level at rest against that of the first touch."""
    name, law = "level at rest", "the body comes to rest where it first touched, less its dent"
    rest, u_rest = fall.value("rest_level")
    touch, u_touch = fall.value("contact_level")
    if not isfinite(rest):
        return not_made(name, law, "a record that lasts until rest")
    deepest = float(np.nanmax(fall.values("penetration")))
    gap, u = rest - touch, hypot(u_rest, u_touch)
    message = f"{fall.name}: rest lies {shown(gap, u, 'm')} from first touch"
    return compared(
        name, law, message, gap, u, -sag, sag, allowance=max(deepest, 3 * sag), factor=False, file=fall.name
    )

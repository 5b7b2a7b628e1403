"""Checks of the flights: curved by g, as long as stated, begun at rest."""

from dataclasses import replace
from math import hypot, isfinite, nan, sqrt

import numpy as np
import xarray as xr

from labpipe.judging import Check, compared, in_words, not_made, stated
from labpipe.report import quantity
from labpipe.units import Quantity
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.fall_checks._fall import Fall, matched, shown

SPEED = "speed of the first impact"
GUIDE = 5e-3
"""Largest share of g that the friction of a guide or the drag of the air takes from a fall."""
_ROUGH = 3e-3  # of the fall, by which a body that trembles after an impact may leave its arc
_LET_GO, _HELD_READINGS, _SLIDES = 2e-3, 40, 0.02
"""Seconds that it takes to let a body go, readings that tell where it was held, and the share of its fall by which the
two may be apart: a thread that stretches, a magnet that lets go slowly."""
CLOCK = 1e-4
"""Relative uncertainty of a sampling interval as manufacturers state it."""


def acceleration(fall: Fall, gravity: Quantity) -> Check:
    """Hold the curvature of all flights against g."""
    name, law = "free-fall acceleration", "every flight of a falling body is curved by g"
    if "fall_acceleration" not in fall.bounces:
        return not_made(name, law, "flights between bounces")
    seen, own = fall.value("fall_acceleration")
    u = hypot(own, abs(seen) * hypot(fall.relative, 2 * CLOCK))
    ratio = seen / gravity.value
    times = f", {in_words(ratio)} times" if abs(ratio - 1) > 0.05 else " where"
    message = (
        f"{fall.name}: g comes out as {shown(seen, u, 'm/s2')}{times} {gravity.value:.4g} m/s²"
        f"{'' if abs(ratio - 1) > 0.05 else ' is expected'}"
    )
    return compared(
        name, law, message, seen, u, gravity.value, gravity.u, allowance=GUIDE * gravity.value, file=fall.name
    )


def height(fall: Fall, given: Quantity | None) -> Check:
    """Hold the measured fall against the stated height."""
    name, law = "height of the fall", "the fall that is seen is the fall that is stated"
    if given is None:
        return not_made(name, law, "a stated height")
    seen, own = fall.value("drop_height")
    u = hypot(own, seen * fall.relative)
    u_given = given.u or usual_uncertainty(given)
    assumed = "" if given.u else f", without ±: {quantity(u_given, 'm', 1)} is assumed"
    message = f"{fall.name}: the body fell {shown(seen, u, 'm')}, stated are {shown(*given)}{assumed}"
    return compared(name, law, message, seen, u, given.value, u_given, file="", setting="height", recording=fall.name)


def speed(fall: Fall, gravity: Quantity) -> Check:
    """Hold the speed of the first impact against that of a free fall from the seen height."""
    name, law = SPEED, "v² = 2 g h of the fall that is seen"
    seen, own = fall.value("incoming_speed", 0)
    h, u_h = fall.value("drop_height")
    expected = sqrt(2 * gravity.value * max(h, 0.0))
    # the scale of length is in both, once in v and half in the root of h
    u = hypot(own, seen * hypot(0.5 * fall.relative, CLOCK))
    message = f"{fall.name}: {shown(seen, u, 'm/s')} seen, {matched(expected, u, 'm/s')} expected"
    u_expected = 0.5 * expected * u_h / h if h > 0 else nan
    return compared(name, law, message, seen, u, expected, u_expected, allowance=GUIDE * expected, file=fall.name)


def release(fall: Fall, moved: xr.Dataset) -> Check:
    """Hold the level at which the body was held against that from which it fell."""
    name, law = "level of the release", "a body that is let go falls from where it was held"
    begun, direction = float(fall.values("release_time")), float(fall.bounces.attrs["direction"])
    time, x = moved["time"].values, moved["displacement"].values
    held = x[(time < begun - _LET_GO) & np.isfinite(x)]
    if held.size < _HELD_READINGS or not isfinite(begun):
        return not_made(name, law, f"{_HELD_READINGS} readings before the release")
    middle = float(np.median(held))
    level, spread = direction * (middle - float(fall.values("contact_level"))), float(np.std(held))
    fell, own = fall.value("drop_height")
    text = (
        f"{fall.name}: the body was held {quantity(level, 'm')} above its first touch and fell as from "
        f"{quantity(fell, 'm')}"
    )
    # it moves while it is let go, by what a fall of that time is long
    allowed = _SLIDES * abs(fell) + 0.5 * 9.81 * _LET_GO**2
    check = compared(name, law, text, level, hypot(own, spread), fell, 0.0, allowance=allowed)
    if check.level is None:
        return replace(check, file=fall.name)
    cause = (
        "the body was pushed or thrown at the release, or the sensor was clipped while it was held"
        if fell > level
        else "the body did not fall freely at first: it stuck, slid or was guided by hand; or the sensor was moved"
    )
    return replace(check, level="doubtful", cause=cause, file=fall.name)


def smooth_flights(fall: Fall) -> Check:
    """Hold what is left of the flights about the first impact against the noise before the release."""
    name, law = "smoothness of the flights", "nothing acts on a flying body but gravity: flights are arcs with noise"
    if "chi_square" not in fall.bounces:
        return not_made(name, law, "flights before and after an impact")
    ratio, noise = float(fall.values("chi_square")[0]), float(fall.bounces.attrs["noise"])
    height = fall.value("drop_height")[0]
    if not (isfinite(ratio) and isfinite(height)):
        return not_made(name, law, "flights before and after an impact")
    left = noise * sqrt(max(ratio - 1.0, 0.0))
    text = f"{fall.name}: flights leave their arcs by {quantity(left, 'm')}, the noise is {quantity(noise, 'm')}"
    is_rough = left > max(_ROUGH * height, 5 * noise)
    cause = "the sensor or its clamp shakes, the body swings or turns, or a filter of the sensor bends the flights"
    return stated(name, law, text, "doubtful" if is_rough else None, cause=cause, file=fall.name)


def flights_alike(fall: Fall, gravity: Quantity) -> Check:
    """Hold the duration of every flight against the speed with which it began."""
    name, law = "durations of the flights", "a flight lasts as long as its speeds say: 2 v/g"
    touch, u_touch = fall.values("touch_time"), fall.values("u_touch_time")
    leave, u_leave = fall.values("liftoff_time"), fall.values("u_liftoff_time")
    out, u_out = fall.values("outgoing_speed"), fall.values("u_outgoing_speed")
    into, u_into = fall.values("incoming_speed"), fall.values("u_incoming_speed")
    if touch.size < 3:
        return not_made(name, law, "three bounces")
    own = float(fall.values("fall_acceleration"))
    lasts = touch[1:] - leave[:-1]
    said = (out[:-1] + into[1:]) / (own if own > 0 else gravity.value)
    u = np.hypot(np.hypot(u_touch[1:], u_leave[:-1]), np.hypot(u_out[:-1], u_into[1:]) / abs(own))
    gaps = np.abs(lasts - said)
    known = np.isfinite(gaps) & np.isfinite(u) & (u > 0)
    if not known.any():
        return not_made(name, law, "three bounces")
    margin = np.where(known, gaps / np.where(known, u, 1.0), 0.0)
    worst = int(np.argmax(margin))
    at = quantity(float(leave[worst]), "s")
    message = (
        f"{fall.name}: the flight from {at} lasts {quantity(float(lasts[worst]), 's')}, "
        f"its speeds say {quantity(float(said[worst]), 's')}"
    )
    measured, u_measured, expected = float(lasts[worst]), float(u[worst]), float(said[worst])
    width, apart = 0.01 * measured, quantity(abs(expected - measured), "s", 2)
    cause = f"{apart} of this flight are missing, as where rows or frames are lost and those after them counted on"
    if measured > expected:
        cause = f"this flight holds {apart} too much, as where rows or frames stand twice, or the body was held in it"
    found = compared(
        name, law, message, measured, u_measured, expected, 0.0, allowance=width, factor=False, file=fall.name
    )
    return replace(found, cause=cause) if found.level else found


_OTHER_WAY = (
    "the sensor counts the other way than stated: sensor.direction in session.toml has the wrong sign "
    "(direction = -1 where the reading falls when the body rises)"
)


def direction(fall: Fall, cause: str = _OTHER_WAY, *, file: str = "", setting: str = "sensor.direction") -> Check:
    """Hold the direction in which a displacement counts against that of the fall."""
    name, law = "direction of the fall", "a body falls downwards: the displacement counts upwards"
    if int(fall.bounces.attrs["direction"]) == 1:
        return stated(name, law, f"{fall.name}: the body falls downwards", None, file=fall.name)
    text = f"{fall.name}: the body falls upwards and is thrown down by the impacts"
    return stated(name, law, text, "impossible", cause=cause, file=file, setting=setting)


def ends_early(fall: Fall, end: float) -> Check:
    """Say what a record that ends in the first flight does not hold."""
    name, law = "end of the record", "a record lasts until the body rests"
    text = f"{fall.name}: {fall.bounces.sizes['impact']} impacts until {quantity(end, 's')}"
    if fall.bounces.sizes["impact"] > 1:
        return stated(name, law, text, None, file=fall.name)
    text = f"{fall.name}: the record ends in the first flight, at {quantity(end, 's')}: one impact is measured"
    return stated(name, law, text, "note", file=fall.name, cause="the recording ends too soon")

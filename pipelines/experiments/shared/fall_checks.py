"""Checks of a record of a falling and bouncing body, whichever sensor saw it.

Free fall and the order of bounces are redundant: the curvature of every flight is g, the fall is
what the session states, and no bounce is higher than the one before. A factor in time or length
moves them by different powers, which tells the mistake.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, hypot, isfinite, nan, pi, sqrt

import numpy as np
import xarray as xr
from scipy import stats

from labpipe.judging import Check, Level, bounded, compared, not_made, stated
from labpipe.report import quantity, value_with_uncertainty
from labpipe.units import Quantity

GUIDE = 5e-3
"""Largest share of g that the friction of a guide or the drag of the air takes from a fall."""
_CLOCK = 1e-4
"""Relative uncertainty of a sampling interval as manufacturers state it."""
_FLAT = 6
"""Equal readings in a row that a moving body does not give."""
_SLOW = 0.05  # of the largest speed, below which a body may rest on one reading
_HUM = (50.0, 60.0)
_SURE = 1e-6  # probability by chance of a line in a spectrum that is told
_MATERIAL = 0.25
"""Standard uncertainty of the logarithm of a contact's duration, for a solid that is known by its
name: t goes with E*^-0.4, so that a factor of two in its modulus is one standard uncertainty."""
_PLAUSIBLE = (1e6, 5e10)  # Pa, contact moduli of whatever is dropped


@dataclass(frozen=True, slots=True)
class Fall:
    """One record of a drop as it was measured.

    Attributes
    ----------
    name : str
        File, for messages.
    bounces : Dataset
        As :func:`labpipe.signals.bounces` returns it.
    relative : float
        Relative standard uncertainty of its scale of length.
    """

    name: str
    bounces: xr.Dataset
    relative: float

    def value(self, name: str, impact: int | None = None) -> tuple[float, float]:
        """Return a quantity with the standard uncertainty of the record alone."""
        values, u = self.bounces[name].values, self.bounces[f"u_{name}"].values
        if impact is None:
            return float(values), float(u)
        return float(values[impact]), float(u[impact])


def shown(value: float, u: float, unit: str) -> str:
    """Write a value with its uncertainty."""
    return value_with_uncertainty(value, u, unit) if isfinite(u) and u > 0 else quantity(value, unit)


def acceleration(fall: Fall, gravity: Quantity) -> Check:
    """Hold the curvature of all flights against g."""
    name, law = "free-fall acceleration", "every flight of a falling body is curved by g"
    if "fall_acceleration" not in fall.bounces:
        return not_made(name, law, "flights between bounces")
    seen, own = fall.value("fall_acceleration")
    u = hypot(own, abs(seen) * hypot(fall.relative, 2 * _CLOCK))
    ratio = seen / gravity.value
    times = f", {ratio:.2f} times" if abs(ratio - 1) > 0.05 else " where"
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
    message = f"{fall.name}: the body fell {shown(seen, u, 'm')}, stated are {shown(*given)}"
    return compared(name, law, message, seen, u, given.value, given.u, file="", setting="height")


def speed(fall: Fall, gravity: Quantity) -> Check:
    """Hold the speed of the first impact against that of a free fall from the seen height."""
    name, law = "speed of the first impact", "v² = 2 g h of the fall that is seen"
    seen, own = fall.value("incoming_speed", 0)
    h, u_h = fall.value("drop_height")
    expected = sqrt(2 * gravity.value * max(h, 0.0))
    # the scale of length is in both, once in v and half in the root of h
    u = hypot(own, seen * hypot(0.5 * fall.relative, _CLOCK))
    message = f"{fall.name}: {shown(seen, u, 'm/s')} seen, {quantity(expected, 'm/s')} expected"
    return compared(
        name,
        law,
        message,
        seen,
        u,
        expected,
        0.5 * expected * u_h / h if h > 0 else nan,
        allowance=GUIDE * expected,
        file=fall.name,
    )


def restitution(fall: Fall) -> Check:
    """Hold every bounce against 0 < e < 1."""
    name, law = "coefficients of restitution", "a bounce gives back less than it took: 0 < e < 1"
    values, u = fall.bounces["restitution"].values, fall.bounces["u_restitution"].values
    known = np.isfinite(values) & np.isfinite(u) & (u > 0)
    if not known.any():
        return not_made(name, law, "a bounce")
    beyond = np.where(known, (np.abs(values - 0.5) - 0.5) / np.where(u > 0, u, 1.0), -np.inf)
    worst = int(np.argmax(beyond))
    message = f"{fall.name}: e = {shown(float(values[worst]), float(u[worst]), '1')} at impact {worst + 1}"
    return bounded(name, law, message, float(values[worst]), float(u[worst]), at_least=0.0, at_most=1.0, file=fall.name)


def apexes(fall: Fall) -> Check:
    """Hold the heights of all flights against their order."""
    name, law = "heights of the rebounds", "no flight is higher than the one before it"
    heights = np.concatenate([[float(fall.bounces["drop_height"])], fall.bounces["apex_height"].values])
    u = np.concatenate([[float(fall.bounces["u_drop_height"])], fall.bounces["u_apex_height"].values])
    rises, u_rises = np.diff(heights), np.hypot(u[1:], u[:-1])
    known = np.isfinite(rises) & np.isfinite(u_rises) & (u_rises > 0)
    if not known.any():
        return not_made(name, law, "two flights")
    margin = np.where(known, rises / np.where(known, u_rises, 1.0), -np.inf)
    worst = int(np.argmax(margin))
    message = (
        f"{fall.name}: after impact {worst + 1} the body rises to "
        f"{quantity(float(heights[worst + 1]), 'm')} after {quantity(float(heights[worst]), 'm')}"
    )
    return bounded(name, law, message, float(rises[worst]), float(u_rises[worst]), at_most=0.0, file=fall.name)


def flights_alike(fall: Fall, gravity: Quantity) -> Check:
    """Hold the duration of every flight against the speed with which it began."""
    name, law = "durations of the flights", "a flight lasts as long as its speeds say: 2 v/g"
    touch, u_touch = fall.bounces["touch_time"].values, fall.bounces["u_touch_time"].values
    leave, u_leave = fall.bounces["liftoff_time"].values, fall.bounces["u_liftoff_time"].values
    out, u_out = fall.bounces["outgoing_speed"].values, fall.bounces["u_outgoing_speed"].values
    into, u_into = fall.bounces["incoming_speed"].values, fall.bounces["u_incoming_speed"].values
    if touch.size < 3:
        return not_made(name, law, "three bounces")
    own = float(fall.bounces["fall_acceleration"])
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
    return compared(
        name,
        law,
        message,
        float(lasts[worst]),
        float(u[worst]),
        float(said[worst]),
        0.0,
        allowance=0.01 * float(lasts[worst]),
        factor=False,
        file=fall.name,
    )


def contact_duration(fall: Fall, radius: float, mass: float, contact_modulus: float | None) -> Check:
    """Hold the first contact's duration against Hertz for the stated sphere.

    t = 2.868 (m^2 / (R E*^2 v))^(1/5), Johnson, Contact Mechanics (1985), eq. (11.24).
    """
    name = "duration of the first contact"
    law = "Hertz: t = 2.87 (m²/(R E*² v))^(1/5) for the stated sphere"
    seen, own = fall.value("contact_duration", 0)
    v = float(fall.bounces["incoming_speed"][0])
    if not (isfinite(seen) and v > 0 and seen > 0):
        return not_made(name, law, "a first contact")

    def hertz(modulus: float) -> float:
        return float(2.868 * (mass**2 / (radius * modulus**2 * v)) ** 0.2)

    if contact_modulus is None:
        message = f"{fall.name}: {shown(seen, own, 's')}"
        return bounded(
            name,
            law,
            message,
            np.log(seen).item(),
            max(own / seen, 0.05),
            at_least=np.log(hertz(_PLAUSIBLE[1])).item(),
            at_most=np.log(hertz(_PLAUSIBLE[0])).item(),
            is_law=False,
            file=fall.name,
        )
    expected = hertz(contact_modulus)
    message = (
        f"{fall.name}: {shown(seen, own, 's')} seen, about {quantity(expected, 's')} expected "
        "for the stated sphere and material"
    )
    found = compared(name, law, message, seen, own, expected, _MATERIAL * expected, file=fall.name)
    if found.level is None and abs(np.log(seen / expected)) > np.log(3.0):
        return stated(name, law, message, "doubtful", file=fall.name)
    return found


def rest_level(fall: Fall, sag: float) -> Check:
    """Hold the level at rest against that of the first touch."""
    name, law = "level at rest", "the body comes to rest where it first touched, less its dent"
    rest, u_rest = fall.value("rest_level")
    touch, u_touch = fall.value("contact_level")
    if not isfinite(rest):
        return not_made(name, law, "a record that lasts until rest")
    deepest = float(np.nanmax(fall.bounces["penetration"].values))
    gap, u = rest - touch, hypot(u_rest, u_touch)
    message = f"{fall.name}: rest lies {shown(gap, u, 'm')} from first touch"
    return compared(
        name, law, message, gap, u, -sag, sag, allowance=max(deepest, 3 * sag), factor=False, file=fall.name
    )


def held_readings(name: str, time: np.ndarray, reading: np.ndarray, resolution: float) -> Check:
    """Look for a body that stands still at its highest or lowest reading while it should move."""
    title, law = "clipped or held readings", "a moving body gives no equal readings in a row"
    finite = np.isfinite(reading)
    if finite.sum() < 10 * _FLAT:
        return not_made(title, law, "readings")
    steps = np.abs(np.diff(reading))
    speed_scale = float(np.nanquantile(steps, 0.98))
    same = steps <= max(resolution, 0.0) * 0.5
    longest, start = _longest_run(same & np.isfinite(steps))
    lost = int((~finite).sum())
    span = slice(max(start - 1, 0), start + longest + 2)
    around = np.abs(np.diff(reading[max(start - 4, 0) : start + longest + 5]))
    jumps = np.nanmax(around) if around.size else 0.0
    is_moving = speed_scale > 3 * resolution and jumps > max(_SLOW * speed_scale, 3 * resolution)
    at = quantity(float(time[span][0]), "s")
    if longest >= _FLAT and is_moving:
        text = f"{name}: {longest + 1} equal readings in a row from {at}, in the middle of motion"
        return stated(
            title,
            law,
            text,
            "impossible",
            file=name,
            cause="the sensor was out of its range or held its last value: the impact is not "
            "measured there; move the sensor or choose a larger range",
        )
    text = f"{name}: no clipped readings" + (f", {lost} invalid" if lost else "")
    return stated(title, law, text, None, file=name)


def _longest_run(flags: np.ndarray) -> tuple[int, int]:
    """Return length and start of the longest run of true values."""
    if not flags.any():
        return 0, 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2]
    best = int(np.argmax(ends - starts))
    return int(ends[best] - starts[best]), int(starts[best])


def hum(name: str, time: np.ndarray, reading: np.ndarray, noise: float) -> Check:
    """Look for a line of the mains in the part of a record where the body is still."""
    title, law = ("noise of the record", "noise of a sensor has no line at the frequency of the mains")
    if time.size < 200:
        return not_made(title, law, "a part of the record in which the body is still")
    interval = float(np.median(np.diff(time)))
    x = reading - np.polynomial.Polynomial.fit(time, reading, 2)(time)
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
    frequency = np.fft.rfftfreq(x.size, interval)
    floor = float(np.median(power[1:])) / np.log(2)
    for line in _HUM:
        near = np.flatnonzero(np.abs(frequency - line) <= 1.5 / (x.size * interval))
        if not near.size or floor <= 0:
            continue
        height = float(power[near].max()) / floor
        if np.exp(-height) * near.size < _SURE:
            amplitude = 2 * sqrt(float(power[near].max())) / (0.5 * x.size)
            text = f"{name}: hum of {quantity(amplitude, 'm')} at {line:g} Hz"
            level: Level = "note" if amplitude < 20 * max(noise, 1e-12) else "doubtful"
            return stated(
                title, law, text, level, file=name, cause="mains hum: ground the sensor, or average over one period"
            )
    return stated(title, law, f"{name}: no line of the mains", None, file=name)


def repeats_alike(falls: Sequence[Fall], quantities: Sequence[tuple[str, str, str]]) -> list[Check]:
    """Hold the repeats of one drop against each other.

    Parameters
    ----------
    falls : sequence of Fall
    quantities : sequence of (str, str, str)
        Variable, title and unit; of variables over impacts the first one counts.
    """
    law = "repeats of one drop differ by what their scatter says"
    found = []
    for variable, title, unit in quantities:
        name = f"repeats: {title}"
        pairs = [_first(fall, variable) for fall in falls]
        if len(falls) < 3:
            found.append(not_made(name, law, "three repeats"))
            continue
        values, u = np.array([v for v, _ in pairs]), np.array([s for _, s in pairs])
        centre = float(np.median(values))
        apart = np.abs(values - centre)
        # robust: one repeat that is another drop must not hide itself in the scatter
        scatter = 1.4826 * float(np.median(apart)) * _small_sample(len(values))
        scale = np.hypot(u, scatter)
        worst = int(np.argmax(apart / scale))
        others = np.delete(np.arange(len(values)), worst)
        message = (
            f"{falls[worst].name}: {shown(float(values[worst]), float(u[worst]), unit)}, the other "
            f"repeats {quantity(float(np.median(values[others])), unit)}"
        )
        found.append(
            compared(
                name,
                law,
                message,
                float(values[worst]),
                float(scale[worst]),
                centre,
                0.0,
                allowance=0.02 * abs(centre),
                factor=False,
                file=falls[worst].name,
            )
        )
    return found


def _small_sample(n: int) -> float:
    """Return by how much a median deviation of few values must be widened."""
    return float(stats.t.ppf(0.975, n - 1) / stats.norm.ppf(0.975))


def _first(fall: Fall, variable: str) -> tuple[float, float]:
    values = np.atleast_1d(fall.bounces[variable].values)
    u = np.atleast_1d(fall.bounces[f"u_{variable}"].values)
    return float(values[0]), float(u[0])


def usual_angles(angle: float) -> Iterator[float]:
    """Yield factors of length by which mistakes with an inclination change a displacement.

    The correction divides by the cosine: left out, made twice, made with the complement, or with
    degrees taken for radians.
    """
    c = cos(angle)
    yield 1 / c
    yield c
    if abs(cos(pi / 2 - angle)) > 1e-3:
        yield c / cos(pi / 2 - angle)
        yield cos(pi / 2 - angle) / c

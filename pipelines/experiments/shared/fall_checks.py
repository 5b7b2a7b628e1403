"""Checks of a record of a falling and bouncing body, whichever sensor saw it.

Free fall and the order of bounces are redundant: the curvature of every flight is g, the fall is
what the session states, and no bounce is higher than the one before. A factor in time or length
moves them by different powers, which tells the mistake.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, hypot, inf, isfinite, log, log10, nan, pi, sqrt

import numpy as np
import xarray as xr
from scipy import special

from labpipe.arrays import Floats
from labpipe.judging import DOUBTFUL, IMPOSSIBLE, Check, Level, bounded, compared, not_made, stated
from labpipe.report import quantity, value_with_uncertainty
from labpipe.units import Quantity

SPEED = "speed of the first impact"
GUIDE = 5e-3
"""Largest share of g that the friction of a guide or the drag of the air takes from a fall."""
_ON_GROUND = (9.76, 9.84)  # m/s²: from the equator's mountains to the poles, by the International Gravity Formula
_ROUGH = 3e-3  # of the fall, by which a body that trembles after an impact may leave its arc
_LET_GO, _HELD_READINGS, _SLIDES = 2e-3, 40, 0.02
"""Seconds that it takes to let a body go, readings that tell where it was held, and the share of its fall by which the
two may be apart: a thread that stretches, a magnet that lets go slowly."""
_SWING = 0.07
"""Largest share of the first impact's speed that a plate, still swinging, adds to a later bounce.

A plate takes (1 + e) m/M of the speed and returns at most twice its own: 0.07 is a plate
55 times as heavy as what falls."""
_STAYS = 0.02  # of the fall, by which a plate that swings may be elsewhere when it is hit again
_LEAST_ROUGH = 2e-3  # of the fall, by which repeats may differ where they touch
_ENOUGH = 3  # repeats: of two nobody knows which is off
_LEVELS = ("touch_level", "u_touch_level")
_CLOCK = 1e-4
"""Relative uncertainty of a sampling interval as manufacturers state it."""
_HERTZ = 2.868
BY_NAME, MEASURED = 0.25, 0.1
"""Standard uncertainty of the logarithm of a contact's duration, for a solid that is known by its
name and for one whose modulus was measured: t goes with E*^-0.4, so that factors of two and of 1.3
in its modulus are one standard uncertainty."""
_SLIPPED, _SLIPS_APART = 2.0, 0.2
"""Standard uncertainties by which a slip of a unit may be missed, and the uncertainty beyond which
slips of a decimal can no longer be told from anything else."""
LIGHTEST = 800.0  # kg/m³, density of the lightest solid polymer
_RIDER = 1e4  # times the weight of such a sphere, that may rest on it
_PLASTIC = 3e8  # Pa, contact modulus above which a polymer is no rubber
_YIELDS, _LARGEST = 0.3, 0.8  # of a contact's radius over its sphere's: of a plastic, of any solid
_BY_HAND = 0.2
"""Relative, by which two repeats may differ since they were let go by hand."""
_SLIP = 0.02  # decades by which two repeats that differ by a slipped decimal may miss it
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


def gravity_stated(gravity: Quantity) -> Check:
    """Hold the stated acceleration of fall against those on the ground of the Earth."""
    name, law = "stated gravity", "on the ground g lies between 9.76 and 9.84 m/s²"
    text = f"g is stated as {quantity(gravity.value, 'm/s2')}"
    low, high = _ON_GROUND
    if low - gravity.u <= gravity.value <= high + gravity.u:
        return stated(name, law, text, None)
    cause = "model.gravity in session.toml is no acceleration of fall on Earth: digits were exchanged or lost"
    return stated(name, law, text, "impossible", cause=cause, setting="model.gravity")


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
    name, law = SPEED, "v² = 2 g h of the fall that is seen"
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


def release(fall: Fall, moved: xr.Dataset) -> Check:
    """Hold the level at which the body was held against that from which it fell."""
    name, law = "level of the release", "a body that is let go falls from where it was held"
    begun, direction = float(fall.bounces["release_time"]), float(fall.bounces.attrs["direction"])
    time, x = moved["time"].values, moved["displacement"].values
    held = x[(time < begun - _LET_GO) & np.isfinite(x)]
    if held.size < _HELD_READINGS or not isfinite(begun):
        return not_made(name, law, f"{_HELD_READINGS} readings before the release")
    middle = float(np.median(held))
    level, spread = direction * (middle - float(fall.bounces["contact_level"])), float(np.std(held))
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
    ratio, noise = float(fall.bounces["chi_square"].values[0]), float(fall.bounces.attrs["noise"])
    height = fall.value("drop_height")[0]
    if not (isfinite(ratio) and isfinite(height)):
        return not_made(name, law, "flights before and after an impact")
    left = noise * sqrt(max(ratio - 1.0, 0.0))
    text = f"{fall.name}: flights leave their arcs by {quantity(left, 'm')}, the noise is {quantity(noise, 'm')}"
    is_rough = left > max(_ROUGH * height, 5 * noise)
    cause = "the sensor or its clamp shakes, the body swings or turns, or a filter of the sensor bends the flights"
    level: Level | None = "doubtful" if is_rough else None
    return stated(name, law, text, level, cause=cause if is_rough else "", file=fall.name)


def restitution(fall: Fall) -> Check:
    """Hold every bounce against 0 < e < 1; after the first, a swinging plate may return some speed."""
    name = "coefficients of restitution"
    law = "a bounce gives back less than it took, but for what a plate that still swings returns: 0 < e < 1"
    values, u = fall.bounces["restitution"].values, fall.bounces["u_restitution"].values
    values = np.where(values > 1.0, np.maximum(values - _returned(fall), np.minimum(values, 1.0)), values)
    known = np.isfinite(values) & np.isfinite(u) & (u > 0)
    if not known.any():
        return not_made(name, law, "a bounce")
    beyond = np.where(known, (np.abs(values - 0.5) - 0.5) / np.where(u > 0, u, 1.0), -np.inf)
    worst = int(np.argmax(beyond))
    seen = float(fall.bounces["restitution"].values[worst])
    message = f"{fall.name}: e = {shown(seen, float(u[worst]), '1')} at impact {worst + 1}"
    check = bounded(
        name, law, message, float(values[worst]), float(u[worst]), at_least=0.0, at_most=1.0, file=fall.name
    )
    return _moved_later(check, beyond, worst)


def _moved_later(check: Check, beyond: Floats, worst: int) -> Check:
    """Say what gains height or speed after bounces that lose them."""
    if check.level is None or worst == 0 or (beyond[:worst] > DOUBTFUL).any():
        return check
    cause = (
        f"until impact {worst} the body bounces, then something else moves it: it was touched or lifted, or another "
        "drop follows in the record"
    )
    return replace(check, cause=cause)


def _returned(fall: Fall) -> Floats:
    """Return what a swinging plate may add to the restitution of each impact; 0 for the first."""
    into = fall.bounces["incoming_speed"].values
    share = _SWING * into[0] / np.where(into > 0, into, np.inf)
    return np.where(np.arange(into.size) > 0, np.nan_to_num(share), 0.0)


def apexes(fall: Fall) -> Check:
    """Hold the heights of all flights against their order; a swinging plate may return some height."""
    name = "heights of the rebounds"
    law = "no flight is higher than the one before it, but for what a plate that still swings returns"
    heights = np.concatenate([[float(fall.bounces["drop_height"])], fall.bounces["apex_height"].values])
    u = np.concatenate([[float(fall.bounces["u_drop_height"])], fall.bounces["u_apex_height"].values])
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


def touch_levels(fall: Fall) -> Check:
    """Hold the displacement at every touch against that at the first."""
    name, law = "levels of the touches", "the floor stays where it is: every contact begins at one displacement"
    level, u = fall.bounces["touch_level"].values, fall.bounces["u_touch_level"].values
    if level.size < 2:
        return not_made(name, law, "two bounces")
    apart = np.abs(level - level[0])
    worst = int(np.argmax(apart))
    allowed = _STAYS * abs(fall.value("drop_height")[0]) + 4 * np.hypot(u, u[0])
    text = (
        f"{fall.name}: touch {worst + 1} lies {quantity(float(level[worst] - level[0]), 'm')} from the first one, "
        f"{quantity(float(allowed[worst]), 'm')} may be"
    )
    beyond = np.flatnonzero(apart > allowed)
    if not beyond.size:
        return stated(name, law, text, None, file=fall.name)
    at = quantity(float(fall.bounces["touch_time"].values[beyond[0]]), "s")
    cause = f"the bench sank, or the sensor, its clamp or the plate was knocked or crept, before {at}"
    return stated(name, law, text, "doubtful", cause=cause, file=fall.name)


@dataclass(frozen=True, slots=True)
class Stiffness:
    """Contact modulus E* [Pa] of a body at a contact, and what is uncertain of its contact's duration.

    ``u_duration`` is the standard uncertainty of that duration's logarithm: t goes with E*^-0.4.
    """

    modulus: float
    u_duration: float

    @classmethod
    def by_name(cls, modulus: float) -> "Stiffness":
        """Of a solid that is known by its name alone."""
        return cls(modulus, BY_NAME)

    @classmethod
    def of_model(cls, model: xr.Dataset, radius: float, mass: float, *, is_measured: bool) -> "Stiffness":
        """By Hertz from the first contact of a simulation, for the sphere that was simulated."""
        duration, v = float(model["contact_duration"][0]), float(model["impact_speed"][0])
        modulus = sqrt((_HERTZ / duration) ** 5 * mass**2 / (radius * v))
        return cls(modulus, MEASURED if is_measured else BY_NAME)


def contact_duration(fall: Fall, radius: float, mass: float, stiffness: Stiffness | None, gravity: Quantity) -> Check:
    """Hold the first contact's duration against Hertz for the stated sphere.

    t = 2.868 (m^2 / (R E*^2 v))^(1/5), Johnson, Contact Mechanics (1985), eq. (11.24).
    """
    name = "duration of the first contact"
    law = "Hertz: t = 2.87 (m²/(R E*² v))^(1/5) for the stated sphere"
    seen, own = fall.value("contact_duration", 0)
    # with the scale of length that makes the fall one of g: that scale has its own check
    v = float(fall.bounces["incoming_speed"][0]) * gravity.value / float(fall.bounces["fall_acceleration"])
    if not (isfinite(seen) and v > 0 and seen > 0):
        return not_made(name, law, "a first contact")

    def hertz(modulus: float) -> float:
        return float(_HERTZ * (mass**2 / (radius * modulus**2 * v)) ** 0.2)

    if stiffness is None:
        shortest, longest = hertz(_PLAUSIBLE[1]), hertz(_PLAUSIBLE[0])
        message = (
            f"{fall.name}: {shown(seen, own, 's')} seen, {quantity(shortest, 's')} to {quantity(longest, 's')} would "
            "be those of the stated sphere on any solid"
        )
        check = bounded(
            name,
            law,
            message,
            np.log(seen).item(),
            max(own / seen, 0.05),
            at_least=np.log(shortest).item(),
            at_most=np.log(longest).item(),
            is_law=False,
            setting="sphere.mass",
        )
        word = "large" if seen < shortest else "small"
        cause = f"sphere.mass is too {word}: {quantity(mass, 'kg')} is in another unit than was typed (g, kg)"
        return replace(check, cause=cause) if check.level else check
    expected = hertz(stiffness.modulus)
    message = (
        f"{fall.name}: the first contact lasts {shown(seen, own, 's')}, about {quantity(expected, 's')} is expected "
        "for the stated sphere and material"
    )
    gap, u = float(np.log(seen / expected)), hypot(own / seen, stiffness.u_duration)
    level: Level | None = None
    if abs(gap) > DOUBTFUL * u:
        level = "impossible" if abs(gap) > max(IMPOSSIBLE * u, log(3.0)) else "doubtful"
    cause, setting = of_body(gap, u, radius, mass) if level else ("", "")
    if level and not cause and gap > 0:
        cause = (
            "the moving mass is larger, or the material softer, than stated; or the controller averages or filters the "
            "readings over such a time, which smears an impact"
        )
    file = "" if setting else fall.name
    return Check(name, law, message, level, gap / u, gap, u, cause=cause, file=file, setting=setting)


def of_body(gap: float, u: float, radius: float, mass: float) -> tuple[str, str]:
    """Say what a contact that is too short or too long tells of the body, and its setting.

    By Hertz t goes with m^0.4 R^-0.2 E*^-0.4: slips of a unit or a decimal in one of the two, else the
    mass that explains it, where the stiffness is known well enough.

    Parameters
    ----------
    gap : float
        Logarithm of the duration that is seen over that which is expected.
    u : float
        Its standard uncertainty.
    radius, mass : float
        As stated [m, kg].
    """
    given = (("sphere.mass", "the moving mass", mass, "kg", 0.4), ("sphere.radius", "the radius", radius, "m", -0.2))
    slips = [
        (abs(gap - power * log(k)), abs(log(k)), f"{what} is probably {quantity(value * k, si)}", setting)
        for setting, what, value, si, power in given
        for k in (10.0, 0.1, 100.0, 0.01, 1e3, 1e-3, *((25.4, 1 / 25.4) if si == "m" else ()))
        if (_is_body(radius * k, mass) if si == "m" else _is_body(radius, mass * k))
    ]
    # of two slips that explain it alike the smaller one is likelier
    off, _, said, setting = min(slips, key=lambda slip: (round(slip[0], 2), slip[1]), default=(inf, inf, "", ""))
    if off > _SLIPPED * min(u, _SLIPS_APART):
        if u > _SLIPS_APART:
            return "", ""
        setting = "sphere.mass"
        said = f"the moving mass is probably about {quantity(mass * exp(2.5 * gap), 'kg')}"
    stands = quantity(mass, "kg") if setting == "sphere.mass" else quantity(radius, "m")
    stiffer = f"or the sphere's material is about {exp(-2.5 * gap):.2g} times as stiff as stated"
    return f"{said}, not {stands} ({setting} in session.toml); {stiffer}", setting


def _is_body(radius: float, mass: float) -> bool:
    """Whether a sphere of a solid may be part of what falls, and not a vanishing one."""
    return 1.0 <= mass / (LIGHTEST * 4 / 3 * pi * radius**3) <= _RIDER


def strain(name: str, approach: float, radius: float, mass: float, speed: float) -> Check:
    """Hold the depth of a contact against what a sphere of that radius can bear.

    Hertz: a² = R δ, and the mean pressure is 4 a E*/(3 π R); the hardest plastics yield at a tenth
    of E* (Johnson, Contact Mechanics, 1985, section 6.1). Rubbers bear more, but stay spheres.

    Parameters
    ----------
    name : str
        What shows it, for the message.
    approach : float
        Largest approach of an impact [m].
    radius, mass : float
        As stated [m, kg].
    speed : float
        Of the impact [m/s].
    """
    title, law = "size of the contact", "a plastic yields before its contact is a third as wide as its sphere"
    if not (approach > 0.0 and speed > 0.0):
        return not_made(title, law, "a measured depth of the first contact")
    ratio = sqrt(approach / radius)
    modulus = 15 / 16 * mass * speed**2 / (sqrt(radius) * approach**2.5)
    limit = _YIELDS if modulus > _PLASTIC else _LARGEST
    text = (
        f"{name}: {quantity(approach, 'm')} deep in a sphere of {quantity(radius, 'm')}, a contact {ratio:.2g} times "
        "as wide as the sphere"
    )
    level: Level | None = "doubtful" if ratio > limit else None
    cause = (
        f"sphere.radius in session.toml is too small for so deep a contact: {quantity(radius, 'm')} is in another "
        "unit than was typed, or its decimal point slipped"
    )
    return stated(title, law, text, level, cause=cause if level else "", setting="sphere.radius")


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


def repeats_alike(falls: Sequence[Fall], quantities: Sequence[tuple[str, str, str]], cause: str = "") -> list[Check]:
    """Hold the repeats of one drop against each other.

    Parameters
    ----------
    falls : sequence of Fall
    quantities : sequence of (str, str, str)
        Variable, title and unit; of variables over impacts the first one counts.
    cause : str
        What a repeat that differs probably is.
    """
    law = "repeats of one drop differ by what their scatter says"
    found = []
    for variable, title, unit in quantities:
        name = f"repeats: {title}"
        pairs = [_first(fall, variable) for fall in falls]
        if len(falls) < 2:
            found.append(not_made(name, law, "two repeats"))
            continue
        if len(falls) == 2:
            found.append(_pair(name, law, falls, pairs, unit, cause))
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
        check = compared(
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
        found.append(replace(check, cause=cause) if check.level is not None else check)
    return found


def levels_alike(falls: Sequence[Fall]) -> Check:
    """Hold the levels of later touches, from the first, against those of the other repeats.

    A plate that swings after a blow is elsewhere at the next, but in all repeats alike.
    """
    name, law = "repeats: levels of the touches", "what moves between two contacts moves alike in all repeats of a drop"
    known = [fall for fall in falls if fall.bounces.sizes["impact"] > 1]
    if len(known) < _ENOUGH:
        return not_made(name, law, "three repeats with two touches")
    worst, text, at, file = 0.0, f"{len(known)} repeats: alike", "", ""
    for touch in range(1, min(fall.bounces.sizes["impact"] for fall in known)):
        levels, u = (np.array([fall.bounces[n].values[[0, touch]] for fall in known]) for n in _LEVELS)
        rise, own = levels[:, 1] - levels[:, 0], np.hypot(u[:, 0], u[:, 1])
        for i, fall in enumerate(known):
            others = np.delete(rise, i)
            # two others tell nothing of a scatter beyond what is known of each
            spread = float(np.median(np.abs(others - np.median(others)))) if others.size >= _ENOUGH else 0.0
            apart = float(rise[i] - np.median(others))
            scatter = hypot(float(np.median(own)), 1.4826 * spread)
            beyond = abs(apart) / (DOUBTFUL * hypot(own[i], scatter) + _LEAST_ROUGH * abs(fall.value("drop_height")[0]))
            if beyond > worst:
                worst, file = beyond, fall.name
                at = quantity(float(fall.bounces["touch_time"].values[touch]), "s")
                text = f"{file}: touch {touch + 1} lies {quantity(apart, 'm')} from where it lies in the other repeats"
    if worst <= 1.0:
        return stated(name, law, text, None, file=file)
    cause = f"the sensor, its cable or clamp, or the plate was knocked or pulled in this repeat, before {at}"
    return stated(name, law, text, "doubtful", cause=cause, file=file)


def _pair(
    name: str, law: str, falls: Sequence[Fall], pairs: Sequence[tuple[float, float]], unit: str, cause: str
) -> Check:
    """Hold two repeats against each other, whose scatter nobody knows: only what no hand does is told."""
    (first, u_first), (second, u_second) = pairs
    message = (
        f"{falls[1].name}: {shown(second, u_second, unit)}, {falls[0].name} "
        f"{quantity(first, unit)}, where repeats should agree"
    )
    allowance = _BY_HAND * min(abs(first), abs(second))
    check = compared(
        name, law, message, second, u_second, first, u_first, allowance=allowance, factor=False, file=falls[1].name
    )
    if check.level is None:
        return check
    slip = abs(log10(second / first)) if first * second > 0 else 0.0
    if slip > 0.5 and abs(slip - round(slip)) < _SLIP:
        cause = (
            f"lengths of the two differ by a factor {10 ** round(slip):g}: the unit or decimal point of one is wrong"
        )
    return replace(check, cause=cause or "one of the two is of another drop")


def _small_sample(n: int) -> float:
    """Return by how much a median deviation of few values must be widened."""
    return float(special.stdtrit(n - 1, 0.975) / special.ndtri(0.975))


def _first(fall: Fall, variable: str) -> tuple[float, float]:
    values = np.atleast_1d(fall.bounces[variable].values)
    u = np.atleast_1d(fall.bounces[f"u_{variable}"].values)
    return float(values[0]), float(u[0])


def direction(fall: Fall) -> Check:
    """Hold the stated direction of the sensor against that of the fall."""
    name, law = "direction of the fall", "a body falls downwards: the displacement counts upwards"
    if int(fall.bounces.attrs["direction"]) == 1:
        return stated(name, law, f"{fall.name}: the body falls downwards", None, file=fall.name)
    text = f"{fall.name}: the body falls upwards and is thrown down by the impacts"
    cause = (
        "the sensor counts the other way than stated: sensor.direction in session.toml has the wrong sign "
        "(direction = -1 where the reading falls when the body rises)"
    )
    return stated(name, law, text, "impossible", cause=cause, setting="sensor.direction")


def ends_early(fall: Fall, end: float) -> Check:
    """Say what a record that ends in the first flight does not hold."""
    name, law = "end of the record", "a record lasts until the body rests"
    text = f"{fall.name}: {fall.bounces.sizes['impact']} impacts until {quantity(end, 's')}"
    if fall.bounces.sizes["impact"] > 1:
        return stated(name, law, text, None, file=fall.name)
    text = f"{fall.name}: the record ends in the first flight, at {quantity(end, 's')}: one impact is measured"
    return stated(name, law, text, "note", file=fall.name, cause="the recording ends too soon")

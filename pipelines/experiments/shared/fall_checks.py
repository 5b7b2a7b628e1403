"""Redundancies of a falling and bouncing body, whichever sensor recorded it.

The curvature of every flight is g, the fall is the stated one, no bounce is higher than the one before, and by Hertz a
contact lasts as long as the stated sphere makes it. A factor in time or length moves these by different powers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite, pi
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy import special

from labpipe.judging import DOUBTFUL, Check, Level, bounded, compared, in_words, not_made
from labpipe.report import quantity, value_with_uncertainty as shown
from labpipe.signals import Floor
from labpipe.units import Quantity
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.judgements import Title, Titles

G, HEIGHT, DURATION = "free-fall acceleration", "height of the fall", "duration of the first contact"
_DIRECTION, _RESTITUTION = "direction of the fall", "coefficients of restitution"
OF_FALL: Titles = {
    "free fall": Title(
        "Every flight is a parabola with the acceleration of gravity, and a body at rest does not move.",
        (G, _DIRECTION, "course"),
    ),
    "order of the bounces": Title(
        "0 < e < 1: every rebound is lower than the one before, unless the plate vibrates.", (_RESTITUTION,)
    ),
}
"""Checks of every fall."""
BACKWARDS = "every bounce gives back more than it took: the record runs backwards in time"
_NOT_FREE = "the body did not fly freely (a guide that rubs, a thread, a hand), or bench or sensor moved"
_ROLLED = "the body rolled or turned under the spot of the laser, or floor, stand or sensor moved"
_MOVED = "the body was touched or lifted, or another drop follows in the record"
GUIDE = 5e-3
"""Largest share of g that the friction of a guide or the drag of the air takes from a fall."""
CLOCK = 1e-4
"""Relative uncertainty of a sampling interval or frame rate as manufacturers state it."""
SWING = 0.07
"""Largest share of the first impact's speed that a plate, still vibrating, adds to a later bounce: it takes (1 + e) m/M
of the speed and returns at most twice its own, 0.07 for a plate 55 times as heavy as the falling body."""
_BY_HAND = 0.2
"""Relative difference of two repeats that were released by hand."""


@dataclass(frozen=True, slots=True)
class Fall:
    """One record of a drop as it was measured.

    ``name`` is its file, for messages; ``bounces`` as :func:`labpipe.signals.bounces` returns them; ``relative`` the
    relative standard uncertainty of its scale of length.
    """

    name: str
    bounces: xr.Dataset
    relative: float

    def values(self, name: str) -> Any:
        """Return a quantity as its plain array: a DataArray takes longer to make than most checks to compute."""
        return self.bounces.variables[name].values

    def value(self, name: str, impact: int = 0) -> tuple[float, float]:
        """Return a quantity, of one impact where it has several, with the standard uncertainty of the record alone."""
        values, u = (np.atleast_1d(self.values(of)) for of in (name, f"u_{name}"))
        return float(values[impact]), float(u[impact])


def acceleration(fall: Fall, gravity: Quantity) -> Check:
    """Compare the curvature of all flights with g."""
    if "fall_acceleration" not in fall.bounces:
        return not_made(G, "flights between bounces")
    seen, own = fall.value("fall_acceleration")
    u, ratio = hypot(own, abs(seen) * hypot(fall.relative, 2 * CLOCK)), seen / gravity.value
    against = f", {in_words(ratio)} times" if abs(ratio - 1) > 0.05 else " for"
    text = f"{fall.name}: g comes out as {shown(seen, u, 'm/s2')}{against} {gravity.value:.4g} m/s²"
    place: dict[str, Any] = {"file": fall.name, "otherwise": _NOT_FREE}
    return compared(G, text, seen, u, *gravity[:2], allowance=GUIDE * gravity.value, **place)


def height(fall: Fall, given: Quantity) -> Check:
    """Compare the measured fall with the stated height."""
    seen, own = fall.value("drop_height")
    u, u_given = hypot(own, seen * fall.relative), given.u or usual_uncertainty(given)
    assumed = "" if given.u else f", without ±: {quantity(u_given, 'm', 1)} is assumed"
    text = f"{fall.name}: the body fell {shown(seen, u, 'm')}, the stated height is {shown(*given)}{assumed}"
    place: dict[str, Any] = {"recording": fall.name, "setting": "height"}
    place["otherwise"] = f"height in session.toml is not that of this drop, {_NOT_FREE} with it"
    return compared(HEIGHT, text, seen, u, given.value, u_given, **place)


def direction(fall: Fall, cause: str, *, file: str = "", setting: str = "") -> Check:
    """Compare the direction in which a displacement counts with that of the fall."""
    if int(fall.bounces.attrs["direction"]) == 1:
        return Check(_DIRECTION, f"{fall.name}: the body falls downwards", None, file=fall.name)
    text = f"{fall.name}: the body falls upwards and is thrown down by the impacts"
    return Check(_DIRECTION, text, "impossible", cause=cause, file=file, setting=setting)


def restitution(fall: Fall) -> Check:
    """Compare every bounce with 0 < e < 1; after the first, a vibrating plate may return some speed."""
    values, u, into = (fall.values(name) for name in ("restitution", "u_restitution", "incoming_speed"))
    returned = np.nan_to_num(SWING * into[0] / np.where(into > 0, into, np.inf)) * (np.arange(into.size) > 0)
    held = np.where(values > 1.0, np.maximum(values - returned, 1.0), values)
    known = np.isfinite(values) & np.isfinite(u) & (u > 0)
    if not known.any():
        return not_made(_RESTITUTION, "a bounce")
    beyond = np.where(known, (np.abs(held - 0.5) - 0.5) / np.where(u > 0, u, 1.0), -np.inf)
    worst = int(np.argmax(beyond))
    text = f"{fall.name}: e = {shown(float(values[worst]), float(u[worst]), '1')} at impact {worst + 1}"
    if values[worst] > 1.0 and returned[worst] > 0.0:
        text += f", at most {1.0 + returned[worst]:.2g} where a vibrating plate returns speed"
    cause = BACKWARDS if beyond.size > 1 and np.mean(beyond > DOUBTFUL) > 0.5 else _MOVED
    place: dict[str, Any] = {"at_least": 0.0, "at_most": 1.0, "file": fall.name, "cause": cause}
    return bounded(_RESTITUTION, text, float(held[worst]), float(u[worst]), **place)


def levels(fall: Fall, floor: Floor | None = None) -> Check:
    """Compare the levels of later touches and of rest with that of the first touch.

    They differ by no more than the deepest impact, and touches on a known ``floor`` by no more than an impact's own
    depth and the floor's oscillation: no dent is as deep as the impact on it, nor does a weight approach it as far.
    """
    depth = fall.values("penetration")
    level, u_level = (np.append(fall.values(f"{u}touch_level"), fall.values(f"{u}rest_level")) for u in ("", "u_"))
    gaps, u, allowed = level[1:] - level[0], np.hypot(u_level[1:], u_level[0]), np.full(depth.size, np.nanmax(depth))
    if floor is not None:
        blows = np.nan_to_num(fall.values("incoming_speed") + fall.values("outgoing_speed"))
        allowed[:-1] = depth[1:] + floor.share * np.linalg.norm(blows) / (2.0 * pi * floor.frequency)
    known = np.flatnonzero(np.isfinite(gaps * u * allowed))
    if not known.size:
        return not_made("level at rest", "two impacts, or a record that lasts until rest")
    k = known[np.argmax((np.abs(gaps) - allowed)[known] / u[known])]
    gap, own, where = float(gaps[k]), float(u[k]), "rest" if k == depth.size - 1 else f"touch {k + 2}"
    text = f"{fall.name}: {where} is {shown(gap, own, 'm')} from first touch"
    place: dict[str, Any] = {"allowance": float(allowed[k]), "file": fall.name, "otherwise": _ROLLED}
    check = compared("level at rest", text, gap, own, 0.0, 0.0, factor=False, **place)
    return check if not check.level or abs(gap) > np.nanmax(depth) else replace(check, level="doubtful")


class Repeated(NamedTuple):
    """A quantity that repeats have in common.

    ``variable`` of the results (of one over impacts the first counts), ``title``, ``unit``, and the relative
    differences of two repeats and of several that are ordinary.
    """

    variable: str
    title: str
    unit: str
    of_two: float = _BY_HAND
    of_several: float = 0.02


def repeats_agree(falls: Sequence[Fall], quantities: Sequence[Repeated], cause: str) -> list[Check]:
    """Compare repeats; ``cause`` is the probable cause of one that differs.

    Of several repeats their scatter is known, and the one that differs most is named; of two only a difference counts
    that no release by hand makes.
    """
    found = list[Check]()
    for variable, title, unit, of_two, of_several in quantities:
        name, is_pair = f"repeats: {title}", len(falls) == 2
        if len(falls) < 2:
            found.append(not_made(name, "two repeats"))
            continue
        values, u = np.array([fall.value(variable) for fall in falls]).T
        ordinary, centre, scale = of_two, float(values[0]), np.full(2, hypot(u[0], u[-1]))
        if not is_pair:
            # robust: one repeat that is another drop must not hide itself in the scatter
            few = float(special.stdtrit(len(values) - 1, 0.975) / special.ndtri(0.975))
            ordinary, centre = of_several, float(np.median(values))
            scale = np.hypot(u, 1.4826 * float(np.median(np.abs(values - centre))) * few)
        worst = int(np.argmax(np.abs(values - centre) / scale))
        seen, own, file = float(values[worst]), float(u[worst]), falls[worst].name
        size = float(np.abs(values).min()) if is_pair else abs(centre)
        others = shown(float(np.median(np.delete(values, worst))), own, unit)
        text = f"{file}: {title} {shown(seen, own, unit)}, the other repeats {others}"
        text += f"; allowed scatter {100 * ordinary:g} %"
        # of two nobody knows which is right, nor how much a body scatters
        said = f"either of the two files may be the one: {cause}" if is_pair else cause
        place: dict[str, Any] = {"allowance": ordinary * size, "factor": False, "file": file, "cause": said}
        check = compared(name, text, seen, float(scale[worst]), centre, 0.0, **place)
        if check.level:
            level: Level = "doubtful" if is_pair and abs(seen - centre) < _BY_HAND * size else check.level
            check = replace(check, message=f"{text}; all repeats are in the means", level=level)
        found.append(check)
    return found


def contact_duration(fall: Fall, known: tuple[float, float] | None, gravity: Quantity, u: float) -> Check:
    """Compare the first contact's duration with the one ``known`` [s] at a speed [m/s] for the stated sphere.

    ``u`` is the relative standard uncertainty of the modulus E*, with which by Hertz t ~ E*^-0.4 v^-0.2 goes.
    """
    seen, own = fall.value("contact_duration")
    # with the scale of length that makes the fall one of g: that scale has its own check
    v = fall.value("incoming_speed")[0] * gravity.value / float(fall.values("fall_acceleration"))
    if known is None or not (isfinite(seen) and v > 0 and seen > 0):
        return not_made(DURATION, "a first contact, and a material")
    expected = known[0] * (known[1] / v) ** 0.2
    text = f"{fall.name}: the first contact lasts {shown(seen, own, 's')}, about {quantity(expected, 's')} is expected "
    text += "for the stated sphere and material"
    return compared(DURATION, text, seen, hypot(own, 0.4 * u * seen), expected, 0.0, file=fall.name)


def body_stated(radius: float, mass: float, lightest: float = 800.0) -> Check:
    """Compare a stated mass with the least weight of a sphere of that radius, of the ``lightest`` polymer [kg/m³]."""
    name, least = "mass of the falling body", lightest * 4 / 3 * pi * radius**3
    text = f"{quantity(mass, 'kg')} with a sphere that weighs at least {quantity(least, 'kg')}"
    cause = "sphere.mass or sphere.radius is in another unit than was typed, or a diameter was typed"
    return Check(name, text, "impossible" if mass < least else None, cause=cause, setting="sphere.mass")

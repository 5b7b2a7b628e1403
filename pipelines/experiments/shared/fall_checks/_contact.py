"""Checks of a contact: as long and as deep as the stated sphere makes it."""

from dataclasses import dataclass
from math import exp, hypot, inf, isfinite, log, nan, pi, sqrt

import numpy as np
import xarray as xr

from labpipe.judging import DOUBTFUL, IMPOSSIBLE, Check, Level, bounded, in_words, not_made, stated
from labpipe.report import quantity
from labpipe.units import Quantity
from pipelines.experiments.shared.fall_checks._fall import Fall, shown

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
_POLYMERS = (1e6, 1.2e10)  # Pa, contact moduli of polymers, from soft rubber to hard thermoset
_PLAUSIBLE = (1e6, 5e10)  # Pa, contact moduli of whatever is dropped


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
    v = float(fall.bounces["incoming_speed"][0]) * gravity.value / float(fall.values("fall_acceleration"))
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
        ends = {"at_least": np.log(shortest).item(), "at_most": np.log(longest).item()}
        seen_log, u = np.log(seen).item(), max(own / seen, 0.05)
        word = "large" if seen < shortest else "small"
        cause = f"sphere.mass is too {word}: {quantity(mass, 'kg')} is in another unit than was typed (g, kg)"
        return bounded(name, law, message, seen_log, u, **ends, is_law=False, setting="sphere.mass", cause=cause)
    expected = hertz(stiffness.modulus)
    message = (
        f"{fall.name}: the first contact lasts {shown(seen, own, 's')}, about {quantity(expected, 's')} is expected "
        "for the stated sphere and material"
    )
    gap, u = float(np.log(seen / expected)), hypot(own / seen, stiffness.u_duration)
    level: Level | None = None
    if abs(gap) > DOUBTFUL * u:
        level = "impossible" if abs(gap) > max(IMPOSSIBLE * u, log(3.0)) else "doubtful"
    cause, setting = of_body(gap, u, radius, mass, stiffness.modulus) if level else ("", "")
    if level and not cause and gap > 0:
        cause = (
            "the moving mass is larger, or the material softer, than stated; or the controller averages or filters the "
            "readings over such a time, which smears an impact"
        )
    file = "" if setting else fall.name
    return Check(name, law, message, level, gap / u, gap, u, cause=cause, file=file, setting=setting)


def of_body(gap: float, u: float, radius: float, mass: float, modulus: float = nan) -> tuple[str, str]:
    """Say what a contact that is too short or too long tells of the body, and its setting.

    By Hertz t goes with m^0.4 R^-0.2 E*^-0.4: slips of a unit or a decimal in one of the two, else
    another material, or the mass that explains it, where the stiffness is known well enough. ``gap`` is
    the logarithm of the duration that is seen over that which is expected. With the modulus E* [Pa] of
    the stated material another polymer that would explain it is named before a slip.
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
    stiffer = f"the sphere's material is about {in_words(exp(-2.5 * gap), 2)} times as stiff as stated"
    if off > _SLIPPED * min(u, _SLIPS_APART):
        if u > _SLIPS_APART:
            return "", ""
        said = f"the moving mass is probably about {quantity(mass * exp(2.5 * gap), 'kg')}, not {quantity(mass, 'kg')}"
        return f"{stiffer}, of another material then; or {said} (sphere.mass in session.toml)", "sphere"
    stands = quantity(mass, "kg") if setting == "sphere.mass" else quantity(radius, "m")
    slipped = f"{said}, not {stands} ({setting} in session.toml)"
    if _POLYMERS[0] < modulus * exp(-2.5 * gap) < _POLYMERS[1]:
        return f"{stiffer}, of another material then; or {slipped}", setting
    return f"{slipped}; or {stiffer}", setting


def body_stated(radius: float, mass: float) -> Check:
    """Hold a stated mass against what a sphere of that radius weighs at least, and can carry."""
    name, law = "mass of the falling body", "what falls weighs as much as its sphere, or more by a holder"
    least = LIGHTEST * 4 / 3 * pi * radius**3
    text = f"{quantity(mass, 'kg')} with a sphere that weighs at least {quantity(least, 'kg')}"
    is_light = mass < least
    if _is_body(radius, mass):
        return stated(name, law, text, None, setting="sphere.mass")
    cause = "sphere.mass or sphere.radius is in another unit than was typed"
    cause += ", or a diameter was typed" if is_light else ", or has lost its decimal point"
    return stated(name, law, text, "impossible" if is_light else "doubtful", cause=cause, setting="sphere.mass")


def _is_body(radius: float, mass: float) -> bool:
    """Whether a sphere of a solid may be part of what falls, and not a vanishing one."""
    return 1.0 <= mass / (LIGHTEST * 4 / 3 * pi * radius**3) <= _RIDER


def strain(name: str, approach: float, radius: float, mass: float, speed: float) -> Check:
    """Hold the largest approach [m] of an impact against what a sphere of that radius can bear.

    Hertz: a² = R δ, and the mean pressure is 4 a E*/(3 π R); the hardest plastics yield at a tenth
    of E* (Johnson, Contact Mechanics, 1985, section 6.1). Rubbers bear more, but stay spheres.
    """
    title, law = "size of the contact", "a plastic yields before its contact is a third as wide as its sphere"
    if not (approach > 0.0 and speed > 0.0):
        return not_made(title, law, "a measured depth of the first contact")
    ratio = sqrt(approach / radius)
    modulus = 15 / 16 * mass * speed**2 / (sqrt(radius) * approach**2.5)
    limit = _YIELDS if modulus > _PLASTIC else _LARGEST
    text = (
        f"{name}: {quantity(approach, 'm')} deep in a sphere of {quantity(radius, 'm')}, a contact "
        f"{in_words(ratio, 2)} times as wide as the sphere"
    )
    cause = (
        f"sphere.radius in session.toml is too small for so deep a contact: {quantity(radius, 'm')} is in another "
        "unit than was typed, or its decimal point slipped"
    )
    return stated(title, law, text, "doubtful" if ratio > limit else None, cause=cause, setting="sphere.radius")

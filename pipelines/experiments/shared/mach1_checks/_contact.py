"""Checks of the stated punch, and of a force at its depth against what a polymer would give."""

from dataclasses import replace
from math import isfinite, log

import numpy as np

from labpipe.contact.line import westergaard
from labpipe.judging import Check, Level, bounded, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.mach1_checks._titles import MODULUS, RATIO
from pipelines.experiments.shared.punch_settings import IndentationModel, Punch, Substrate

_LARGEST_PUNCH, _LARGE_PUNCH = 0.5, 0.15  # m, either way
_POLYMER = (1e6, 1e10)  # Pa, reduced moduli of whatever is indented
_U_RANGE = 0.25  # of the logarithm of a modulus at the ends of that range
_U_MATERIAL = 0.5  # of the logarithm of the force for a solid that is known by its name
_U_LAYER = 2.3  # the same where a thin layer stiffens the contact


def of_punch(punch: Punch | None, substrate: Substrate | None, model: IndentationModel, deepest: float) -> list[Check]:
    """Check the geometry that the session states against itself and the largest depth [m]."""
    title = "size of the punch"
    if punch is None:
        return [not_made(title, "a punch")]
    found = []
    for setting, size, what in (
        ("punch.depth", punch.depth.value, "length of a tip"),
        ("punch.radius", punch.radius.value, "radius of a tip"),
        ("punch.tips", punch.tips * punch.period.value, f"{punch.tips} tips {quantity(punch.period.value, 'm')} apart"),
    ):
        level: Level | None = "impossible" if size > _LARGEST_PUNCH else "doubtful" if size > _LARGE_PUNCH else None
        text = f"{what}: {quantity(size, 'm')}"
        if level is not None:
            cause = f"{setting} in session.toml is wrong: its unit, or its number"
            cause += "; or punch.period is" if setting == "punch.tips" else ""
            found.append(stated(title, text, level, cause=cause, setting=setting))
    if not found:
        found.append(stated(title, f"{punch.tips} tips of {quantity(punch.depth.value, 'm')} fit", None))
    found.append(_valleys(punch, model, deepest))
    found.append(_bottom(punch, substrate, deepest))
    return found


def _valleys(punch: Punch, model: IndentationModel, deepest: float) -> Check:
    title = "period of the punch"
    if not deepest > 0.0 or model.profile == "cosine":
        return not_made(title, "a depth, and tips that are no waves")
    share = deepest / westergaard.full_contact(punch.radius.value, punch.period.value, "parabola")
    level: Level | None = "impossible" if share > 1.0 else "doubtful" if share > 0.5 else None
    width = 2 * (2 * punch.radius.value * deepest) ** 0.5
    text = (
        f"at a depth of {quantity(deepest, 'm')} a tip of {quantity(punch.radius.value, 'm')} meets the surface over "
        f"{quantity(width, 'm')}; the period is {quantity(punch.period.value, 'm')}"
    )
    cause = "punch.period in session.toml is too small for these tips, or punch.radius is too large"
    return stated(title, text, level, cause=cause, setting="punch.period")


def _bottom(punch: Punch, substrate: Substrate | None, deepest: float) -> Check:
    title = "depth of the indentation"
    if not deepest > 0.0:
        return not_made(title, "a position of first touch")
    limits = [(punch.radius.value, "the tip's radius", "punch.radius")]
    if substrate is not None and substrate.thickness is not None:
        limits.append((substrate.thickness.value, "the sheet's thickness", "substrate.thickness"))
    limit, what, setting = min(limits)
    level: Level | None = "impossible" if deepest > limit else "doubtful" if deepest > 0.5 * limit else None
    text = f"{quantity(deepest, 'm')} deep; {what} is {quantity(limit, 'm')}"
    cause = f"{setting} in session.toml, or the position of first touch, is wrong"
    return stated(title, text, level, cause=cause, setting=setting)


def of_force(
    name: str, punch: Punch | None, substrate: Substrate | None, depth: float, force: float, expected: float
) -> list[Check]:
    """Hold a force [N] at a depth [m] against what any polymer, and the named one, would give.

    ``expected`` is the force of the model, NaN where there is none. Both are plausible ranges:
    what lies outside is doubtful, never impossible.
    """
    found: list[Check] = []
    layer = None if substrate is None else substrate.thickness
    is_thin = layer is not None and punch is not None and layer.value < 5 * (punch.radius.value * depth) ** 0.5
    closed = 0.0 if punch is None else westergaard.full_contact(punch.radius.value, punch.period.value, "parabola")
    if punch is None or not (0.0 < depth < closed and force > 0.0):
        found.append(not_made(MODULUS, "a punch, a depth that leaves valleys, and a force in compression"))
    else:
        radius, period, length = punch.radius.value, punch.period.value, punch.depth.value * punch.tips
        state = westergaard.from_displacement(np.array([depth]), radius, period, 1.0, "parabola")
        modulus = force / (float(np.atleast_1d(state.force)[0]) * length)
        text = f"{name}: {quantity(force, 'N')} at {quantity(depth, 'm')} take a reduced modulus of "
        text += quantity(modulus, "Pa")
        u = _U_LAYER if is_thin else _U_RANGE
        ends = [log(end) for end in _POLYMER]
        check = bounded(MODULUS, text, log(modulus), u, at_least=ends[0], at_most=ends[1], is_law=False, file=name)
        if check.level is not None:
            cause = "the unit of the column of the force, or punch.tips or punch.depth in session.toml, is wrong"
            check = replace(check, cause=cause)
        found.append(check)
    if not (isfinite(expected) and expected > 0.0 and force > 0.0):
        found.append(not_made(RATIO, "a model"))
    else:
        ratio = log(force / expected)
        text = f"{name}: {quantity(force, 'N')} measured, {quantity(expected, 'N')} expected of the named material"
        check = bounded(RATIO, text, abs(ratio), _U_MATERIAL, at_most=0.0, is_law=False, file=name)
        found.append(replace(check, log_ratio=ratio, u_log_ratio=_U_MATERIAL))
    return found

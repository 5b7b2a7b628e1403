"""Checks of the repeats of one drop against each other."""

from collections.abc import Sequence
from dataclasses import replace
from math import log10

import numpy as np
from scipy import special

from labpipe.judging import DOUBTFUL, Check, compared, in_words, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.shared.fall_checks._fall import Fall, matched, shown

LEAST_ROUGH = 2e-3  # of the fall, by which repeats may differ where they touch
_ENOUGH = 3  # repeats: of two nobody knows which is off
_LEVELS = ("touch_level", "u_touch_level")
_BY_HAND = 0.2
"""Relative, by which two repeats may differ since they were let go by hand."""
_OF_BODY = {"restitution": 0.05}  # the same of what one body shows however it was let go, spinning or on another spot
_SLIP = 0.02  # decades by which two repeats that differ by a slipped decimal may miss it


def repeats_alike(falls: Sequence[Fall], quantities: Sequence[tuple[str, str, str]], cause: str = "") -> list[Check]:
    """Hold the repeats of one drop against each other; ``cause`` says what a repeat that differs probably is.

    A quantity is a variable, its title and unit; of variables over impacts the first one counts.
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
            found.append(_pair(name, law, falls, pairs, unit, _OF_BODY.get(variable, _BY_HAND)))
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
            f"repeats {matched(float(np.median(values[others])), float(u[worst]), unit)}"
        )
        seen, u_seen, file = float(values[worst]), float(scale[worst]), falls[worst].name
        allowance = 0.02 * abs(centre)
        check = compared(name, law, message, seen, u_seen, centre, 0.0, allowance=allowance, factor=False, file=file)
        found.append(replace(check, cause=cause))
    return found


def levels_alike(falls: Sequence[Fall]) -> Check:
    """Hold the levels of later touches, from the first, against those of the other repeats.

    A plate that swings after a blow is elsewhere at the next, but in all repeats alike.
    """
    name, law = "repeats: levels of the touches", "what moves between two contacts moves alike in all repeats of a drop"
    known = [fall for fall in falls if fall.bounces.sizes["impact"] > 1]
    if len(known) < _ENOUGH:
        return not_made(name, law, "three repeats with two touches")
    touches = min(fall.bounces.sizes["impact"] for fall in known)
    levels, u = (np.array([fall.values(n)[:touches] for fall in known]) for n in _LEVELS)
    rise, own = levels[:, 1:] - levels[:, :1], np.hypot(u[:, 1:], u[:, :1])
    others = np.array([np.delete(rise, i, axis=0) for i in range(len(known))])
    centre = np.median(others, axis=1)
    # two others tell nothing of a scatter beyond what is known of each
    is_told = others.shape[1] >= _ENOUGH
    spread = np.median(np.abs(others - centre[:, None]), axis=1) if is_told else np.zeros_like(centre)
    # what moved the sensor widens the uncertainty of its own record, which would hide it
    usual = np.median(own, axis=0)
    rough = np.array([LEAST_ROUGH * abs(fall.value("drop_height")[0]) for fall in known])
    scatter = np.hypot(usual, np.hypot(usual, 1.4826 * spread))
    beyond = np.nan_to_num(np.abs(rise - centre) / (DOUBTFUL * scatter + rough[:, None]), nan=0.0)
    # of equal ones the earliest touch
    touch, i = np.unravel_index(int(np.argmax(beyond.T)), beyond.T.shape)
    worst, file = float(beyond[i, touch]), known[i].name
    at = quantity(float(known[i].values("touch_time")[touch + 1]), "s")
    apart = quantity(float(rise[i, touch] - centre[i, touch]), "m")
    text = f"{file}: touch {touch + 2} lies {apart} from where it lies in the other repeats"
    if worst <= 1.0:
        return stated(name, law, text, None, file=file)
    cause = f"the sensor, its cable or clamp, or the plate was knocked or pulled in this repeat, before {at}"
    return stated(name, law, text, "doubtful", cause=cause, file=file)


def _pair(
    name: str, law: str, falls: Sequence[Fall], pairs: Sequence[tuple[float, float]], unit: str, differs: float
) -> Check:
    """Hold two repeats against each other, whose scatter nobody knows: only what no hand does is told."""
    (first, u_first), (second, u_second) = pairs
    message = (
        f"{falls[1].name}: {shown(second, u_second, unit)}, {falls[0].name} "
        f"{matched(first, u_second, unit)}, where repeats should agree"
    )
    least = min(abs(first), abs(second))
    check = compared(
        name,
        law,
        message,
        second,
        u_second,
        first,
        u_first,
        allowance=differs * least,
        factor=False,
        file=falls[1].name,
    )
    if check.level is None:
        return check
    if check.level == "impossible" and abs(second - first) < _BY_HAND * least:
        check = replace(check, level="doubtful")  # how much a body scatters, two drops of it do not tell
    cause = "one of the two is of another drop or another body"
    slip = abs(log10(second / first)) if first * second > 0 else 0.0
    if slip > 0.5 and abs(slip - round(slip)) < _SLIP:
        factor = in_words(10.0 ** round(slip))
        cause = f"lengths of the two differ by a factor {factor}: the unit or decimal point of one is wrong"
    return replace(check, cause=cause)


def _small_sample(n: int) -> float:
    """Return by how much a median deviation of few values must be widened."""
    return float(special.stdtrit(n - 1, 0.975) / special.ndtri(0.975))


def _first(fall: Fall, variable: str) -> tuple[float, float]:
    values = np.atleast_1d(fall.values(variable))
    u = np.atleast_1d(fall.values(f"u_{variable}"))
    return float(values[0]), float(u[0])

"""Whether a master curve can be trusted: one verdict from everything that contradicts it.

Storage and loss may obey Kramers and Kronig although the sweeps do not superpose, and a fit may
follow the sweeps to their scatter although its vertical factors are those of no material. So the
verdict asks all of it: residuals against the scatter and in absolute terms, causality, the
vertical law, and the alternative of two processes that shift apart.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from labpipe.materials.spectrum import KramersKronig
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._model_doubt import ROUGH, VIOLATED
from labpipe.materials.superposition._outlying import LEAST_POINTS
from labpipe.materials.superposition._reweighting import Superposition
from labpipe.materials.superposition._shift_parameters import CHANGE, CHANGE_SHARE, LEAST_SPACING

Level = Literal["pass", "doubtful", "fail"]

# Residuals over scatter from which no smaller error explains them; and relative residuals of which no
# part is a rheometer's noise (those of ROUGH are doubtful).
_FAR_BEYOND = 3.0
_HOPELESS = {"storage": 0.15, "loss": 0.30}
# Shifts that differ by less (decades) between one process and two are the same for most uses.
_SAME_SHIFT = 0.15
# Changes of the step from one pair to the next, in units of what materials do, that count as abrupt; and
# isotherms that two steps and their usual size need.
_ABRUPT, _LEAST_STEPS = 1.0, 4
# Root mean square by which fits from other slopes of a glass may differ (decades).
_LOOSE_SLOPE = 0.3


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether time-temperature superposition holds.

    Attributes
    ----------
    level : {"pass", "doubtful", "fail"}
    reasons : tuple of str
        Everything that speaks against it, one sentence each; empty for a pass.
    is_violated : bool
        Whether no shifts make the sweeps one curve to their scatter.
    """

    level: Level
    reasons: tuple[str, ...]
    is_violated: bool = False


def verdict_on(points: Points, found: Superposition, kk: KramersKronig) -> Verdict:
    """Judge a fit."""
    objections = [
        *_two_processes(found),
        *_residuals(found),
        *_search(points),
        *_vertical(found),
        *_slopes(found),
        *_steps(points, found),
        *_causality(kk),
    ]
    order: tuple[Level, ...] = ("pass", "doubtful", "fail")
    worst = max((order.index(level) for level, _ in objections), default=0)
    return Verdict(order[worst], tuple(reason for _, reason in objections), found.violation > VIOLATED)


def _two_processes(found: Superposition) -> Iterator[tuple[Level, str]]:
    if found.rival is None or found.rival.belief < 1.0:
        return
    change = np.abs(found.rival.log10_aT - found.fit.state.log10_aT)
    worst = int(np.argmax(change))
    yield (
        "fail" if change[worst] > _SAME_SHIFT else "doubtful",
        f"two processes that shift apart, the second by {found.rival.share:.2f} decades for each decade of the first, "
        f"describe the sweeps better than one master curve; their shifts differ by up to {change[worst]:.2f} decades "
        f"(at {float(found.model.temperature[worst]):.0f} °C), which is part of the uncertainties",
    )


def _search(points: Points) -> Iterator[tuple[Level, str]]:
    if points.work.is_cut:
        yield (
            "doubtful",
            "the search for shifts and laws was ended after a fixed amount of work, before everything was tried: "
            "hand-set shifts to start from, a shift law, or fewer temperatures at a time would help",
        )


def _residuals(found: Superposition) -> Iterator[tuple[Level, str]]:
    if found.violation > VIOLATED:
        text = (
            "time-temperature superposition does not hold to the noise of the sweeps (the fit misses by "
            f"{found.violation:.1f} times as much)"
        )
        if found.alternatives:
            shifts = np.array([other for _, other in found.alternatives])
            change = np.abs(shifts - shifts[:, [found.model.reference]] - found.fit.state.log10_aT)
            worst = np.unravel_index(int(np.argmax(change)), change.shape)
            text += (
                ": with other weights of the moduli, another vertical law or another start the shifts change by up "
                f"to {change[worst]:.1f} decades ({float(found.model.temperature[worst[1]]):.0f} °C); their "
                "uncertainties include these changes"
            )
        yield ("fail" if found.violation > _FAR_BEYOND else "doubtful", text)
    for name, size in (("storage", found.noise.storage), ("loss", found.noise.loss)):
        if size > ROUGH[name]:
            level: Level = "fail" if size > _HOPELESS[name] else "doubtful"
            yield level, f"the master curve misses the {name} modulus by {100 * size:.0f} % (root mean square)"


def _vertical(found: Superposition) -> Iterator[tuple[Level, str]]:
    if found.refused:
        yield (
            "doubtful",
            f"the sweeps ask for a {' or '.join(found.refused)} vertical factor steeper than a material's modulus can "
            "change; it was refused, for it would make up for sweeps that do not superpose",
        )


def _slopes(found: Superposition) -> Iterator[tuple[Level, str]]:
    if not found.slopes:
        return
    spread = np.sqrt(np.diag(found.spread_of_slopes))
    worst = int(np.argmax(spread))
    if spread[worst] > _LOOSE_SLOPE:
        yield (
            "doubtful",
            "the loss is too small and flat to tell shifts from a slope of the modulus over temperature: fits with "
            f"other slopes describe the sweeps nearly as well, with shifts that differ by {spread[worst]:.1f} decades "
            f"({float(found.model.temperature[worst]):.0f} °C), and the stated uncertainties include that",
        )


def _steps(points: Points, found: Superposition) -> Iterator[tuple[Level, str]]:
    """Doubt a short sweep that lies where no other would have led it: one wrong reading can do that."""
    model = found.model
    short = np.bincount(points.isotherm, minlength=points.count) < LEAST_POINTS
    if model.horizontal != "free" or model.temperature.size < _LEAST_STEPS or not short.any():
        return
    order = np.argsort(model.temperature, kind="stable")
    spacing = np.maximum(np.diff(model.temperature[order]), LEAST_SPACING)
    slope = -np.diff(found.fit.state.log10_aT[order]) / spacing
    mean = 0.5 * (spacing[1:] + spacing[:-1])
    usual = CHANGE + CHANGE_SHARE * np.minimum(np.abs(slope[:-1]), np.abs(slope[1:])) * mean
    jump = np.abs(np.diff(slope)) * mean / usual
    worst = int(np.argmax(jump))
    near = order[worst : worst + 3]
    if jump[worst] > _ABRUPT and short[near].any():
        low, middle, high = (float(model.temperature[k]) for k in near)
        yield (
            "doubtful",
            f"the shifts of neighbours change abruptly, {slope[worst]:.2f} decades per kelvin from {low:.4g} to "
            f"{middle:.4g} °C and {slope[worst + 1]:.2f} from there to {high:.4g} °C; in sweeps of a few readings a "
            "wrong one can do that, and nothing tells it",
        )


def _causality(kk: KramersKronig) -> Iterator[tuple[Level, str]]:
    if kk.verdict != "pass":
        yield ("fail" if kk.verdict == "fail" else "doubtful", f"Kramers-Kronig {kk.verdict}: {kk.reason}")

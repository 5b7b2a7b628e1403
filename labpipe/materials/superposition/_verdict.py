"""The verdict on a master curve, and the warnings on its validity, one sentence each.

Storage and loss may obey Kramers and Kronig although the sweeps do not superpose, and a fit may follow the sweeps with
vertical factors of no material: residuals against the scatter and in absolute terms, causality, and the vertical law
all count.
"""

from dataclasses import dataclass
from typing import Literal

import xarray as xr

from labpipe.arrays import Flags
from labpipe.materials._shift_law import HOLDS, ShiftLaw
from labpipe.materials.spectrum import PASS_RATIO, WARN_RATIO, KramersKronig
from labpipe.materials.superposition._joint_fit import Points
from labpipe.materials.superposition._model_selection import (
    SAME_SOLUTION,
    STRONG_EVIDENCE,
    Superposition,
    free_shifts_gain,
)

Level = Literal["pass", "doubtful", "fail"]

# Relative residuals that no rheometer's noise explains, and of which no part is such noise.
_ROUGH, _HOPELESS = {"storage": 0.05, "loss": 0.10}, {"storage": 0.15, "loss": 0.30}


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on time-temperature superposition, with all reasons against it, one sentence each."""

    level: Level
    reasons: tuple[str, ...]


def verdict_on(found: Superposition, kk: KramersKronig) -> Verdict:
    """Judge a fit."""
    objections: list[tuple[Level, str]] = []
    # noise of the fit over scatter of the sweeps, which of the fewest that are judged is known to a fifth
    if found.violation > PASS_RATIO:
        text = (
            "time-temperature superposition does not hold to the noise of the sweeps (the fit misses by "
            f"{found.violation:.1f} times as much); the uncertainties are widened by the lack of fit, by a factor of "
            f"{found.lack_of_fit**0.5:.1f}"
        )
        objections.append(("fail" if found.violation > WARN_RATIO else "doubtful", text))
    for name, size in (("storage", found.noise.storage), ("loss", found.noise.loss)):
        if size > _ROUGH[name]:
            level: Level = "fail" if size > _HOPELESS[name] else "doubtful"
            text = f"the master curve misses the {name} modulus by {100 * size:.0f} % (root mean square)"
            objections.append((level, text))
    if found.refused:
        text = (
            f"the sweeps ask for a {' or '.join(found.refused)} vertical factor steeper than a material's modulus can "
            "change; it was refused, for it would make up for sweeps that do not superpose"
        )
        objections.append(("doubtful", text))
    if kk.verdict != "pass":
        text = f"Kramers-Kronig {kk.verdict}: {kk.reason}"
        objections.append(("fail" if kk.verdict == "fail" else "doubtful", text))
    order: tuple[Level, ...] = ("pass", "doubtful", "fail")
    worst = max((order.index(level) for level, _ in objections), default=0)
    return Verdict(order[worst], tuple(reason for _, reason in objections))


def limits_of(
    points: Points, found: Superposition, chosen: ShiftLaw, overlap: xr.Dataset, verdict: Verdict
) -> list[str]:
    """Return all limits of the result, one sentence each."""
    notes: list[str] = []
    if points.count == 1:
        notes.append("only one temperature: there is nothing to shift, the spectrum is that of this isotherm")
    if found.model.horizontal == "free":
        pairs = _pairs(overlap, ~overlap["determined"].values, "{}/{} °C (±{:.2f})", overlap["u_step"])
        if pairs:
            notes.append(
                f"the data barely determine the step of log10 a_T between {pairs}; there the shifts rely on the "
                "expected continuation. Smaller temperature steps, a wider frequency range or a shift law would help"
            )
        best = found.starts[0][1]
        notes += [
            f'the start "{name}" ends {distance:.2f} decades away at nearly the same misfit: the '
            "shifts have a second solution"
            for name, cost, distance in found.starts[1:]
            if distance > SAME_SOLUTION and cost - best < STRONG_EVIDENCE
        ]
    gaps = _pairs(overlap, overlap["overlap"].values <= 0, "{} and {} °C (by {:.2f} decades)", -overlap["overlap"])
    if gaps:
        notes.append(
            f"no overlap between {gaps}; the step there relies on the relation of storage and loss "
            "and on a smooth spectrum across the gap"
        )
    law = found.model.horizontal
    if law in ("wlf", "arrhenius") and points.count > len(chosen.parameters) + 1:
        gain = free_shifts_gain(points, found)
        if gain > HOLDS:
            notes.append(
                f"the {law} law does not hold over these temperatures: free shifts fit better "
                f"(F = {gain:.1f}); use law=None and look for a transition"
            )
    return [*notes, *verdict.reasons]


def _pairs(overlap: xr.Dataset, chosen: Flags, form: str, size: xr.DataArray) -> str:
    """List pairs of temperatures, each with a number."""
    temperatures = ([f"{float(T):.4g}" for T in overlap[name].values[chosen]] for name in ("colder", "warmer"))
    return ", ".join(map(form.format, *temperatures, size.values[chosen]))

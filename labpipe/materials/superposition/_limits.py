"""Warnings on the validity of a master curve, one sentence each."""

import xarray as xr

from labpipe.arrays import Flags
from labpipe.materials._shift_law import LawName, ShiftLaw
from labpipe.materials.superposition._law_choice import free_shifts_gain
from labpipe.materials.superposition._reweighting import Superposition
from labpipe.materials.superposition._sweep_data import SweepData
from labpipe.materials.superposition._verdict import Verdict

#: A step between neighbours known worse than this (decades) is called barely determined.
BARELY_DETERMINED = 0.15
# Another start that ends this far away (decades) at nearly the same cost (in units of twice the
# log-likelihood) is a second solution.
_OTHER_SOLUTION, _NEARLY_SAME_COST = 0.15, 6.0
# A law holds when free shifts lower the misfit by less than this per parameter (F statistic).
_LAW_HOLDS = 4.0


def limits_of(
    data: SweepData, found: Superposition, law: LawName | None, chosen: ShiftLaw, overlap: xr.Dataset, verdict: Verdict
) -> list[str]:
    """Say everything that limits the result, one sentence each."""
    notes: list[str] = []
    if data.points.count == 1:
        notes.append("only one temperature: there is nothing to shift, the spectrum is that of this isotherm")
    if found.model.horizontal == "free":
        notes += _identifiability(overlap)
        best = found.starts[0][1]
        others = [
            (name, distance)
            for name, cost, distance in found.starts[1:]
            if distance > _OTHER_SOLUTION and cost - best < _NEARLY_SAME_COST
        ]
        notes += [
            f'the start "{name}" ends {distance:.2f} decades away at nearly the same misfit: the '
            "shifts have a second solution"
            for name, distance in others
        ]
    notes += _gaps(overlap)
    if law is not None and data.points.count > len(chosen.parameters) + 1:
        gain = free_shifts_gain(data.points, found)
        if gain > _LAW_HOLDS:
            notes.append(
                f"the {law} law does not hold over these temperatures: free shifts fit better "
                f"(F = {gain:.1f}); use law=None and look for a transition"
            )
    return [*notes, *verdict.reasons]


def _gaps(overlap: xr.Dataset) -> list[str]:
    pairs = _pairs(overlap, overlap["overlap"].values <= 0, "{} and {} °C (by {:.2f} decades)", -overlap["overlap"])
    if not pairs:
        return []
    return [
        f"no overlap between {pairs}; the step there relies on the relation of storage and loss "
        f"and on a smooth spectrum across the gap"
    ]


def _identifiability(overlap: xr.Dataset) -> list[str]:
    pairs = _pairs(overlap, ~overlap["determined"].values, "{}/{} °C (±{:.2f})", overlap["u_step"])
    if not pairs:
        return []
    return [
        f"the data barely determine the step of log10 a_T between {pairs}; there the shifts rely on the expected "
        "continuation. Smaller temperature steps, a wider frequency range or a shift law would help"
    ]


def _pairs(overlap: xr.Dataset, chosen: Flags, form: str, told: xr.DataArray) -> str:
    """List pairs of temperatures, each with what is told of it."""
    temperatures = ([f"{float(T):.4g}" for T in overlap[name].values[chosen]] for name in ("colder", "warmer"))
    return ", ".join(map(form.format, *temperatures, told.values[chosen]))

"""Storage and loss modulus, from whichever two quantities a table gives.

Relations of the complex modulus E* = E′ + i E″ = |E*| exp(iδ), its inverse the complex compliance D* = D′ − i D″, and
the complex viscosity η* = η′ − i η″ = G*/(iω) (J. D. Ferry, Viscoelastic Properties of Polymers, 3rd ed., ch. 1).
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from instruments._quantities import FREQUENCIES, RESPONSES, SHIFTS, TEMPERATURES, TIMES
from labpipe.arrays import Floats

_Made = tuple[Floats, Floats]


def _inverse(storage: Floats, loss: Floats) -> _Made:
    """Return the modulus of a compliance, or the other way round."""
    squared = storage**2 + loss**2
    return storage / squared, loss / squared


# Needed quantities, and how they make E′ and E″; "damping" is tan δ, "δ" the phase.
_WAYS: tuple[tuple[tuple[str, ...], Callable[..., _Made]], ...] = (
    (("storage_modulus", "loss_modulus"), lambda e1, e2: (e1, e2)),
    (("storage_modulus", "loss_factor"), lambda e1, tan: (e1, e1 * tan)),
    (("loss_modulus", "loss_factor"), lambda e2, tan: (e2 / tan, e2)),
    (("storage_modulus", "phase_angle"), lambda e1, d: (e1, e1 * np.tan(d))),
    (("loss_modulus", "phase_angle"), lambda e2, d: (e2 / np.tan(d), e2)),
    (("complex_modulus", "phase_angle"), lambda e, d: (e * np.cos(d), e * np.sin(d))),
    (("complex_modulus", "loss_factor"), lambda e, tan: (e / np.hypot(1, tan), e * tan / np.hypot(1, tan))),
    (("storage_compliance", "loss_compliance"), _inverse),
    (("storage_compliance", "loss_factor"), lambda d1, tan: _inverse(d1, d1 * tan)),
    (("storage_compliance", "phase_angle"), lambda d1, d: _inverse(d1, d1 * np.tan(d))),
    (("complex_compliance", "phase_angle"), lambda j, d: (np.cos(d) / j, np.sin(d) / j)),
    (("complex_compliance", "loss_factor"), lambda j, tan: (1 / np.hypot(1, tan) / j, tan / np.hypot(1, tan) / j)),
    (("complex_viscosity_real", "complex_viscosity_imaginary", "ω"), lambda re, im, w: (im * w, re * w)),
    (("complex_viscosity", "phase_angle", "ω"), lambda v, d, w: (v * w * np.cos(d), v * w * np.sin(d))),
    (
        ("complex_viscosity", "loss_factor", "ω"),
        lambda v, tan, w: (v * w / np.hypot(1, tan), v * w * tan / np.hypot(1, tan)),
    ),
)


def _has(columns: Mapping[str, Any], needed: tuple[str, ...]) -> bool:
    return all(name in columns or (name == "ω" and not FREQUENCIES.isdisjoint(columns)) for name in needed)


def with_moduli(columns: dict[str, Any]) -> dict[str, Any]:
    """Add storage and loss modulus [Pa] to columns in SI by the first way that determines them."""
    arrays = {name: np.asarray(column.values, dtype=float) for name, column in columns.items() if column.si}
    arrays["ω"] = arrays.get("angular_frequency", 2.0 * np.pi * arrays.get("frequency", np.empty(0)))
    names, make = next(((needed, make) for needed, make in _WAYS if _has(columns, needed)), ((), None))
    if make is None:
        return columns
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        moduli = make(*(arrays[name] for name in names))
    header = f"of {' and '.join(columns[name].header for name in names if name != 'ω')}"
    for name, values in zip(("storage_modulus", "loss_modulus"), moduli, strict=True):
        if name not in columns:
            columns[name] = replace(columns[names[0]], name=name, header=header, unit="Pa", si="Pa", values=values)
    return columns


def needed(names: set[str]) -> set[str]:
    """Return which of some columns a sweep, a response or a table of shifts is made of; the others are not needed."""
    way = next((set(way) for way, _ in _WAYS if _has(dict.fromkeys(names), way)), set())
    temperatures, responses = names & {*TEMPERATURES}, names & RESPONSES
    wanted = way | temperatures | FREQUENCIES | responses
    return names & (wanted | (TIMES if responses else set()) | (SHIFTS if temperatures else set()))


def missing(names: set[str]) -> str:
    """Name the quantities that columns lack to be sweeps, responses over time or shift factors; "" for nothing."""
    is_shift_table = names & {*TEMPERATURES} and names & SHIFTS
    if is_shift_table or (names & TIMES and names & RESPONSES):
        return ""
    lacks = [] if names & FREQUENCIES else ["frequency"]
    if not any(set(way) <= names | {"ω"} for way, _ in _WAYS):
        begun = [way for way, _ in _WAYS if names.intersection(way) - {"loss_factor", "phase_angle"}]
        rests = [set(way) - names - {"ω"} for way in begun]
        words = dict.fromkeys(_WORDS.get(n, n.replace("_", " ")) for rest in rests if len(rest) == 1 for n in rest)
        *others, last = words or ["modulus"]
        lacks.append(f"{', '.join(others)} or {last}" if others else last)
    return "; no ".join(lacks)


_WORDS = {"loss_factor": "tan δ", "phase_angle": "phase"}

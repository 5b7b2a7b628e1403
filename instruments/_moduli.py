"""Storage and loss modulus, from whichever two quantities a table gives.

Exact relations of the complex modulus E* = E′ + i E″ = |E*| exp(iδ), its inverse the complex
compliance D* = D′ − i D″, and the complex viscosity η* = η′ − i η″ = G*/(iω) (J. D. Ferry,
Viscoelastic Properties of Polymers, 3rd ed., ch. 1).
"""

from collections.abc import Callable, Mapping, Set
from dataclasses import replace
from typing import Any

import numpy as np

from instruments._symbols import FREQUENCIES, RESPONSES, SHIFTS, TIMES
from labpipe.arrays import Floats

_Made = tuple[Floats, Floats]


def _inverse(storage: Floats, loss: Floats) -> _Made:
    """Return the modulus of a compliance, or the other way round."""
    squared = storage**2 + loss**2
    return storage / squared, loss / squared


# What is needed, and how it makes E′ and E″; "damping" is tan δ, "δ" the phase.
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


def with_moduli(columns: dict[str, Any]) -> dict[str, Any]:
    """Add storage and loss modulus [Pa] to columns in SI that determine them."""
    omega = _omega(columns)
    for needed, made in _WAYS:
        if all(name in columns or (name == "ω" and omega is not None) for name in needed):
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                storage, loss = made(
                    *(omega if name == "ω" else np.asarray(columns[name].values, dtype=float) for name in needed)
                )
            source = " and ".join(columns[name].header for name in needed if name != "ω")
            for name, values in (("storage_modulus", storage), ("loss_modulus", loss)):
                if name not in columns:
                    columns[name] = replace(
                        columns[needed[0]],
                        name=name,
                        header=f"of {source}",
                        unit="Pa",
                        si="Pa",
                        values=values,
                        sub_label="",
                    )
            break
    return columns


def _omega(columns: Mapping[str, Any]) -> Floats | None:
    if "angular_frequency" in columns:
        return np.asarray(columns["angular_frequency"].values, dtype=float)
    if "frequency" in columns:
        return 2.0 * np.pi * np.asarray(columns["frequency"].values, dtype=float)
    return None


def missing(names: Set[str]) -> str:
    """Say what columns lack to be sweeps, responses over time or shift factors; "" for nothing.

    Examples
    --------
    >>> missing({"frequency", "temperature", "storage_modulus"})
    'loss modulus, tan δ or phase'
    """
    has = set(names)
    if "temperature_set" in has:
        has.add("temperature")
    if has & FREQUENCIES:
        has.add("ω")
    if "temperature" in has and has & SHIFTS:
        return ""
    if has & TIMES and has & RESPONSES:
        return ""
    makes = any(set(needed) <= has for needed, _ in _WAYS)
    lacks = []
    if "ω" not in has:
        lacks.append("frequency")
    if not makes:
        lacks.append(_lacking_modulus(has))
    return "; no ".join(lacks)


def _lacking_modulus(has: Set[str]) -> str:
    if has & {"storage_modulus"}:
        return "loss modulus, tan δ or phase"
    if has & {"loss_modulus"}:
        return "storage modulus, tan δ or phase"
    if has & {"complex_modulus", "complex_viscosity", "complex_compliance"}:
        return "phase or tan δ"
    if has & {"storage_compliance"}:
        return "loss compliance, tan δ or phase"
    if has & {"complex_viscosity_real", "complex_viscosity_imaginary"}:
        return "other part of the complex viscosity"
    return "modulus"

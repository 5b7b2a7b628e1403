"""A material as input text of each simulation code, by its published rules.

Abaqus: *ELASTIC or *HYPERELASTIC with instantaneous moduli, *VISCOELASTIC, TIME=PRONY, *TRS.
ANSYS: MP or TB,HYPER with instantaneous moduli, TB,PRONY for shear and bulk, TB,SHIFT. COMSOL: long-time
moduli, and a table of branches (number, shear modulus, relaxation time) that its viscoelasticity
node loads. LS-DYNA: *MAT_GENERAL_VISCOELASTIC with terms in Pa and 1/s.
"""

import json
from collections.abc import Callable
from typing import Literal

import numpy as np

from labpipe.materials.codes._deck import Deck
from labpipe.units import ZERO_CELSIUS

Code = Literal["abaqus", "ansys", "comsol", "lsdyna", "json"]

_LN10 = float(np.log(10.0))
_NEARLY = 1000.0  # bulk over shear modulus where a code has no incompressible material


def _abaqus(deck: Deck) -> str:
    lines = deck.remarks("**")
    label = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in deck.name).upper()
    label = label if label[:1].isalpha() else f"M{label}"
    lines.append(f"*MATERIAL, NAME={label[:80]}")
    if deck.bulk == "incompressible":
        lines += [
            "** incompressible: take hybrid elements",
            "*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS",
            f"{0.5 * deck.shear.E_unrelaxed:.14g}, 0.",
        ]
    else:
        lines += ["*ELASTIC, MODULI=INSTANTANEOUS", f"{deck.E_unrelaxed:.14g}, {deck.nu:.14g}"]
    if deck.shares.size:
        lines.append("*VISCOELASTIC, TIME=PRONY")
    for share, time in zip(deck.shares, deck.shear.rho, strict=True):
        lines.append(f"{share:.14g}, {share if deck.bulk == 'relaxing' else 0.0:.14g}, {time:.14g}")
    if deck.wlf is not None:
        lines += [
            "** log10 a_T = -C1 (T - T_ref)/(C2 + T - T_ref), temperatures in degC",
            "*TRS, DEFINITION=WLF",
            f"{deck.T_ref:.14g}, {deck.wlf[0]:.14g}, {deck.wlf[1]:.14g}",
        ]
    return "\n".join(lines) + "\n"


def _ansys(deck: Deck) -> str:
    lines = deck.remarks("!")
    if deck.bulk == "incompressible":
        lines += [
            "! incompressible: take elements with mixed u-P formulation",
            "TB,HYPER,1,1,2,NEO",
            f"TBDATA,1,{deck.shear.E_unrelaxed:.14g},0  ! instantaneous shear modulus",
        ]
    else:
        lines += [f"MP,EX,1,{deck.E_unrelaxed:.14g}  ! instantaneous modulus", f"MP,PRXY,1,{deck.nu:.14g}"]
    if deck.shares.size:
        for name in ("SHEAR", "BULK") if deck.bulk == "relaxing" else ("SHEAR",):
            lines.append(f"TB,PRONY,1,,{deck.shares.size},{name}")
            lines += [
                f"TBDATA,{2 * i + 1},{share:.14g},{time:.14g}"
                for i, (share, time) in enumerate(zip(deck.shares, deck.shear.rho, strict=True))
            ]
    if deck.wlf is not None:
        lines += [
            "TB,SHIFT,1,,3,WLF",
            f"TBDATA,1,{deck.T_ref:.14g},{deck.wlf[0]:.14g},{deck.wlf[1]:.14g}  ! temperatures in degC",
        ]
    return "\n".join(lines) + "\n"


def _comsol(deck: Deck) -> str:
    relaxed = deck.shear.E_relaxed
    solid = (
        [f"G = {relaxed:.14g} [Pa], nearly incompressible material with mixed formulation"]
        if deck.bulk == "incompressible"
        else [f"G = {relaxed:.14g} [Pa]", f"K = {deck.K:.14g} [Pa]"]
        if deck.bulk == "constant"
        else [f"E = {2.0 * (1.0 + deck.nu) * relaxed:.14g} [Pa]", f"nu = {deck.nu:.14g}"]
    )
    lines = deck.remarks("%")
    lines.append("% Linear elastic material, long-term moduli:")
    lines += [f"%   {line}" for line in solid]
    if deck.bulk == "relaxing":
        lines.append("% Viscoelasticity: deviatoric and volumetric, with the same relative moduli in both;")
        lines.append("%   a version that has the deviatoric one only keeps the bulk modulus constant.")
    else:
        lines.append("% Viscoelasticity: deviatoric; generalized Maxwell.")
    if deck.wlf is not None:
        lines.append("% Thermal effects, Williams-Landel-Ferry:")
        lines.append(f"%   T0 = {deck.T_ref + ZERO_CELSIUS:.14g} [K]")
        lines.append(f"%   C1 = {deck.wlf[0]:.14g}")
        lines.append(f"%   C2 = {deck.wlf[1]:.14g} [K]")
    lines.append("% Branches, to load into the table: number, shear modulus in Pa, relaxation time in s")
    lines += [
        f"{i} {weight:.14g} {time:.14g}"
        for i, (weight, time) in enumerate(zip(deck.shear.E, deck.shear.rho, strict=True), 1)
    ]
    return "\n".join(lines) + "\n"


def _field(value: float) -> str:
    """Return the most digits of a number that ten characters hold."""
    if value == 0.0:
        return "       0.0"
    for digits in range(6, 1, -1):
        mantissa, power = f"{value:.{digits}E}".split("E")
        text = f"{mantissa}E{int(power)}"
        if len(text) <= 10:
            return text.rjust(10)
    return f"{value:.1E}".rjust(10)


def _lsdyna(deck: Deck) -> str:
    more = ["Fields of ten characters round each number to 5 digits or so."]
    K = deck.K
    if deck.bulk == "incompressible":
        K = _NEARLY * deck.shear.E_unrelaxed
        more.append(
            f"This card cannot be incompressible: BULK is {_NEARLY:g} times the instantaneous shear modulus, "
            f"nu = {(3 * _NEARLY - 2) / (6 * _NEARLY + 2):.6f}."
        )
    A, B, T_ref = 0.0, 0.0, 0.0
    if deck.wlf is not None:
        A, B, T_ref = -deck.wlf[0] * _LN10, deck.wlf[1], deck.T_ref + ZERO_CELSIUS
        more.append(
            "Temperatures in K. The reduced time is the integral of Phi dt, with "
            "Phi = exp(-A (T - TREF)/(B + T - TREF)): A is negative, so that the material is faster when it is hot."
        )
    more.append("RO is not known here: set the density.")
    lines = ["*KEYWORD", *deck.remarks("$", *more), "*MAT_GENERAL_VISCOELASTIC"]
    lines.append("$      MID        RO      BULK       PCF        EF      TREF         A         B")
    lines.append("         1" + "".join(map(_field, (0.0, K, 0.0, 0.0, T_ref, A, B))))
    lines.append("$     LCID        NT    BSTART     TRAMP     LCIDK       NTK   BSTARTK    TRAMPK")
    lines.append("         0         0" + "       0.0" * 2 + "         0         0" + "       0.0" * 2)
    lines.append("$       GI     BETAI        KI    BETAKI")
    relaxes = deck.bulk == "relaxing"
    ratio = deck.K / deck.shear.E_unrelaxed if relaxes else 0.0
    for weight, time in zip(deck.shear.E, deck.shear.rho, strict=True):
        lines.append("".join(map(_field, (weight, 1.0 / time, ratio * weight, 1.0 / time if relaxes else 0.0))))
    lines.append("".join(map(_field, (deck.shear.E_relaxed, 0.0, ratio * deck.shear.E_relaxed, 0.0))))
    return "\n".join([*lines, "*END"]) + "\n"


def _json(deck: Deck) -> str:
    document = {
        "name": deck.name,
        "units": {"modulus": "Pa", "time": "s", "temperature": "degC", "frequency": "Hz"},
        "window": list(deck.window),
        "T_ref": deck.T_ref,
        "bulk": deck.bulk,
        "K_unrelaxed": deck.K if np.isfinite(deck.K) else None,
        "nu_unrelaxed": deck.nu,
        "shear": {
            "G_relaxed": deck.shear.E_relaxed,
            "G_unrelaxed": deck.shear.E_unrelaxed,
            "G": deck.shear.E.tolist(),
            "rho": deck.shear.rho.tolist(),
            "shares": deck.shares.tolist(),
        },
        "tension": {
            "E_relaxed": deck.tension.E_relaxed,
            "E": deck.tension.E.tolist(),
            "rho": deck.tension.rho.tolist(),
        },
        "rms_relative_error": deck.error,
        "wlf": None if deck.wlf is None else {"C1": deck.wlf[0], "C2": deck.wlf[1]},
        "shifts": {
            "temperature": deck.shifts[0].tolist(),
            "log10_aT": [None if np.isnan(value) else value for value in deck.shifts[1].tolist()],
        },
        "notes": list(deck.notes),
        "warnings": list(deck.warnings),
    }
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


_WRITERS: dict[str, Callable[[Deck], str]] = {
    "abaqus": _abaqus,
    "ansys": _ansys,
    "comsol": _comsol,
    "lsdyna": _lsdyna,
    "json": _json,
}
CODES: dict[str, str] = {"abaqus": ".inp", "ansys": ".mac", "comsol": ".txt", "lsdyna": ".k", "json": ".json"}
"""The codes, and how their files end."""


def deck_text(deck: Deck, code: Code | str) -> str:
    """Return a material in the input language of a simulation code."""
    return _WRITERS[code](deck)

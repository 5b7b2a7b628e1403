r"""A material as input of simulation codes: Abaqus, ANSYS, COMSOL, LS-DYNA, and JSON for any other.

Codes part a solid into shear and volume. From the tension modulus E(t) and the behaviour of the bulk modulus
follows the shear modulus, exactly and with as many terms:

- ``relaxing``: Poisson's ratio is constant, so that G(t) = E(t)/2(1 + ν) and K(t) = E(t)/3(1 − 2ν);
- ``constant``: K = E(0)/3(1 − 2ν) does not relax. Compliances add, 1/G = 3/E − 1/(3K) of the
  transforms, so that the retardation times of G are those of E;
- ``incompressible``: G(t) = E(t)/3.

Where the shear modulus was measured, it is G(t) that is kept, and E(t) that follows.

The texts follow the published rules of the codes. Abaqus: *ELASTIC or *HYPERELASTIC with instantaneous moduli,
*VISCOELASTIC, TIME=PRONY, *TRS. ANSYS: MP or TB,HYPER with instantaneous moduli, TB,PRONY for shear and bulk,
TB,SHIFT. COMSOL: long-time moduli, and a table of branches (number, shear modulus, relaxation time). LS-DYNA:
*MAT_GENERAL_VISCOELASTIC with terms in Pa and 1/s.

References
----------
N. W. Tschoegl, The Phenomenological Theory of Linear Viscoelastic Behavior, Springer, 1989, ch. 11.
"""

import json
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from scipy.optimize import nnls

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials._shift_law import ShiftLaw
from labpipe.materials.prony import Prony, Retardation, relaxation_from_creep
from labpipe.materials.spectrum import NNLS_STEPS_PER_COLUMN, moduli_of_terms
from labpipe.units import ZERO_CELSIUS

Bulk = Literal["constant", "relaxing", "incompressible"]
Code = Literal["abaqus", "ansys", "comsol", "lsdyna", "json"]
CODES: dict[str, str] = {"abaqus": ".inp", "ansys": ".mac", "comsol": ".txt", "lsdyna": ".k", "json": ".json"}
"""The codes, and the suffixes of their files."""

_SMALLEST = 1e-12  # long-time over instantaneous modulus that is left of 1 - sum in double precision
_TOLERANCE = 0.01  # root-mean-square relative error that the reduction of terms may cost
_OF_TOLERANCE = 1e-3  # of the storage modulus at the end of the window, which the long-time modulus may be wrong by
_WIDTH = 74  # of a line of remarks; LS-DYNA reads 80 characters
_MOST_TERMS = 17  # LS-DYNA reads 18, of which one is the long-time modulus
_POINTS_PER_DECADE = 10  # of the reduction to few terms
_NEARLY = 1000.0  # bulk over shear modulus where a code has no incompressible material


@dataclass(frozen=True, slots=True)
class Deck:
    """A material as simulation codes need it.

    ``tension``, ``shear``: Reduced series of the tension modulus, and of the shear modulus as E_relaxed, E and rho.
    ``shares`` (term,): G_i over the instantaneous shear modulus, as they are printed; their sum is below one.
    ``K`` [Pa], ``nu``: Instantaneous bulk modulus, infinite for an incompressible material, and Poisson's ratio.
    ``window`` [Hz], ``T_ref`` [degC]: Where the series holds. ``wlf``: C1 and C2 [K] about T_ref; None where no law
    holds. ``shifts``: Temperatures [degC] and log10 a_T. ``error``: Root-mean-square relative error of the worse
    modulus over the window. ``notes``, ``warnings``: Sentences for the reader of the file.
    """

    name: str
    tension: Prony
    shear: Prony
    shares: Floats
    bulk: Bulk
    K: float
    nu: float
    window: tuple[float, float]
    T_ref: float
    wlf: tuple[float, float] | None
    shifts: tuple[Floats, Floats]
    error: float
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def E_unrelaxed(self) -> float:
        """Instantaneous tension modulus, Pa."""
        return 2.0 * (1.0 + self.nu) * self.shear.E_unrelaxed

    def remarks(self, mark: str, *more: str) -> list[str]:
        """Return notes and warnings as lines of remarks of a code."""
        texts = [*self.notes, *more, *(f"WARNING: {text}" for text in self.warnings)]
        lines = (textwrap.wrap(text, _WIDTH, subsequent_indent="  ") for text in texts)
        return [f"{mark} {line}" for part in lines for line in part]


def make_deck(
    material: Prony,
    window: tuple[float, float],
    T_ref: float,
    *,
    name: str = "material",
    law: ShiftLaw | None = None,
    shifts: tuple[Sequence[float] | Floats, Sequence[float] | Floats] = ((), ()),
    b_T: Sequence[float] | Floats = (),
    bulk: Bulk | None = None,
    measured: Literal["tension", "shear"] = "tension",
) -> Deck:
    """Reduce a material to the input of simulation codes.

    Parameters
    ----------
    material : Prony
        At T_ref.
    window : (float, float) [Hz]
        Lowest and highest frequency that was covered.
    T_ref, law : float [degC], ShiftLaw
        Reference temperature, and the shift law about it.
    shifts, b_T : (array, array), array
        Temperatures [degC] and log10 a_T as measured; vertical factors, which no code takes.
    bulk : {"constant", "relaxing", "incompressible"}, optional
        Behaviour of the bulk modulus; by default Poisson's ratio is constant, and at ν = 0.5 the
        material incompressible.
    measured : {"tension", "shear"}
        The modulus that was measured, which stays as it is.

    Raises
    ------
    InputError
        The bulk modulus cannot be as asked for; the material has no finite instantaneous modulus.
    """
    if bulk is not None and bulk not in get_args(Bulk):
        raise InputError(f'bulk = "{bulk}" is unknown; expected one of {", ".join(get_args(Bulk))}')
    if material.nu == 0.5 and bulk not in (None, "incompressible"):
        raise InputError(
            f'bulk = "{bulk}": at nu = 0.5 the bulk modulus is infinite; give nu below 0.5 or bulk = "incompressible"'
        )
    if not np.isfinite(material.E_unrelaxed):
        raise InputError("the material has no finite instantaneous modulus (a dashpot in parallel); codes need one")
    chosen: Bulk = bulk or ("incompressible" if material.nu == 0.5 else "relaxing")
    few, error, tolerance = *fewest_terms(material, *window, _TOLERANCE), _TOLERANCE
    while few.E.size > _MOST_TERMS and tolerance < 1.0:
        tolerance *= 1.5
        few, error = fewest_terms(material, *window, tolerance)
    # The shares of a liquid's terms too must add up to less than one.
    ends = few.complex_modulus(2.0 * np.pi * np.asarray(window)).real
    rest = max(_OF_TOLERANCE * _TOLERANCE * float(ends[0]), _SMALLEST * few.E_unrelaxed)
    is_raised = few.E_relaxed < rest
    few = Prony(max(few.E_relaxed, rest), few.E, few.rho, few.nu)
    nu = 0.5 if chosen == "incompressible" else few.nu
    K = np.inf if chosen == "incompressible" else few.E_unrelaxed / (3.0 * (1.0 - 2.0 * nu))
    if chosen != "constant" or measured == "shear":
        shear = few.scaled(0.5 / (1.0 + (few.nu if measured == "shear" else nu)))
    else:
        C, tau = few.creep_terms()
        unrelaxed = 3.0 / few.E_unrelaxed - 1.0 / (3.0 * K)
        family = relaxation_from_creep(Retardation(unrelaxed, 3.0 * C, tau, 3.0 * few.fluidity))
        shear = Prony(family.relaxed, family.weight, family.time, few.nu)
    temperatures, log10_aT = np.asarray(shifts[0], float), np.asarray(shifts[1], float)
    behaviour = {
        "incompressible": "Incompressible: the bulk modulus is infinite.",
        "relaxing": f"Poisson's ratio is constant, nu = {nu:.6g}: the bulk modulus relaxes as the shear modulus does.",
        "constant": f"The bulk modulus is constant, K = {K:.6g} Pa, from nu = {nu:.6g} of the instantaneous modulus.",
    }[chosen]
    slowest, fastest = 0.5 / np.pi / window[0], 0.5 / np.pi / window[1]
    wlf, law_notes = _law_of(law, T_ref, temperatures, log10_aT, np.asarray(b_T, float))
    notes = [
        f"{name}: linear viscoelastic material at {T_ref:.6g} degC; SI units (Pa, s)",
        f"Valid from {window[0]:.4g} to {window[1]:.4g} Hz, times from {fastest:.4g} to {slowest:.4g} s; "
        "outside, it is extrapolated.",
        f"{few.E.size} terms; root-mean-square error against the full series within the window: "
        f"{max(100 * error, 1e-4):.2g} % of the worse modulus in tension.",
        behaviour + " The shear modulus was measured and stays as it is." * (measured == "shear"),
        *law_notes,
    ]
    if is_raised or material.is_liquid:
        notes.append(
            f"{'The material flows. ' * material.is_liquid}{few.E_relaxed:.3g} Pa is written as its long-time modulus, "
            "because the shares of the terms must add up to less than one; that is "
            f"{few.E_relaxed / ends[0]:.1e} of the storage modulus at the lower end of the window."
        )
    extrapolated = [
        f"the {which} modulus, {modulus:.4g} Pa in tension, is extrapolated: at {frequency:.4g} Hz, the {end} end of "
        f"the window, the storage modulus is {storage:.4g} Pa"
        for which, modulus, end, frequency, storage in (
            ("instantaneous", few.E_unrelaxed, "upper", window[1], float(ends[1])),
            ("long-time", few.E_relaxed, "lower", window[0], float(ends[0])),
        )
        if abs(modulus - storage) > _TOLERANCE * storage
    ]
    # Their sum stays below one: the long-time modulus is larger than what rounding to 14 digits may add.
    shares = np.array([float(f"{share:.14g}") for share in shear.E / shear.E_unrelaxed])
    return Deck(
        name, few, shear, shares, chosen, float(K), float(nu), window, T_ref, wlf, (temperatures, log10_aT), error,
        tuple(notes), tuple(extrapolated),
    )  # fmt: skip


def fewest_terms(material: Prony, lowest: float, highest: float, tolerance: float) -> tuple[Prony, float]:
    """Return a series with the fewest equally spaced terms that keeps both moduli, and its error.

    Times are spaced evenly in their logarithm over the window [Hz] and their weights solve a non-negative least-squares
    problem of relative errors; the number of terms rises until the larger root-mean-square error of storage and loss is
    below the tolerance. The given material and zero where no shorter series serves.
    """
    if not 0 < lowest < highest < np.inf:
        raise InputError(f"window {lowest:g} to {highest:g} Hz: expected a positive window, lowest first")
    count = max(int(np.log10(highest / lowest) * _POINTS_PER_DECADE), 2)
    omega = 2.0 * np.pi * np.geomspace(lowest, highest, count)
    exact = material.complex_modulus(omega)
    if not np.all(exact.imag > 0):
        return material, 0.0
    for terms in range(1, material.E.size):
        middle = np.array([1.0 / np.sqrt(omega[0] * omega[-1])])
        rho = np.geomspace(1.0 / omega[-1], 1.0 / omega[0], terms) if terms > 1 else middle
        rows = moduli_of_terms(np.log(omega), np.log(rho)) / np.concatenate([exact.real, exact.imag])[:, None]
        scale = 1.0 / np.linalg.norm(rows, axis=0)
        weight = scale * nnls(rows * scale, np.ones(len(rows)), maxiter=NNLS_STEPS_PER_COLUMN * rows.shape[1])[0]
        error = max(float(np.sqrt(np.mean(part**2))) for part in np.split(rows @ weight - 1.0, 2))
        if error <= tolerance:
            kept = weight[:-1] > 0
            return Prony(weight[-1], weight[:-1][kept], rho[kept], material.nu), error
    return material, 0.0


def _law_of(
    law: ShiftLaw | None, T_ref: float, T: Floats, log10_aT: Floats, b_T: Floats
) -> tuple[tuple[float, float] | None, list[str]]:
    """Return C1 and C2 where a law holds, and the remarks on the shifts."""
    span = f" Measured from {np.nanmin(T):.6g} to {np.nanmax(T):.6g} degC." if T.size else ""
    C1, C2 = (np.nan, np.nan) if law is None or np.unique(T).size == 1 else (law.C1, law.C2)
    notes = []
    if law is not None and law.holds and np.isfinite([C1, C2]).all() and C2 > 0:
        name = "the WLF law" if law.name == "wlf" else f"Arrhenius' law, {law.activation_energy:.6g} J/mol, "
        same = "" if law.name == "wlf" else "written as the WLF law with C2 = T_ref in kelvin, the same function"
        notes.append(f"Shifts by {name}{same}.{span}")
    else:
        reason = "The shifts follow a straight line over temperature, a WLF law without finite constants"
        if np.isnan(C1):
            reason = "No shift law is known"
        elif law is not None and not law.holds:
            reason = "Neither WLF nor Arrhenius describes the shifts within their uncertainty"
        C1 = np.nan
        notes.append(f"{reason}; the material holds at {T_ref:.6g} degC only.{span}")
        if T.size:
            table = ", ".join(f"({t:.6g}, {a:.6g})" for t, a in zip(T, log10_aT, strict=True))
            notes.append(f"Shifts as measured, not expressed below: (temperature in degC, log10 a_T) = {table}.")
    factors = b_T[np.isfinite(b_T)]
    if factors.size and np.ptp(factors) > 1e-6:
        notes.append(
            f"The moduli change with temperature too, by factors b_T from {factors.min():.4g} to {factors.max():.4g}; "
            "this is not expressed below."
        )
    return None if np.isnan(C1) else (C1, C2), notes


def _abaqus(deck: Deck) -> list[str]:
    label = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in deck.name).upper()
    label = label if label[:1].isalpha() else f"M{label}"
    lines = [*deck.remarks("**"), f"*MATERIAL, NAME={label[:80]}"]
    if deck.bulk == "incompressible":
        lines += ["** incompressible: take hybrid elements", "*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS"]
        lines.append(f"{0.5 * deck.shear.E_unrelaxed:.14g}, 0.")
    else:
        lines += ["*ELASTIC, MODULI=INSTANTANEOUS", f"{deck.E_unrelaxed:.14g}, {deck.nu:.14g}"]
    lines += ["*VISCOELASTIC, TIME=PRONY"] * bool(deck.shares.size)
    for share, time in zip(deck.shares, deck.shear.rho, strict=True):
        lines.append(f"{share:.14g}, {share if deck.bulk == 'relaxing' else 0.0:.14g}, {time:.14g}")
    if deck.wlf is not None:
        lines += ["** log10 a_T = -C1 (T - T_ref)/(C2 + T - T_ref), temperatures in degC", "*TRS, DEFINITION=WLF"]
        lines.append(f"{deck.T_ref:.14g}, {deck.wlf[0]:.14g}, {deck.wlf[1]:.14g}")
    return lines


def _ansys(deck: Deck) -> list[str]:
    lines = deck.remarks("!")
    if deck.bulk == "incompressible":
        lines += ["! incompressible: take elements with mixed u-P formulation", "TB,HYPER,1,1,2,NEO"]
        lines.append(f"TBDATA,1,{deck.shear.E_unrelaxed:.14g},0  ! instantaneous shear modulus")
    else:
        lines += [f"MP,EX,1,{deck.E_unrelaxed:.14g}  ! instantaneous modulus", f"MP,PRXY,1,{deck.nu:.14g}"]
    for name in ("SHEAR", "BULK")[: 1 + (deck.bulk == "relaxing")] if deck.shares.size else ():
        lines.append(f"TB,PRONY,1,,{deck.shares.size},{name}")
        for i, (share, time) in enumerate(zip(deck.shares, deck.shear.rho, strict=True)):
            lines.append(f"TBDATA,{2 * i + 1},{share:.14g},{time:.14g}")
    if deck.wlf is not None:
        lines.append("TB,SHIFT,1,,3,WLF")
        lines.append(f"TBDATA,1,{deck.T_ref:.14g},{deck.wlf[0]:.14g},{deck.wlf[1]:.14g}  ! temperatures in degC")
    return lines


def _comsol(deck: Deck) -> list[str]:
    relaxed = deck.shear.E_relaxed
    solid = {
        "incompressible": [f"G = {relaxed:.14g} [Pa], nearly incompressible material with mixed formulation"],
        "constant": [f"G = {relaxed:.14g} [Pa]", f"K = {deck.K:.14g} [Pa]"],
        "relaxing": [f"E = {2.0 * (1.0 + deck.nu) * relaxed:.14g} [Pa]", f"nu = {deck.nu:.14g}"],
    }[deck.bulk]
    lines = [*deck.remarks("%"), "% Linear elastic material, long-term moduli:", *(f"%   {line}" for line in solid)]
    if deck.bulk == "relaxing":
        lines.append("% Viscoelasticity: deviatoric and volumetric, with the same relative moduli in both;")
        lines.append("%   a version that has the deviatoric one only keeps the bulk modulus constant.")
    else:
        lines.append("% Viscoelasticity: deviatoric; generalized Maxwell.")
    if deck.wlf is not None:
        lines.append("% Thermal effects, Williams-Landel-Ferry:")
        lines.append(f"%   T0 = {deck.T_ref + ZERO_CELSIUS:.14g} [K]")
        lines += [f"%   C1 = {deck.wlf[0]:.14g}", f"%   C2 = {deck.wlf[1]:.14g} [K]"]
    lines.append("% Branches, to load into the table: number, shear modulus in Pa, relaxation time in s")
    for i, (weight, time) in enumerate(zip(deck.shear.E, deck.shear.rho, strict=True), 1):
        lines.append(f"{i} {weight:.14g} {time:.14g}")
    return lines


def _field(value: float) -> str:
    """Return the most digits of a number that ten characters hold."""
    texts = ["0.0"] if value == 0.0 else [re.sub(r"E([+-])0*(?=\d)", r"E\1", f"{value:.{n}E}") for n in range(6, 0, -1)]
    return next(text for text in (text.replace("E+", "E") for text in texts) if len(text) <= 10).rjust(10)


def _lsdyna(deck: Deck) -> list[str]:
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
        A, B, T_ref = -deck.wlf[0] * float(np.log(10.0)), deck.wlf[1], deck.T_ref + ZERO_CELSIUS
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
    return [*lines, "*END"]


def _json(deck: Deck) -> list[str]:
    shear, tension = deck.shear, deck.tension
    document = {
        "name": deck.name,
        "units": {"modulus": "Pa", "time": "s", "temperature": "degC", "frequency": "Hz"},
        "window": list(deck.window),
        "T_ref": deck.T_ref,
        "bulk": deck.bulk,
        "K_unrelaxed": deck.K if np.isfinite(deck.K) else None,
        "nu_unrelaxed": deck.nu,
        "shear": {"G_relaxed": shear.E_relaxed, "G_unrelaxed": shear.E_unrelaxed}
        | {"G": shear.E.tolist(), "rho": shear.rho.tolist(), "shares": deck.shares.tolist()},
        "tension": {"E_relaxed": tension.E_relaxed, "E": tension.E.tolist(), "rho": tension.rho.tolist()},
        "rms_relative_error": deck.error,
        "wlf": None if deck.wlf is None else {"C1": deck.wlf[0], "C2": deck.wlf[1]},
        "shifts": {
            "temperature": deck.shifts[0].tolist(),
            "log10_aT": [None if np.isnan(value) else value for value in deck.shifts[1].tolist()],
        },
        "notes": list(deck.notes),
        "warnings": list(deck.warnings),
    }
    return [json.dumps(document, indent=1, allow_nan=False)]


_WRITERS: dict[str, Callable[[Deck], list[str]]]
_WRITERS = {"abaqus": _abaqus, "ansys": _ansys, "comsol": _comsol, "lsdyna": _lsdyna, "json": _json}


def deck_text(deck: Deck, code: Code | str) -> str:
    """Return a material in the input language of a simulation code."""
    return "\n".join(_WRITERS[code](deck)) + "\n"

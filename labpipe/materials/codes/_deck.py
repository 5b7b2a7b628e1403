r"""The input of a simulation code for a material: shear and bulk series, shift law, window, warnings.

Codes part a solid into shear and volume. From the tension modulus E(t) and what the bulk modulus
does follows the shear modulus, exactly and with as many terms:

- ``relaxing``: Poisson's ratio is constant, so that G(t) = E(t)/2(1 + ν) and K(t) = E(t)/3(1 − 2ν);
- ``constant``: K = E(0)/3(1 − 2ν) does not relax. Compliances add, 1/G = 3/E − 1/(3K) of the
  transforms, so that the retardation times of G are those of E;
- ``incompressible``: G(t) = E(t)/3.

Where the shear modulus was measured, it is G(t) that is kept, and E(t) that follows.

References
----------
N. W. Tschoegl, The Phenomenological Theory of Linear Viscoelastic Behavior, Springer, 1989, ch. 11.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, get_args

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials._shift_law import ShiftLaw
from labpipe.materials.prony import Prony, Retardation, relaxation_from_creep
from labpipe.materials.spectrum import fewest_terms

Bulk = Literal["constant", "relaxing", "incompressible"]
BULKS: tuple[str, ...] = get_args(Bulk)
"""What the bulk modulus does while the shear modulus relaxes."""

_SMALLEST = 1e-12  # long-time over instantaneous modulus that is left of 1 - sum in double precision
_ENOUGH = 1e-9  # the same, of which no more is asked
_OF_TOLERANCE = 1e-3  # of the storage modulus at the end of the window, which a liquid may be wrong by
_WIDTH = 74  # of a line of remarks; LS-DYNA reads 80 characters
_MOST_TERMS = 17  # LS-DYNA reads 18, of which one is the long-time modulus


@dataclass(frozen=True, slots=True)
class Deck:
    """A material as simulation codes need it.

    Attributes
    ----------
    name : str
    tension : Prony
        The reduced series of the tension modulus.
    shear : Prony
        Relaxation terms of the shear modulus, as E_relaxed, E and rho.
    shares : array (term,)
        G_i over the instantaneous shear modulus, as they are printed; their sum is below one.
    bulk : {"constant", "relaxing", "incompressible"}
    K : float [Pa]
        Instantaneous bulk modulus; infinite for an incompressible material.
    nu : float
        Instantaneous Poisson's ratio.
    window : (float, float) [Hz]
    T_ref : float [degC]
    wlf : (float, float), optional
        C1 and C2 [K] about T_ref; None where no law holds.
    shifts : (array, array)
        Temperatures [degC] and log10 a_T.
    error : float
        Root-mean-square relative error of the worse modulus over the window.
    notes, warnings : tuple of str
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
    tolerance: float = 0.01,
) -> Deck:
    """Reduce a material to what simulation codes take.

    Parameters
    ----------
    material : Prony
        At T_ref.
    window : (float, float) [Hz]
        Lowest and highest frequency that was covered.
    T_ref : float [degC]
        Reference temperature.
    name : str
        Of the material.
    law : ShiftLaw, optional
        The shift law about T_ref.
    shifts : (array, array)
        Temperatures [degC] and log10 a_T as measured.
    b_T : array
        Vertical factors, which no code takes.
    bulk : {"constant", "relaxing", "incompressible"}, optional
        What the bulk modulus does; by default Poisson's ratio is constant, and at ν = 0.5 the
        material incompressible.
    measured : {"tension", "shear"}
        Which modulus the series was measured as; it is the one that stays as it is.
    tolerance : float
        Root-mean-square relative error that the reduction of terms may cost.

    Raises
    ------
    InputError
        The bulk modulus cannot be as asked for; the material has no finite instantaneous modulus.
    """
    chosen = _bulk(material, bulk)
    few, error = _reduced(material, window, tolerance)
    few, liquid = _with_rest(few, window, tolerance, flows=material.is_liquid)
    K = np.inf if chosen == "incompressible" else few.E_unrelaxed / (3.0 * (1.0 - 2.0 * few.nu))
    nu = 0.5 if chosen == "incompressible" else few.nu
    shear = _shear(few, chosen, K, nu, measured)
    wlf = _constants(law, np.asarray(shifts[0], float))
    omega = 2.0 * np.pi * np.asarray(window)
    storage = few.complex_modulus(omega).real
    times = [0.5 / np.pi / f for f in reversed(window)]
    notes = [
        f"{name}: linear viscoelastic material at {T_ref:.6g} degC; SI units (Pa, s)",
        f"Valid from {window[0]:.4g} to {window[1]:.4g} Hz, times from {times[0]:.4g} to {times[1]:.4g} s; "
        "what lies outside is extrapolated.",
        f"{few.E.size} terms; root-mean-square error against the full series within the window: "
        f"{max(100 * error, 1e-4):.2g} % of the worse modulus in tension.",
        _bulk_note(chosen, K, nu, measured),
        *_law_notes(law, wlf, T_ref, shifts, b_T),
    ]
    notes += [liquid] if liquid else []
    return Deck(
        name=name,
        tension=few,
        shear=shear,
        shares=_shares(shear),
        bulk=chosen,
        K=float(K),
        nu=float(nu),
        window=window,
        T_ref=T_ref,
        wlf=wlf,
        shifts=(np.asarray(shifts[0], float), np.asarray(shifts[1], float)),
        error=error,
        notes=tuple(notes),
        warnings=tuple(_extrapolated(few, storage, window, tolerance)),
    )


def _bulk(material: Prony, bulk: Bulk | None) -> Bulk:
    if bulk is None:
        return "incompressible" if material.nu == 0.5 else "relaxing"
    if bulk not in BULKS:
        raise InputError(f'bulk = "{bulk}" is unknown; expected one of {", ".join(BULKS)}')
    if material.nu == 0.5 and bulk != "incompressible":
        raise InputError(
            f'bulk = "{bulk}": at nu = 0.5 the bulk modulus is infinite; give nu below 0.5 or bulk = "incompressible"'
        )
    return bulk


def _reduced(material: Prony, window: tuple[float, float], tolerance: float) -> tuple[Prony, float]:
    """Return the fewest terms within the tolerance, or as many as codes take."""
    if not np.isfinite(material.E_unrelaxed):
        message = "the material has no finite instantaneous modulus (a dashpot stands in parallel); codes need one"
        raise InputError(message)
    few, error = fewest_terms(material, *window, tolerance)
    while few.E.size > _MOST_TERMS and tolerance < 1.0:
        tolerance *= 1.5
        few, error = fewest_terms(material, *window, tolerance)
    return few, error


def _with_rest(few: Prony, window: tuple[float, float], tolerance: float, *, flows: bool) -> tuple[Prony, str]:
    """Leave a liquid a long-time modulus so small that it is not seen; codes need shares below one."""
    storage = float(few.complex_modulus(2.0 * np.pi * window[0]).real)
    rest = max(_OF_TOLERANCE * tolerance * storage, _SMALLEST * few.E_unrelaxed)
    is_enough = few.E_relaxed >= min(rest, _ENOUGH * few.E_unrelaxed)
    if is_enough and not flows:
        return few, ""
    modulus = few.E_relaxed if is_enough else rest
    text = (
        f"{'The material flows: its long-time modulus is zero. ' if flows else ''}{modulus:.3g} Pa is written as its "
        "long-time modulus, because the shares of the terms must add up to less than one; that is "
        f"{modulus / storage:.1e} of the storage modulus at the lower end of the window."
    )
    return Prony(modulus, few.E, few.rho, few.nu), text


def _shear(few: Prony, bulk: Bulk, K: float, nu: float, measured: str) -> Prony:
    if bulk != "constant" or measured == "shear":
        return few.scaled(0.5 / (1.0 + (few.nu if measured == "shear" else nu)))
    C, tau = few.creep_terms()
    family = relaxation_from_creep(
        Retardation(3.0 / few.E_unrelaxed - 1.0 / (3.0 * K), 3.0 * C, tau, 3.0 * few.fluidity)
    )
    return Prony(family.relaxed, family.weight, family.time, few.nu)


def _shares(shear: Prony) -> Floats:
    """Return the terms over the instantaneous modulus, rounded as printed, with a sum below one."""
    shares = [Decimal(f"{share:.14g}") for share in shear.E / shear.E_unrelaxed]
    if shares:
        most = Decimal(1) - Decimal(f"{shear.E_relaxed / shear.E_unrelaxed:.6g}")
        excess = sum(shares) - most
        if sum(shares) >= 1 or (excess > 0 and most < 1):
            largest = shares.index(max(shares))
            shares[largest] -= max(excess, Decimal(0))
    return np.array([float(share) for share in shares])


def _constants(law: ShiftLaw | None, T: Floats) -> tuple[float, float] | None:
    """Return WLF constants, where a law with finite ones is known and holds."""
    if law is None or np.unique(T).size == 1 or not law.holds:
        return None
    C1, C2 = law.as_wlf
    return (C1, C2) if np.isfinite([C1, C2]).all() and C2 > 0 else None


def _bulk_note(bulk: Bulk, K: float, nu: float, measured: str) -> str:
    kept = "The shear modulus was measured and stays as it is." if measured == "shear" else ""
    if bulk == "incompressible":
        return f"Incompressible: the bulk modulus is infinite. {kept}".strip()
    if bulk == "relaxing":
        text = f"Poisson's ratio is constant, nu = {nu:.6g}: the bulk modulus relaxes as the shear modulus does."
        return f"{text} {kept}".strip()
    return (
        f"The bulk modulus is constant, K = {K:.6g} Pa, from nu = {nu:.6g} of the instantaneous modulus. {kept}"
    ).strip()


def _law_notes(
    law: ShiftLaw | None,
    wlf: tuple[float, float] | None,
    T_ref: float,
    shifts: tuple[Sequence[float] | Floats, Sequence[float] | Floats],
    b_T: Sequence[float] | Floats,
) -> list[str]:
    T, log10_aT = (np.asarray(part, float) for part in shifts)
    span = f" Measured from {np.nanmin(T):.6g} to {np.nanmax(T):.6g} degC." if T.size else ""
    notes = []
    if wlf is None:
        notes.append(f"{_without_law(law, T)}; the material holds at {T_ref:.6g} degC only.{span}")
    elif law is not None and law.name != "wlf":
        notes.append(
            f"Shifts by Arrhenius' law, {law.activation_energy:.6g} J/mol, written as the WLF law with C2 = T_ref in "
            f"kelvin, which is the same function.{span}"
        )
    else:
        notes.append(f"Shifts by the WLF law.{span}")
    if wlf is None and T.size:
        table = ", ".join(f"({t:.6g}, {a:.6g})" for t, a in zip(T, log10_aT, strict=True))
        notes.append(f"Shifts as measured, not expressed below: (temperature in degC, log10 a_T) = {table}.")
    factors = np.asarray(b_T, float)
    factors = factors[np.isfinite(factors)]
    if factors.size and np.ptp(factors) > 1e-6:
        notes.append(
            f"The moduli change with temperature too, by factors b_T from {factors.min():.4g} to {factors.max():.4g}; "
            "this is not expressed below."
        )
    return notes


def _without_law(law: ShiftLaw | None, T: Floats) -> str:
    """Say why no law is written."""
    if law is None or np.unique(T).size == 1:
        return "No shift law is known"
    if not law.holds:
        return "Neither WLF nor Arrhenius describes the shifts within their uncertainty"
    return "The shifts follow a straight line over temperature, a WLF law without finite constants"


def _extrapolated(few: Prony, storage: Floats, window: tuple[float, float], tolerance: float) -> list[str]:
    """Say where the moduli after no time and after an infinite one lie beyond what was measured."""
    found = []
    if few.E_unrelaxed > (1.0 + tolerance) * storage[1]:
        found.append(
            f"the instantaneous modulus, {few.E_unrelaxed:.4g} Pa in tension, is extrapolated: at {window[1]:.4g} Hz, "
            f"the upper end of the window, the storage modulus is {storage[1]:.4g} Pa"
        )
    if few.E_relaxed < (1.0 - tolerance) * storage[0]:
        found.append(
            f"the long-time modulus, {few.E_relaxed:.4g} Pa in tension, is extrapolated: at {window[0]:.4g} Hz, the "
            f"lower end of the window, the storage modulus is {storage[0]:.4g} Pa"
        )
    return found

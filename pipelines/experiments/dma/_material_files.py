"""Materials as texts for other programs: ANSYS, Abaqus, JSON; reduced in terms."""

import json
from dataclasses import dataclass
from typing import Any

import xarray as xr

from labpipe import materials
from labpipe.arrays import Floats
from labpipe.materials import Prony

TOLERANCE = 0.01
"""Largest root-mean-square relative error of the reduced series in both moduli."""
_HOLDS = 4.0  # chi-square per degree of freedom: twice the stated uncertainty on the whole


@dataclass(frozen=True, slots=True)
class Series:
    """A Prony series in tension, with the error that the reduction of its terms cost (rms)."""

    relaxed: float
    E: Floats
    rho: Floats
    nu: float
    error: float

    @property
    def unrelaxed(self) -> float:
        """Modulus after no time, Pa."""
        return self.relaxed + float(self.E.sum())


def fewest_terms(curve: xr.Dataset, tolerance: float = TOLERANCE) -> Series:
    """Return the series with the fewest terms that reproduces a master curve.

    See :func:`labpipe.materials.fewest_terms`.

    Parameters
    ----------
    curve : Dataset
        The result of the stage ``master_curve``.
    tolerance : float
        Root-mean-square relative error over the covered window.
    """
    full = Prony(float(curve["E_relaxed"]), curve["E"].values, curve["rho"].values, float(curve["nu"]))
    covered = curve["reduced_frequency"].values
    few, error = materials.fewest_terms(full, float(covered.min()), float(covered.max()), tolerance)
    return Series(few.E_relaxed, few.E, few.rho, few.nu, error)


def holds(law: dict[str, Any]) -> bool:
    """Tell whether a shift law describes the shifts within their uncertainty.

    A law that was fitted to the moduli themselves has no free shifts to be judged by.
    """
    if law["chi_square"] is None or not law["freedom"]:
        return True
    return bool(law["chi_square"] / law["freedom"] <= _HOLDS)


def _is_wlf(law: dict[str, Any]) -> bool:
    constants = [law.get("C1"), law.get("C2")]
    return law["name"] == "wlf" and None not in constants and holds(law)


def ansys(series: Series, law: dict[str, Any], T_ref: float) -> str:
    """Return the series as APDL commands; shear and bulk relax alike because ν is constant."""
    shares = series.E / series.unrelaxed
    lines = [
        "! linear viscoelastic solid; SI units (Pa, s)",
        f"MP,EX,1,{series.unrelaxed:.8g}  ! instantaneous modulus",
        f"MP,PRXY,1,{series.nu:.6g}",
        *_ansys_table("SHEAR", shares, series.rho),
        *_ansys_table("BULK", shares, series.rho),
    ]
    if _is_wlf(law):
        lines += ["TB,SHIFT,1,,3,WLF", f"TBDATA,1,{T_ref:.8g},{law['C1']:.8g},{law['C2']:.8g}  ! temperatures in degC"]
    return "\n".join(lines) + "\n"


def _ansys_table(name: str, shares: Floats, times: Floats) -> list[str]:
    lines = [f"TB,PRONY,1,,{shares.size},{name}"]
    for i, (share, time) in enumerate(zip(shares, times, strict=True)):
        lines.append(f"TBDATA,{2 * i + 1},{share:.8g},{time:.8g}")
    return lines


def abaqus(series: Series, law: dict[str, Any], T_ref: float, name: str) -> str:
    """Return the series as Abaqus keywords; relative shear and bulk moduli are equal."""
    lines = [
        "** linear viscoelastic solid; SI units (Pa, s)",
        f"*MATERIAL, NAME={name.upper()}",
        "*ELASTIC, MODULI=INSTANTANEOUS",
        f"{series.unrelaxed:.8g}, {series.nu:.6g}",
        "*VISCOELASTIC, TIME=PRONY",
    ]
    for share, time in zip(series.E / series.unrelaxed, series.rho, strict=True):
        lines.append(f"{share:.8g}, {share:.8g}, {time:.8g}")
    if _is_wlf(law):
        lines += ["*TRS, DEFINITION=WLF", f"{T_ref:.8g}, {law['C1']:.8g}, {law['C2']:.8g}"]
    return "\n".join(lines) + "\n"


def as_csv(curve: xr.Dataset, series: Series) -> str:
    """Return terms and shift factors as rows that any spreadsheet reads, units in the heads."""
    lines = [
        f"# E(t) = E_relaxed + sum E exp(-t/rho) at T_ref = {float(curve['T_ref']):.8g} degC",
        f"# nu = {float(curve['nu']):.6g}",
        "series,term,rho / s,E / Pa,extrapolated",
        f"full,E_relaxed,inf,{float(curve['E_relaxed']):.8g},0",
    ]
    outside = curve["extrapolated"].values.astype(int)
    for i, (time, weight) in enumerate(zip(curve["rho"].values, curve["E"].values, strict=True)):
        lines.append(f"full,{i + 1},{time:.8g},{weight:.8g},{outside[i]}")
    lines.append(f"reduced,E_relaxed,inf,{series.relaxed:.8g},0")
    for i, (time, weight) in enumerate(zip(series.rho, series.E, strict=True)):
        lines.append(f"reduced,{i + 1},{time:.8g},{weight:.8g},0")
    lines += ["", "temperature / degC,log10_aT,u_log10_aT,b_T,u_b_T,level"]
    names = ("temperature", "log10_aT", "u_log10_aT", "b_T", "u_b_T", "level")
    columns = [curve[name].values for name in names]
    lines += [",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"


def as_json(curve: xr.Dataset, series: Series) -> str:
    """Return the full and the reduced series with the shift law as JSON."""
    document = {
        "units": {"E": "Pa", "rho": "s", "temperature": "degC"},
        "T_ref": float(curve["T_ref"]),
        "nu": float(curve["nu"]),
        "full": {
            "E_relaxed": float(curve["E_relaxed"]),
            "E": curve["E"].values.tolist(),
            "rho": curve["rho"].values.tolist(),
            "extrapolated": curve["extrapolated"].values.astype(bool).tolist(),
        },
        "reduced": {
            "E_relaxed": series.relaxed,
            "E": series.E.tolist(),
            "rho": series.rho.tolist(),
            "rms_relative_error": series.error,
        },
        "shift_law": json.loads(curve.attrs["law"]),
    }
    return json.dumps(document, indent=1)

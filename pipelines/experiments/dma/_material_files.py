"""A stored master curve as a material for other programs: simulation codes, spreadsheets."""

import json
from typing import Literal

import xarray as xr

from labpipe.materials import Bulk, Deck, Prony, ShiftLaw, make_deck
from pipelines.experiments.dma.settings import Dma


def deck(master_curve: xr.Dataset, *, settings: Dma, name: str, bulk: Bulk | None = None) -> Deck:
    """Return the material as simulation codes take it, of the result of the stage ``master_curve``."""
    return of_curve(master_curve, "shear" if settings.mode in ("shear", "torsion") else "tension", name, bulk)


def of_curve(
    curve: xr.Dataset, measured: Literal["tension", "shear"] = "tension", name: str = "", bulk: Bulk | None = None
) -> Deck:
    """Return a stored master curve as simulation codes take it."""
    full = Prony(float(curve["E_relaxed"]), curve["E"].values, curve["rho"].values, float(curve["nu"]))
    covered = curve["reduced_frequency"].values
    return make_deck(
        full,
        (float(covered.min()), float(covered.max())),
        float(curve["T_ref"]),
        name=name or "material",
        law=ShiftLaw.of(json.loads(curve.attrs["law"])),
        shifts=(curve["temperature"].values, curve["log10_aT"].values),
        b_T=curve["b_T"].values,
        bulk=bulk,
        measured=measured,
    )


def as_csv(curve: xr.Dataset, reduced: Prony) -> str:
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
    lines.append(f"reduced,E_relaxed,inf,{reduced.E_relaxed:.8g},0")
    for i, (time, weight) in enumerate(zip(reduced.rho, reduced.E, strict=True)):
        lines.append(f"reduced,{i + 1},{time:.8g},{weight:.8g},0")
    lines += ["", "temperature / degC,log10_aT,u_log10_aT,b_T,u_b_T,level"]
    names = ("temperature", "log10_aT", "u_log10_aT", "b_T", "u_b_T", "level")
    columns = [curve[name].values for name in names]
    lines += [",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines) + "\n"

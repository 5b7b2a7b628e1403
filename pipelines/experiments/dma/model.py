"""One spectrum and all shifts, fitted to isothermal sweeps: the master curve."""

import json
from dataclasses import asdict
from math import hypot, inf, nan, pi, sqrt, tan
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError
from labpipe.materials import Bulk, Deck, MasterCurve, Prony, ShiftLaw, make_deck
from labpipe.variables import variable, with_u
from pipelines.experiments.dma.measured import shift_table, shifts_at
from pipelines.experiments.dma.settings import Dma

_SWITCH: dict[str, bool | Literal["auto"]] = {"auto": "auto", "on": True, "off": False}
_SLOW_DECADES = 2.0  # at the slow end, over which the loss tells how it goes on


def master_curve(sweeps: xr.Dataset, shifts: Path | None = None, *, settings: Dma) -> xr.Dataset:
    """Shift the sweeps onto one curve and fit its spectrum.

    The result is the material that other experiments refer to: ``E_relaxed`` and ``nu``, and
    ``E`` and ``rho`` over ``term``, at the reference temperature; of a short melt that is the temperature of equal
    friction. Shifts set by hand are where the fit begins, or what it takes.
    """
    fit, melt = settings.fit, settings.melt
    reference = None if settings.T_ref is None else settings.T_ref.value
    if melt is not None:
        if reference is None:
            raise InputError("melt corrects T_ref for the molar mass; give T_ref, that of long chains")
        reference = materials.isofrictional_temperature(reference, melt.molar_mass, melt.fox_flory)
    T, by_hand = sweeps["temperature"].values, None
    if shifts is not None:
        by_hand = shifts_at(shift_table(shifts, settings), T)
        if not np.isfinite(by_hand).all():
            missing = ", ".join(f"{t:.4g}" for t in T[~np.isfinite(by_hand)])
            hint = "Give one for each isotherm, or leave fit.shifts out."
            raise SourceError(shifts, f"the table holds no shift for {missing} °C", hint=hint)
    made = materials.master_curve(
        sweeps,
        reference,
        None if fit.law == "free" else fit.law,
        vertical=fit.vertical,
        delay=_SWITCH[fit.delay],
        levels=_SWITCH[fit.levels],
        robust=fit.robust,
        noise_ratio=fit.noise_ratio,
        shifts=by_hand,
        refine=fit.refine,
        nu=settings.nu.value,
    )
    return _stored(made, sweeps, settings.nu.u)


def _stored(made: MasterCurve, sweeps: xr.Dataset, u_nu: float) -> xr.Dataset:
    """Return everything the page and other experiments need as one Dataset."""
    result = made.to_dataset()
    scalars = {
        "E_relaxed": (made.prony.E_relaxed, "Pa", "modulus after an infinite time"),
        "E_unrelaxed": (made.prony.E_unrelaxed, "Pa", "instantaneous modulus"),
        "T_ref": (made.T_ref, "degC", "reference temperature"),
    }
    known = {name: variable((), float(value), units, text) for name, (value, units, text) in scalars.items()}
    known |= with_u("nu", (), float(made.prony.nu), float(u_nu), "1", "Poisson's ratio")
    known |= with_u("delay", (), float(made.delay), float(made.u_delay), "s", "delay of the instrument's phase")
    result.attrs = {name: value for name, value in result.attrs.items() if name not in known}
    result = result.assign(known)
    factor = sweeps.attrs.get("u_modulus_factor", 0.0) / sweeps.attrs["modulus_factor"]
    result = result.assign(ends(result, float(np.hypot(factor, sweeps.attrs.get("u_scale", 0.0)))))
    curves = made.kramers_kronig.curves
    for name in map(str, curves.data_vars):
        result[f"kk_{name}"] = ("kk_frequency", curves[name].values, dict(curves[name].attrs))
    result = result.assign_coords(
        kk_frequency=variable(
            "kk_frequency", curves["frequency"].values, "Hz", "frequency at the reference temperature"
        )
    )
    for name in ("extrapolated", "determined"):
        result[name] = result[name].astype(np.int8)
    kk = asdict(made.kramers_kronig)
    kk.pop("curves")
    result.attrs |= {
        "kramers_kronig": json.dumps(kk),
        "superposition": json.dumps(asdict(made.verdict), ensure_ascii=False),
        "laws": json.dumps({name: _law(law) for name, law in made.laws.items()}),
        "law": json.dumps(_law(made.law)),
        "noise": json.dumps(made.noise),
        "notes": json.dumps(made.warnings, ensure_ascii=False),
        "u_modulus_factor": sweeps.attrs.get("u_modulus_factor", 0.0),
        "modulus_factor": sweeps.attrs["modulus_factor"],
        "u_scale": sweeps.attrs.get("u_scale", 0.0),
    }
    return result


def _law(law: Any) -> dict[str, Any]:
    """Return a shift law as plain numbers; None for a number that it does not have."""
    entry = {name: getattr(law, name) for name in ("name", "T_ref", "chi_square", "freedom")}
    entry["parameters"] = list(law.parameters)
    if law.name == "wlf":
        entry |= {name: float(getattr(law, name)) for name in ("C1", "u_C1", "C2", "u_C2")}
    else:
        entry["activation_energy"] = law.activation_energy
        entry["u_activation_energy"] = float(np.sqrt(law.covariance[0, 0]))
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in entry.items()}


def ends(curve: xr.Dataset, scale: float) -> dict[str, Any]:
    """Return ``relaxed_modulus`` and ``unrelaxed_modulus`` [Pa], each with its standard uncertainty.

    Both are NaN where the loss at that end is so large that the storage modulus may still change by
    all of itself: the series' modulus is extrapolated there. The uncertainty is that of
    extrapolating the loss, of the noise at the end, and `scale`, the relative one of all moduli.
    """
    frequency = curve["reduced_frequency"].values
    found: dict[str, Any] = {}
    for name, ratio in (("relaxed", frequency), ("unrelaxed", 1.0 / frequency)):
        # mirrored, the loss of the fast end falls as that of the slow one does
        left = still_falls(ratio, curve["master_loss"].values)
        last, u_last = (float(curve[part][int(np.argmin(ratio))]) for part in ("master_storage", "u_master_storage"))
        modulus = float(curve[f"E_{name}"]) if left < last else nan
        u = hypot(left / sqrt(3.0), modulus * u_last / last, modulus * scale) if left < last else nan
        found |= with_u(f"{name}_modulus", (), modulus, u, "Pa", f"{name} modulus, where the data determine it")
    return found


def still_falls(frequency: Floats, loss: Floats) -> float:
    """Return how far [Pa] the storage modulus falls beyond the slow end, if the loss goes on so.

    A loss that falls as the power m of the frequency belongs to a storage modulus that lies
    E″ cot(m π/2) above its end (Kramers and Kronig); infinity where it does not fall.
    """
    order = np.argsort(frequency)
    f, e = frequency[order], loss[order]
    near = f <= f[0] * 10.0**_SLOW_DECADES
    if near.sum() < 2 or not np.all(e[near] > 0.0):
        return inf
    power = float(np.polyfit(np.log(f[near]), np.log(e[near]), 1)[0])
    return float(e[0]) / tan(0.5 * pi * min(power, 1.0)) if power > 0.0 else inf


def deck(master_curve: xr.Dataset, *, settings: Dma, name: str, bulk: Bulk | None = None) -> Deck:
    """Return the material as simulation codes take it."""
    curve, covered = master_curve, master_curve["reduced_frequency"].values
    return make_deck(
        Prony(float(curve["E_relaxed"]), curve["E"].values, curve["rho"].values, float(curve["nu"])),
        (float(covered.min()), float(covered.max())),
        float(curve["T_ref"]),
        name=name or "material",
        law=ShiftLaw.of(json.loads(curve.attrs["law"])),
        shifts=(curve["temperature"].values, curve["log10_aT"].values),
        b_T=curve["b_T"].values,
        bulk=bulk,
        measured="shear" if settings.is_shear else "tension",
    )

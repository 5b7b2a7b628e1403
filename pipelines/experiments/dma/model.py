"""One spectrum and all shifts, fitted to isothermal sweeps: the master curve."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.arrays import Floats
from labpipe.errors import InputError, SourceError
from labpipe.materials import MasterCurve
from labpipe.variables import variable, with_u
from pipelines.experiments.dma import _shift_tables as shift_tables
from pipelines.experiments.dma._ends import ends
from pipelines.experiments.dma.settings import Dma

_SWITCH: dict[str, bool | Literal["auto"]] = {"auto": "auto", "on": True, "off": False}


def master_curve(sweeps: xr.Dataset, shifts: Path | None = None, *, settings: Dma) -> xr.Dataset:
    """Shift the sweeps onto one curve and fit its spectrum.

    The result is the material that other experiments refer to: ``E_relaxed`` and ``nu``, and
    ``E`` and ``rho`` over ``term``, at the reference temperature. Shifts set by hand are where the
    fit begins, or what it takes.
    """
    fit = settings.fit
    by_hand = None if shifts is None else _by_hand(sweeps["temperature"].values, shifts, settings)
    made = materials.master_curve(
        sweeps,
        _reference(settings),
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


def _reference(settings: Dma) -> float | None:
    """Return the reference temperature; of a short melt that of equal friction."""
    if settings.melt is None:
        return None if settings.T_ref is None else settings.T_ref.value
    if settings.T_ref is None:
        raise InputError("melt corrects T_ref for the molar mass; give T_ref, that of long chains")
    melt = settings.melt
    return materials.isofrictional_temperature(settings.T_ref.value, melt.molar_mass, melt.fox_flory)


def _by_hand(T: Floats, shifts: Path, settings: Dma) -> Floats:
    """Return the shifts of a table at the measured temperatures."""
    found = shift_tables.at(shift_tables.read(shifts, settings), T)
    if not np.isfinite(found).all():
        missing = ", ".join(f"{t:.4g}" for t in T[~np.isfinite(found)])
        raise SourceError(
            shifts,
            f"the table holds no shift for {missing} °C",
            hint="Give one for each isotherm, or leave fit.shifts out.",
        )
    return found


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
        "starts": json.dumps(made.starts),
        "notes": json.dumps(made.warnings, ensure_ascii=False),
        "u_modulus_factor": sweeps.attrs.get("u_modulus_factor", 0.0),
        "modulus_factor": sweeps.attrs["modulus_factor"],
        "u_scale": sweeps.attrs.get("u_scale", 0.0),
    }
    return result


def _law(law: Any) -> dict[str, Any]:
    """Return a shift law as plain numbers; what it does not have is None."""
    entry = {
        "name": law.name,
        "T_ref": law.T_ref,
        "parameters": list(law.parameters),
        "chi_square": law.chi_square,
        "freedom": law.freedom,
    }
    if law.name == "wlf":
        entry |= {name: float(getattr(law, name)) for name in ("C1", "u_C1", "C2", "u_C2")}
    else:
        entry["activation_energy"] = law.activation_energy
        entry["u_activation_energy"] = float(np.sqrt(law.covariance[0, 0]))
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in entry.items()}

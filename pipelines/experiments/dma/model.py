"""One spectrum and all shifts, fitted to isothermal sweeps: the master curve."""

import json
from dataclasses import asdict
from typing import Any, Literal

import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.materials import MasterCurve
from labpipe.variables import variable
from pipelines.experiments.dma.settings import Dma

_SWITCH: dict[str, bool | Literal["auto"]] = {"auto": "auto", "on": True, "off": False}


def master_curve(sweeps: xr.Dataset, *, settings: Dma) -> xr.Dataset:
    """Shift the sweeps onto one curve and fit its spectrum.

    The result is the material that other experiments refer to: ``E_relaxed`` and ``nu``, and
    ``E`` and ``rho`` over ``term``, at the reference temperature.
    """
    fit = settings.fit
    made = materials.master_curve(
        sweeps,
        None if settings.T_ref is None else settings.T_ref.value,
        None if fit.law == "free" else fit.law,
        vertical=fit.vertical,
        delay=_SWITCH[fit.delay],
        levels=_SWITCH[fit.levels],
        robust=fit.robust,
        noise_ratio=fit.noise_ratio,
        nu=settings.nu.value,
    )
    return _stored(made, sweeps, settings.nu.u)


def _stored(made: MasterCurve, sweeps: xr.Dataset, u_nu: float) -> xr.Dataset:
    """Return everything the page and other experiments need as one Dataset."""
    result = made.to_dataset()
    scalars = {
        "E_relaxed": (made.prony.E_relaxed, "Pa", "modulus after an infinite time"),
        "E_unrelaxed": (made.prony.E_unrelaxed, "Pa", "instantaneous modulus"),
        "nu": (made.prony.nu, "1", "Poisson's ratio"),
        "u_nu": (u_nu, "1", "standard uncertainty: Poisson's ratio"),
        "T_ref": (made.T_ref, "degC", "reference temperature"),
        "delay": (made.delay, "s", "delay of the instrument's phase"),
        "u_delay": (made.u_delay, "s", "standard uncertainty: delay of the instrument's phase"),
    }
    for name, (value, units, text) in scalars.items():
        result.attrs.pop(name, None)
        result[name] = variable((), float(value), units, text)
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

"""One spectrum and all shifts, fitted to isothermal sweeps: the master curve."""

import json
from dataclasses import asdict
from math import inf, nan, pi, sqrt, tan
from typing import Any, Literal

import numpy as np
import xarray as xr

from labpipe import materials
from labpipe.arrays import Floats
from labpipe.materials import Bulk, Deck, Prony, ShiftLaw, make_deck
from labpipe.uncertainty import Source, budget_rows, combined_uncertainty
from labpipe.variables import variable, with_u
from pipelines.experiments.dma.glass_transition import over_frequency
from pipelines.experiments.dma.settings import Dma

_SWITCH: dict[str, bool | Literal["auto"]] = {"auto": "auto", "on": True, "off": False}


def master_curve(sweeps: xr.Dataset, *, settings: Dma) -> xr.Dataset:
    """Shift the sweeps onto one curve and fit its spectrum.

    The result is the material that other experiments refer to: ``E_relaxed`` and ``nu``, and
    ``E`` and ``rho`` over ``term``, at the reference temperature.
    """
    fit, nu = settings.fit, settings.nu
    made = materials.master_curve(
        sweeps,
        None if settings.T_ref is None else settings.T_ref.value,
        None if fit.law == "free" else fit.law,
        vertical=fit.vertical,
        delay=_SWITCH[fit.delay],
        nu=nu.value,
    )
    known = {
        "E_relaxed": variable((), float(made.prony.E_relaxed), "Pa", "modulus after an infinite time"),
        "E_unrelaxed": variable((), float(made.prony.E_unrelaxed), "Pa", "instantaneous modulus"),
        "T_ref": variable((), float(made.T_ref), "degC", "reference temperature"),
        **with_u("nu", (), float(made.prony.nu), float(nu.u), "1", "Poisson's ratio"),
        **with_u("delay", (), float(made.delay), float(made.u_delay), "s", "delay of the instrument's phase"),
    }
    result = made.to_dataset()
    result.attrs = {name: value for name, value in result.attrs.items() if name not in known}
    factor, u_scale = sweeps.attrs["u_modulus_factor"] / sweeps.attrs["modulus_factor"], sweeps.attrs["u_scale"]
    result = result.assign(known)
    transitions, no_transition = over_frequency(result)
    found = ends(result, scale=float(u_scale), **{"Poisson's ratio": float(factor)})
    result = result.merge(found).merge(transitions)
    result = result.assign({name: result[name].astype(np.int8) for name in ("extrapolated", "determined")})
    said = {
        "kramers_kronig": asdict(made.kramers_kronig),
        "superposition": asdict(made.verdict),
        "laws": {name: _law(law) for name, law in made.laws.items()},
        "law": _law(made.nearest_law),
        "noise": made.noise,
    }
    names = sweeps.attrs.keys() & {"u_modulus_factor", "modulus_factor", "u_scale", "strain"}
    attrs = {name: sweeps.attrs[name] for name in sorted(names)} | found.attrs | {"no_transition": no_transition}
    return result.assign_attrs({name: json.dumps(one, ensure_ascii=False) for name, one in said.items()} | attrs)


def _law(law: Any) -> dict[str, Any]:
    """Return a shift law as plain numbers; None for a number that it does not have."""
    own = ("C1", "u_C1", "C2", "u_C2") if law.name == "wlf" else ("activation_energy",)
    entry = {name: getattr(law, name) for name in ("name", "T_ref", "chi_square", "freedom", "parameters", *own)}
    if law.name != "wlf":
        entry["u_activation_energy"] = float(np.sqrt(law.covariance[0, 0]))
    return {key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in entry.items()}


def ends(curve: xr.Dataset, **scales: float) -> xr.Dataset:
    """Return ``relaxed_modulus`` and ``unrelaxed_modulus`` [Pa], each with its standard uncertainty.

    Both are NaN where the loss at that end is so large that the storage modulus may still change by
    all of itself: the series' modulus is extrapolated there. The uncertainty is that of extrapolating the loss, of the
    noise at the end, and of ``scales``, relative ones of all moduli by their source. The attribute ``budget`` is that
    of the relaxed modulus, where it is known.
    """
    frequency, found, attrs = curve["reduced_frequency"].values, dict[str, Any](), dict[str, str]()
    for name, ratio in (("unrelaxed", 1.0 / frequency), ("relaxed", frequency)):
        # mirrored, the loss of the fast end falls as that of the slow one does
        left = still_falls(ratio, curve["master_loss"].values)
        last, u_last = (float(curve[part][int(np.argmin(ratio))]) for part in ("master_storage", "u_master_storage"))
        modulus = u = nan
        if left < last:
            modulus = float(curve[f"E_{name}"])
            of_all = {"noise": u_last / last, **scales}
            sources = [Source(source, 1.0, one, "1", modulus) for source, one in of_all.items()]
            sources.append(Source("extrapolation", 0.0, left / sqrt(3.0), "Pa", 1.0))
            u, attrs = combined_uncertainty(sources), {"budget": json.dumps(budget_rows(sources))}
        found |= with_u(f"{name}_modulus", (), modulus, u, "Pa", f"{name} modulus, where the data determine it")
    return xr.Dataset(found, attrs=attrs if np.isfinite(modulus) else {})


def still_falls(frequency: Floats, loss: Floats, decades: float = 2.0) -> float:
    """Return how far [Pa] the storage modulus falls beyond the slow end, if the loss goes on as over its last decades.

    A loss that falls as the power m of the frequency belongs to a storage modulus that lies
    E″ cot(m π/2) above its end (Kramers and Kronig); infinity where it does not fall.
    """
    order = np.argsort(frequency)
    f, e = frequency[order], loss[order]
    near = f <= f[0] * 10.0**decades
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

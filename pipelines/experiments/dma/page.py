"""The report of a dynamic mechanical analysis."""

import json
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.materials import ShiftLaw
from labpipe.report import (
    SURE,
    Band,
    Block,
    Details,
    KeyValues,
    LineChart,
    Listed,
    Paragraph,
    Role,
    Section,
    Series,
    listed,
    number,
    quantity,
    value_with_uncertainty,
)
from labpipe.workflow.context import Context
from pipelines.experiments.dma.budget import quantities
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.judgements import capitalised, with_minus
from pipelines.experiments.shared.reports import Report, is_there

_LOG_LOG: dict[str, Any] = {"x_scale": "log", "y_scale": "log"}
_MODULI = {"storage": "Storage modulus", "loss": "Loss modulus"}
_BAND = (
    "The band includes the uncertainty of the spectrum, the shifts, the vertical law and the delay; it assumes that "
    "superposition holds."
)
# The verdict on superposition is one of the checks.
_CONSISTENT = {"pass": "fulfilled", "warn": "nearly fulfilled", "fail": "violated"}
_VERTICAL = {
    "none": "none",
    "rho_T": "b_T ∝ absolute temperature times density",
    "linear": "linear in temperature",
    "quadratic": "quadratic in temperature",
}
_LAWS = {"wlf": "WLF", "arrhenius": "Arrhenius"}
_CRITERIA = {"T_peak": "maximum of tan δ", "T_drop": "steepest fall of E′"}


def _details(
    sweeps: xr.Dataset | None = None,
    master_curve: xr.Dataset | None = None,
    temperature_sweep: xr.Dataset | None = None,
) -> list[tuple[str, str, str]]:
    rows, curve, title = list[tuple[str, str, str]](), master_curve, "glass transition"
    if sweeps is not None:
        T = sweeps["temperature"].values
        rows.append(("isothermal sweeps", str(T.size), _celsius(T)))
    if curve is not None:
        frequency, kk = curve["reduced_frequency"].values, json.loads(curve.attrs["kramers_kronig"])
        decades = f"{np.log10(frequency[-1] / frequency[0]):.1f} decades at the reference temperature"
        outside = f"{int(curve['extrapolated'].sum())} outside the covered window"
        rows += [
            ("reference temperature", with_minus(f"{float(curve['T_ref']):.4g} °C"), ""),
            ("covered frequencies", " to ".join(number(float(frequency[i]), 2) for i in (0, -1)) + " Hz", decades),
            _end(curve, "relaxed"),
            _end(curve, "unrelaxed"),
            ("relaxation terms", str(curve.sizes["term"]), outside),
            _law_row(json.loads(curve.attrs["law"])),
            ("vertical shift", _VERTICAL[str(curve.attrs["vertical_law"])], ""),
            ("Kramers–Kronig", _CONSISTENT[kk["verdict"]], kk["reason"]),
        ]
    if (ramps := temperature_sweep) is not None:
        for i, reason in enumerate(json.loads(ramps.attrs["reasons"])):
            at = f"at {float(ramps['frequency'][i]):.3g} Hz"
            for name, text in _CRITERIA.items():
                if np.isfinite(float(ramps[name][i])):
                    rows.append((f"{title}, {text}", pages.told(ramps, name, i), at))
                elif name == "T_peak":
                    rows.append((f"{title}, {text}", "none", f"{at}: {reason}"))
    if curve is not None and "T_peak" in curve:  # at the decade nearest to the middle of the swept ones
        f, swept = curve["transition_frequency"].values, np.log(curve["frequency"].values).mean()
        near = int(np.argmin(np.abs(np.log(f) - swept)))
        shown = pages.told(curve, "T_peak", near)
        rows.append((f"{title}, {_CRITERIA['T_peak']}", shown, f"at {f[near]:.3g} Hz, by the shifts"))
    elif curve is not None:
        why = f"in the master curve: {curve.attrs['no_transition']}"
        rows.append((f"{title}, {_CRITERIA['T_peak']}", "none", why))
    return rows


def _end(curve: xr.Dataset, name: Literal["relaxed", "unrelaxed"]) -> tuple[str, str, str]:
    """Return the modulus of an end, relaxed or unrelaxed, as far as the data there determine it."""
    is_slow = name == "relaxed"
    when, end, at = ("after an infinite time", "slow", 0) if is_slow else ("instantaneous", "fast", -1)
    if np.isfinite(float(curve[f"{name}_modulus"])):
        origin = f"{when}; standard uncertainty from extrapolating the loss at the {end} end, from noise and scale"
        return f"{name} modulus", pages.told(curve, f"{name}_modulus"), origin
    order = np.argsort(curve["reduced_frequency"].values)
    last = quantity(float(curve["master_storage"][int(order[at])]), "Pa", 4)
    bound = f"0 to {last}" if is_slow else f"{last} at least"
    beyond = f"{quantity(float(curve[f'E_{name}']), 'Pa', 4)}, used in simulations, is an extrapolation"
    return f"{name} modulus", bound, f"{when}; no plateau was reached: {beyond}"


def _celsius(T: Floats) -> str:
    return with_minus(f"{T.min():.1f} to {T.max():.1f} °C")


def _shifts(master_curve: xr.Dataset) -> Section:
    """Show the shift factors over temperature, the laws that hold, and the glass transition over frequency."""
    rising = master_curve.isel(temperature=np.argsort(master_curve["temperature"].values))
    T, y, u = (rising[n].values for n in ("temperature", "log10_aT", "u_log10_aT"))
    fine = np.linspace(T.min(), T.max(), 161)
    laws = dict(sorted(json.loads(master_curve.attrs["laws"]).items(), reverse=True))
    holding = [ShiftLaw.of(law) for law in laws.values() if ShiftLaw.of(law).holds]
    series = [Series("fitted", T, y, style="points", role="measured", u=u)]
    roles: tuple[Role, ...] = ("model", "reference")
    series += [
        Series(_LAWS[law.name], fine, law.log10_aT(fine), role=role) for law, role in zip(holding, roles, strict=False)
    ]
    caption = "Bars are standard uncertainties."
    if laws and not holding:
        caption += " No law is drawn, because none describes the shifts within their uncertainty."
    labels = ("Horizontal shift factors", "temperature / °C", "log₁₀ a_T", series)
    blocks: list[Block] = [LineChart(*labels, height_px=240, caption=caption)]
    if "T_peak" in master_curve:
        f, T_g, u_T = (master_curve[n].values for n in ("transition_frequency", "T_peak", "u_T_peak"))
        drawn = [Series(_CRITERIA["T_peak"], f, T_g, style="points", role="measured", u=u_T)]
        words = "By the shifts, at whole decades of the frequency for which it lies among the isotherms."
        shape = ("Glass transition over frequency", "frequency / Hz", "temperature / °C", drawn)
        blocks.append(LineChart(*shape, x_scale="log", height_px=220, caption=words))
    columns = [
        Listed("temperature / °C", T.tolist(), digits=3),
        *pages.columns(rising, {"log10_aT": "log₁₀ a_T", "b_T": "b_T"}),
    ]
    fits = [(f"law of {_LAWS[name]}", *_law(law)) for name, law in laws.items()]
    if float(master_curve["delay"]):
        fits.append(("delay of the instrument's phase", pages.told(master_curve, "delay"), "removed"))
    title = f"Laws, and the shift factors of {T.size} temperatures"
    return Section("Shift factors", (*blocks, Details(title, (KeyValues(fits), listed(columns)))))


def _law_row(law: dict[str, Any]) -> tuple[str, str, str]:
    if law["name"] == "arrhenius" and law["u_activation_energy"] is None:
        return "shift law", "none: a single temperature determines no shift", ""
    if ShiftLaw.of(law).holds:
        return "shift law", *_law(law)
    text = "neither WLF nor Arrhenius holds over all temperatures"
    return "shift law", text, "the shifts are free; a kink indicates a transition"


def _law(law: dict[str, Any]) -> tuple[str, str]:
    """Write the parameters of a law, and how well it describes the shifts."""

    def shown(name: str, scale: float = 1.0) -> str:
        if not ShiftLaw.of(law).holds:  # an uncertainty would claim that it does
            return number(law[name] / scale, 3)
        return value_with_uncertainty(law[name] / scale, (law[f"u_{name}"] or 0.0) / scale)

    text = "WLF, a straight line over temperature"
    if law["name"] == "arrhenius":
        text = f"Arrhenius, activation energy {shown('activation_energy', 1e3)} kJ/mol"
    elif law["C1"] is not None and law["C2"] is not None:
        text = f"WLF, C₁ = {shown('C1')}, C₂ = {shown('C2')} K"
    if not law["freedom"] or not law["chi_square"]:
        return text, ""
    fits = f"χ² / degrees of freedom = {number(law['chi_square'] / law['freedom'], 3)}"
    return text, fits if ShiftLaw.of(law).holds else f"{fits}: does not hold"


def _master(context: Context, master_curve: xr.Dataset) -> Iterator[Section]:
    """Show the shifted points, on a scale of colours from the coldest, the fitted spectrum, and how to export it."""
    x, T = master_curve["reduced_frequency"].values, master_curve["temperature"].values
    label = f"frequency at {float(master_curve['T_ref']):.4g} °C / Hz"
    titles = [with_minus(f"{each:.0f} °C") for each in T]
    blocks: list[Block] = []
    for name, title in _MODULI.items():
        curves, drawn = list[Series](), list[str]()
        for i in np.argsort(T, kind="stable"):
            shifted, y = master_curve["point_reduced_frequency"].values[i], master_curve[f"{name}_reduced"].values[i]
            good = np.flatnonzero(np.isfinite(shifted) & np.isfinite(y))
            good = good[np.argsort(shifted[good], kind="stable")]
            if good.size:
                level, again = float(T[i] - T.min()) / (float(np.ptp(T)) or 1.0), drawn.count(titles[i])
                named = titles[i] + (f", sweep {again + 1}" if again else "")
                curves.append(Series(named, shifted[good], y[good], style="points", level=level))
                drawn.append(titles[i])
        y, u = (master_curve[f"{of}master_{name}"].values for of in ("", "u_"))
        low = np.maximum(y - SURE * u, y * 1e-3)  # a logarithmic axis shows no zero
        curves.append(Series("fitted spectrum", x, y, role="model"))
        curves.append(Band("95 %", x, low, y + SURE * u, role="model"))
        labels = (f"{title}, master curve", label, f"{title.lower()} / MPa", curves)
        caption = _BAND if name == "storage" else ""
        blocks.append(pages.chart(*labels, **_LOG_LOG, group="master", height_px=300, caption=caption))
    yield Section("Master curve", blocks)
    outside = master_curve["extrapolated"].values.astype(bool)
    text = (
        f"E(t) = E_relaxed + Σ E_i exp(−t/ρ_i) at {float(master_curve['T_ref']):.4g} °C, in tension. "
        f"`labpipe export SESSION --experiment {context.experiment} --format abaqus` (or ansys, comsol, lsdyna, json) "
        "writes fewer terms as input of a simulation code; --bulk says what the bulk modulus does."
    )
    rho, E = master_curve["rho"].values, master_curve["E"].values
    series = [Series("inside the window", rho[~outside], E[~outside], style="points", role="measured")]
    if outside.any():
        series.append(Series("extrapolated", rho[outside], E[outside], style="points", role="reference"))
    chart = pages.chart("Relaxation spectrum", "relaxation time ρ / s", "E_i / MPa", series, **_LOG_LOG)
    yield Section("Spectrum and terms", (Paragraph(text), Details("Spectrum", (chart,))))


def _readings(settings: Dma, sweeps: xr.Dataset, readings: Sequence[xr.Dataset | None] = ()) -> Section:
    """Show how the readings were converted."""
    blocks: list[Block] = []
    factor, u_factor, scale, u_scale = (
        float(sweeps.attrs[name]) for name in ("modulus_factor", "u_modulus_factor", "scale", "u_scale")
    )
    if factor != 1.0:
        text = f"Loaded in {settings.mode}; the file's moduli were multiplied by 2 (1 + ν) = "
        text += f"{value_with_uncertainty(factor, u_factor)} with ν = {pages.stated(settings.nu)}, the same for all."
        blocks.append(Paragraph(text))
    if settings.specimen is not None:
        text = "the form factor of the stated specimen over that of the dimensions as entered"
        shown = value_with_uncertainty(scale, u_scale * scale)
        blocks.append(Paragraph(f"All moduli were multiplied by {shown}: {text}."))
    blocks += pages.raw_headers(pages.present(readings))
    return pages.folded("Readings", "Readings and their conversion", blocks)


def _transition(temperature_sweep: xr.Dataset) -> Section:
    ramps, moduli, factors = temperature_sweep, list[Series](), list[Series]()
    parts: tuple[tuple[str, str, Role], ...] = (("E′", "storage", "measured"), ("E″", "loss", "model"))
    for i, frequency in enumerate(ramps["frequency"].values):
        name, one = f"{frequency:.3g} Hz", ramps.isel(point=ramps["ramp_of"].values == i)
        T = one["temperature"].values
        for sign, of, role in parts:
            moduli.append(Series(f"{sign}, {name}", T, one[of].values, role=role))
        factors.append(Series(f"tan δ, {name}", T, one["loss_factor"].values, role="measured"))
    places = (("tan δ", float(ramps["T_peak"][0])), ("fall of E′", float(ramps["T_drop"][0])))
    lines = [(title, place) for title, place in places if np.isfinite(place)]
    drawn = partial(pages.chart, x="temperature / °C", vlines=lines, group="ramp")
    charts = (
        drawn("Moduli over temperature", y="modulus / MPa", series=moduli, y_scale="log"),
        drawn("Loss factor over temperature", y="tan δ", series=factors, height_px=220),
    )
    return Section("Temperature sweep", (Details("Moduli and loss factor over temperature", charts),))


def _methods(settings: Dma, master_curve: xr.Dataset) -> str:
    T, asked = master_curve["temperature"].values, settings.fit.law
    text = f"Storage and loss modulus were measured in {settings.mode} at {pages.counted(T.size, 'temperature')} from "
    text += f"{_celsius(T)}. "
    if settings.mode in ("shear", "torsion"):
        text += f"Tension moduli follow from E = 2 (1 + ν) G with ν = {settings.nu.value:g}. "
    residuals = (master_curve[f"{name}_residual"].values for name in ("storage", "loss"))
    missed = [100 * float(np.sqrt(np.nanmean(one**2))) for one in residuals]
    shifts = "every isotherm had a shift of its own"
    if asked != "free":
        shifts = f"the shifts followed the {_LAWS[asked]} law"
    text += (
        "The isotherms were joined by time–temperature superposition in one fit of all horizontal shifts and one "
        "non-negative relaxation spectrum to both moduli (variable projection, Golub and Pereyra 2003, "
        "doi:10.1088/0266-5611/19/2/201; regularisation by generalised cross-validation); "
        f"{shifts}. The reference temperature is {float(master_curve['T_ref']):.4g} °C; vertical "
        f"law: {_VERTICAL[str(master_curve.attrs['vertical_law'])]}. "
        f"{capitalised(_law_row(json.loads(master_curve.attrs['law']))[1])}. "
        "The fit left {:.2f} % (E′) and {:.2f} % (E″) rms.".format(*missed)
    )
    return text


page = Report(
    subtitle="Dynamic mechanical analysis",
    shown=("readings", "sweeps", "master_curve", "temperature_sweep"),
    details=_details,
    sections=(_master, _shifts, _transition, _readings),
    budget=quantities,
    methods=_methods,
    counts={"temperature_sweep": is_there},
)

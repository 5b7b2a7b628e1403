"""The report of a dynamic mechanical analysis."""

import json
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.materials import deck_text
from labpipe.report import (
    Band,
    Block,
    Details,
    KeyValues,
    LineChart,
    Listed,
    Notice,
    Paragraph,
    Section,
    Series,
    Table,
    display_unit,
    listed,
    number,
    value_with_uncertainty,
)
from labpipe.workflow.context import Context
from pipelines.experiments.dma import _material_files, _shift_section
from pipelines.experiments.dma.budget import quantities
from pipelines.experiments.dma.published import rms
from pipelines.experiments.dma.settings import Dma
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.reports import Report, budgets, is_there

_MPA = 1e-6
_BAND = (
    "The band includes the uncertainty of the spectrum, the shifts, the vertical law and the delay; it assumes that "
    "superposition holds."
)
_COVERAGE = 1.96  # of the bands, 95 %
# What a verdict on the model is called; the verdict on the record, above, has words of its own.
_SUPERPOSITION = {"pass": "holds", "doubtful": "holds roughly at best", "fail": "does not hold"}
_CONSISTENT = {"pass": "fulfilled", "warn": "nearly fulfilled", "fail": "violated"}
_KIND = {"warn": "warning", "fail": "error"}


def _summary(
    context: Context,
    sweeps: xr.Dataset | None = None,
    master_curve: xr.Dataset | None = None,
    temperature_sweep: xr.Dataset | None = None,
) -> Section:
    rows: list[tuple[str, str, str]] = []
    blocks: list[Block] = [*pages.failed_notice(context)]
    if sweeps is not None:
        T = sweeps["temperature"].values
        rows.append(("isothermal sweeps", str(T.size), _celsius(T)))
    if master_curve is not None:
        rows += _curve_rows(master_curve)
        verdict = json.loads(master_curve.attrs["kramers_kronig"])["verdict"]
        superposition = json.loads(master_curve.attrs["superposition"])
        remark = "see the verdict" if superposition["reasons"] else "one spectrum fits all sweeps"
        rows.append(("superposition", _SUPERPOSITION[superposition["level"]], remark))
        rows.append(("Kramers–Kronig", _CONSISTENT[verdict], "consistency of storage and loss modulus"))
    rows += _transition_rows(temperature_sweep)
    blocks.append(KeyValues(rows))
    if master_curve is not None:
        # The first reason stands in the verdict above.
        notes = [note for note in json.loads(master_curve.attrs["notes"]) if note not in superposition["reasons"][:1]]
        if notes:
            title = f"What limits this curve ({pages.counted(len(notes), 'remark')})"
            blocks.append(Details(title, [Paragraph(_sentence(note)) for note in notes]))
    return Section("Summary", tuple(blocks))


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _curve_rows(curve: xr.Dataset) -> list[tuple[str, str, str]]:
    covered = curve["reduced_frequency"].values
    outside = int(curve["extrapolated"].sum())
    reference = f"{float(curve['T_ref']):.1f} °C".replace("-", "\N{MINUS SIGN}")
    return [
        ("reference temperature", reference, ""),
        (
            "covered frequencies",
            f"{number(float(covered[0]), 2)} to {number(float(covered[-1]), 2)} Hz",
            f"{np.log10(covered[-1] / covered[0]):.1f} decades at the reference temperature",
        ),
        _end(curve, "relaxed"),
        _end(curve, "unrelaxed"),
        ("relaxation terms", str(curve.sizes["term"]), f"{outside} outside the covered window"),
        _shift_section.law_row(json.loads(curve.attrs["law"])),
        ("vertical shift", _vertical(curve), ""),
    ]


def _end(curve: xr.Dataset, name: Literal["relaxed", "unrelaxed"]) -> tuple[str, str, str]:
    """Return the modulus of an end, relaxed or unrelaxed, as far as the data there determine it."""
    is_slow = name == "relaxed"
    when, end = ("after an infinite time", "slow") if is_slow else ("instantaneous", "fast")
    modulus, u = float(curve[f"{name}_modulus"]), float(curve[f"u_{name}_modulus"])
    if np.isfinite(modulus):
        origin = f"{when}; standard uncertainty from extrapolating the loss at the {end} end, from noise and scale"
        return f"{name} modulus", value_with_uncertainty(modulus, u, "Pa"), origin
    frequency = curve["reduced_frequency"].values
    last = _modulus(float(curve["master_storage"][int(np.argmin(frequency) if is_slow else np.argmax(frequency))]))
    may = "may still fall to zero" if is_slow else "may still rise"
    return (
        f"{name} modulus",
        f"0 to {last}" if is_slow else f"{last} at least",
        f"{when}; with this loss the storage modulus {may}: the series' {_modulus(float(curve[f'E_{name}']))} "
        "is extrapolated",
    )


def _vertical(curve: xr.Dataset) -> str:
    """Name the vertical law for a reader."""
    return {
        "none": "none",
        "rho_T": "b_T ∝ absolute temperature times density",
        "linear": "linear in temperature",
        "quadratic": "quadratic in temperature",
    }[str(curve.attrs["vertical_law"])]


def _celsius(T: Floats) -> str:
    return f"{T.min():.1f} to {T.max():.1f} °C".replace("-", "\N{MINUS SIGN}")


def _modulus(value: float) -> str:
    shown = display_unit([value], "Pa")
    return f"{value / shown.factor:.4g} {shown.text}"


def _transition_rows(ramp: xr.Dataset | None) -> list[tuple[str, str, str]]:
    if ramp is None or "absent" in ramp.attrs:
        return []
    rows = []
    for i in range(ramp.sizes["ramp"]):
        at = f"at {float(ramp['frequency'][i]):.3g} Hz"
        for name, text in (
            ("T_peak", "maximum of tan δ"),
            ("T_loss", "maximum of E″"),
            ("T_drop", "steepest fall of E′"),
        ):
            value = float(ramp[name][i])
            if np.isfinite(value):
                shown = value_with_uncertainty(value, float(ramp[f"u_{name}"][i]), "degC")
                rows.append((f"glass transition, {text}", shown, at))
    return rows


def _isotherms(
    table: xr.Dataset,
    name: str,
    x_name: str | None = None,
    factor: float = _MPA,
    style: Literal["line", "points"] = "line",
) -> list[Series]:
    """Return one curve per temperature, coldest first, sorted along x, on a scale of colours."""
    series: list[Series] = []
    temperature = table["temperature"].values
    for i in np.argsort(temperature, kind="stable"):
        x = table["frequency"].values if x_name is None else table[x_name].values[i]
        y = table[name].values[i] * factor
        good = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        good = good[np.argsort(x[good], kind="stable")]
        if good.size:
            span = float(np.ptp(temperature))
            level = (float(temperature[i]) - float(temperature.min())) / span if span else 0.5
            title = f"{temperature[i]:.0f} °C".replace("-", "\N{MINUS SIGN}")
            again = sum(one.name.split(",")[0] == title for one in series)
            title += f", sweep {again + 1}" if again else ""
            series.append(Series(title, x[good], y[good], style=style, level=level))
    return series


def _sweeps(settings: Dma, readings: Sequence[xr.Dataset | None], sweeps: xr.Dataset | None) -> list[Block]:
    if sweeps is None:
        return []
    blocks: list[Block] = []
    factor = float(sweeps.attrs["modulus_factor"])
    if factor != 1.0:
        text = (
            f"Loaded in {settings.mode}; the file's moduli were multiplied by 2 (1 + ν) = "
            f"{factor:.4g} with ν = {value_with_uncertainty(settings.nu.value, settings.nu.u)}."
        )
        if settings.nu.u:
            relative = float(sweeps.attrs["u_modulus_factor"]) / factor * 100
            text += f" That factor is uncertain by {relative:.2g} %, equally for all moduli."
        blocks.append(Paragraph(text))
    charts = [
        pages.log_log(title, "frequency / Hz", f"{title.lower()} / MPa", _isotherms(sweeps, name), group="sweeps")
        for name, title in (("storage", "Storage modulus"), ("loss", "Loss modulus"))
    ]
    blocks.append(Details("Moduli in tension over frequency, as measured", charts))
    for reading in readings:
        header = pages.raw_header(reading)
        if header is not None:
            blocks.append(header)
    return blocks


def _master(master_curve: xr.Dataset) -> Section:
    x = master_curve["reduced_frequency"].values
    label = f"frequency at {float(master_curve['T_ref']):.4g} °C / Hz"
    blocks: list[Block] = []
    for name, title in (("storage", "Storage modulus"), ("loss", "Loss modulus")):
        y, u = master_curve[f"master_{name}"].values * _MPA, master_curve[f"u_master_{name}"].values * _MPA
        low = np.maximum(y - _COVERAGE * u, y * 1e-3)  # a logarithmic axis shows no zero
        curves: list[Series | Band] = [
            *_isotherms(master_curve, f"{name}_reduced", "point_reduced_frequency", style="points"),
            Series("spectrum", x, y, role="model"),
            Band("95 %", x, low, y + _COVERAGE * u, role="model"),
        ]
        labels = (f"{title}, master curve", label, f"{title.lower()} / MPa")
        caption = _BAND if name == "storage" else ""
        blocks.append(pages.log_log(*labels, curves, group="master", height_px=300, caption=caption))
    drawn = [Series("spectrum", x, master_curve["master_loss_factor"].values, role="model")]
    factor = LineChart("Loss factor, master curve", label, "tan δ", drawn, x_scale="log", group="master", height_px=220)
    blocks.append(Details("Loss factor", (factor,)))
    return Section("Master curve", tuple(blocks))


def _spectrum(curve: xr.Dataset) -> list[Block]:
    outside = curve["extrapolated"].values.astype(bool)
    rho, E = curve["rho"].values, curve["E"].values * _MPA
    series = [Series("inside the window", rho[~outside], E[~outside], style="points", role="measured")]
    if outside.any():
        series.append(Series("extrapolated", rho[outside], E[outside], style="points", role="reference"))
    title, x, y = "Relaxation spectrum", "relaxation time ρ / s", "E_i / MPa"
    blocks: list[Block] = [pages.log_log(title, x, y, series, group="spectrum")]
    if "tau" in curve and curve.sizes.get("creep_term", 0):
        tau, C = curve["tau"].values, curve["C"].values * 1e6
        order = np.argsort(tau)
        title, x, y = "Creep spectrum", "retardation time τ / s", "C_k / (1/MPa)"
        series = [Series("C_k", tau[order], C[order], style="points", role="measured")]
        caption = "J(t) = 1/E_relaxed − Σ C_k exp(−t/τ_k), from the relaxation series by exact interconversion."
        blocks.append(pages.log_log(title, x, y, series, group="spectrum", caption=caption))
    return blocks


def _readings(
    settings: Dma,
    master_curve: xr.Dataset | None = None,
    readings: Sequence[xr.Dataset | None] = (),
    sweeps: xr.Dataset | None = None,
) -> Section | None:
    how = (*_fit(master_curve), *_sweeps(settings, readings, sweeps))
    return pages.folded("Readings and fit", "Readings, residuals, each modulus from the other", how) if how else None


def _fit(curve: xr.Dataset | None) -> list[Block]:
    """Say how well the curve fits the readings, and the two moduli each other; both in detail below."""
    if curve is None:
        return []
    kk = json.loads(curve.attrs["kramers_kronig"])
    missed = [100 * rms(curve[name].values) for name in ("storage_residual", "loss_residual")]
    text = f"The spectrum misses the storage modulus by {missed[0]:.2g} %, the loss by {missed[1]:.2g} % (rms)."
    said = f"Storage and loss modulus, Kramers–Kronig: {_CONSISTENT[kk['verdict']]}; {kk['reason']}."
    consistent = Paragraph(said) if kk["verdict"] == "pass" else Notice(_KIND[kk["verdict"]], said)  # type: ignore[arg-type]
    return [consistent, Paragraph(text), _residuals(curve), _kramers_kronig(curve)]


def _kramers_kronig(curve: xr.Dataset) -> Details:
    x = curve["kk_frequency"].values

    def line(name: str, title: str, role: Any, style: Any = "line") -> Series:
        return Series(title, x, curve[name].values * _MPA, role=role, style=style)

    label = f"frequency at {float(curve['T_ref']):.4g} °C / Hz"
    storage = pages.log_log(
        "Storage modulus predicted from the loss",
        label,
        "storage modulus / MPa",
        [line("kk_storage", "measured", "measured", "points"), line("kk_storage_from_loss", "from E″", "model")],
        group="kk",
        height_px=240,
    )
    loss = pages.log_log(
        "Loss modulus predicted from the storage",
        label,
        "loss modulus / MPa",
        [line("kk_loss", "measured", "measured", "points"), line("kk_loss_from_storage", "from E′", "model")],
        group="kk",
        height_px=300,
        caption="Near the ends the prediction lacks the data beyond the window.",
    )
    return Details("Each modulus predicted from the other", (storage, loss))


def _residuals(curve: xr.Dataset) -> Details:
    label = f"frequency at {float(curve['T_ref']):.4g} °C / Hz"
    blocks: list[Block] = [
        LineChart(
            title,
            label,
            "model / measured − 1 / %",
            _isotherms(curve, name, "point_reduced_frequency", 100.0, "points"),
            x_scale="log",
            group="residuals",
            height_px=240,
        )
        for name, title in (("storage_residual", "Residuals of E′"), ("loss_residual", "Residuals of E″"))
    ]
    storage, loss = curve["storage_residual"].values, curve["loss_residual"].values
    columns = [
        Listed("temperature / °C", curve["temperature"].values.tolist(), digits=3),
        Listed("points", np.isfinite(storage).sum(axis=1).tolist()),
    ]
    for title, values in (("E′", storage), ("E″", loss)):
        columns.append(Listed(f"{title} rms / %", [100 * rms(each) for each in values], digits=3))
        columns.append(Listed(f"{title} max / %", [100 * _largest(each) for each in values], digits=3))
    blocks.append(listed(columns))
    return Details("Residuals by temperature", blocks)


def _largest(values: Floats) -> float:
    good = np.abs(values[np.isfinite(values)])
    return float(good.max()) if good.size else float("nan")


def _transition(temperature_sweep: xr.Dataset) -> Section:
    moduli, factors = [], []
    for i in range(temperature_sweep.sizes["ramp"]):
        where = temperature_sweep["ramp_of"].values == i
        T = temperature_sweep["temperature"].values[where]
        name = f"{float(temperature_sweep['frequency'][i]):.3g} Hz"
        moduli += [
            Series(f"E′, {name}", T, temperature_sweep["storage"].values[where] * _MPA, role="measured"),
            Series(f"E″, {name}", T, temperature_sweep["loss"].values[where] * _MPA, role="model"),
        ]
        factors.append(Series(f"tan δ, {name}", T, temperature_sweep["loss_factor"].values[where], role="measured"))
    lines = [
        (title, float(temperature_sweep[name][0]))
        for name, title in (("T_peak", "tan δ"), ("T_drop", "fall of E′"))
        if np.isfinite(float(temperature_sweep[name][0]))
    ]
    none = "It shows no glass transition: the storage modulus falls too little, or the maxima lie at its ends."
    charts = (
        LineChart(
            "Moduli over temperature", "temperature / °C", "modulus / MPa", moduli, y_scale="log", vlines=lines,
            group="ramp",
        ),
        LineChart(
            "Loss factor over temperature", "temperature / °C", "tan δ", factors, vlines=lines, group="ramp",
            height_px=220,
        ),
    )  # fmt: skip
    said = () if _transition_rows(temperature_sweep) else (Paragraph(none),)
    return Section("Temperature sweep", (*said, Details("Moduli and loss factor over temperature", charts)))


def _terms(context: Context, master_curve: xr.Dataset, settings: Dma) -> Section:
    name = context.experiment
    outside = master_curve["extrapolated"].values.astype(bool)
    deck = _material_files.deck(master_curve, settings=settings, name=name)
    few = deck.tension
    text = (
        f"E(t) = E_relaxed + Σ E_i exp(−t/ρ_i) at {deck.T_ref:.4g} °C, in tension; other experiments of this session "
        f"use the full series. `labpipe export SESSION --experiment {name} --format abaqus` (or ansys, comsol, lsdyna, "
        f"json; --bulk says what the bulk modulus does) writes {few.E.size} terms, within {deck.error * 100:.2g} % of "
        "the worse modulus inside the window (rms)."
    )
    relaxed = f"All terms; E_relaxed = {_modulus(float(master_curve['E_relaxed']))}."
    caption = f"{relaxed} Terms outside the covered window are extrapolation."
    full = _term_table(master_curve["rho"].values, master_curve["E"].values, outside, caption)
    caption = f"The reduced series; E_relaxed = {_modulus(few.E_relaxed)}."
    reduced = _term_table(few.rho, few.E, np.zeros(few.E.size, dtype=bool), caption)
    warnings = [Notice("warning", _sentence(warning)) for warning in deck.warnings]
    warned = f" ({pages.counted(len(warnings), 'warning')})" if warnings else ""
    blocks: tuple[Block, ...] = (
        Details("Relaxation and creep spectrum", _spectrum(master_curve)),
        Details(f"For simulation codes, {few.E.size} terms", (*warnings, reduced)),
        Details(f"All {outside.size} terms", (full,)),
        Details("For Abaqus", text=deck_text(deck, "abaqus")),
        Details("CSV, all terms and the shift factors", text=_material_files.as_csv(master_curve, few)),
    )
    return Section("Spectrum and terms", (Paragraph(text), Details(f"Spectrum, terms, files{warned}", blocks)))


def _term_table(rho: Floats, E: Floats, outside: NDArray[np.bool_], caption: str) -> Table:
    columns = [
        Listed("term", list(range(1, len(rho) + 1))),
        Listed("ρ / s", rho.tolist()),
        Listed("E / MPa", (E * _MPA).tolist()),
    ]
    if outside.any():
        columns.append(Listed("remark", ["extrapolated" if is_outside else "" for is_outside in outside]))
    return listed(columns, caption)


def _methods(settings: Dma, master_curve: xr.Dataset) -> Section:
    T = master_curve["temperature"].values
    law = json.loads(master_curve.attrs["law"])
    asked = settings.fit.law
    shifts = (
        "every isotherm had a shift of its own"
        if asked == "free"
        else f"the shifts followed the {asked.upper() if asked == 'wlf' else 'Arrhenius'} law"
    )
    missed = [rms(master_curve[name].values) for name in ("storage_residual", "loss_residual")]
    text = (
        f"Storage and loss modulus were measured in {settings.mode} at {pages.counted(T.size, 'temperature')} from "
        f"{_celsius(T)}. "
    )
    if settings.mode in ("shear", "torsion"):
        text += f"Tension moduli follow from E = 2 (1 + ν) G with ν = {settings.nu.value:g}. "
    text += (
        "The isotherms were joined by time–temperature superposition in one fit of all horizontal shifts and one "
        "non-negative relaxation spectrum to both moduli (variable projection, regularisation by generalised "
        f"cross-validation); {shifts}. The reference temperature is {float(master_curve['T_ref']):.4g} °C; vertical "
        f"law: {_vertical(master_curve)}. {_shift_section.law_row(law)[1]}. The fit left {missed[0] * 100:.2f} % (E′) "
        f"and {missed[1] * 100:.2f} % (E″) rms."
    )
    return pages.methods(text)


page = Report(
    "Dynamic mechanical analysis",
    ("readings", "sweeps", "master_curve", "published", "temperature_sweep"),
    (_summary, _master, _shift_section.shifts, _transition, _readings, budgets(quantities), _terms, _methods),
    counts={"published": is_there, "temperature_sweep": is_there},
)

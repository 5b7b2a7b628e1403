"""The report of a harmonic indentation."""

import json

import numpy as np
import xarray as xr

from labpipe.report import (
    Band,
    Block,
    LineChart,
    Listed,
    Notice,
    ScatterChart,
    Section,
    Series,
    listed,
    number,
    value_with_uncertainty,
)
from pipelines.experiments.harmonic.budget import quantities
from pipelines.experiments.harmonic.comparison import rows as compared_rows
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings, pages
from pipelines.experiments.shared.judgements import capitalised
from pipelines.experiments.shared.punch_sections import measured, simulated_by, without_model
from pipelines.experiments.shared.reports import Report, budgets, is_there, summary

_UM = 1e6


def _details(settings: Harmonic, oscillations: xr.Dataset | None = None) -> list[tuple[str, str, str]]:
    rows = list[tuple[str, str, str]]()
    if oscillations is not None:
        frequency = oscillations["frequency"].values
        rows.append(("frequencies", ", ".join(f"{f:.4g}" for f in frequency), "Hz, fitted"))
        is_found = np.isfinite(float(oscillations["contact_position"]))
        touch = pages.told(oscillations, "contact_position") if is_found else "not found"
        rows.append(("first touch", touch, oscillations.attrs["contact"]))
    return rows + without_model(settings)


def _frequencies(oscillations: xr.Dataset, comparison: xr.Dataset | None = None) -> Section:
    columns = [
        Listed("declared / Hz", oscillations["declared_frequency"].values.tolist()),
        Listed("frequency / Hz", oscillations["frequency"].values.tolist(), digits=5),
        pages.plain(oscillations, "amplitude", "amplitude"),
        pages.column(oscillations, "phase_lag", "phase lag"),
        pages.column(oscillations, "storage_stiffness", "storage stiffness"),
        pages.column(oscillations, "loss_stiffness", "loss stiffness"),
        pages.column(oscillations, "work_per_cycle", "work per cycle"),
        pages.column(oscillations, "work_sd", "spread over cycles", digits=2),
        Listed("cycles", oscillations["n_cycles"].values.astype(int).tolist()),
    ]
    if comparison is not None:
        columns.append(Listed("nRMSE of force", (comparison["nrmse"].values * 100).tolist(), "%", digits=3))
    caption = (
        "Frequency, amplitude and phase are fitted to the position; the header holds only the commanded values. "
        "Cycles of the transient and of the deceleration are left out."
    )
    notes: list[Block] = [listed(columns, caption)]
    declared = json.loads(oscillations.attrs["filter"])
    if declared is not None:
        lag = np.degrees(oscillations["filter_phase"].values)
        known = json.loads(oscillations.attrs.get("filter_delay", "null"))
        how = "assuming a causal Butterworth filter; the uncertainty covers the other usual types, and shrinks if the "
        how += "load cell's record states a filter_delay"
        if known is not None:
            how = f"by the delay in the load cell's record, {value_with_uncertainty(known[0], known[1], 's')}"
        text = (
            f"The load cell's low-pass (order {declared['order']:g}, {declared['cutoff']:.3g} Hz) delays the force by "
            f"{lag.min():.1f} to {lag.max():.1f}°. This was removed, {how}."
        )
        notes.append(Notice("info", text))
    waves = [
        pages.column(oscillations, f"{of}harmonic_{n}", f"{name} harmonic of the {signal} / %", 100)
        for of, signal in (("", "force"), ("position_", "position"))
        for n, name in ((2, "second"), (3, "third"))
    ]
    caption = (
        "Amplitude over that of the fundamental in %, over whole cycles. A harmonic of the force that is larger than "
        "that of the position shows a nonlinear contact: its area changes over the cycle, or the surface is left."
    )
    notes.append(
        listed([Listed("frequency / Hz", oscillations["frequency"].values.tolist(), digits=5), *waves], caption)
    )
    return Section("Frequencies", tuple(notes))


def _stiffness(oscillations: xr.Dataset, model: xr.Dataset | None = None, theory: xr.Dataset | None = None) -> Section:
    frequency = oscillations["frequency"].values
    order = np.argsort(frequency)
    theory = None if theory is None or not is_there(theory) else theory
    charts: list[Block] = []
    for name, title, unit, factor in (
        ("storage_stiffness", "Storage stiffness", "(kN/m)", 1e-3),
        ("loss_stiffness", "Loss stiffness", "(kN/m)", 1e-3),
        ("work_per_cycle", "Dissipated work per cycle", "µJ", 1e6),
    ):
        y, u = (oscillations[n].values[order] * factor for n in (name, f"u_{name}"))
        series: list[Series | Band] = [Series("measured", frequency[order], y, style="points", role="measured", u=u)]
        if model is not None:
            simulated, u = (model[each].values[order] * factor for each in (name, f"u_{name}"))
            series += pages.model_curves(frequency[order], simulated, u)
        caption = "Bars are standard uncertainties."
        if name == "work_per_cycle" and theory is not None:
            limit = theory["dissipated_work"].values[order] * factor
            series.append(Series("thesis eq. (2.31)", frequency[order], limit, role="reference"))
            caption += " Thesis eq. (2.31) is the limit of small amplitudes."
        shape = (title, "frequency / Hz", f"{title.lower()} / {unit}", tuple(series))
        charts.append(LineChart(*shape, x_scale="log", height_px=260, caption=caption))
    if theory is not None:
        moduli = [
            pages.column(theory, f"{route}{part}_modulus", f"{sign}, {by}")
            for part, sign in (("storage", "E′"), ("loss", "E″"))
            for route, by in (("", "fit"), ("fourier_", "Fourier"))
        ]
        caption = (
            "Stiffness over that of the contact per modulus, thesis eq. (2.24), at the mean indentation: by the fitted "
            "sinusoids, and by the Fourier components of force and displacement over whole cycles."
        )
        charts.append(listed([Listed("frequency / Hz", frequency.tolist(), digits=5), *moduli], caption))
    return Section("Stiffness and work", tuple(charts))


def _dissipation(model: xr.Dataset, theory: xr.Dataset, loops: xr.Dataset | None = None) -> Section:
    """Show the dimensionless work against eq. (2.31), the tapping front, and contact."""
    del model  # without one nothing is said here: the summary says why
    if not is_there(theory):
        return Section("Dissipation and detachment", (Notice("info", f"{capitalised(theory.attrs['absent'])}."),))
    columns = (
        pages.plain(theory, "dimensionless_frequency", "f τ₀"),
        pages.plain(theory, "dimensionless_amplitude", "α/R"),
        pages.column(theory, "dimensionless_work_measured", "W/(E λ R d), measured"),
        pages.column(theory, "dimensionless_work_theory", "by thesis eq. (2.31)"),
        pages.column(theory, "tapping_amplitude", "tapping front"),
        *([pages.column(loops, "least_force", "least force")] if loops is not None else []),
        *([pages.plain(loops, "contact_loss", "contact lost / %", 100)] if loops is not None else []),
    )
    caption = (
        f"f: frequency; τ₀ = {number(float(theory['characteristic_time']), 3)} s (thesis eq. 2.38); α: amplitude; R: "
        "tip radius; W: work per cycle; E: relaxed modulus; λ: period; d: length of the contact; E λ R d = "
        f"{float(theory['work_scale']):.4g} J. Contact is lost where the mean loop's force does not exceed twice its "
        "uncertainty; theory predicts loss of contact at amplitudes beyond the tapping front (thesis eq. 2.34)."
    )
    return Section("Dissipation and detachment", (listed(columns, caption),))


def _loops(
    loops: xr.Dataset, oscillations: xr.Dataset, loads: xr.Dataset | None = None, comparison: xr.Dataset | None = None
) -> Section:
    series = []
    for i in range(loops.sizes["oscillation"]):
        at = oscillations.isel(oscillation=i)
        name, mean, last = f"{float(at['frequency']):.4g} Hz", float(at["mean_position"]), float(at["end"])
        x = (loops["position"][i].values - mean) * _UM
        series.append(Series(f"{name}, measured", x, loops["force"][i].values, role="measured"))
        if comparison is not None and loads is not None:
            where = mach1_readings.rows(loads, int(at["block"]))
            time = loads["time"].values[where]
            used = (time >= last - 1 / float(at["frequency"])) & (time <= last)
            position = (loads["position_z"].values[where][used] - mean) * _UM
            force = comparison["simulated_force"].values[where][used]
            series.append(Series(f"{name}, model", position, force, role="model"))
    lag = ""
    if loads is not None and mach1_readings.declared_filter(loads):
        lag = f": it includes the load cell's lag{', as the loop of the model does' * (comparison is not None)}"
    caption = f"Mean loop over the evaluated cycles, as recorded{lag}."
    return Section(
        "Loops",
        (ScatterChart("Hysteresis loops", "position − mean / µm", "force / N", tuple(series), caption=caption),),
    )


def _methods(settings: Harmonic, oscillations: xr.Dataset, comparison: xr.Dataset | None = None) -> Section:
    frequency = oscillations["frequency"].values
    text = (
        f"Harmonic indentation was evaluated at {pages.counted(frequency.size, 'frequency', 'frequencies')}, "
        f"{pages.spanned(frequency, '.3g')} Hz. Frequency, amplitude and phase were fitted to the recorded position; "
        f"of each block the first {pages.counted(settings.cycles.skip, 'cycle')} and the last one were left out. "
    )
    if oscillations.attrs["is_filter_corrected"]:
        text += "The delay of the load cell's low-pass filter was removed (causal Butterworth). "
    text += (
        "Storage and loss stiffness are the in-phase and quadrature parts of force over displacement; the dissipated "
        "work per cycle is π times the loss stiffness times the squared amplitude (thesis eq. 2.31). "
    )
    if comparison is not None:
        text += simulated_by(comparison["nrmse"].values)
    return pages.methods(text, settings)


page = Report(
    "Harmonic indentation",
    ("readings", "loads", "oscillations", "loops", "model", "theory", "comparison"),
    (
        summary(compared_rows, _details), measured, _frequencies, _stiffness, _dissipation, _loops,
        budgets(quantities), _methods,
    ),
    compared_rows,
    counts={"model": is_there, "comparison": is_there},
)  # fmt: skip

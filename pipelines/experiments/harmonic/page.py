"""The report of a harmonic indentation."""

import json

import numpy as np
import xarray as xr

from labpipe.report import Block, Listed, Notice, ScatterChart, Section, Series, listed, number, value_with_uncertainty
from pipelines.experiments.harmonic.budget import quantities
from pipelines.experiments.harmonic.comparison import rows
from pipelines.experiments.harmonic.settings import Harmonic
from pipelines.experiments.shared import mach1_readings, pages
from pipelines.experiments.shared.judgements import capitalised
from pipelines.experiments.shared.punch_sections import measured, simulated_by, without_model
from pipelines.experiments.shared.reports import Report, is_there


def _details(settings: Harmonic, oscillations: xr.Dataset | None = None) -> list[tuple[str, str, str]]:
    rows = list[tuple[str, str, str]]()
    if oscillations is not None:
        is_found = np.isfinite(float(oscillations["contact_position"]))
        touch = pages.told(oscillations, "contact_position") if is_found else "not found"
        rows.append(("first touch", touch, oscillations.attrs["contact"]))
    return rows + without_model(settings)


def _frequency(oscillations: xr.Dataset) -> Listed:
    return Listed("frequency / Hz", oscillations["frequency"].values.tolist(), digits=5)


def _frequencies(oscillations: xr.Dataset, comparison: xr.Dataset | None = None) -> Section:
    titles = ("phase_lag", "storage_stiffness", "loss_stiffness", "work_per_cycle")
    columns = [
        *pages.columns(oscillations, {"declared_frequency": "declared / Hz"}, has_u=False),
        _frequency(oscillations),
        *pages.columns(oscillations, {"amplitude": "amplitude"}, has_u=False),
        *pages.columns(oscillations, {name: name.replace("_", " ") for name in titles}),
        *pages.columns(oscillations, {"work_sd": "spread over cycles"}, digits=2),
        Listed("cycles", oscillations["n_cycles"].values.astype(int).tolist()),
        *pages.columns(comparison, {"nrmse": "nRMSE of force / %"}, digits=3),
    ]
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
    waves = {
        f"{of}harmonic_{n}": f"{name} harmonic of the {signal} / %"
        for of, signal in (("", "force"), ("position_", "position"))
        for n, name in ((2, "second"), (3, "third"))
    }
    caption = (
        "Amplitude over that of the fundamental in %, over whole cycles. A harmonic of the force that is larger than "
        "that of the position shows a nonlinear contact: its area changes over the cycle, or the surface is left."
    )
    notes.append(listed([_frequency(oscillations), *pages.columns(oscillations, waves)], caption))
    return Section("Frequencies", tuple(notes))


def _stiffness(oscillations: xr.Dataset, model: xr.Dataset | None = None, theory: xr.Dataset | None = None) -> Section:
    frequency = oscillations["frequency"].values
    order = np.argsort(frequency)
    theory = None if theory is None or not is_there(theory) else theory
    charts: list[Block] = []
    for name, title, unit in (
        ("storage_stiffness", "Storage stiffness", "(kN/m)"),
        ("loss_stiffness", "Loss stiffness", "(kN/m)"),
        ("work_per_cycle", "Dissipated work per cycle", "µJ"),
    ):
        y, u = (oscillations[n].values[order] for n in (name, f"u_{name}"))
        series = [Series("measured", frequency[order], y, style="points", role="measured", u=u)]
        if model is not None:
            series += pages.model_curves(frequency[order], (model[n].values[order] for n in (name, f"u_{name}")))
        caption = "Bars are standard uncertainties."
        if name == "work_per_cycle" and theory is not None:
            limit = theory["dissipated_work"].values[order]
            series.append(Series("thesis eq. (2.31)", frequency[order], limit, role="reference"))
            caption += " Thesis eq. (2.31) is the limit of small amplitudes."
        shape = (title, "frequency / Hz", f"{title.lower()} / {unit}", series)
        charts.append(pages.chart(*shape, x_scale="log", height_px=260, caption=caption))
    if theory is not None:
        moduli = {
            f"{route}{part}_modulus": f"{sign}, {by}"
            for part, sign in (("storage", "E′"), ("loss", "E″"))
            for route, by in (("", "fit"), ("fourier_", "Fourier"))
        }
        caption = (
            "Stiffness over that of the contact per modulus, thesis eq. (2.24), at the mean indentation: by the fitted "
            "sinusoids, and by the Fourier components of force and displacement over whole cycles."
        )
        charts.append(listed([_frequency(oscillations), *pages.columns(theory, moduli)], caption))
    return Section("Stiffness and work", tuple(charts))


def _dissipation(model: xr.Dataset, theory: xr.Dataset, loops: xr.Dataset | None = None) -> Section:
    """Show the dimensionless work against eq. (2.31), the tapping front, and contact."""
    del model  # without one nothing is said here: the summary says why
    if not is_there(theory):
        return Section("Dissipation and detachment", (Notice("info", f"{capitalised(theory.attrs['absent'])}."),))
    titles = {
        "dimensionless_work_measured": "W/(E λ R d), measured",
        "dimensionless_work_theory": "by thesis eq. (2.31)",
    }
    columns = (
        *pages.columns(theory, {"dimensionless_frequency": "f τ₀", "dimensionless_amplitude": "α/R"}, has_u=False),
        *pages.columns(theory, titles | {"tapping_amplitude": "tapping front"}),
        *pages.columns(loops, {"least_force": "least force"}),
        *pages.columns(loops, {"contact_loss": "contact lost / %"}, has_u=False),
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
    series, count = list[Series](), loops.sizes["oscillation"]
    for i in range(count):
        at, level = oscillations.isel(oscillation=i), pages.level(i, count)
        name, mean, last = f"{float(at['frequency']):.4g} Hz", float(at["mean_position"]), float(at["end"])
        x, force = loops["position"][i].values - mean, loops["force"][i].values
        series.append(Series(name, x, force, role="measured", level=level))
        if comparison is not None and loads is not None:
            where = mach1_readings.rows(loads, int(at["block"]))
            time = loads["time"].values[where]
            used = (time >= last - 1 / float(at["frequency"])) & (time <= last)
            position = loads["position_z"].values[where][used] - mean
            force = comparison["simulated_force"].values[where][used]
            series.append(Series(f"{name}, model", position, force, role="model", level=level))
    lag = ""
    if loads is not None and mach1_readings.declared_filter(loads):
        lag = f": it includes the load cell's lag{', as the loop of the model does' * (comparison is not None)}"
    caption = f"Mean loop over the evaluated cycles, as recorded{lag}."
    labels = ("Hysteresis loops", "position − mean / µm", "force / N", series)
    return Section("Loops", (pages.chart(*labels, kind=ScatterChart, caption=caption),))


def _methods(settings: Harmonic, oscillations: xr.Dataset, comparison: xr.Dataset | None = None) -> str:
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
    return text


page = Report(
    subtitle="Harmonic indentation",
    shown=("readings", "loads", "oscillations", "loops", "model", "theory", "comparison"),
    details=_details,
    rows=rows,
    sections=(measured, _frequencies, _stiffness, _dissipation, _loops),
    budget=quantities,
    methods=_methods,
    counts={"model": is_there, "comparison": is_there},
)

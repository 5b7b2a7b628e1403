"""Sections of the report of a DMA on its shifts: the factors over temperature, and the laws through them."""

import json
from typing import Any, Literal

import numpy as np
import xarray as xr

from labpipe.materials import ShiftLaw
from labpipe.report import Details, KeyValues, LineChart, Listed, Section, Series, listed, value_with_uncertainty
from pipelines.experiments.dma import _published_section
from pipelines.experiments.shared import pages


def shifts(master_curve: xr.Dataset, published: xr.Dataset | None = None) -> Section:
    T, y, u = (master_curve[n].values for n in ("temperature", "log10_aT", "u_log10_aT"))
    order = np.argsort(T)
    fine = np.linspace(T.min(), T.max(), 161)
    series = [Series("fitted", T[order], y[order], style="points", role="measured", u=u[order])]
    if published is not None:
        series.append(_published_section.series(published))
    laws = json.loads(master_curve.attrs["laws"])
    roles: tuple[Literal["model", "reference"], ...] = ("model", "reference")
    holding = {name: law for name, law in laws.items() if ShiftLaw.of(law).holds}
    for (name, law), role in zip(sorted(holding.items(), reverse=True), roles, strict=False):
        title = {"wlf": "WLF", "arrhenius": "Arrhenius"}[name]
        series.append(Series(title, fine, ShiftLaw.of(law).log10_aT(fine), role=role))
    labels, caption = ("temperature / °C", "log₁₀ a_T"), "Bars are standard uncertainties."
    if laws and not holding:
        caption += " No law is drawn, because none describes the shifts within their uncertainty."
    chart = LineChart("Horizontal shift factors", *labels, series, height_px=240, caption=caption)
    rising = master_curve.isel(temperature=order)
    overlaps, steps = zip(*(_neighbour(master_curve, float(t)) for t in T[order]), strict=True)
    table = listed(
        (
            Listed("temperature / °C", T[order].tolist(), digits=3),
            pages.column(rising, "log10_aT", "log₁₀ a_T"),
            pages.column(rising, "b_T", "b_T"),
            pages.column(rising, "level", "level"),
            Listed("overlap with the next / decades", overlaps, digits=3),
            Listed("step", steps),
        ),
        "A step is “loose” when the data alone do not determine it; there the shift "
        "relies on the prior, the usual behaviour of polymers.",
    )
    titles = {n: "law of WLF" if n == "wlf" else "law of Arrhenius" for n in laws}
    fits = [(titles[n], _law_text(law), _law_quality(law)) for n, law in sorted(laws.items(), reverse=True)]
    if float(master_curve["delay"]):
        fits.append(("delay of the instrument's phase", pages.told(master_curve, "delay"), "removed"))
    folded = Details(f"Laws, and the shift factors of {T.size} temperatures", (KeyValues(fits), table))
    compared = [] if published is None else _published_section.blocks(published, master_curve)
    return Section("Shift factors", (chart, folded, *compared))


def law_row(law: dict[str, Any]) -> tuple[str, str, str]:
    if law["name"] == "arrhenius" and law["u_activation_energy"] is None:
        return "shift law", "none: a single temperature determines no shift", ""
    if ShiftLaw.of(law).holds:
        return "shift law", _law_text(law), _law_quality(law)
    return (
        "shift law",
        "neither WLF nor Arrhenius holds over all temperatures",
        "the shifts are free; a kink indicates a transition",
    )


def _law_text(law: dict[str, Any]) -> str:
    if law["name"] == "wlf":
        if law["C1"] is None or law["C2"] is None:
            return "WLF, a straight line over temperature"
        return (
            f"WLF, C₁ = {value_with_uncertainty(law['C1'], law['u_C1'] or 0.0)}, "
            f"C₂ = {value_with_uncertainty(law['C2'], law['u_C2'] or 0.0)} K"
        )
    u = law["u_activation_energy"] or 0.0
    shown = value_with_uncertainty(law["activation_energy"] / 1e3, u / 1e3)
    return f"Arrhenius, activation energy {shown} kJ/mol"


def _law_quality(law: dict[str, Any]) -> str:
    if law["chi_square"] is None or not law["freedom"]:
        return ""
    ratio = law["chi_square"] / law["freedom"]
    verdict = "" if ShiftLaw.of(law).holds else ": does not hold"
    return f"χ² / degrees of freedom = {ratio:.3g}{verdict}"


def _neighbour(curve: xr.Dataset, T: float) -> tuple[float | None, str]:
    found = np.flatnonzero(np.isclose(curve["colder"].values, T))
    if not found.size:
        return None, ""
    pair = curve.isel(pair=int(found[0]))
    return float(pair["overlap"]), "" if int(pair["determined"]) else "loose"

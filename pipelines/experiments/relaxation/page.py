"""The report of relaxation tests."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr

from labpipe.report import Band, Block, KeyValues, LineChart, Listed, Notice, Paragraph, Section, Series, listed
from labpipe.workflow.context import Context
from pipelines.experiments.relaxation.budget import quantities
from pipelines.experiments.relaxation.comparison import rows as compared_rows
from pipelines.experiments.relaxation.moduli import BINS_PER_DECADE
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, pages, ramps_and_holds
from pipelines.experiments.shared.punch_sections import measured
from pipelines.experiments.shared.reports import Report, budgets, is_there

_MPA = 1e-6
_RAMP_VIEW = 2.0  # s around a ramp that are drawn sample by sample


def _label(tests: xr.Dataset | None, number: int) -> str:
    if tests is None:
        return f"test {number + 1}"
    depth = float(tests["depth"][number])
    return f"{depth * 1e3:.3f} mm" if np.isfinite(depth) else str(json.loads(tests.attrs["names"])[number])


def _summary(
    context: Context, tests: xr.Dataset | None = None, comparison: Sequence[xr.Dataset] | None = None
) -> Section:
    rows = []
    if tests is not None:
        rows.append(("tests", str(tests.sizes["test"]), "ramps with their holds"))
        if "mean_relaxed_modulus" in tests and np.isfinite(float(tests["mean_relaxed_modulus"])):
            remark = "in tension, from the plateaus of all tests"
            rows.append(("relaxed modulus", pages.told(tests, "mean_relaxed_modulus"), remark))
        elif "mean_reduced_modulus" in tests:
            remark = "E/(1 − ν²), from the plateaus of all tests"
            rows.append(("relaxed reduced modulus", pages.told(tests, "mean_reduced_modulus"), remark))
        if "nrmse_all" in tests:
            errors = tests["nrmse_all"].values * 100
            remark = "root mean square of measured minus model, over the range of the simulated force of each test"
            rows.append(("nRMSE of force", f"{np.nanmin(errors):.3g} to {np.nanmax(errors):.3g} %", remark))
    blocks: list[Block] = [KeyValues(rows)] if rows else []
    reasons = sorted({str(c.attrs["absent"]) for c in comparison or () if "absent" in c.attrs})
    blocks += [Notice("info", f"No comparison with a model: {reason}.") for reason in reasons]
    return Section("Summary", (*blocks, *pages.failed_notice(context)))


def _measured(
    settings: Relaxation,
    context: Context,
    readings: list[xr.Dataset | None] | None = None,
    loads: list[xr.Dataset] | None = None,
    model: list[xr.Dataset] | None = None,
) -> Section:
    found = next(filter(is_there, model or ()), None)
    return measured(settings, context, settings.mach1, readings, loads, found)


def _tests(tests: xr.Dataset) -> Section:
    clean = "peak_force_unfiltered"
    is_clean = clean in tests and bool(np.isfinite(tests[clean]).all())
    peak = clean if is_clean else "peak_force"
    top, level = tests[peak].values, tests["plateau_force"].values
    ratio = top / level
    # the cell's gain is in both and cancels, so that this is rather too large
    u = np.abs(ratio) * np.hypot(tests[f"u_{peak}"].values / top, tests["u_plateau_force"].values / level)
    first = (
        Listed("test", list(json.loads(tests.attrs["names"]))),
        *([pages.column(tests, "depth", "depth")] if np.isfinite(tests["depth"]).any() else []),
        pages.column(tests, peak, "peak"),
        *([pages.column(tests, "peak_force", "peak as recorded")] if is_clean else []),
        pages.column(tests, "plateau_force", "plateau"),
        Listed("peak/plateau", ratio.tolist(), u=u.tolist()),
    )
    caption = (
        "The peak is that before the load cell's filter, from the relaxation fitted to the force behind it; its "
        "uncertainty includes the filter's unknown type"
        if is_clean
        else "The peak is as recorded, behind the load cell's filter if it has one"
    )
    second = [
        Listed("test", [_label(tests, i) for i in range(tests.sizes["test"])]),
        pages.column(tests, "speed", "ramp speed"),
        pages.column(tests, "duration", "hold"),
    ]
    text = "Measured displacement."
    if "nrmse_all" in tests:
        errors = {part: (tests[f"nrmse_{part}"].values * 100).tolist() for part in ("ramp", "early", "late", "all")}
        second += [Listed(f"nRMSE {part}", error, "%", digits=3) for part, error in errors.items()]
        text = (
            "Measured displacement, and errors of the simulated force relative to the range of the simulated force "
            "in the whole test."
        )
    caption += "; the plateau is the mean over the end of the hold."
    return Section("Tests", (listed(first, caption), listed(second, text)))


def _ramps(
    loads: Sequence[xr.Dataset],
    ramps: Sequence[xr.Dataset],
    comparison: Sequence[xr.Dataset],
    tests: xr.Dataset | None = None,
) -> Section:
    charts: list[Block] = []
    for load, found, compared in zip(loads, ramps, comparison, strict=True):
        touch, has_model = float(found["contact_position"]), "absent" not in compared.attrs
        is_filtered = has_model and mach1_readings.declared_filter(load)
        caption = "The load cell's filter was applied to the model too." if is_filtered else ""
        for hold in ramps_and_holds.find(load):
            label = _label(tests, len(charts) // 2)
            time = load["time"].values[hold.rows]
            near = (time >= hold.begin - _RAMP_VIEW) & (time <= hold.end + _RAMP_VIEW)
            since, force = time[near] - hold.begin, load["force"].values[hold.rows][near]
            series: list[Series | Band] = [Series("measured", since, force, role="measured")]
            if has_model:
                names = ("simulated_force", "u_simulated_force")
                series += pages.model_curves(since, *(compared[name].values[hold.rows][near] for name in names))
            labels = (f"Force around the ramp, {label}", "time since the ramp began / s", "force / N")
            charts.append(LineChart(*labels, tuple(series), group=label, height_px=240, caption=caption))
            position = load["position_z"].values[hold.rows][near]
            depth = (position - (touch if np.isfinite(touch) else hold.start)) * 1e3
            labels = (f"Indentation around the ramp, {label}", "time since the ramp began / s", "indentation / mm")
            pressed = (Series(f"measured{', input of the model' * has_model}", since, depth, role="measured"),)
            charts.append(LineChart(*labels, pressed, group=label, height_px=150))
    return Section("Ramp and peak", tuple(charts))


def _holds(loads: Sequence[xr.Dataset], comparison: Sequence[xr.Dataset], tests: xr.Dataset | None = None) -> Section:
    curves: list[Series] = []
    gaps: list[Series | Band] = []
    held = [
        (load, compared, hold)
        for load, compared in zip(loads, comparison, strict=True)
        for hold in ramps_and_holds.find(load)
    ]
    for number, (load, compared, hold) in enumerate(held):
        label = _label(tests, number)
        time, force = load["time"].values[hold.rows] - hold.end, load["force"].values[hold.rows]
        first, longest = float(np.min(time[time > 0])), float(time[-1])
        edges = np.geomspace(0.99 * first, 1.001 * longest, int(np.log10(longest / first) * BINS_PER_DECADE) + 2)
        lag, mean, _, _ = ramps_and_holds.binned(time, force, edges)
        curves.append(Series(f"{label}, measured", lag, mean, style="points", role="measured"))
        if "absent" in compared.attrs:
            continue
        theirs, u_theirs = (compared[f"{u}simulated_force"].values[hold.rows] for u in ("", "u_"))
        _, model, _, _ = ramps_and_holds.binned(time, theirs, edges)
        _, wide, _, _ = ramps_and_holds.binned(time, u_theirs, edges)
        _, gap, spread, n = ramps_and_holds.binned(time, force - theirs, edges)
        u = np.maximum(spread, float(np.nanmax(load["u_force"].values))) / np.sqrt(n)
        curves.append(Series(f"{label}, model", lag, model, role="model"))
        gaps.append(Series(label, lag, gap, role="residual", u=u))
        gaps.append(Band(f"{label}, model ± 2 u", lag, -2 * wide, 2 * wide, role="model"))
    x, caption = "time since the stage arrived / s", "Means over equal steps of the logarithm of time."
    drawn = tuple(curves)
    charts = [LineChart("Relaxation", x, "force / N", drawn, x_scale="log", height_px=320, caption=caption)]
    if gaps:
        caption = (
            "Bars: noise of each mean, one standard uncertainty. An error of the depth, the gain or the modulus shifts "
            "the whole curve; the area is the uncertainty of the model."
        )
        title, y, rest = "Measured minus model", "difference / N", tuple(gaps)
        charts.append(LineChart(title, x, y, rest, x_scale="log", height_px=200, caption=caption))
    return Section("Relaxation", tuple(charts))


def _moduli(curves: Sequence[xr.Dataset], tests: xr.Dataset, model: Sequence[xr.Dataset] | None = None) -> Section:
    absent = next((str(c.attrs["absent"]) for c in curves if "absent" in c.attrs), None)
    if absent is not None:
        return Section("Modulus", (Notice("info", f"{absent}."),))
    text = (
        "The plateau gives the relaxed reduced modulus E/(1 − ν²) as force over the elastic "
        "force of a unit modulus at the same depth (eq. 2.17 inverted, for the punch's own "
        "profile). The relaxation modulus is fitted to the force from the ramp to the end of "
        "the hold through Lee and Radok's integral; no material was assumed."
    )
    series, number = [], 0
    for curve in curves:
        if "relaxation_modulus" in curve:
            modulus = curve["relaxation_modulus"].values * _MPA
            series.append(Series(_label(tests, number), curve["elapsed"].values, modulus, role="measured"))
        number += curve.sizes["ramp"]
    known = next((m for m in model or () if "relaxation_modulus" in m), None)
    if series and known is not None:
        modulus = known["relaxation_modulus"].values * _MPA
        series.append(Series("of the material", known["elapsed"].values, modulus, role="model"))
    blocks: list[Block] = [Paragraph(text)]
    if series:
        caption = "For a linear material all curves coincide. They begin where ramp and filter allow processes to be "
        caption += "resolved."
        labels = ("Relaxation modulus from the force", "time / s", "reduced modulus / MPa")
        blocks.append(LineChart(*labels, tuple(series), x_scale="log", height_px=280, caption=caption))
    depths = [_label(tests, i) for i in range(tests.sizes["test"])]
    columns = (Listed("depth", depths), pages.column(tests, "reduced_modulus", "reduced modulus"))
    blocks.append(listed(columns, "Reduced modulus by the plateau of each test.", sortable=False))
    return Section("Modulus", tuple(blocks))


def _methods(settings: Relaxation, tests: xr.Dataset, ramps: Sequence[xr.Dataset] | None = None) -> Section:
    depths = tests["depth"].values * 1e3
    speed, hold = float(np.median(tests["speed"])) * 1e3, float(np.median(tests["duration"]))
    punch = "a punch" if settings.punch is None else "a periodic punch"
    text = f"In {pages.counted(tests.sizes['test'], 'relaxation test')} {punch} was pressed into the sample"
    if np.isfinite(depths).all():
        text += f" to {', '.join(f'{d:.3f}' for d in depths)} mm"
    text += (
        f" at {speed:.3g} mm/s and held for {hold:.0f} s. The plateau is the mean force over the last "
        f"{min(settings.hold.plateau.value, 0.1 * hold):.0f} s. "
    )
    if ramps and all(np.isfinite(float(ramp["contact_position"])) for ramp in ramps):
        text += f"First touch was {' or '.join(dict.fromkeys(str(ramp.attrs['contact']) for ramp in ramps))}. "
    if "mean_reduced_modulus" in tests:
        shown = pages.told(tests, "mean_reduced_modulus")
        text += (
            "The relaxed reduced modulus, from the plateau and the elastic force at the measured "
            f"depth, is {shown} (standard uncertainty). "
        )
    if "nrmse_all" in tests:
        error = tests["nrmse_all"].values * 100
        text += (
            "The force was simulated by periodic boundary elements with the measured displacement; the normalised "
            f"root-mean-square error over a test was {pages.spanned(error, '.2f')} %."
        )
    return pages.methods(text, settings)


page = Report(
    "Stress relaxation",
    ("readings", "loads", "ramps", "curves", "model", "comparison", "tests"),
    (_summary, _measured, _tests, _ramps, _holds, _moduli, budgets(quantities), _methods),
    compared_rows,
    counts=dict.fromkeys(
        ("loads", "ramps", "curves", "model", "comparison"), lambda each: all(one is not None for one in each)
    ),
)

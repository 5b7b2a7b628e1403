"""The report of relaxation tests."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr

from labpipe.report import Band, LineChart, Listed, Notice, Section, Series, listed, quantity
from pipelines.experiments.relaxation.budget import quantities
from pipelines.experiments.relaxation.comparison import rows
from pipelines.experiments.relaxation.measured import samples
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, pages
from pipelines.experiments.shared.punch_sections import measured, simulated_by, without_model
from pipelines.experiments.shared.reports import Report, is_there


def _details(
    settings: Relaxation, tests: xr.Dataset | None = None, ramps: Sequence[xr.Dataset] | None = None
) -> list[tuple[str, str, str]]:
    moduli = {
        "mean_relaxed_modulus": ("relaxed modulus", "in tension, from the plateaus of all tests"),
        "mean_reduced_modulus": ("relaxed reduced modulus", "E/(1 − ν²), from the plateaus of all tests"),
    }
    rows = pages.known(tests, moduli)[:1]
    if ramps:
        begin, end, last = (float(ramps[0][name][0]) for name in ("begin", "end", "last"))
        until = quantity(np.sqrt((end - begin) * (last - end)), "s", 2)
        rows.append(("parts of the hold", "early, late", f"up to {until} after the ramp, and from then on"))
    lost = {str(ramp.attrs["contact"]) for ramp in ramps or () if not np.isfinite(float(ramp["contact_position"]))}
    return [*rows, *(("first touch", "not found", reason) for reason in sorted(lost)), *without_model(settings)]


def _tests(tests: xr.Dataset, curves: Sequence[xr.Dataset] = ()) -> Section:
    top, level = tests["peak_force"].values, tests["plateau_force"].values
    # the cell's gain is in both and cancels, so that this is rather too large
    u = np.abs(top / level) * np.hypot(tests["u_peak_force"].values / top, tests["u_plateau_force"].values / level)
    titles = {"speed": "ramp speed", "duration": "hold", "reduced_modulus": "reduced modulus"}
    columns = (
        Listed("test", list(json.loads(tests.attrs["names"]))),
        *pages.columns(tests, {"depth": "depth", "peak_force": "peak", "plateau_force": "plateau"}),
        Listed("peak/plateau", (top / level).tolist(), u=u.tolist()),
        *pages.columns(tests, titles),
    )
    caption = (
        "The peak is as recorded, behind the load cell's filter if it has one; the plateau is the mean over the end of "
        "the hold, its reduced modulus E/(1 − ν²) that over the elastic force of a unit modulus at the same depth "
        "(thesis eq. 2.17 inverted, for the punch's own profile)."
    )
    missing = dict.fromkeys(f"{curve.attrs['absent']}." for curve in curves if "absent" in curve.attrs)
    return Section("Tests", (listed(columns, caption), *(Notice("info", text) for text in missing)))


def _forces(
    loads: Sequence[xr.Dataset],
    ramps: Sequence[xr.Dataset],
    comparison: Sequence[xr.Dataset],
    curves: Sequence[xr.Dataset] | None = None,
    tests: xr.Dataset | None = None,
) -> list[Section]:
    """Draw the force for ten durations of each ramp, and the means of all holds over the logarithm of time."""
    around, drawn, gaps = list[Series](), list[Series](), list[Series]()
    places = [(n, i, part) for n, ramp in enumerate(ramps) for i, part in enumerate(samples(ramp))]
    for place, (n, i, part) in enumerate(places):
        load, ramp, compared = loads[n], ramps[n], comparison[n]
        depth, level = float("nan") if tests is None else float(tests["depth"][place]), pages.level(place, len(places))
        label = f"test {place + 1}" if tests is None else str(json.loads(tests.attrs["names"])[place])
        label = f"{depth * 1e3:.3f} mm" if np.isfinite(depth) else label
        since, force = load["time"].values[part] - float(ramp["end"][i]), load["force"].values[part]
        model = [compared[f"{u}simulated_force"].values[part] for u in ("", "u_")] if is_there(compared) else []
        begin = float(ramp["begin"][i] - ramp["end"][i])
        shown = (since >= 2.0 * begin) & (since <= -10.0 * begin)
        around.append(Series(label, since[shown] - begin, force[shown], role="measured", level=level))
        if model:
            near_it = (one[shown] for one in model)
            around += pages.model_curves(since[shown] - begin, near_it, f"{label}, model", level=level)
        if curves is None:
            continue
        means = np.array([curves[n][name].values[i] for name in ("mean_time", "force", "u_force")])
        lag, force, u = means[:, np.isfinite(means[1])]
        drawn.append(Series(label, lag, force, style="points", role="measured", level=level))
        if model:
            theirs, wide = (np.interp(lag, since, one) for one in model)
            drawn.append(Series(f"{label}, model", lag, theirs, role="model", level=level))
            gaps.append(Series(label, lag, force - theirs, role="residual", u=u, level=level))
            gaps.append(Band(f"{label}, model ± 2 u", lag, -2 * wide, 2 * wide, role="model", level=level))
    is_filtered = any(map(mach1_readings.declared_filter, loads)) and any(map(is_there, comparison))
    filtered = "The load cell's filter was applied to the model too." * is_filtered
    caption = (
        "Bars: noise of each mean, one standard uncertainty. An error of the depth, the gain or the modulus shifts "
        "the whole curve; the area is the uncertainty of the model."
    )
    labels = ("Force around the ramp", "time since the ramp began / s", "force / N", around)
    holds = [
        LineChart(title, "time since the stage arrived / s", label, shown, x_scale="log", height_px=tall, caption=text)
        for title, label, shown, tall, text in (
            ("Relaxation", "force / N", drawn, 320, "Means over equal steps of the logarithm of time."),
            ("Measured minus model", "difference / N", gaps, 200, caption),
        )
        if shown
    ]
    chart = LineChart(*labels, height_px=320, caption=filtered)
    return [Section("Ramp and peak", [chart]), Section("Relaxation", holds)]


def _methods(settings: Relaxation, tests: xr.Dataset, ramps: Sequence[xr.Dataset] | None = None) -> str:
    depths = tests["depth"].values * 1e3
    speed, hold = float(np.median(tests["speed"])) * 1e3, float(np.median(tests["duration"]))
    punch = "a punch" if settings.punch is None else "a periodic punch"
    text = f"In {pages.counted(tests.sizes['test'], 'relaxation test')} {punch} was pressed into the sample"
    if np.isfinite(depths).all():
        text += f" to {', '.join(f'{d:.3f}' for d in depths)} mm"
    text += (
        f" at {speed:.3g} mm/s and held for {hold:.0f} s. The plateau is the mean force over the last tenth of that. "
    )
    if ramps and all(np.isfinite(float(ramp["contact_position"])) for ramp in ramps):
        text += f"First touch was {' or '.join(dict.fromkeys(str(ramp.attrs['contact']) for ramp in ramps))}. "
    if "mean_reduced_modulus" in tests:
        shown = pages.told(tests, "mean_reduced_modulus")
        text += (
            "The relaxed reduced modulus, from the plateau and the elastic force at the measured depth (thesis "
            f"eq. 2.17), is {shown} (standard uncertainty). "
        )
    if "nrmse_all" in tests:
        text += simulated_by(tests["nrmse_all"].values)
    return text


page = Report(
    subtitle="Stress relaxation",
    shown=("readings", "loads", "ramps", "curves", "model", "comparison", "tests"),
    details=_details,
    rows=rows,
    sections=(measured, _tests, _forces),
    budget=quantities,
    methods=_methods,
    counts=dict.fromkeys(
        ("loads", "ramps", "curves", "model", "comparison"), lambda each: all(one is not None for one in each)
    ),
)

"""The report of relaxation tests."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr

from labpipe.report import Band, Block, LineChart, Listed, Notice, Section, Series, listed, quantity
from pipelines.experiments.relaxation.budget import quantities
from pipelines.experiments.relaxation.comparison import rows as compared_rows
from pipelines.experiments.relaxation.measured import samples
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings, pages
from pipelines.experiments.shared.punch_sections import measured, simulated_by, without_model
from pipelines.experiments.shared.reports import Report, budgets, is_there, summary

_RAMP_VIEW = 2.0  # s around a ramp that are drawn sample by sample


def _label(tests: xr.Dataset | None, number: int) -> str:
    if tests is None:
        return f"test {number + 1}"
    depth = float(tests["depth"][number])
    return f"{depth * 1e3:.3f} mm" if np.isfinite(depth) else str(json.loads(tests.attrs["names"])[number])


def _details(
    settings: Relaxation, tests: xr.Dataset | None = None, ramps: Sequence[xr.Dataset] | None = None
) -> list[tuple[str, str, str]]:
    rows = list[tuple[str, str, str]]()
    for name, title, remark in (
        ("mean_relaxed_modulus", "relaxed modulus", "in tension, from the plateaus of all tests"),
        ("mean_reduced_modulus", "relaxed reduced modulus", "E/(1 − ν²), from the plateaus of all tests"),
    ):
        if tests is not None and name in tests and np.isfinite(float(tests[name])) and not rows:
            rows.append((title, pages.told(tests, name), remark))
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
    columns = (
        Listed("test", list(json.loads(tests.attrs["names"]))),
        *([pages.column(tests, "depth", "depth")] if np.isfinite(tests["depth"]).any() else []),
        pages.column(tests, "peak_force", "peak"),
        pages.column(tests, "plateau_force", "plateau"),
        Listed("peak/plateau", (top / level).tolist(), u=u.tolist()),
        pages.column(tests, "speed", "ramp speed"),
        pages.column(tests, "duration", "hold"),
        *([pages.column(tests, "reduced_modulus", "reduced modulus")] if "reduced_modulus" in tests else []),
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
    """Draw the force around each ramp sample by sample, and the means of all holds over the logarithm of time."""
    charts, drawn, gaps = list[Block](), list[Series](), list[Series | Band]()
    for number, (load, ramp, compared) in enumerate(zip(loads, ramps, comparison, strict=True)):
        has_model, names = is_there(compared), ("simulated_force", "u_simulated_force")
        is_filtered = has_model and mach1_readings.declared_filter(load)
        caption = "The load cell's filter was applied to the model too." if is_filtered else ""
        for i, rows in enumerate(samples(ramp)):
            label, begin = _label(tests, len(charts)), float(ramp["begin"][i] - ramp["end"][i])
            since, force = load["time"].values[rows] - float(ramp["end"][i]), load["force"].values[rows]
            model = [compared[name].values[rows] for name in names] if has_model else []
            near = (since >= begin - _RAMP_VIEW) & (since <= _RAMP_VIEW)
            series: list[Series | Band] = [Series("measured", since[near] - begin, force[near], role="measured")]
            series += pages.model_curves(since[near] - begin, *(one[near] for one in model)) if model else ()
            labels = (f"Force around the ramp, {label}", "time since the ramp began / s", "force / N", tuple(series))
            charts.append(LineChart(*labels, group="ramps", height_px=240, caption=caption))
            if curves is None:
                continue
            means = np.array([curves[number][name].values[i] for name in ("mean_time", "force", "u_force")])
            lag, force, u = means[:, np.isfinite(means[1])]
            drawn.append(Series(f"{label}, measured", lag, force, style="points", role="measured"))
            if model:
                theirs, wide = (np.interp(lag, since, one) for one in model)
                drawn.append(Series(f"{label}, model", lag, theirs, role="model"))
                gaps.append(Series(label, lag, force - theirs, role="residual", u=u))
                gaps.append(Band(f"{label}, model ± 2 u", lag, -2 * wide, 2 * wide, role="model"))
    sections, x = [Section("Ramp and peak", tuple(charts))], "time since the stage arrived / s"
    if drawn:
        caption = "Means over equal steps of the logarithm of time."
        holds = [LineChart("Relaxation", x, "force / N", drawn, x_scale="log", height_px=320, caption=caption)]
        caption = (
            "Bars: noise of each mean, one standard uncertainty. An error of the depth, the gain or the modulus shifts "
            "the whole curve; the area is the uncertainty of the model."
        )
        labels = ("Measured minus model", x, "difference / N", tuple(gaps))
        holds += [LineChart(*labels, x_scale="log", height_px=200, caption=caption)] if gaps else []
        sections.append(Section("Relaxation", tuple(holds)))
    return sections


def _methods(settings: Relaxation, tests: xr.Dataset, ramps: Sequence[xr.Dataset] | None = None) -> Section:
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
    return pages.methods(text, settings)


page = Report(
    "Stress relaxation",
    ("readings", "loads", "ramps", "curves", "model", "comparison", "tests"),
    (summary(compared_rows, _details), measured, _tests, _forces, budgets(quantities), _methods),
    compared_rows,
    counts=dict.fromkeys(
        ("loads", "ramps", "curves", "model", "comparison"), lambda each: all(one is not None for one in each)
    ),
)

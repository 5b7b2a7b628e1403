"""The report of a static loading."""

from itertools import pairwise

import numpy as np
import xarray as xr

from labpipe.report import Band, Block, KeyValues, LineChart, Listed, Paragraph, Section, Series, listed
from labpipe.workflow.context import Context
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.counter_body import described_flat
from pipelines.experiments.shared.ramps_and_holds import binned
from pipelines.experiments.shared.reports import Report, budgets
from pipelines.experiments.static_loading.budget import quantities
from pipelines.experiments.static_loading.comparison import rows as compared_rows
from pipelines.experiments.static_loading.settings import StaticLoading

_UM = 1e6
_MIN = 1 / 60
_POINTS_PER_DECADE = 8  # of the creep curves


def _summary(context: Context, approach: xr.Dataset | None = None, comparison: xr.Dataset | None = None) -> Section:
    rows = []
    if approach is not None:
        radius = approach["level_contact_radius"].values * _UM
        rows.append(("loads", str(radius.size), "steps of the load"))
        for at, word in ((0, "first"), (-1, "last")):
            shown = pages.told(approach, "level_contact_radius", at)
            rows.append((f"contact radius under the {word} load", shown, "at the end of the load"))
        largest = int(np.argmax(approach["creep"].values))
        shown = pages.told(approach, "creep", largest)
        rows.append(("largest creep under one load", shown, f"load {largest + 1}"))
    if comparison is not None:
        for other, word in (("model", "viscoelastic model"), ("hertz", f"Hertz, {comparison.attrs['reference']}")):
            error = float(comparison[f"nrmse_contact_radius_{other}"]) * 100
            remark = "single readings, over the range of what they are compared with"
            rows.append((f"nRMSE of contact radius, {word}", f"{error:.3g} %", remark))
    shown_rows: list[Block] = [KeyValues(rows)] if rows else []
    return Section("Summary", (*shown_rows, *pages.failed_notice(context)))


def _measured(
    settings: StaticLoading,
    context: Context,
    readings: xr.Dataset | None = None,
    displacement: xr.Dataset | None = None,
) -> Section:
    ball = settings.sphere
    rows = [("file", settings.laser, ""), ("radius of the sphere", pages.stated(ball.radius), "")]
    rows += [("material", ball.source, ""), *pages.remarks(context)]
    blocks: list[Block] = [KeyValues([r for r in rows if r[1]])]
    if displacement is not None:
        blocks.append(pages.calibration_rows(displacement.attrs["calibration"]))
    header = pages.raw_header(readings)
    inside = (*blocks, *([header] if header is not None else []))
    return pages.folded("What was measured, and its calibration", "File, sphere and calibration record", inside)


def _radii(steps: xr.Dataset, approach: xr.Dataset, model: xr.Dataset | None = None) -> Section:
    time = approach["time"].values * _MIN
    series: list[Series | Band] = [
        Series("readings", time, approach["contact_radius"].values * _UM, role="repeat"),
        Series("moving average", time, approach["smooth_radius"].values * _UM, role="measured"),
    ]
    edges = np.append(steps["begin"].values, steps["end"].values[-1]) * _MIN
    if model is not None:
        radius, u = (model[name].values * _UM for name in ("contact_radius", "u_contact_radius"))
        series += pages.model_curves(time, radius, u, label="viscoelastic model")
        elastic = np.append(model["hertz_radius_relaxed"].values, model["hertz_radius_relaxed"].values[-1]) * _UM
        series.append(Series(f"Hertz, {model.attrs['reference']}", edges, elastic, style="step", role="reference"))
    lines = tuple((f"load {i + 1}", float(t)) for i, t in enumerate(edges[:-1]))
    views = tuple((f"load {i + 1}", float(a), float(b)) for i, (a, b) in enumerate(pairwise(edges)))
    labels = ("Contact radius, a = √(R δ)", "time / min", "contact radius / µm")
    caption = "Moving average over one minute, not across a load step."
    chart = LineChart(*labels, tuple(series), vlines=lines, views=views, height_px=340, caption=caption)
    return Section("Contact radius", (chart,))


def _creep(settings: StaticLoading, steps: xr.Dataset, approach: xr.Dataset, model: xr.Dataset) -> Section:
    """Show the approach over Hertz's under each load, over the time since it was put on."""
    time, kept = approach["time"].values, approach["is_settled"].values.astype(bool)
    series = []
    for i in range(steps.sizes["load"]):
        begin, end = float(steps["begin"][i]), float(steps["end"][i])
        inside = kept & (time > begin) & (time < end)
        since = time[inside] - begin
        elastic = float(model["hertz_approach_relaxed"][i])
        count = int(np.log10(since[-1] / since[0]) * _POINTS_PER_DECADE) + 2
        edges = np.geomspace(0.99 * since[0], 1.001 * since[-1], count)
        lag, mean, _, _ = binned(since, approach["approach"].values[inside] / elastic, edges)
        label = f"{settings.loads[i].mass.value:g} kg"
        series.append(Series(f"{label}, measured", lag, mean, style="points", role="measured"))
        _, theirs, _, _ = binned(since, model["approach"].values[inside] / elastic, edges)
        series.append(Series(f"{label}, model", lag, theirs, role="model"))
    shares = 100.0 * (model["u_approach"] / model["approach"]).values[kept]
    caption = (
        f"Hertz with the {model.attrs['reference']} would be 1 at all times; readings next to a step are left out. "
        f"The model's standard uncertainty is {pages.spanned(shares, '.2g')} % of its approach."
    )
    labels = ("Approach over that of Hertz", "time since the load was applied / s", "approach / approach by Hertz")
    chart = LineChart(*labels, tuple(series), x_scale="log", height_px=320, caption=caption)
    return Section("Creep", (chart,))


def _loads(
    settings: StaticLoading, steps: xr.Dataset, approach: xr.Dataset, comparison: xr.Dataset | None = None
) -> Section:
    columns = [
        Listed("load / kg", [load.mass.value for load in settings.loads]),
        Listed("found / min", (steps["begin"].values * _MIN).tolist()),
        pages.column(approach, "level_approach", "approach"),
        pages.column(approach, "creep", "creep"),
        pages.column(approach, "level_contact_radius", "contact radius"),
    ]
    chosen = settings.steps
    caption = (
        f"Approach and radius: means over the last {chosen.window.value:g} s of a load. Creep: "
        f"from the first {chosen.window.value:g} s, {chosen.settle.value:g} s after the load was "
        f"applied, to the last."
    )
    if comparison is not None:
        columns += [
            pages.column(comparison, "radius_difference", "radius, measured − model"),
            pages.plain(comparison, "hertz_difference", "measured − Hertz"),
            pages.plain(comparison, "creep_model", "creep, model"),
        ]
        caption += f" Hertz with the {comparison.attrs['reference']} does not creep."
    return Section("Loads", (listed(columns, caption, sortable=False),))


def _touch(steps: xr.Dataset, model: xr.Dataset | None = None) -> Section:
    misfit, noise = (f"{float(steps[name]) * _UM:.2f} µm" for name in ("scatter", "noise"))
    rows = [
        ("displacement at first touch", pages.told(steps, "touch"), steps.attrs["touch"]),
        ("misfit of the creep fit", misfit, f"noise of a reading: {noise}"),
    ]
    lag = steps["elapsed"].values
    series = [Series("from the record", lag, steps["compliance"].values * 1e9, role="measured")]
    if model is not None:
        series.append(Series("of sphere and disc", lag, model["compliance"].values * 1e9, role="model"))
    text = (
        "Under increasing loads, the approach to the power 3/2 is the convolution of the load "
        "history with the creep compliance (Lee and Radok); loads of different size determine "
        "the zero of the approach, and the compliance follows without assuming a material."
    )
    title, x, y = "Reduced creep compliance", "time under load / s", "compliance / GPa⁻¹"
    chart = LineChart(title, x, y, tuple(series), x_scale="log", height_px=240)
    return Section("First touch and compliance", (Paragraph(text), KeyValues(rows), chart))


def _methods(
    settings: StaticLoading, steps: xr.Dataset, approach: xr.Dataset, comparison: xr.Dataset | None = None
) -> Section:
    masses = ", ".join(f"{load.mass.value:g}" for load in settings.loads)
    begins = ", ".join(f"{t * _MIN:.2f}" for t in steps["begin"].values)
    text = (
        f"A sphere of {settings.sphere.radius.value * 1e3:g} mm radius was loaded on "
        f"{described_flat(settings.counter_body)} by {masses} kg at {begins} min. The displacement of the holder was "
        f"read by a laser every {float(np.median(np.diff(approach['time']))):.3g} s and corrected for its inclination. "
        "The contact radius is √(R δ). "
    )
    if settings.zero is None:
        text += "The approach at first touch was fitted from the loads (Lee and Radok). "
    if comparison is not None:
        error = float(comparison["nrmse_contact_radius_model"]) * 100
        elastic = float(comparison["nrmse_contact_radius_hertz"]) * 100
        text += (
            f"The normalised root-mean-square error of the contact radius was {error:.2f} % against a viscoelastic "
            f"simulation and {elastic:.2f} % against Hertz with the {comparison.attrs['reference']}."
        )
    return pages.methods(text, settings)


page = Report(
    "Static loading",
    ("readings", "displacement", "steps", "approach", "model", "comparison"),
    (_summary, _measured, _radii, _creep, _loads, _touch, budgets(quantities), _methods),
    compared_rows,
)

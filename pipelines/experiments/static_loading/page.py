"""The report of a static loading."""

from itertools import pairwise

import numpy as np
import xarray as xr

from labpipe.report import Band, LineChart, Listed, Section, Series, listed, quantity
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.counter_body import described_flat
from pipelines.experiments.shared.reports import Report, budgets, summary
from pipelines.experiments.static_loading.budget import quantities
from pipelines.experiments.static_loading.comparison import rows as compared_rows
from pipelines.experiments.static_loading.settings import StaticLoading

_UM = 1e6
_MIN = 1 / 60


def _details(
    settings: StaticLoading,
    steps: xr.Dataset | None = None,
    approach: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> list[tuple[str, str, str]]:
    rows = []
    if approach is not None:
        largest = int(np.argmax(approach["creep"].values))
        where = f"load {largest + 1}, {settings.loads[largest].mass.value:g} kg"
        rows.append(("largest creep under one load", pages.told(approach, "creep", largest), where))
    if comparison is not None:
        error = float(comparison["nrmse_contact_radius_hertz"]) * 100
        remark = f"single readings, over the range of Hertz's radius, {comparison.attrs['reference']}"
        rows.append(("nRMSE of contact radius, Hertz", f"{error:.3g} %", remark))
    if steps is not None:
        remark = (
            f"± {quantity(float(steps['u_touch']), 'm', 2)} against the other readings; from the loads (Lee and Radok)"
        )
        rows.append(("displacement at first touch", quantity(float(steps["touch"]), "m", 4), remark))
        misfit, noise = (f"{float(steps[name]) * _UM:.2f} µm" for name in ("scatter", "noise"))
        rows.append(("misfit of the creep fit", misfit, f"noise of a reading: {noise}"))
    return rows


def _radii(steps: xr.Dataset, approach: xr.Dataset, model: xr.Dataset | None = None) -> Section:
    time = approach["time"].values * _MIN
    series: list[Series | Band] = [Series("readings", time, approach["contact_radius"].values * _UM, role="measured")]
    edges = np.append(steps["begin"].values, steps["end"].values[-1]) * _MIN
    if model is not None:
        radius, u = (model[name].values * _UM for name in ("contact_radius", "u_contact_radius"))
        series += pages.model_curves(time, radius, u, label="viscoelastic model")
        elastic = np.append(model["hertz_radius_relaxed"].values, model["hertz_radius_relaxed"].values[-1]) * _UM
        series.append(Series(f"Hertz, {model.attrs['reference']}", edges, elastic, style="step", role="reference"))
    lines = tuple((f"load {i + 1}", float(t)) for i, t in enumerate(edges[:-1]))
    views = tuple((f"load {i + 1}", float(a), float(b)) for i, (a, b) in enumerate(pairwise(edges)))
    labels = ("Contact radius, a = √(R δ)", "time / min", "contact radius / µm")
    chart = LineChart(*labels, tuple(series), vlines=lines, views=views, height_px=340)
    return Section("Contact radius", (chart,))


def _loads(
    settings: StaticLoading, steps: xr.Dataset, approach: xr.Dataset, comparison: xr.Dataset | None = None
) -> Section:
    columns = [
        Listed("load / kg", [load.mass.value for load in settings.loads]),
        Listed("found / min", (steps["begin"].values * _MIN).tolist()),
        pages.column(approach, "level_approach", "approach"),
        pages.column(approach, "creep", "creep / µm", _UM),
    ]
    window, settle = settings.steps.window.value, settings.steps.settle.value
    caption = (
        f"Approach: mean over the last {window:g} s of a load. Creep: from the first {window:g} s, {settle:g} s after "
        "the load was applied, to the last."
    )
    if comparison is not None:
        columns.append(pages.plain(comparison, "creep_model", "creep, model / µm", _UM, digits=3))
        columns.append(pages.plain(comparison, "hertz_difference", "contact radius, measured − Hertz"))
        caption += f" Hertz with the {comparison.attrs['reference']} does not creep."
    return Section("Loads", (listed(columns, caption, sortable=False),))


def _compliance(steps: xr.Dataset, model: xr.Dataset | None = None) -> Section:
    lag = steps["elapsed"].values
    series = [Series("from the record", lag, steps["compliance"].values * 1e9, role="measured")]
    if model is not None:
        series.append(Series("of sphere and disc", lag, model["compliance"].values * 1e9, role="model"))
    caption = (
        "Under increasing loads, the approach to the power 3/2 is the convolution of the load history with the creep "
        "compliance (Lee and Radok): loads of different size determine first touch and the compliance, without "
        "assuming a material."
    )
    labels = ("Reduced creep compliance", "time under load / s", "compliance / GPa⁻¹")
    chart = LineChart(*labels, tuple(series), x_scale="log", height_px=240, caption=caption)
    return Section("First touch and compliance", (chart,))


def _methods(
    settings: StaticLoading, steps: xr.Dataset, approach: xr.Dataset, comparison: xr.Dataset | None = None
) -> Section:
    masses = ", ".join(f"{load.mass.value:g}" for load in settings.loads)
    begins = ", ".join(f"{t * _MIN:.2f}" for t in steps["begin"].values)
    text = (
        f"A sphere of {settings.sphere.radius.value * 1e3:g} mm radius was loaded on "
        f"{described_flat(settings.counter_body)} by {masses} kg at {begins} min. The displacement of the holder was "
        f"read by a laser every {float(np.median(np.diff(approach['time']))):.3g} s and corrected for its inclination. "
        "The contact radius is √(R δ). The approach at first touch was fitted from the loads (Lee and Radok 1960, "
        "doi:10.1115/1.3644020). "
    )
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
    (summary(compared_rows, _details), pages.recordings, _radii, _loads, _compliance, budgets(quantities), _methods),
    compared_rows,
)

"""The report of a static loading."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import xarray as xr

from labpipe.report import Listed, Section, Series, listed, quantity
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.counter_body import described_flat
from pipelines.experiments.shared.reports import Report
from pipelines.experiments.static_loading.budget import quantities
from pipelines.experiments.static_loading.comparison import rows
from pipelines.experiments.static_loading.settings import StaticLoading


def _details(steps: xr.Dataset, comparison: xr.Dataset | None = None) -> list[tuple[str, str, str]]:
    near = quantity(float(steps["u_touch"]), "m", 2)
    rows = [
        (
            "displacement at first touch",
            quantity(float(steps["touch"]), "m", 4),
            f"± {near} against the other readings; from the loads (Lee and Radok)",
        )
    ]
    misfit, noise = (quantity(float(steps[name]), "m", 2) for name in ("scatter", "noise"))
    rows.append(("misfit of the creep fit", misfit, f"noise of a reading: {noise}"))
    if comparison is not None:
        error = float(comparison["nrmse_contact_radius_hertz"]) * 100
        remark = f"single readings, over the range of Hertz's radius, {comparison.attrs['reference']}"
        rows.insert(0, ("nRMSE of contact radius, Hertz", f"{error:.3g} %", remark))
    return rows


def _loads(
    settings: StaticLoading,
    steps: xr.Dataset,
    approach: xr.Dataset,
    model: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Iterator[Section]:
    """Show the contact radius over time, and the loads with what was found under each."""
    time = approach["time"].values
    series: list[Series] = [Series("readings", time, approach["contact_radius"].values, role="measured")]
    edges = np.append(steps["begin"].values, steps["end"].values[-1])
    if model is not None:
        radius, u, elastic = (model[n].values for n in ("contact_radius", "u_contact_radius", "hertz_radius_relaxed"))
        series += pages.model_curves(time, (radius, u), "viscoelastic model")
        label, elastic = f"Hertz, {model.attrs['reference']}", np.append(elastic, elastic[-1])
        series.append(Series(label, edges, elastic, style="step", role="reference"))
    views = [(f"load {i}", *ends) for i, ends in enumerate(pairwise(edges), 1)]
    lines = [(name, begin) for name, begin, _ in views]
    labels = ("Contact radius, a = √(R δ)", "time / min", "contact radius / µm")
    yield Section("Contact radius", (pages.chart(*labels, series, vlines=lines, views=views, height_px=340),))
    expected = {"creep_model": "creep, model / µm", "hertz_difference": "contact radius, measured − Hertz"}
    columns = [
        Listed("load / kg", [load.mass.value for load in settings.loads]),
        *pages.columns(steps, {"begin": "found / min"}, has_u=False),
        *pages.columns(approach, {"level_approach": "approach", "creep": "creep / µm"}),
        *pages.columns(comparison, expected, has_u=False, digits=3),
    ]
    window, settle = settings.steps.window.value, settings.steps.settle.value
    caption = (
        f"Approach: mean over the last {window:g} s of a load. Creep: from the first {window:g} s, {settle:g} s after "
        "the load was applied, to the last."
    )
    if comparison is not None:
        caption += f" Hertz with the {comparison.attrs['reference']} does not creep."
    yield Section("Loads", (listed(columns, caption, sortable=False),))


def _compliance(steps: xr.Dataset, model: xr.Dataset | None = None) -> Section:
    lag = steps["elapsed"].values
    series = [Series("from the record", lag, steps["compliance"].values, role="measured")]
    if model is not None:
        series.append(Series("of sphere and disc", lag, model["compliance"].values, role="model"))
    caption = (
        "Under increasing loads, the approach to the power 3/2 is the convolution of the load history with the creep "
        "compliance (Lee and Radok): loads of different size determine first touch and the compliance, without "
        "assuming a material."
    )
    labels = ("Reduced creep compliance", "time under load / s", "compliance / GPa⁻¹")
    chart = pages.chart(*labels, series, x_scale="log", height_px=240, caption=caption)
    return Section("First touch and compliance", (chart,))


def _methods(
    settings: StaticLoading, steps: xr.Dataset, approach: xr.Dataset, comparison: xr.Dataset | None = None
) -> str:
    masses = ", ".join(f"{load.mass.value:g}" for load in settings.loads)
    begins = ", ".join(f"{t / 60:.2f}" for t in steps["begin"].values)
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
    return text


page = Report(
    subtitle="Static loading",
    shown=("readings", "displacement", "steps", "approach", "model", "comparison"),
    details=_details,
    rows=rows,
    sections=(pages.recordings, _loads, _compliance),
    budget=quantities,
    methods=_methods,
)

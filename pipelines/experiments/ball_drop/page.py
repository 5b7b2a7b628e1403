"""The report of a ball drop."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import xarray as xr

from labpipe.report import Band, KeyValues, LineChart, Listed, Paragraph, Section, Series, listed, quantity
from pipelines.experiments.ball_drop.budget import quantities
from pipelines.experiments.ball_drop.comparison import rows
from pipelines.experiments.ball_drop.model import FOLLOWED, path_limits
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.counter_body import flat_rows
from pipelines.experiments.shared.drop_model import described_plate, linear_range_rows, simulated
from pipelines.experiments.shared.reports import Report

_RIGID_FLOOR = (
    "The model assumes a floor that does not move. A real floor takes up energy: a floor of mass M lowers the "
    "restitution of a mass m by up to about 2 m/M (0.0005 for half a kilogram on 1.5 t), which the uncertainty above "
    "does not include. Give the floor as plate (mass, frequency, damping_ratio), or name an experiment that measured "
    "it as plate_from."
)
_SPREAD = "± 2 sd of the repeats"
_DRAWN = {
    "displacement": ("Displacement", "height over first contact / mm"),
    "velocity": ("Velocity", "velocity / (m/s), upwards"),
    "force": ("Contact force (model)", "force / N"),
    "contact_radius": ("Contact radius (model)", "contact radius / mm"),
}
"""Title and axis of each quantity of the motion."""


def motion(repeats: xr.Dataset, model: xr.Dataset | None = None, comparison: xr.Dataset | None = None) -> Section:
    """Draw position, difference, velocity, force and contact radius over one axis of time.

    Without model or comparison the measurement alone is drawn.
    """
    views = pages.impact_views(repeats["touch_time"].values, repeats["contact_duration"].values)
    chart = partial(pages.chart, x="time since first contact / ms", group="drop", views=views, height_px=220)
    caption, apart, measured = "", list[LineChart](), repeats["time"].values
    curves: dict[str, list[Series]] = {"displacement": [], "velocity": []}
    if is_repeated := repeats.sizes["repeat"] > 1:
        caption = "Mean of the repeats with the band of ± 2 standard deviations; point at the chart to show each."
    for name, drawn in curves.items():
        mean = repeats[f"{name}_mean"].values
        if is_repeated:
            wide = 2 * repeats[f"{name}_sd"].values
            drawn.append(Band(_SPREAD, measured, mean - wide, mean + wide, role="measured"))
            for n, is_out, values in zip(*(repeats[of].values for of in ("repeat", "is_outlier", name)), strict=True):
                text = f"repeat {int(n)}{' (outlier)' * bool(is_out)}"
                drawn.append(Series(text, measured, values, role="repeat", on_hover=True))
        drawn.append(Series("mean of the repeats", measured, mean, role="measured"))
    if model is not None:
        since = model["time"].values - float(model["impact_time"][0])
        low, high = path_limits(model)
        curves["displacement"].append(Band("model, earliest to latest", since, low, high, role="model"))
        for name in _DRAWN:
            curves.setdefault(name, []).append(Series("model", since, model[name].values, role="model"))
        if followed := int(np.isfinite(model["u_impact_time"]).sum()):
            beyond = f"; after impact {followed} they grow in proportion to time" * (followed < model.sizes["impact"])
            caption += " The model's band lies between its earliest and latest path within two standard uncertainties "
            caption += f"of its inputs{beyond}."
    if model is not None and comparison is not None:
        time = comparison["time"].values
        below, above = (np.interp(time, since, end - model["displacement"].values) for end in (low, high))
        drawn = [Band("model, earliest to latest", time, below, above, role="model")]
        if is_repeated:
            wide = 2 * repeats["displacement_sd"].sel(time=time).values
            drawn.append(Band(_SPREAD, time, -wide, wide, role="repeat"))
        drawn.append(Series("difference", time, comparison["residual"].values, role="residual"))
        spikes = (
            "An impact that is early or late in the model shows as a spike, as both curves are steep there; the table "
            "of bounces gives the difference in time."
        )
        apart.append(chart("Measured minus model", y="difference / µm", series=drawn, caption=spikes))
    captions = {"displacement": caption.strip()}
    moved, *others = (
        chart(title, y=label, series=curves[name], caption=captions.get(name, ""))
        for name, (title, label) in _DRAWN.items()
        if name in curves
    )
    return Section("Motion", (moved, *apart, *others))


def _tables(
    settings: BallDrop,
    bounces: Sequence[xr.Dataset | None],
    repeats: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Iterator[Section]:
    """List every bounce, and every recording with the phases of its motion: bouncing, vibration, rest."""
    if repeats is not None:
        counts = [
            Listed(of, repeats[n].values.astype(int).tolist()) for n, of in (("impact",) * 2, ("n_repeats", "repeats"))
        ]
        titles = {"touch_time": "touch", "incoming_speed": "speed in", "outgoing_speed": "speed out"}
        apart = {"touch_time": "touch", "restitution": "restitution"}
        differences = {f"{name}_difference": f"{title}, measured − model" for name, title in apart.items()}
        shown = (*pages.columns(repeats, titles | apart), *pages.columns(comparison, differences))
        caption = (
            "Mean over the repeats that show the bounce, standard uncertainty. Touch times count from the first touch."
        )
        if comparison is not None:
            caption += f" At most {FOLLOWED} impacts are compared with the model, whose uncertainty from its inputs is "
            caption += f"included; the restitutions of the first {IMPACTS} by the same fit to the model's motion."
        yield Section("Bounces", (listed((*counts, *shown), caption),))
    flags = np.zeros(len(bounces), bool) if repeats is None else repeats["is_outlier"].values.astype(bool)
    known = [i for i, each in enumerate(bounces) if each is not None]
    found = pages.present(bounces)
    touch, settled, rest, u_rest = (
        np.array([float(each[f"{which}_time"]) for each in found])
        for which in ("first_contact", "settling", "rest", "u_rest")
    )
    remarks = list[str]()
    for at, (i, end) in enumerate(zip(known, rest, strict=True)):
        texts: dict[float, str] = {}  # by how much the recording differs from the others
        outlying = (("drop_height", "fall", "m"), ("restitution", "first restitution", "1")) if flags[i] else ()
        for name, title, unit in outlying:
            values = np.array([float(np.atleast_1d(each[name].values)[0]) for each in found])
            others = float(np.nanmedian(np.delete(values, at)))
            own, usual = (quantity(value, unit, 4) for value in (float(values[at]), others))
            texts[abs(float(values[at]) / others - 1.0)] = f"outlier: {title} {own}, others {usual}"
        is_moving = ["still moving when the recording ends"] * (not np.isfinite(end))
        remarks.append("; ".join([texts[each] for each in sorted(texts)[-1:]] + is_moving))
    columns = (
        Listed("recording", [settings.laser[i] for i in known]),
        *pages.columns(found, {"release_time": "release"}, has_u=False),
        *pages.columns(found, {"first_contact_time": "first contact", "drop_height": "fall"}),
        Listed("bounces", [each.sizes["impact"] for each in found]),
        Listed("bouncing", (settled - touch).tolist(), "s"),
        Listed("vibration", (rest - settled).tolist(), "s"),
        Listed("static from", (rest - touch).tolist(), "s", u_rest.tolist()),
        Listed("remark", remarks),
    )
    text = (
        "Release and first contact by the clock of the recording. Phases count from first contact: bouncing to the "
        "last resolved flight, vibration until the speed stays below a hundredth of that of the first impact, static "
        "from then on. Outliers of the displacement are flagged; all recordings are in the means."
    )
    yield Section("Repeats", (listed(columns, text),))


def _model(settings: BallDrop, model: xr.Dataset) -> Section:
    names = {"peak_force": "peak force", "peak_contact_radius": "largest contact radius"}
    rows = pages.known(model, {name: (title, "first impact") for name, title in names.items()})
    rows += [*linear_range_rows(model), *flat_rows(settings.counter_body, settings.sphere, model)]
    rigid = [] if described_plate(model) else [Paragraph(_RIGID_FLOOR)]
    if not rigid:
        remark = f"without its motion the first restitution is {float(model['rigid_restitution']):.5f}"
        rows.append(("plate", described_plate(model), remark))
    return Section("Model", (KeyValues(rows), *pages.limits_of(model), *rigid))


def _methods(
    settings: BallDrop, displacement: Sequence[xr.Dataset | None] = (), model: xr.Dataset | None = None
) -> str:
    sphere, n = settings.sphere, len(settings.laser)
    times = {1: "once", 2: "twice"}.get(n, f"{n} times")
    text = (
        f"A sphere of radius {pages.stated(sphere.radius)} with a total moving mass of {pages.stated(sphere.mass)} was "
        f"dropped {times} from {pages.stated(settings.height)}. "
    )
    if moved := pages.present(displacement):
        shown = pages.told(moved[0], "inclination")
        text += f"The laser readings were divided by the cosine of the sensor's inclination ({shown}). "
    text += (
        "Velocity was obtained by a quintic smoothing spline with the noise level estimated from the record; contacts "
        "were located by fitting ballistic arcs and a contact pulse to each impact, and the recordings were aligned at "
        "first contact. "
    )
    if model is not None:
        text += simulated(settings, model)
    return text


page = Report(
    subtitle=lambda settings: f"Ball drop from {pages.stated(settings.height)}",
    shown=("readings", "displacement", "velocity", "bounces", "repeats", "model", "comparison"),
    rows=rows,
    sections=(motion, _tables, pages.recordings, _model),
    budget=quantities,
    methods=_methods,
)

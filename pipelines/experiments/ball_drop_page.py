"""The report of a ball drop."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.report import (
    Band,
    Block,
    Column,
    KeyValues,
    LineChart,
    Notice,
    Paragraph,
    Section,
    Series,
    Table,
    quantity,
    value_with_uncertainty,
)
from labpipe.workflow.context import Context
from pipelines import pages
from pipelines.settings.ball_drop import BallDrop

Array = NDArray[np.float64]

_VIEWS = 3  # impacts that get a button; the thesis analyses the first three
_BEFORE, _AFTER = 0.5e-3, 2.0e-3  # s around a touch that show one impact
_MM, _MM_PER_S = 1e3, 1e3
_RIGID_FLOOR = (
    "The model's floor is rigid. A real one takes energy: one of mass M lowers the restitution of "
    "a mass m by up to about 2 m/M (0.0005 for half a kilogram on 1.5 t), which the uncertainty "
    "above does not hold. State it as plate (mass, frequency, damping_ratio), or name an "
    "experiment that measured it as plate_from."
)


def page(
    readings: list[xr.Dataset] | None,
    displacement: list[xr.Dataset] | None,
    velocity: list[xr.Dataset] | None,
    bounces: list[xr.Dataset] | None,
    repeats: xr.Dataset | None,
    model: xr.Dataset | None,
    comparison: xr.Dataset | None,
    *,
    settings: BallDrop,
    context: Context,
) -> str:
    """Write the page; a step that failed leaves its section out and its error in."""
    del velocity
    sections = [
        _summary(settings, repeats, model, comparison, context),
        _measured(settings, readings, context),
    ]
    if displacement:
        sections.append(_calibration(displacement))
    if repeats is not None:
        sections += [_motion(repeats, model, comparison), _bounces(repeats, comparison)]
    if bounces:
        sections.append(_repeats(settings, bounces, repeats))
    if model is not None:
        sections.append(_model(model))
    if repeats is not None:
        sections.append(pages.methods(_methods(settings, displacement, repeats, comparison)))
    subtitle = f"Ball drop from {pages.stated(settings.height)}"
    return pages.document(context, subtitle, sections).render()


def _summary(
    settings: BallDrop,
    repeats: xr.Dataset | None,
    model: xr.Dataset | None,
    comparison: xr.Dataset | None,
    context: Context,
) -> Section:
    rows = [("drop height", pages.stated(settings.height), "from session.toml")]
    if repeats is not None and repeats.sizes["impact"]:
        e, u = float(repeats["restitution"][0]), float(repeats["u_restitution"][0])
        rows.append(
            ("restitution of the first impact, measured", value_with_uncertainty(e, u, "1"),
             f"mean of {int(repeats['n_repeats'][0])} repeats; standard uncertainty")
        )  # fmt: skip
    if model is not None and model.sizes["impact"]:
        e, u = float(model["restitution"][0]), float(model["u_restitution"][0])
        rows.append(
            ("restitution of the first impact, model", value_with_uncertainty(e, u, "1"),
             "uncertainty from height, radius and mass; the material's is not included")
        )  # fmt: skip
    if comparison is not None:
        rows += [
            ("nRMSE of displacement", f"{float(comparison['nrmse']) * 100:.2f} %",
             "root mean square of measured minus model, over the range of the measurement"),
            ("bias", quantity(float(comparison["bias"]), "m"),
             "mean difference"),
            ("largest difference",
             quantity(float(comparison["max_error"]), "m"), ""),
        ]  # fmt: skip
    blocks: list[Block] = [KeyValues(rows), *pages.failed_notice(context)]
    if comparison is None and not context.failures:
        blocks.append(Notice("info", "There is no comparison with a model."))
    return Section("Summary", tuple(blocks))


def _measured(settings: BallDrop, readings: list[xr.Dataset] | None, context: Context) -> Section:
    rows = [
        ("recordings", str(len(settings.laser)), "repeats of the same drop"),
        ("sphere radius", pages.stated(settings.sphere.radius), ""),
        ("moving mass", pages.stated(settings.sphere.mass), "sphere and holder"),
        ("operator", context.operator, ""),
        ("notes", context.notes, ""),
    ]
    blocks: list[Block] = []
    if readings:
        first = readings[0]
        interval = float(first.attrs["sampling_interval"])
        rate = value_with_uncertainty(1 / interval, 0.0, "Hz")
        name, model = (str(first.attrs.get(key, "")) for key in ("instrument", "model"))
        rows[1:1] = [
            ("instrument", name, model),
            ("sampling", rate, f"{first.sizes['time']} points"),
        ]
        if first.attrs.get("layout") == "assumed":
            blocks.append(
                Notice(
                    "info",
                    "The layout of Keyence storage files is assumed: no such file is public.",
                )
            )
        headers = [h for r in readings if (h := pages.raw_header(r)) is not None]
        blocks += headers
    return Section("What was measured", (KeyValues([r for r in rows if r[1]]), *blocks))


def _calibration(displacement: list[xr.Dataset]) -> Section:
    first = displacement[0]
    attrs = first.attrs
    blocks: list[Block] = [
        pages.calibration_rows(attrs["calibration"]),
        KeyValues(
            [
                (
                    "inclination used",
                    value_with_uncertainty(
                        float(first["inclination"]), float(first["u_inclination"]), "rad"
                    ),
                    "true displacement = reading / cos(inclination)",
                ),
                (
                    "relative uncertainty of the scale",
                    f"{float(attrs['u_systematic_relative']) * 100:.3f} %",
                    "inclination and gain; the same for every sample",
                ),
                (
                    "noise of a sample",
                    quantity(float(attrs["noise"]), "m"),
                    "from the quiet beginning",
                ),
            ]
        ),
        *pages.budget_table(
            json.loads(attrs["budget"]), "Budget for the largest displacement of the first repeat"
        ),
    ]
    if "inclination_of_record" in attrs:
        recorded = json.loads(attrs["inclination_of_record"])
        shown = value_with_uncertainty(recorded["value"], recorded["u"], "rad")
        text = f"The inclination was fitted from the drop height; the record says {shown}."
        blocks.insert(1, Notice("info", text))
    return Section("Calibration and its uncertainty", tuple(blocks))


def _views(repeats: xr.Dataset) -> tuple[tuple[str, float, float], ...]:
    touches = repeats["touch_time"].values[:_VIEWS]
    return tuple(
        (f"impact {i + 1}", float((t - _BEFORE) * 1e3), float((t + _AFTER) * 1e3))
        for i, t in enumerate(touches)
        if np.isfinite(t)
    )


def _motion(
    repeats: xr.Dataset, model: xr.Dataset | None, comparison: xr.Dataset | None
) -> Section:
    time = repeats["time"].values * 1e3
    views = _views(repeats)
    position: list[Series | Band] = [
        *_band("displacement", repeats, _MM),
        Series("mean of the repeats", time, repeats["displacement_mean"].values * _MM,
               role="measured"),
    ]  # fmt: skip
    speed: list[Series | Band] = [
        *_band("velocity", repeats, 1.0),
        Series("mean of the repeats", time, repeats["velocity_mean"].values, role="measured"),
    ]
    if model is not None:
        since = (model["time"].values - float(model["impact_time"][0])) * 1e3
        position.append(Series("model", since, model["displacement"].values * _MM, role="model"))
        speed.append(Series("model", since, model["velocity"].values, role="model"))
    label = "time since first contact / ms"
    charts: list[Block] = [
        LineChart("Displacement", label, "height over first contact / mm", tuple(position),
                  group="drop", views=views,
                  caption="Mean of the repeats with the band of ± 2 standard deviations."),
    ]  # fmt: skip
    if comparison is not None:
        charts.append(
            LineChart(
                "Measured minus model", label, "difference / mm",
                (Series("difference", comparison["time"].values * 1e3,
                        comparison["residual"].values * _MM, role="residual"),),
                group="drop", views=views, height_px=220,
                caption="A late touch shows as a spike: both curves are steep there.",
            )
        )  # fmt: skip
    charts.append(
        LineChart("Velocity", label, "velocity / (m/s), upwards", tuple(speed), group="drop",
                  views=views)
    )  # fmt: skip
    if model is not None:
        charts += [
            LineChart("Contact force (model)", label, "force / N",
                      (Series("model", since, model["force"].values, role="model"),),
                      group="drop", views=views, height_px=220),
            LineChart("Contact radius (model)", label, "contact radius / mm",
                      (Series("model", since, model["contact_radius"].values * _MM,
                              role="model"),), group="drop", views=views, height_px=220),
        ]  # fmt: skip
    return Section("Motion", tuple(charts))


def _band(name: str, repeats: xr.Dataset, factor: float) -> tuple[Band, ...]:
    if repeats.sizes["repeat"] < 2:
        return ()
    mean, sd = repeats[f"{name}_mean"].values * factor, repeats[f"{name}_sd"].values * factor
    time = repeats["time"].values * 1e3
    return (Band("± 2 sd of the repeats", time, mean - 2 * sd, mean + 2 * sd, role="measured"),)


def _bounces(repeats: xr.Dataset, comparison: xr.Dataset | None) -> Section:
    columns = [
        Column("impact"), Column("repeats"),
        Column("touch after the first", unit="s", u=3), Column("u"),
        Column("incoming speed", unit="m/s", u=5), Column("u"),
        Column("outgoing speed", unit="m/s", u=7), Column("u"),
        Column("restitution", u=9), Column("u"),
    ]  # fmt: skip
    names = ("touch_time", "incoming_speed", "outgoing_speed", "restitution")
    rows: list[list[float | int | str | bool | None]] = []
    for i in range(repeats.sizes["impact"]):
        at = repeats.isel(impact=i)
        row: list[float | int | str | bool | None] = [int(at["impact"]), int(at["n_repeats"])]
        for name in names:
            row += [float(at[name]), float(at[f"u_{name}"])]
        rows.append(row)
    if comparison is not None:
        first = len(columns)
        columns += [
            Column("restitution, model"),
            Column("measured − model", u=first + 2), Column("u"),
            Column("touch, measured − model", unit="s", u=first + 4), Column("u"),
        ]  # fmt: skip
        shown = ("restitution_model", "restitution_difference", "u_restitution_difference",
                 "touch_time_difference", "u_touch_time_difference")  # fmt: skip
        count = comparison.sizes["impact"]
        for i, row in enumerate(rows):
            row += [float(comparison[n][i]) if i < count else None for n in shown]
    caption = (
        "Every bounce: mean over the repeats that show it, with its standard uncertainty. The "
        "uncertainty of a difference holds the model's from height, radius and mass."
    )
    return Section("Bounces", (Table(tuple(columns), rows, caption=caption),))


def _repeats(
    settings: BallDrop, bounces: Sequence[xr.Dataset], repeats: xr.Dataset | None
) -> Section:
    rows = []
    for i, (name, found) in enumerate(zip(settings.laser, bounces, strict=True)):
        is_outlier = repeats is not None and bool(repeats["is_outlier"][i])
        rows.append(
            (
                name, float(found["release_time"]), float(found["first_contact_time"]),
                float(found["u_first_contact_time"]), float(found["drop_height"]),
                float(found["u_drop_height"]), found.sizes["impact"],
                float(found["rest_time"]), "outlier" if is_outlier else "",
            )
        )  # fmt: skip
    columns = (
        Column("recording"), Column("release", unit="s"), Column("first contact", unit="s", u=3),
        Column("u"), Column("fall", unit="m", u=5), Column("u"), Column("bounces"),
        Column("rest", unit="s"), Column("remark"),
    )  # fmt: skip
    text = "Times of each recording by its own clock. An outlier is flagged, never dropped."
    return Section("Repeats", (Table(columns, rows, caption=text),))


def _model(model: xr.Dataset) -> Section:
    rows = [
        ("impacts in the simulated time", str(model.sizes["impact"]), ""),
        ("peak force", value_with_uncertainty(
            float(model["peak_force"][0]), float(model["u_peak_force"][0]), "N"), "first impact"),
        ("largest contact radius", value_with_uncertainty(
            float(model["peak_contact_radius"][0]), float(model["u_peak_contact_radius"][0]),
            "m"), "first impact"),
        ("contact duration", value_with_uncertainty(
            float(model["contact_duration"][0]), 0.0, "s"), "first impact"),
    ]  # fmt: skip
    plate = json.loads(model.attrs["plate"])
    floor = "a rigid flat" if plate is None else "a flat that moves"
    text = (
        f"A viscoelastic sphere on {floor} by the method of dimensionality reduction: "
        "independent springs with exact exponential memory, adaptive steps, one step per flight."
    )
    blocks: list[Block] = [Paragraph(text), KeyValues(rows)]
    if plate is None:
        blocks.append(Paragraph(_RIGID_FLOOR))
    else:
        rows.append((
            "flat", f"{plate['mass']:.6g} kg, {plate['frequency']:.6g} Hz",
            f"damping ratio {plate['damping_ratio']:.3g}; on a rigid one the first restitution "
            f"is {float(model['rigid_restitution']):.5f}",
        ))  # fmt: skip
    return Section("Model", tuple(blocks))


def _methods(
    settings: BallDrop,
    displacement: list[xr.Dataset] | None,
    repeats: xr.Dataset,
    comparison: xr.Dataset | None,
) -> str:
    sphere = settings.sphere
    source = sphere.material or sphere.material_file or sphere.material_from
    text = (
        f"A sphere of radius {pages.stated(sphere.radius)} with a total moving mass of "
        f"{pages.stated(sphere.mass)} was dropped {len(settings.laser)} times from "
        f"{pages.stated(settings.height)}. "
    )
    if displacement:
        angle = displacement[0]
        shown = value_with_uncertainty(
            float(angle["inclination"]), float(angle["u_inclination"]), "rad"
        )
        text += (
            f"The laser readings were divided by the cosine of the sensor's inclination ({shown}). "
        )
    text += (
        "Velocity was obtained by a quintic smoothing spline with the noise level estimated from "
        "the record; contacts were located by fitting ballistic arcs and a contact pulse to each "
        "impact, and the recordings were aligned at first contact. "
        f"The drop was simulated with the material “{source}” by the method of dimensionality "
        f"reduction (profile: {settings.model.profile}, tolerance {settings.model.rtol:g}). "
    )
    if comparison is not None:
        text += (
            "The normalised root-mean-square error between the mean displacement and the model, "
            "relative to the range of the measurement, was "
            f"{float(comparison['nrmse']) * 100:.2f} %. "
        )
    e, u = float(repeats["restitution"][0]), float(repeats["u_restitution"][0])
    text += (
        f"The coefficient of restitution of the first impact was {value_with_uncertainty(e, u)} "
        "(standard uncertainty)."
    )
    return text

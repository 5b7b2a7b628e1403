"""The report of a ball drop."""

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr

from labpipe.report import (
    Block,
    KeyValues,
    Listed,
    Notice,
    Paragraph,
    Section,
    Table,
    listed,
    quantity,
    value_with_uncertainty,
)
from labpipe.workflow.context import Context
from pipelines.experiments.ball_drop._charts import motion
from pipelines.experiments.ball_drop._model_uncertainty import FOLLOWED
from pipelines.experiments.ball_drop.budget import quantities
from pipelines.experiments.ball_drop.comparison import rows as compared_rows
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.reports import Report, budgets

_RIGID_FLOOR = (
    "The model assumes a rigid floor. A real floor takes up energy: a floor of mass M lowers the restitution of a mass "
    "m by up to about 2 m/M (0.0005 for half a kilogram on 1.5 t), which the uncertainty above does not include. Give "
    "the floor as plate (mass, frequency, damping_ratio), or name an experiment that measured it as plate_from."
)


def _moduli(settings: BallDrop) -> str:
    return "with that of their DMA" if settings.sphere.material_from else "are taken as exact"


def _summary(
    settings: BallDrop,
    context: Context,
    repeats: xr.Dataset | None = None,
    model: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Section:
    rows = [("drop height", pages.stated(settings.height), "from session.toml")]
    if repeats is not None and repeats.sizes["impact"]:
        remark = f"mean of {pages.counted(int(repeats['n_repeats'][0]), 'repeat')}; standard uncertainty"
        rows.append(("restitution of the first impact, measured", pages.told(repeats, "restitution", 0), remark))
    if model is not None and model.sizes["impact"]:
        remark = (
            "uncertainty from height, radius, mass, plate, and from temperature and Poisson's ratio where stated "
            f"with an uncertainty; the moduli {_moduli(settings)}"
        )
        rows.append(("restitution of the first impact, model", pages.told(model, "restitution", 0), remark))
    if model is not None and comparison is not None:
        known = 2.0 * float(model["u_displacement"].max())
        of_model = f"2 u of the model reach {quantity(known, 'm')}" if np.isfinite(known) else ""
        remark = "root mean square of measured minus model, over the range of the model"
        rows += [
            ("nRMSE of displacement", f"{float(comparison['nrmse']) * 100:.3g} %", remark),
            ("bias", quantity(float(comparison["bias"]), "m"), "mean difference"),
            ("largest difference", quantity(float(comparison["max_error"]), "m"), of_model),
        ]
    blocks: list[Block] = [KeyValues(rows), *pages.failed_notice(context)]
    if comparison is None and not context.failures:
        blocks.append(Notice("info", "There is no comparison with a model."))
    return Section("Summary", tuple(blocks))


def _measured(settings: BallDrop, context: Context, readings: Sequence[xr.Dataset | None] = ()) -> Section:
    rows = [
        ("recordings", str(len(settings.laser)), "repeats of the same drop"),
        ("sphere radius", pages.stated(settings.sphere.radius), ""),
        ("moving mass", pages.stated(settings.sphere.mass), "sphere and holder"),
        *pages.remarks(context),
    ]
    blocks: list[Block] = []
    if read := pages.present(readings):
        first = read[0]
        interval = float(first.attrs["sampling_interval"])
        rate = value_with_uncertainty(1 / interval, 0.0, "Hz")
        name, model = (str(first.attrs.get(key, "")) for key in ("instrument", "model"))
        rows[1:1] = [("instrument", name, model), ("sampling", rate, f"{first.sizes['time']} points")]
        if first.attrs.get("layout") == "assumed":
            blocks.append(Notice("info", "The layout of Keyence storage files is assumed, as no such file is public."))
        blocks += pages.raw_headers(read)
    return pages.folded("What was measured", "Files and readings", (KeyValues([r for r in rows if r[1]]), *blocks))


def _calibration(displacement: Sequence[xr.Dataset | None]) -> Section:
    first = pages.present(displacement)[0]
    caption = "Budget for the largest displacement of the first repeat"
    blocks = pages.laser_calibration(first, "for every sample", "from the part at rest before the drop", caption)
    if "inclination_of_record" in first.attrs:
        recorded = json.loads(first.attrs["inclination_of_record"])
        shown = value_with_uncertainty(recorded["value"], recorded["u"], "rad")
        text = f"The inclination was fitted from the drop height; the record says {shown}."
        blocks.insert(1, Notice("info", text))
    return pages.folded("Calibration and its uncertainty", "Record and what follows from it", blocks)


def _bounces(repeats: xr.Dataset, comparison: xr.Dataset | None = None) -> Section:
    columns = (
        Listed("impact", repeats["impact"].values.tolist()),
        Listed("repeats", repeats["n_repeats"].values.astype(int).tolist()),
        pages.column(repeats, "touch_time", "touch"),
        pages.column(repeats, "incoming_speed", "speed in"),
        pages.column(repeats, "outgoing_speed", "speed out"),
        pages.column(repeats, "restitution", "restitution"),
    )
    caption = (
        "Every bounce: mean over the repeats that show it, with its standard uncertainty. Touch "
        "times are counted from the first touch."
    )
    measured = listed(columns, caption)
    if comparison is None:
        return Section("Bounces", (measured,))
    return Section("Bounces", (measured, _against_model(comparison)))


def _against_model(comparison: xr.Dataset) -> Table:
    columns = (
        Listed("impact", comparison["impact"].values.tolist()),
        pages.column(comparison, "restitution_model", "restitution, model", digits=6),
        pages.column(comparison, "restitution_difference", "measured − model"),
        pages.column(comparison, "touch_time_model", "touch, model", digits=6),
        pages.column(comparison, "touch_time_difference", "measured − model"),
    )
    caption = (
        f"Comparison with the model, of the first {FOLLOWED} impacts at most. The uncertainty of a difference "
        "includes that of the model from its inputs, as in the summary. Restitutions, durations and penetrations of "
        f"the first {IMPACTS} impacts are compared with what the same fit finds in the model's motion: where the fit "
        "errs by the shape of the pulse that it expects, it errs alike in both."
    )
    return listed(columns, caption)


def _repeats(settings: BallDrop, bounces: Sequence[xr.Dataset | None], repeats: xr.Dataset | None = None) -> Section:
    names, found = _recorded(settings, bounces)
    flags = [False] * len(bounces) if repeats is None else repeats["is_outlier"].values.astype(bool).tolist()
    columns = (
        names,
        pages.of_each(found, "release_time", "release", has_u=False),
        pages.of_each(found, "first_contact_time", "first contact"),
        pages.of_each(found, "drop_height", "fall"),
        Listed("bounces", [each.sizes["impact"] for each in found]),
        pages.of_each(found, "rest_time", "rest", has_u=False),
        Listed("remark", ["outlier" * flag for flag, each in zip(flags, bounces, strict=True) if each is not None]),
    )
    text = "Times of each recording by its own clock. Outliers are flagged, never removed."
    if len(found) < len(bounces):
        text += f" {pages.counted(len(bounces) - len(found), 'recording')} gave no bounces: see the errors."
    return Section("Repeats", (listed(columns, text),))


def _recorded(settings: BallDrop, bounces: Sequence[xr.Dataset | None]) -> tuple[Listed, list[xr.Dataset]]:
    """Return the names of the recordings that gave bounces, and those."""
    names = [name for name, each in zip(settings.laser, bounces, strict=True) if each is not None]
    return Listed("recording", names), pages.present(bounces)


def _phases(settings: BallDrop, bounces: Sequence[xr.Dataset | None]) -> Section:
    """Say of every recording how long the sphere bounces, vibrates and rests."""
    names, found = _recorded(settings, bounces)
    touch, settled, rest, u_rest = (
        np.array([float(each[f"{which}_time"]) for each in found])
        for which in ("first_contact", "settling", "rest", "u_rest")
    )
    columns = (
        names,
        Listed("bouncing", (settled - touch).tolist(), "s"),
        Listed("vibration", (rest - settled).tolist(), "s"),
        Listed("static from", (rest - touch).tolist(), "s", u_rest.tolist()),
        Listed("remark", ["" if np.isfinite(end) else "still moving when the recording ends" for end in rest]),
    )
    text = (
        "Bouncing: from first contact to the last resolved flight. Vibration: until the speed stays below a hundredth "
        "of that of the first impact. Static: from then on. Times are counted from first contact."
    )
    return Section("Phases", (listed(columns, text),))


def _model(model: xr.Dataset) -> Section:
    rows = [
        ("impacts in the simulated time", str(model.sizes["impact"]), ""),
        ("peak force", pages.told(model, "peak_force", 0), "first impact"),
        ("largest contact radius", pages.told(model, "peak_contact_radius", 0), "first impact"),
        ("contact duration", value_with_uncertainty(float(model["contact_duration"][0]), 0.0, "s"), "first impact"),
    ]
    plate = json.loads(model.attrs["plate"])
    floor = "a rigid flat" if plate is None else "a vibrating plate"
    text = (
        f"A viscoelastic sphere on {floor} by the method of dimensionality reduction: independent springs with exact "
        "exponential memory, adaptive time steps, one step per flight."
    )
    blocks: list[Block] = [Paragraph(text), KeyValues(rows)]
    if plate is None:
        blocks.append(Paragraph(_RIGID_FLOOR))
    else:
        rigid = f"on a rigid one the first restitution is {float(model['rigid_restitution']):.5f}"
        swing = f"{plate['mass']:.6g} kg, {plate['frequency']:.6g} Hz"
        rows.append(("flat", swing, f"damping ratio {plate['damping_ratio']:.3g}; {rigid}"))
    return Section("Model", tuple(blocks))


def _times(n: int) -> str:
    return {1: "once", 2: "twice"}.get(n, f"{n} times")


def _methods(
    settings: BallDrop,
    repeats: xr.Dataset,
    displacement: Sequence[xr.Dataset | None] = (),
    model: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Section:
    sphere = settings.sphere
    text = (
        f"A sphere of radius {pages.stated(sphere.radius)} with a total moving mass of {pages.stated(sphere.mass)} was "
        f"dropped {_times(len(settings.laser))} from {pages.stated(settings.height)}. "
    )
    if moved := pages.present(displacement):
        shown = pages.told(moved[0], "inclination")
        text += f"The laser readings were divided by the cosine of the sensor's inclination ({shown}). "
    text += (
        "Velocity was obtained by a quintic smoothing spline with the noise level estimated from the record; "
        if settings.analysis.velocity == "spline"
        else "Velocity was obtained by central differences and a moving average; "
    )
    text += (
        "contacts were located by fitting ballistic arcs and a contact pulse to each "
        "impact, and the recordings were aligned at first contact. "
    )
    if model is not None:
        text += (
            f"The drop was simulated with the material “{sphere.source}” by the method of dimensionality "
            f"reduction (profile: {settings.model.profile}, tolerance {settings.model.rtol:g}). "
        )
    if comparison is not None:
        text += (
            "The normalised root-mean-square error between the mean displacement and the model, relative to the range "
            f"of the model, was {float(comparison['nrmse']) * 100:.2f} %. "
        )
    first = pages.told(repeats, "restitution", 0)
    text += f"The coefficient of restitution of the first impact was {first} (standard uncertainty)."
    return pages.methods(text)


page = Report(
    lambda settings: f"Ball drop from {pages.stated(settings.height)}",
    ("readings", "displacement", "velocity", "bounces", "repeats", "model", "comparison"),
    (_summary, motion, _bounces, _repeats, _phases, _measured, _calibration, _model, budgets(quantities), _methods),
    compared_rows,
)

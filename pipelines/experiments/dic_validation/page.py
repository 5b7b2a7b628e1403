"""The report of a film against the laser."""

import json
import math

import cv2
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.report import (
    Band,
    Block,
    Gallery,
    KeyValues,
    LineChart,
    Listed,
    Notice,
    Paragraph,
    Picture,
    Section,
    Series,
    budget_table,
    listed,
    quantity,
    value_with_uncertainty,
)
from labpipe.workflow.context import Context
from pipelines.experiments.dic_validation.budget import quantities
from pipelines.experiments.dic_validation.comparison import rows as compared_rows
from pipelines.experiments.dic_validation.settings import DicValidation, Tracking
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.film_frames import enlarged, png
from pipelines.experiments.shared.reports import Report, budgets

_VIEWS = 3  # impacts that get a button
_BEFORE, _AFTER = 1e-3, 4e-3  # s around a touch that show one impact
_SMALLEST_PICTURE = 480  # px; smaller frames are enlarged by a whole factor
_REGION, _COVER, _OBSTRUCTION = (80, 200, 80), (80, 80, 230), (230, 80, 200)  # BGR: green, red, violet
_MASKS = (
    "Green: regions that count; red: covered parts that do not, both moving with the large subset; violet: "
    "obstructions that stand still before the holder and do not count. "
)
_BODY, _POINT = (80, 200, 255), (255, 200, 60)  # BGR: orange square, blue points
_GROUP = "film"  # charts and frames over the film's time
_SPREAD = "± 2 sd of the laser's repeats"
_LABEL = "time since first contact / ms"


def _summary(
    settings: DicValidation,
    context: Context,
    track: xr.Dataset | None = None,
    bounces: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Section:
    rows = [("film", settings.film, f'view "{settings.view}"')]
    if track is not None:
        share = float(track["valid"].mean())
        count = track.sizes["point"]
        followed = "one point" if count == 1 else f"{count} points"
        rows.append(
            ("frames", str(track.sizes["frame"]), f"{followed} followed; found in {100 * share:.3g} % of the frames")
        )
    if bounces is not None and bounces.sizes["impact"]:
        rows.append(
            ("restitution of the first impact, film", pages.told(bounces, "restitution", 0), "standard uncertainty")
        )
    if comparison is not None:
        rows += [
            (
                "nRMSE, film against laser",
                f"{float(comparison['nrmse']) * 100:.2f} %",
                "root mean square of the difference, over the range of the laser",
            ),
            (
                "ratio of the laser's scale to the film's",
                pages.told(comparison, "gain"),
                f"expected 1 within {float(comparison['expected_u_gain']) * 100:.2g} % from both calibrations",
            ),
        ]
    blocks: list[Block] = [KeyValues(rows), *pages.failed_notice(context)]
    if comparison is None and not context.failures:
        text = (
            "No laser experiment is named, so the film is not compared; name one as laser_experiment in session.toml."
        )
        blocks.append(Notice("info", text))
    return Section("Summary", tuple(blocks))


def _key_frames(keys: xr.Dataset, settings: DicValidation, bounces: xr.Dataset | None = None) -> Section:
    start = None if bounces is None else float(bounces["first_contact_time"])
    pictures = [_picture(keys.isel(key=i), start, settings.tracking) for i in range(keys.sizes["key"])]
    caption = "Orange: the large subset whose motion is the result, with its rotation. "
    caption += "Blue: the line of small subsets. " * (keys.sizes["point"] > 1)
    caption += _MASKS * bool(settings.tracking.masks) + "The charts below mark the frame that is shown." * (
        start is not None
    )
    gallery = Gallery("Key frames with the tracked subsets", pictures, caption=caption, group=_GROUP)
    header = pages.raw_header(keys.assign_attrs(source=settings.film))
    return Section("Film", (gallery,) if header is None else (gallery, header))


def _picture(key: xr.Dataset, start: float | None, tracking: Tracking) -> Picture:
    image = key["image"].values
    factor = max(1, math.ceil(_SMALLEST_PICTURE / max(image.shape)))
    canvas = enlarged(image, factor)
    scale = factor / float(key["reduction"])
    half = factor / 2 - 0.5  # the centre of an enlarged pixel
    _draw_masks(canvas, key, tracking, scale, half)
    for n in range(key.sizes["point"]):
        x, y = float(key["point_x"][n]), float(key["point_y"][n])
        if not (math.isfinite(x) and math.isfinite(y)):
            continue
        centre = (round(x * scale + half), round(y * scale + half))
        if n == 0:
            side = float(key["subset"][n]) * scale
            box = cv2.boxPoints((centre, (side, side), math.degrees(float(key["turn"][n]))))
            cv2.polylines(canvas, [np.rint(box).astype(np.int32)], True, _BODY, 2, cv2.LINE_AA)
        else:
            cv2.circle(canvas, centre, 4, _POINT, 2, cv2.LINE_AA)
    frame, time = int(key["frame"]), float(key["key_time"]) * 1e3
    words = f"frame {frame} of the film with the tracked subsets drawn on it"
    at = None if start is None else time - start * 1e3
    status = str(key["key_status"].values)
    lost = "" if status == "ok" else f"; the large subset has no value: {status.replace('_', ' ')}"
    return Picture(png(canvas), words, f"frame {frame}, {time:.2f} ms in the film{lost}", at=at)


def _draw_masks(canvas: NDArray[np.uint8], key: xr.Dataset, tracking: Tracking, scale: float, half: float) -> None:
    """Draw the polygons of the masks, those that move with the large subset moved and turned as it is."""
    for polygon in tracking.obstructions or ():
        _draw_polygon(canvas, np.array(polygon) * scale + half, _OBSTRUCTION)
    body = key.isel(point=0)
    start, now = (np.array([float(body[f"{name}_x"]), float(body[f"{name}_y"])]) for name in ("start", "point"))
    if not np.isfinite(now).all():
        return
    cosine, sine = math.cos(float(body["turn"])), math.sin(float(body["turn"]))
    turn = np.array([[cosine, -sine], [sine, cosine]])
    for polygons, colour in ((tracking.regions, _REGION), (tracking.covers, _COVER)):
        for polygon in polygons or ():
            corners = (now + (np.array(polygon) - start) @ turn.T) * scale + half
            _draw_polygon(canvas, corners, colour)


def _draw_polygon(canvas: NDArray[np.uint8], corners: NDArray[np.float64], colour: tuple[int, int, int]) -> None:
    cv2.polylines(canvas, [np.rint(corners).astype(np.int32)], True, colour, 2, cv2.LINE_AA)


def _calibration(motion: xr.Dataset, settings: DicValidation) -> Section:
    direction, u_direction = (math.degrees(float(motion[of])) for of in ("direction", "u_direction"))
    blocks: list[Block] = [
        pages.calibration_rows(motion.attrs["calibration"]),
        KeyValues(
            [
                ("length of one pixel", pages.told(motion, "pixel_size"), "in the plane of the holder"),
                (
                    "motion, to the image's columns",
                    value_with_uncertainty(direction, u_direction, "deg"),
                    "positive to the right of upwards; displacements are along it up to 30°",
                ),
                ("tilt of the camera, up or down", pages.stated(settings.camera_tilt), "stated; lengths / cos(tilt)"),
                (
                    "relative uncertainty of a displacement's scale",
                    f"{float(motion.attrs['u_systematic_relative']) * 100:.3f} %",
                    "the same for every frame",
                ),
            ]
        ),
        *budget_table(json.loads(motion.attrs["budget"]), "Budget of the image scale", "m/px"),
    ]
    return pages.folded("Calibration and its uncertainty", "Record and what follows from it", blocks)


def _motion(
    motion: xr.Dataset,
    bounces: xr.Dataset | None = None,
    velocity: xr.Dataset | None = None,
    laser: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Section:
    if bounces is None:  # no contact from which to count
        shown = Series("film", motion["time"].values * 1e3, motion["displacement"].values * 1e3, role="measured")
        labels = ("Displacement", "time in the film / ms", "displacement / mm, upwards")
        return Section("Motion", (LineChart(*labels, (shown,), group=_GROUP),))
    start, level = float(bounces["first_contact_time"]), float(bounces["contact_level"])
    time = (motion["time"].values - start) * 1e3
    touches = (bounces["touch_time"].values[:_VIEWS] - start) * 1e3
    views = tuple(
        (f"impact {i + 1}", float(t - _BEFORE * 1e3), float(t + _AFTER * 1e3))
        for i, t in enumerate(touches)
        if np.isfinite(t)
    )
    position: list[Series | Band] = [
        Series("film", time, (motion["displacement"].values - level) * 1e3, role="measured")
    ]
    if laser is not None:
        inside = laser.sel(time=slice(time[0] * 1e-3, time[-1] * 1e-3))
        when, mean = inside["time"].values * 1e3, inside["displacement_mean"].values * 1e3
        position.append(Series("laser, mean of the repeats", when, mean, role="reference"))
        if laser.sizes["repeat"] > 1:
            wide = 2 * inside["displacement_sd"].values * 1e3
            position.insert(0, Band(_SPREAD, when, mean - wide, mean + wide, role="reference"))
    charts: list[Block] = [
        LineChart("Displacement", _LABEL, "height over first contact / mm", tuple(position), group=_GROUP, views=views)
    ]
    if comparison is not None:
        charts.append(_difference(comparison, laser, views))
    if velocity is not None:
        speed = [Series("film", time, velocity["velocity"].values, role="measured")]
        if laser is not None and "velocity_mean" in laser:
            when, mean = inside["time"].values * 1e3, inside["velocity_mean"].values
            speed.append(Series("laser, mean of the repeats", when, mean, role="reference"))
        charts.append(
            LineChart("Velocity", _LABEL, "velocity / (m/s), upwards", tuple(speed), group=_GROUP, views=views)
        )
    turned, label = Series("film", time, motion["rotation"].values * 1e3, role="measured"), "rotation / mrad, clockwise"
    charts.append(
        LineChart("Rotation of the holder", _LABEL, label, (turned,), group=_GROUP, views=views, height_px=220)
    )
    return Section("Motion", tuple(charts))


def _difference(
    comparison: xr.Dataset, laser: xr.Dataset | None, views: tuple[tuple[str, float, float], ...]
) -> LineChart:
    """Draw film minus laser, and behind it how far the laser's repeats differ among themselves."""
    time = comparison["time"].values
    series: list[Series | Band] = [
        Series("difference", time * 1e3, comparison["residual"].values * 1e6, role="residual")
    ]
    if laser is not None and laser.sizes["repeat"] > 1:
        wide = 2e6 * np.interp(time, laser["time"].values, laser["displacement_sd"].values)
        series.insert(0, Band(_SPREAD, time * 1e3, -wide, wide, role="reference"))
    caption = "An impact that is early or late in one record shows as a spike, as both curves are steep there."
    labels, drawn = ("Film minus laser", _LABEL, "difference / µm"), tuple(series)
    return LineChart(*labels, drawn, group=_GROUP, views=views, height_px=220, caption=caption)


def _agreement(comparison: xr.Dataset) -> Section:
    rows = [
        ("bias", pages.told(comparison, "bias"), "film minus laser"),
        ("standard deviation of the difference", quantity(float(comparison["difference_sd"]), "m"), ""),
        ("lower 95 % limit of agreement", pages.told(comparison, "limit_low"), ""),
        ("upper 95 % limit of agreement", pages.told(comparison, "limit_high"), ""),
        ("concordance", f"{float(comparison['concordance']):.6f}", "Lin's coefficient"),
        ("remaining lag", pages.told(comparison, "lag"), "lag of the laser after alignment"),
        ("largest difference", quantity(float(comparison["max_error"]), "m"), ""),
    ]
    columns = (
        Listed("impact", comparison["impact"].values.tolist()),
        pages.column(comparison, "touch_time_difference", "touch, film − laser"),
        pages.plain(comparison, "incoming_speed_film", "incoming speed, film"),
        pages.plain(comparison, "incoming_speed_laser", "laser"),
        pages.plain(comparison, "restitution_film", "restitution, film"),
        pages.plain(comparison, "restitution_laser", "laser"),
        pages.column(comparison, "restitution_difference", "film − laser"),
    )
    text = (
        "Film and laser recorded different drops on different days: they are aligned at first "
        "contact. Limits of agreement after Bland and Altman, with the number of independent "
        "samples estimated from the autocorrelation of the difference."
    )
    return Section("Agreement", (Paragraph(text), KeyValues(rows), listed(columns)))


def _tracking(track: xr.Dataset, motion: xr.Dataset | None = None) -> Section:
    frames = track["frame"].values
    body = track.isel(point=0)
    size = track["subset"].values[0]
    stretched = int((np.nan_to_num(body["stretch_x"].values) != 0.0).sum())
    rows = [
        ("subset on the holder", f"{size} px", "two shifts and a rotation"),
        ("stretch and shear", f"in {stretched} of {len(frames)} frames", "solved for where the residual shows it"),
        ("standard uncertainty of a displacement (noise)", quantity(float(np.nanmedian(body["u_dy"])), "px"), "median"),
        ("correlation", f"{float(np.nanmin(body['zncc'])):.4f}", "smallest over all frames"),
        ("lost", str(int((~body["valid"].values).sum())), "frames without a value"),
    ]
    share = np.nan_to_num(body["hidden"].values)
    if (share > 0.0).any():
        said = f"at most {100 * share.max():.0f} % of it, in {int((share > 0.0).sum())} of {share.size} frames"
        rows.append(("hidden of it", said, "left out there; the uncertainty grows accordingly"))
    if motion is not None and "line_scatter" in motion:
        scatter = quantity(float(np.nanmedian(motion["line_scatter"])), "m")
        rows.append(("scatter along the line", scatter, "median over frames; includes the rotation"))
    seen = body["valid"].values
    drawn = [Series("found", frames.astype(float), np.where(seen, body["zncc"].values, np.nan), role="measured")]
    if not seen.all():
        lost = np.where(seen, np.nan, body["zncc"].values)
        drawn.append(Series("no value", frames.astype(float), lost, role="residual", style="points"))
    labels = ("Correlation of the large subset", "frame", "zero-normalised correlation")
    chart = LineChart(*labels, tuple(drawn), height_px=200)
    return Section("Tracking", (KeyValues(rows), chart))


def _methods(settings: DicValidation, track: xr.Dataset, comparison: xr.Dataset | None = None) -> Section:
    size = int(track["subset"][0])
    text = (
        "The holder's motion was measured by digital image correlation (zero-normalised sum of squared differences, "
        f"inverse-compositional Gauss–Newton, one rigid subset of {size} px, B-spline interpolation of order "
        f"{settings.tracking.order}) and scaled with the calibration of the view “{settings.view}”. "
    )
    if comparison is not None:
        text += (
            "It was aligned with the mean of the laser's repeats at first contact. The normalised root-mean-square "
            f"difference was {float(comparison['nrmse']) * 100:.2f} %, the bias {pages.told(comparison, 'bias')}, the "
            f"95 % limits of agreement {pages.told(comparison, 'limit_low')} and {pages.told(comparison, 'limit_high')}"
            " (Bland and Altman)."
        )
    return pages.methods(text)


page = Report(
    "Camera against laser",
    ("track", "motion", "bounces", "velocity", "keys", "comparison", "laser"),
    (_summary, _key_frames, _motion, _agreement, _tracking, _calibration, budgets(quantities), _methods),
    compared_rows,
    counts={"comparison": lambda comparison: "nrmse" in comparison},
)

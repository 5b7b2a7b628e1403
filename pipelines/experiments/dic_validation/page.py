"""The report of a film against the laser."""

import math
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import xarray as xr

from labpipe.report import Band, Section, Series, quantity, value_with_uncertainty
from pipelines.experiments.dic_validation.budget import quantities
from pipelines.experiments.dic_validation.comparison import rows
from pipelines.experiments.dic_validation.settings import DicValidation, Tracking
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.film_frames import Drawn, DrawnFilm, drawing_of, film_of, ink, meanings, strip
from pipelines.experiments.shared.reports import Report

_MASKS = (
    "Green: regions that count; purple: covered parts that do not, both moving with the large subset; ochre: "
    "obstructions that stand still before the holder and do not count. "
)
_SPREAD = "± 2 sd of the laser's repeats"


def _details(track: xr.Dataset) -> list[tuple[str, str, str]]:
    body = track.isel(point=0)
    lost, hidden = int((~body["valid"].values).sum()), np.nan_to_num(body["hidden"].values)
    rows = [
        ("subset on the holder", f"{int(body['subset'])} px", f"lost in {pages.counted(lost, 'frame')}"),
        ("noise of a displacement", quantity(float(np.nanmedian(body["u_dy"])), "px"), "median; standard uncertainty"),
        ("smallest correlation of the subset", f"{float(np.nanmin(body['zncc'])):.4f}", "zero-normalised"),
    ]
    if (hidden > 0.0).any():
        said = f"at most {100 * hidden.max():.0f} % of it, in {int((hidden > 0.0).sum())} of {hidden.size} frames"
        rows.append(("hidden of it", said, "left out there; the uncertainty grows accordingly"))
    return rows


def _key_frames(
    keys: xr.Dataset, track: xr.Dataset, settings: DicValidation, bounces: xr.Dataset | None = None
) -> Section:
    start = None if bounces is None else float(bounces["first_contact_time"])
    at = track.sel(frame=keys["frame"].values)
    drawn = [_drawn(keys.isel(key=i), at.isel(frame=i), start, settings.tracking) for i in range(keys.sizes["key"])]
    caption = "Orange: the large subset whose motion is the result, with its rotation. "
    caption += "Blue: the line of small subsets. " * (track.sizes["point"] > 1) + _MASKS * bool(settings.tracking.masks)
    caption += "The charts below mark the frame that is shown." * (start is not None)
    gallery = strip("Film with the tracked subsets", drawn, caption=caption, group="film")
    return Section("Film", (gallery, *pages.raw_headers([keys.assign_attrs(source=settings.film)])))


def film(path: Path, track: xr.Dataset | None, bounces: xr.Dataset | None, *, settings: DicValidation) -> DrawnFilm:
    """Return the film with the tracked subsets drawn; the first contact has a name."""
    source = film_of(path, settings)
    if track is None:
        return DrawnFilm(source)
    start = math.nan if bounces is None else float(bounces["first_contact_time"])
    jumps = {"First contact": int(np.argmin(np.abs(source.time - start)))} if math.isfinite(start) else {}
    drawn = partial(_drawn, start=None, tracking=settings.tracking)
    return DrawnFilm(source, track["frame"].values, lambda key, at: drawn(key, track.isel(frame=at)), jumps)


def _drawn(key: xr.Dataset, at: xr.Dataset, start: float | None, tracking: Tracking) -> Drawn:
    """Draw the subsets and masks; those that move with the large subset are moved and turned as it is."""
    canvas, scale, half = drawing_of(key)
    starts, moved = (np.stack([at[name].values for name in names], axis=1) for names in (("x", "y"), ("dx", "dy")))
    first, now, turned = starts[0], (starts + moved)[0], float(at["rotation"][0])
    cosine, sine = math.cos(turned), math.sin(turned)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    side = 0.5 * float(at["subset"][0])
    square = now + np.array([(-side, -side), (side, -side), (side, side), (-side, side)]) @ turn.T
    point, body_ink, region, cover, obstruction = map(ink, range(5))
    drawn = [(square, body_ink), *((np.array(polygon), obstruction) for polygon in tracking.obstructions or ())]
    for polygons, colour in ((tracking.regions, region), (tracking.covers, cover)):
        drawn += [(now + (np.array(polygon) - first) @ turn.T, colour) for polygon in polygons or ()]
    for corners, colour in drawn:
        if np.isfinite(corners).all():
            places = np.rint(corners * scale + half).astype(np.int32)
            cv2.polylines(canvas, [places], True, colour, 2, cv2.LINE_AA)
    for x, y in (starts + moved)[1:].tolist():
        if math.isfinite(x) and math.isfinite(y):
            cv2.circle(canvas, (round(x * scale + half), round(y * scale + half)), 4, point, 2, cv2.LINE_AA)
    frame, time, [status] = int(key["frame"]), float(key["key_time"]) * 1e3, meanings(at["status"][0])
    lost = "" if status == "ok" else f"; the large subset has no value: {status.replace('_', ' ')}"
    words = f"frame {frame} of the film with the tracked subsets drawn on it"
    place = None if start is None else time - start * 1e3
    return canvas, words, f"frame {frame}, {time:.2f} ms in the film{lost}", place


def _calibration(motion: xr.Dataset, settings: DicValidation) -> Section:
    direction, u_direction = (math.degrees(float(motion[of])) for of in ("direction", "u_direction"))
    turned = value_with_uncertainty(direction, u_direction, "deg")
    relative = f"{float(motion.attrs['u_systematic_relative']) * 100:.3f} %"
    along = "positive to the right of upwards; displacements are along it up to 30°"
    rows = [
        ("motion, to the image's columns", turned, along),
        ("tilt of the camera, up or down", pages.stated(settings.camera_tilt), "stated; lengths / cos(tilt)"),
        ("relative uncertainty of a displacement's scale", relative, "the same for every frame"),
    ]
    return pages.camera_calibration(motion, "holder", rows)


def _motion(
    motion: xr.Dataset,
    bounces: xr.Dataset | None = None,
    velocity: xr.Dataset | None = None,
    laser: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Section:
    moved, time = motion["displacement"].values, motion["time"].values
    if bounces is None:  # no contact from which to count
        labels = ("Displacement", "time in the film / ms", "displacement / mm, upwards")
        return Section("Motion", (pages.chart(*labels, [Series("film", time, moved, role="measured")], group="film"),))
    start, level = float(bounces["first_contact_time"]), float(bounces["contact_level"])
    time = time - start
    touches, leaves = (bounces[f"{of}_time"].values - start for of in ("touch", "liftoff"))
    views = pages.impact_views(touches, leaves - touches)
    chart = partial(pages.chart, x="time since first contact / ms", group="film", views=views)
    position, speed, difference = [Series("film", time, moved - level, role="measured")], list[Series](), list[Series]()
    if velocity is not None:
        speed.append(Series("film", time, velocity["velocity"].values, role="measured"))
    if comparison is not None:
        both = comparison["time"].values
        difference.append(Series("difference", both, comparison["residual"].values, role="residual"))
    if laser is not None:
        inside = laser.sel(time=slice(time[0], time[-1]))
        when, mean = inside["time"].values, inside["displacement_mean"].values
        position.append(Series("laser, mean of the repeats", when, mean, role="reference"))
        if laser.sizes["repeat"] > 1:
            wide = 2 * inside["displacement_sd"].values
            position.insert(0, Band(_SPREAD, when, mean - wide, mean + wide, role="reference"))
            if comparison is not None:
                wide = 2 * np.interp(both, when, inside["displacement_sd"].values)
                difference.insert(0, Band(_SPREAD, both, -wide, wide, role="reference"))
        if speed and "velocity_mean" in laser:
            speed.append(Series("laser, mean of the repeats", when, inside["velocity_mean"].values, role="reference"))
    caption = "An impact that is early or late in one record shows as a spike, as both curves are steep there."
    charts = [chart("Displacement", y="height over first contact / mm", series=position)]
    if difference:
        apart = chart("Film minus laser", y="difference / µm", series=difference, caption=caption, height_px=220)
        charts.append(apart)
    charts += [chart("Velocity", y="velocity / (m/s), upwards", series=speed)] if speed else []
    return Section("Motion", charts)


def _methods(settings: DicValidation, track: xr.Dataset, comparison: xr.Dataset | None = None) -> str:
    size = int(track["subset"][0])
    text = (
        "The holder's motion was measured by digital image correlation (zero-normalised sum of squared differences, "
        "inverse-compositional Gauss–Newton, Pan et al. 2013, doi:10.1007/s11340-013-9717-6; "
        f"one rigid subset of {size} px, B-spline interpolation of order 5) "
        f"and scaled with the calibration of the view “{settings.view}”."
    )
    if comparison is not None:
        text += " It was aligned with the mean of the laser's repeats at first contact."
    return text


page = Report(
    subtitle="Camera against laser",
    shown=("track", "motion", "bounces", "velocity", "keys", "comparison", "laser"),
    details=_details,
    rows=rows,
    sections=(_key_frames, _motion, _calibration),
    budget=quantities,
    methods=_methods,
    counts={"comparison": lambda comparison: "nrmse" in comparison},
)

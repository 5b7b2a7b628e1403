"""The report of a contact area."""

import math
from collections import Counter
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import xarray as xr

from labpipe.imaging import USUAL_WORK
from labpipe.report import Band, Block, Paragraph, Section, Series, quantity, value_with_uncertainty
from pipelines.experiments.contact_area.budget import quantities
from pipelines.experiments.contact_area.comparison import rows
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared import pages
from pipelines.experiments.shared.counter_body import flat_rows
from pipelines.experiments.shared.drop_model import linear_range_rows, simulated
from pipelines.experiments.shared.film_frames import Drawn, DrawnFilm, drawing_of, film_of, ink, meanings, strip
from pipelines.experiments.shared.reports import Report

_METHODS = {
    "fringe_fit": (
        "fringe fit",
        "by fitting the interference phase of Hertz's gap to the first fringes, with the exposure's smear modelled",
    ),
    "fringe_fit_open_gap": ("fringe fit, gap width free", "by the same fit with the width of the gap left free"),
    "edge": ("edge", "from the edge of the dark spot"),
    "between_equal_frames": (
        "interpolation between equal frames at rest",
        "at rest by interpolation between equal frames",
    ),
    "wider_than_frame": ("contact fills the view (no radius)", ""),
}
"""Of each method of a radius, a name and how it reads in a sentence."""
_AROUND = (
    "Film and model around each largest radius: both are aligned there, and the model then shifted in time to fit all "
    "frames of the contact, since the largest radius is flat in time. Bars: standard uncertainty of the film. Band: "
    "twice that of the model, in which size and duration of a contact move together, as by a wrong modulus."
)


def _details(
    settings: ContactArea, impacts: xr.Dataset | None = None, model: xr.Dataset | None = None
) -> list[tuple[str, str, str]]:
    light, limit = settings.wavelength, "by the edge of the dark spot, uncertain by several micrometres"
    known = ("not known", limit) if light is None else (pages.stated(light), "from session.toml")
    rows = [("wavelength", *known)]
    if model is not None and model.sizes["impact"]:
        work, why = settings.work_of_adhesion, "work_of_adhesion is stated as 0: the surfaces do not stick"
        place = "at the radius"
        if work is None:  # the middle of what is possible is half of the most
            place = f"up to {quantity(2.0 * float(model['adhesion_shift'][0]), 'm', 2)} farther out"
            why = f"if the surfaces stick as clean smooth polymers do (JKR, {quantity(USUAL_WORK, 'J/m2', 2)}); state "
            why += "work_of_adhesion in session.toml"
        elif work.value > 0.0:
            place = f"{pages.told(model, 'adhesion_shift', 0)} farther out"
            why = f"JKR with the stated {pages.stated(work)}"
        rows.append(("edge of the contact", place, f"{why}; fringes show the Hertz-equivalent radius"))
        rows += [*linear_range_rows(model), *flat_rows(settings.counter_body, settings.sphere, model)]
    at_rest = pages.known(impacts, {"static_radius": ("contact radius at rest, film", "")})
    if at_rest and model is not None:
        brief, lasting = (quantity(float(model[f"static_radius_{n}"]), "m", 4) for n in ("brief", "lasting"))
        text = f"{brief} after as long as an impact, {lasting} at the end of the film"
        at_rest.append(("Hertz radius under the weight", text, "with the creep of the material"))
    return [*rows, *at_rest]


def _key_frames(
    keys: xr.Dataset, radius: xr.Dataset, settings: ContactArea, impacts: xr.Dataset | None = None
) -> Section:
    at = radius.sel(frame=keys["frame"].values)
    drawn = [_drawn(keys.isel(key=i), at.isel(frame=i)) for i in range(keys.sizes["key"])]
    top = int(np.argmax(np.nan_to_num(at["radius"].values)))
    shown = "Frames all over the film, since no impact was found in it"
    shown = shown if impacts is None else "The frames of each impact, of a long one every few, and rest"
    caption = f"{shown}. The chart of the contact radius marks the frame that is shown."
    gallery = strip("Film with the fitted circle", drawn, start=top, group="film", caption=caption)
    return Section("Film", (gallery, *pages.raw_headers([keys.assign_attrs(source=settings.film)])))


def film(path: Path, radius: xr.Dataset | None, *, settings: ContactArea) -> DrawnFilm:
    """Return the film with the fitted circles drawn; first contact and largest radius have names."""
    source = film_of(path, settings)
    if radius is None:
        return DrawnFilm(source)
    frame, found = radius["frame"].values, radius["radius"].where(radius["in_contact"]).values
    names = {"First contact": np.isfinite(found).argmax(), "Largest radius": np.nan_to_num(found).argmax()}
    jumps = {name: int(frame[at]) for name, at in names.items() if np.isfinite(found[at])}
    return DrawnFilm(source, frame, lambda key, at: _drawn(key, radius.isel(frame=at)), jumps)


def _drawn(key: xr.Dataset, at: xr.Dataset) -> Drawn:
    """Draw the fitted circle on a frame; return it with a description, a caption and its place on the charts."""
    canvas, scale, shift = drawing_of(key)
    x, y, angle = (float(at[name]) for name in ("centre_x", "centre_y", "axis_angle"))
    lengths = ("radius", "semi_axis_major", "semi_axis_minor")
    r, major, minor = (float(at[name]) / float(at["pixel_size"]) for name in lengths)
    if all(map(math.isfinite, (x, y, r))):
        digits = 4  # binary ones of a place, beyond whole pixels
        unit = scale * (1 << digits)
        centre = (round((x + shift / scale) * unit), round((y + shift / scale) * unit))
        size = [round((axis if math.isfinite(axis) else r) * unit) for axis in (major, minor)]
        turned = math.degrees(angle) if math.isfinite(angle) else 0.0
        cv2.ellipse(canvas, centre, size, turned, 0, 360, ink(1), 1, cv2.LINE_AA, digits)
    frame, time = int(key["frame"]), float(key["key_time"]) * 1e3  # ms
    found = "no radius"
    if math.isfinite(r):
        u = math.hypot(float(at["u_radius"]), float(at["radius_systematic"]))
        value, [method] = value_with_uncertainty(float(at["radius"]), u, "m"), meanings(at["method"])
        found = f"radius {value} ({r:.1f} px), {_METHODS[method][0]}"
    words = f"frame {frame} with the fitted contact circle"
    return canvas, words, f"frame {frame}, {time:.2f} ms in the film, {found}", time


def _over_time(
    settings: ContactArea,
    radius: xr.Dataset,
    impacts: xr.Dataset | None = None,
    model: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Section:
    time, seen = radius["time"].values, radius["in_contact"].values.astype(bool)
    known = np.hypot(radius["u_radius"].values, radius["radius_systematic"].values)
    known = np.where(seen & np.isfinite(known), known, 0.0)
    shown = np.where(seen, radius["radius"].values, 0.0)
    curves, views = [Series("film", time, shown, role="measured", style="points", u=known)], []
    if impacts is not None:
        first, last = (impacts[f"{which}_seen"].values for which in ("first", "last"))
        views = pages.impact_views(first, last - first)
    if model is not None and impacts is not None and impacts.sizes["impact"]:
        start = float(impacts["peak_time"][0])
        if comparison is not None and comparison.sizes["impact"]:
            start -= float(comparison["model_peak_time"][0] + comparison["time_shift"][0])
        moved = model.assign_coords(time=model["time"] + start).sel(time=slice(time[0], time[-1]))
        label = "model, aligned at the first impact"
        curves.append(Series(label, moved["time"].values, moved["contact_radius"].values, role="model"))
    least = quantity(float(radius.attrs["least_radius"]), "m", 2)
    caption = (
        f"Frames without a contact are drawn at 0; contacts below {least} cannot be distinguished from a touch. Bars: "
        "standard uncertainty."
    )
    labels = ("Contact radius", "time in the film / ms", "contact radius / mm", curves)
    charts: list[Block] = [pages.chart(*labels, group="film", views=views, opens_on_view=bool(views), caption=caption)]
    if comparison is not None and model is not None and comparison.sizes["impact"]:
        around, residuals = list[Series](), list[Series]()
        for i in range(comparison.sizes["impact"]):
            mine, name = comparison["impact_number"].values == i + 1, f"impact {i + 1}"
            since, film, made, u = (comparison[of].values[mine] for of in ("since_peak", "film", "model", "u_film"))
            # nearly all uncertainty of the model is the modulus': the radius goes as E^-0.2 and the duration as E^-0.4
            relative = float(model["u_peak_contact_radius"][i] / model["peak_contact_radius"][i])
            slope = np.gradient(made, since) if since.size > 1 else np.zeros(since.size)
            wide = 2.0 * relative * np.abs(made - 2.0 * since * slope)
            around.append(Series(f"{name}, film", since, film, role="measured", style="points", u=u))
            around.append(Series(f"{name}, model", since, made, role="model"))
            residuals.append(Band(f"{name}, model ± 2 u", since, -wide, wide, role="model"))
            residuals.append(
                Series(f"{name}, film minus model", since, film - made, role="residual", style="points", u=u)
            )
        chart = partial(pages.chart, x="time since the largest radius / ms", group="impacts")
        title = "Contact radius around its largest value"
        charts += [
            Paragraph(_AROUND),
            chart(title, y="contact radius / mm", series=around, height_px=260),
            chart("Film minus model", y="difference / µm", series=residuals, height_px=220),
        ]
        charts += pages.limits_of(model)
    return Section("Contact radius over time", tuple(charts))


def _methods(settings: ContactArea, radius: xr.Dataset, model: xr.Dataset | None = None) -> str:
    counts = Counter(meanings(radius["method"]).tolist())
    used = [(counts[name], text) for name, (_, text) in _METHODS.items() if counts[name] and text]
    parts = [f"in {pages.counted(count, 'frame')} {text}" for count, text in used]
    text = f"The contact radius of a sphere of radius {pages.stated(settings.sphere.radius)} was measured "
    text += " and ".join([part for part in (", ".join(parts[:-1]), *parts[-1:]) if part]) or "in no frame"
    if settings.wavelength is not None and (counts["fringe_fit"] or counts["fringe_fit_open_gap"]):
        text += (
            f". The wavelength of the light was {pages.stated(settings.wavelength)}. The radius is that of the Hertz "
            "contact with the same gap around it, whether the surfaces stick or not"
        )
    text += ". "
    if model is not None:
        text += simulated(settings, model)
    return text


page = Report(
    subtitle=lambda settings: f"Contact area, drop from {pages.stated(settings.height)}",
    shown=("radius", "impacts", "model", "comparison", "keys"),
    details=_details,
    rows=rows,
    sections=(_key_frames, _over_time, lambda radius: pages.camera_calibration(radius, "disc")),
    budget=quantities,
    methods=_methods,
)

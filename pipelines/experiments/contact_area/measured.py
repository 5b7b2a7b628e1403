"""Contact area: the radius of the contact over time from a film under the disc.

Each impact is counted from its largest radius (t_p = 0), as in the thesis.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import calibration
from calibration import camera as camera_scale
from labpipe import imaging
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.uncertainty import Source, budget_rows
from labpipe.variables import variable, with_u
from pipelines.experiments.contact_area._axes import u_of_view, with_uneven_scale
from pipelines.experiments.contact_area._peaks import STILL, peak_of
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.film_frames import about_contacts, key_frames, open_film, recorded_on, repeated
from pipelines.experiments.shared.film_light import DARK, LIGHT, light_of
from pipelines.experiments.shared.film_stated import said_by_file

FRINGE_FIT, EDGE, OPEN_GAP = READ = (1, 2, 5)
"""Methods of :func:`labpipe.imaging.contact_radius` that read the frame itself: by fringes, by the edge of the spot,
by fringes of a gap that is wider than Hertz's."""
_LEAST_REGION = 32  # px: below it no contact with a ring would fit
_IMPACTS = 3  # the thesis analyses the first three
_GAP = 4.0  # usual intervals between two frames that end a contact even when both see one
_MISSED = 2  # frames without contact within one: a flight lasts longer
_HIDDEN = 8.0  # usual intervals that frames which show nothing may take from one contact
_COVERS, _NEAR = 0.85, 8
"""Share of half the view's diagonal from which a contact, so many frames away, may cover the view."""
_BRIEF = 0.3  # an impact lasts at least this share of the longest: slower ones last longer
_SLOWEST = 3.0  # an impact lasts at most this many times the longest before: Hertz's fifth root
_RESOLVED = 3  # frames of an impact from which single frames elsewhere are not impacts


def radius(film: Path, record: Path, *, settings: ContactArea, full: bool) -> xr.Dataset:
    """Measure the contact radius while there may be contact; in every frame if full."""
    source = open_film(film, settings.frame_rate, settings.channel)
    known = calibration.load_record(record)
    day = settings.measured_on
    size, checked = camera_scale.image_scale(known, settings.view, measured=day, recorded=recorded_on(source))
    sphere, light = settings.sphere.radius, settings.wavelength
    rows, columns = _region(source.shape[1:], settings)
    seen = source if settings.region is None else source.roi(rows, columns)
    found = imaging.contact_radius(
        seen,
        size.value,
        sphere.value,
        None if light is None else light.value,
        None if settings.exposure is None else settings.exposure.value,
        full=full,
        u_pixel_size=size.u,
        u_sphere_radius=sphere.u,
        u_wavelength=0.0 if light is None else light.u,
    )
    read = np.isin(found["method"].values, READ) & found["in_contact"].values.astype(bool)
    time = variable("frame", source.time, "s", "time in the film")
    found = found.assign_coords(time=time)
    found["centre_x"].values += columns.start
    found["centre_y"].values += rows.start
    found["pixel_size"] = variable((), size.value, "m/px", "length of one pixel")
    found["u_pixel_size"] = variable((), size.u, "m/px", "standard uncertainty: length of one pixel")
    budget, u_view = checked.pop("budget"), u_of_view(found)
    if u_view:
        found = with_uneven_scale(found, u_view)
        of_record = [Source(*(row[key] for key in Source._fields)) for row in budget]
        budget = budget_rows([*of_record, Source("oblique view", 0.0, u_view, "1", size.value, "systematic")])
    return found.assign_attrs(
        scale_budget=json.dumps(budget),
        calibration=json.dumps(checked, ensure_ascii=False),
        u_systematic_relative=math.hypot(size.u / size.value, u_view),
        repeated=json.dumps(repeated(seen, read)),
        light=light_of(seen, about_contacts(read)),
        said_by_file=said_by_file(source),
    )


def _region(shape: tuple[int, ...], settings: ContactArea) -> tuple[slice, slice]:
    """Return the rows and columns in which the contact is looked for."""
    if settings.region is None:
        return slice(0, shape[0]), slice(0, shape[1])
    (x1, y1), (x2, y2) = settings.region
    wide, high, (rows, columns) = max(x1, x2), max(y1, y2), shape
    if wide > columns or high > rows:
        swapped = ": x and y are exchanged" if wide <= rows and high <= columns else ""
        raise InputError(
            f"region: the part from ({x1:g}, {y1:g}) to ({x2:g}, {y2:g}) reaches beyond the images, {columns} px "
            f"wide and {rows} px high{swapped}; give px of the images, x to the right and y down"
        ).because("region")
    found = []
    for low, high, size in ((*sorted((y1, y2)), rows), (*sorted((x1, x2)), columns)):
        found.append(slice(min(math.floor(low), size), min(math.ceil(high) + 1, size)))
    if min(part.stop - part.start for part in found) < _LEAST_REGION:
        raise InputError(
            f"region: the part from ({x1:g}, {y1:g}) to ({x2:g}, {y2:g}) of a film of {columns} x {rows} px is "
            f"less than {_LEAST_REGION} px wide or high; draw it around the contact with its rings"
        )
    return found[0], found[1]


def impacts(radius: xr.Dataset, *, settings: ContactArea) -> xr.Dataset:
    """Find the first three impacts with their largest radius, and the radius at rest."""
    time, a = radius["time"].values, radius["radius"].values
    u = radius["u_radius"].values
    seen = radius["in_contact"].values.astype(bool)
    unknown = ~radius["valid"].values.astype(bool) if "valid" in radius else np.zeros(len(time), bool)
    unknown[[i for i, b in brightness(radius).items() if b < DARK]] = True
    runs = _contacts(time, seen, unknown & ~seen)
    if not any(np.isfinite(a[run]).any() for run in runs):
        raise InputError(f"{radius.attrs['note']}; check the view under the disc, its scale and the wavelength")
    brief = _brief_contacts(time, a, runs)
    brief = brief[:_IMPACTS]
    peaks = [peak_of(time[run], a[run], u[run]) for run in brief]
    shared = radius["radius_systematic"].values / a
    relative = float(np.nanmedian(shared)) if np.isfinite(shared).any() else 0.0
    table: dict[str, Any] = {}
    largest = np.array([p.radius for p in peaks])
    sampling = np.array([p.sampling for p in peaks])
    own = np.hypot([p.u for p in peaks], sampling)
    for name, values, units, text in (
        ("peak_time", np.array([p.time for p in peaks]), "s", "time of the largest radius"),
        ("peak_sampling", sampling, "m", "part of that uncertainty from interpolation between the frames"),
    ):
        table[name] = variable("impact", values, units, text)
    u_largest = np.hypot(own, relative * largest)
    table |= with_u("peak_radius", "impact", largest, u_largest, "m", "largest contact radius, Hertz-equivalent")
    for name, place, text in (("first_seen", 0, "first"), ("last_seen", -1, "last")):
        table[name] = variable(
            "impact", np.array([time[run[place]] for run in brief], float), "s", f"{text} frame with contact"
        )
    table |= _at_rest(time, a, u, runs, relative)
    return xr.Dataset(table, coords={"impact": np.arange(1, len(brief) + 1)})


def edges_only(radius: xr.Dataset) -> tuple[int, int]:
    """Return the frames that were measured by the edge of the spot, and by fringes."""
    method = radius["method"].values
    return int(np.sum(method == EDGE)), int(np.sum((method == FRINGE_FIT) | (method == OPEN_GAP)))


def brightness(radius: xr.Dataset) -> dict[int, float]:
    """Return how bright frames are, over what is usual, that no contact as wide as the view makes dark."""
    light = json.loads(radius.attrs.get(LIGHT, "{}"))
    if not light:
        return {}
    wide = np.nan_to_num(radius["radius"].values / float(radius["pixel_size"]))
    covers = _COVERS * 0.5 * math.hypot(*light["view"])
    seen = ((int(i), float(b)) for i, b in light["brightness"].items())
    return {i: b for i, b in seen if wide[max(i - _NEAR, 0) : i + _NEAR + 1].max(initial=0.0) < covers}


def _contacts(
    time: Floats, is_seen: NDArray[np.bool_], is_unknown: NDArray[np.bool_] | None = None
) -> list[NDArray[np.int64]]:
    """Group the frames with contact into contacts; frames that show nothing do not part them."""
    seen = np.flatnonzero(is_seen)
    if not len(seen):
        return []
    usual = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    late = np.diff(time[seen])
    is_new = (np.diff(seen) > _MISSED + 1) | (late > max(_GAP * usual, STILL / 2))
    is_new |= (np.diff(seen) > 1) & (late > (_MISSED + 1.5) * usual)
    if is_unknown is not None:
        shows = np.cumsum(~is_unknown)
        is_new &= (np.diff(shows[seen]) > 1) | (late > _HIDDEN * usual) | (np.diff(seen) == 1)
    return np.split(seen, np.flatnonzero(is_new) + 1)


def _brief_contacts(time: Floats, a: Floats, runs: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """Contacts that are impacts: neither rest nor a single frame mistaken for a contact.

    The time of an impact hardly depends on its speed (Hertz: as its fifth root), and grows from
    bounce to bounce. What ends much sooner than others last, or shows in one frame where others
    show in several, is a shadow or a sphere that passes close by.
    """
    brief = [run for run in runs if time[run[-1]] - time[run[0]] < STILL]
    brief = [run for run in brief if np.isfinite(a[run]).any()]
    brief = _without_rest(time, _seen_through(time, brief))
    longest = max((float(time[run[-1]] - time[run[0]]) for run in brief), default=0.0)
    most = max(map(len, brief), default=0)
    last = len(time) - 1

    def is_impact(run: NDArray[np.int64]) -> bool:
        between = time[min(run[-1] + 1, last)] - time[max(run[0] - 1, 0)]
        is_alone = len(run) == 1 and most >= _RESOLVED
        return bool(between >= _BRIEF * longest) and not is_alone

    return [run for run in brief if is_impact(run)]


def _seen_through(time: Floats, brief: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """Leave out contacts in frames between which another whole contact would have fitted.

    Films that the camera thins out between the impacts show several last bounces as one contact.
    """
    whole = [float(time[run[-1]] - time[run[0]]) for run in brief if len(run) > 2]
    shortest = min(whole, default=np.inf)
    return [run for run in brief if len(run) < 2 or float(np.diff(time[run]).max()) <= shortest]


def _without_rest(time: Floats, brief: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """Leave out a contact that the film's end cuts off when it is too long for an impact."""
    last = len(time) - 1
    ended = [run for run in brief if run[-1] < last]
    if len(ended) in (0, len(brief)):
        return brief
    frame = float(np.median(np.diff(time)))
    longest = max(float(time[run[-1]] - time[run[0]]) for run in ended) + 2 * frame
    is_rest = float(time[last] - time[brief[-1][0]]) > _SLOWEST * longest
    return ended if is_rest else brief


def _at_rest(time: Floats, a: Floats, u: Floats, runs: list[NDArray[np.int64]], relative: float) -> dict[str, Any]:
    """Radius in the last half of the last contact when that is rest; NaN otherwise."""
    last = runs[-1]
    value, own, start = np.nan, np.nan, np.nan
    if time[last[-1]] - time[last[0]] >= STILL:
        half = last[time[last] >= 0.5 * (time[last[0]] + time[last[-1]])]
        value, start = float(np.median(a[half])), float(time[half[0]])
        scatter = float(np.std(a[half])) if len(half) > 1 else 0.0
        own = float(np.hypot(max(scatter, np.median(u[half])), relative * value))
    return {
        **with_u("static_radius", (), value, own, "m", "contact radius at rest"),
        "static_since": variable((), start, "s", "start of the frames at rest"),
    }


_ALL_OVER = 7  # frames that stand for a film without impacts


def keys(film: Path, radius: xr.Dataset, impacts: xr.Dataset | None, *, settings: ContactArea) -> xr.Dataset:
    """Copy key frames with the fitted circles: around each largest radius, and at rest; without impacts, all over."""
    source = open_film(film, settings.frame_rate, settings.channel)
    wanted = _of_impacts(radius, impacts) if impacts is not None else _of_whole(radius)
    near = sorted(i for i in wanted if source.valid[int(radius["frame"][i])])
    found = key_frames(source, [int(radius["frame"][i]) for i in near])
    size = float(radius["pixel_size"])
    at = radius.isel(frame=near)
    for name, values, units, text in (
        ("circle_x", at["centre_x"].values, "px", "column of the fitted centre"),
        ("circle_y", at["centre_y"].values, "px", "row of the fitted centre"),
        ("circle_radius", at["radius"].values / size, "px", "fitted radius"),
        ("circle_major", at["semi_axis_major"].values / size, "px", "fitted major semi-axis"),
        ("circle_minor", at["semi_axis_minor"].values / size, "px", "fitted minor semi-axis"),
        ("circle_angle", at["axis_angle"].values, "rad", "direction of the major axis"),
        ("key_method", at["method"].values.astype(float), "1", "method of the radius"),
    ):
        found[name] = variable("key", values, units, text)
    u = np.hypot(at["u_radius"].values, at["radius_systematic"].values)
    found = found.assign(with_u("key_radius", "key", at["radius"].values, u, "m", "contact radius"))
    return found.assign_attrs(work=json.dumps({"key_frames": len(near)}))


def _of_impacts(radius: xr.Dataset, impacts: xr.Dataset) -> set[int]:
    """Choose the first frame, that of the largest radius and the last of each impact, and one at rest."""
    time, seen = radius["time"].values, radius["in_contact"].values.astype(bool)
    wanted: set[int] = set()
    for i in range(impacts.sizes["impact"]):
        inside = np.flatnonzero(
            seen & (time >= float(impacts["first_seen"][i])) & (time <= float(impacts["last_seen"][i]))
        )
        top = int(inside[np.argmin(np.abs(time[inside] - float(impacts["peak_time"][i])))])
        wanted |= {int(inside[0]), top, int(inside[-1])}
    if np.isfinite(float(impacts["static_radius"])):
        wanted.add(int(np.flatnonzero(seen)[-1]))
    return wanted


def _of_whole(radius: xr.Dataset) -> set[int]:
    """Choose frames all over a film of which no impact was told."""
    sound = np.flatnonzero(radius["valid"].values)
    return {int(i) for i in sound[np.linspace(0, len(sound) - 1, min(_ALL_OVER, len(sound))).round().astype(int)]}

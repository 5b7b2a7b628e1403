"""Contact area: the radius of the contact over time from a film under the disc.

Each impact is counted from its largest radius (t_p = 0), as in the thesis.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

import calibration
from calibration import camera as camera_scale
from labpipe import imaging
from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import InputError
from labpipe.variables import variable, with_u
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.film_checks import light_of, repeated, said_by_file
from pipelines.experiments.shared.film_frames import film_of, key_frames, recorded_on, thinned

STILL = 20e-3  # s of contact after which it is rest, not an impact
WINDOW = 3e-3  # s around the largest radius in which film and model are compared
FRINGE_FIT, EDGE, OPEN_GAP = READ = (1, 2, 5)
"""Methods of :func:`labpipe.imaging.contact_radius` that read the frame itself: by fringes, by the edge of the spot,
by fringes of a gap that is wider than Hertz's."""
_LEAST_REGION = 32  # px: below it no contact with a ring would fit
_IMPACTS = 3  # the thesis analyses the first three
_GAP = 4.0  # usual intervals between two frames that end a contact even when both see one
_MISSED = 2  # frames without contact within one: a flight lasts longer
_HIDDEN = 8.0  # usual intervals that frames which show nothing may take from one contact
_BRIEF = 0.3  # an impact lasts at least this share of the longest: slower ones last longer
_RESOLVED = 3  # frames of an impact from which single frames elsewhere are not impacts


def radius(film: Path, record: Path, *, settings: ContactArea, full: bool) -> xr.Dataset:
    """Measure the contact radius while there may be contact; in every frame if full."""
    source = film_of(film, settings)
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
    return found.assign_attrs(
        scale_budget=json.dumps(checked.pop("budget")),
        calibration=json.dumps(checked, ensure_ascii=False),
        u_systematic_relative=size.u / size.value,
        repeated=json.dumps(repeated(seen, read)),
        light=light_of(seen),
        said_by_file=said_by_file(source),
    )


def _region(shape: tuple[int, ...], settings: ContactArea) -> tuple[slice, slice]:
    """Return the rows and columns in which the contact is looked for."""
    size = np.array(shape[::-1])  # x, y
    corners = np.array([(0, 0), size - 1] if settings.region is None else settings.region)
    low, high = corners.min(axis=0), corners.max(axis=0)
    part = f"region: the part from ({', '.join(f'{c:g}' for c in low)}) to ({', '.join(f'{c:g}' for c in high)})"
    seen = f"the images, {size[0]} px wide and {size[1]} px high"
    if (high > size).any():
        swapped = ": x and y are exchanged" if (high[::-1] <= size).all() else ""
        text = f"{part} reaches beyond {seen}{swapped}; give px of the images, x to the right and y down"
        raise InputError(text).because("region")
    begin, end = np.minimum(np.floor(low), size).astype(int), np.minimum(np.ceil(high) + 1, size).astype(int)
    if settings.region is not None and (end - begin).min() < _LEAST_REGION:
        text = (
            f"{part} of {seen}, is less than {_LEAST_REGION} px wide or high; draw it around the contact with its rings"
        )
        raise InputError(text)
    return slice(int(begin[1]), int(end[1])), slice(int(begin[0]), int(end[0]))


def impacts(radius: xr.Dataset, *, settings: ContactArea) -> xr.Dataset:
    """Find the first three impacts with their largest radius, and the radius at rest."""
    time, a, u = (radius[name].values for name in ("time", "radius", "u_radius"))
    seen = radius["in_contact"].values.astype(bool)
    unknown = ~radius["valid"].values.astype(bool) if "valid" in radius else np.zeros(len(time), bool)
    runs = _contacts(time, seen, unknown & ~seen)
    if not any(np.isfinite(a[run]).any() for run in runs):
        raise InputError(f"{radius.attrs['note']}; check the view under the disc, its scale and the wavelength")
    brief = _brief_contacts(time, a, runs)[:_IMPACTS]
    shared = radius["radius_systematic"].values / a
    relative = float(np.nanmedian(shared)) if np.isfinite(shared).any() else 0.0
    peaks = [(*peak_of(time[run], a[run], u[run]), time[run[0]], time[run[-1]]) for run in brief]
    when, largest, own, sampling, first, last = np.array(peaks).reshape(-1, 6).T
    u_largest = np.hypot(np.hypot(own, sampling), relative * largest)
    table = with_u("peak_radius", "impact", largest, u_largest, "m", "largest contact radius, Hertz-equivalent")
    for name, values, units, text in (
        ("peak_time", when, "s", "time of the largest radius"),
        ("peak_sampling", sampling, "m", "part of that uncertainty from interpolation between the frames"),
        ("first_seen", first, "s", "first frame with contact"),
        ("last_seen", last, "s", "last frame with contact"),
    ):
        table[name] = variable("impact", values, units, text)
    # the radius in the last half of the last contact, when that is rest
    rest, value, u_value = runs[-1], np.nan, np.nan
    if time[rest[-1]] - time[rest[0]] >= STILL:
        half = rest[time[rest] >= 0.5 * (time[rest[0]] + time[rest[-1]])]
        value = float(np.median(a[half]))
        u_value = float(np.hypot(max(np.std(a[half]), np.median(u[half])), relative * value))
    table |= with_u("static_radius", (), value, u_value, "m", "contact radius at rest")
    return xr.Dataset(table, coords={"impact": np.arange(1, len(brief) + 1)})


def edges_only(radius: xr.Dataset) -> tuple[int, int]:
    """Return the frames that were measured by the edge of the spot, and by fringes."""
    method = radius["method"].values
    return int(np.sum(method == EDGE)), int(np.sum((method == FRINGE_FIT) | (method == OPEN_GAP)))


def _contacts(time: Floats, is_seen: Flags, is_unknown: Flags) -> list[Integers]:
    """Group the frames with contact into contacts; damaged frames do not part them."""
    seen = np.flatnonzero(is_seen)
    if not len(seen):
        return []
    usual = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    late = np.diff(time[seen])
    is_new = (np.diff(seen) > _MISSED + 1) | (late > max(_GAP * usual, STILL / 2))
    is_new |= (np.diff(seen) > 1) & (late > (_MISSED + 1.5) * usual)
    shows = np.cumsum(~is_unknown)
    is_new &= (np.diff(shows[seen]) > 1) | (late > _HIDDEN * usual) | (np.diff(seen) == 1)
    return np.split(seen, np.flatnonzero(is_new) + 1)


def _brief_contacts(time: Floats, a: Floats, runs: list[Integers]) -> list[Integers]:
    """Return contacts that are impacts: neither rest nor a frame mistaken for a contact."""
    last = len(time) - 1
    brief = [run for run in runs if np.ptp(time[run]) < STILL and np.isfinite(a[run]).any()]
    shortest = min((np.ptp(time[run]) for run in brief if len(run) > 2), default=np.inf)
    brief = [run for run in brief if len(run) < 2 or np.diff(time[run]).max() <= shortest]
    longest, most = max((np.ptp(time[run]) for run in brief), default=0.0), max(map(len, brief), default=0)
    between = [time[min(run[-1] + 1, last)] - time[max(run[0] - 1, 0)] for run in brief]
    return [
        run
        for run, lasts in zip(brief, between, strict=True)
        if lasts >= _BRIEF * longest and not (len(run) == 1 and most >= _RESOLVED)
    ]


# Frames on either side of the largest and degree of the polynomial through them, the best first. In
# simulated impacts of four polymers at 10,000 frames a second five frames and degree 2, 3 lie 0.06,
# 0.03 % low (worst 0.16, 0.10), seven and degree 4 0.01 % high (worst 0.09); noise of 1 µm scatters
# all of them by 0.07 to 0.08 %.
_FITS = ((3, 4), (2, 3), (1, 2))
_CHANCE = 0.1  # of the steps between the frames at the largest, what a single fit leaves open
_REAL = 1e-9  # imaginary part of a root that is real


class Peak(NamedTuple):
    """The largest radius [m] of an impact, its time [s], and two standard uncertainties of it.

    ``u`` is that of the frames, ``sampling`` that of the course between them.
    """

    time: float
    radius: float
    u: float
    sampling: float = 0.0


def peak_of(time: Floats, a: Floats, u: Floats) -> Peak:
    """Find the largest radius by a polynomial through a² of the frames around the largest.

    a² goes with the approach, which passes its largest value smoothly; a itself does not. How far a fit of fewer
    frames and lower degree ends elsewhere is the uncertainty between the frames.
    """
    is_known = np.isfinite(a)
    time, a, u = time[is_known], a[is_known], u[is_known]
    top, n, found = int(np.argmax(a)), len(a), list[Peak]()
    for by, degree in _FITS:
        # where frames beside the largest are missing, the nearest, wherever they are
        low = max(0, min(top - by, n - 2 * by - 1))
        x, near, own = (values[low : low + 2 * by + 1] for values in (time - time[top], a, u))
        if n <= 2 * by:
            continue
        scale = float(np.max(np.abs(x)))
        fit = np.polyfit(x / scale, near**2, degree, w=1 / np.maximum(2 * near * own, 1e-18))
        slope = np.polyder(fit)
        roots = [float(root.real) for root in np.roots(slope) if abs(root.imag) < _REAL and abs(root.real) <= 1.0]
        tops = [root for root in roots if np.polyval(np.polyder(slope), root) < 0.0]
        if tops:
            place = min(tops, key=abs)
            rest = near - np.sqrt(np.maximum(np.polyval(fit, x / scale), 0))
            scatter = float(np.sqrt(np.sum(rest**2) / max(2 * by - degree, 1)))
            value = float(np.sqrt(np.polyval(fit, place)))
            found.append(Peak(float(time[top] + place * scale), value, max(float(u[top]), scatter)))
    alone = Peak(float(time[top]), float(a[top]), float(u[top]))
    best, lower = [*found, alone, alone][:2]
    # of a single frame the steps to its neighbours; a fit may cross the next one by chance
    least = (1.0, _CHANCE, 0.0)[min(len(found), 2)] * float(np.ptp(a[max(0, top - 1) : top + 2])) / np.sqrt(12.0)
    return best._replace(sampling=max(abs(best.radius - lower.radius) / np.sqrt(3.0), least))


_ALL_OVER = 7  # frames that stand for a film without impacts
_NEIGHBOURS = 3  # frames before and after an impact, which show that there is no contact


def keys(film: Path, radius: xr.Dataset, impacts: xr.Dataset | None, *, settings: ContactArea) -> xr.Dataset:
    """Copy frames with the fitted circles: those of the impacts, and at rest; without impacts, all over."""
    source = film_of(film, settings)
    sound = np.flatnonzero(radius["valid"].values)
    spread = sound[np.linspace(0, len(sound) - 1, min(_ALL_OVER, len(sound))).round().astype(int)]
    wanted = spread.tolist() if impacts is None else _of_impacts(radius, impacts)
    near = [i for i in wanted if source.valid[int(radius["frame"][i])]]
    found = key_frames(source, [int(radius["frame"][i]) for i in near])
    return with_circles(found, radius.isel(frame=near)).assign_attrs(work=json.dumps({"key_frames": len(near)}))


def with_circles(keys: xr.Dataset, at: xr.Dataset) -> xr.Dataset:
    """Add to key frames the circles that ``at``, the radii of the same frames, holds."""
    size = float(at["pixel_size"])
    for name, values, units, text in (
        ("circle_x", at["centre_x"].values, "px", "column of the fitted centre"),
        ("circle_y", at["centre_y"].values, "px", "row of the fitted centre"),
        ("circle_radius", at["radius"].values / size, "px", "fitted radius"),
        ("circle_major", at["semi_axis_major"].values / size, "px", "fitted major semi-axis"),
        ("circle_minor", at["semi_axis_minor"].values / size, "px", "fitted minor semi-axis"),
        ("circle_angle", at["axis_angle"].values, "rad", "direction of the major axis"),
        ("key_method", at["method"].values.astype(float), "1", "method of the radius"),
    ):
        keys[name] = variable("key", values, units, text)
    u = np.hypot(at["u_radius"].values, at["radius_systematic"].values)
    return keys.assign(with_u("key_radius", "key", at["radius"].values, u, "m", "contact radius"))


def _of_impacts(radius: xr.Dataset, impacts: xr.Dataset) -> list[int]:
    """Choose the frames of the impacts with their neighbours, and one at rest, as many as a strip holds."""
    time, contacts = radius["time"].values, np.flatnonzero(radius["in_contact"].values)
    events = np.stack([impacts[name].values for name in ("first_seen", "peak_time", "last_seen")])
    always = contacts[np.argmin(np.abs(time[contacts] - events[..., None]), axis=-1)]
    around = {i for a, _, b in always.T for i in range(max(a - _NEIGHBOURS, 0), min(b + _NEIGHBOURS + 1, time.size))}
    chosen, rest = set(always.ravel().tolist()), int(contacts[-1])
    if np.isfinite(float(impacts["static_radius"])):
        chosen.add(rest)
        around = {i for i in around if i < rest}
    return thinned(around, chosen)

"""Contact area: the radius of the contact over time from a film under the disc.

Each impact is counted from its largest radius (t_p = 0), as in the thesis.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.polynomial import Polynomial

import calibration
from calibration import camera as camera_scale
from labpipe import imaging
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.variables import variable, with_u
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.film_checks import light_of, said_by_file
from pipelines.experiments.shared.film_frames import film_of, key_frames, meanings, recorded_on, thinned

STILL = 20e-3  # s of contact after which it is rest, not an impact
WINDOW = 3e-3  # s around the largest radius in which film and model are compared


@dataclass(frozen=True, slots=True)
class Reading:
    """How contacts are told apart in a film, and their largest radius found; px, frames.

    ``fits``: frames on either side of the largest and degree of the polynomial through them, the best first. In
    simulated impacts of four polymers at 10,000 frames a second five frames and degree 2, 3 lie 0.06, 0.03 % low (worst
    0.16, 0.10), seven and degree 4 0.01 % high (worst 0.09); noise of 1 µm scatters all of them by 0.07 to 0.08 %.
    """

    least_region: int = 32  # below it no contact with a ring would fit
    gap: float = 4.0  # usual intervals between two frames that end a contact even when both see one
    missed: int = 2  # without contact within one: a flight lasts longer
    brief: float = 0.3  # of the usual length that an impact has at least: slower ones last longer
    resolved: int = 3  # of an impact, from which single frames elsewhere are not impacts
    fits: tuple[tuple[int, int], ...] = ((3, 4), (2, 3), (1, 2))
    chance: float = 0.1  # of the steps between the frames at the largest, what a single fit leaves open
    beside: int = 3  # before and after an impact, which show that there is no contact


_READING = Reading()


def radius(film: Path, record: Path, *, settings: ContactArea, full: bool) -> xr.Dataset:
    """Measure the contact radius while there may be contact; in every frame if full."""
    source = film_of(film, settings)
    known, day = calibration.load_record(record), settings.measured_on
    size, checked = camera_scale.image_scale(known, settings.view, measured=day, recorded=recorded_on(source))
    sphere, light, exposure = settings.sphere.radius, settings.wavelength, settings.exposure
    seen, left, top = source, 0, 0
    if settings.region is not None:
        shape, corners = np.array(source.shape[:0:-1]), np.array(settings.region)  # x, y
        low, high = corners.min(axis=0), corners.max(axis=0)
        part = f"region: the part from ({', '.join(f'{c:g}' for c in low)}) to ({', '.join(f'{c:g}' for c in high)})"
        images = f"the images, {shape[0]} px wide and {shape[1]} px high"
        if (high > shape).any():
            swapped = ": x and y are exchanged" if (high[::-1] <= shape).all() else ""
            text = f"{part} reaches beyond {images}{swapped}; give px of the images, x to the right and y down"
            raise InputError(text).because("region")
        begin, end = np.floor(low).astype(int), np.minimum(np.ceil(high) + 1, shape).astype(int)
        if (end - begin).min() < _READING.least_region:
            least = f"less than {_READING.least_region} px wide or high"
            raise InputError(f"{part} of {images}, is {least}; draw it around the contact with its rings")
        (left, top), (right, bottom) = begin.tolist(), end.tolist()
        seen = source.roi(slice(top, bottom), slice(left, right))
    found = imaging.contact_radius(
        seen,
        size.value,
        sphere.value,
        None if light is None else light.value,
        None if exposure is None else exposure.value,
        full=full,
        u_pixel_size=size.u,
        u_sphere_radius=sphere.u,
        u_wavelength=0.0 if light is None else light.u,
    )
    found = found.assign_coords(time=variable("frame", source.time, "s", "time in the film"))
    found["centre_x"].values += left
    found["centre_y"].values += top
    return found.assign(with_u("pixel_size", (), size.value, size.u, "m/px", "length of one pixel")).assign_attrs(
        budget=json.dumps(checked.pop("budget")),
        calibration=json.dumps(checked, ensure_ascii=False),
        u_systematic_relative=size.u / size.value,
        light=light_of(seen),
        said_by_file=said_by_file(source),
    )


def impacts(radius: xr.Dataset, *, settings: ContactArea) -> xr.Dataset:
    """Find the first three impacts with their largest radius, and the radius at rest."""
    time, a, u = (radius[name].values for name in ("time", "radius", "u_radius"))
    seen = radius["in_contact"].values.astype(bool)
    # damaged frames do not part a contact; an impact is neither rest nor a frame mistaken for a contact
    lost = ~(seen | ~radius["valid"].values.astype(bool)) if "valid" in radius else ~seen
    frames, usual = np.flatnonzero(seen), float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    late, missed = np.diff(time[frames]), np.diff(np.cumsum(lost)[frames])
    is_new = (missed > _READING.missed) | (late > max(_READING.gap * usual, STILL / 2))
    is_new |= (missed > 0) & (late > (_READING.missed + 1.5) * usual)
    runs = np.split(frames, np.flatnonzero(is_new) + 1) if len(frames) else []
    brief = [run for run in runs if np.ptp(time[run]) < STILL and np.isfinite(a[run]).any()]
    if max(map(len, brief), default=0) >= _READING.resolved:
        brief = [run for run in brief if len(run) > 1]
    least = _READING.brief * float(np.median([np.ptp(time[run]) for run in brief])) if brief else 0.0
    around = [time[[max(run[0] - 1, 0), min(run[-1] + 1, len(time) - 1)]] for run in brief]
    brief = [run for run, ends in zip(brief, around, strict=True) if np.ptp(ends) >= least]
    if not any(np.isfinite(a[run]).any() for run in runs):
        raise InputError(f"{radius.attrs['note']}; check the view under the disc, its scale and the wavelength")
    brief, shared = brief[:IMPACTS], radius["radius_systematic"].values / a
    relative = float(np.nanmedian(shared)) if np.isfinite(shared).any() else 0.0
    peaks = [(*peak_of(time[run], a[run], u[run]), time[run[0]], time[run[-1]]) for run in brief]
    when, largest, own, sampling, first, last = np.array(peaks).reshape(-1, 6).T
    u_largest = np.linalg.norm([own, sampling, relative * largest], axis=0)
    table = with_u("peak_radius", "impact", largest, u_largest, "m", "largest contact radius, Hertz-equivalent")
    text = "part of that uncertainty from interpolation between the frames"
    table["peak_sampling"] = variable("impact", sampling, "m", text)
    table["peak_time"] = variable("impact", when, "s", "time of the largest radius")
    table["first_seen"] = variable("impact", first, "s", "first frame with contact")
    table["last_seen"] = variable("impact", last, "s", "last frame with contact")
    # the radius in the last half of the last contact, when that is rest
    rest, value, u_value = runs[-1], np.nan, np.nan
    if np.ptp(time[rest]) >= STILL:
        half = rest[time[rest] >= 0.5 * (time[rest[0]] + time[rest[-1]])]
        value = float(np.median(a[half]))
        u_value = float(np.hypot(max(np.std(a[half]), np.median(u[half])), relative * value))
    table |= with_u("static_radius", (), value, u_value, "m", "contact radius at rest")
    return xr.Dataset(table, coords={"impact": np.arange(1, len(brief) + 1)})


def edges_only(radius: xr.Dataset) -> tuple[int, int]:
    """Return the frames that were measured by the edge of the spot, and by fringes."""
    method = meanings(radius["method"])
    return int(np.sum(method == "edge")), int(np.isin(method, ("fringe_fit", "fringe_fit_open_gap")).sum())


def peak_of(time: Floats, a: Floats, u: Floats) -> tuple[float, float, float, float]:
    """Find the largest radius [m] of an impact by a polynomial through a² of the frames around the largest.

    a² goes with the approach, which passes its largest value smoothly; a itself does not. Returned are its time [s], it
    and two standard uncertainties: that of the frames, and that of the course between them, by how far a fit of fewer
    frames and lower degree ends elsewhere.
    """
    is_known = np.isfinite(a)
    time, a, u = time[is_known], a[is_known], u[is_known]
    top, n, found = int(np.argmax(a)), len(a), []
    for by, degree in (fit for fit in _READING.fits if n > 2 * fit[0]):
        # where frames beside the largest are missing, the nearest, wherever they are
        low = max(0, min(top - by, n - 2 * by - 1))
        x, near, own = (values[low : low + 2 * by + 1] for values in (time - time[top], a, u))
        square = Polynomial.fit(x, near**2, degree, w=1 / np.maximum(2 * near * own, 1e-18))
        roots = square.deriv().roots()
        tops = roots.real[np.isreal(roots) & (np.abs(roots) <= np.abs(x).max()) & (square.deriv(2)(roots.real) < 0.0)]
        if tops.size:
            place = float(tops[np.argmin(np.abs(tops))])
            rest = near - np.sqrt(np.maximum(square(x), 0))
            scatter = float(np.sqrt(np.sum(rest**2) / max(2 * by - degree, 1)))
            found.append((time[top] + place, float(np.sqrt(square(place))), max(float(u[top]), scatter)))
    # of a single frame the steps to its neighbours; a fit may cross the next one by chance
    left_open = (1.0, _READING.chance, 0.0)[min(len(found), 2)]
    least = left_open * float(np.ptp(a[max(0, top - 1) : top + 2])) / np.sqrt(12.0)
    alone = (time[top], float(a[top]), float(u[top]))
    best, lower = [*found, alone, alone][:2]
    return *best, max(abs(best[1] - lower[1]) / np.sqrt(3.0), least)


def keys(film: Path, radius: xr.Dataset, impacts: xr.Dataset | None, *, settings: ContactArea) -> xr.Dataset:
    """Copy frames for the page: those of the impacts and beside, and at rest; without impacts, all over."""
    around, always = set(np.flatnonzero(radius["valid"].values).tolist()), set[int]()
    if impacts is not None:
        time, contacts = radius["time"].values, np.flatnonzero(radius["in_contact"].values)
        events = np.stack([impacts[name].values for name in ("first_seen", "peak_time", "last_seen")])
        at = contacts[np.argmin(np.abs(time[contacts] - events[..., None]), axis=-1)]
        always, rest = set(at.ravel().tolist()), int(contacts[-1])
        first, last = np.maximum(at[0] - _READING.beside, 0), np.minimum(at[-1] + _READING.beside + 1, time.size)
        around = {i for ends in zip(first.tolist(), last.tolist(), strict=True) for i in range(*ends)}
        if np.isfinite(float(impacts["static_radius"])):
            always.add(rest)
            around = {i for i in around if i < rest}
    return key_frames(film_of(film, settings), radius["frame"].values[thinned(around, always)])

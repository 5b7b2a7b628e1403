"""Contact area: the radius of the contact over time from a film under the disc, and the model.

Each impact is counted from its largest radius (t_p = 0), as in the thesis; film and model are laid
over each other there.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import calibration
from calibration import camera as camera_scale
from labpipe import contact, imaging
from labpipe.contact.sphere import hertz
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.uncertainty import Source, combined, table
from pipelines.experiments.film_frames import key_frames, open_film, recorded_on
from pipelines.experiments.material import resolve, variations
from pipelines.experiments.plate import resolve_plate
from pipelines.settings.contact_area import ContactArea

Array = NDArray[np.float64]

_IMPACTS = 3  # the thesis analyses the first three
_STILL = 20e-3  # s of contact after which it is rest, not an impact
_GAP = 4.0  # usual intervals between two frames that end a contact even when both see one
_MISSED = 2  # frames without contact within one: a flight lasts longer
_BRIEF = 0.3  # an impact lasts at least this share of the longest: slower ones last longer
_SLOWEST = 3.0  # an impact lasts at most this many times the longest before: Hertz's fifth root
_RESOLVED = 3  # frames of an impact from which single frames elsewhere are not impacts
_STEP = 2e-5  # s, spacing of the model's curve
_WINDOW = 3e-3  # s around the largest radius in which film and model are compared
# Frames on either side of the largest and degree of the polynomial through them, the best first. In
# simulated impacts of four polymers at 10,000 frames a second five frames and degree 2, 3 lie 0.06,
# 0.03 % low (worst 0.16, 0.10), seven and degree 4 0.01 % high (worst 0.09); noise of 1 µm scatters
# all of them by 0.07 to 0.08 %.
_FITS = ((3, 4), (2, 3), (1, 2))
_BESIDE = _FITS[0][0]
_REAL = 1e-9  # imaginary part of a root that is real


class Peak(NamedTuple):
    """The largest radius [m] of an impact, its time [s], and two standard uncertainties of it.

    ``u`` is that of the frames, ``sampling`` that of the course between them.
    """

    time: float
    radius: float
    u: float
    sampling: float = 0.0


def radius(film: Path, record: Path, *, settings: ContactArea, full: bool) -> xr.Dataset:
    """Measure the contact radius while there may be contact; in every frame if full."""
    source = open_film(film, settings.frame_rate)
    known = calibration.load_record(record)
    day = settings.measured_on or recorded_on(source) or None
    size, checked = camera_scale.image_scale(known, settings.view, measured=day)
    sphere, light = settings.sphere.radius, settings.wavelength
    found = imaging.contact_radius(
        source, size.value, sphere.value, None if light is None else light.value,
        None if settings.exposure is None else settings.exposure.value,
        full=full, u_pixel_size=size.u, u_sphere_radius=sphere.u,
        u_wavelength=0.0 if light is None else light.u,
    )  # fmt: skip
    time = ("frame", source.time, {"units": "s", "long_name": "time in the film"})
    found = found.assign_coords(time=time)
    found["pixel_size"] = ((), size.value, {"units": "m/px", "long_name": "length of one pixel"})
    found["u_pixel_size"] = (
        (), size.u, {"units": "m/px", "long_name": "standard uncertainty: length of one pixel"},
    )  # fmt: skip
    return found.assign_attrs(
        scale_budget=json.dumps(checked.pop("budget")),
        calibration=json.dumps(checked, ensure_ascii=False),
        u_systematic_relative=size.u / size.value,
    )


def impacts(radius: xr.Dataset, *, settings: ContactArea) -> xr.Dataset:
    """Find the first three impacts with their largest radius, and the radius at rest."""
    del settings
    time, a = radius["time"].values, radius["radius"].values
    u = radius["u_radius"].values
    seen = radius["in_contact"].values.astype(bool)
    runs = _contacts(time, seen)
    if not any(np.isfinite(a[run]).any() for run in runs):
        message = (
            "no contact was found in the film; check the view under the disc, its scale and the "
            "wavelength"
        )
        raise InputError(message)
    brief = _brief_contacts(time, a, runs)[:_IMPACTS]
    peaks = [_peak(time[run], a[run], u[run]) for run in brief]
    shared = radius["radius_systematic"].values / a
    relative = float(np.nanmedian(shared)) if np.isfinite(shared).any() else 0.0
    table: dict[str, Any] = {}
    largest = np.array([p.radius for p in peaks])
    sampling = np.array([p.sampling for p in peaks])
    own = np.hypot([p.u for p in peaks], sampling)
    for name, values, units, text in (
        ("peak_time", np.array([p.time for p in peaks]), "s", "time of the largest radius"),
        ("peak_radius", largest, "m", "largest contact radius"),
        ("u_peak_radius", np.hypot(own, relative * largest), "m",
         "standard uncertainty: largest contact radius"),
        ("peak_sampling", sampling, "m",
         "part of that uncertainty that the course between the frames leaves"),
    ):  # fmt: skip
        table[name] = ("impact", values, {"units": units, "long_name": text})
    for name, place, text in (("first_seen", 0, "first"), ("last_seen", -1, "last")):
        table[name] = (
            "impact", np.array([time[run[place]] for run in brief], float),
            {"units": "s", "long_name": f"{text} frame with contact"},
        )  # fmt: skip
    table |= _at_rest(time, a, u, runs, relative)
    return xr.Dataset(table, coords={"impact": np.arange(1, len(brief) + 1)})


def _contacts(time: Array, is_seen: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Group the frames with contact into contacts."""
    seen = np.flatnonzero(is_seen)
    if not len(seen):
        return []
    usual = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
    late = np.diff(time[seen])
    is_new = (np.diff(seen) > _MISSED + 1) | (late > max(_GAP * usual, _STILL / 2))
    is_new |= (np.diff(seen) > 1) & (late > (_MISSED + 1.5) * usual)
    return np.split(seen, np.flatnonzero(is_new) + 1)


def _brief_contacts(
    time: Array, a: Array, runs: list[NDArray[np.int64]]
) -> list[NDArray[np.int64]]:
    """Contacts that are impacts: neither rest nor a single frame mistaken for a contact.

    The time of an impact hardly depends on its speed (Hertz: as its fifth root), and grows from
    bounce to bounce. What ends much sooner than others last, or shows in one frame where others
    show in several, is a shadow or a sphere that passes close by.
    """
    brief = [run for run in runs if time[run[-1]] - time[run[0]] < _STILL]
    brief = [run for run in brief if np.isfinite(a[run]).any()]
    brief = _without_rest(time, brief)
    longest = max((float(time[run[-1]] - time[run[0]]) for run in brief), default=0.0)
    most = max(map(len, brief), default=0)
    last = len(time) - 1

    def is_impact(run: NDArray[np.int64]) -> bool:
        between = time[min(run[-1] + 1, last)] - time[max(run[0] - 1, 0)]
        is_alone = len(run) == 1 and most >= _RESOLVED
        return bool(between >= _BRIEF * longest) and not is_alone

    return [run for run in brief if is_impact(run)]


def _without_rest(time: Array, brief: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """Leave out a contact that the film's end cuts off when it is too long for an impact."""
    last = len(time) - 1
    ended = [run for run in brief if run[-1] < last]
    if len(ended) in (0, len(brief)):
        return brief
    frame = float(np.median(np.diff(time)))
    longest = max(float(time[run[-1]] - time[run[0]]) for run in ended) + 2 * frame
    is_rest = float(time[last] - time[brief[-1][0]]) > _SLOWEST * longest
    return ended if is_rest else brief


def _peak(time: Array, a: Array, u: Array) -> Peak:
    """Find the largest radius by a polynomial through a² of the frames around the largest.

    a² goes with the approach, which passes its largest value smoothly; a itself does not. How far
    fewer frames and a lower degree end elsewhere tells what the frames leave open between them.
    """
    is_known = np.isfinite(a)
    time, a, u = time[is_known], a[is_known], u[is_known]
    top = int(np.argmax(a))
    found = [p for beside, degree in _FITS if (p := _fitted(time, a, u, top, beside, degree))]
    alone = Peak(float(time[top]), float(a[top]), float(u[top]))
    if not found:
        low, high = max(0, top - 1), min(len(a), top + 2)
        return alone._replace(sampling=float(np.ptp(a[low:high])) / np.sqrt(12.0))
    best, lower, *_ = *found, alone
    return best._replace(sampling=abs(best.radius - lower.radius) / np.sqrt(3.0))


def _fitted(time: Array, a: Array, u: Array, top: int, beside: int, degree: int) -> Peak | None:
    """Fit the frames beside the largest; nothing where they are too few or have no maximum."""
    low, high = top - beside, top + beside + 1
    if low < 0 or high > len(a):
        return None
    x, near = time[low:high] - time[top], a[low:high]
    scale = float(np.max(np.abs(x)))
    weights = 1 / np.maximum(2 * near * u[low:high], 1e-18)
    fit = np.polyfit(x / scale, near**2, degree, w=weights)
    place = _summit(fit)
    if place is None:
        return None
    rest = near - np.sqrt(np.maximum(np.polyval(fit, x / scale), 0))
    scatter = float(np.sqrt(np.sum(rest**2) / max(high - low - degree - 1, 1)))
    value = float(np.sqrt(np.polyval(fit, place)))
    return Peak(float(time[top] + place * scale), value, max(float(u[top]), scatter))


def _summit(polynomial: Array) -> float | None:
    """Return where a polynomial has its maximum between -1 and 1, the nearest to 0."""
    slope = np.polyder(polynomial)
    roots = [float(r.real) for r in np.roots(slope) if abs(r.imag) < _REAL]
    bend = np.polyder(slope)
    tops = [r for r in roots if abs(r) <= 1.0 and np.polyval(bend, r) < 0.0]
    return min(tops, key=abs) if tops else None


def _at_rest(
    time: Array, a: Array, u: Array, runs: list[NDArray[np.int64]], relative: float
) -> dict[str, Any]:
    """Radius in the last half of the last contact when that is rest; NaN otherwise."""
    last = runs[-1]
    value, own, start = np.nan, np.nan, np.nan
    if time[last[-1]] - time[last[0]] >= _STILL:
        half = last[time[last] >= 0.5 * (time[last[0]] + time[last[-1]])]
        value, start = float(np.median(a[half])), float(time[half[0]])
        scatter = float(np.std(a[half])) if len(half) > 1 else 0.0
        own = float(np.hypot(max(scatter, np.median(u[half])), relative * value))
    return {
        "static_radius": ((), value, {"units": "m", "long_name": "contact radius at rest"}),
        "u_static_radius": (
            (), own, {"units": "m", "long_name": "standard uncertainty: contact radius at rest"},
        ),
        "static_since": ((), start, {"units": "s", "long_name": "begin of the frames at rest"}),
    }  # fmt: skip


def model(
    radius: xr.Dataset,
    impacts: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    *,
    settings: ContactArea,
    full: bool = False,
) -> xr.Dataset:
    """Simulate the drop for as long as the film lasts after its first contact.

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    sphere, chosen = settings.sphere, settings.model
    solid = resolve(sphere, material_file, fitted)
    gravity = chosen.gravity.value
    fall = float(np.sqrt(2 * settings.height.value / gravity))
    begun = float(impacts["first_seen"][0]) if impacts.sizes["impact"] else 0.0
    duration = fall + float(radius["time"][-1]) - begun + 2 * _WINDOW
    made = contact.drop(
        solid, sphere.radius.value, sphere.mass.value, settings.height.value, duration,
        chosen.solver, chosen.profile, chosen.rtol, gravity=gravity,
        plate=resolve_plate(settings.plate, plate),
        times=np.arange(0.0, duration, _STEP),
        fold=not full, shortcuts=contact.Shortcuts.chosen(full=full),
    )  # fmt: skip
    largest = made["peak_contact_radius"].values
    sources = [
        s._replace(sensitivity=s.sensitivity * float(largest[0]))
        for s in _relative_sources(settings, material_file, fitted, solid, made)
    ] if largest.size else []  # fmt: skip
    relative = combined(sources) / float(largest[0]) if sources else 0.0
    made["u_peak_contact_radius"] = (
        "impact", relative * largest,
        {"units": "m", "long_name": "standard uncertainty from height, body and material: peak"},
    )  # fmt: skip
    made.attrs["budget"] = json.dumps(table(sources))
    weight = sphere.mass.value * gravity
    for name, modulus in (("relaxed", solid.E_relaxed), ("unrelaxed", solid.E_unrelaxed)):
        reduced = float(modulus) / (1 - float(solid.nu) ** 2)
        state = hertz.static_load(weight, sphere.radius.value, reduced)
        made[f"static_radius_{name}"] = (
            (), float(state.contact_radius),
            {"units": "m", "long_name": f"Hertz radius at rest with the {name} modulus"},
        )  # fmt: skip
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    made.attrs["work"] = json.dumps(work)
    return made


def _relative_sources(
    settings: ContactArea, material_file: Path | None, fitted: xr.Dataset | None, solid: Prony,
    made: xr.Dataset,
) -> list[Source]:  # fmt: skip
    """Return what makes the largest radius uncertain, relative to it.

    By the exponents of Hertz's impact, a ~ R^0.4 (m h)^0.2 E^-0.2, the modulus that at the
    frequency of the contact.
    """
    sphere = settings.sphere
    given = (("radius", sphere.radius, 0.4), ("mass", sphere.mass, 0.2),
             ("height", settings.height, 0.2))  # fmt: skip
    sources = [
        Source(name, q.value, q.u, q.si, power / q.value, "systematic") for name, q, power in given
    ]
    omega = np.pi / float(made["contact_duration"][0])
    stiffness = abs(complex(solid.complex_modulus(omega)))
    for name, (q, step, other) in variations(sphere, material_file, fitted).items():
        slope = -0.2 * float(np.log(abs(complex(other.complex_modulus(omega))) / stiffness)) / step
        unit = "K" if q.si == "degC" else q.si
        sources.append(Source(name, q.value, q.u, unit, slope, "systematic"))
    return sources


def comparison(
    radius: xr.Dataset, impacts: xr.Dataset, model: xr.Dataset, *, settings: ContactArea
) -> xr.Dataset:
    """Compare film and model around the largest radius of each impact."""
    del settings
    count = min(impacts.sizes["impact"], model.sizes["impact"])
    time, a = radius["time"].values, radius["radius"].values
    seen = radius["in_contact"].values.astype(bool)
    known = np.hypot(radius["u_radius"].values, radius["radius_systematic"].values)
    points: dict[str, list[Array]] = {
        "number": [], "since": [], "film": [], "u_film": [], "model": [],
    }  # fmt: skip
    errors, peak_times = [], []
    for i in range(count):
        peak = _model_peak(model, i)
        peak_times.append(peak)
        since = time - float(impacts["peak_time"][i])
        inside = (np.abs(since) < _WINDOW) & np.isfinite(a) & seen
        inside &= time >= float(impacts["first_seen"][i])
        inside &= time <= float(impacts["last_seen"][i])
        theirs = np.interp(since[inside] + peak, model["time"], model["contact_radius"])
        for key, values in (("number", np.full(inside.sum(), i + 1.0)), ("since", since[inside]),
                            ("film", a[inside]), ("u_film", known[inside]),
                            ("model", theirs)):  # fmt: skip
            points[key].append(values)
        spread = max(float(np.max(a[inside])), 1e-12)
        errors.append(float(np.sqrt(np.mean((a[inside] - theirs) ** 2))) / spread)
    joined = {k: np.concatenate(v) if v else np.empty(0) for k, v in points.items()}
    ours, theirs = (
        impacts["peak_radius"].values[:count],
        model["peak_contact_radius"].values[:count],
    )
    u = np.hypot(impacts["u_peak_radius"].values[:count],
                 model["u_peak_contact_radius"].values[:count])  # fmt: skip
    return xr.Dataset(
        {
            "impact_number": ("sample", joined["number"],
                              {"units": "1", "long_name": "impact of a compared frame"}),
            "since_peak": ("sample", joined["since"],
                           {"units": "s", "long_name": "time since the largest radius"}),
            "film": ("sample", joined["film"],
                     {"units": "m", "long_name": "contact radius, film"}),
            "u_film": ("sample", joined["u_film"],
                       {"units": "m", "long_name": "standard uncertainty: contact radius, film"}),
            "model": ("sample", joined["model"],
                      {"units": "m", "long_name": "contact radius, model"}),
            "nrmse": ("impact", np.array(errors),
                      {"units": "1", "long_name": "root-mean-square error over largest radius"}),
            "peak_radius_film": ("impact", ours,
                                 {"units": "m", "long_name": "largest radius, film"}),
            "peak_radius_model": ("impact", theirs,
                                  {"units": "m", "long_name": "largest radius, model"}),
            "peak_radius_difference": ("impact", ours - theirs,
                                       {"units": "m", "long_name": "film minus model"}),
            "u_peak_radius_difference": ("impact", u,
                                         {"units": "m", "long_name": "standard uncertainty"}),
            "model_peak_time": ("impact", np.array(peak_times),
                                {"units": "s", "long_name": "time of the model's largest radius"}),
        },
        coords={"impact": np.arange(1, count + 1)},
    )  # fmt: skip


def _model_peak(model: xr.Dataset, impact: int) -> float:
    """Time of the model's largest radius in one impact."""
    time = model["time"].values
    touch = model["impact_time"].values
    end = touch[impact + 1] if impact + 1 < len(touch) else time[-1]
    end = min(end, touch[impact] + _STILL)
    inside = np.flatnonzero((time >= touch[impact]) & (time <= end))
    a = model["contact_radius"].values
    top = inside[int(np.argmax(a[inside]))]
    low, high = max(top - _BESIDE, 0), min(top + _BESIDE + 1, len(a))
    return _peak(time[low:high], a[low:high], np.full(high - low, 1e-9)).time


def keys(
    film: Path, radius: xr.Dataset, impacts: xr.Dataset, *, settings: ContactArea
) -> xr.Dataset:
    """Copy key frames with the fitted circles: around each largest radius, and at rest."""
    source = open_film(film, settings.frame_rate)
    time, seen = radius["time"].values, radius["in_contact"].values.astype(bool)
    wanted: set[int] = set()
    for i in range(impacts.sizes["impact"]):
        inside = np.flatnonzero(
            seen & (time >= float(impacts["first_seen"][i]))
            & (time <= float(impacts["last_seen"][i]))
        )  # fmt: skip
        top = int(inside[np.argmin(np.abs(time[inside] - float(impacts["peak_time"][i])))])
        wanted |= {int(inside[0]), top, int(inside[-1])}
    if np.isfinite(float(impacts["static_radius"])):
        wanted.add(int(np.flatnonzero(seen)[-1]))
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
        ("key_radius", at["radius"].values, "m", "contact radius"),
        ("u_key_radius", np.hypot(at["u_radius"].values, at["radius_systematic"].values), "m",
         "standard uncertainty: contact radius"),
        ("key_method", at["method"].values.astype(float), "1", "how the radius was found"),
    ):  # fmt: skip
        found[name] = ("key", values, {"units": units, "long_name": text})
    return found.assign_attrs(work=json.dumps({"key_frames": len(near)}))

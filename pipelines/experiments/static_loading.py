"""Static loading: approach and contact radius of a sphere while loads are added, and its creep.

Conventions: the approach counts downwards from first touch; a load is all that rests on the disc.
Under loads that are only added to the contact only grows, and Lee and Radok's form is exact,

    δ^{3/2} = (3 / (4 √R)) ∫ J*(t − s) dF(s),     a = √(R δ),

for any creep compliance J*. It makes the sensor's reading at first touch follow from the loads,
and gives the compliance itself, with no material assumed.

References
----------
Thesis section 3.3.4; E. H. Lee & J. R. M. Radok, J. Appl. Mech. 27 (1960) 438,
https://doi.org/10.1115/1.3644020.
"""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar, nnls

import calibration
from calibration import laser
from labpipe import contact
from labpipe.contact import hertz
from labpipe.errors import InputError
from labpipe.signals.noise import estimate_noise
from labpipe.uncertainty import Source, table
from labpipe.units import Quantity
from pipelines.experiments.laser_file import read_laser
from pipelines.experiments.material import resolve
from pipelines.settings.static_loading import StaticLoading

Array = NDArray[np.float64]

_TERMS_PER_DECADE = 2  # of the creep compliance that is fitted
_SIDE = 4  # readings on either side of a step
_CLEAR = 5.0  # standard deviations by which a step must stand out
_MORE = 0.1  # of the smallest step that was found, above which another one counts
_ELAPSED = 60  # points of the compliance curve
_STEP_POINTS = 80  # of the simulation in one load step, evenly in the logarithm of time
_SMOOTH = 60.0  # s, the moving average of the thesis's smoothed curve
_FIRST = 0.5  # s under a load at which the simulation is first asked
_TOLERANCE = 1e-5  # of the record's range, to which first touch is searched
_MISFIT = 1.5  # times the noise, above which the creep fit does not describe the record
_WIDEST = 1e4  # times the noise, the search for a misfit that grows ends


def readings(path: Path, *, settings: StaticLoading) -> xr.Dataset:
    """Read the laser's export; what it leaves unsaid comes from the settings."""
    return read_laser(path, settings.keyence)


def displacement(readings: xr.Dataset, record: Path, *, settings: StaticLoading) -> xr.Dataset:
    """Correct the inclination: displacement downwards, from the sensor's zero or first touch."""
    known = calibration.load_record(record)
    if settings.sensor.serial is not None:
        readings = readings.assign_attrs(serial=settings.sensor.serial)
    moved = laser.displacement(
        readings, known, output=settings.sensor.output, direction=-settings.sensor.direction,
        measured=settings.measured_on, zero=0.0 if settings.zero is None else settings.zero,
    )  # fmt: skip
    short = moved["time"].values[-1] < settings.steps.window.value
    if int(moved["valid"].sum()) < 2 * _SIDE * len(settings.loads) or short:
        message = (
            f"the record holds {int(moved['valid'].sum())} valid readings over "
            f"{float(moved['time'][-1]):.4g} s, too few for {len(settings.loads)} loads"
        )
        raise InputError(message)
    return moved


def steps(displacement: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Find when each load was put on, and the reading at first touch."""
    time, moved = _valid(displacement)
    noise = _noise(moved)
    starts, sizes = _starts(time, moved, noise, settings)
    masses = [load.mass for load in settings.loads]
    gravity = settings.model.gravity
    force = np.array([m.value for m in masses]) * gravity.value
    u_force = np.array([np.hypot(m.u / m.value, gravity.u / gravity.value) for m in masses]) * force
    given = [np.nan if load.time is None else load.time.value for load in settings.loads]
    ends = np.append(starts[1:], time[-1])
    table = {
        "begin": (starts, "s", "time at which the load was put on"),
        "end": (ends, "s", "time at which the next one was, or the record ends"),
        "given_time": (np.array(given), "s", "time that session.toml gives"),
        "jump": (sizes, "m", "displacement across the step"),
        "force": (force, "N", "load"),
        "u_force": (u_force, "N", "standard uncertainty: load"),
    }
    result = xr.Dataset(
        {n: ("load", v, {"units": u, "long_name": t}) for n, (v, u, t) in table.items()},
        coords={"load": np.arange(1, starts.size + 1)},
    )
    touch = _first_touch(displacement, noise, result, settings)
    return result.merge(touch).assign_attrs(touch.attrs)


def _valid(displacement: xr.Dataset) -> tuple[Array, Array]:
    usable = displacement["valid"].values.astype(bool)
    return displacement["time"].values[usable], displacement["displacement"].values[usable]


def _noise(moved: Array) -> float:
    found = estimate_noise(moved)
    return float(max(found.sigma, found.step / np.sqrt(12)))


def _starts(
    time: Array, moved: Array, noise: float, settings: StaticLoading
) -> tuple[Array, Array]:
    """Return begin and size of every step; the first load is on from the beginning."""
    padded = np.lib.stride_tricks.sliding_window_view(moved, _SIDE)
    level = np.median(padded, axis=1)
    place = np.arange(_SIDE, moved.size - _SIDE + 1)
    jump = level[place] - level[place - _SIDE]
    gap = _SIDE * 2
    starts, sizes = [float(time[0])], [np.nan]
    free = np.ones(place.size, dtype=bool)
    wanted = settings.loads[1:]
    # steps with a given time first: their places are then taken
    for load in sorted(wanted, key=lambda each: each.time is None):
        inside = free.copy()
        if load.time is not None:
            inside &= np.abs(time[place] - load.time.value) <= settings.steps.search.value
        best = int(np.argmax(np.where(inside, jump, -np.inf)))
        if not inside.any() or jump[best] < _CLEAR * noise:
            where = (
                f"within {settings.steps.search.value:g} s of {load.time.value:g} s"
                if load.time is not None
                else "in the record"
            )
            message = (
                f"no step of the displacement was found {where} for the load "
                f"{load.mass.value:g} kg; check times and number of the loads, and the sensor's "
                "direction"
            )
            raise InputError(message)
        at = _sharpened(moved, int(place[best]))
        # the load came between two readings
        starts.append(0.5 * float(time[at - 1] + time[at]))
        sizes.append(float(jump[best]))
        free[max(0, best - gap) : best + gap + 1] = False
    _warn_of_more(time[place[free]], jump[free], sizes[1:], noise)
    order = np.argsort(starts)
    tolerance = 0.5 * settings.steps.search.value
    late = [
        f"{load.mass.value:g} kg: {start:.0f} s, given {load.time.value:.0f} s"
        for load, start in zip(settings.loads, np.array(starts)[order], strict=True)
        if load.time is not None and abs(start - load.time.value) > tolerance
    ]
    if late:
        warnings.warn(
            "loads were put on at other times than given; the times found are used: "
            + "; ".join(late),
            stacklevel=2,
        )
    return np.array(starts)[order], np.array(sizes)[order]


def _warn_of_more(time: Array, jump: Array, found: list[float], noise: float) -> None:
    """Say that the record steps where no load is stated; a load left out spoils all others."""
    if not (found and jump.size):
        return
    largest = int(np.argmax(jump))
    if jump[largest] > max(_CLEAR * noise, _MORE * min(found)):
        warnings.warn(
            f"the displacement steps by {jump[largest]:.3g} m at {time[largest]:.0f} s, where no "
            f"load is stated ({len(found) + 1} are); state every load that was put on, in its own "
            "[[loads]]",
            stacklevel=3,
        )


def _sharpened(moved: Array, near: int) -> int:
    """Return the first reading behind a step: the split with the least absolute misfit.

    A hand may disturb a reading next to the step; medians and absolute values forgive it.
    """
    low, high = max(near - 2 * _SIDE, 0), min(near + 2 * _SIDE, moved.size)
    before, after = np.median(moved[low : near - 1]), np.median(moved[near + 1 : high])
    splits = range(max(near - _SIDE // 2, low + 1), min(near + _SIDE // 2, high - 1) + 1)
    return min(splits, key=lambda k: float(
        np.abs(moved[low:k] - before).sum() + np.abs(moved[k:high] - after).sum()
    ))  # fmt: skip


def settled(time: Array, table: xr.Dataset, settings: StaticLoading) -> NDArray[np.bool_]:
    """Return which readings lie far enough from every step."""
    spacing = float(np.median(np.diff(time)))
    kept = np.ones(time.size, dtype=bool)
    for begin in table["begin"].values:
        since = time - begin
        kept &= (since < -spacing) | (since > settings.steps.settle.value)
    return kept


def _creep_design(time: Array, table: xr.Dataset, radius: float) -> tuple[Array, Array]:
    """Return approach^{3/2} under unit compliances: instantaneous, and creep with each time tau."""
    begin = table["begin"].values
    added = np.diff(table["force"].values, prepend=0.0)
    spacing, whole = float(np.median(np.diff(time))), float(time[-1] - begin[0])
    decades = np.log10(whole / spacing)
    tau = np.geomspace(spacing, whole, int(decades * _TERMS_PER_DECADE) + 1)
    since = np.maximum(time[:, None] - begin, 0.0)
    columns = [(added * (since > 0)).sum(axis=1)]
    columns += [(-added * np.expm1(-since / each)).sum(axis=1) for each in tau]
    return 0.75 / np.sqrt(radius) * np.column_stack(columns), tau


class _TouchFit:
    """The creep fit as a function of the displacement at first touch; see :func:`_first_touch`."""

    def __init__(self, rows: Array, design: Array) -> None:
        self.rows, self.design = rows, design

    def solve(self, touch: float) -> tuple[Array, float]:
        """Return the compliance's weights and the sum of squares [m²] of the approach's misfit."""
        depth = np.maximum(self.rows - touch, 1e-9)
        # the power 3/2 is linear in the compliance; its derivative brings the misfit back to m
        weight = 1 / (1.5 * np.sqrt(depth))
        scale = np.abs(self.design).max(axis=0)
        answer, misfit = nnls(self.design / scale * weight[:, None], depth**1.5 * weight)
        return answer / scale, misfit**2

    def best(self) -> float:
        """Return the displacement of least misfit."""
        high = float(self.rows.min())
        low = high - float(np.ptp(self.rows))
        found = minimize_scalar(
            lambda touch: self.solve(touch)[1], bounds=(low, high), method="bounded",
            options={"xatol": _TOLERANCE * float(np.ptp(self.rows))},
        )  # fmt: skip
        return float(found.x)


def _first_touch(
    displacement: xr.Dataset, noise: float, table: xr.Dataset, settings: StaticLoading
) -> xr.Dataset:
    """Return the displacement at first touch and the creep compliance that fits with it.

    Two nested least squares: for every position of first touch the compliance is a sum of creep
    terms with weights of at least zero; the position is that of the least misfit. Its uncertainty
    holds the misfit's curvature, the sensor's drift and the loads.
    """
    time, moved = _valid(displacement)
    used = settled(time, table, settings)
    elapsed, rows = time[used], moved[used]
    design, tau = _creep_design(elapsed, table, settings.sphere.radius.value)
    fit = _TouchFit(rows, design)
    if settings.zero is None:
        touch = fit.best()
        weights, misfit = fit.solve(touch)
        scatter = _scatter(misfit, weights, rows.size)
        drift = settings.steps.drift.value * elapsed / float(time[-1])
        changes = [_TouchFit(rows + drift, design).best()] if settings.steps.drift.value else []
        for i, u in enumerate(table["u_force"].values):
            if u > 0:
                force = table["force"].values.copy()
                force[i] += u
                other = table.assign(force=("load", force))
                again, _ = _creep_design(elapsed, other, settings.sphere.radius.value)
                changes.append(_TouchFit(rows, again).best())
        own = _u_from_curvature(fit, touch, max(noise, scatter))
        u, how = float(np.sqrt(own**2 + sum((c - touch) ** 2 for c in changes))), "from the loads"
    else:
        touch, how = 0.0, "given in session.toml"
        factor = float(displacement["gain"]) / np.cos(float(displacement["inclination"]))
        u = settings.zero.u * factor
        weights, misfit = fit.solve(touch)
        scatter = _scatter(misfit, weights, rows.size)
    if scatter > _MISFIT * noise:
        warnings.warn(
            f"the record differs from any creep under these loads by {scatter * 1e6:.2g} µm, "
            f"{scatter / noise:.1f} times its noise: a load, a time or the zero cannot be right, "
            "or something else than the contact moved",
            stacklevel=2,
        )
    lag = np.geomspace(settings.steps.settle.value + 1.0, float(time[-1] - time[0]), _ELAPSED)
    terms = np.column_stack([np.ones(lag.size), -np.expm1(-lag[:, None] / tau)])
    scalars = {
        "touch": (touch, "m", "displacement at first touch"),
        "u_touch": (u, "m", "standard uncertainty: displacement at first touch"),
        "scatter": (scatter, "m", "root mean square misfit of the creep fit"),
        "noise": (noise, "m", "noise of a reading"),
    }
    return xr.Dataset(
        {n: ((), v, {"units": unit, "long_name": t}) for n, (v, unit, t) in scalars.items()}
        | {
            "compliance": (
                "elapsed", terms @ weights,
                {"units": "1/Pa", "long_name": "reduced creep compliance, from the record"},
            ),
        },
        coords={
            "elapsed": ("elapsed", lag, {"units": "s", "long_name": "time under load"}),
        },
        attrs={
            "touch": how,
            "work": json.dumps({"fit_rows": int(rows.size), "fit_terms": int(tau.size + 1)}),
        },
    )  # fmt: skip


def _scatter(misfit: float, weights: Array, n_rows: int) -> float:
    return float(np.sqrt(misfit / max(n_rows - int((weights > 0).sum()) - 1, 1)))


def _u_from_curvature(fit: _TouchFit, touch: float, noise: float) -> float:
    """Return the shift at which the misfit has grown by one variance, the mean of both sides."""
    least = fit.solve(touch)[1]
    step = noise
    sides = []
    for sign in (-1.0, 1.0):
        rise = 0.0
        width = step
        while rise < noise**2 and width < _WIDEST * noise:
            width *= 2.0
            rise = fit.solve(touch + sign * width)[1] - least
        # a parabola through the least and this point
        sides.append(width * noise / np.sqrt(max(rise, 1e-3 * noise**2)))
    return float(np.mean(sides))


_LEVELS = {
    "approach": ("m", "approach at the end of the load"),
    "contact_radius": ("m", "contact radius at the end of the load, from the approach"),
    "mean_radius": ("m", "contact radius, mean over the load"),
    "creep": ("m", "growth of the approach under the load, first to last window"),
}


def approach(displacement: xr.Dataset, steps: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Return approach and contact radius over time, and their levels and creep under each load."""
    time, moved = _valid(displacement)
    depth = moved - float(steps["touch"])
    radius = settings.sphere.radius
    relative = float(displacement.attrs["u_systematic_relative"])
    noise, u_touch = float(steps["noise"]), float(steps["u_touch"])
    wander = settings.steps.drift.value * time / float(time[-1])
    u_depth = np.sqrt(u_touch**2 + (relative * depth) ** 2 + wander**2)
    a = np.sqrt(radius.value * np.maximum(depth, 0.0))
    rows = [
        _levels(time, depth, u_depth, wander, step, noise, relative, settings)
        for step in _each(steps)
    ]
    table: dict[str, Any] = {
        "approach": ("time", depth, {"units": "m", "long_name": "approach from first touch"}),
        "u_approach": (
            "time", np.hypot(u_depth, noise),
            {"units": "m", "long_name": "standard uncertainty: approach from first touch"},
        ),
        "contact_radius": (
            "time", a, {"units": "m", "long_name": "contact radius, root of R times approach"},
        ),
        "u_contact_radius": (
            "time", _u_radius(a, depth, np.hypot(u_depth, noise), radius),
            {"units": "m", "long_name": "standard uncertainty: contact radius"},
        ),
        "smooth_radius": (
            "time", _smoothed(time, a, steps),
            {"units": "m", "long_name": "contact radius, moving average inside each load"},
        ),
        "is_settled": (
            "time", settled(time, steps, settings),
            {"units": "1", "long_name": "whether the reading lies far from every step"},
        ),
    }  # fmt: skip
    for name, (units, text) in _LEVELS.items():
        for prefix, words in (("", text), ("u_", f"standard uncertainty: {text}")):
            key = f"{prefix}{name}" if name in ("creep", "mean_radius") else f"{prefix}level_{name}"
            table[key] = (
                "load", np.array([r[f"{prefix}{name}"] for r in rows]),
                {"units": units, "long_name": words},
            )  # fmt: skip
    return xr.Dataset(
        table,
        coords={
            "time": ("time", time, {"units": "s", "long_name": "time from the first point"}),
            "load": steps["load"],
        },
        attrs={"budget": json.dumps(_budget(float(depth.max()), displacement, steps, settings))},
    )


def _budget(
    largest: float, displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading
) -> list[dict[str, Any]]:
    """Return what makes a reading of the largest approach uncertain.

    Inclination and gain scale the approach alone: the way from the sensor's zero cancels.
    """
    angle, gain = float(displacement["inclination"]), float(displacement["gain"])
    return table([
        Source("noise of a reading", 0.0, float(steps["noise"]), "m", 1.0, "random"),
        Source("first touch", float(steps["touch"]), float(steps["u_touch"]), "m", -1.0,
               "systematic"),
        Source("drift of the zero", 0.0, settings.steps.drift.value, "m", 1.0, "systematic"),
        Source("inclination", angle, float(displacement["u_inclination"]), "rad",
               largest * np.tan(angle), "systematic"),
        Source("gain", gain, float(displacement["u_gain"]), "1", largest / gain, "systematic"),
    ])  # fmt: skip


def _each(steps: xr.Dataset) -> list[tuple[float, float]]:
    return list(zip(steps["begin"].values.tolist(), steps["end"].values.tolist(), strict=True))


def windows(
    time: Array, step: tuple[float, float], settings: StaticLoading
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the first and the last window of one load.

    Raises
    ------
    InputError
        The load lasts too short for two windows.
    """
    begin, end = step
    chosen, spacing = settings.steps, float(np.median(np.diff(time)))
    start = begin + chosen.settle.value
    first = (time > start) & (time <= start + chosen.window.value)
    last = (time < end - spacing) & (time >= end - spacing - chosen.window.value)
    if not first.any() or not last.any() or np.any(first & last):
        message = (
            f"the load from {begin:.0f} to {end:.0f} s is too short for two windows of "
            f"{chosen.window.value:g} s after {chosen.settle.value:g} s; lower steps.window"
        )
        raise InputError(message)
    return first, last


def _levels(
    time: Array,
    depth: Array,
    u_depth: Array,
    wander: Array,
    step: tuple[float, float],
    noise: float,
    relative: float,
    settings: StaticLoading,
) -> dict[str, float]:
    """Return level, radius and creep of one load with their uncertainties."""
    first, last = windows(time, step, settings)
    radius = settings.sphere.radius
    level = float(depth[last].mean())
    random = noise / np.sqrt(last.sum())
    u_level = float(np.hypot(random, u_depth[last].mean()))
    creep = level - float(depth[first].mean())
    moved = float(wander[last].mean() - wander[first].mean())
    u_creep = float(np.sqrt(
        noise**2 * (1 / first.sum() + 1 / last.sum()) + (relative * creep) ** 2 + moved**2
    ))  # fmt: skip
    inside = (time > step[0] + settings.steps.settle.value) & (time < step[1])
    mean = np.sqrt(radius.value * max(float(depth[inside].mean()), 0.0))
    u_mean = np.hypot(noise / np.sqrt(inside.sum()), float(u_depth[inside].mean()))
    a = np.sqrt(radius.value * max(level, 0.0))
    return {
        "approach": level, "u_approach": u_level,
        "contact_radius": float(a),
        "u_contact_radius": float(_u_radius(a, level, u_level, radius)),
        "mean_radius": float(mean),
        "u_mean_radius": float(_u_radius(mean, mean**2 / radius.value, u_mean, radius)),
        "creep": creep, "u_creep": u_creep,
    }  # fmt: skip


def _u_radius(a: Any, depth: Any, u_depth: Any, radius: Quantity) -> Any:
    """Propagate through a = √(R δ)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(depth > 0, u_depth / np.maximum(depth, 1e-12), np.nan)
    return 0.5 * a * np.hypot(relative, radius.u / radius.value)


def _smoothed(time: Array, a: Array, steps: xr.Dataset) -> Array:
    """Return a moving average that does not cross a step."""
    made = np.empty_like(a)
    for begin, end in _each(steps):
        inside = np.flatnonzero((time >= begin) & (time <= end))
        for n in inside:
            near = inside[np.abs(time[inside] - time[n]) <= 0.5 * _SMOOTH]
            made[n] = a[near].mean()
    return made


def model(
    displacement: xr.Dataset,
    steps: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: StaticLoading,
) -> xr.Dataset:
    """Simulate the loading with the times found; Hertz's steps beside it."""
    solid = resolve(settings.sphere, material_file, fitted)
    radius = settings.sphere.radius
    chosen = settings.model
    time, _ = _valid(displacement)
    force = steps["force"].values
    stretches, loads = [], []
    for (begin, end), load in zip(_each(steps), force, strict=True):
        inside = begin + np.concatenate([[0.0], np.geomspace(_FIRST, end - begin, _STEP_POINTS)])
        stretches.append(inside)
        loads.append(np.full(inside.size, load))
    made = contact.load_sphere(
        solid, radius.value, np.concatenate(stretches), np.concatenate(loads),
        profile=chosen.profile, springs=chosen.springs,
    )  # fmt: skip
    relative_force = steps["u_force"].values / force
    held = np.searchsorted(steps["begin"].values, time, side="right") - 1
    # exponents of Hertz's contact: approach F^(2/3) R^(-1/3), radius F^(1/3) R^(1/3)
    spread = relative_force[np.maximum(held, 0)]
    size = radius.u / radius.value
    table: dict[str, Any] = {}
    for name, of_force, of_radius in (("approach", 2 / 3, 1 / 3), ("contact_radius", 1 / 3, 1 / 3)):
        values = np.interp(time, made["time"].values, made[name].values)
        attrs = {"units": "m", "long_name": f"{name.replace('_', ' ')}, viscoelastic model"}
        table[name] = ("time", values, attrs)
        table[f"u_{name}"] = (
            "time", values * np.hypot(of_force * spread, of_radius * size),
            {"units": "m", "long_name": f"standard uncertainty from load and radius: {name}"},
        )  # fmt: skip
    factor = 1 / (1 - float(solid.nu) ** 2)
    for name, modulus in (("relaxed", solid.E_relaxed), ("unrelaxed", solid.E_unrelaxed)):
        state = hertz.static_load(force, radius.value, float(modulus) * factor)
        table[f"hertz_radius_{name}"] = (
            "load", np.asarray(state.contact_radius),
            {"units": "m", "long_name": f"contact radius by Hertz, {name} modulus"},
        )  # fmt: skip
        table[f"hertz_approach_{name}"] = (
            "load", np.asarray(state.approach),
            {"units": "m", "long_name": f"approach by Hertz, {name} modulus"},
        )  # fmt: skip
    lag = steps["elapsed"].values
    table["compliance"] = (
        "elapsed", np.asarray(solid.creep(lag)) / factor,
        {"units": "1/Pa", "long_name": "reduced creep compliance of the material"},
    )  # fmt: skip
    work = json.loads(made.attrs["work"])
    return xr.Dataset(
        table,
        coords={
            "time": ("time", time, {"units": "s", "long_name": "time from the first point"}),
            "load": steps["load"],
            "elapsed": steps["elapsed"],
        },
        attrs={"work": json.dumps(work)},
    )


def comparison(
    approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, *, settings: StaticLoading
) -> xr.Dataset:
    """Compare the record with the viscoelastic model and with Hertz's steps."""
    time = approach["time"].values
    kept = approach["is_settled"].values.astype(bool)
    held = np.maximum(np.searchsorted(steps["begin"].values, time, side="right") - 1, 0)
    table: dict[str, Any] = {}
    for name in ("approach", "contact_radius"):
        ours = approach[name].values
        extent = float(np.ptp(ours[kept]))
        elastic = model[f"hertz_{'radius' if name == 'contact_radius' else name}_relaxed"].values
        for other, theirs in (("model", model[name].values), ("hertz", elastic[held])):
            gap = np.where(kept, ours - theirs, np.nan)
            rms = float(np.sqrt(np.nanmean(gap**2))) / extent
            words = f"{name.replace('_', ' ')}, measured minus {other}"
            table[f"nrmse_{name}_{other}"] = (
                (), rms, {"units": "1", "long_name": f"rms error over range: {words}"},
            )  # fmt: skip
            table[f"bias_{name}_{other}"] = (
                (), float(np.nanmean(gap)), {"units": "m", "long_name": f"mean of {words}"},
            )  # fmt: skip
            if other == "model":
                table[f"{name}_residual"] = ("time", gap, {"units": "m", "long_name": words})
    table |= _per_load(approach, steps, model, settings)
    return xr.Dataset(table, coords={"time": approach["time"], "load": steps["load"]})


def _per_load(
    approach: xr.Dataset, steps: xr.Dataset, model: xr.Dataset, settings: StaticLoading
) -> dict[str, Any]:
    """Compare levels and creep under each load, and the radii that session.toml gives."""
    time = approach["time"].values
    rows = []
    for number, step in enumerate(_each(steps)):
        first, last = windows(time, step, settings)
        at = approach.isel(load=number)
        depth, a = model["approach"].values, model["contact_radius"].values
        u_a = float(model["u_contact_radius"].values[last].mean())
        given = settings.loads[number].radius
        level, u = float(at["level_contact_radius"]), float(at["u_level_contact_radius"])
        hertzian = float(model["hertz_radius_relaxed"][number])
        rows.append({
            "creep_model": float(depth[last].mean() - depth[first].mean()),
            "radius_model": float(a[last].mean()),
            "radius_difference": level - float(a[last].mean()),
            "u_radius_difference": float(np.hypot(u, u_a)),
            "hertz_difference": level - hertzian,
            "given_radius": np.nan if given is None else given.value,
            "u_given_radius": np.nan if given is None else given.u,
            "given_difference": np.nan if given is None else level - given.value,
            "u_given_difference": np.nan if given is None else float(np.hypot(u, given.u)),
        })  # fmt: skip
    texts = {
        "creep_model": "growth of the approach under the load, model",
        "radius_model": "contact radius at the end of the load, model",
        "radius_difference": "contact radius, measured minus model",
        "u_radius_difference": "standard uncertainty: radius difference",
        "hertz_difference": "contact radius, measured minus Hertz with the relaxed modulus",
        "given_radius": "contact radius that session.toml gives",
        "u_given_radius": "standard uncertainty: given contact radius",
        "given_difference": "contact radius, from the approach minus given",
        "u_given_difference": "standard uncertainty: given difference",
    }
    return {
        name: ("load", np.array([r[name] for r in rows]), {"units": "m", "long_name": text})
        for name, text in texts.items()
    }

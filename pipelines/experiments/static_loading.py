"""Static loading: approach and contact radius of a sphere while loads are added, and its creep.

Conventions: the approach counts downwards from first touch; a load is all that rests on the disc.
When the loads were put on, and where first touch was, tells
:mod:`pipelines.experiments.static_steps`; a = √(R δ) makes the radius of the approach.

References
----------
Thesis section 3.3.4.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import calibration
from calibration import laser
from labpipe import contact
from labpipe.contact.sphere import hertz
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.uncertainty import Source
from labpipe.uncertainty import table as budget_table
from labpipe.units import Quantity
from pipelines.experiments.laser_file import read_laser
from pipelines.experiments.material import resolve, variations
from pipelines.experiments.static_steps import SIDE, settled, valid
from pipelines.settings.static_loading import StaticLoading

Array = NDArray[np.float64]

_STEP_POINTS = 80  # of the simulation in one load step, evenly in the logarithm of time
_SMOOTH = 60.0  # s, the moving average of the thesis's smoothed curve
_FIRST = 0.5  # s under a load at which the simulation is first asked


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
    if int(moved["valid"].sum()) < 2 * SIDE * len(settings.loads) or short:
        message = (
            f"the record holds {int(moved['valid'].sum())} valid readings over "
            f"{float(moved['time'][-1]):.4g} s, too few for {len(settings.loads)} loads"
        )
        raise InputError(message)
    return moved


_LEVELS = {
    "approach": ("m", "approach at the end of the load"),
    "contact_radius": ("m", "contact radius at the end of the load, from the approach"),
    "mean_radius": ("m", "contact radius, mean over the load"),
    "creep": ("m", "growth of the approach under the load, first to last window"),
}


def approach(displacement: xr.Dataset, steps: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Return approach and contact radius over time, and their levels and creep under each load."""
    time, moved = valid(displacement)
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
    return budget_table([
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
    time, _ = valid(displacement)
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
    # exponents of Hertz's contact: approach (F J)^(2/3) R^(-1/3), radius (F J)^(1/3) R^(1/3)
    spread = relative_force[np.maximum(held, 0)]
    size = radius.u / radius.value
    softer = _softer(settings, material_file, fitted, solid, float(time[-1]))
    of_material = float(np.sqrt(sum((given.u * s) ** 2 for given, s in softer.values())))
    table: dict[str, Any] = {}
    for name, power in (("approach", 2 / 3), ("contact_radius", 1 / 3)):
        values = np.interp(time, made["time"].values, made[name].values)
        attrs = {"units": "m", "long_name": f"{name.replace('_', ' ')}, viscoelastic model"}
        table[name] = ("time", values, attrs)
        relative = np.sqrt((power * spread) ** 2 + (size / 3) ** 2 + (power * of_material) ** 2)
        table[f"u_{name}"] = (
            "time", values * relative,
            {"units": "m", "long_name": f"standard uncertainty from load, radius, solid: {name}"},
        )  # fmt: skip
    last = float(table["contact_radius"][1][-1])
    sources = [
        Source("load", float(force[-1]), float(steps["u_force"][-1]), "N", last / 3 / force[-1],
               "systematic"),
        Source("radius", radius.value, radius.u, "m", last / 3 / radius.value, "systematic"),
    ]  # fmt: skip
    sources += [
        Source(name, given.value, given.u, "K" if given.si == "degC" else given.si,
               last / 3 * slope, "systematic")
        for name, (given, slope) in softer.items()
    ]  # fmt: skip
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
        attrs={"work": json.dumps(work), "budget": json.dumps(budget_table(sources))},
    )


def _softer(
    settings: StaticLoading, material_file: Path | None, fitted: xr.Dataset | None, solid: Prony,
    lasted: float,
) -> dict[str, tuple[Quantity, float]]:  # fmt: skip
    """Return what is uncertain of the solid, and the relative change of its compliance by it."""
    whole = float(solid.creep(lasted))
    return {
        name: (given, float(np.log(float(other.creep(lasted)) / whole)) / step)
        for name, (given, step, other) in variations(settings.sphere, material_file, fitted).items()
    }


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

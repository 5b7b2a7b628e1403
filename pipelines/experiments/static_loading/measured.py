"""Static loading: approach and contact radius of a sphere while loads are added, and its creep.

Conventions: the approach counts downwards from first touch; a load is all that rests on the disc.
When the loads were put on, and where first touch was, tells
:mod:`pipelines.experiments.static_loading.load_steps`; a = √(R δ) makes the radius of the approach.

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
from labpipe import uncertainty
from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.uncertainty import Row, Source
from labpipe.units import Quantity
from labpipe.variables import from_rows, variable, with_u
from pipelines.experiments.shared import laser_readings
from pipelines.experiments.static_loading.load_steps import SIDE, settled, touch_apart, touch_weights, valid
from pipelines.experiments.static_loading.settings import StaticLoading

_SMOOTH = 60.0  # s, the moving average of the thesis's smoothed curve


def readings(path: Path, *, settings: StaticLoading) -> xr.Dataset:
    """Read the laser export; a reading at its end is kept: it may be the level before the first load."""
    return laser_readings.without_outliers(laser_readings.read_laser(path, settings.keyence), ends=False)


def displacement(readings: xr.Dataset, record: Path, *, settings: StaticLoading) -> xr.Dataset:
    """Correct the inclination: displacement downwards, from the sensor's zero or first touch."""
    known = calibration.load_record(record)
    if settings.sensor.serial is not None:
        readings = readings.assign_attrs(serial=settings.sensor.serial)
    sensor, zero = settings.sensor, 0.0 if settings.zero is None else settings.zero
    moved = laser.displacement(
        readings, known, output=sensor.output, direction=-sensor.direction, measured=settings.measured_on, zero=zero
    )
    short = moved["time"].values[-1] < settings.steps.window.value
    if int(moved["valid"].sum()) < 2 * SIDE * len(settings.loads) or short:
        raise InputError(
            f"the record holds {int(moved['valid'].sum())} valid readings over "
            f"{float(moved['time'][-1]):.4g} s, too few for {len(settings.loads)} loads"
        )
    return moved


_LEVELS = {
    "level_approach": ("m", "approach at the end of the load"),
    "level_contact_radius": ("m", "contact radius at the end of the load, from the approach"),
    "mean_radius": ("m", "contact radius, mean over the load"),
    "creep": ("m", "growth of the approach under the load, first to last window"),
    "touch_follows": ("1", "by how much the noise of the level follows an error of first touch"),
}


def approach(displacement: xr.Dataset, steps: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Return approach and contact radius over time, and their levels and creep under each load."""
    time, moved = valid(displacement)
    depth = moved - float(steps["touch"])
    radius = settings.sphere.radius
    relative = float(displacement.attrs["u_systematic_relative"])
    noise, (u_touch, by_drift) = float(steps["noise"]), touch_apart(steps)
    wander = settings.steps.drift.value * time / float(time[-1])
    u_depth = np.sqrt(u_touch**2 + (relative * depth) ** 2 + (wander - by_drift) ** 2)
    a = np.sqrt(radius.value * np.maximum(depth, 0.0))
    # the touch follows the readings that it is told by, the first load's above all
    together = noise**2 * touch_weights(displacement, steps, settings)
    rows = [_levels(time, depth, u_depth, wander, step, noise, relative, together, settings) for step in spans(steps)]
    for row in rows:
        row["touch_follows"] = row["touch_follows"] / u_touch**2 if u_touch > 0.0 else 0.0
    u_each = np.hypot(u_depth, noise)
    u_a = _u_radius(a, depth, u_each, radius)
    table: dict[str, Any] = {
        **with_u("approach", "time", depth, u_each, "m", "approach from first touch"),
        **with_u("contact_radius", "time", a, u_a, "m", "contact radius, root of R times approach"),
        "smooth_radius": variable(
            "time", _smoothed(time, a, steps), "m", "contact radius, moving average inside each load"
        ),
        "is_settled": variable(
            "time", settled(time, steps, settings), "1", "whether the reading is away from every load step"
        ),
    }
    table |= from_rows("load", rows, _LEVELS)
    return xr.Dataset(
        table,
        coords={"time": variable("time", time, "s", "time from the first point"), "load": steps["load"]},
        attrs={"budget": json.dumps(_budget(float(depth.max()), displacement, steps, settings))},
    )


def _budget(largest: float, displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> list[Row]:
    """Return what makes a reading of the largest approach uncertain.

    Inclination and gain scale the approach alone: the way from the sensor's zero cancels.
    """
    angle, gain = float(displacement["inclination"]), float(displacement["gain"])
    u_touch, by_drift = touch_apart(steps)
    return uncertainty.budget_rows(
        [
            Source("noise of a reading", 0.0, float(steps["noise"]), "m", 1.0, "random"),
            Source("first touch", float(steps["touch"]), u_touch, "m", -1.0, "systematic"),
            Source("drift of the zero", 0.0, settings.steps.drift.value - by_drift, "m", 1.0, "systematic"),
            Source(
                "inclination", angle, float(displacement["u_inclination"]), "rad", largest * np.tan(angle), "systematic"
            ),
            Source("gain", gain, float(displacement["u_gain"]), "1", largest / gain, "systematic"),
        ]
    )


def spans(steps: xr.Dataset) -> list[tuple[float, float]]:
    """Return begin and end [s] of every load."""
    return list(zip(steps["begin"].values.tolist(), steps["end"].values.tolist(), strict=True))


def windows(
    time: Floats, step: tuple[float, float], settings: StaticLoading
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
        raise InputError(
            f"the load from {begin:.0f} to {end:.0f} s is too short for two windows of "
            f"{chosen.window.value:g} s after {chosen.settle.value:g} s; lower steps.window"
        )
    return first, last


def _levels(
    time: Floats,
    depth: Floats,
    u_depth: Floats,
    wander: Floats,
    step: tuple[float, float],
    noise: float,
    relative: float,
    together: Floats,
    settings: StaticLoading,
) -> dict[str, float]:
    """Return level, radius and creep of one load with their uncertainties."""
    first, last = windows(time, step, settings)
    radius = settings.sphere.radius
    level = float(depth[last].mean())
    random, shared = noise / np.sqrt(last.sum()), float(together[last].mean())
    u_level = float(np.sqrt(max(random**2 - 2.0 * shared + u_depth[last].mean() ** 2, 0.0)))
    creep = level - float(depth[first].mean())
    moved = float(wander[last].mean() - wander[first].mean())
    u_creep = float(np.sqrt(noise**2 * (1 / first.sum() + 1 / last.sum()) + (relative * creep) ** 2 + moved**2))
    inside = (time > step[0] + settings.steps.settle.value) & (time < step[1])
    mean = np.sqrt(radius.value * max(float(depth[inside].mean()), 0.0))
    u_mean = np.hypot(noise / np.sqrt(inside.sum()), float(u_depth[inside].mean()))
    a = np.sqrt(radius.value * max(level, 0.0))
    return {
        "level_approach": level,
        "u_level_approach": u_level,
        "touch_follows": shared,
        "level_contact_radius": float(a),
        "u_level_contact_radius": float(_u_radius(a, level, u_level, radius)),
        "mean_radius": float(mean),
        "u_mean_radius": float(_u_radius(mean, mean**2 / radius.value, u_mean, radius)),
        "creep": creep,
        "u_creep": u_creep,
    }


def _u_radius(a: Any, depth: Any, u_depth: Any, radius: Quantity) -> Any:
    """Propagate through a = √(R δ)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(depth > 0, u_depth / np.maximum(depth, 1e-12), np.nan)
    return 0.5 * a * np.hypot(relative, radius.u / radius.value)


def _smoothed(time: Floats, a: Floats, steps: xr.Dataset) -> Floats:
    """Return a moving average that does not cross a step."""
    made = np.empty_like(a)
    for begin, end in spans(steps):
        inside = np.flatnonzero((time >= begin) & (time <= end))
        for n in inside:
            near = inside[np.abs(time[inside] - time[n]) <= 0.5 * _SMOOTH]
            made[n] = a[near].mean()
    return made

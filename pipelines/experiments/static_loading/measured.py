"""Static loading: approach and contact radius of a sphere while loads are added, and its creep.

Conventions: the approach counts downwards from first touch; a load is all that rests on the disc.
Times of the loads and first touch are those of :mod:`pipelines.experiments.static_loading.load_steps`; the contact
radius is a = √(R δ).

References
----------
Thesis section 3.3.4.
"""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.judging import stretch_means
from labpipe.units import Quantity
from labpipe.variables import variable, with_u
from pipelines.experiments.shared import laser_readings
from pipelines.experiments.shared.exclusions import without_readings
from pipelines.experiments.static_loading.load_steps import SIDE, settled, valid
from pipelines.experiments.static_loading.settings import StaticLoading


def readings(path: Path, *, settings: StaticLoading) -> xr.Dataset:
    """Read the laser export; a reading at its end is kept: it may be the level before the first load."""
    found = without_readings(laser_readings.read_laser(path, settings.keyence), settings, "out")
    return laser_readings.without_outliers(found, ends=False)


def displacement(readings: xr.Dataset, record: Path, *, settings: StaticLoading) -> xr.Dataset:
    """Correct the inclination: displacement downwards, from the sensor's zero."""
    downwards = {"direction": -settings.sensor.direction, "zero": 0.0}
    moved = laser_readings.displacement(readings, record, settings=settings, **downwards)
    short = moved["time"].values[-1] < settings.steps.window.value
    if int(moved["valid"].sum()) < 2 * SIDE * len(settings.loads) or short:
        raise InputError(
            f"the record holds {int(moved['valid'].sum())} valid readings over "
            f"{float(moved['time'][-1]):.4g} s, too few for {len(settings.loads)} loads"
        )
    return moved


def approach(displacement: xr.Dataset, steps: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Return approach and contact radius over time, and their levels and creep under each load."""
    time, moved = valid(displacement)
    depth = moved - float(steps["touch"])
    radius, relative = settings.sphere.radius, float(displacement.attrs["u_systematic_relative"])
    noise, wander = float(steps["noise"]), settings.steps.drift.value * time / float(time[-1])
    u_depth = np.sqrt(float(steps["u_touch"]) ** 2 + (relative * depth) ** 2 + wander**2)
    first, last = zip(*(windows(time, span, settings) for span in spans(steps)), strict=True)
    level, u_mean, after = stretch_means([depth, u_depth, wander], last)
    start, before = stretch_means([depth, wander], first)
    few, many = (1.0 / np.sum(window, axis=1) for window in (first, last))
    creep, u_level = level - start, np.hypot(noise * np.sqrt(many), u_mean)
    u_creep = np.sqrt(noise**2 * (few + many) + (relative * creep) ** 2 + (after - before) ** 2)
    u_each = np.hypot(u_depth, noise)
    radii = _radius(depth, u_each, radius), _radius(level, u_level, radius)
    text, kept = "growth of the approach under the load, first to last window", settled(time, steps, settings)
    table: dict[str, Any] = {
        **with_u("approach", "time", depth, u_each, "m", "approach from first touch"),
        **with_u("contact_radius", "time", *radii[0], "m", "contact radius, root of R times approach"),
        "is_settled": variable("time", kept, "1", "whether the reading is away from every load step"),
        **with_u("level_approach", "load", level, u_level, "m", "approach at the end of the load"),
        **with_u("level_contact_radius", "load", *radii[1], "m", "contact radius at the end of the load"),
        **with_u("creep", "load", creep, u_creep, "m", text),
    }
    return xr.Dataset(table, {"time": variable("time", time, "s", "time from the first point"), "load": steps["load"]})


def _radius(depth: Any, u_depth: Any, radius: Quantity) -> tuple[Any, Any]:
    """Return a = √(R δ) and its standard uncertainty."""
    a = np.sqrt(radius.value * np.maximum(depth, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(depth > 0, u_depth / np.maximum(depth, 1e-12), np.nan)
    return a, 0.5 * a * np.hypot(relative, radius.u / radius.value)


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

"""Static loading: steps of the loads, first touch, approach and contact radius of a sphere, and its creep.

The approach counts downwards from first touch; a load is all that rests on the disc; the contact radius is a = √(R δ).
Under loads that are only added the contact only grows, and Lee and Radok's form is exact,

    δ^{3/2} = (3 / (4 √R)) ∫ J*(t − s) dF(s),

for any creep compliance J*. The sensor's reading at first touch follows from the loads,
and the compliance too, with no material assumed.

References
----------
Thesis section 3.3.4; E. H. Lee & J. R. M. Radok, J. Appl. Mech. 27 (1960) 438,
https://doi.org/10.1115/1.3644020.
"""

import json
import warnings
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar, nnls
from scipy.signal import find_peaks

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.judging import doubtful_among, stretch_means
from labpipe.signals import estimate_noise
from labpipe.units import Quantity
from labpipe.variables import variable, with_u
from pipelines.experiments.shared import laser_readings
from pipelines.experiments.shared.exclusions import without_readings
from pipelines.experiments.static_loading.settings import StaticLoading

SIDE = 4
"""Readings on either side of a step."""
POINTS = 80
"""Points of a curve of creep, evenly in the logarithm of time."""


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


def steps(displacement: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Find when each load was put on, the reading at first touch, and the creep compliance that fits with it.

    For every position of first touch the compliance is a sum of creep terms with weights of at least zero; the
    position is that of the least misfit. Its uncertainty is that of the fit and of the loads.
    """
    time, moved = valid(displacement)
    starts, sizes = _starts(displacement, settings)
    gravity, masses = settings.model.gravity, [load.mass for load in settings.loads]
    force = np.array([m.value for m in masses]) * gravity.value
    u_force = np.array([hypot(m.u / m.value, gravity.u / gravity.value) for m in masses]) * force
    ends = np.append(starts[1:], time[-1])
    result = xr.Dataset(
        {
            "begin": variable("load", starts, "s", "time at which the load was applied"),
            "end": variable("load", ends, "s", "time at which the next one was applied, or the record ends"),
            "jump": variable("load", sizes, "m", "displacement across the step"),
            **with_u("force", "load", force, u_force, "N", "load"),
        },
        coords={"load": np.arange(1, starts.size + 1)},
    )
    used, radius, noise = settled(time, result, settings), settings.sphere.radius.value, estimate_noise(moved).sigma
    elapsed, rows = time[used], moved[used]
    design, tau = creep_design(elapsed, result, radius)
    touch = best_touch(rows, design)
    weights, misfit = creep_fit(rows, design, touch)
    scatter = float(np.sqrt(misfit / max(rows.size - int((weights > 0).sum()) - 1, 1)))
    by_loads = 0.0
    for i in np.flatnonzero(u_force > 0):
        other = result.assign(force=("load", force + np.where(np.arange(force.size) == i, u_force, 0.0)))
        by_loads = hypot(by_loads, best_touch(rows, creep_design(elapsed, other, radius)[0]) - touch)
    slopes = design[:, weights > 0] / (1.5 * np.sqrt(np.maximum(rows - touch, 1e-9)))[:, None]
    slopes = np.column_stack([np.ones(rows.size), slopes / np.abs(slopes).max(axis=0)])
    u = hypot(max(noise, scatter) * float(np.linalg.norm(np.linalg.pinv(slopes)[0])), by_loads)
    lag = np.geomspace(settings.steps.settle.value + 1.0, float(time[-1] - time[0]), POINTS)
    terms = np.column_stack([np.ones(lag.size), -np.expm1(-lag[:, None] / tau)])
    found: dict[str, Any] = {
        "touch_part_of_loads": variable((), by_loads, "m", "part of its uncertainty that comes from the loads"),
        "scatter": variable((), scatter, "m", "root mean square misfit of the creep fit"),
        "noise": variable((), noise, "m", "noise of a reading"),
        **with_u("touch", (), touch, u, "m", "displacement at first touch"),
        "compliance": variable("elapsed", terms @ weights, "1/Pa", "reduced creep compliance, from the record"),
        "elapsed": variable("elapsed", lag, "s", "time under load"),
    }
    work = json.dumps({"fit_rows": int(rows.size), "fit_terms": int(tau.size + 1)})
    return result.assign(found).assign_attrs(work=work)


def valid(displacement: xr.Dataset) -> tuple[Floats, Floats]:
    """Return time [s] and displacement [m] of the valid readings."""
    usable = displacement["valid"].values.astype(bool)
    return displacement["time"].values[usable], displacement["displacement"].values[usable]


def clear_steps(displacement: xr.Dataset, least: float = 0.1) -> tuple[Floats, Floats]:
    """Return time [s] and size [m] of all steps downwards that stand out of the noise, whatever loads are stated.

    Steps smaller than ``least`` of the largest are left out.
    """
    time, moved = valid(displacement)
    level = np.median(np.lib.stride_tricks.sliding_window_view(moved, SIDE), axis=1)
    jump = level[SIDE:] - level[:-SIDE]
    tops, _ = find_peaks(jump, height=doubtful_among(jump.size) * estimate_noise(moved).sigma, distance=2 * SIDE + 1)
    tops = tops[jump[tops] >= least * jump[tops].max(initial=0.0)]
    # between the two readings that differ most
    at = np.array([top + 1 + np.argmax(np.diff(moved[top + 1 : top + 2 * SIDE - 1])) for top in tops], int)
    return 0.5 * (time[at] + time[at + 1]), jump[tops]


def _starts(displacement: xr.Dataset, settings: StaticLoading) -> tuple[Floats, Floats]:
    """Return begin and size of every step of a load; the first load is on from the beginning."""
    at, jump = clear_steps(displacement, least=0.0)
    search = settings.steps.search.value
    starts, sizes = [float(valid(displacement)[0][0])], [np.nan]
    free, late = np.ones(at.size, dtype=bool), list[str]()
    # steps with a given time first: their places are then taken
    for load in sorted(settings.loads[1:], key=lambda each: each.time is None):
        inside, where = free, "in the record"
        if load.time is not None:
            inside = free & (np.abs(at - load.time.value) <= search)
            where = f"within {search:g} s of {load.time.value:g} s"
        if not inside.any():
            times = ", ".join(f"{t:.0f}" for t in clear_steps(displacement)[0])
            raise InputError(
                f"no step of the displacement was found {where} for the load {load.mass.value:g} kg: the record steps "
                f"{f'at {times} s' if times else 'nowhere'}; check times and number of the loads, the sampling "
                "interval, and the sensor's direction"
            )
        best = int(np.argmax(np.where(inside, jump, -np.inf)))
        starts.append(float(at[best]))
        sizes.append(float(jump[best]))
        free[best] = False
        if load.time is not None and abs(at[best] - load.time.value) > 0.5 * search:
            late.append(f"{load.mass.value:g} kg: {at[best]:.0f} s, given {load.time.value:.0f} s")
    if late:
        text = "the loads were applied at other times than given; the detected times are used"
        warnings.warn(f"{text}: {'; '.join(late)}", stacklevel=3)
    order = np.argsort(starts)
    return np.array(starts)[order], np.array(sizes)[order]


def settled(time: Floats, table: xr.Dataset, settings: StaticLoading) -> NDArray[np.bool_]:
    """Return which readings lie far enough from every step."""
    spacing = float(np.median(np.diff(time)))
    kept = np.ones(time.size, dtype=bool)
    for begin in table["begin"].values:
        since = time - begin
        kept &= (since < -spacing) | (since > settings.steps.settle.value)
    return kept


def creep_design(time: Floats, table: xr.Dataset, radius: float, per_decade: int = 2) -> tuple[Floats, Floats]:
    """Return approach^{3/2} under unit compliances: at once, and creep with each time tau [s], so many a decade."""
    begin = table["begin"].values
    added = np.diff(table["force"].values, prepend=0.0)
    spacing, whole = float(np.median(np.diff(time))), float(time[-1] - begin[0])
    decades = np.log10(whole / spacing)
    tau = np.geomspace(spacing, whole, int(decades * per_decade) + 1)
    since = np.maximum(time[:, None] - begin, 0.0)
    columns = [(added * (since > 0)).sum(axis=1)]
    columns += [(-added * np.expm1(-since / each)).sum(axis=1) for each in tau]
    return 0.75 / np.sqrt(radius) * np.column_stack(columns), tau


def creep_fit(rows: Floats, design: Floats, touch: float) -> tuple[Floats, float]:
    """Return the weights of the compliance, and the sum of squares [m²] of the misfit of readings to a first touch."""
    depth = np.maximum(rows - touch, 1e-9)
    # the power 3/2 is linear in the compliance; its derivative brings the misfit back to m
    weight, scale = 1 / (1.5 * np.sqrt(depth)), np.abs(design).max(axis=0)
    answer, misfit = nnls(design / scale * weight[:, None], depth**1.5 * weight)
    return answer / scale, misfit**2


def best_touch(rows: Floats, design: Floats) -> float:
    """Return the displacement at first touch of least misfit."""
    high, extent = float(rows.min()), float(np.ptp(rows))
    found = minimize_scalar(lambda part: creep_fit(rows, design, high - part * extent)[1], bounds=(0.0, 1.0))
    return high - float(found.x) * extent


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

"""Load times of a static loading, and the position of first touch.

Under loads that are only added to the contact only grows, and Lee and Radok's form is exact,

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

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar, nnls

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals import estimate_noise
from labpipe.uncertainty import excess_uncertainty
from labpipe.variables import variable, with_u
from pipelines.experiments.static_loading.settings import StaticLoading

_TERMS_PER_DECADE = 2  # of the creep compliance that is fitted
SIDE = 4
"""Readings on either side of a step."""
_CLEAR = 5.0  # standard deviations by which a step must stand out
_MORE = 0.1  # of the smallest step that was found, above which another one counts
_ELAPSED = 60  # points of the compliance curve
_TOLERANCE = 1e-5  # of the record's range, to which first touch is searched
_WIDEST = 1e4  # times the noise, the search for a misfit that grows ends


def steps(displacement: xr.Dataset, *, settings: StaticLoading) -> xr.Dataset:
    """Find when each load was put on, and the reading at first touch."""
    time, moved = valid(displacement)
    noise = _noise(moved)
    starts, sizes = _starts(displacement, settings)
    masses = [load.mass for load in settings.loads]
    gravity = settings.model.gravity
    force = np.array([m.value for m in masses]) * gravity.value
    u_force = np.array([np.hypot(m.u / m.value, gravity.u / gravity.value) for m in masses]) * force
    ends = np.append(starts[1:], time[-1])
    table = {
        "begin": (starts, "s", "time at which the load was applied"),
        "end": (ends, "s", "time at which the next one was applied, or the record ends"),
        "jump": (sizes, "m", "displacement across the step"),
    }
    result = xr.Dataset(
        {n: variable("load", v, u, t) for n, (v, u, t) in table.items()}
        | with_u("force", "load", force, u_force, "N", "load"),
        coords={"load": np.arange(1, starts.size + 1)},
    )
    touch = _first_touch(displacement, noise, result, settings)
    return result.merge(touch).assign_attrs(touch.attrs)


def valid(displacement: xr.Dataset) -> tuple[Floats, Floats]:
    """Return time [s] and displacement [m] of the valid readings."""
    usable = displacement["valid"].values.astype(bool)
    return displacement["time"].values[usable], displacement["displacement"].values[usable]


def touch_apart(steps: xr.Dataset) -> tuple[float, float]:
    """Return the standard uncertainty of first touch without the drift of the zero, and its change by the drift [m].

    The drift moves touch and readings together.
    """
    u, by_drift = float(steps["u_touch"]), float(steps["touch_by_drift"])
    return excess_uncertainty(u, by_drift), by_drift


def touch_weights(displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> Floats:
    """Return the change of first touch by an error of each valid reading (reading,) [1], for the fitted creep terms."""
    time, moved = valid(displacement)
    follows, used, touch = np.zeros(time.size), settled(time, steps, settings), float(steps["touch"])
    design, _ = creep_design(time[used], steps, settings.sphere.radius.value)
    weights, _ = TouchFit(moved[used], design).solve(touch)
    slopes = design[:, weights > 0] / (1.5 * np.sqrt(np.maximum(moved[used] - touch, 1e-9)))[:, None]
    slopes = np.column_stack([np.ones(len(slopes)), slopes / np.abs(slopes).max(axis=0)])
    follows[used] = np.linalg.pinv(slopes)[0]
    return follows


def _noise(moved: Floats) -> float:
    found = estimate_noise(moved)
    return float(max(found.sigma, found.step / np.sqrt(12)))


def clear_steps(displacement: xr.Dataset, sign: int = 1, least: float = _MORE) -> tuple[Floats, Floats]:
    """Return time [s] and size [m] of all steps that stand out of the noise, whatever loads and times are stated.

    With ``sign`` 1 they are steps downwards, as a load makes them; with -1 those upwards. Steps smaller than ``least``
    of the largest are left out.
    """
    time, moved = valid(displacement)
    noise = _noise(moved)
    level = np.median(np.lib.stride_tricks.sliding_window_view(sign * moved, SIDE), axis=1)
    jump = level[SIDE:] - level[:-SIDE]
    found: list[tuple[float, float]] = []
    free = np.ones(jump.size, dtype=bool)
    while free.any():
        best = int(np.argmax(np.where(free, jump, -np.inf)))
        if jump[best] < max(_CLEAR * noise, least * max((size for _, size in found), default=0.0)):
            break
        at = _sharpened(moved, best + SIDE)
        found.append((0.5 * float(time[at - 1] + time[at]), float(jump[best])))  # the load came between two readings
        free[max(0, best - 2 * SIDE) : best + 2 * SIDE + 1] = False
    found.sort()
    return np.array([at for at, _ in found]), np.array([size for _, size in found])


def _starts(displacement: xr.Dataset, settings: StaticLoading) -> tuple[Floats, Floats]:
    """Return begin and size of every step of a load; the first load is on from the beginning."""
    at, jump = clear_steps(displacement, least=0.0)
    search = settings.steps.search.value
    starts, sizes = [float(valid(displacement)[0][0])], [np.nan]
    free = np.ones(at.size, dtype=bool)
    # steps with a given time first: their places are then taken
    for load in sorted(settings.loads[1:], key=lambda each: each.time is None):
        inside, where = free, "in the record"
        if load.time is not None:
            inside = free & (np.abs(at - load.time.value) <= search)
            where = f"within {search:g} s of {load.time.value:g} s"
        if not inside.any():
            raise InputError(
                f"no step of the displacement was found {where} for the load {load.mass.value:g} kg; check times and "
                "number of the loads, and the sensor's direction"
            )
        best = int(np.argmax(np.where(inside, jump, -np.inf)))
        starts.append(float(at[best]))
        sizes.append(float(jump[best]))
        free[best] = False
    order = np.argsort(starts)
    late = [
        f"{load.mass.value:g} kg: {start:.0f} s, given {load.time.value:.0f} s"
        for load, start in zip(settings.loads, np.array(starts)[order], strict=True)
        if load.time is not None and abs(start - load.time.value) > 0.5 * search
    ]
    if late:
        warnings.warn(
            "the loads were applied at other times than given; the detected times are used: " + "; ".join(late),
            stacklevel=3,
        )
    return np.array(starts)[order], np.array(sizes)[order]


def _sharpened(moved: Floats, near: int) -> int:
    """Return the first reading behind a step: the split with the least absolute misfit.

    A hand may disturb a reading next to the step; medians and absolute values forgive it.
    """
    low, high = max(near - 2 * SIDE, 0), min(near + 2 * SIDE, moved.size)
    before, after = np.median(moved[low : near - 1]), np.median(moved[near + 1 : high])
    splits = range(max(near - SIDE // 2, low + 1), min(near + SIDE // 2, high - 1) + 1)
    return min(splits, key=lambda k: float(np.abs(moved[low:k] - before).sum() + np.abs(moved[k:high] - after).sum()))


def settled(time: Floats, table: xr.Dataset, settings: StaticLoading) -> NDArray[np.bool_]:
    """Return which readings lie far enough from every step."""
    spacing = float(np.median(np.diff(time)))
    kept = np.ones(time.size, dtype=bool)
    for begin in table["begin"].values:
        since = time - begin
        kept &= (since < -spacing) | (since > settings.steps.settle.value)
    return kept


def creep_design(time: Floats, table: xr.Dataset, radius: float) -> tuple[Floats, Floats]:
    """Return approach^{3/2} under unit compliances: at once, and creep with each time tau [s]."""
    begin = table["begin"].values
    added = np.diff(table["force"].values, prepend=0.0)
    spacing, whole = float(np.median(np.diff(time))), float(time[-1] - begin[0])
    decades = np.log10(whole / spacing)
    tau = np.geomspace(spacing, whole, int(decades * _TERMS_PER_DECADE) + 1)
    since = np.maximum(time[:, None] - begin, 0.0)
    columns = [(added * (since > 0)).sum(axis=1)]
    columns += [(-added * np.expm1(-since / each)).sum(axis=1) for each in tau]
    return 0.75 / np.sqrt(radius) * np.column_stack(columns), tau


class TouchFit:
    """The creep fit as a function of the displacement at first touch; see :func:`_first_touch`."""

    def __init__(self, rows: Floats, design: Floats) -> None:
        self.rows, self.design = rows, design

    def solve(self, touch: float) -> tuple[Floats, float]:
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
        options, ends = {"xatol": _TOLERANCE * float(np.ptp(self.rows))}, (low, high)
        found = minimize_scalar(lambda touch: self.solve(touch)[1], bounds=ends, method="bounded", options=options)
        return float(found.x)


def _first_touch(displacement: xr.Dataset, noise: float, table: xr.Dataset, settings: StaticLoading) -> xr.Dataset:
    """Return the displacement at first touch and the creep compliance that fits with it.

    Two nested least squares: for every position of first touch the compliance is a sum of creep
    terms with weights of at least zero; the position is that of the least misfit. Its uncertainty
    holds the misfit's curvature, the sensor's drift and the loads.
    """
    time, moved = valid(displacement)
    used = settled(time, table, settings)
    elapsed, rows, radius = time[used], moved[used], settings.sphere.radius.value
    design, tau = creep_design(elapsed, table, radius)
    fit = TouchFit(rows, design)
    touch = fit.best()
    weights, misfit = fit.solve(touch)
    scatter = float(np.sqrt(misfit / max(rows.size - int((weights > 0).sum()) - 1, 1)))
    by_loads = by_drift = 0.0
    if settings.steps.drift.value > 0.0:
        drift = settings.steps.drift.value * elapsed / float(time[-1])
        by_drift = TouchFit(rows + drift, design).best() - touch
    force, u_force = table["force"].values, table["u_force"].values
    for i in np.flatnonzero(u_force > 0):
        other = table.assign(force=("load", force + np.where(np.arange(force.size) == i, u_force, 0.0)))
        by_loads = hypot(by_loads, TouchFit(rows, creep_design(elapsed, other, radius)[0]).best() - touch)
    u = hypot(_u_from_curvature(fit, touch, max(noise, scatter)), by_drift, by_loads)
    lag = np.geomspace(settings.steps.settle.value + 1.0, float(time[-1] - time[0]), _ELAPSED)
    terms = np.column_stack([np.ones(lag.size), -np.expm1(-lag[:, None] / tau)])
    scalars = {
        "touch_part_of_loads": (by_loads, "m", "part of it that comes from the loads"),
        "touch_by_drift": (by_drift, "m", "change of it by the drift of the zero, one standard uncertainty"),
        "scatter": (scatter, "m", "root mean square misfit of the creep fit"),
        "noise": (noise, "m", "noise of a reading"),
    }
    work = {"fit_rows": int(rows.size), "fit_terms": int(tau.size + 1)}
    return xr.Dataset(
        {n: variable((), v, unit, t) for n, (v, unit, t) in scalars.items()}
        | with_u("touch", (), touch, u, "m", "displacement at first touch")
        | {"compliance": variable("elapsed", terms @ weights, "1/Pa", "reduced creep compliance, from the record")},
        coords={"elapsed": variable("elapsed", lag, "s", "time under load")},
        attrs={"work": json.dumps(work)},
    )


def _u_from_curvature(fit: TouchFit, touch: float, noise: float) -> float:
    """Return the shift at which the misfit has grown by one variance, the mean of both sides."""
    least, sides = fit.solve(touch)[1], []
    for sign in (-1.0, 1.0):
        rise, width = 0.0, noise
        while rise < noise**2 and width < _WIDEST * noise:
            width *= 2.0
            rise = fit.solve(touch + sign * width)[1] - least
        # a parabola through the least and this point
        sides.append(width * noise / np.sqrt(max(rise, 1e-3 * noise**2)))
    return float(np.mean(sides))

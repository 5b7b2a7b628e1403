"""Ramps and holds of a Mach-1 file: their intervals, peak and plateau forces."""

import json
import warnings
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError
from labpipe.signals import independent_count
from labpipe.units import Quantity
from labpipe.variables import from_rows
from pipelines.experiments.shared import mach1_readings

RELAXATION = "Stress Relaxation"
_ARRIVED = 2e-3  # of a ramp's travel: closer to its end than this the stage has arrived
_LEAST_TRAVEL = 1e-6  # m; ten steps of the stage's display
_STEP = 1e-7  # m, the step of the display outside a Sinusoid block
_HELD = 0.9  # of the readings after the ramp, which must lie where it ended
_UNFINISHED = 0.01  # of a plateau, its uncertainty from relaxation that goes on: told
_SLOWEST = 0.9  # of a quarter's fall in the next quarter: a fall without end is not extrapolated
_FEWEST = 20  # readings of a hold
_PLATEAU_SHARE = 0.1  # of a hold
_ENOUGH = 100  # readings from which noise is known to 7 %
_NOISE_TREND = 3  # degree in log time: what is left of the second half of a hold is noise


@dataclass(frozen=True, slots=True)
class Hold:
    """One ramp with its hold.

    ``rows`` are the samples of ramp and hold; ``begin``, ``end`` and ``last`` are the block's
    times [s] at which the ramp begins, the stage has arrived, and the hold ends; ``start`` and
    ``held`` the positions [m] before and after; ``speed`` [m/s] that of the ramp's middle.
    """

    block: int
    rows: slice
    begin: float
    end: float
    last: float
    start: float
    held: float
    speed: float


def find(loads: xr.Dataset) -> list[Hold]:
    """Return every ramp and hold of the file's Stress Relaxation blocks.

    Raises
    ------
    InputError
        The file holds none, or a block holds no ramp.
    """
    functions = [str(f) for f in loads["function"].values]
    if RELAXATION not in functions:
        known = ", ".join(sorted(set(functions)))
        raise InputError(f"the file holds no {RELAXATION} block; its blocks are: {known}")
    found = []
    for block in (i for i, function in enumerate(functions) if function == RELAXATION):
        rows = mach1_readings.rows(loads, block)
        segment = loads["segment"].values[rows]
        edges = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1, append=segment[-1] + 1))
        previous = None
        for first, after in pairwise(edges):
            inside = slice(rows.start + int(first), rows.start + int(after))
            hold = _hold(loads, block, inside, previous)
            previous = hold.held
            found.append(hold)
    return found


def _hold(loads: xr.Dataset, block: int, rows: slice, previous: float | None) -> Hold:
    time = loads["time"].values[rows]
    position = loads["position_z"].values[rows]
    if not (np.isfinite(position).all() and np.isfinite(loads["force"].values[rows]).all()):
        raise InputError(f"block {block + 1}: a reading of position or force is missing during the test")
    held = float(np.median(position[position.size // 2 :]))
    start = float(position[0]) if previous is None else previous
    travel = held - start
    if abs(travel) < _LEAST_TRAVEL:
        raise InputError(
            f"block {block + 1}: the stage moves by {travel * 1e6:.3g} µm only, so there is no "
            "ramp; a relaxation test has one"
        )
    near = max(_ARRIVED * abs(travel), 2 * _STEP)
    moving = np.abs(position - start) > near
    arrived = np.abs(position - held) <= near
    if not arrived.any() or time.size - int(np.argmax(arrived)) < _FEWEST:
        raise InputError(f"block {block + 1}: the stage is not held after its ramp")
    first, end = max(int(np.argmax(moving)) - 1, 0), int(np.argmax(arrived))
    if np.mean(arrived[end:]) < _HELD:
        raise InputError(f"block {block + 1}: the stage moves on after its ramp; a relaxation test holds it")
    share = (position - start) / travel
    middle = (share > 0.1) & (share < 0.9) & (np.arange(time.size) <= end)
    speed = (
        float(np.polyfit(time[middle], position[middle], 1)[0])
        if middle.sum() > 2
        else travel / max(float(time[end] - time[first]), 1e-9)
    )
    return Hold(block, rows, float(time[first]), float(time[end]), float(time[-1]), start, held, speed)


class Level(NamedTuple):
    """A mean force [N] without the lag of the cell's filter, its random u, and over which times of the block [s].

    ``lag`` [N] is by how much the force would have read lower without the filter; ``u`` includes ``u_lag``.
    """

    force: float
    u: float
    begin: float
    end: float
    lag: float
    u_lag: float


def mean_force(loads: xr.Dataset, hold: Hold, begin: float, end: float) -> Level:
    """Return the mean force between two times of the block, with its random uncertainty."""
    time, force = loads["time"].values[hold.rows], loads["force"].values[hold.rows]
    used = (time >= begin) & (time <= end)
    values = force[used]
    since = time[used] - time[used].mean()
    slope = float(since @ values / max(float(since @ since), 1e-30))
    rest = values - values.mean() - slope * since
    step = float(loads.attrs.get("resolution", 0.0))
    noise = max(float(rest.std()), step / np.sqrt(12))
    # the cell's filter ties neighbouring readings together
    u = noise / np.sqrt(independent_count(rest))
    if noise < step / 2:
        u = max(u, step / np.sqrt(12))  # all on one step of the cell: no mean sees between
    delay = mach1_readings.filter_delay(loads)
    lag = -slope * delay.value  # what falls, reads too high by as much as it falls meanwhile
    u_lag = abs(slope) * delay.u
    return Level(float(values.mean()) - lag, float(np.hypot(u, u_lag)), begin, end, lag, u_lag)


def unfinished(loads: xr.Dataset, hold: Hold, level: Level) -> float:
    """Return the standard uncertainty [N] of a plateau from relaxation that still goes on.

    The force at half and at three quarters of the hold shows how fast its fall slows down; a
    fall that goes on so, each quarter the same share of the one before, ends lower by a known
    amount. Its distribution is a rectangle of twice this half width.
    """
    width = 0.5 * (level.end - level.begin)
    places = [hold.end + share * (hold.last - hold.end) for share in (0.5, 0.75)]
    half, later = (mean_force(loads, hold, t - width, t + width) for t in places)
    fell, falls = half.force - later.force, later.force - level.force
    share = float(np.clip(falls / max(fell, half.u, 1e-12), 0.0, _SLOWEST))
    left = max(falls, 0.0) * share / (1.0 - share)
    return 2.0 * left / float(np.sqrt(3.0))


def binned(time: Floats, values: Floats, edges: Floats) -> tuple[Floats, Floats, Floats, Integers]:
    """Return mean time, mean value, standard deviation and number in bins; empty bins left out."""
    place = np.searchsorted(edges, time, side="right") - 1
    inside = (place >= 0) & (place < edges.size - 1)
    groups = pd.DataFrame({"time": time[inside], "value": values[inside]}).groupby(place[inside])
    means, spread, count = groups.mean(), groups["value"].std(ddof=0), groups.size()
    t, mean, sd = (np.asarray(each, float) for each in (means["time"], means["value"], spread))
    return t, mean, sd, np.asarray(count, np.int64)


def u_of_means(loads: xr.Dataset, hold: Hold, count: Integers) -> Floats:
    """Return the standard uncertainty [N] of means of so many readings of a hold by their noise.

    The second half of the hold, where the force hardly falls, shows the noise better than the few
    readings of an early bin could; for a short hold the quiet start of the file is taken. Where the noise does
    not cross the resolution of the cell no mean sees between.
    """
    time, force = loads["time"].values[hold.rows], loads["force"].values[hold.rows]
    late = time >= 0.5 * (hold.end + hold.last)
    step = float(loads.attrs.get("resolution", 0.0))
    sd, memory = float(np.nanmax(loads["u_force"].values)), 1.0
    if late.sum() >= _ENOUGH:
        since = np.log(time[late] - hold.end)
        rest = force[late] - np.polynomial.Polynomial.fit(since, force[late], _NOISE_TREND)(since)
        # the cell's filter ties neighbouring readings together
        sd, memory = float(rest.std()), rest.size / independent_count(rest)
    least = step / np.sqrt(12.0)
    u = max(sd, least) / np.sqrt(np.maximum(count / memory, 1.0))
    return np.asarray(np.maximum(u, least) if sd < step / 2 else u)


def systematic(loads: xr.Dataset, force: float) -> float:
    """Return the uncertainty of a force by tare and gain [N]; an unknown gain adds nothing."""
    return float(np.hypot(float(loads["u_tare"]), relative_gain(loads) * force))


def relative_gain(loads: xr.Dataset) -> float:
    """Return the relative uncertainty of the cell's gain; an unknown one is 0."""
    return float(np.nan_to_num(float(loads["u_gain"]))) / float(loads["gain"])


_RAMP_COLUMNS = {
    "depth": ("m", "indentation of the hold, from first touch"),
    "travel": ("m", "travel of the ramp"),
    "speed": ("m/s", "speed of the ramp, from the position"),
    "duration": ("s", "length of the hold"),
    "peak_force": ("N", "largest force, as recorded after the cell's filter"),
    "plateau_force": ("N", "mean force over the end of the hold"),
    "unfinished": ("N", "standard uncertainty of the plateau from unfinished relaxation"),
    "plateau_lag": ("N", "effect of the cell's filter lag that was corrected in the plateau"),
    "begin": ("s", "start of the ramp, in the block's time"),
    "end": ("s", "arrival of the stage, in the block's time"),
    "plateau_begin": ("s", "start of the plateau's window, in the block's time"),
    "last": ("s", "end of the hold, in the block's time"),
    "block": ("1", "number of the block in the file"),
}


def measured(loads: xr.Dataset, touch: Quantity) -> xr.Dataset:
    """Return depth, peak and plateau of every ramp and hold of a file's tared, compression-positive force.

    Where the stage position of first touch is NaN depths are too.
    """
    rows = [_row(loads, hold, touch) for hold in find(loads)]
    return xr.Dataset(
        from_rows("ramp", rows, _RAMP_COLUMNS),
        coords={"ramp": np.arange(1, len(rows) + 1)},
        attrs={"work": json.dumps({"ramps": len(rows)})},
    )


def _row(loads: xr.Dataset, hold: Hold, touch: Quantity) -> dict[str, float]:
    force = loads["force"].values[hold.rows]
    if np.ptp(force) == 0.0:
        raise InputError(f"block {hold.block + 1}: the force is the same in all readings; the load cell did not record")
    level = mean_force(loads, hold, hold.last - _PLATEAU_SHARE * (hold.last - hold.end), hold.last)
    rest = unfinished(loads, hold, level)
    if rest > _UNFINISHED * level.force:
        warnings.warn(
            f"block {hold.block + 1}: the force is still falling at the end of the hold from {hold.end:.4g} s, by "
            f"about {50 * np.sqrt(3.0) * rest / level.force:.1f} % more: the plateau is not relaxed",
            stacklevel=2,
        )
    peak = float(force.max())
    return {
        "depth": hold.held - touch.value,
        "u_depth": float(np.hypot(touch.u, _STEP / np.sqrt(12))),
        "travel": hold.held - hold.start,
        "speed": hold.speed,
        "duration": hold.last - hold.end,
        "peak_force": peak,
        "u_peak_force": float(np.hypot(np.nanmax(loads["u_force"].values), systematic(loads, peak))),
        "plateau_force": level.force,
        "u_plateau_force": float(np.hypot(level.u, systematic(loads, level.force))),
        "unfinished": rest,
        "plateau_lag": level.lag,
        "u_plateau_lag": level.u_lag,
        "begin": hold.begin,
        "end": hold.end,
        "plateau_begin": level.begin,
        "last": hold.last,
        "block": float(hold.block),
    }

"""Relaxation under a periodic punch: ramps and holds with their peaks and plateaus, and all tests in a table."""

import json
import warnings
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.signal import detrend

from labpipe.errors import InputError
from labpipe.signals import independent_count
from labpipe.units import Quantity
from labpipe.variables import from_rows, with_u
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.mach1_readings import relative_gain

_ARRIVED = 2e-3  # of a ramp's travel: closer to its end than this the stage has arrived
_LEAST_TRAVEL = 1e-6  # m; ten steps of the stage's display
_STEP = 1e-7  # m, the step of the display outside a Sinusoid block
_HELD = 0.9  # of the readings after the ramp, which must lie where it ended
_UNFINISHED = 0.01  # of a plateau, its uncertainty from relaxation that goes on: told
_SLOWEST = 0.9  # of a quarter's fall in the next quarter: a fall without end is not extrapolated
_FEWEST = 20  # readings of a hold
_PLATEAU = 0.1  # of a hold, its last part
_BIRGE_LIMIT = 2.0  # of chance alone, three depths exceed it once in fifty
_COLUMNS = {
    "depth": ("m", "indentation of the hold, from first touch"),
    "travel": ("m", "travel of the ramp"),
    "speed": ("m/s", "speed of the ramp, from the position"),
    "duration": ("s", "length of the hold"),
    "peak_force": ("N", "largest force, as recorded after the cell's filter"),
    "plateau_force": ("N", "mean force over the end of the hold"),
    "unfinished": ("N", "standard uncertainty of the plateau from unfinished relaxation"),
    "begin": ("s", "start of the ramp, in the block's time"),
    "end": ("s", "arrival of the stage, in the block's time"),
    "plateau_begin": ("s", "start of the plateau's window, in the block's time"),
    "last": ("s", "end of the hold, in the block's time"),
    "block": ("1", "number of the block in the file"),
}


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
    found = []
    for block in mach1_readings.blocks_of(loads, Relaxation.function):
        rows = mach1_readings.rows(loads, block)
        segment = loads["segment"].values[rows]
        edges = np.flatnonzero(np.diff(segment, prepend=segment[0] - 1, append=segment[-1] + 1))
        previous = None
        for first, after in pairwise(edges):
            hold = _hold(loads, block, slice(rows.start + int(first), rows.start + int(after)), previous)
            previous = hold.held
            found.append(hold)
    return found


def _hold(loads: xr.Dataset, block: int, rows: slice, previous: float | None) -> Hold:
    time, position, force = (loads[name].values[rows] for name in ("time", "position_z", "force"))

    def refused(text: str) -> InputError:
        return InputError(f"block {block + 1}: {text}")

    if not (np.isfinite(position).all() and np.isfinite(force).all()):
        raise refused("a reading of position or force is missing during the test")
    held = float(np.median(position[position.size // 2 :]))
    start = float(position[0]) if previous is None else previous
    travel = held - start
    if abs(travel) < _LEAST_TRAVEL:
        raise refused(f"the stage moves by {travel * 1e6:.3g} µm only, so there is no ramp; a relaxation test has one")
    near = max(_ARRIVED * abs(travel), 2 * _STEP)
    arrived = np.abs(position - held) <= near
    first, end = max(int(np.argmax(np.abs(position - start) > near)) - 1, 0), int(np.argmax(arrived))
    if not arrived.any() or time.size - end < _FEWEST:
        raise refused("the stage is not held after its ramp")
    if np.mean(arrived[end:]) < _HELD:
        raise refused("the stage moves on after its ramp; a relaxation test holds it")
    share = (position - start) / travel
    middle = (share > 0.1) & (share < 0.9) & (np.arange(time.size) <= end)
    speed = travel / max(float(time[end] - time[first]), 1e-9)
    if middle.sum() > 2:
        speed = float(np.polyfit(time[middle], position[middle], 1)[0])
    return Hold(block, rows, float(time[first]), float(time[end]), float(time[-1]), start, held, speed)


def ramps(loads: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Find first touch, and depth, peak and plateau of every ramp and hold of a tared, compression-positive force.

    Where the stage position of first touch is NaN depths are too.
    """
    known = mach1_readings.first_touch(loads, settings.contact)
    touch = mach1_readings.touch_of(known)
    rows = [_row(loads, hold, touch) for hold in find(loads)]
    made = xr.Dataset(from_rows("ramp", rows, _COLUMNS), coords={"ramp": np.arange(1, len(rows) + 1)})
    return made.merge(known).assign_attrs(known.attrs, work=json.dumps({"ramps": len(rows)}))


def _level(loads: xr.Dataset, hold: Hold, middle: float) -> tuple[float, float]:
    """Return the mean force over a tenth of a hold about a place in it, 0 to 1, with its random uncertainty [N]."""
    time, force = loads["time"].values[hold.rows], loads["force"].values[hold.rows]
    used = np.abs((time - hold.end) / (hold.last - hold.end) - middle) <= 0.5 * _PLATEAU + 1e-9
    values = force[used]
    rest = detrend(values)
    step = float(loads.attrs.get("resolution", 0.0)) / np.sqrt(12)
    noise = max(float(rest.std()), step)
    # the cell's filter ties neighbouring readings together; all on one step of the cell no mean sees between
    u = max(noise / np.sqrt(independent_count(rest)), step if noise < np.sqrt(3) * step else 0.0)
    return float(values.mean()), float(u)


def _row(loads: xr.Dataset, hold: Hold, touch: Quantity) -> dict[str, float]:
    force = loads["force"].values[hold.rows]
    if np.ptp(force) == 0.0:
        raise InputError(f"block {hold.block + 1}: the force is the same in all readings; the load cell did not record")
    (half, u_half), (later, _), (level, u_level) = (_level(loads, hold, at) for at in (0.5, 0.75, 1 - 0.5 * _PLATEAU))
    # The force at half and at three quarters of the hold shows how fast its fall slows down; a fall that goes on so,
    # each quarter the same share of the one before, ends lower by a known amount: a rectangle of twice this half width.
    falls = max(later - level, 0.0)
    share = float(np.clip(falls / max(half - later, u_half, 1e-12), 0.0, _SLOWEST))
    rest = 2.0 * falls * share / (1.0 - share) / float(np.sqrt(3.0))
    if rest > _UNFINISHED * level:
        warnings.warn(
            f"block {hold.block + 1}: the force is still falling at the end of the hold from {hold.end:.4g} s, by "
            f"about {50 * np.sqrt(3.0) * rest / level:.1f} % more: the plateau is not relaxed",
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
        "plateau_force": level,
        "u_plateau_force": float(np.hypot(u_level, systematic(loads, level))),
        "unfinished": rest,
        "begin": hold.begin,
        "end": hold.end,
        "plateau_begin": hold.last - _PLATEAU * (hold.last - hold.end),
        "last": hold.last,
        "block": float(hold.block),
    }


def systematic(loads: xr.Dataset, force: float) -> float:
    """Return the uncertainty of a force by tare and gain [N]; an unknown gain adds nothing."""
    return float(np.hypot(float(loads["u_tare"]), relative_gain(loads) * force))


def tests(
    ramps: list[xr.Dataset], curves: list[xr.Dataset], comparison: list[xr.Dataset], *, settings: Relaxation
) -> xr.Dataset:
    """Gather every ramp of every file, and average the modulus over the depths."""
    names, tables = [], []
    for file, *found in zip(settings.mach1, ramps, curves, comparison, strict=True):
        part = xr.merge(found, combine_attrs="drop_conflicts")
        count = part.sizes["ramp"]
        names += [Path(file).stem + (f", ramp {i + 1}" if count > 1 else "") for i in range(count)]
        kept = [n for n in part.data_vars if part[n].dims == ("ramp",)]
        tables.append(part[kept].drop_vars("ramp", errors="ignore"))
    made = xr.concat(tables, "ramp", data_vars="minimal", coords="minimal", compat="override", join="outer")
    made = made.rename(ramp="test").assign_coords(test=np.arange(1, len(names) + 1))
    made.attrs = {"names": json.dumps(names)}
    if "reduced_modulus" in made:
        made = made.merge(_averaged(made, next(float(c["nu"]) for c in curves if "nu" in c)))
    return made


def _averaged(table: xr.Dataset, nu: float) -> xr.Dataset:
    """Average the modulus over the tests, weighted by the part of u that they do not share, with the Birge ratio."""
    names = ("reduced_modulus", "reduced_modulus_own_part", "u_reduced_modulus")
    value, own, whole = (table[name].values[np.isfinite(table["reduced_modulus"])] for name in names)
    mean, weights = np.average(value, weights=1 / own**2, returned=True)
    birge = max(1.0, float(np.sqrt(np.sum(((value - mean) / own) ** 2) / max(value.size - 1, 1))))
    if birge > _BIRGE_LIMIT:
        warnings.warn(
            f"the moduli of the depths differ by {birge:.1f} times their uncertainties: the rubber "
            "is not linear, or the punch is not what session.toml says",
            stacklevel=2,
        )
    u = float(np.hypot(birge / np.sqrt(weights), np.mean(np.sqrt(np.maximum(whole**2 - own**2, 0.0)))))
    tension = 1 - nu**2
    return xr.Dataset(
        with_u("mean_reduced_modulus", (), mean, u, "Pa", "relaxed reduced modulus over all tests")
        | with_u("mean_relaxed_modulus", (), mean * tension, u * tension, "Pa", "relaxed modulus in tension")
    )

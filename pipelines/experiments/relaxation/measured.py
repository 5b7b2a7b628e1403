"""Relaxation under a periodic punch: ramps and holds, relaxation curves, moduli from plateaus, and all tests.

The modulus of a plateau is that of eq. (2.17) of the thesis.
"""

import json
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import chdtrc

from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError
from labpipe.judging import LIKELY
from labpipe.signals import independent_count
from labpipe.uncertainty import Row, Source, budget_rows, combined_uncertainty, excess_uncertainty
from labpipe.variables import from_rows, variable, with_u
from pipelines.experiments.relaxation.settings import Relaxation
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.mach1_touch import STEP
from pipelines.experiments.shared.material_choice import resolve
from pipelines.experiments.shared.punch_model import Geometry, elastic_force, relative_sources

_UNFINISHED = 0.01  # of a plateau, its uncertainty from relaxation that goes on: told
_SLOWEST = 0.9  # of a quarter's fall in the next quarter: a fall without end is not extrapolated
_FEWEST = 20  # readings of a hold
_PLATEAU = 0.1  # of a hold, its last part
_NOISE_TREND = 3  # degree in log time: what is left of the second half of a hold is noise
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
    "first": ("1", "first sample of the ramp in the file"),
    "stop": ("1", "sample of the file behind the hold"),
}


def find(loads: xr.Dataset) -> list[dict[str, float]]:
    """Return every ramp and hold of the file's Stress Relaxation blocks: the motion, in the names of :func:`ramps`.

    In addition ``held`` is the position [m] of the hold.

    Raises
    ------
    InputError
        The file holds none, or a block holds no ramp.
    """
    found: list[dict[str, float]] = []
    for block in mach1_readings.blocks_of(loads, Relaxation.function):
        place, begins = mach1_readings.rows(loads, block), True
        segment = loads["segment"].values[place]
        for first, after in pairwise(np.flatnonzero(np.diff(segment, prepend=np.nan, append=np.nan)) + place.start):
            rows = slice(int(first), int(after))
            time, position, force = (loads[name].values[rows] for name in ("time", "position_z", "force"))
            if not (np.isfinite(position).all() and np.isfinite(force).all()):
                raise InputError(f"block {block + 1}: a reading of position or force is missing during the test")
            held, near = mach1_readings.hold_of(position)
            travel = held - (float(position[0]) if begins else found[-1]["held"])
            if abs(travel) < 10 * STEP:
                raise InputError(
                    f"block {block + 1}: the stage moves by {travel * 1e6:.3g} µm only, so there is no ramp; a "
                    "relaxation test has one"
                )
            arrived = np.abs(position - held) <= near
            begin = max(int(np.argmax(np.abs(position - held + travel) > near)) - 1, 0)
            end = int(np.argmax(arrived))
            if time.size - end < _FEWEST or not np.median(arrived[end:]):
                raise InputError(f"block {block + 1}: the stage is not held after its ramp")
            since, arrival, last = (float(time[i]) for i in (begin, end, -1))
            speed = mach1_readings.ramp_speed(time[: end + 1], position[: end + 1])
            found.append(
                {
                    "held": held,
                    "travel": travel,
                    "speed": speed if np.isfinite(speed) else travel / max(arrival - since, 1e-9),
                    "begin": since,
                    "end": arrival,
                    "plateau_begin": last - _PLATEAU * (last - arrival),
                    "last": last,
                    "duration": last - arrival,
                    "block": float(block),
                    "first": float(rows.start),
                    "stop": float(rows.stop),
                }
            )
            begins = False
    return found


def samples(ramps: xr.Dataset) -> list[slice]:
    """Return where the samples of each ramp and its hold lie in the file."""
    return [slice(int(first), int(stop)) for first, stop in zip(ramps["first"], ramps["stop"], strict=True)]


def ramps(loads: xr.Dataset, *, settings: Relaxation) -> xr.Dataset:
    """Find first touch, and depth, peak and plateau of every ramp and hold of a tared, compression-positive force.

    Where the stage position of first touch is NaN depths are too.
    """
    known = mach1_readings.first_touch(loads, settings.contact)
    touch, rows = mach1_readings.touch_of(known), []
    for hold, inside in ((hold, slice(int(hold["first"]), int(hold["stop"]))) for hold in find(loads)):
        since, force = loads["time"].values[inside] - hold["end"], loads["force"].values[inside]
        where, peak = f"block {int(hold['block']) + 1}", float(force.max())
        if np.ptp(force) == 0.0:
            raise InputError(f"{where}: the force is the same in all readings; the load cell did not record")
        middles = np.array([0.5, 0.75, 1 - 0.5 * _PLATEAU])[:, None] * hold["duration"]
        tenths = np.abs(since - middles) <= (0.5 * _PLATEAU + 1e-9) * hold["duration"]
        half, later, level = (float(force[tenth].mean()) for tenth in tenths)
        u_half, _, u_level = _u_of_means(loads, since, force, tenths.sum(axis=1)).tolist()
        # The force at half and at three quarters of the hold shows how fast its fall slows down; a fall that goes on
        # so, each quarter the same share of the one before, ends lower: a rectangle of twice this half width.
        falls = max(later - level, 0.0)
        share = float(np.clip(falls / max(half - later, u_half, 1e-12), 0.0, _SLOWEST))
        rest = 2.0 * falls * share / (1.0 - share) / float(np.sqrt(3.0))
        if rest > _UNFINISHED * level:
            warnings.warn(
                f"{where}: the force is still falling at the end of the hold from {hold['end']:.4g} s, by "
                f"about {50 * np.sqrt(3.0) * rest / level:.1f} % more: the plateau is not relaxed",
                stacklevel=2,
            )
        forces = {
            "depth": hold["held"] - touch.value,
            "u_depth": float(np.hypot(touch.u, STEP / np.sqrt(12))),
            "peak_force": peak,
            "u_peak_force": float(np.hypot(np.nanmax(loads["u_force"].values), systematic(loads, peak))),
            "plateau_force": level,
            "u_plateau_force": float(np.hypot(u_level, systematic(loads, level))),
            "unfinished": rest,
        }
        rows.append(hold | forces)
    made = xr.Dataset(from_rows("ramp", rows, _COLUMNS), coords={"ramp": np.arange(1, len(rows) + 1)})
    return made.merge(known).assign_attrs(known.attrs, work=json.dumps({"ramps": len(rows)}))


def systematic(loads: xr.Dataset, force: float) -> float:
    """Return the uncertainty of a force by tare and gain [N]; an unknown gain adds nothing."""
    return float(np.hypot(float(loads["u_tare"]), mach1_readings.relative_gain(loads) * force))


def _u_of_means(loads: xr.Dataset, since: Floats, force: Floats, count: Integers) -> Floats:
    """Return the standard uncertainty [N] of means of so many readings, by the noise of the second half of a hold."""
    late, step = since >= 0.5 * since[-1], float(loads.attrs.get("resolution", 0.0))
    sd, memory = float(np.nanmax(loads["u_force"].values)), 1.0
    if late.sum() >= _FEWEST:
        log_time = np.log(since[late])
        rest = force[late] - np.polynomial.Polynomial.fit(log_time, force[late], _NOISE_TREND)(log_time)
        # the cell's filter ties neighbouring readings together, and so does a wandering zero
        sd, memory = float(rest.std()), rest.size / independent_count(rest)
    least = step / np.sqrt(12.0)
    u = max(sd, least) / np.sqrt(np.maximum(count / memory, 1.0))
    return np.asarray(np.maximum(u, least) if sd < step / 2 else u)


def curves(
    loads: xr.Dataset,
    ramps: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    *,
    settings: Relaxation,
    per_decade: int = 12,
) -> xr.Dataset:
    """Return relaxation curves over the time since the ramp, and moduli where the depth is known.

    The force of every hold is averaged in bins, so many ``per_decade`` of the time since the stage arrived, at the
    bins' mean times. Of the named material only Poisson's ratio is used.
    """
    interval, longest = float(loads["sampling_interval"][int(ramps["block"][0])]), float(ramps["duration"].max())
    edges = np.geomspace(0.5 * interval, 1.001 * longest, int(np.log10(longest / interval) * per_decade) + 2)
    text = "force in the hold, as recorded behind the cell's filter"
    words = {
        "force": ("N", text),
        "u_force": ("N", f"standard uncertainty from noise: {text}"),
        "mean_time": ("s", "mean time of a bin's readings since the stage arrived"),
        "time_spread": ("s", "standard deviation of the times of a bin's readings"),
    }
    table = np.full((len(words), ramps.sizes["ramp"], edges.size - 1), np.nan)
    for i, (rows, end) in enumerate(zip(samples(ramps), ramps["end"].values, strict=True)):
        since, force = loads["time"].values[rows] - end, loads["force"].values[rows]
        inside = (since >= edges[0]) & (since < edges[-1])
        held = pd.DataFrame({"force": force[inside], "time": since[inside]})
        bins = held.groupby(np.searchsorted(edges, since[inside], side="right") - 1)
        mean, u = bins.mean(), _u_of_means(loads, since, force, np.asarray(bins.size(), np.int64))
        table[:, i, mean.index] = mean["force"], u, mean["time"], bins["time"].std(ddof=0)
    kept = np.isfinite(table[0]).any(axis=0)
    lag = np.sqrt(edges[1:] * edges[:-1])[kept]
    dims = ("ramp", "lag")
    result = xr.Dataset(
        {name: variable(dims, one[:, kept], *words[name]) for name, one in zip(words, table, strict=True)},
        coords={"ramp": ramps["ramp"], "lag": variable("lag", lag, "s", "time since the stage arrived")},
    )
    if settings.punch is None or not np.isfinite(float(ramps["contact_position"])):
        reason = "no punch is named" if settings.punch is None else ramps.attrs["contact"]
        return result.assign_attrs(absent=f"no modulus was found: {reason}")
    substrate = settings.substrate
    nu = None if substrate is None else float(resolve(substrate, material_file, fitted).nu)
    geometry = Geometry.of(settings.punch, substrate, settings.model, nu)
    moduli = [reduced_modulus(loads, ramps.isel(ramp=i), geometry) for i in range(ramps.sizes["ramp"])]
    columns = {
        "reduced_modulus": ("Pa", "relaxed reduced modulus E/(1 - nu^2), from the plateau"),
        "reduced_modulus_own_part": ("Pa", "part of its uncertainty that other depths do not share"),
    }
    result = result.merge(xr.Dataset(from_rows("ramp", [m for m, _ in moduli], columns)))
    result["nu"] = variable((), np.nan if nu is None else nu, "1", "Poisson ratio")
    return result.assign_attrs(budgets=json.dumps([b for _, b in moduli]))


def reduced_modulus(loads: xr.Dataset, at: xr.Dataset, geometry: Geometry) -> tuple[dict[str, float], list[Row]]:
    """Invert the plateau of one ramp and hold: reduced modulus, its uncertainty, and the budget."""
    depth, force = float(at["depth"]), float(at["plateau_force"])
    if depth <= 0:
        message = f"the hold lies {-depth * 1e6:.3g} µm above first touch; the position of first touch cannot be right"
        raise InputError(message)
    value = force / float(elastic_force(np.array([depth]), geometry)[0])
    of_force, noise = value / force, excess_uncertainty(float(at["u_plateau_force"]), systematic(loads, force))
    # a deeper contact at the same force is a softer one
    of_punch = relative_sources(depth, float(at["u_depth"]), geometry)
    *shape, touch = (s._replace(sensitivity=-value * s.sensitivity) for s in of_punch)
    own = [
        Source("noise", 0.0, noise, "N", of_force, "random"),
        Source("tare", float(loads["tare"]), float(loads["u_tare"]), "N", -of_force, "systematic"),
        Source("unfinished relaxation", 0.0, float(at["unfinished"]), "N", -of_force, "systematic"),
        touch,
    ]
    gain = Source("gain", float(loads["gain"]), float(np.nan_to_num(loads["u_gain"])), "1", value, "systematic")
    sources = [*own, gain, *shape]
    row = {
        "reduced_modulus": value,
        "u_reduced_modulus": combined_uncertainty(sources),
        "reduced_modulus_own_part": combined_uncertainty(own),
    }
    return row, budget_rows(sources)


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
    if "reduced_modulus" not in made:
        return made
    names = ["reduced_modulus", "reduced_modulus_own_part", "u_reduced_modulus"]
    value, own, whole = (made[name].values[np.isfinite(made["reduced_modulus"])] for name in names)
    # weighted by the part of u that the tests do not share, with the Birge ratio
    mean, weights = np.average(value, weights=1 / own**2, returned=True)
    square = float(np.sum(((value - mean) / own) ** 2))
    birge = max(1.0, float(np.sqrt(square / max(value.size - 1, 1))))
    if chdtrc(value.size - 1, square) < LIKELY:
        warnings.warn(
            f"the moduli of the depths differ by {birge:.1f} times their uncertainties: the rubber "
            "is not linear, or the punch is not what session.toml says",
            stacklevel=2,
        )
    u = float(np.hypot(birge / np.sqrt(weights), np.mean(np.sqrt(np.maximum(whole**2 - own**2, 0.0)))))
    tension = 1 - next(float(curve["nu"]) for curve in curves if "nu" in curve) ** 2
    return made.assign(
        with_u("mean_reduced_modulus", (), mean, u, "Pa", "relaxed reduced modulus over all tests")
        | with_u("mean_relaxed_modulus", (), mean * tension, u * tension, "Pa", "relaxed modulus in tension")
    )

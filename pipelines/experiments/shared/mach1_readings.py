"""Mach-1 files in experiments: blocks, force, contact, histories."""

import json
import warnings
from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import calibration
import instruments
from calibration import load_cell
from calibration.record import LoadCellRecord
from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import InputError
from labpipe.signals import LONGEST_RUN
from labpipe.units import Quantity
from labpipe.variables import with_u
from pipelines.experiments.shared import mach1_touch
from pipelines.experiments.shared.exclusions import EXCLUDED, left_out, without_readings
from pipelines.experiments.shared.mach1_touch import FINENESS, STEP
from pipelines.experiments.shared.punch_settings import Indentation
from pipelines.experiments.shared.settings import named_columns

_APPROACH = "Find Contact"
_SLOW = 1e-3  # of a cutoff: there a filter only delays


def readings(path: Path, *, settings: object = None) -> xr.Dataset:
    """Read a file of the tester, as a stage of every kind that has one; outliers and excluded readings become NaN.

    A table whose columns the settings name is one block, of the function that the kind of experiment evaluates.
    """
    columns = named_columns(getattr(settings, "columns", None))
    found = instruments.read_table(path, "force", "mach1", columns=columns)
    found = without_readings(found, settings, "position_", "force_")
    for run in _runs(found[EXCLUDED].values != 0) if EXCLUDED in found else ():
        if run.size > LONGEST_RUN:
            raise InputError(
                f"exclude: readings {run[0] + 1} to {run[-1] + 1}: at most {LONGEST_RUN} in a row can be left out of a "
                "record that is evaluated at even sampling; exclude the whole file"
            )
    if columns is None:
        return without_outliers(found)
    name = str(getattr(settings, "function", "Stress Relaxation"))
    found.attrs["blocks"] = json.dumps([block | {"function": name} for block in json.loads(found.attrs["blocks"])])
    return without_outliers(found.assign(function=("block_index", [name])))


def _runs(flags: Flags) -> list[Integers]:
    """Return the places of each run of true flags."""
    places = np.flatnonzero(flags)
    return np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if places.size else []


def without_outliers(readings: xr.Dataset) -> xr.Dataset:
    """Leave out short runs of readings that leave a record and return to it, block by block.

    They become NaN; the attribute ``outliers`` holds, as JSON, for each run its column, block, first and last index in
    the block, and largest deviation [m or N].
    """
    made, runs = readings.copy(), []
    for name in _columns(readings):
        values = readings[name].values.astype(float)
        for number in np.unique(readings["block"].values):
            inside = rows(readings, number)
            flags, found = left_out(values[inside], readings["time"].values[inside])
            runs += [{"column": name, "block": int(number), "first": a, "last": b, "by": by} for a, b, by in found]
            values[inside][flags] = np.nan
        made[name] = readings[name].copy(data=values)
    return made.assign_attrs(outliers=json.dumps(runs)) if runs else readings


def _columns(readings: xr.Dataset) -> list[str]:
    return [name for name in map(str, readings) if name.startswith(("position_", "force_"))]


def bridged(values: Floats, time: Floats) -> Floats:
    """Fill short runs of missing readings with an Akima curve through those around: an even sampling is needed."""
    lost = _runs(~np.isfinite(values))
    if not lost or max(run.size for run in lost) > LONGEST_RUN or not np.all(np.diff(time) > 0):
        return values
    return np.asarray(pd.Series(values, time).interpolate("akima").ffill().bfill(), float)


def loads(readings: xr.Dataset, record: Path | None, *, settings: Indentation) -> xr.Dataset:
    """Make force compression-positive, as a stage of every kind; tared where the file begins with a free approach.

    Readings that are missing or were left out are bridged: at most ten in a row, by the curve through their neighbours.
    Without a calibration record of the cell the gain's uncertainty is NaN.
    """
    del settings
    made, time = {}, readings["time"].values
    for name in _columns(readings):
        blocks = (rows(readings, number) for number in np.unique(readings["block"].values))
        values = np.concatenate([bridged(readings[name].values[each], time[each]) for each in blocks])
        made[name] = readings[name].copy(data=values)
    readings = readings.assign(made)
    begins_free = str(readings["function"].values[0]) == _APPROACH
    if not begins_free:
        text = "peaks, plateaus and mean forces include the cell's offset and a preload; amplitudes and work do not"
        warnings.warn(f"the file begins in contact, so the force is not tared: {text}", stacklevel=2)
    known = None if record is None else calibration.load_record(record)
    found = load_cell.force(readings, known, zero="start" if begins_free else None)
    found = found.merge(readings[[n for n in readings.data_vars if n not in found and n != "force_z"]])
    delay = known.values.filter_delay if isinstance(known, LoadCellRecord) else None
    found.attrs["filter_delay"] = json.dumps(None if delay is None else [delay.value, delay.u])
    found.attrs["is_tared"] = int(begins_free)
    return found.assign_attrs(blocks=readings.attrs["blocks"], source=readings.attrs.get("source", ""))


def rows(loads: xr.Dataset, block: int) -> slice:
    """Return where the samples of a block lie."""
    where = np.flatnonzero(loads["block"].values == block)
    return slice(int(where[0]), int(where[-1]) + 1)


def blocks_of(loads: xr.Dataset, function: str) -> list[int]:
    """Return the numbers of the blocks of a function of the tester; InputError where there is none."""
    functions = [str(name) for name in loads["function"].values]
    if function not in functions:
        known = ", ".join(sorted(set(functions)))
        raise InputError(f"the file holds no {function} block; its blocks are: {known}")
    return [i for i, name in enumerate(functions) if name == function]


def relative_gain(loads: xr.Dataset) -> float:
    """Return the relative uncertainty of the cell's gain; an unknown one is 0."""
    return float(np.nan_to_num(float(loads["u_gain"]))) / float(loads["gain"])


def declared_filter(loads: xr.Dataset) -> dict[str, float] | None:
    """Return order and cutoff [Hz] of the load cell's low-pass, a Butterworth, when the header says so.

    Where the cell's record gives a delay the cutoff is the one that a Butterworth of this delay has.
    """
    declared, delay = load_cell.declared_filter(loads.attrs), json.loads(loads.attrs.get("filter_delay", "null"))
    if declared is None or delay is None:
        return declared
    slow = load_cell.filter_lag(_SLOW * declared["cutoff"], int(declared["order"]), declared["cutoff"])
    return declared | {"cutoff": float(declared["cutoff"]) * slow.delay / delay[0]}


def force_lag(loads: xr.Dataset, frequency: float) -> load_cell.FilterLag:
    """Return gain and lag of the load cell's filter at a frequency; without a filter they are 1 and 0.

    The uncertainty of a delay that the cell's record gives replaces that of the filter's type.
    """
    declared, delay = declared_filter(loads), json.loads(loads.attrs.get("filter_delay", "null"))
    if declared is None:
        return load_cell.FilterLag(1.0, 0.0, 0.0, 0.0, 0.0, "no filter is declared")
    lag = load_cell.filter_lag(frequency, int(declared["order"]), float(declared["cutoff"]))
    if delay is None:
        return lag
    note = "delay measured, see the record of the load cell"
    return lag._replace(u_gain=0.0, u_phase=lag.phase * delay[1] / delay[0], note=note)


def filter_delay(loads: xr.Dataset) -> Quantity:
    """Return by how much a slowly changing force comes late [s]; 0 without a filter."""
    slow = _SLOW * (declared_filter(loads) or {"cutoff": 1.0})["cutoff"]
    lag = force_lag(loads, slow)
    return Quantity(lag.delay, lag.u_phase / (2 * np.pi * slow), "s")


def passed(loads: xr.Dataset, force: Floats) -> Floats:
    """Pass the force (sample,) [N] of every block through the cell's filter."""
    from scipy.interpolate import Akima1DInterpolator
    from scipy.signal import sosfilt, sosfilt_zi

    declared, made = declared_filter(loads), force.copy()
    if declared is None:
        return made
    sections = filter_sections(declared, float(np.nanmedian(loads["sampling_interval"].values)))
    for part in (rows(loads, block) for block in np.unique(loads["block"].values)):
        each = np.arange(force[part].size * FINENESS) / FINENESS
        # a chord would cut off peaks; Akima's curve bends with them and does not overshoot corners
        fine = Akima1DInterpolator(np.arange(force[part].size), force[part], extrapolate=True)(each)
        made[part] = sosfilt(sections, fine, zi=sosfilt_zi(sections) * fine[0])[0][::FINENESS]
    return made


def filter_sections(declared: dict[str, float], interval: float) -> Floats:
    """Return the load cell's filter (section, 6) at :data:`FINENESS` steps a sampling interval [s]."""
    from scipy.signal import butter

    order, cutoff = int(declared["order"]), declared["cutoff"]
    if cutoff >= 0.5 * FINENESS / interval:
        raise InputError(
            f"readings every {interval:.3g} s cannot have passed the load cell's low-pass of {cutoff:g} "
            "Hz as the header declares it; the column of the time, or the cutoff in the header, is wrong"
        )
    return np.asarray(butter(order, cutoff, fs=FINENESS / interval, output="sos"))


def clock(loads: xr.Dataset) -> Floats:
    """Return the time of every sample since the file's first block began, in s."""
    found = [str(block.get("start") or "") for block in json.loads(loads.attrs["blocks"])]
    if len(found) == 1:
        return np.asarray(loads["time"].values)
    if not all(found):
        raise InputError("a block without a start time cannot be placed in the history of the test")
    starts = [datetime.fromisoformat(start) for start in found]
    since = np.array([(start - starts[0]).total_seconds() for start in starts])
    return loads["time"].values + since[loads["block"].values.astype(int)]


def first_touch(loads: xr.Dataset, given: Quantity | None) -> xr.Dataset:
    """Return ``contact_position`` with its u, as given or found in an approach, and how in the attribute ``contact``.

    Where it is not known it is NaN, and the attribute says why: forces need no depth.
    """
    touch, how, functions = given, "given in session.toml", [str(name) for name in loads["function"].values]
    if given is None and _APPROACH not in functions:
        how = "the file holds no Find Contact block, so the position of first touch is not known; "
        how += 'give it in session.toml: contact = "12.345 ± 0.001 mm"'
    elif given is None:
        part, declared = loads.isel(sample=rows(loads, functions.index(_APPROACH))), declared_filter(loads)
        interval = float(np.median(np.diff(part["time"].values)))
        try:
            sections = None if declared is None else filter_sections(declared, interval)
            touch = mach1_touch.touched(part, filter_delay(part), sections)
            how = "fitted to the force of the Find Contact block, with the cell's filter"
        except InputError as error:
            how = str(error)
    if touch is None:
        warnings.warn(f"no modulus and no model: {how}", stacklevel=3)
        touch = Quantity(np.nan, np.nan, "m")
    known = with_u("contact_position", (), touch.value, touch.u, "m", "stage position of first touch")
    return xr.Dataset(known, attrs={"contact": how})


def touch_of(found: xr.Dataset) -> Quantity:
    """Return the stage position of first touch that a result of :func:`first_touch` holds."""
    return Quantity(float(found["contact_position"]), float(found["u_contact_position"]), "m")


def ramp_speed(time: Floats, position: Floats) -> float:
    """Return the speed [m/s] of the middle of a ramp that ends with the last reading; NaN by fewer than three."""
    share = (position - position[0]) / ((position[-1] - position[0]) or np.nan)
    middle = (share > 0.1) & (share < 0.9)
    return float(np.polyfit(time[middle], position[middle], 1)[0]) if middle.sum() > 2 else np.nan


def hold_of(position: Floats, share: float = 2e-3) -> tuple[float, float]:
    """Return the position [m] of the hold after a ramp, and within which distance of it [m] the stage has arrived."""
    return float(np.median(position[position.size // 2 :])), max(share * float(np.ptp(position)), 2.0 * STEP)


def filter_settles(loads: xr.Dataset, time_constants: float = 20.0) -> float:
    """Return the time [s] after which the cell's filter leaves a relaxation as it is; 0 without a filter."""
    declared = declared_filter(loads)
    return 0.0 if declared is None else time_constants / (2.0 * np.pi * declared["cutoff"])


def history(time: Floats, displacement: Floats, per_decade: int = 25) -> Integers:
    """Choose the samples that a simulation needs: all in motion, of a rest a few per decade, the first and the last."""
    moving = np.concatenate([[True], np.diff(displacement) != 0])
    moving[:-1] |= moving[1:]
    kept: list[Integers] = [np.flatnonzero(moving), np.array([0, time.size - 1])]
    for rest in _runs(~moving):
        points = max(4, int(np.log10(rest.size) * per_decade))
        kept.append(rest[np.geomspace(1, rest.size, points).astype(int) - 1] if rest.size >= 4 else rest)
    return np.unique(np.concatenate(kept)).astype(np.int64)

"""Mach-1 files in experiments: blocks, force, contact, histories."""

import json
import warnings
from datetime import datetime
from pathlib import Path

import numpy as np
import xarray as xr

import calibration
import instruments
from calibration import load_cell
from calibration.record import LoadCellRecord
from labpipe.arrays import Floats, Integers
from labpipe.errors import InputError
from labpipe.signals import LONGEST_RUN, outliers
from labpipe.units import Quantity
from labpipe.variables import variable, with_u
from pipelines.experiments.shared import mach1_touch
from pipelines.experiments.shared.exclusions import EXCLUDED, without_readings
from pipelines.experiments.shared.punch_settings import Indentation
from pipelines.experiments.shared.settings import named_columns

LAST_DECIMAL = 1e-9
"""Last decimal of a position in m: every file has six of a millimetre."""

_STATE = {"units": "1", "long_name": "state of the reading: 0 valid, 1 left out as an outlier"}
_APPROACH = "Find Contact"
_KINDS = ("butterworth", "bessel")  # what a header's "low-pass" may be, the likelier first
_CONSISTENT = 3.0  # standard uncertainties between two delays that may be one
_SLOW = 1e-3  # of a cutoff: there a filter only delays
_FILTER_FINENESS = 10  # steps per sample, so that a digital filter behaves as the analogue one
_SETTLED = 5.0  # s of a hold after which the filter's delay changes the force by less than 1e-4
_POINTS_PER_DECADE = 25  # of a rest, kept for the simulation: force is smooth in log time


def readings(path: Path, *, settings: object = None) -> xr.Dataset:
    """Read a file of the tester, as a stage of every kind that has one; outliers and excluded readings become NaN.

    A table whose columns the settings name is one block, of the function that the kind of experiment evaluates.
    """
    columns = named_columns(getattr(settings, "columns", None))
    found = _without_excluded(instruments.read_table(path, "force", "mach1", columns=columns), settings)
    if columns is None:
        return without_outliers(found)
    name = str(getattr(settings, "function", "Stress Relaxation"))
    found.attrs["blocks"] = json.dumps([block | {"function": name} for block in json.loads(found.attrs["blocks"])])
    found = found.assign(function=("block_index", [name]))
    if name == "Sinusoid":  # that other testers do not state; the fit begins there
        position, time = found["position_z"].values, found["time"].values
        spectrum = np.abs(np.fft.rfft(position - position.mean()))
        frequency = float(np.argmax(spectrum)) / (np.ptp(time) * position.size / (position.size - 1))
        for of, value, unit in (("frequency", frequency, "Hz"), ("amplitude", 0.5 * float(np.ptp(position)), "m")):
            found[f"declared_{of}"] = variable("block_index", [value], unit, f"{of} of the largest motion")
    return without_outliers(found)


def _without_excluded(readings: xr.Dataset, settings: object) -> xr.Dataset:
    """Leave excluded readings out: NaN and :data:`EXCLUDED`; few in a row, as the analysis bridges them."""
    made = without_readings(readings, settings, "position_", "force_")
    if EXCLUDED not in made:
        return readings
    flags = made[EXCLUDED].values.astype(bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        if after - first > LONGEST_RUN:
            raise InputError(
                f"exclude: readings {first + 1} to {after}: at most {LONGEST_RUN} in a row can be left out of a "
                "record that is evaluated at even sampling; exclude the whole file"
            )
    columns = [str(n) for n in readings if str(n).startswith(("position_", "force_"))]
    return made.assign_attrs(
        excluded=json.dumps([[name, int(b)] for b in np.unique(readings["block"].values[flags]) for name in columns])
    )


def without_outliers(readings: xr.Dataset) -> xr.Dataset:
    """Leave out short runs of readings that leave a record and return to it, block by block.

    Sets ``status`` (sample,) to 1 where a position or a force was left out, and the attribute ``outliers``: as JSON
    for each run its column, block, first and last index in the block, and largest deviation [m or N].
    """
    block, time = readings["block"].values, readings["time"].values
    made, left_out = readings.copy(), []
    status = np.zeros(block.size, np.int8)
    for name in (str(n) for n in readings if str(n).startswith(("position_", "force_"))):
        values = readings[name].values.astype(float)
        for number in np.unique(block):
            where = np.flatnonzero(block == number)
            rising = np.all(np.diff(time[where]) > 0)
            found = outliers(values[where], time[where] if rising else None)
            if not found.runs:
                continue
            off = np.abs(values[where] - bridged(np.where(found.flags, np.nan, values[where]), time[where]))
            left_out += [
                {"column": name, "block": int(number), "first": a, "last": b, "by": float(off[a : b + 1].max())}
                for a, b in found.runs
            ]
            values[where[found.flags]] = np.nan
            status[where[found.flags]] = 1
        made[name] = readings[name].copy(data=values)
    if not left_out:
        return readings
    made["status"] = ("sample", status, _STATE)
    return made.assign_attrs(outliers=json.dumps(left_out))


def bridged(values: Floats, time: Floats) -> Floats:
    """Fill readings that were left out with an Akima curve through those around, where an even sampling is needed."""
    from scipy.interpolate import Akima1DInterpolator

    lost = ~np.isfinite(values)
    if not lost.any() or lost.sum() > values.size - 2 or not np.all(np.diff(time) > 0):
        return values
    made = values.copy()
    curve = Akima1DInterpolator(time[~lost], values[~lost], method="makima")
    inside = np.clip(time[lost], time[~lost][0], time[~lost][-1])
    made[lost] = curve(inside)
    return made


def loads(readings: xr.Dataset, record: Path | None, *, settings: Indentation) -> xr.Dataset:
    """Make force compression-positive, as a stage of every kind; tared where the file begins with a free approach.

    Readings that were left out are bridged: at most ten in a row, by the curve through their neighbours.
    Without a calibration record of the cell the gain's uncertainty is NaN.
    """
    left_out = [(run["column"], run["block"]) for run in json.loads(readings.attrs.get("outliers", "[]"))]
    left_out += map(tuple, json.loads(readings.attrs.get("excluded", "[]")))
    for name, number in sorted(set(left_out)):
        where, values = readings["block"].values == number, readings[name].values.copy()
        values[where] = bridged(values[where], readings["time"].values[where])
        readings = readings.assign({name: readings[name].copy(data=values)})
    tare, begins_free = settings.load_cell.tare, str(readings["function"].values[0]) == _APPROACH
    if tare and not begins_free:
        text = "peaks, plateaus and mean forces include the cell's offset and a preload; amplitudes and work do not"
        warnings.warn(f"the file begins in contact, so the force is not tared: {text}", stacklevel=2)
    known = None if record is None else calibration.load_record(record)
    made = load_cell.force(readings, known, zero="start" if tare and begins_free else None)
    made = made.merge(readings[[n for n in readings.data_vars if n not in made and n != "force_z"]])
    delay = known.values.filter_delay if isinstance(known, LoadCellRecord) else None
    made.attrs["filter_delay"] = json.dumps(None if delay is None else [delay.value, delay.u])
    made.attrs["is_tared"] = int(tare and begins_free)
    return made.assign_attrs(blocks=readings.attrs["blocks"], source=readings.attrs.get("source", ""))


def rows(loads: xr.Dataset, block: int) -> slice:
    """Return where the samples of a block lie."""
    where = np.flatnonzero(loads["block"].values == block)
    return slice(int(where[0]), int(where[-1]) + 1)


def declared_filter(loads: xr.Dataset) -> dict[str, float] | None:
    """Return order and cutoff of the load cell's low-pass, when the header says so."""
    return load_cell.declared_filter(loads.attrs)


def force_lag(loads: xr.Dataset, frequency: float) -> load_cell.FilterLag | None:
    """Return gain and lag of the load cell's filter at a frequency; None without a filter.

    A delay that the cell's record gives stretches the lag of the assumed filter, so that how it
    changes with frequency is kept; its uncertainty then replaces that of the filter's type.
    """
    declared = declared_filter(loads)
    if declared is None:
        return None
    order, cutoff = int(declared["order"]), float(declared["cutoff"])
    lag = load_cell.filter_lag(frequency, order, cutoff)
    measured = json.loads(loads.attrs.get("filter_delay", "null"))
    if measured is None:
        return lag
    value, u = measured
    slow = load_cell.filter_lag(_SLOW * cutoff, order, cutoff).delay
    note = "delay measured, see the record of the load cell"
    # where the delay leaves one kind of filter, its gain is known
    u_gain = 0.0 if filter_kinds(loads) == _KINDS[:1] else lag.u_gain
    phase, u_phase, delay = lag.phase * value / slow, lag.phase * u / slow, lag.delay * value / slow
    return lag._replace(u_gain=u_gain, phase=phase, u_phase=u_phase, delay=delay, note=note)


def filter_delay(loads: xr.Dataset) -> Quantity:
    """Return by how much a slowly changing force comes late [s]; 0 without a filter."""
    declared = declared_filter(loads)
    slow = 0.0 if declared is None else _SLOW * float(declared["cutoff"])
    lag = force_lag(loads, slow) if slow else None
    if lag is None:
        return Quantity(0.0, 0.0, "s")
    return Quantity(lag.delay, lag.u_phase / (2 * np.pi * slow), "s")


def filter_kinds(loads: xr.Dataset) -> tuple[str, ...]:
    """Return which kinds of filter the load cell may have: those of the delay in its record.

    Without a delay in the record, or with one that fits no kind, all of them, the likeliest first.
    """
    from scipy.signal import besselap, buttap

    declared = declared_filter(loads)
    measured = json.loads(loads.attrs.get("filter_delay", "null"))
    if declared is None or measured is None:
        return _KINDS
    order, turn, (value, u) = int(declared["order"]), 2 * np.pi * declared["cutoff"], measured
    poles = zip(_KINDS, (buttap(order)[1], besselap(order, norm="mag")[1]), strict=True)
    delays = {kind: float(np.real(np.sum(-1 / each))) / turn for kind, each in poles}
    return tuple(kind for kind, delay in delays.items() if abs(delay - value) <= _CONSISTENT * u) or _KINDS


def filtered(
    force_values: Floats, interval: float, declared: dict[str, float] | None, kind: str = "butterworth"
) -> Floats:
    """Pass a force (n,) [N] at the instrument's rate through the load cell's filter, assumed causal.

    ``declared`` has ``order`` and ``cutoff`` as the header says; None leaves the force as it is. The kind of filter,
    "butterworth" or "bessel", the header does not say.
    """
    from scipy.interpolate import Akima1DInterpolator
    from scipy.signal import sosfilt, sosfilt_zi

    if declared is None:
        return force_values
    coarse = np.arange(force_values.size)
    fine = np.arange(force_values.size * _FILTER_FINENESS) / _FILTER_FINENESS
    # a chord would cut off peaks; Akima's curve bends with them and does not overshoot corners
    force_between = Akima1DInterpolator(coarse, force_values, extrapolate=True)(fine)
    rate = _FILTER_FINENESS / interval
    sections = _sections(declared, kind, rate)
    passed, _ = sosfilt(sections, force_between, zi=sosfilt_zi(sections) * force_between[0])
    return passed[::_FILTER_FINENESS]


def passed(loads: xr.Dataset, force_values: Floats, kind: str = "") -> Floats:
    """Pass the force (sample,) [N] of every block through the cell's filter, while the stage moves and after.

    ``kind`` is by default the likeliest. In a long hold the force is so slow that a filter leaves it as it is.
    """
    declared, made = declared_filter(loads), force_values.copy()
    interval = float(np.nanmedian(loads["sampling_interval"].values))
    moving = np.flatnonzero(np.diff(loads["position_z"].values, prepend=np.nan) != 0)
    for block in np.unique(loads["block"].values) if declared is not None else ():
        where = rows(loads, block)
        inside = moving[(moving >= where.start) & (moving < where.stop)]
        last = int(inside[-1]) if inside.size else where.start
        part = slice(where.start, min(where.stop, last + round(_SETTLED / interval)))
        made[part] = filtered(force_values[part], interval, declared, kind or filter_kinds(loads)[0])
    return made


def _sections(declared: dict[str, float], kind: str, rate: float) -> Floats:
    """Return the load cell's filter (section, 6) at a rate [Hz]."""
    from scipy.signal import bessel, butter

    order, cutoff = int(declared["order"]), declared["cutoff"]
    if cutoff >= 0.5 * rate:
        raise InputError(
            f"readings every {_FILTER_FINENESS / rate:.3g} s cannot have passed the load cell's low-pass of {cutoff:g} "
            "Hz as the header declares it; the column of the time, or the cutoff in the header, is wrong"
        )
    if kind == "bessel":
        return np.asarray(bessel(order, cutoff, fs=rate, output="sos", norm="mag"))
    return np.asarray(butter(order, cutoff, fs=rate, output="sos"))


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


def contact_position(loads: xr.Dataset, given: Quantity | None) -> tuple[Quantity, str]:
    """Return the stage position of first touch, and how it was found.

    Raises
    ------
    InputError
        It is neither given nor found in an approach.
    """
    if given is not None:
        return given, "given in session.toml"
    functions = [str(f) for f in loads["function"].values]
    if _APPROACH not in functions:
        raise InputError(
            "the file holds no Find Contact block, so the position of first touch is not known; "
            'give it in session.toml: contact = "12.345 ± 0.001 mm"'
        )
    part = loads.isel(sample=rows(loads, functions.index(_APPROACH)))
    declared, filters, delay = declared_filter(loads), [np.empty((0, 6))], 0.0
    if declared is not None:
        interval, cutoff = float(np.median(np.diff(part["time"].values))), declared["cutoff"]
        filters = [_sections(declared, kind, mach1_touch.FINENESS / interval) for kind in filter_kinds(part)]
        delay = load_cell.filter_lag(_SLOW * cutoff, int(declared["order"]), cutoff).delay
    found = mach1_touch.touched(part, delay, filters)
    return found, "fitted to the force of the Find Contact block, with the cell's filter"


def first_touch(loads: xr.Dataset, given: Quantity | None) -> xr.Dataset:
    """Return ``contact_position`` with its u, and the attribute ``contact``; NaN and the reason where there is none."""
    try:
        touch, how = contact_position(loads, given)
    except InputError as error:  # forces need no depth
        warnings.warn(f"no modulus and no model: {error}", stacklevel=3)
        touch, how = Quantity(np.nan, np.nan, "m"), str(error)
    known = with_u("contact_position", (), touch.value, touch.u, "m", "stage position of first touch")
    return xr.Dataset(known, attrs={"contact": how})


def touch_of(found: xr.Dataset) -> Quantity:
    """Return the stage position of first touch that a result of :func:`first_touch` holds."""
    return Quantity(float(found["contact_position"]), float(found["u_contact_position"]), "m")


def history(time: Floats, displacement: Floats) -> Integers:
    """Choose the samples that a simulation needs: all in motion, few at rest, the first and the last."""
    moving = np.concatenate([[True], np.diff(displacement) != 0])
    moving[:-1] |= moving[1:]
    kept: list[Integers] = [np.flatnonzero(moving), np.array([0, time.size - 1])]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (~moving).astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        count = last - first
        points = max(4, int(np.log10(count) * _POINTS_PER_DECADE))
        picks = np.arange(count) if count < 4 else np.geomspace(1, count, points).astype(int) - 1
        kept.append(first + picks)
    return np.unique(np.concatenate(kept)).astype(np.int64)

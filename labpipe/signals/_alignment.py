"""Repeats on a common time axis, with their band."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError
from labpipe.signals._readings import checked_times, refuse_infinite
from labpipe.variables import variable

_ROUNDING = 1e-6  # of an interval


def combine_repeats(records: Sequence[xr.DataArray], starts: ArrayLike) -> xr.Dataset:
    """Put repeats on one time axis, each counted from its own start.

    Parameters
    ----------
    records : sequence of DataArray (time,)
        One quantity, named, of every repeat.
    starts : array (repeat,) [s]
        Time in each record that becomes 0, for example its first contact.

    Returns
    -------
    Dataset
        Over ``time`` (from the first to the last moment that any repeat covers, at the finest interval) and ``repeat``:
        the quantity, NaN outside a record; over ``time`` ``<name>_mean``, ``<name>_sd`` and the number ``n`` of
        repeats; ``is_outlier`` over ``repeat``: flagged, never left out of mean or band.

    Raises
    ------
    InputError
        There are no records, names, units or counts differ, times do not increase, or a value is infinite.

    Notes
    -----
    A repeat is an outlier when its root-mean-square distance from the median curve is more than five robust standard
    deviations above that of the others; with fewer than four none is flagged. Records are interpolated linearly.
    """
    starts = np.asarray(starts, float)
    if len(records) == 0 or len(records) != starts.size:
        raise InputError(f"{len(records)} records with {starts.size} starts cannot be combined")
    name, units = records[0].name, records[0].attrs.get("units")
    if any(r.name != name or r.attrs.get("units") != units for r in records):
        raise InputError("repeats must hold one quantity in one unit; names or units differ")
    if not np.all(np.isfinite(starts)):
        raise InputError("a repeat has no start to be aligned at")
    for k, record in enumerate(records):
        checked_times(record["time"].values, f"time of repeat {k + 1}")
        refuse_infinite(np.asarray(record.values, float), f"repeat {k + 1}")
        if record.size < 2:
            raise InputError(f"a repeat needs two readings; repeat {k + 1} has {record.size}")
    # A grid through 0 at the finest interval; a point on the very edge of a record counts as inside despite rounding.
    own = [r["time"].values - s for r, s in zip(records, starts, strict=True)]
    interval = min(float(np.median(np.diff(t))) for t in own)
    first, last = min(float(t[0]) for t in own), max(float(t[-1]) for t in own)
    if not last - first <= 20_000_000 * interval:  # a thousand times a long record, and still in memory
        text = f"{last - first:.3g} s at the finest interval of {interval:.3g} s are more than 20000000 samples"
        raise InputError(f"{text}; give all records their times in s")
    time = interval * np.arange(np.ceil(first / interval - _ROUNDING), np.floor(last / interval + _ROUNDING) + 1)
    values = np.empty((len(own), len(time)))
    for row, t, record in zip(values, own, records, strict=True):
        t[[0, -1]] += _ROUNDING * (t[-1] - t[0]) / (t.size - 1) * np.array([-1.0, 1.0])
        row[:] = np.interp(time, t, record.values, left=np.nan, right=np.nan)
    n = np.isfinite(values).sum(axis=0)
    mean = np.where(n > 0, np.nansum(values, axis=0) / np.maximum(n, 1), np.nan)
    spread = np.nansum((values - mean) ** 2, axis=0) / np.maximum(n - 1, 1)
    sd = np.where(n > 1, np.sqrt(spread), np.nan)
    label = records[0].attrs.get("long_name", str(name))
    return xr.Dataset(
        {
            str(name): variable(("repeat", "time"), values, str(units), label),
            f"{name}_mean": variable("time", mean, str(units), f"{label}, mean of the repeats"),
            f"{name}_sd": variable("time", sd, str(units), f"{label}, standard deviation over repeats"),
            "n": variable("time", n.astype(float), "1", "repeats at this time"),
            "is_outlier": ("repeat", _outliers(values), {"long_name": "is an outlier among the repeats"}),
        },
        coords={
            "time": variable("time", time, "s", "time since the repeat's start"),
            "repeat": np.arange(1, len(records) + 1),
        },
    )


def _outliers(values: Floats) -> Flags:
    shared = values[:, np.isfinite(values).all(axis=0)]
    if len(values) < 4 or not shared.size:  # among three, none can be called wrong
        return np.zeros(len(values), dtype=bool)
    distance = np.sqrt(np.mean((shared - np.median(shared, axis=0)) ** 2, axis=1))
    centre = np.median(distance)
    scale = 1.4826 * np.median(np.abs(distance - centre))
    # identical repeats have no scatter to be compared with
    floor = 1e-12 * max(float(np.ptp(shared)), np.finfo(float).tiny)
    return np.asarray(distance > centre + 5.0 * max(scale, 0.1 * centre, floor))

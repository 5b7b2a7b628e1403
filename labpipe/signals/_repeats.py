"""Repeats of one experiment on a common time axis: mean, band, number, outliers."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Flags, Floats
from labpipe.errors import InputError
from labpipe.signals._readings import checked_times, refuse_endless, refuse_infinite
from labpipe.variables import described, variable

_OUTLYING = 5.0  # robust standard deviations from the median of the repeats
_ROUNDING = 1e-6  # of an interval
_FEWEST_FOR_OUTLIERS = 4  # among three, nothing tells which one is wrong


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
        Over ``time`` (from the first to the last moment that any repeat covers, at the finest
        interval of the repeats) and ``repeat``: the quantity, NaN outside a record;
        ``<name>_mean``, ``<name>_sd`` over ``time``; ``n`` repeats over ``time``;
        ``is_outlier`` over ``repeat``: flagged, never left out of mean or band.

    Raises
    ------
    InputError
        There are no records, names, units or counts differ, times do not increase, or a value is
        infinite.

    Notes
    -----
    A repeat is an outlier when its root-mean-square distance from the median curve lies more than
    five robust standard deviations above that of the others; with fewer than four repeats nothing
    is flagged. Records are interpolated linearly.
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
    time = _common_time(records, starts)
    values = np.array(
        [_interpolated(time, r["time"].values - s, r.values) for r, s in zip(records, starts, strict=True)]
    )
    n = np.isfinite(values).sum(axis=0)
    mean = np.where(n > 0, np.nansum(values, axis=0) / np.maximum(n, 1), np.nan)
    spread = np.nansum((values - mean) ** 2, axis=0) / np.maximum(n - 1, 1)
    sd = np.where(n > 1, np.sqrt(spread), np.nan)
    label = records[0].attrs.get("long_name", str(name))

    def text(note: str) -> dict[str, str]:
        return described(str(units), f"{label}, {note}")

    return xr.Dataset(
        {
            str(name): variable(("repeat", "time"), values, str(units), label),
            f"{name}_mean": ("time", mean, text("mean of the repeats")),
            f"{name}_sd": ("time", sd, text("standard deviation over repeats")),
            "n": variable("time", n.astype(float), "1", "repeats at this time"),
            "is_outlier": ("repeat", _outliers(values), {"long_name": "is an outlier among the repeats"}),
        },
        coords={
            "time": variable("time", time, "s", "time since the repeat's start"),
            "repeat": np.arange(1, len(records) + 1),
        },
    )


def _interpolated(time: Floats, own: Floats, values: Floats) -> Floats:
    slack = _ROUNDING * (own[-1] - own[0]) / max(own.size - 1, 1)
    inside = (time >= own[0] - slack) & (time <= own[-1] + slack)
    return np.where(inside, np.interp(time, own, values), np.nan)


def _common_time(records: Sequence[xr.DataArray], starts: Floats) -> Floats:
    """Return a grid through 0 at the finest interval, as long as the longest repeat."""
    interval = min(float(np.median(np.diff(r["time"].values))) for r in records)
    first = min(float(r["time"][0]) - s for r, s in zip(records, starts, strict=True))
    last = max(float(r["time"][-1]) - s for r, s in zip(records, starts, strict=True))
    refuse_endless(last - first, interval)
    # a grid point on the very edge of a record counts as inside despite rounding
    lowest, highest = np.ceil(first / interval - _ROUNDING), np.floor(last / interval + _ROUNDING)
    return interval * np.arange(lowest, highest + 1)


def _outliers(values: Floats) -> Flags:
    if len(values) < _FEWEST_FOR_OUTLIERS:
        return np.zeros(len(values), dtype=bool)
    covered = np.isfinite(values).all(axis=0)
    if not covered.any():
        return np.zeros(len(values), dtype=bool)
    shared = values[:, covered]
    distance = np.sqrt(np.mean((shared - np.median(shared, axis=0)) ** 2, axis=1))
    centre = np.median(distance)
    scale = 1.4826 * np.median(np.abs(distance - centre))
    # identical repeats have no scatter to be compared with
    floor = 1e-12 * max(float(np.ptp(shared)), np.finfo(float).tiny)
    return distance > centre + _OUTLYING * max(scale, 0.1 * centre, floor)

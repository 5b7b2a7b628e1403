"""Align two records in time: at an event in both, or by the best-fitting lag."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy import fft
from scipy.interpolate import CubicSpline

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._noise import estimate_noise
from labpipe.signals._readings import checked_times, is_constant, refuse_endless, refuse_infinite
from labpipe.signals._residuals import parameter_covariance
from labpipe.signals._smoothing_spline import evaluate, smooth
from labpipe.variables import described

_STEPS = 30  # of Gauss-Newton at most; four are usual
_SETTLED = 1e-6  # sampling intervals
_FEWEST = 12  # readings
_LEAST_OVERLAP = 0.25  # of the shorter record, when the reach is not given


@dataclass(frozen=True, slots=True)
class Lag:
    """``second(t + lag) = offset + gain first(t)``, with standard uncertainties.

    ``lag`` in s is positive when the second record is later; ``correlation`` is that of the
    aligned records; ``n`` the readings compared.
    """

    lag: float
    u_lag: float
    gain: float
    u_gain: float
    offset: float
    u_offset: float
    correlation: float
    n: int


def timed_from_event(record: xr.DataArray, event: float) -> xr.DataArray:
    """Count time from an event.

    Parameters
    ----------
    record : DataArray (time,)
    event : float [s]
        Time in the record that becomes 0, for example ``first_contact_time``.

    Returns
    -------
    DataArray (time,)
        A copy with shifted ``time`` (long name "time from the event").

    Raises
    ------
    InputError
        The event is not finite.
    """
    if not np.isfinite(event):
        raise InputError(f"cannot align at {event}: the event was not found in this record")
    shifted = record.assign_coords(time=record["time"] - event)
    shifted["time"].attrs = described("s", "time from the event")
    return shifted


def interpolated_at(record: xr.DataArray, time: Floats) -> xr.DataArray:
    """Interpolate linearly; NaN outside the record and next to unread samples.

    Parameters
    ----------
    record : DataArray (time,)
    time : array (m,) [s]

    Returns
    -------
    DataArray (time,)

    Raises
    ------
    InputError
        The record's times do not increase, or a value is infinite.
    """
    own = checked_times(record["time"].values)
    refuse_infinite(np.asarray(record.values, float), "a record")
    values = np.interp(time, own, record.values, left=np.nan, right=np.nan)
    coordinate = ("time", np.asarray(time, float), record["time"].attrs)
    return xr.DataArray(values, dims="time", coords={"time": coordinate}, name=record.name, attrs=record.attrs)


def lag(first: xr.DataArray, second: xr.DataArray, largest: float | None = None) -> Lag:
    """Find how much later the second record is, to a fraction of a sample.

    Parameters
    ----------
    first, second : DataArray (time,)
        The same motion seen by two instruments, at any rates; scales and zeros may differ. NaN is
        bridged linearly for the search and left out of the fit.
    largest : float, optional [s]
        Largest lag considered; default such that a quarter of the shorter record overlaps.

    Returns
    -------
    Lag

    Raises
    ------
    InputError
        Too few readings, no motion, or no overlap.

    Notes
    -----
    The maximum of the cross-correlation on a common grid starts a least-squares fit of lag, gain
    and offset with a cubic spline through the second record; the uncertainty accounts for
    correlated residuals. The noise of the second record weakens the gain by its share of the
    variance (attenuation); put the quieter record second.

    Examples
    --------
    >>> time = np.arange(0.0, 1.0, 0.01)
    >>> a = xr.DataArray(np.sin(9 * time), {"time": time})
    >>> b = xr.DataArray(2 * np.sin(9 * (time - 0.0123)), {"time": time})
    >>> found = lag(a, b, 0.2)
    >>> round(found.lag, 5), round(found.gain, 3)
    (0.0123, 2.0)
    """
    t1, y1 = _readings(first)
    t2, y2 = _readings(second)
    start = _coarse(t1, y1, t2, y2, largest)
    spline = CubicSpline(t2, y2)
    # The derivative of the interpolant is mostly noise and would feign certainty.
    smoothed = smooth(t2, y2, estimate_noise(y2 - y2[0], t2).sigma)
    interval = float(np.median(np.diff(t1)))
    # Gauss-Newton on (lag, gain, offset); the overlap is fixed so that the sum stays comparable.
    inside = (t1 + start >= t2[0] + interval) & (t1 + start <= t2[-1] - interval)
    t, y = t1[inside], y1[inside]
    if len(t) < _FEWEST:
        raise InputError(f"the records overlap in {len(t)} readings only; at least {_FEWEST} are needed")
    if is_constant(y):
        raise InputError("a record is constant where the two overlap, so it determines no lag")
    shift = start
    for _ in range(_STEPS):
        moved, rate = spline(t + shift), evaluate(smoothed, t + shift, 1)[0]
        design = np.column_stack([y, np.ones_like(t), -rate])
        solution, *_ = np.linalg.lstsq(design, moved, rcond=None)
        step = float(np.clip(solution[2], -2 * interval, 2 * interval))
        shift += step
        if abs(step) < _SETTLED * interval:
            break
    moved = spline(t + shift)
    rate = evaluate(smoothed, t + shift, 1)[0]
    jacobian = np.column_stack([y, np.ones_like(t), -rate])
    (gain, offset), *_ = np.linalg.lstsq(jacobian[:, :2], moved, rcond=None)
    left = moved - gain * y - offset
    u_gain, u_offset, u_shift = np.sqrt(np.maximum(np.diag(parameter_covariance(jacobian, left)), 0))
    correlation = float(np.corrcoef(y, moved)[0, 1])
    return Lag(
        float(shift), float(u_shift), float(gain), float(u_gain), float(offset), float(u_offset), correlation, len(t)
    )


def _readings(record: xr.DataArray) -> tuple[Floats, Floats]:
    t, y = checked_times(record["time"].values), np.asarray(record.values, float)
    refuse_infinite(y, "a record")
    finite = np.isfinite(y)
    t, y = t[finite], y[finite]
    if len(t) < _FEWEST:
        raise InputError(f"a lag needs {_FEWEST} readings; found {len(t)}")
    if is_constant(y):
        raise InputError("a record is constant, so it determines no lag")
    return t, y


def _coarse(t1: Floats, y1: Floats, t2: Floats, y2: Floats, largest: float | None) -> float:
    """Lag of the largest normalised correlation on a common grid."""
    interval = float(min(np.median(np.diff(t1)), np.median(np.diff(t2))))
    refuse_endless(float(max(t1[-1] - t1[0], t2[-1] - t2[0])), interval)
    grid1 = np.arange(t1[0], t1[-1] + 0.5 * interval, interval)
    grid2 = np.arange(t2[0], t2[-1] + 0.5 * interval, interval)
    a, b = np.interp(grid1, t1, y1), np.interp(grid2, t2, y2)
    a, b = (a - a.mean()) / a.std(), (b - b.mean()) / b.std()
    lags = np.arange(1 - len(a), len(b))
    size = fft.next_fast_len(len(lags), real=True)
    # values, squares and ones of each, the first turned around: their products are correlations
    one, two = (fft.rfft(np.stack([y, y**2, np.ones_like(y)]), size) for y in (a[::-1], b))
    pairs = np.stack([two[2] * one[2], two[0] * one[0], two[1] * one[2], two[2] * one[1]])
    overlap, product, second, first = fft.irfft(pairs, size)[:, : len(lags)]
    overlap, power = overlap.round(), second * first
    shifts = lags * interval + (grid2[0] - grid1[0])
    allowed = overlap >= max(_FEWEST, _LEAST_OVERLAP * min(len(a), len(b)))
    if largest is not None:
        allowed = (overlap >= _FEWEST) & (np.abs(shifts) <= largest + 0.5 * interval)
    if not allowed.any():
        raise InputError("the records do not overlap within the largest lag")
    score = np.where(allowed, np.abs(product) / np.sqrt(np.maximum(power, 1e-12)), -np.inf)
    return float(shifts[int(np.argmax(score))])

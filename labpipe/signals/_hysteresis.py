"""Cycles of a harmonic test: the interval of motion, the steady cycles, the work of each."""

import json
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._metrics import independent_count
from labpipe.signals._noise import difference_sigma, quantisation_step
from labpipe.signals._oscillation import fit_sinusoid
from labpipe.signals._readings import checked_times, is_constant, refuse_infinite
from labpipe.variables import variable

_MOVED_SIGMA, _MOVED_SHARE = 6.0, 5e-3  # off its rest level by noise, and by part of the range
_FIRST = 10  # readings that are taken to be at rest, if any are
_EASING = 1  # cycles left out at either end: the stage eases in and out of the motion
_STEADY = 0.01  # relative difference from the median of the later half
_STEADY_SPREADS = 5.0  # or this many robust spreads, whichever is wider
_ROUNDING = 0.05  # of a cycle that a part may lack of a whole number
_POINTS_PER_CYCLE = 512  # of the path whose area is taken; its error is below 1e-5
_COLUMNS = (
    ("work", "J", "work dissipated in the cycle"),
    ("position_amplitude", "m", "amplitude of the position"),
    ("force_amplitude", "N", "amplitude of the force"),
    ("storage_stiffness", "N/m", "storage stiffness"),
    ("loss_stiffness", "N/m", "loss stiffness"),
    ("mean_force", "N", "mean force of the cycle"),
)


@dataclass(frozen=True, slots=True)
class Window:
    """Where a driven motion is.

    ``start`` and ``end`` (s) bound the motion; ``frequency`` (Hz) is a fit to its middle.
    ``steady_start`` and ``steady_end`` leave out the first and the last cycle.
    """

    start: float
    end: float
    frequency: float
    steady_start: float
    steady_end: float

    def slice(self, time: ArrayLike) -> slice:
        """Return the samples of the steady cycles."""
        edges = np.searchsorted(np.asarray(time, float), [self.steady_start, self.steady_end])
        return slice(int(edges[0]), int(edges[1]))


def active_window(time: ArrayLike, position: ArrayLike, frequency_guess: float | None = None) -> Window:
    """Find the motion between the rests before and after it, and its steady part.

    Parameters
    ----------
    time : array (n,) [s]
    position : array (n,) [m]
    frequency_guess : float, optional [Hz]
        Default the strongest line.

    Returns
    -------
    Window

    Raises
    ------
    InputError
        There is no motion, or no cycle is left.

    Notes
    -----
    The rule: the motion begins with the first, and ends with the last reading that is further from
    the level at that end of the record than six standard deviations and 0.5 % of the range.
    """
    t, x = np.asarray(time, float), np.asarray(position, float)
    if t.ndim != 1 or t.shape != x.shape:
        raise InputError(f"time and position must be one-dimensional and alike: {t.shape} and {x.shape}")
    t = checked_times(t)
    refuse_infinite(x, "position")
    finite = np.isfinite(x)
    t, x = t[finite], x[finite]
    if len(x) < 16 or is_constant(x):
        raise InputError(f"no motion in {len(x)} readings")
    extent = float(np.ptp(x))
    start, end = _edge(t, x, extent), -_edge(-t[::-1], x[::-1], extent)
    moving = (t >= start) & (t <= end)
    middle = (t >= start + 0.2 * (end - start)) & (t <= end - 0.2 * (end - start))
    fit = fit_sinusoid(t[middle], x[middle], frequency_guess, harmonics=1)
    period = 1.0 / fit.frequency
    n_cycles = int((end - start) / period + 0.5) - 2 * _EASING
    if n_cycles < 1:
        raise InputError(
            f"{(end - start) / period:.2f} cycles of motion leave none after {_EASING} are left out at either end"
        )
    first = start + _EASING * period
    last = min(first + n_cycles * period, float(t[moving][-1]))
    return Window(start, end, fit.frequency, first, last)


def _edge(t: Floats, x: Floats, extent: float) -> float:
    """Time of the last reading at the first level."""
    level = float(np.median(x[:_FIRST]))
    noise = max(difference_sigma(x[:_FIRST]), quantisation_step(x))
    limit = max(_MOVED_SIGMA * noise, _MOVED_SHARE * extent)
    off = np.flatnonzero(np.abs(x - level) > limit)
    return float(t[off[0] - 1] if len(off) and off[0] >= _FIRST else t[0])


def hysteresis_loops(
    time: ArrayLike,
    position: ArrayLike,
    force: ArrayLike,
    frequency: float,
    *,
    start: float | None = None,
    end: float | None = None,
) -> xr.Dataset:
    """Cut a driven test into cycles and measure the loop of each.

    Parameters
    ----------
    time, position, force : array (n,) [s, m, N]
        Indentation and compression positive, without NaN between ``start`` and ``end``.
    frequency : float [Hz]
        Fitted frequency; every cycle is exactly one period long.
    start, end : float, optional [s]
        Part to be cut; default the whole record. A part of a cycle at the end is left out.

    Returns
    -------
    Dataset
        Over ``cycle`` (numbered from 1): ``cycle_start`` [s], ``work`` [J], dissipated by the
        solid, ``position_amplitude`` [m], ``force_amplitude`` [N], ``storage_stiffness``,
        ``loss_stiffness`` [N/m], ``mean_force`` [N], ``is_transient``.
        Scalars over the steady cycles: ``mean_work`` [J] with ``u_mean_work`` (spread over cycles,
        over the root of the number of independent ones) and ``sd_work``; ``n_cycles`` [1].

    Raises
    ------
    InputError
        Less than one cycle, fewer than eight readings per cycle, or a NaN inside.

    Notes
    -----
    ``work`` is the area inside the path (x, F) of one period, closed by taking out the linear
    drift of both; between readings the path is a cubic spline, so sparse sampling does not cut the
    loop's corners (a polygon of 50 readings per cycle is 0.3 % too small).
    Rule for transients: a cycle is transient while, counted from the first, its force or position
    amplitude differs from the median of the later half by more than 1 % and five robust spreads.

    Examples
    --------
    >>> time = np.arange(0.0, 10.0, 0.02)
    >>> angle = 2 * np.pi * time
    >>> found = hysteresis_loops(time, 1e-4 * np.sin(angle), 2.0 * np.sin(angle + 0.1), 1.0)
    >>> round(float(found.mean_work / (np.pi * 2e-4 * np.sin(0.1))), 3)
    1.0
    """
    t, x, load = (np.asarray(a, float) for a in (time, position, force))
    if not (t.shape == x.shape == load.shape and t.size):
        raise InputError(f"time, position and force must be alike: {t.shape}, {x.shape} and {load.shape}")
    t = checked_times(t)
    refuse_infinite(x, "position")
    refuse_infinite(load, "force")
    begin = float(t[0]) if start is None else start
    stop = float(t[-1]) if end is None else end
    inside = (t >= begin - 1.0 / frequency) & (t <= stop + 1.0 / frequency)
    t, x, load = t[inside], x[inside], load[inside]
    # A window of whole cycles at a slightly other frequency still holds that many.
    count = int((stop - begin) * frequency + _ROUNDING)
    while len(t) and count and begin + count / frequency > t[-1] + 1e-9 / frequency:
        count -= 1
    interval = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if count < 1 or interval * frequency > 1.0 / 8.0:
        raise InputError(
            f"loops need a whole cycle of eight readings; found {(stop - begin) * frequency:.3g} "
            f"cycles of {1.0 / (interval * frequency):.3g} readings"
        )
    if not (np.isfinite(x).all() and np.isfinite(load).all()):
        raise InputError("position or force has unread samples inside the cycles; choose start and end")
    path = CubicSpline(t, np.column_stack([x, load]))
    phase = np.arange(_POINTS_PER_CYCLE) / _POINTS_PER_CYCLE
    starts = begin + np.arange(count) / frequency
    rows = [_one_loop(path, start, 1.0 / frequency, phase) for start in starts.tolist()]
    table = np.array(rows)
    # Leading cycles whose amplitudes differ from those of the later half are transient.
    amplitudes, later = table[:, 1:3], table[count // 2 :, 1:3]
    centre = np.median(later, axis=0)
    spread = 1.4826 * np.median(np.abs(later - centre), axis=0)
    differs = (np.abs(amplitudes - centre) > np.maximum(_STEADY * centre, _STEADY_SPREADS * spread)).any(axis=1)
    transient = np.logical_and.accumulate(differs)
    steady = table[~transient, 0]
    n = len(steady)
    sd = float(np.std(steady, ddof=1)) if n > 1 else float("nan")
    u = sd / float(np.sqrt(independent_count(steady))) if n > 1 else float("nan")
    result = xr.Dataset(coords={"cycle": variable("cycle", np.arange(1, count + 1), "1", "number of the cycle")})
    result["cycle_start"] = variable("cycle", starts, "s", "start of the cycle")
    for values, name, unit, label in zip(table.T, *zip(*_COLUMNS, strict=True), strict=True):
        result[name] = variable("cycle", values, unit, label)
    result["is_transient"] = variable("cycle", transient, "1", "left out as transient")
    for name, value, unit, label in (
        ("mean_work", float(np.mean(steady)), "J", "mean dissipated work of the steady cycles"),
        ("u_mean_work", u, "J", "standard uncertainty of the mean dissipated work"),
        ("sd_work", sd, "J", "standard deviation of the work over the steady cycles"),
        ("n_cycles", float(n), "1", "steady cycles"),
    ):
        result[name] = variable((), value, unit, label)
    result.attrs["work"] = json.dumps({"cycles": count, "points": count * _POINTS_PER_CYCLE})
    return result


def _one_loop(path: CubicSpline, begin: float, period: float, phase: Floats) -> Floats:
    """Work, amplitudes, stiffnesses and mean force of one period."""
    first, last = path(np.array([begin, begin + period]))
    points = path(begin + period * phase) - phase[:, None] * (last - first)
    centred = points - points.mean(axis=0)
    x, load = centred.T
    work = float(0.5 * np.sum(np.roll(x, -1) * load - x * np.roll(load, -1)))
    wave = 2.0 * np.exp(-2j * np.pi * phase) / len(phase)
    moved, pushed = complex(x @ wave), complex(load @ wave)
    stiffness = pushed / moved if moved else complex(np.nan)
    mean_force = float(points[:, 1].mean() + 0.5 * (last[1] - first[1]))
    return np.array([work, abs(moved), abs(pushed), stiffness.real, stiffness.imag, mean_force])

"""Cycles of a harmonic test: the interval of motion, and the work of every cycle."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._noise import difference_sigma, quantisation_step
from labpipe.signals._oscillation import fit_sinusoid
from labpipe.signals._readings import is_constant, readings_of

_MOVED_SIGMA, _MOVED_SHARE = 6.0, 5e-3  # off its rest level by noise, and by part of the range
_FIRST = 10  # readings that are taken to be at rest, if any are
_LEAST_CYCLES = 2.5  # of a motion: one, and those in which the stage eases in and out
_POINTS_PER_CYCLE = 512  # of the path whose area is taken; its error is below 1e-5


class Window(NamedTuple):
    """Begin and end of a driven motion [s], and its frequency [Hz], a fit to its middle."""

    start: float
    end: float
    frequency: float


def active_window(time: ArrayLike, position: ArrayLike, frequency_guess: float | None = None) -> Window:
    """Find the motion between the rests before and after it.

    Parameters
    ----------
    time, position : array (n,) [s, m]
    frequency_guess : float, optional [Hz]
        Default the strongest line.

    Raises
    ------
    InputError
        There is no motion, or hardly a cycle besides those in which the stage eases in and out.

    Notes
    -----
    The motion begins with the first, and ends with the last reading that is further from the level at that end of the
    record than six standard deviations and 0.5 % of the range.
    """
    t, x = readings_of(time=time, position=position)
    if len(x) < 16 or is_constant(x):
        raise InputError(f"no motion in {len(x)} readings")
    extent = float(np.ptp(x))
    start, end = _edge(t, x, extent), -_edge(-t[::-1], x[::-1], extent)
    middle = (t >= start + 0.2 * (end - start)) & (t <= end - 0.2 * (end - start))
    frequency = fit_sinusoid(t[middle], x[middle], frequency_guess, harmonics=1).frequency
    if not (end - start) * frequency >= _LEAST_CYCLES:
        raise InputError(f"{(end - start) * frequency:.2f} cycles of motion, expected at least {_LEAST_CYCLES:g}")
    return Window(start, end, frequency)


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
) -> Floats:
    """Cut a driven test into cycles and measure the area of the loop of each.

    Parameters
    ----------
    time, position, force : array (n,) [s, m, N]
        Indentation and compression positive, without NaN between ``start`` and ``end``.
    frequency : float [Hz]
        Every cycle is exactly one period long.
    start, end : float, optional [s]
        Part to be cut; default the whole record. A part of a cycle at the end is left out.

    Returns
    -------
    array (cycle,) [J]
        Work that the solid dissipates.

    Raises
    ------
    InputError
        Less than one cycle, fewer than eight readings per cycle, or a NaN inside.

    Notes
    -----
    The work is the area inside the path (x, F) of one period, closed by taking out the linear drift of both. It is a
    cubic spline between readings: a polygon of 50 readings per cycle is 0.3 % too small.
    """
    t, x, load = readings_of(time=time, position=position, force=force)
    if not t.size:
        raise InputError("position or force has unread samples alone: no loop")
    begin = float(t[0]) if start is None else start
    stop = float(t[-1]) if end is None else end
    inside = (t >= begin - 1.0 / frequency) & (t <= stop + 1.0 / frequency)
    t, x, load = t[inside], x[inside], load[inside]
    # A window of whole cycles at a slightly other frequency still holds that many.
    last = float(t[-1]) if t.size else begin
    count = min(int((stop - begin) * frequency + 0.05), int((last - begin) * frequency + 1e-9))
    interval = float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    if count < 1 or interval * frequency > 1.0 / 8.0:
        raise InputError(
            f"loops need a whole cycle of eight readings; found {(stop - begin) * frequency:.3g} "
            f"cycles of {1.0 / (interval * frequency):.3g} readings"
        )
    unread = np.setdiff1d(time, t)
    if np.any((unread > begin) & (unread < begin + count / frequency)):
        raise InputError("position or force has unread samples inside the cycles; choose start and end")
    starts, phase = begin + np.arange(count) / frequency, np.linspace(0.0, 1.0, _POINTS_PER_CYCLE + 1)
    loops = CubicSpline(t, np.column_stack([x, load]))(starts[:, None] + phase / frequency)
    loops -= phase[:, None] * (loops[:, -1:] - loops[:, :1])
    moved, pushed = np.moveaxis(loops - loops.mean(axis=1, keepdims=True), -1, 0)
    return np.asarray(0.5 * np.sum(moved[:, 1:] * pushed[:, :-1] - moved[:, :-1] * pushed[:, 1:], axis=1))

"""Zero and noise of a sensor, with uncertainties, from the part of a record at rest."""

import math
from typing import Literal, NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import IN_MOTION, CalibrationError
from labpipe.signals import MAINS, Hum, estimate_noise, hum_at_rest, quantisation_step
from labpipe.uncertainty import Source, excess_uncertainty
from labpipe.units import Quantity

_BLOCK = 16  # independent samples whose median is compared with the beginning
_FIRST = 2 * _BLOCK  # the least that can be called a window
_FACTOR = 5.0  # standard deviations that count as motion: 1 in 2 million for a single sample


class Quiet(NamedTuple):
    """A quiet window.

    Attributes
    ----------
    level, u_level : float
        Median of the readings and its standard uncertainty.
    noise : float
        Standard deviation of one reading, rounding included.
    start, stop : float [s]
        The window; NaN when the level was given as a number.
    n : int
        Valid samples in it.
    hum : Hum, optional
        Of the mains, where it is sure enough to be continued beyond the window.
    """

    level: float
    u_level: float
    noise: float
    start: float
    stop: float
    n: int
    hum: Hum | None = None

    def sources(self, zero: str, rounding: str, resolution: float, unit: str, factor: float) -> list[Source]:
        """Return the lines of a budget for one reading: its noise, its rounding, and the level, by their names."""
        of_step = resolution / math.sqrt(12)
        noise = excess_uncertainty(self.noise, of_step)
        return [
            Source("noise of a sample", 0.0, noise, unit, factor, "random"),
            Source(rounding, 0.0, of_step, unit, factor, "random"),
            Source(zero, self.level, self.u_level, unit, factor, "systematic"),
        ]


Zero = Literal["start"] | tuple[float, float] | Quantity | float
"""Zero that a caller may name: the quiet beginning, a window in s, or a level in the unit of the readings."""


def of_zero(
    time: Floats,
    values: Floats,
    zero: Zero,
    *,
    resolution: float = 0.0,
    correlated: int = 1,
    first: slice = slice(None),
) -> Quiet:
    """Find the zero that a caller names; the beginning and windows lie in the ``first`` part of a record.

    ``values`` (n,) are NaN where there is no reading; ``resolution`` is the step of the display, and ``correlated`` the
    number of samples over which the sensor averages.

    Raises
    ------
    CalibrationError
        There is no such window, or the record begins in motion.
    """
    if isinstance(zero, tuple) and not isinstance(zero, Quantity):
        return in_window(time[first], values[first], zero, resolution=resolution, correlated=correlated)
    if isinstance(zero, str):
        return from_start(time[first], values[first], resolution=resolution, correlated=correlated)
    level, u_level = (zero.value, zero.u) if isinstance(zero, Quantity) else (float(zero), 0.0)
    finite = values[np.isfinite(values)]  # the noise is judged from the whole record
    noise = max(estimate_noise(finite).sigma if finite.size > 2 else 0.0, resolution / np.sqrt(12))
    return Quiet(level, u_level, float(noise), np.nan, np.nan, 0)


def from_start(time: Floats, values: Floats, *, resolution: float = 0.0, correlated: int = 1) -> Quiet:
    """Find the quiet window with which a record begins.

    Too few valid samples, or a record that begins in motion, raise CalibrationError. A hum of the mains is no motion:
    the level is that about which the beginning swings.
    """
    is_valid = np.isfinite(values)
    time, values = time[is_valid], values[is_valid]
    # Samples that a moving average ties together count as one.
    block, first = _BLOCK * correlated, _FIRST * correlated
    if values.size < first:
        raise CalibrationError(f"found {values.size} valid samples, a zero needs {first} or a given value")

    def still(values: Floats) -> int:
        """Return with how many samples a record rests on its first level; it began to move two blocks earlier."""
        usable = values[: values.size - values.size % block].reshape(-1, block)
        level, spread = float(np.median(values[:first])), _spread(values[:first], resolution)
        moved = np.flatnonzero(np.abs(np.median(usable, axis=1) - level) > _FACTOR * spread)
        return block * (max(int(moved[0]) - 2, 2) if moved.size else len(usable))

    n = 0 if _begins_in_motion(values[::correlated], resolution) else still(values)
    swing = _swing(time, values, resolution)
    if swing is not None and (longer := still(values - swing)) > 1.25 * n:
        n = longer
    wanders = float(np.ptp(values[: 6 * first]))
    if n == 0 and wanders < 0.02 * float(np.ptp(values)):
        # A sensor that averages or swings: its zero is known to what it wanders; what begins to fall wanders further.
        quiet = _describe(time[:first], values[:first], resolution, correlated)
        return quiet._replace(u_level=max(quiet.u_level, wanders / np.sqrt(12)))
    if n == 0:
        raise CalibrationError(
            "the record begins in motion, so its beginning is no zero; give the zero, or a quiet "
            "window as zero=(from, to) in s"
        ).because(IN_MOTION)
    noise = max(estimate_noise(values[:n]).sigma, resolution / 2) if n > first else np.inf
    found = hum_at_rest(time[:n], values[:n], noise) if np.isfinite(noise) else None
    if found is None:
        return _describe(time[:n], values[:n], resolution, correlated)
    hum, is_decided = found
    quiet = _describe(time[:n], values[:n] - hum.at(time[:n]), resolution, correlated)
    u_level = float(np.hypot(quiet.u_level, np.linalg.norm(hum.modes(time[:n]).mean(axis=0))))
    return quiet._replace(u_level=u_level, hum=hum if is_decided else None)


def in_window(
    time: Floats, values: Floats, window: tuple[float, float], *, resolution: float = 0.0, correlated: int = 1
) -> Quiet:
    """Take a window that the caller knows to be quiet; fewer than two valid samples raise CalibrationError."""
    inside = (time >= window[0]) & (time <= window[1]) & np.isfinite(values)
    if inside.sum() < 2:
        raise CalibrationError(
            f"the window from {window[0]} to {window[1]} s holds {int(inside.sum())} valid "
            f"samples; the record goes from {time[0]:.6g} to {time[-1]:.6g} s"
        )
    return _describe(time[inside], values[inside], resolution, correlated)


def resolution_of(values: Floats, stated: float | None) -> float:
    """Return the step of readings (n,): as displayed, by its decimals, or coarser when the values show it."""
    finite = values[np.isfinite(values)]
    return max(quantisation_step(finite) if finite.size > 2 else 0.0, stated or 0.0)


def largest(values: Floats) -> float:
    """Return the value that is furthest from zero; 0 where there is none."""
    finite = values[np.isfinite(values)]
    return float(finite[np.argmax(np.abs(finite))]) if finite.size else 0.0


def _begins_in_motion(values: Floats, resolution: float) -> bool:
    """Return whether a beginning has a slope that is real, moves its level by more than its noise, and goes on.

    One of 10,000 beginnings at rest has such a slope by chance; the readings behind it are on the level again.
    """

    def slope(values: Floats) -> tuple[float, float, float]:
        """Return the slope per reading, its standard uncertainty, and the noise about it."""
        position = np.arange(values.size) - (values.size - 1) / 2
        # From the first reading, so that equal readings far from zero have no slope by rounding.
        moved = values - values[0]
        found = float(position @ moved / (position @ position))
        rest = moved - moved.mean() - found * position
        noise = max(float(rest.std()), resolution / np.sqrt(12), float(np.spacing(np.abs(values).max())))
        return found, noise / float(np.sqrt(position @ position)), noise

    rate, u_rate, noise = slope(values[:_FIRST])
    if abs(rate) <= _FACTOR * u_rate or abs(rate) * _FIRST <= 2 * noise:
        return False
    follows = values[_FIRST : 2 * _FIRST]
    if follows.size < _FIRST:
        return True
    away = abs(float(np.mean(follows - values[0])) - float(np.mean(values[:_FIRST] - values[0])))
    rate, u_rate, _ = slope(follows)
    return away > _FACTOR * noise * np.sqrt(2 / _FIRST) or abs(rate) > 3.0 * u_rate


def _swing(time: Floats, values: Floats, resolution: float) -> Floats | None:
    """Return the line of the mains that explains how a record begins, by most periods first; None where none does."""
    since = time - time[0]
    for periods in (2.0, 1.0, 0.6):
        for line in MAINS:
            n = int(np.searchsorted(since, periods / line))
            if not _FIRST < n < time.size:
                continue
            angle = 2 * np.pi * line * since
            basis = np.stack([np.ones_like(since), np.cos(angle), np.sin(angle)], axis=1)
            fit = np.linalg.lstsq(basis[:n], values[:n], rcond=None)[0]
            # A fall of as long leaves more than ten times the noise.
            left = float(np.std(values[:n] - basis[:n] @ fit))
            if left < 2.0 * max(estimate_noise(values[:n]).sigma, resolution / np.sqrt(12)):
                return np.asarray(basis[:, 1:] @ fit[1:])
    return None


def _spread(values: Floats, resolution: float) -> float:
    return max(float(values.std(ddof=1)), resolution / np.sqrt(12))


def _describe(time: Floats, values: Floats, resolution: float, correlated: int) -> Quiet:
    noise = _spread(values, resolution)
    # the standard error of a median over that of a mean is sqrt(pi / 2)
    u_level = math.sqrt(math.pi / 2) * noise / math.sqrt(max(values.size / correlated, 1.0))
    if noise < resolution / 2:
        # All readings fall on one or two steps: averaging does not see between them.
        u_level = max(u_level, resolution / math.sqrt(12))
    # the median of rounded values, interpolated inside the step on which it falls
    level, inside = float(np.median(values)), int(np.sum(np.abs(values - np.median(values)) <= resolution / 2))
    if resolution > 0 and inside:
        below = int(np.sum(values < level - resolution / 2))
        level += resolution * ((values.size / 2 - below) / inside - 0.5)
    return Quiet(level, u_level, noise, float(time[0]), float(time[-1]), values.size)

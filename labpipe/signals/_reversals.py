"""Reversals of a bouncing body, the flights between them, and the acceleration of free fall."""

from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.signals._noise_spectrum import WHITE, Colour, coloured_covariance

SURE = 4.0  # standard uncertainties by which a speed must differ from zero to have a direction
FEWEST_IN_FLIGHT = 6
_TENTH = 0.26  # of a Hertzian contact's duration, when a tenth of its impulse is done
_MARGIN = 0.3  # of the rough duration that is left out around a contact when an arc is looked at
_STRONG = 0.3  # of the strongest change of speed: the first impact


class Turn(NamedTuple):
    """One reversal from down to up: the sample of the fastest descent, and its surroundings."""

    descent: int
    before: int  # first sample of the descending stretch
    end: int  # sample of the next fastest descent, or the end of the record
    touch: float  # rough times of touch and lift-off
    liftoff: float
    jump: float  # change of speed

    @property
    def duration(self) -> float:
        """Rough duration of the contact in s."""
        return self.liftoff - self.touch


def find_turns(time: Floats, speed: Floats, u_speed: Floats) -> list[Turn]:
    """Find the reversals from surely down to surely up, in order, from the first impact on.

    ``time``, ``speed``, ``u_speed`` (n,) [s, m/s]: Upwards positive, with its standard uncertainty.
    """
    sign = np.where(np.abs(speed) > SURE * u_speed, np.sign(speed), 0.0)
    known = np.flatnonzero(sign)
    if len(known) == 0:
        return []
    starts = known[np.concatenate([[True], np.diff(sign[known]) != 0])]
    stops = np.append(starts[1:], known[-1] + 1)
    turns = []
    for i in range(len(starts) - 1):
        if sign[starts[i]] > 0:
            continue
        down, up = slice(starts[i], stops[i]), slice(starts[i + 1], stops[i + 1])
        descent = starts[i] + int(np.argmin(speed[down]))
        ascent = starts[i + 1] + int(np.argmax(speed[up]))
        end = len(speed)
        if i + 2 < len(starts):
            end = starts[i + 2] + int(np.argmin(speed[starts[i + 2] : stops[i + 2]]))
        # Touch and lift-off from the times at which a tenth and nine tenths of the impulse are done: the extremes of
        # the speed themselves are flat and wander with the noise.
        part, jump = slice(descent, ascent + 1), float(speed[ascent] - speed[descent])
        share = (speed[part] - speed[descent]) / jump
        early, late = np.interp([0.1, 0.9], np.maximum.accumulate(share), time[part]).tolist()
        before = _TENTH * (late - early) / (1.0 - 2.0 * _TENTH)
        turns.append(Turn(descent, int(starts[i]), end, early - before, late + before, jump))
    # The holder may tremble before the release; the first impact is among the strongest.
    strongest = max((turn.jump for turn in turns), default=0.0)
    return turns[next((i for i, turn in enumerate(turns) if turn.jump > _STRONG * strongest), 0) :]


def flights_after(time: Floats, turns: list[Turn]) -> list[slice]:
    """List the samples of the flight after each turn, a margin away from the contacts."""
    flights = []
    for i, turn in enumerate(turns):
        end = time[turn.end - 1]
        if i + 1 < len(turns):
            end = turns[i + 1].touch - _MARGIN * turns[i + 1].duration
        first = int(np.searchsorted(time, turn.liftoff + _MARGIN * turn.duration))
        flights.append(slice(first, max(int(np.searchsorted(time, end)), first)))
    return flights


def first_fall(time: Floats, first: Turn) -> slice:
    """Return the samples of the fall before the first impact, without the jolt of the release."""
    start = first.before + (first.descent - first.before) // 3
    end = int(np.searchsorted(time, first.touch - _MARGIN * first.duration))
    return slice(start, max(end, start))


def arc(
    time: Floats,
    height: Floats,
    sigma: float,
    colour: Colour = WHITE,
    origin: float | None = None,
    gravity: tuple[float, float] | None = None,
) -> tuple[Floats, Floats]:
    """Fit a parabola: level, speed upwards and acceleration downwards at an origin [s], with their covariance (3, 3).

    ``gravity`` is the known acceleration, with its uncertainty; the origin is the middle by default.
    """
    t = time - (time.mean() if origin is None else origin)
    half = float(np.max(np.abs(t), initial=0.0)) or 1.0
    units = np.array([1.0, 1.0 / half, 1.0 / half**2])
    design = np.stack([np.ones_like(t), t / half, -0.5 * (t / half) ** 2], axis=1)
    right = height - (mean := float(np.sum(height)) / max(height.size, 1))  # an empty arc is singular below
    if gravity is not None:  # one more, very certain, reading
        value, u = np.array(gravity) * half**2
        design, right = np.vstack([design, [0.0, 0.0, sigma / u]]), np.append(right, value * sigma / u)
    found = np.linalg.lstsq(design, right, rcond=None)[0]
    left = (right - design @ found)[: len(t)]
    inverse = np.linalg.inv(design.T @ design)
    covariance = coloured_covariance(design, inverse, time, colour, sigma) * sigma**2
    # Residuals beyond the noise mean another motion: the larger uncertainty is stated.
    scatter = max(sigma**2, float(np.sum(left**2) / max(len(design) - 3, 1)))
    covariance *= max(1.0, scatter * inverse[2, 2] / covariance[2, 2])
    return found * units + [mean, 0.0, 0.0], covariance * np.outer(units, units)


def curvature(time: Floats, height: Floats, sigma: float, colour: Colour = WHITE) -> tuple[float, float]:
    """Downward acceleration of a parabola through the samples, and its standard uncertainty."""
    if len(time) < FEWEST_IN_FLIGHT:
        return np.nan, np.inf
    value, covariance = arc(time, height, sigma, colour)
    return float(value[2]), float(np.sqrt(covariance[2, 2]))


def common_fall(
    time: Floats, height: Floats, sigma: float, turns: list[Turn], colour: Colour = WHITE
) -> tuple[float, float]:
    """Acceleration of the free fall, common to the longest flights."""
    if not turns:
        raise InputError("no bounce found: the displacement never turns from down to up")
    stretches = [first_fall(time, turns[0]), *flights_after(time, turns)]
    found = np.array([curvature(time[stretch], height[stretch], sigma, colour) for stretch in stretches])
    values, spread = found[(found[:, 1] < np.inf) & (found[:, 0] > 3.0 * found[:, 1])].T
    if len(values) == 0:
        raise InputError("no bounce found: no stretch of constant downward acceleration around one")
    # Vibration in contact looks like short flights with less acceleration: the longest decide.
    best = float(values[np.argmin(spread)])
    near = np.abs(values - best) < np.maximum(5.0 * spread, 0.02 * best)
    weight = 1.0 / spread[near] ** 2
    common = float(np.sum(weight * values[near]) / np.sum(weight))
    chi_square = float(np.mean(((values[near] - common) / spread[near]) ** 2))
    return common, float(np.sqrt(max(chi_square, 1.0) / np.sum(weight)))

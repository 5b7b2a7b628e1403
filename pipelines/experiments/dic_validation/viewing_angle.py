"""The camera's angle to the motion that it films: turned about its axis, or looking up or down at it.

A camera that is turned sees a fall aslant. One that looks up or down at it sees lengths along the fall
too short, by the cosine of the angle. It also sees the holder come closer or go away, and so grow or
shrink, along the fall by twice what it does across. A holder that swings towards the camera grows alike
both ways.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.signals import independent_count
from labpipe.uncertainty import Source
from labpipe.units import Quantity
from labpipe.variables import with_u

STRAIGHT = math.radians(30.0)
"""Largest angle of the motion to the columns that is taken for a turned camera."""
USUAL_DISTANCE = 0.3
"""Distance (m) of camera and holder for which a tilt is budgeted where none is stated."""
_CLEAR = 50.0  # noises of a travel whose direction is told
_FALLING, _BEGUN = 0.9, 0.05  # of the travel, between which the holder has not touched yet
_FEWEST = 4  # frames
_DRIFTS = 0.3  # of what is left across the motion, that is left where it drifts aside evenly
_SHARE = 0.5  # of the frames on the far half of the way, in which a growth must be seen
_STEEPEST = math.tan(math.radians(60.0))  # of a camera that still sees its motion
_UNSEEN = 5.0  # standard uncertainties of the rotation, up to which a growth is not told
_BY_EYE = math.radians(5.0)  # to which a camera is set up without an instrument


@dataclass(frozen=True, slots=True)
class Seen:
    """What the film shows of the camera's angle; NaN where the motion is too small to show it.

    ``is_known``: whether the distance is stated. ``direction``, ``u_direction`` [rad]: of the motion to the image's
    columns, to the right of upwards. ``growth``, ``u_growth`` [1/m]: relative growth of the holder's image along the
    motion, per length of the motion; 0 where none is seen, as for the next. ``slant``, ``u_slant`` [1/m]: what it grows
    more along the motion than across, which tells a tilt times a distance. ``tilt``, ``u_tilt`` [rad]: angle of looking
    up or down, for the stated distance or else for the usual one. Where none is seen, that which so short a motion
    would hide.
    """

    is_known: bool
    direction: float = math.nan
    u_direction: float = math.nan
    growth: float = math.nan
    u_growth: float = math.nan
    slant: float = math.nan
    u_slant: float = math.nan
    tilt: float = math.nan
    u_tilt: float = math.nan

    @property
    def turn(self) -> float:
        """Angle [rad] by which displacements are turned: none where it is not that of a camera."""
        return self.direction if abs(self.direction) < STRAIGHT else 0.0

    @property
    def lengthened(self) -> float:
        """Factor of displacements; 1 where the distance is not stated."""
        return 1.0 / math.cos(self.tilt) if self.is_known and math.isfinite(self.tilt) else 1.0

    @property
    def shortened(self) -> float:
        """Relative standard uncertainty of displacements that the tilt leaves."""
        if self.tilt and self.is_known:
            return math.tan(self.tilt) * self.u_tilt
        return (1.0 / math.cos(self.tilt or most_unseen(self.u_tilt)) - 1.0) / math.sqrt(3.0)

    def variables(self) -> dict[str, Any]:
        """Return what a page and checks read."""
        texts = {
            "direction": ("rad", "direction of the motion to the image's columns"),
            "growth": ("1/m", "relative growth of the holder's image along its motion, per length of it"),
            "slant": ("1/m", "what the image grows more along the motion than across"),
            "tilt": ("rad", "angle by which the camera looks up or down"),
        }
        made: dict[str, Any] = {}
        for name, text in texts.items():
            made |= with_u(name, (), getattr(self, name), getattr(self, f"u_{name}"), *text)
        return made


def most_unseen(u_tilt: float) -> float:
    """Largest tilt [rad] that a film would not show, where it shows none."""
    return math.sqrt(3.0) * u_tilt


def seen(body: xr.Dataset, distance: Quantity | None = None) -> Seen:
    """Find how the camera stands to the motion of the holder.

    ``body`` (frame,) holds displacements [m] of the holder with noise, and its stretches [1]; ``distance`` [m] is that
    of the camera's lens from it.
    """
    x, y = body["displacement_x"].values, body["displacement_y"].values
    away = np.hypot(x, y)
    noise = np.hypot(body["u_displacement_x"].values, body["u_displacement_y"].values)
    nothing = Seen(distance is not None)
    if not np.isfinite(away).any() or np.nanmax(away) < _CLEAR * np.nanmedian(noise):
        return nothing
    far = float(np.nanmax(away))
    begun = np.flatnonzero(away[: int(np.flatnonzero(away >= _FALLING * far)[0]) + 1] > _BEGUN * far)
    if len(begun) < _FEWEST:
        return nothing
    x, y, weight = x[begun], y[begun], away[begun]
    side, rise = float(weight @ x), float(weight @ y)
    direction = math.atan2(math.copysign(1.0, rise) * side, abs(rise))
    across = x * math.cos(direction) - y * math.sin(direction)
    u_direction = _u_slope(across, weight)
    along = y * math.cos(direction) + x * math.sin(direction)
    if abs(direction) < STRAIGHT and "time" in body.coords:
        turn, u_turn, left = _without_drift(body["time"].values[begun], across, along)
        if left < _DRIFTS * float(np.std(across)):
            direction, u_direction = direction + turn, u_turn
    growth, slant = _per_length(body, 0.0), _per_length(body, 1.0)
    length = Quantity(USUAL_DISTANCE, 0.0, "m") if distance is None else distance
    if not slant[0]:
        hidden = _UNSEEN * float(np.nanmedian(body["u_rotation"].values)) / far * length.value
        unseen = min(math.atan(hidden), _BY_EYE) / math.sqrt(3.0)  # anywhere up to that
        return Seen(distance is not None, direction, u_direction, *growth, *slant, 0.0, unseen)
    # the displacement, of which this is the slope, is itself too short by the cosine
    tilt = math.atan(min(abs(slant[0]) * length.value, _STEEPEST))
    u_tilt = math.hypot(length.value * slant[1], slant[0] * length.u) * math.cos(tilt) ** 2
    return Seen(distance is not None, direction, u_direction, *growth, *slant, tilt, u_tilt)


def _without_drift(time: Floats, across: Floats, rise: Floats) -> tuple[float, float, float]:
    """Direction [rad] of what moves across with the fall, its u, and the rest [m], if all drifts aside evenly too.

    A holder that turns, a camera that creeps or a table that rolls moves the image aside all the time,
    whatever it has fallen.
    """
    columns = np.column_stack([rise, time - time.mean(), np.ones_like(time)])
    found, *_ = np.linalg.lstsq(columns, across)
    residual = across - columns @ found
    # what the others explain of the rise tells nothing of the direction
    own = rise - columns[:, 1:] @ np.linalg.lstsq(columns[:, 1:], rise)[0]
    return float(found[0]), _u_slope(residual, own), float(np.std(residual))


def _per_length(body: xr.Dataset, across: float) -> tuple[float, float]:
    """Slope [1/m] over the displacement of the stretch along, less so many times that across; and its u."""
    along, stretch = body["displacement_y"].values, body["stretch_y"].values - across * body["stretch_x"].values
    is_far = np.abs(along) > 0.5 * np.nanmax(np.abs(along))
    found = np.flatnonzero(is_far & np.isfinite(stretch) & (stretch != 0.0))
    if len(found) < max(_FEWEST, _SHARE * is_far.sum()):
        return 0.0, 0.0
    x, y = along[found], stretch[found]
    slope = float(x @ y / (x @ x))
    # Noise of the reference and what interpolation misses are alike in all frames: as those of one.
    shared = float(np.std(y - slope * x)) * abs(x.sum()) / float(x @ x)
    return slope, math.hypot(_u_slope(y - slope * x, x), shared)


def _u_slope(residual: Floats, x: Floats) -> float:
    """Return the standard uncertainty of a slope through the origin, whose residual has a memory."""
    memory = len(x) / independent_count(residual)
    return float(np.sqrt(memory * (residual @ residual) / (len(x) - 1) / (x @ x)))


def along(body: xr.Dataset, seen: Seen) -> tuple[Floats, Floats]:
    """Displacement (frame,) [m] along the motion, upwards, and its random uncertainty."""
    cosine, sine = seen.lengthened * math.cos(seen.turn), seen.lengthened * math.sin(seen.turn)
    moved = cosine * body["displacement_y"].values + sine * body["displacement_x"].values
    noise = np.hypot(cosine * body["u_displacement_y"].values, sine * body["u_displacement_x"].values)
    return np.asarray(moved), np.asarray(noise)


def sources(seen: Seen, travel: float, size: float) -> list[Source]:
    """Rows of the budget of the scale [m/px]: what the angle leaves open of a displacement.

    Whether the camera is turned or the body moves aslant is not told: the vertical displacement is that
    along the motion, or its cosine. At which place the scale was measured is not told either. Without
    a distance the tilt is that for the usual one, and nothing is corrected for it. ``travel`` [m] is the largest
    displacement, ``size`` [m/px] the length of a pixel.
    """
    if not math.isfinite(seen.direction):
        return []
    relative = {
        "direction of motion": (1.0 - math.cos(seen.direction)) / math.sqrt(3.0),
        "tilt of the camera": seen.shortened,
        "scale along the motion": abs(seen.growth) * travel / math.sqrt(12.0),
    }
    return [Source(name, 0.0, u, "1", size, "systematic") for name, u in relative.items() if u > 0.0]

"""Image correlation where more changes than the place: blur, light, stretch, and bare edges.

The pattern of each row is of another making than the film of :mod:`pipelines.bench.dic`; every row
states what the default reaches, what it reaches without solving for the change, and how its stated
uncertainty compares with the scatter.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.imaging import track
from pipelines.bench.film_scenes import (
    Film,
    Formula,
    View,
    bars,
    blurred_by_camera,
    bricks,
    cells,
    digitised,
    dots,
    edge,
    from_formula,
    from_spectrum,
    perlin,
    photograph,
    random_field,
    seen_by_pixels,
)
from pipelines.bench.measure import Point, Suite, held_against

_SUBSET, _SPACING, _NOISE = 31, 13, 1.0
_STEP = (0.13, 0.07)  # px from frame to frame
_FEATURE, _CELL, _WEAK = 1.9, 7.0, 0.7  # px, px, contrast of a pattern that is not strong
_ANGLES, _PERIOD = (0.0, 0.4, math.pi / 4.0), 9.0  # rad, px
_UNCHANGED = "nothing changes"
_COVERED = "a wire before the specimen"
_PLAIN = View()


@dataclass(frozen=True, slots=True)
class Scene:
    """A pattern, and how it is seen before and after."""

    draw: Callable[[View], Floats]
    before: View = _PLAIN
    after: View = _PLAIN


def scenes(size: int) -> dict[str, Scene]:
    """Return the scenes by name; images are ``size`` px wide and high."""
    speckle, texture, noise_cells = _WEAK * random_field(size, _FEATURE, 1), perlin(_CELL, 2), perlin(_CELL, 3)
    field = partial(from_spectrum, speckle)
    middle = 0.5 * (size - 1)
    hidden = _wire(size)
    noise = partial(from_formula, lambda x, y: _WEAK * texture(x, y), size)
    near, wide, far = View(defocus=0.6), View(defocus=1.0), View(defocus=1.2)
    return {
        _UNCHANGED: Scene(field),
        "defocus 0.6 to 1.2 px": Scene(field, near, far),
        "defocus 1.2 to 0.6 px": Scene(field, far, near),
        "defocus 0.6 to 2.0 px": Scene(field, near, View(defocus=2.0)),
        "motion of 4 px in the exposure": Scene(field, _PLAIN, View(smear=(4.0, 0.0))),
        "light sloping by 0.2 % per px": Scene(field, _PLAIN, View(light=(1.0, 0.002, -0.001))),
        "scale 1.03": Scene(noise, _PLAIN, View(scale=1.03)),
        "photograph": Scene(partial(from_spectrum, photograph(size))),
        "Perlin noise": Scene(partial(from_formula, noise_cells, size)),
        "dots that repeat themselves": Scene(partial(from_formula, dots(0.3, 9.0, 1.0), size)),
        _COVERED: Scene(lambda view: (1.0 - hidden) * field(view) + 70.0 * hidden),
        "photograph that comes into focus": Scene(partial(from_spectrum, photograph(size)), far, near),
        "bricks out of focus": Scene(partial(seen_by_pixels, bricks(0.4, 14.0, 1.6, 6), size), near, far),
        "bricks that come into focus": Scene(partial(seen_by_pixels, bricks(0.4, 14.0, 1.6, 6), size), far, near),
        "black and white cells behind a lens": Scene(partial(seen_by_pixels, cells(0.3, 4.3, 7), size), near, near),
        "cells blurred after sampling": Scene(partial(blurred_by_camera, cells(0.3, 4.3, 7), size), wide, wide),
        "bare edge blurred after sampling": Scene(partial(blurred_by_camera, _bare_edge(middle), size), wide, wide),
        **{
            f"{name} at {math.degrees(angle):.0f}°": Scene(partial(from_formula, formula, size))
            for angle in _ANGLES
            for name, formula in (
                ("edge with a grain of 2 grey levels", edge(angle, (middle, middle), 2.0, 4)),
                ("grating", bars(angle, _PERIOD, 0.6)),
            )
        },
    }


def _bare_edge(middle: float) -> Formula:
    """Edge through the middle that nothing blurs, of any place along it."""
    return lambda x, y: np.where((x - middle) * 0.92 + (y - middle) * 0.39 > 0.0, 60.0, -60.0)


def _wire(size: int) -> Floats:
    """Share (row, column) of a slanting wire, 8 px wide, in the light."""
    y, x = np.mgrid[:size, :size] - 0.5 * (size - 1)
    return np.asarray(1.0 / (1.0 + np.exp(2.0 * (np.abs(0.9 * x + 0.44 * y) - 4.0))))


def disturbances(quick: bool) -> Suite:
    """Measure error, uncertainty and time in every scene.

    Parameters
    ----------
    quick : bool
        Fewer frames.
    """
    size, frames = 192, 4 if quick else 12
    rows = [_row(name, scene, size, frames) for name, scene in scenes(size).items()]
    title = f"Displacement of subsets of {_SUBSET} px where more changes than the place, noise of {_NOISE:g} grey level"
    goal = (
        "goals: at least 75 % recovered where something changes, u / scatter 0.9 to 1.1 within two of its standard "
        "deviations, none off by more than 5 u"
    )
    label = "run time per point and frame (s)"
    return Suite("dic-scenes", title, "RMS error (px)", rows, notes=(goal,), time_label=label)


def _row(name: str, scene: Scene, size: int, frames: int) -> Point:
    axis = np.arange(_SUBSET, size - _SUBSET, float(_SPACING))
    points = np.stack([axis.ravel() for axis in np.meshgrid(axis, axis)], axis=1)
    scene = replace(scene, draw=cache(scene.draw))  # most views come again in the films in which nothing changes
    film, truth = _moved(scene, scene.before, scene.after, points, size, frames)
    track(film[:2], points, _SUBSET)
    start = time.perf_counter()
    found = track(film, points, _SUBSET)
    seconds = time.perf_counter() - start
    error, u = _compared(found, truth)
    plain, _ = _compared(track(film, points, _SUBSET, "rigid", adapt=False), truth)
    recovered = None
    if scene.before != scene.after:
        unchanged = []
        for view in (scene.before, replace(scene.after, scale=1.0, angle=0.0)):
            still, place = _moved(scene, view, view, points, size, frames)
            unchanged.append(_rms(_compared(track(still, points, _SUBSET), place)[0]))
        recovered = 100.0 * (_rms(plain) - _rms(error)) / (_rms(plain) - min(unchanged))
    beyond = int((np.hypot(*error.T) > 5.0 * np.hypot(*u.T)).sum())
    ratio = _rms(u) / _rms(error) if np.isfinite(error).any() else None
    by_chance = None if ratio is None else ratio * _chance(error)
    goals = {
        "recovered": recovered is None or recovered >= 75.0,
        "u / scatter": ratio is None or by_chance is None or abs(ratio - 1.0) <= 0.1 + 2.0 * by_chance,
        "off by more than 5 u": beyond == 0,
    }
    return Point(
        name,
        _rms(error),
        seconds / (frames * len(points)),
        is_default=name == _UNCHANGED,
        extra={
            "error, change not solved for (px)": _rms(plain) if np.isfinite(plain).any() else None,
            "of what the change costs, recovered (%)": recovered,
            "u / scatter": ratio,
            "its standard deviation": by_chance,
            "lost (%)": 100.0 * float(np.isnan(error).any(axis=-1).mean()),
            "off by more than 5 u": beyond,
            "goals": held_against(goals),
        },
    )


def _chance(error: Floats) -> float:
    """Relative standard deviation of a scatter (frame, point, 2), from that of points: their frames share a noise."""
    squares = np.nanmean(error**2, axis=(0, 2))
    squares = squares[np.isfinite(squares)]
    return float(0.5 * squares.std() / squares.mean() / np.sqrt(squares.size))


def _moved(scene: Scene, before: View, after: View, points: Floats, size: int, frames: int) -> tuple[Film, Floats]:
    """Film of a scene that is shifted from frame to frame, and the displacement (frame, point, 2) after the first."""
    views = [before, *(replace(after, shift=(k * _STEP[0], k * _STEP[1])) for k in range(1, frames))]
    film = digitised([scene.draw(view) for view in views], _NOISE, 5)
    return film, np.stack([view.displacement(points, size) for view in views])[1:]


def _compared(found: xr.Dataset, truth: Floats) -> tuple[Floats, Floats]:
    """Error and stated uncertainty (frame, point, 2) in px, without the frame of the reference."""
    value = np.stack([found["dx"].values, found["dy"].values], axis=-1)[1:]
    return value - truth, np.stack([found["u_dx"].values, found["u_dy"].values], axis=-1)[1:]


def _rms(values: Floats) -> float:
    found = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(found**2))) if len(found) else math.nan

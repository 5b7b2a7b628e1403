"""Which single mistake would make a record of static loading consistent with its loads.

The creep fit takes what is stated for granted: one wrong load, a holder that was not counted, or a
drift while a load was held leaves a misfit. Each is freed in turn, and the one that takes the
misfit away is probably it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import xarray as xr
from scipy.optimize import minimize_scalar

from labpipe.arrays import Floats
from labpipe.report import quantity
from pipelines.experiments.static_loading.load_steps import TouchFit, creep_design, settled, valid
from pipelines.experiments.static_loading.settings import StaticLoading

_ROWS = 240
"""Readings of a record that are enough to tell mistakes apart."""
_FREED = 20.0
"""Times by which a load may be wrong when the right one is looked for."""
_LEFT = 0.3
"""Part of the misfit beyond the noise that a mistake may leave and still be told."""


@dataclass(frozen=True, slots=True)
class Suspect:
    """A mistake that would explain the misfit.

    Attributes
    ----------
    sentence : str
        What is probably wrong.
    setting : str
        Where it stands in session.toml; empty where nothing there is wrong.
    left : float
        Misfit that it leaves [m²].
    """

    sentence: str
    setting: str
    left: float


def likeliest(displacement: xr.Dataset, steps: xr.Dataset, settings: StaticLoading) -> Suspect | None:
    """Return the mistake that leaves the least misfit; None where none takes it away."""
    time, moved = valid(displacement)
    used = np.flatnonzero(settled(time, steps, settings))
    used = used[:: max(used.size // _ROWS, 1)]
    elapsed, rows = time[used], moved[used]
    radius = settings.sphere.radius.value
    force = steps["force"].values

    def misfit(forces: Floats, readings: Floats) -> float:
        if not (np.diff(forces, prepend=0.0) > 0.0).all():
            return np.inf
        design, _ = creep_design(elapsed, steps.assign(force=("load", forces)), radius)
        fit = TouchFit(readings, design)
        return fit.solve(0.0 if settings.zero is not None else fit.best())[1]

    before = misfit(force, rows)
    noise = float(steps["noise"]) ** 2 * used.size
    found = [
        Suspect(say(value), setting, left)
        for say, setting, value, left in _freed(misfit, elapsed, rows, steps, settings)
    ]
    best = min(found, key=lambda suspect: suspect.left)
    return best if best.left - noise < _LEFT * (before - noise) else None


def _freed(
    misfit: Callable[[Floats, Floats], float], elapsed: Floats, rows: Floats, steps: xr.Dataset, settings: StaticLoading
) -> Iterator[tuple[Callable[[float], str], str, float, float]]:
    """Yield sentence, setting, value and misfit of each mistake when it is as large as it fits best."""
    force, begin, end = (steps[name].values for name in ("force", "begin", "end"))
    for i in range(force.size):
        below = force[i - 1] if i else 0.0
        above = force[i + 1] if i + 1 < force.size else _FREED * force[i]
        least = max(below * 1.01, force[i] / _FREED)

        def one(decade: float, i: int = i) -> float:
            changed = force.copy()
            changed[i] = 10.0**decade
            return misfit(changed, rows)

        decade, left = _least(one, np.log10(least), np.log10(above * 0.99))
        yield partial(_wrong_load, i, settings), f"loads[{i}].mass", 10.0**decade, left
    value, left = _least(lambda more: misfit(force + more, rows), -0.9 * force[0], force[0] * 10)
    yield partial(_holder, settings), "loads", value, left
    extent = float(np.ptp(rows))
    for i in range(force.size):
        share = np.clip((elapsed - begin[i]) / (end[i] - begin[i]), 0.0, 1.0)

        def drifted(value: float, share: Floats = share) -> float:
            return misfit(force, rows - value * share)

        value, left = _least(drifted, -0.3 * extent, 0.3 * extent)
        yield partial(_drift, i, settings), "", value, left


def _least(function: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    found = minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": 1e-3 * (high - low)})
    return float(found.x), float(found.fun)


def _wrong_load(i: int, settings: StaticLoading, force: float) -> str:
    mass, gravity = settings.loads[i].mass.value, settings.model.gravity.value
    return (
        f"load {i + 1} is probably {force / gravity:.3g} kg, not {mass:g} kg: all others fit the record then "
        f"(loads in session.toml)"
    )


def _holder(settings: StaticLoading, more: float) -> str:
    mass = more / settings.model.gravity.value
    what = "the holder was probably not counted" if more > 0 else "something was probably counted that does not rest"
    return f"{what}: with {abs(mass):.3g} kg {'more' if more > 0 else 'less'} under every load all of them fit"


def _drift(i: int, settings: StaticLoading, way: float) -> str:
    load = f"load {i + 1} ({settings.loads[i].mass.value:g} kg)"
    return (
        f"the readings probably drifted by {quantity(way, 'm')} while {load} was held: the temperature changed, or the "
        "stand settled"
    )

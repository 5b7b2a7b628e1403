"""Shortcuts of the simulator: terms, flights, springs, rest and memory that need not be stepped through."""

import itertools
from functools import partial

import numpy as np
import xarray as xr

from labpipe import contact, materials
from labpipe.arrays import Floats
from labpipe.contact import Shortcuts
from labpipe.contact.memory import Creep, advance, history, step_weights
from labpipe.materials import Prony
from pipelines.bench.shortcut import Shortcut, counted

_SPHERE, _MASS, _HEIGHT = 9.525e-3, 0.505, 1.5e-3
#: A drop that flies long, and one (m) that comes to rest soon: after 0.24 s in acrylic.
_HIGH, _LOW = 10e-3, 2e-5
#: Swing, relative to the sag under its weight, below which a sphere counts as resting (``rtol``).
_STILL = 1e-4
#: A spectrum as fine as a master curve may give: many terms (s) lie outside of any drop's times.
_MANY_TERMS = np.geomspace(1e-12, 1e8, 80)
#: Impacts of a drop by the collision law that are fitted, its damping (N s/m^1.5) and tolerance.
_IMPACTS, _DAMPING, _LAW_RTOL = 4, 1500.0, 1e-7


def many_terms() -> Prony:
    """Return a solid with more terms than any drop feels."""
    moduli = np.full(_MANY_TERMS.size, 2.5e9 / _MANY_TERMS.size)
    return Prony(5e8, moduli, _MANY_TERMS, nu=0.35)


def _other_restitution(short: xr.Dataset, whole: xr.Dataset) -> float:
    ratio = short["restitution"] / whole["restitution"] - 1.0
    return float(np.abs(ratio).max() / 1e-4)


def folded_terms(name: str, solid: Prony) -> Shortcut:
    """Simulate a drop with and without the terms far outside of its times."""

    def drop(fold: bool) -> xr.Dataset:
        return contact.drop(solid, _SPHERE, _MASS, _HEIGHT, 0.1, fold=fold)

    title, tolerance = f"simulator: terms far outside the time scale ({name})", "1e-4 of the restitution (rtol)"
    short, long = partial(drop, True), partial(drop, False)
    return Shortcut(title, short, long, _other_restitution, tolerance, counted("terms"), "terms")


def flights(duration: float) -> Shortcut:
    """Cross a flight at once, or in steps as long as those of a contact."""
    name = "simulator: a free flight is one step"
    return _dropped(name, Shortcuts(flights=False), _HIGH, duration, "solver_steps", "steps")


def _dropped(name: str, without: Shortcuts, height: float, duration: float, count: str, unit: str) -> Shortcut:
    """Drop a sphere with all shortcuts, and without one of them."""
    solid = materials.load("acrylic")

    def drop(shortcuts: Shortcuts) -> xr.Dataset:
        return contact.drop(solid, _SPHERE, _MASS, height, duration, shortcuts=shortcuts)

    short, long, tolerance = partial(drop, Shortcuts()), partial(drop, without), "1e-4 of the restitution (rtol)"
    return Shortcut(name, short, long, _other_restitution, tolerance, counted(count), unit)


def rest(duration: float) -> Shortcut:
    """Follow the creep at rest in few steps, or go on with the motion until the end."""
    solid = materials.load("acrylic")
    times = np.linspace(0.0, duration, 501)

    def drop(shortcuts: Shortcuts) -> xr.Dataset:
        return contact.drop(solid, _SPHERE, _MASS, _LOW, duration, times=times, shortcuts=shortcuts)

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        apart = np.abs(short["displacement"] - whole["displacement"]).max()
        return float(apart / (_STILL * abs(whole["displacement"][-1])))

    short, long = partial(drop, Shortcuts()), partial(drop, Shortcuts(rest=False))
    name, tolerance = "simulator: stop at rest", "1e-4 of the sag (rtol)"
    return Shortcut(name, short, long, difference, tolerance, counted("solver_steps"), "steps")


def memory(steps: int) -> Shortcut:
    """Carry the memory from step to step instead of summing over the whole history."""
    creep = Creep.of(materials.load("acrylic"))
    time = np.linspace(0.0, 0.01, steps + 1)
    load = np.sin(np.pi * time / time[-1]) ** 2 * 1e3

    def carried() -> Floats:
        memory, found = creep.rest(1), [0.0]
        weights = step_weights(creep, float(time[1]))
        for before, after in itertools.pairwise(load):
            past = history(weights, memory, np.array([before]))
            found.append(float((past + weights.compliance * after)[0]))
            memory = advance(weights, memory, np.array([before]), np.array([after]))
        return np.array(found)

    def summed() -> Floats:
        rate = np.diff(load) / np.diff(time)
        found = [0.0]
        for n in range(1, steps + 1):
            late = time[n] - time[: n + 1]
            # integral of J over a segment in which the load grows evenly
            grown = creep.instantaneous * late[:, None] + creep.C * (
                late[:, None] + creep.tau * np.expm1(-late[:, None] / creep.tau)
            )
            total = creep.instantaneous * late + (grown - creep.instantaneous * late[:, None]).sum(1)
            found.append(float(rate[:n] @ -np.diff(total)))
        return np.array(found)

    return Shortcut(
        "simulator: memory carried, not summed",
        carried,
        summed,
        lambda short, whole: float(np.abs(short - whole).max() / np.abs(whole).max() / 1e-9),
        "1e-9 of the largest displacement",
        lambda found: float(len(found)),
        "steps",
    )


def impacts_asked_for(duration: float) -> Shortcut:
    """End a drop of the collision law behind the impacts that a fit asks for."""

    def drop(impacts: int | None) -> xr.Dataset:
        return contact.collision(
            _SPHERE, _MASS, _HEIGHT, damping=_DAMPING, duration=duration, impacts=impacts, rtol=_LAW_RTOL
        )

    def difference(short: xr.Dataset, whole: xr.Dataset) -> float:
        apart = short["restitution"].values - whole["restitution"].values[:_IMPACTS]
        return float(np.abs(apart).max() / 1e-12)

    return Shortcut(
        "collision: impacts that nobody asked for",
        lambda: drop(_IMPACTS),
        lambda: drop(None),
        difference,
        "1e-12 of restitution",
        lambda found: float(found["restitution"].size),
        "impacts",
    )

"""Extreme impacts: drops, and two solvers compared."""

import warnings
from collections.abc import Mapping
from math import sqrt
from typing import Any

import numpy as np

from labpipe import contact
from labpipe.contact.impact import Solver
from labpipe.contact.sphere import hertz
from tests.extremes.inputs import Random, below_zero, extreme_material
from tests.extremes.outcome import Case, Outcome, worst

#: Work that one drop may take before it is refused; a contact takes some 200 steps.
_MOST_STEPS = 3_000
_SOLVERS: tuple[Solver, ...] = ("mdr", "rings")


def extreme_drop(random: Random, **options: Any) -> tuple[Any, float]:
    """Drop 1 mg to 1 t by 1 nm to 1 m; returns the result and the energy of the fall in J."""
    material = extreme_material(random)
    mass, height = 10 ** random.uniform(-6, 3), 10 ** random.uniform(-9, 0)
    if random.random() < 0.05:
        height = 0.0  # first contact at zero speed
    radius = 10 ** random.uniform(-3, 0.3)
    duration = sqrt(2.0 * height / 9.81) * random.uniform(1.1, 2.5) + 10 ** random.uniform(-5, -2)
    found = contact.drop(material, radius, mass, height, duration, max_steps=_MOST_STEPS, **options)
    return found, mass * 9.81 * (height + float(found.approach.max()))


def any_drop(random: Random) -> Outcome:
    """Energy bounds the error of every drop; nothing is negative, nothing is created."""
    solver = str(random.choice(["mdr", "mdr", "rings"]))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found, energy = extreme_drop(random, solver=solver, rtol=1e-3)
    error = float(np.abs(found.numerical_energy).max()) / energy
    said = any("energy error" in str(warning.message) for warning in caught)
    series = ("displacement", "velocity", "force", "contact_radius", "stored_energy")
    finite = all(np.all(np.isfinite(found[name].values)) for name in series)
    return worst(
        (0.0 if said else error / 6e-3, "unreported energy error 6e-3 at rtol = 1e-3"),
        (below_zero(found.force.values), "a force below zero"),
        (below_zero(np.diff(found.dissipated_energy.values, prepend=0.0)), "dissipation that falls"),
        (below_zero(1.0 + 1e-4 - found.restitution.values), "a rebound faster than the impact"),
        (0.0 if finite else np.inf, "a value that is not finite"),
    )


def two_solvers(random: Random) -> Outcome:
    """Compare the first impact by springs and by rings, which share neither grid nor kernel.

    A surface that recovers touches the leaving sphere again without load for some microseconds. Whether this still
    belongs to the contact moves the speed at lift-off, not the work that the contact has taken: this is compared.
    """
    material = extreme_material(random, 20)
    mass, height = 10 ** random.uniform(-4, 2), 10 ** random.uniform(-4, -1)
    radius = 10 ** random.uniform(-2, 0)
    speed = sqrt(2.0 * 9.81 * height)
    reduced = material.factor("contact") * material.E_relaxed
    longest = 3.0 * float(hertz.impact(speed, radius, mass, reduced).contact_duration)
    duration = speed / 9.81 + longest
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = [
                contact.drop(material, radius, mass, height, duration, name, max_steps=_MOST_STEPS) for name in _SOLVERS
            ]
        except UserWarning as warning:
            return Outcome(0.0, "", f"warned: {str(warning).split(';')[-1]}")
    forces = [float(run.peak_force[0] if run.sizes["impact"] else run.force.max()) for run in found]
    taken = [run.energy_dissipated + run.energy_stored for run in found]
    works = [float(work[0]) / (0.5 * mass * speed**2) if work.size else np.nan for work in taken]
    return worst(
        (abs(forces[0] / forces[1] - 1.0) / 4e-4, "peak forces of two solvers differ by 4e-4"),
        (np.nan_to_num(abs(works[0] - works[1])) / 1e-4, "work by two solvers differs by 1e-4 of the impact energy"),
    )


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {"any drop": (any_drop, 40), "springs and rings": (two_solvers, 15)}

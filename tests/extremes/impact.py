"""Extreme impacts: drops, two solvers compared, Hertz, appendix A."""

import warnings
from collections.abc import Mapping
from math import sqrt
from typing import Any

import numpy as np

from labpipe import contact
from labpipe.contact.impact import Solver
from labpipe.contact.sphere import hertz
from labpipe.materials import Prony
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


def elastic_impact(random: Random) -> Outcome:
    """Hertz's closed form, where the weight does not matter."""
    modulus, nu = 10 ** random.uniform(3, 12), float(random.uniform(0.0, 0.4999))
    mass, radius = 10 ** random.uniform(-6, 3), 10 ** random.uniform(-3, 1)
    speed = 10 ** random.uniform(-3, 0.6)
    gravity = 1e-9
    height = speed**2 / (2.0 * gravity)
    reduced = modulus / (1.0 - nu**2)
    exact = hertz.impact(speed, radius, mass, reduced)
    if float(exact.peak_contact_radius) > 0.5 * radius:
        return Outcome(0.0, "", "the contact would be as wide as the sphere")
    fall = sqrt(2.0 * height / gravity)
    # The time since the release would lose the contact's digits: it starts close above the flat.
    found = contact.drop(
        Prony(modulus, [], [], nu=nu),
        f"{radius!r} m",  # as a text, which asks nobody whether millimetres were meant
        mass,
        height,
        fall + 3.0 * float(exact.contact_duration),
        gravity=gravity,
        max_steps=_MOST_STEPS,
    )
    force = abs(float(found.peak_force[0]) / float(exact.peak_force) - 1.0)
    depth = abs(float(found.peak_approach[0]) / float(exact.peak_approach) - 1.0)
    back = abs(float(found.restitution[0]) - 1.0)
    return worst(
        (force / 2e-4, "relative error of Hertz's force 2e-4"),
        (depth / 1e-4, "relative error of Hertz's approach 1e-4"),
        (back / 1e-4, "restitution of an elastic sphere off by 1e-4"),
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


def any_collision(random: Random) -> Outcome:
    """Appendix A's law: without damping its restitution is the cube root of 1/f."""
    multiplier = float(random.choice([1.0, random.uniform(1.0, 20.0)]))
    damping = float(random.choice([0.0, 10 ** random.uniform(0, 5)]))
    found = contact.collision(
        10 ** random.uniform(-4, 0),
        10 ** random.uniform(-6, 3),
        10 ** random.uniform(-9, 0),
        youngs_modulus=10 ** random.uniform(3, 12),
        nu=float(random.uniform(0.0, 0.5)),
        damping=damping,
        unloading_multiplier=multiplier,
        yield_depth=float(random.choice([np.inf, 10 ** random.uniform(-7, -4)])),
        duration=10 ** random.uniform(-4, -1),
    )
    e = found.restitution.values
    known = e[np.isfinite(e)]
    lost = found.energy_dissipated.values
    energy = 0.5 * found.impact_speed.values**2
    return worst(
        (below_zero(found.force.values), "a force below zero"),
        (float(np.max(known - 1.0, initial=0.0)) / 1e-7, "a rebound faster by 1e-7"),
        (0.0 if np.all(np.isfinite(found.displacement.values)) else np.inf, "no height"),
        (
            float(np.isnan(lost).any() and np.isfinite(energy).all() and known.size == e.size),
            "a loss that is not finite",
        ),
    )


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "any drop": (any_drop, 40),
    "elastic impact": (elastic_impact, 40),
    "springs and rings": (two_solvers, 15),
    "collision": (any_collision, 15),
}

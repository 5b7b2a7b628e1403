"""The thesis's own scheme, plainly: full history, instantaneous step compliance, dense active set.

Equations (3.4)-(3.9). At step n the pressures ``sigma`` of the rings in contact solve

    J(0) G sigma_n = w_n - Omega_n - Gamma_n,
    Omega_n = G sum_{m<n} J((n - m) dt) (sigma_m - sigma_{m-1}),   Gamma_n = -J(0) G sigma_{n-1}

over an active set: rings that would pull leave it, rings that would overlap enter it. The sum
runs over all past steps again at every step, so the cost grows with the square of their number. A
retardation time far below ``dt`` answers with the glassy modulus although it has long relaxed;
where ``J(dt) > 2 J(0)`` successive steps over- and undershoot, and the contact flickers.

It is the reference that the benchmark measures against, and is never used by default. The thesis
does not say how it integrates the motion (3.9); here the approach of a step is that of constant
acceleration since the step before (velocity Verlet), and the contact is then solved at that
approach, which is how (3.6)-(3.9) read.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.contact.impact._springs import Profile, influence, surface_gap
from labpipe.contact.memory import Creep
from labpipe.errors import InputError, LabpipeError

# The thesis's ring width and time step.
RING_WIDTH = 4e-5
TIME_STEP = 2e-4
# Multiplications of history terms beyond this would take more than about an hour.
_MOST_PRODUCTS = 2e12
_MOST_SETS = 200


@dataclass(frozen=True, slots=True)
class ThesisRun:
    """Histories over time (time,), lengths downwards positive, and the work they took."""

    time: Floats
    position: Floats
    velocity: Floats
    force: Floats
    contact_radius: Floats
    reduced_gap: Floats
    active_set_solves: int
    history_products: int


@dataclass(frozen=True, slots=True)
class _Rings:
    matrix: Floats
    gap: Floats
    area: Floats
    width: float


def drop_thesis(
    creep: Creep,
    radius: float,
    mass: float,
    gravity: float,
    speed: float,
    duration: float,
    reach: float,
    *,
    ring_width: float = RING_WIDTH,
    time_step: float = TIME_STEP,
    profile: Profile = "parabola",
    observe: Callable[[float], None] | None = None,
) -> ThesisRun:
    """Follow a sphere from first touch in equal time steps.

    ``speed`` [m/s] is that at first touch, from which ``duration`` [s] counts; ``mass`` [kg] may include what the
    sphere carries. Rings of ``ring_width`` [m] are laid out to ``reach`` [m]. A resolution that would take hours, or
    leaves no ring in contact, raises InputError, and a contact that outgrows the rings LabpipeError.
    """
    steps, count = ceil(duration / time_step), ceil(reach / ring_width) + 1
    if not (count > 2 and 0.5 * steps**2 * count < _MOST_PRODUCTS):
        raise InputError(
            f"{steps} steps with {count} rings: the full history would take "
            f"{0.5 * steps**2 * count:.1e} products, expected fewer than {_MOST_PRODUCTS:.0e} and "
            "3 or more rings; choose a longer time step or another ring width"
        )
    middle = np.linspace(0.5, count - 0.5, count) * ring_width
    rings = _Rings(
        influence(count) * ring_width,
        surface_gap(middle, radius, profile),
        2.0 * np.pi * ring_width * middle,
        ring_width,
    )
    time = np.linspace(0.0, steps, steps + 1) * time_step
    position, velocity, force, contact, reduced_gap = np.zeros((5, steps + 1))
    velocity[0], acceleration = speed, gravity
    creep_at_lag = creep.compliance(time)
    pressure, increments = np.zeros(count), np.zeros((steps + 1, count))
    solves = 0
    half = 0.5 * time_step
    for n in range(1, steps + 1):
        remembered = creep_at_lag[n:0:-1] @ increments[:n]
        past = rings.matrix @ (remembered - creep_at_lag[0] * pressure)
        position[n] = position[n - 1] + time_step * (velocity[n - 1] + half * acceleration)
        overlap = position[n] - rings.gap - past
        new, n_solves = _active_set(rings.matrix, creep_at_lag[0], overlap, pressure > 0.0)
        solves += n_solves
        increments[n], pressure = new - pressure, new
        force[n] = rings.area @ pressure
        previous, acceleration = acceleration, gravity - force[n] / mass
        velocity[n] = velocity[n - 1] + half * (previous + acceleration)
        contact[n] = ring_width * np.count_nonzero(pressure > 0.0)
        surface = past[0] + creep_at_lag[0] * float(rings.matrix[0] @ pressure)
        reduced_gap[n] = surface + rings.gap[0] - position[n]
        if pressure[-1] > 0.0:
            raise LabpipeError(f"the contact outgrew the rings ({reach:.4g} m); give more reach")
        if observe is not None:
            observe(float(time[n]))
    products = steps * (steps + 1) // 2 * count
    return ThesisRun(time, position, velocity, force, contact, reduced_gap, solves, products)


def _active_set(matrix: Floats, compliance: float, overlap: Floats, active: Flags) -> tuple[Floats, int]:
    """Pressures (ring,) in Pa that press an overlap (ring,) [m] away, and the solves it took."""
    active = active if active.any() else overlap > 0.0
    # Rounding must not let a ring on the edge enter and leave for ever.
    slack = 1e-12 * float(np.abs(overlap).max())
    for solves in range(1, _MOST_SETS):
        pressure = np.zeros(overlap.size)
        inside = np.flatnonzero(active)
        block = compliance * matrix[np.ix_(inside, inside)]
        pressure[inside] = np.linalg.solve(block, overlap[inside])
        left = overlap - compliance * (matrix @ pressure)
        wanted = np.where(active, pressure > 0.0, left > slack)
        if np.array_equal(wanted, active):
            return pressure, solves
        active = wanted
    raise LabpipeError("the active set did not settle; choose another ring width or time step")

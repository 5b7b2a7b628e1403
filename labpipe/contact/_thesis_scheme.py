r"""The thesis's own scheme, of lines and of spheres: full history, instantaneous step compliance, active set.

Equations (2.13)-(2.16) and (3.4)-(3.9). With uniform steps Δt the pressures σ of step n, of the strips or
rings in contact, solve

.. math::
    J(0)\,G\,\sigma^n = w^n - G \sum_{k<n} J((n-k)\Delta t)\,\Delta\sigma^k + J(0)\,G\,\sigma^{n-1}

over an active set: elements that would pull leave it, elements that would overlap enter it. The cost grows with the
square of the steps. A retardation time far below Δt answers with the glassy modulus although it has long relaxed; where
J(Δt) > 2 J(0) successive steps over- and undershoot.

It is a reference, never used by default. The thesis does not say how it integrates the motion (3.9); here the approach
of a step is that of constant acceleration since the step before (velocity Verlet).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError, LabpipeError

#: Ring width [m] and time step [s] of the thesis.
RING_WIDTH, TIME_STEP = 4e-5, 2e-4
# Multiplications of history terms beyond this would take more than about an hour, bytes more than there is room for.
_MOST_PRODUCTS, _MOST_BYTES = 2e12, 1 << 30
_MOST_SETS = 200


@dataclass(slots=True)
class ThesisScheme:
    """Pressures (element,) [Pa] of one contact, step by step.

    ``matrix`` (element, element) [m]: influence; ``gap`` (element,) [m]: height of the indenter; ``creep`` (step,)
    [1/Pa]: contact compliance at all lags.
    """

    matrix: Floats
    gap: Floats
    creep: Floats
    pressure: Floats = field(init=False)
    increments: Floats = field(init=False)
    work: dict[str, int] = field(default_factory=lambda: {"history_products": 0, "active_set_solves": 0})

    def __post_init__(self) -> None:
        steps, count = self.creep.size, self.gap.size
        if 0.5 * steps**2 * count > _MOST_PRODUCTS or 8 * steps * count > _MOST_BYTES:
            raise InputError(
                f"{steps} steps with {count} elements: the full history would take {0.5 * steps**2 * count:.1e} "
                f"products, expected fewer than {_MOST_PRODUCTS:.0e}; choose a longer time step or wider elements"
            )
        self.pressure, self.increments = np.zeros(count), np.zeros((steps, count))

    def step(self, n: int, approach: float) -> Floats:
        """Press to an approach [m] at step n; return the displacement (element,) [m] that the past leaves."""
        remembered = self.creep[n:0:-1] @ self.increments[:n]  # J((n - k) dt) falls on increment k = 0 ... n - 1
        past = np.asarray(self.matrix @ (remembered - self.creep[0] * self.pressure))
        overlap = approach - self.gap - past
        active = self.pressure > 0.0
        active = active if active.any() else overlap > 0.0
        # Rounding must not let an element on the edge enter and leave for ever.
        slack = 1e-12 * float(np.abs(overlap[np.isfinite(overlap)]).max())
        for _ in range(_MOST_SETS):
            self.work["active_set_solves"] += 1
            new, inside = np.zeros(overlap.size), np.flatnonzero(active)
            block = self.creep[0] * self.matrix[np.ix_(inside, inside)]
            new[inside] = np.linalg.solve(block, overlap[inside])
            left = overlap - self.creep[0] * (self.matrix @ new)
            wanted = np.where(active, new > 0.0, left > slack)
            if np.array_equal(wanted, active):
                break
            active = wanted
        else:
            raise LabpipeError("the active set did not settle; choose another element width or time step")
        self.work["history_products"] += n * self.gap.size
        self.increments[n], self.pressure = new - self.pressure, new
        return past


def drop_thesis(
    rings: tuple[Floats, Floats, float],
    compliance: Callable[[Floats], Floats],
    mass: float,
    gravity: float,
    speed: float,
    duration: float,
    time_step: float,
    observe: Callable[[float], None] | None = None,
) -> tuple[Floats, dict[str, int]]:
    """Follow a sphere from first touch in equal time steps.

    ``rings``: influence (ring, ring) [m], gap (ring,) [m] and width [m]. Returns (6, step + 1) time, position,
    velocity, force, contact radius and reduced gap, lengths downwards positive, and the work done.
    """
    matrix, gap, width = rings
    steps = ceil(duration / time_step)
    table = np.zeros((6, steps + 1))
    time, position, velocity, force, contact, reduced_gap = table
    time[:] = np.linspace(0.0, steps, steps + 1) * time_step
    scheme = ThesisScheme(matrix, gap, compliance(time))
    area = np.pi * width**2 * (2.0 * np.arange(gap.size) + 1.0)
    velocity[0], acceleration, half = speed, gravity, 0.5 * time_step
    for n in range(1, steps + 1):
        position[n] = position[n - 1] + time_step * (velocity[n - 1] + half * acceleration)
        past = scheme.step(n, position[n])
        force[n] = area @ scheme.pressure
        previous, acceleration = acceleration, gravity - force[n] / mass
        velocity[n] = velocity[n - 1] + half * (previous + acceleration)
        contact[n] = width * np.count_nonzero(scheme.pressure)
        surface = past[0] + scheme.creep[0] * float(matrix[0] @ scheme.pressure)
        reduced_gap[n] = surface + gap[0] - position[n]
        if scheme.pressure[-1] > 0.0:
            raise LabpipeError("the contact outgrew the rings: choose a shorter time step")
        if observe is not None:
            observe(float(time[n]))
    return table, scheme.work

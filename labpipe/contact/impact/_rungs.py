"""The ladder of step lengths: everything a step needs to know of the memory, once per rung."""

from dataclasses import dataclass, field
from math import floor, log2

import numpy as np

from labpipe.contact.memory import Array, Creep, StepWeights, step_weights

# Rungs of the ladder per factor of two.
RUNGS = 4
# A load that is linear in time rings from step to step when the step is long against the fastest
# relaxation. Where one step would leave more than this part of the ringing, a share of the load's
# change is put at the start of the step, which damps it to this part.
MOST_RINGING = 0.6


@dataclass(frozen=True, slots=True)
class Rung:
    """The weights of one step length, arranged for the two matrix products of a step."""

    weights: StepWeights
    rows: Array
    pair: Array
    jump: float
    old_integral: float
    new_integral: float
    jump_compliance: float


def rung_of(creep: Creep, dt: float) -> Rung:
    """Weights of a step, and those of the time integral of the displacement for its work."""
    weights = step_weights(creep, dt)
    plain_old, plain_new = weights.old, weights.new
    excess = weights.old_total - MOST_RINGING * weights.compliance
    jump = max(0.0, excess / (weights.old_total * (1.0 + MOST_RINGING))) if excess > 0.0 else 0.0
    if jump > 0.0:
        weights = step_weights(creep, dt, jump=jump)
    n_terms = creep.n_terms
    dwell = -np.expm1(-dt * creep.rate)
    dwell[:n_terms] *= creep.tau
    dwell[n_terms:] = dt
    half = 0.5 * dt * (creep.instantaneous + float(creep.C.sum()))
    flow = creep.fluidity * dt**2
    old_integral = half - float(creep.tau @ plain_old[:n_terms]) + flow / 3.0
    new_integral = half - float(creep.tau @ plain_new[:n_terms]) + flow / 6.0
    return Rung(
        weights,
        np.stack([weights.decay, dwell]),
        np.stack([weights.old, weights.new], axis=1),
        jump,
        (1.0 - jump) * old_integral,
        new_integral + jump * old_integral,
        0.5 * creep.instantaneous * jump**2,
    )


@dataclass(slots=True)
class Ladder:
    """Rungs at ``base * 2**(i / 4)``, made when they are first used.

    Parameters
    ----------
    creep : Creep
        Contact compliance.
    base : float [s]
        Step length of rung 0.
    """

    creep: Creep
    base: float
    _rungs: dict[int, Rung] = field(default_factory=dict)

    def below(self, dt: float) -> Rung:
        """Return the longest rung that is not longer than ``dt`` [s]."""
        return self.at(floor(RUNGS * log2(dt / self.base)))

    def at(self, index: int) -> Rung:
        """Return a rung by its number."""
        if index not in self._rungs:
            self._rungs[index] = rung_of(self.creep, self.base * 2.0 ** (index / RUNGS))
        return self._rungs[index]

"""Creep at rest: the sphere sinks in under its weight alone, in steps that grow."""

from typing import TYPE_CHECKING

import numpy as np

from labpipe.contact.impact._bounce_step import LONGEST, NEWTON_LIMIT, NEWTON_TOLERANCE, OLD, Trial
from labpipe.contact.impact._plate import PlateState
from labpipe.contact.impact._rungs import Rung, rung_of

if TYPE_CHECKING:
    from labpipe.contact.impact._bounce import Stepper


def settle(stepper: "Stepper", until: float, growth: float) -> None:
    """Creep on under the weight alone, in steps that grow by a factor each."""
    dt = LONGEST * stepper.time_scale
    weight = stepper.body.mass * stepper.body.gravity
    while stepper.time < until:
        remaining = min([until, *stepper.wanted[:1]]) - stepper.time
        rung = stepper.ladder.below(dt) if dt < remaining else rung_of(stepper.creep, remaining)
        trial = _attempt_resting(stepper, rung, weight)
        if trial is None:
            # The surface would flow further in this step than the contact may spread.
            stepper.counts.rejected_steps += 1
            dt = 0.5 * rung.weights.dt
            continue
        _accept_resting(stepper, trial, until)
        stepper.counts.rest_steps += 1
        dt *= growth
    stepper.give_back()


def _attempt_resting(stepper: "Stepper", rung: Rung, weight: float) -> Trial | None:
    """Find the approach that carries the weight; None when the step is too long for it."""
    wanted = weight * rung.weights.compliance
    while True:
        reach = stepper.past(rung)
        loaded = int(np.count_nonzero(stepper.rows[OLD]))
        approach = float(reach[: loaded + 1].max())
        for _ in range(NEWTON_LIMIT):
            scaled, slope = stepper.springs.force(approach, reach, stepper.moments)
            if slope <= 0.0:
                return None
            change = (scaled - wanted) / slope
            approach -= change
            stepper.counts.newton_iterations += 1
            if abs(change) <= NEWTON_TOLERANCE * abs(approach - reach.item(0)):
                break
        if approach < reach.item(-2):
            break
        stepper.grow()
    if np.count_nonzero(reach < approach) != reach.searchsorted(approach):
        return None
    plate = PlateState()
    if stepper.body.plate is not None:
        plate = PlateState(weight / stepper.body.plate.stiffness)
    position = approach + plate.displacement
    return Trial(rung, approach, weight, position, plate, reach)


def _accept_resting(stepper: "Stepper", trial: Trial, until: float) -> None:
    stepper.velocity = (trial.position - stepper.position) / trial.rung.weights.dt
    stepper.acceleration = 0.0
    stepper.move_on(trial)
    if until - stepper.time < 1e-12 * until:
        stepper.time = until

"""Hand plain steps of a contact to the compiled loop, and take back what it did.

The loop knows arrays only (:mod:`._bounce_compiled`); here the stepper's state is put
into one vector, and the records that come back go onto its trail.
"""

import warnings
from math import floor, log2
from typing import TYPE_CHECKING

import numpy as np

from labpipe.contact.impact._bounce_step import (
    DISPLACEMENT,
    GROWTH,
    LONGEST,
    NEWTON_LIMIT,
    NEWTON_TOLERANCE,
    OLD,
    SAFETY,
    SHRINK,
    Pace,
)
from labpipe.contact.impact._compilation import said
from labpipe.contact.impact._motion import Record
from labpipe.contact.impact._plate import PlateState
from labpipe.contact.impact._rest import RestTest
from labpipe.contact.impact._rungs import RUNGS
from labpipe.contact.memory import Array

if TYPE_CHECKING:
    from labpipe.contact.impact._bounce import Stepper

# Steps that the compiled loop takes before their records are fetched, and the rungs it knows: down
# to 2^-32 of the longest step.
_BUFFER, _RUNGS_IN_TABLE = 4096, 128


def plain_steps(stepper: "Stepper", pace: "Pace", until: float, is_resting: RestTest) -> bool:
    """Take plain steps, compiled; true at rest, else the next one is in numpy."""
    from labpipe.contact.impact import _bounce_compiled as compiled

    if stepper.table is None:
        top = floor(RUNGS * log2(LONGEST))
        stepper.table = compiled.tabulate(stepper.ladder, top - _RUNGS_IN_TABLE, top)
    n, rows = stepper.gap.size, stepper.rows
    plate = stepper.body.plate
    plain = stepper.springs.plain(n)
    line = compiled.Line(stepper.gap, stepper.weight, stepper.springs.position[:n], *plain)
    rules = compiled.Rules(
        stepper.body.mass,
        stepper.body.gravity,
        stepper.creep.instantaneous,
        until,
        stepper.time_scale,
        RUNGS,
        pace.longest,
        stepper.tolerance * stepper.speed_scale,
        pace.leniency,
        pace.lenient_from,
        GROWTH,
        SHRINK,
        SAFETY,
        NEWTON_LIMIT,
        NEWTON_TOLERANCE,
        is_resting.tolerance,
        is_resting.period,
        is_resting.speed,
        *((plate.mass, plate.stiffness, plate.damping) if plate else (0.0, 0.0, 0.0)),
    )
    state = np.array(
        [
            *(
                stepper.time,
                stepper.position,
                stepper.velocity,
                stepper.acceleration,
                stepper.approach,
            ),
            *(stepper.force, stepper.spring_work, *stepper.previous, pace.dt, stepper.leniency),
            *(is_resting.start, is_resting.slowest, is_resting.fastest, is_resting.largest),
            *(*stepper.plate, stepper.plate_loss),
        ]
    )
    load, displacement = rows[OLD].copy(), rows[DISPLACEMENT].copy()
    buffer = np.empty((_BUFFER, compiled.N_RECORD))
    while True:
        counts = np.zeros(4, dtype=np.int64)
        try:
            filled, reason = compiled.plain_steps(
                state, counts, rules, stepper.table, line, stepper.block, load, displacement,
                stepper.inverse, buffer,
            )  # fmt: skip
        except OSError as error:
            # The compiled code could not be stored; nothing was stepped. Go on in numpy.
            warnings.warn(said(error), UserWarning, stacklevel=2)
            stepper.is_compiled = False
            return False
        _take_records(stepper, buffer[:filled], counts.tolist())
        if reason != compiled.BUFFER_FULL:
            break
    values = state.tolist()
    stepper.time, stepper.position, stepper.velocity, stepper.acceleration, stepper.approach = (
        values[:5]
    )
    stepper.force, stepper.spring_work, before, dt_before, pace.dt, stepper.leniency = values[5:11]
    stepper.previous = (before, dt_before)
    is_resting.start, is_resting.slowest, is_resting.fastest, is_resting.largest = values[11:15]
    stepper.plate, stepper.plate_loss = PlateState(*values[15:18]), values[18]
    rows[OLD], rows[DISPLACEMENT] = load, displacement
    np.multiply(load, stepper.weight, out=stepper.weighted[0])
    return reason == compiled.RESTING


def _take_records(stepper: "Stepper", rows: Array, counts: list[int]) -> None:
    """Append what the compiled steps recorded and count what they did."""
    if stepper.outer_stored.any():
        lag = rows[:, :1] - stepper.outer_time
        rows[:, 6] += np.exp(-2.0 * lag * stepper.creep.rate) @ stepper.outer_stored
    stepper.trail.extend(
        Record._make((*row[:8], PlateState(*row[8:11]), row[11])) for row in rows.tolist()
    )
    steps, rejected, newton, products = counts
    stepper.counts.rejected_steps += rejected
    stepper.counts.newton_iterations += newton
    stepper.counts.kernel_products += products
    stepper.counts.spring_updates += products * stepper.block.size
    stepper.counts.solver_steps += steps
    if len(rows):
        stepper.look_at_limits(float(rows[-1, 0]))

"""What a step of given length needs to know of the memory, for many lengths at once."""

from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact.memory import Creep, late_share

# A load that is linear in time rings from step to step when the step is long against the fastest
# relaxation. Where one step would leave more than this part of the ringing, a share of the load's
# change is put at the start of the step, which damps it to this part.
MOST_RINGING = 0.6


class StepTable(NamedTuple):
    """Weights of steps by their length: each field (length,), the last four (length, element).

    As :class:`labpipe.contact.memory.StepWeights`, ``jump`` being the share of the load's change
    that is put at the start; the integrals are those of the displacement over the step per old and
    new load, ``dwell`` that of what each element holds at the start.
    """

    dt: Floats
    compliance: Floats
    old_total: Floats
    jump: Floats
    old_integral: Floats
    new_integral: Floats
    jump_compliance: Floats
    decay: Floats
    dwell: Floats
    old: Floats
    new: Floats


def step_table(creep: Creep, dt: Floats) -> StepTable:
    """Weights of steps of the lengths ``dt`` (length,) [s], and of the work done in them.

    Examples
    --------
    >>> table = step_table(Creep.from_terms(1.0, [2.0], [0.5]), np.array([1e-6, 1e6]))
    >>> table.compliance.round(4).tolist(), table.jump.round(2).tolist()
    ([1.0, 3.0], [0.0, 0.0])
    """
    steps = dt[:, None]
    loss = -np.expm1(-steps / creep.tau)
    share = late_share(steps / creep.tau, loss)
    flow = creep.fluidity * dt
    half = 0.5 * flow[:, None] if creep.fluidity > 0.0 else np.empty((dt.size, 0))
    old = np.hstack([creep.C * (loss - share), half])
    new = np.hstack([creep.C * share, half])
    dwell = np.hstack([creep.tau * loss, steps if half.size else half])
    whole = 0.5 * dt * (creep.instantaneous + float(creep.C.sum()))
    terms = creep.n_terms
    old_integral = whole - old[:, :terms] @ creep.tau + flow * dt / 3.0
    new_integral = whole - new[:, :terms] @ creep.tau + flow * dt / 6.0
    old_total = old.sum(axis=1)
    excess = old_total - MOST_RINGING * (creep.instantaneous + new.sum(axis=1))
    jump = np.maximum(excess, 0.0) / np.maximum(old_total * (1.0 + MOST_RINGING), 1e-300)
    new = new + jump[:, None] * old
    old = (1.0 - jump)[:, None] * old
    return StepTable(
        dt=dt,
        compliance=creep.instantaneous + new.sum(axis=1),
        old_total=old.sum(axis=1),
        jump=jump,
        old_integral=(1.0 - jump) * old_integral,
        new_integral=new_integral + jump * old_integral,
        jump_compliance=0.5 * creep.instantaneous * jump**2,
        decay=np.exp(-steps * creep.rate),
        dwell=dwell,
        old=old,
        new=new,
    )

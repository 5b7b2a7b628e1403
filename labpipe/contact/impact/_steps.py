"""The steps of a contact between sphere and flat, compiled.

Motion: average acceleration (Newmark), so that the change of kinetic and potential energy is the
trapezoid of force times displacement to rounding, at any step length. The only unknown of a step is
the approach; the force is a convex, increasing function of it, so that Newton's method cannot fail.
Error control: ``dt^3 a''/12``, the step's own error in velocity, against the speed of this bounce.

What needs more than the arrays at hand is handed back: the instant of lift-off, a step that must
end at a given time, a contact that outgrows its springs.
"""

from math import floor, isnan, log2, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean
from labpipe.contact.impact._motion import Counts, Motion, Trail
from labpipe.contact.impact._step_table import StepTable

# How a step, or a run of them, ends.
ACCEPTED, REJECTED, OUTGROWN, ANNULAR, LIFTED, RELEASED, LAST, OFF_TABLE, RESTING, FULL = range(10)
# The step grows and shrinks by at most these factors; the safety factor is on the step length.
_GROWTH, _SHRINK, _SAFETY = 2.0, 0.3, 0.9
_NEWTON_LIMIT = 60
# Newton converges quadratically: one more evaluation after this relative change is exact.
_NEWTON_TOLERANCE = 1e-8
# Lengths in a table of steps per factor of two.
PER_OCTAVE = 4
_FAST = {"reassoc", "contract", "nsz"}


class Pace(Protocol):
    """How long the next step may be, and what the rest test has seen of the current period.

    ``attempted`` is the length of the last step tried; steps may err by ``leniency`` times more,
    ``late_leniency`` after ``lenient_from``.
    """

    dt: float
    longest: float
    attempted: float
    leniency: float
    late_leniency: float
    lenient_from: float
    acceleration_before: float
    dt_before: float
    rest_start: float
    slowest: float
    fastest: float
    largest: float


PACE = np.dtype([(name, np.float64) for name in Pace.__annotations__])


class Rules(NamedTuple):
    """Numbers that stay the same during a contact.

    ``base`` [s] is the step whose place in the table, counted from the ``lowest``, is 0;
    ``allowed`` [m/s] the error of a step; the plate's numbers are 0 on a rigid flat.
    """

    mass: float
    gravity: float
    instantaneous: float
    base: float
    lowest: int
    allowed: float
    rest_tolerance: float
    rest_period: float
    rest_speed: float
    plate_speed: float
    plate_mass: float
    plate_stiffness: float
    plate_damping: float


class Block(NamedTuple):
    """The springs that take part in a contact: what they are, hold, and room to work in.

    All (spring,), but ``total`` and ``moments`` (spring + 1,), running sums of the weights and of
    weight times reach, ``memory`` (element, spring) [m] and ``inverse`` (element,) [Pa], half of
    ``1/C``. ``reach`` is the approach that would leave each spring unloaded.
    """

    gap: Floats
    weight: Floats
    position: Floats
    last_weight: Floats
    total: Floats
    edge_bias: float
    memory: Floats
    inverse: Floats
    load: Floats
    displacement: Floats
    reach: Floats
    moments: Floats
    new_load: Floats
    new_displacement: Floats


@inner()
def _carrying(block: Block, approach: float) -> int:
    """Count the springs, from the centre, that carry at an approach [m]."""
    low, high = 0, block.reach.size
    while low < high:
        middle = (low + high) // 2
        if block.reach[middle] < approach:
            low = middle + 1
        else:
            high = middle
    return low


@inner()
def _edge(block: Block, last: int, approach: float) -> float:
    """Where between two springs the load, linear in the square of the radius, is zero."""
    start = block.reach[last]
    fraction = (approach - start) / (block.reach[last + 1] - start)
    square, beyond = block.position[last] ** 2, block.position[last + 1] ** 2
    return sqrt(square + fraction * (beyond - square))


@lean()
def force(block: Block, approach: float) -> tuple[float, float]:
    """Force and its slope, both times the step compliance, at an approach [m].

    Reads ``reach`` and ``moments`` of the block; the approach lies below the last reach.
    """
    count = _carrying(block, approach)
    if count == 0:
        return 0.0, 0.0
    if not isnan(block.edge_bias):
        return approach * block.total[count] - block.moments[count], block.total[count]
    last = count - 1
    excess = approach - block.reach[last]
    x = block.position[last]
    edge = x if count == block.reach.size else _edge(block, last, approach)
    partial = 0.0
    if edge + x > 0.0:
        partial = 2.0 * (edge - x) * (2.0 * edge + x) / (3.0 * (edge + x))
    inside = approach * block.total[last] - block.moments[last]
    return inside + excess * (block.last_weight[last] + partial), 2.0 * edge


@lean()
def contact_radius(block: Block, approach: float) -> float:
    """Radius in m where the load falls to zero.

    An advancing edge meets springs that were free until now, so that the surface outside, continued
    inwards, tells where it is; behind it the surface has a kink. A receding edge lies between its
    neighbours. Rings know the place between two of them only, and its bias.
    """
    count = _carrying(block, approach)
    if count == 0:
        return 0.0
    between = _edge(block, count - 1, approach)
    if not isnan(block.edge_bias):
        return max(between - block.edge_bias, 0.0)
    if count + 1 >= block.reach.size:
        return between
    square, beyond = block.position[count] ** 2, block.position[count + 1] ** 2
    slope = (block.reach[count + 1] - block.reach[count]) / (beyond - square)
    return sqrt(max(square - (block.reach[count] - approach) / slope, between**2))


@lean(fastmath=_FAST)
def look_ahead(table: StepTable, i: int, block: Block, counts: Counts) -> None:
    """Fill the reach of each spring at the end of a step, and its running moment."""
    reach, memory = block.reach, block.memory
    n = reach.size
    for j in range(n):
        reach[j] = block.gap[j] + table.old_total[i] * block.load[j]
    for k in range(memory.shape[0]):
        kept = table.decay[i, k]
        for j in range(n):
            reach[j] += kept * memory[k, j]
    for j in range(n):
        block.moments[j + 1] = block.moments[j] + block.weight[j] * reach[j]
    counts.kernel_products += 1
    counts.spring_updates += memory.size


@inner(fastmath=_FAST)
def _remember(table: StepTable, i: int, block: Block) -> tuple[float, float]:
    """Update the memory; return its weighted dwell on the change of load, and its energy."""
    dwelt, held = 0.0, 0.0
    memory, load, new, weight = block.memory, block.load, block.new_load, block.weight
    for k in range(memory.shape[0]):
        kept, dwell = table.decay[i, k], table.dwell[i, k]
        early, late = table.old[i, k], table.new[i, k]
        moved, squared = 0.0, 0.0
        for j in range(load.size):
            w = memory[k, j]
            moved += weight[j] * (new[j] - load[j]) * w
            w = kept * w + early * load[j] + late * new[j]
            memory[k, j] = w
            squared += weight[j] * w * w
        dwelt += dwell * moved
        held += block.inverse[k] * squared
    return dwelt, held


@inner(fastmath=_FAST)
def _move_on(now: Motion, rules: Rules, table: StepTable, i: int, block: Block, approach: float) -> bool:
    """Bring springs, memory and ledger to the end of a step; false unless the inner ones carry.

    The work on the springs is ``int q dw``, exact for the loads as they are assumed in the step.
    """
    compliance, jump = table.compliance[i], table.jump[i]
    load, new, before, after = (block.load, block.new_load, block.displacement, block.new_displacement)
    loaded = 0
    for j in range(load.size):
        new[j] = max(approach - block.reach[j], 0.0) / compliance
        loaded += new[j] > 0.0
        after[j] = block.reach[j] - block.gap[j] + compliance * new[j]
    if loaded != _carrying(block, approach):
        return False
    work, jumped, on_old, on_new, squared = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(load.size):
        weight = block.weight[j]
        change = weight * (new[j] - load[j])
        work += weight * (new[j] * after[j] - load[j] * before[j])
        jumped += change * before[j]
        on_old += change * load[j]
        on_new += change * new[j]
        squared += weight * new[j] * new[j]
    dwelt, held = _remember(table, i, block)
    integral = dwelt + table.old_integral[i] * on_old + table.new_integral[i] * on_new
    work -= (1.0 - jump) * integral / table.dt[i]
    now.spring_work += work - jump * jumped - table.jump_compliance[i] * (on_new - on_old)
    now.stored = held + 0.5 * rules.instantaneous * squared
    now.contact_radius = contact_radius(block, approach)
    now.approach = approach
    now.time += table.dt[i]
    for j in range(load.size):
        load[j], before[j] = new[j], after[j]
    return True


@inner()
def _newton(block: Block, target: float, softness: float, approach: float, counts: Counts) -> float:
    """Solve ``approach - target + softness * force = 0``: convex and increasing."""
    for _ in range(_NEWTON_LIMIT):
        scaled, slope = force(block, approach)
        change = (approach - target + softness * scaled) / (1.0 + softness * slope)
        approach -= change
        counts.newton_iterations += 1
        if abs(change) <= _NEWTON_TOLERANCE * abs(approach - block.reach[0]):
            break
    return approach


@lean()
def free_motion(now: Motion, rules: Rules, dt: float) -> tuple[float, float, float, float]:
    """Position of the sphere, and of the plate, after a step without force; answers to one."""
    quarter = 0.25 * dt * dt
    position = now.position + dt * now.velocity + quarter * (now.acceleration + rules.gravity)
    answer = quarter / rules.mass
    if rules.plate_mass == 0.0:
        return position, answer, 0.0, 0.0
    reached, acceleration, inertia = _free_plate(now, rules, dt)
    return position, answer, reached + quarter * acceleration, quarter / inertia


@inner()
def _free_plate(now: Motion, rules: Rules, dt: float) -> tuple[float, float, float]:
    """Average acceleration of ``m u'' + c u' + k u = F``: what a step finds without force.

    Returns the displacement without the new acceleration's part, that acceleration, and the force
    per acceleration. The acceleration is solved for, not the displacement: no digit is lost in a
    short step.
    """
    quarter = 0.25 * dt * dt
    half_way = now.plate_velocity + 0.5 * dt * now.plate_acceleration
    reached = now.plate_displacement + dt * now.plate_velocity + quarter * now.plate_acceleration
    inertia = rules.plate_mass + 0.5 * dt * rules.plate_damping + quarter * rules.plate_stiffness
    pull = rules.plate_damping * half_way + rules.plate_stiffness * reached
    return reached, -pull / inertia, inertia


@inner()
def _move_plate(now: Motion, rules: Rules, dt: float, push: float) -> None:
    """Bring the plate to the end of a step, and count what its dashpot took."""
    if rules.plate_mass == 0.0:
        return
    reached, free, inertia = _free_plate(now, rules, dt)
    acceleration = free + push / inertia
    mean = now.plate_velocity + 0.25 * dt * (now.plate_acceleration + acceleration)
    now.plate_loss += rules.plate_damping * mean**2 * dt
    now.plate_displacement = reached + 0.25 * dt * dt * acceleration
    now.plate_velocity += 0.5 * dt * (now.plate_acceleration + acceleration)
    now.plate_acceleration = acceleration


@inner()
def _error(now: Motion, pace: Pace, rules: Rules, acceleration: float, dt: float) -> float:
    """Error in velocity of a trial step over what is allowed."""
    slope = (acceleration - now.acceleration) / dt
    earlier = 0.0
    if pace.dt_before > 0.0:
        earlier = (now.acceleration - pace.acceleration_before) / pace.dt_before
    curvature = abs(slope - earlier) * 2.0 / (dt + pace.dt_before)
    return dt**3 * curvature / (12.0 * pace.leniency * rules.allowed)


@lean()
def one_step(
    now: Motion, pace: Pace, rules: Rules, table: StepTable, i: int, block: Block, counts: Counts, releases: bool
) -> int:
    """Try one step.

    ``now``, ``pace``, ``block`` and ``counts`` are changed in place, ``now`` and ``block`` only by a step that is
    accepted; the length is place ``i`` of ``table``. With ``releases`` the step ends where the last spring, at the
    centre, lets go. Returns ACCEPTED, REJECTED (the pace is shorter now), OUTGROWN, ANNULAR, or LIFTED: the contact
    ends inside the step.
    """
    dt = table.dt[i]
    pace.attempted = dt
    free, answer, plate, plate_answer = free_motion(now, rules, dt)
    target, total = free - plate, answer + plate_answer
    look_ahead(table, i, block, counts)
    approach, push = target, 0.0
    if releases:
        # Rounding must not leave a trace of contact.
        approach = min(target, block.reach[0])
    elif target > block.reach[0]:
        softness = total / table.compliance[i]
        approach = _newton(block, target, softness, target - total * now.force, counts)
        push = force(block, approach)[0] / table.compliance[i]
        approach = target - total * push
    if approach >= block.reach[block.reach.size - 2]:
        return OUTGROWN
    if push <= 0.0 and block.load[0] > 0.0 and not releases:
        return LIFTED
    acceleration = rules.gravity - push / rules.mass
    error = _error(now, pace, rules, acceleration, dt)
    if error > 1.0:
        counts.rejected_steps += 1
        pace.dt = dt * max(_SHRINK, _SAFETY * error ** (-1.0 / 3.0))
        return REJECTED
    if not _move_on(now, rules, table, i, block, approach):
        return ANNULAR
    _move_plate(now, rules, dt, push)
    pace.acceleration_before, pace.dt_before = now.acceleration, dt
    now.velocity += 0.5 * dt * (now.acceleration + acceleration)
    now.acceleration, now.force, now.position = acceleration, push, free - answer * push
    counts.solver_steps += 1
    pace.dt = dt * (_GROWTH if error <= 0.0 else min(_GROWTH, _SAFETY * error ** (-1.0 / 3.0)))
    return ACCEPTED


@lean()
def rests(now: Motion, pace: Pace, rules: Rules) -> bool:
    """Look whether the contact has come to rest, as ``Stillness`` says."""
    unbalanced = abs(now.force / (rules.mass * rules.gravity) - 1.0)
    unbalanced = max(unbalanced, abs(now.plate_velocity) / rules.plate_speed)
    pace.slowest = min(pace.slowest, now.velocity)
    pace.fastest = max(pace.fastest, now.velocity)
    pace.largest = max(pace.largest, unbalanced)
    if now.time - pace.rest_start >= rules.rest_period:
        swing = 0.5 * (pace.fastest - pace.slowest) / rules.rest_speed
        resting = max(pace.largest, swing) < rules.rest_tolerance
        pace.rest_start, pace.largest = now.time, unbalanced
        pace.slowest = pace.fastest = now.velocity
        if resting:
            return True
    if now.time > pace.lenient_from:
        pace.leniency = pace.late_leniency
    return False


@lean()
def steps(
    now: Motion, pace: Pace, rules: Rules, table: StepTable, until: float, block: Block, counts: Counts, trail: Trail
) -> tuple[int, int]:
    """Step on as long as steps come from the table.

    ``now``, ``pace``, ``block`` and ``counts`` are changed in place; no step reaches the time ``until`` [s]. ``trail``
    (step,) is filled with a record per step, whose energy leaves out the springs beyond the block. Returns the records
    filled, and why it came back.
    """
    row = 0
    while row < trail.size:
        length = min(pace.dt, pace.longest)
        i = floor(PER_OCTAVE * log2(length / rules.base)) - rules.lowest
        if i < 0 or i >= table.dt.size:
            return row, OFF_TABLE
        if table.dt[i] >= until - now.time:
            return row, LAST
        outcome = one_step(now, pace, rules, table, i, block, counts, False)
        if outcome == REJECTED:
            continue
        if outcome != ACCEPTED:
            return row, outcome
        trail[row] = now
        row += 1
        if now.force <= 0.0:
            return row, RELEASED
        if rests(now, pace, rules):
            return row, RESTING
    return row, FULL


@lean()
def creep_step(now: Motion, rules: Rules, table: StepTable, i: int, block: Block, counts: Counts) -> int:
    """Sink in under the weight alone for one step.

    Returns ACCEPTED, OUTGROWN, or REJECTED: the surface would flow further in this step than the
    contact may spread.
    """
    look_ahead(table, i, block, counts)
    weight = rules.mass * rules.gravity
    wanted = weight * table.compliance[i]
    reach = block.reach
    approach = reach[0]
    loaded = 0
    for j in range(reach.size):
        loaded += block.load[j] != 0.0
    for j in range(1, min(loaded + 1, reach.size)):
        approach = max(approach, reach[j])
    for _ in range(_NEWTON_LIMIT):
        scaled, slope = force(block, approach)
        if slope <= 0.0:
            return REJECTED
        change = (scaled - wanted) / slope
        approach -= change
        counts.newton_iterations += 1
        if abs(change) <= _NEWTON_TOLERANCE * abs(approach - reach[0]):
            break
    if approach >= reach[reach.size - 2]:
        return OUTGROWN
    if not _move_on(now, rules, table, i, block, approach):
        return REJECTED
    sag = 0.0 if rules.plate_mass == 0.0 else weight / rules.plate_stiffness
    now.velocity = (approach + sag - now.position) / table.dt[i]
    now.position, now.force, now.acceleration = approach + sag, weight, 0.0
    now.plate_displacement, now.plate_velocity, now.plate_acceleration = sag, 0.0, 0.0
    counts.solver_steps += 1
    counts.rest_steps += 1
    return ACCEPTED

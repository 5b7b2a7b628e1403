"""Steps of a contact between sphere and flat, spring by spring, compiled.

Motion: average acceleration (Newmark), so that the change of kinetic and potential energy is the
trapezoid of force times displacement to rounding, at any step length. The only unknown of a step is
the approach; the force is a convex, increasing function of it, so that Newton's method cannot fail.
Error control: ``dt^3 a''/12``, the error of a step in velocity, against the speed of this bounce.
The load of each spring is linear in a step, for which the memory is exact at any length.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean
from labpipe.contact.impact._records import Counts, Motion, Trail

# How steps end.
ACCEPTED, REJECTED, OUTGROWN, ANNULAR, LIFTED, RELEASED, ENDED, RESTING, FULL = range(9)
# The step grows and shrinks by at most these factors; the safety factor is on the step length.
_GROWTH, _SHRINK, _SAFETY = 2.0, 0.3, 0.9
_NEWTON_LIMIT, _HALVINGS = 60, 60
# Newton converges quadratically: one more evaluation after this relative change is exact.
_NEWTON_TOLERANCE = 1e-8
# A load that is linear in time rings from step to step when the step is long against the fastest
# relaxation. Where one step would leave more than this part of the ringing, a share of the load's
# change is put at the start of the step, which damps it to this part.
MOST_RINGING = 0.6
_FAST = {"reassoc", "contract", "nsz"}


class Pace(Protocol):
    """Length of the next step, and the extremes of the current period for the test of rest.

    Steps may err by ``leniency`` times more, ``late_leniency`` after ``lenient_from``.
    """

    dt: float
    longest: float
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
    """Numbers that stay the same during a contact; ``allowed`` [m/s] is the error of a step.

    The numbers of the plate are 0 on a rigid flat.
    """

    mass: float
    gravity: float
    instantaneous: float
    fluidity: float
    allowed: float
    rest_tolerance: float
    rest_period: float
    rest_speed: float
    plate_speed: float
    plate_mass: float
    plate_stiffness: float
    plate_damping: float


class Block(NamedTuple):
    """Springs, their state, and room to work in.

    (spring,): ``gap`` to ``last_weight``, ``load`` to ``new_displacement``; ``total`` and ``moments``
    (spring + 1,) are running sums of the weights and of weight times reach, the approach that
    would leave each spring unloaded. ``memory`` (element, spring) [m], ``inverse`` (element,) [Pa] half of
    ``1/C``; ``C`` and ``tau`` (term,); the last four (element,) are the weights of the step at hand.
    """

    gap: Floats
    weight: Floats
    position: Floats
    last_weight: Floats
    total: Floats
    edge_bias: float
    C: Floats
    tau: Floats
    inverse: Floats
    memory: Floats
    load: Floats
    displacement: Floats
    reach: Floats
    moments: Floats
    new_load: Floats
    new_displacement: Floats
    decay: Floats
    dwell: Floats
    old: Floats
    new: Floats


class Weights(NamedTuple):
    """Sums over the elements for a step of length ``dt``.

    ``jump`` is the share of the change of load that is put at the start; the integrals are those of
    the displacement over the step per old and new load.
    """

    dt: float
    compliance: float
    old_total: float
    jump: float
    old_integral: float
    new_integral: float
    jump_compliance: float


@lean()
def weigh(rules: Rules, block: Block, dt: float) -> Weights:
    """Weights of a step of length ``dt`` [s]: those of the elements go to the block."""
    terms = block.C.size
    whole = 0.5 * dt * (rules.instantaneous + block.C.sum())
    old_integral = new_integral = whole
    old_total, new_total = 0.0, rules.instantaneous
    for k in range(terms):
        x = dt / block.tau[k]
        loss = -math.expm1(-x)
        if x < 0.05:
            share = 1.0 / 40320.0
            for divisor in (-5040.0, 720.0, -120.0, 24.0, -6.0, 2.0):
                share = share * x + 1.0 / divisor
            share *= x
        else:
            share = 1.0 - loss / x
        block.decay[k], block.dwell[k] = math.exp(-x), block.tau[k] * loss
        block.old[k], block.new[k] = block.C[k] * (loss - share), block.C[k] * share
        old_integral -= block.old[k] * block.tau[k]
        new_integral -= block.new[k] * block.tau[k]
    if rules.fluidity > 0.0:
        block.decay[terms], block.dwell[terms] = 1.0, dt
        block.old[terms] = block.new[terms] = 0.5 * rules.fluidity * dt
        old_integral += rules.fluidity * dt * dt / 3.0
        new_integral += rules.fluidity * dt * dt / 6.0
    for k in range(block.decay.size):
        old_total += block.old[k]
        new_total += block.new[k]
    jump = max(old_total - MOST_RINGING * new_total, 0.0) / max(old_total * (1.0 + MOST_RINGING), 1e-300)
    for k in range(block.decay.size):
        block.new[k] += jump * block.old[k]
        block.old[k] *= 1.0 - jump
    return Weights(
        dt,
        new_total + jump * old_total,
        (1.0 - jump) * old_total,
        jump,
        (1.0 - jump) * old_integral,
        new_integral + jump * old_integral,
        0.5 * rules.instantaneous * jump**2,
    )


@inner()
def _edge(block: Block, last: int, approach: float) -> float:
    """Where between two springs the load, linear in the square of the radius, is zero."""
    start = block.reach[last]
    fraction = (approach - start) / (block.reach[last + 1] - start)
    square, beyond = block.position[last] ** 2, block.position[last + 1] ** 2
    return math.sqrt(square + fraction * (beyond - square))


@lean()
def force(block: Block, approach: float) -> tuple[float, float]:
    """Force and its slope, both times the step compliance, at an approach [m] below the last reach."""
    count = np.searchsorted(block.reach, approach)
    if count == 0:
        return 0.0, 0.0
    if not math.isnan(block.edge_bias):
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

    An advancing edge meets springs that were free until now: the surface outside, continued inwards,
    gives the edge; behind it the surface has a kink. A receding edge lies between its neighbours. Rings
    give the place between two of them only, and its bias.
    """
    count = np.searchsorted(block.reach, approach)
    if count == 0:
        return 0.0
    between = _edge(block, count - 1, approach)
    if not math.isnan(block.edge_bias):
        return max(between - block.edge_bias, 0.0)
    if count + 1 >= block.reach.size:
        return between
    square, beyond = block.position[count] ** 2, block.position[count + 1] ** 2
    slope = (block.reach[count + 1] - block.reach[count]) / (beyond - square)
    return math.sqrt(max(square - (block.reach[count] - approach) / slope, between**2))


@inner(fastmath=_FAST)
def _look_ahead(weights: Weights, block: Block, counts: Counts) -> None:
    """Fill the reach of each spring at the end of a step, and its running moment."""
    reach, memory = block.reach, block.memory
    n = reach.size
    for j in range(n):
        reach[j] = block.gap[j] + weights.old_total * block.load[j]
    for k in range(memory.shape[0]):
        kept = block.decay[k]
        for j in range(n):
            reach[j] += kept * memory[k, j]
    for j in range(n):
        block.moments[j + 1] = block.moments[j] + block.weight[j] * reach[j]
    counts.kernel_products += 1
    counts.spring_updates += memory.size


@inner(fastmath=_FAST)
def _move_on(now: Motion, rules: Rules, weights: Weights, block: Block, approach: float) -> bool:
    """Bring springs, memory and ledger to the end of a step; false unless the inner ones carry.

    The work on the springs is ``int q dw``, exact for the loads as they are assumed in the step.
    """
    load, new, before, after = block.load, block.new_load, block.displacement, block.new_displacement
    loaded = 0
    for j in range(load.size):
        new[j] = max(approach - block.reach[j], 0.0) / weights.compliance
        loaded += new[j] > 0.0
        after[j] = block.reach[j] - block.gap[j] + weights.compliance * new[j]
    if loaded != np.searchsorted(block.reach, approach):
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
    dwelt, held, memory = 0.0, 0.0, block.memory
    for k in range(memory.shape[0]):
        kept, early, late = block.decay[k], block.old[k], block.new[k]
        moved, stored = 0.0, 0.0
        for j in range(load.size):
            w = memory[k, j]
            moved += block.weight[j] * (new[j] - load[j]) * w
            w = kept * w + early * load[j] + late * new[j]
            memory[k, j] = w
            stored += block.weight[j] * w * w
        dwelt += block.dwell[k] * moved
        held += block.inverse[k] * stored
    integral = dwelt + weights.old_integral * on_old + weights.new_integral * on_new
    work -= (1.0 - weights.jump) * integral / weights.dt
    now.spring_work += work - weights.jump * jumped - weights.jump_compliance * (on_new - on_old)
    now.stored = held + 0.5 * rules.instantaneous * squared
    now.contact_radius = contact_radius(block, approach)
    now.approach = approach
    now.time += weights.dt
    for j in range(load.size):
        load[j], before[j] = new[j], after[j]
    return True


@inner()
def _free_plate(now: Motion, rules: Rules, dt: float) -> tuple[float, float, float]:
    """Displacement without the part of the new acceleration, that acceleration, and force per acceleration.

    Of ``m u'' + c u' + k u = F``, without F. The acceleration is solved for, not the displacement: no
    digit is lost in a short step.
    """
    quarter = 0.25 * dt * dt
    half_way = now.plate_velocity + 0.5 * dt * now.plate_acceleration
    reached = now.plate_displacement + dt * now.plate_velocity + quarter * now.plate_acceleration
    inertia = rules.plate_mass + 0.5 * dt * rules.plate_damping + quarter * rules.plate_stiffness
    pull = rules.plate_damping * half_way + rules.plate_stiffness * reached
    return reached, -pull / inertia, inertia


@inner()
def _free_motion(now: Motion, rules: Rules, dt: float) -> tuple[float, float, float, float]:
    """Position of the sphere, and of the plate, after a step without force; answers to a unit force."""
    quarter = 0.25 * dt * dt
    position = now.position + dt * now.velocity + quarter * (now.acceleration + rules.gravity)
    answer = quarter / rules.mass
    if rules.plate_mass == 0.0:
        return position, answer, 0.0, 0.0
    reached, acceleration, inertia = _free_plate(now, rules, dt)
    return position, answer, reached + quarter * acceleration, quarter / inertia


@inner()
def _move_plate(now: Motion, rules: Rules, dt: float, push: float) -> None:
    """Bring the plate to the end of a step, and count the loss of its dashpot."""
    reached, free, inertia = _free_plate(now, rules, dt)
    acceleration = free + push / inertia
    mean = now.plate_velocity + 0.25 * dt * (now.plate_acceleration + acceleration)
    now.plate_loss += rules.plate_damping * mean**2 * dt
    now.plate_displacement = reached + 0.25 * dt * dt * acceleration
    now.plate_velocity += 0.5 * dt * (now.plate_acceleration + acceleration)
    now.plate_acceleration = acceleration


@inner()
def _time_to_lift_off(now: Motion, rules: Rules, block: Block, longest: float) -> float:
    """Time in s until the last spring, at the centre, lets go."""
    low, high = 0.0, longest
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        weights = weigh(rules, block, middle)
        free, _, plate, _ = _free_motion(now, rules, middle)
        past = weights.old_total * block.load[0]
        for k in range(block.decay.size):
            past += block.decay[k] * block.memory[k, 0]
        if free - plate - block.gap[0] > past:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inner()
def _balance(block: Block, counts: Counts, approach: float, stiffness: float, target: float, load: float) -> float:
    """Approach at which the springs carry a load and a spring that pulls to a target; NaN where none carries.

    By Newton's method; the load, and the ``stiffness`` of the spring, are times the step compliance.
    """
    for _ in range(_NEWTON_LIMIT):
        scaled, slope = force(block, approach)
        if slope + stiffness <= 0.0:
            return math.nan
        change = (scaled + stiffness * (approach - target) - load) / (slope + stiffness)
        approach -= change
        counts.newton_iterations += 1
        if abs(change) <= _NEWTON_TOLERANCE * abs(approach - block.reach[0]):
            break
    return approach


@inner()
def _one_step(now: Motion, pace: Pace, rules: Rules, dt: float, block: Block, counts: Counts, releases: bool) -> int:
    """Try one step of length ``dt`` [s]; with ``releases`` it ends where the last spring lets go.

    Returns ACCEPTED, REJECTED (the pace is shorter now), OUTGROWN, ANNULAR, or LIFTED: the contact
    ends inside the step.
    """
    weights = weigh(rules, block, dt)
    free, answer, plate, plate_answer = _free_motion(now, rules, dt)
    target, total = free - plate, answer + plate_answer
    _look_ahead(weights, block, counts)
    approach, push = target, 0.0
    if releases:
        approach = min(target, block.reach[0])  # rounding must not leave a trace of contact
    elif target > block.reach[0]:
        approach = _balance(block, counts, target - total * now.force, weights.compliance / total, target, 0.0)
        push = force(block, approach)[0] / weights.compliance
        approach = target - total * push
    if approach >= block.reach[block.reach.size - 2]:
        return OUTGROWN
    if push <= 0.0 and block.load[0] > 0.0 and not releases:
        return LIFTED
    acceleration = rules.gravity - push / rules.mass
    curvature = (acceleration - now.acceleration) / dt
    if pace.dt_before > 0.0:
        curvature -= (now.acceleration - pace.acceleration_before) / pace.dt_before
    curvature = abs(curvature) * 2.0 / (dt + pace.dt_before)
    error = dt**3 * curvature / (12.0 * pace.leniency * rules.allowed)
    if error > 1.0:
        counts.rejected_steps += 1
        pace.dt = dt * max(_SHRINK, _SAFETY * error ** (-1.0 / 3.0))
        return REJECTED
    if not _move_on(now, rules, weights, block, approach):
        return ANNULAR
    if rules.plate_mass > 0.0:
        _move_plate(now, rules, dt, push)
    pace.acceleration_before, pace.dt_before = now.acceleration, dt
    now.velocity += 0.5 * dt * (now.acceleration + acceleration)
    now.acceleration, now.force, now.position = acceleration, push, free - answer * push
    counts.solver_steps += 1
    pace.dt = dt * (_GROWTH if error <= 0.0 else min(_GROWTH, _SAFETY * error ** (-1.0 / 3.0)))
    return ACCEPTED


@inner()
def _rests(now: Motion, pace: Pace, rules: Rules) -> bool:
    """Look whether speed and force swing no more than allowed for a whole period.

    Speed alone will not do: it vanishes at every turn. Its swing is taken, not its size, because a
    contact at rest still creeps.
    """
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
    now: Motion, pace: Pace, rules: Rules, until: float, block: Block, counts: Counts, trail: Trail
) -> tuple[int, int]:
    """Step on until the time ``until`` [s]; all but ``rules`` and ``until`` is changed in place.

    ``trail`` (step,) is filled with a record per step. Returns the records filled, and why it came back.
    """
    row = 0
    while row < trail.size:
        dt = min(pace.dt, pace.longest)
        ends, releases = dt >= until - now.time, False
        dt = min(dt, until - now.time)
        outcome = _one_step(now, pace, rules, dt, block, counts, False)
        if outcome == LIFTED:
            ends, releases = False, True
            outcome = _one_step(now, pace, rules, _time_to_lift_off(now, rules, block, dt), block, counts, True)
        if outcome == REJECTED:
            continue
        if outcome != ACCEPTED:
            return row, outcome
        trail[row] = now
        row += 1
        if releases or now.force <= 0.0:
            return row, RELEASED
        if ends:
            return row, ENDED
        if _rests(now, pace, rules):
            return row, RESTING
    return row, FULL


@lean()
def creep_step(now: Motion, rules: Rules, dt: float, block: Block, counts: Counts) -> int:
    """Sink in under the weight alone for one step of ``dt`` [s].

    Returns ACCEPTED, OUTGROWN, or REJECTED: the surface would flow further in this step than the
    contact may spread.
    """
    weights = weigh(rules, block, dt)
    _look_ahead(weights, block, counts)
    weight = rules.mass * rules.gravity
    reach = block.reach
    approach, loaded = reach[0], 0
    for j in range(reach.size):
        loaded += block.load[j] != 0.0
    for j in range(1, min(loaded + 1, reach.size)):
        approach = max(approach, reach[j])
    approach = _balance(block, counts, approach, 0.0, 0.0, weight * weights.compliance)
    if approach >= reach[reach.size - 2]:
        return OUTGROWN
    if math.isnan(approach) or not _move_on(now, rules, weights, block, approach):
        return REJECTED
    sag = 0.0 if rules.plate_mass == 0.0 else weight / rules.plate_stiffness
    now.velocity = (approach + sag - now.position) / dt
    now.position, now.force, now.acceleration = approach + sag, weight, 0.0
    now.plate_displacement, now.plate_velocity, now.plate_acceleration = sag, 0.0, 0.0
    counts.solver_steps += 1
    counts.rest_steps += 1
    return ACCEPTED

"""The plain steps of :mod:`._bounce`, compiled: many of them without Python between.

A step here is, line by line, what ``Stepper`` does with numpy, and the two are tested against each
other. Whatever is not a plain step is handed back to numpy before anything has changed: lift-off,
the end of time, a contact that outgrows its springs, a step off the ladder.
"""

from math import floor, log2, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from labpipe.contact.impact._rungs import Ladder
from labpipe.contact.memory import Array

# Why the loop came back.
HAND_OVER, BUFFER_FULL, RESTING = range(3)
# Places in the vector of the state.
TIME, POSITION, VELOCITY, ACCELERATION, APPROACH, FORCE, WORK = range(7)
BEFORE, DT_BEFORE, DT, LENIENCY = range(7, 11)
REST_START, SLOWEST, FASTEST, LARGEST = range(11, 15)
PLATE, PLATE_VELOCITY, PLATE_ACCELERATION, PLATE_LOSS = range(15, 19)
N_STATE = 19
# Places in the vector of counts.
STEPS, REJECTED, NEWTON, PRODUCTS = range(4)
# Columns of the buffer of records: those of ``Record``, the plate's state as three.
N_RECORD = 12


class Table(NamedTuple):
    """Weights of every step length on the ladder, by rung (rung,) or (rung, element)."""

    lowest: int
    decay: Array
    dwell: Array
    old: Array
    new: Array
    scalars: Array


def tabulate(ladder: Ladder, lowest: int, top: int) -> Table:
    """Put the rungs from ``lowest`` to ``top`` into arrays."""
    rungs = [ladder.at(i) for i in range(lowest, top + 1)]
    scalars = [
        (
            *(rung.weights.dt, rung.weights.compliance, rung.weights.old_total, rung.jump),
            *(rung.old_integral, rung.new_integral, rung.jump_compliance),
        )
        for rung in rungs
    ]
    return Table(
        lowest,
        np.array([rung.rows[0] for rung in rungs]),
        np.array([rung.rows[1] for rung in rungs]),
        np.array([rung.pair[:, 0] for rung in rungs]),
        np.array([rung.pair[:, 1] for rung in rungs]),
        np.array(scalars),
    )


class Line(NamedTuple):
    """The springs of a contact as plain arrays (spring,)."""

    gap: Array
    weight: Array
    position: Array
    inner: Array
    total: Array
    is_cut: bool
    edge_bias: float


class Rules(NamedTuple):
    """Numbers that stay the same during a contact."""

    mass: float
    gravity: float
    instantaneous: float
    until: float
    base: float
    rungs: float
    longest: float
    allowed: float
    late_leniency: float
    lenient_from: float
    growth: float
    shrink: float
    safety: float
    newton_limit: int
    newton_tolerance: float
    rest_tolerance: float
    rest_period: float
    rest_speed: float
    plate_mass: float
    plate_stiffness: float
    plate_damping: float


class Step(NamedTuple):
    """A step within the tolerance; its rung is -1 where there is none."""

    rung: int
    approach: float
    force: float
    error: float
    position: float
    plate: float


@njit(cache=True)
def _edge(line: Line, last: int, approach: float, reach: Array) -> float:
    start = reach[last]
    fraction = (approach - start) / (reach[last + 1] - start)
    inner, outer = line.position[last] ** 2, line.position[last + 1] ** 2
    return sqrt(inner + fraction * (outer - inner))


@njit(cache=True)
def _force(line: Line, approach: float, reach: Array, moments: Array) -> tuple[float, float]:
    """Force and slope times the compliance; the approach lies below the last reach."""
    count = int(np.searchsorted(reach, approach))
    if count == 0:
        return 0.0, 0.0
    if not line.is_cut:
        return approach * line.total[count] - moments[count], line.total[count]
    last = count - 1
    excess = approach - reach[last]
    x = line.position[last]
    edge = x if count == reach.size else _edge(line, last, approach, reach)
    partial = 0.0
    if edge + x > 0.0:
        partial = 2.0 * (edge - x) * (2.0 * edge + x) / (3.0 * (edge + x))
    inside = approach * line.total[last] - moments[last]
    return inside + excess * (line.inner[last] + partial), 2.0 * edge


@njit(cache=True)
def _radius(line: Line, approach: float, reach: Array) -> float:
    count = int(np.searchsorted(reach, approach))
    if count == 0:
        return 0.0
    between = _edge(line, count - 1, approach, reach)
    if not line.is_cut:
        return max(between - line.edge_bias, 0.0)
    if count + 1 >= reach.size:
        return between
    square, beyond = line.position[count] ** 2, line.position[count + 1] ** 2
    slope = (reach[count + 1] - reach[count]) / (beyond - square)
    return sqrt(max(square - (reach[count] - approach) / slope, between**2))


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def _look_ahead(
    ladder: Table, rung: int, line: Line, block: Array, load: Array, reach: Array, moments: Array
) -> None:
    """Fill the approach that would leave each spring unloaded, and its running moment."""
    n = load.size
    old_total = ladder.scalars[rung, 2]
    for j in range(n):
        reach[j] = line.gap[j] + old_total * load[j]
    for k in range(block.shape[0]):
        kept = ladder.decay[rung, k]
        for j in range(n):
            reach[j] += kept * block[k, j]
    for j in range(n):
        moments[j + 1] = moments[j] + line.weight[j] * reach[j]


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def _remember(
    ladder: Table, rung: int, line: Line, block: Array, load: Array, new: Array, inverse: Array
) -> tuple[float, float]:
    """Update the memory; return its weighted dwell on the change of load, and its energy."""
    dwelt, held = 0.0, 0.0
    n = load.size
    for k in range(block.shape[0]):
        kept, dwell = ladder.decay[rung, k], ladder.dwell[rung, k]
        early, late = ladder.old[rung, k], ladder.new[rung, k]
        moved, squared = 0.0, 0.0
        for j in range(n):
            w = block[k, j]
            moved += line.weight[j] * (new[j] - load[j]) * w
            w = kept * w + early * load[j] + late * new[j]
            block[k, j] = w
            squared += line.weight[j] * w * w
        dwelt += dwell * moved
        held += inverse[k] * squared
    return dwelt, held


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def _sums(line: Line, load: Array, new: Array, before: Array, after: Array) -> Array:
    """Weighted sums over springs that the ledger needs."""
    result = np.zeros(6)
    for j in range(load.size):
        weight = line.weight[j]
        change = weight * (new[j] - load[j])
        result[0] += weight * new[j] * after[j]
        result[1] += weight * load[j] * before[j]
        result[2] += change * before[j]
        result[3] += change * load[j]
        result[4] += change * new[j]
        result[5] += weight * new[j] * new[j]
    return result


@njit(cache=True)
def _is_resting(state: Array, rules: Rules) -> bool:
    unbalanced = abs(state[FORCE] / (rules.mass * rules.gravity) - 1.0)
    unbalanced = max(unbalanced, abs(state[PLATE_VELOCITY]) / rules.rest_speed)
    state[SLOWEST] = min(state[SLOWEST], state[VELOCITY])
    state[FASTEST] = max(state[FASTEST], state[VELOCITY])
    state[LARGEST] = max(state[LARGEST], unbalanced)
    if state[TIME] - state[REST_START] < rules.rest_period:
        return False
    swing = 0.5 * (state[FASTEST] - state[SLOWEST]) / rules.rest_speed
    resting = max(state[LARGEST], swing) < rules.rest_tolerance
    state[REST_START], state[LARGEST] = state[TIME], unbalanced
    state[SLOWEST] = state[FASTEST] = state[VELOCITY]
    return resting


@njit(cache=True)
def _solve(
    line: Line,
    target: float,
    answer: float,
    compliance: float,
    force: float,
    reach: Array,
    moments: Array,
    rules: Rules,
    counts: NDArray[np.int64],
) -> tuple[float, float]:
    """Newton for the approach; a convex, increasing equation. Returns approach and force."""
    softness = answer / compliance
    approach = target - answer * force
    for _ in range(rules.newton_limit):
        scaled, slope = _force(line, approach, reach, moments)
        change = (approach - target + softness * scaled) / (1.0 + softness * slope)
        approach -= change
        counts[NEWTON] += 1
        if abs(change) <= rules.newton_tolerance * abs(approach - reach[0]):
            break
    force = _force(line, approach, reach, moments)[0] / compliance
    return target - answer * force, force


@njit(cache=True)
def _error(state: Array, rules: Rules, acceleration: float, dt: float) -> float:
    """Error in velocity of a trial step over what is allowed."""
    slope = (acceleration - state[ACCELERATION]) / dt
    earlier = 0.0
    if state[DT_BEFORE] > 0.0:
        earlier = (state[ACCELERATION] - state[BEFORE]) / state[DT_BEFORE]
    curvature = abs(slope - earlier) * 2.0 / (dt + state[DT_BEFORE])
    return dt**3 * curvature / (12.0 * state[LENIENCY] * rules.allowed)


@njit(cache=True)
def _free_plate(state: Array, rules: Rules, dt: float) -> tuple[float, float]:
    """Where the plate would be after a step without force, and its answer to one (``Plate``)."""
    if rules.plate_mass == 0.0:
        return 0.0, 0.0
    inertia = 4.0 * rules.plate_mass / dt**2
    drag = 2.0 * rules.plate_damping / dt
    effective = inertia + drag + rules.plate_stiffness
    push = (
        inertia * (state[PLATE] + dt * state[PLATE_VELOCITY])
        + rules.plate_mass * state[PLATE_ACCELERATION]
        + drag * state[PLATE]
        + rules.plate_damping * state[PLATE_VELOCITY]
    )
    return push / effective, 1.0 / effective


@njit(cache=True)
def _move_plate(state: Array, rules: Rules, dt: float, displacement: float, force: float) -> None:
    """Bring the plate to the end of a step, and count what its dashpot took."""
    if rules.plate_mass == 0.0:
        return
    moved = displacement - state[PLATE]
    velocity = 2.0 * moved / dt - state[PLATE_VELOCITY]
    pull = rules.plate_damping * velocity + rules.plate_stiffness * displacement
    state[PLATE_LOSS] += rules.plate_damping * moved**2 / dt
    state[PLATE], state[PLATE_VELOCITY] = displacement, velocity
    state[PLATE_ACCELERATION] = (force - pull) / rules.plate_mass


@njit(cache=True)
def _trial(
    state: Array,
    counts: NDArray[np.int64],
    rules: Rules,
    ladder: Table,
    line: Line,
    block: Array,
    load: Array,
    reach: Array,
    moments: Array,
) -> Step:
    """Find a step within the tolerance, or hand over."""
    nothing = Step(-1, 0.0, 0.0, 0.0, 0.0, 0.0)
    while True:
        length = min(state[DT], rules.longest)
        rung = floor(rules.rungs * log2(length / rules.base)) - ladder.lowest
        if rung < 0 or rung >= ladder.decay.shape[0]:
            return nothing
        dt = ladder.scalars[rung, 0]
        if dt >= rules.until - state[TIME]:
            return nothing
        quarter = 0.25 * dt * dt
        free = state[POSITION] + dt * state[VELOCITY]
        free += quarter * (state[ACCELERATION] + rules.gravity)
        answer = quarter / rules.mass
        plate, plate_answer = _free_plate(state, rules, dt)
        target, total = free - plate, answer + plate_answer
        _look_ahead(ladder, rung, line, block, load, reach, moments)
        counts[PRODUCTS] += 1
        if target <= reach[0]:
            return nothing
        approach, force = _solve(
            line,
            target,
            total,
            ladder.scalars[rung, 1],
            state[FORCE],
            reach,
            moments,
            rules,
            counts,
        )
        if force <= 0.0 or approach >= reach[load.size - 2]:
            return nothing
        error = _error(state, rules, rules.gravity - force / rules.mass, dt)
        if error <= 1.0:
            position = free - answer * force
            return Step(rung, approach, force, error, position, plate + plate_answer * force)
        counts[REJECTED] += 1
        state[DT] = dt * max(rules.shrink, rules.safety * error ** (-1.0 / 3.0))


@njit(cache=True)
def _loads(
    line: Line, approach: float, compliance: float, reach: Array, new: Array, after: Array
) -> bool:
    """Fill loads and displacements at the end of a step; false unless the inner ones carry."""
    loaded = 0
    for j in range(reach.size):
        new[j] = max(approach - reach[j], 0.0) / compliance
        loaded += new[j] > 0.0
        after[j] = reach[j] - line.gap[j] + compliance * new[j]
    return loaded == np.searchsorted(reach, approach)


@njit(cache=True)
def plain_steps(
    state: Array,
    counts: NDArray[np.int64],
    rules: Rules,
    ladder: Table,
    line: Line,
    block: Array,
    load: Array,
    displacement: Array,
    inverse: Array,
    records: Array,
) -> tuple[int, int]:
    """Step on as long as steps are plain.

    Parameters
    ----------
    state, counts : array
        Changed in place; see the places above.
    rules, ladder, line
        What does not change.
    block : array (element, spring) [m]
        Memory, changed in place.
    load, displacement : array (spring,)
        Of each spring at the last step, changed in place.
    inverse : array (element,) [Pa]
        Half of ``1/C``.
    records : array (step, 12)
        Filled with one row per step; its energy leaves out the springs beyond the block.

    Returns
    -------
    (int, int)
        Rows filled, and why it came back.
    """
    n = load.size
    reach, new, after, moments = np.empty(n), np.empty(n), np.empty(n), np.zeros(n + 1)
    for row in range(records.shape[0]):
        step = _trial(state, counts, rules, ladder, line, block, load, reach, moments)
        rung, approach, force = step.rung, step.approach, step.force
        if rung < 0 or not _loads(line, approach, ladder.scalars[rung, 1], reach, new, after):
            return row, HAND_OVER
        dt, _, _, jump, early, late, jumped = ladder.scalars[rung]
        acceleration = rules.gravity - force / rules.mass
        state[BEFORE], state[DT_BEFORE] = state[ACCELERATION], dt
        state[VELOCITY] += 0.5 * dt * (state[ACCELERATION] + acceleration)
        state[ACCELERATION], state[FORCE] = acceleration, force
        _move_plate(state, rules, dt, step.plate, force)
        sums = _sums(line, load, new, displacement, after)
        dwelt, held = _remember(ladder, rung, line, block, load, new, inverse)
        integral = dwelt + early * sums[3] + late * sums[4]
        work = sums[0] - sums[1] - (1.0 - jump) * integral / dt
        state[WORK] += work - jump * sums[2] - jumped * (sums[4] - sums[3])
        load[:] = new
        displacement[:] = after
        state[TIME] += dt
        state[POSITION] = step.position
        state[APPROACH] = approach
        counts[STEPS] += 1
        records[row, :] = (
            state[TIME],
            step.position,
            state[VELOCITY],
            approach,
            force,
            _radius(line, approach, reach),
            held + 0.5 * rules.instantaneous * sums[5],
            state[WORK],
            state[PLATE],
            state[PLATE_VELOCITY],
            state[PLATE_ACCELERATION],
            state[PLATE_LOSS],
        )
        factor = rules.growth
        if step.error > 0.0:
            factor = min(factor, rules.safety * step.error ** (-1.0 / 3.0))
        state[DT] = dt * factor
        if _is_resting(state, rules):
            return row + 1, RESTING
        if state[TIME] > rules.lenient_from:
            state[LENIENCY] = rules.late_leniency
    return records.shape[0], BUFFER_FULL

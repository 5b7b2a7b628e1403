"""Steps in time of a bed of springs, compiled: under a prescribed displacement or force, or under a falling sphere.

Inside a step the load of each spring is taken linear, for which its memory is exact at any length (:mod:`._memory`);
what is left is the curvature of the load in time. It is controlled by doing every step once whole and once in two
halves: the halves are kept, and the difference is the error. Halves of linear load alone never forget an error made
while the force was much larger: they ring. Blending the second half with the whole step, 2:1, is the analogue of
TR-BDF2 for an exact memory: second order, and what rings is damped out in one step. It is the same as a load that is
linear in each half through a middle value.

Bodies that move do so by average acceleration (Newmark) in the whole step and in both halves, blended the same way. The
approach at the end is then the only unknown of a step: the free approach less the answer to the force.

A history is linear between its samples; two samples at one time are a jump. The error of a step is of third order and
what all steps leave of second, so that the share of it that is allowed goes with the power 3/2 of ``rtol``.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean
from labpipe.contact._memory import Creep, Elements
from labpipe.contact._springs import NOT_NESTED, OUTGROWN, SpringBed, balance, press
from labpipe.errors import InputError

Control = Literal["displacement", "force"]

DISPLACEMENT, FORCE, INERTIA = range(3)
# How steps end, besides NOT_NESTED and OUTGROWN.
DONE, TOO_MANY, RELEASED, RESTING, FULL = range(5)
#: Margin of the factor on a step that would just meet the tolerance, and its bounds.
MARGIN, SHRINK, GROW = 0.85, 0.1, 4.0
_MAX_STEPS_PER_INTERVAL = 20_000
#: A contact ends where its force has fallen to this part of its largest.
AT_LIFT_OFF = 1e-11
# No step is shorter than this part of the longest: a contact that still looks as if it were not nested is not.
_SHORTEST = 1e-12
# One that has lasted longer than the period at rest only rings down: its steps may err more.
_LENIENCY = 8.0
# Difference allowed in a step over rtol^(3/2): the returned error is 0.03 to 0.24 of the power 2/3
# of the difference, measured on ramps, holds, oscillations and tapping of four materials.
_STEP_SHARE = 8.0
_FAST = {"reassoc", "contract", "nsz"}  # sums in any order


class Room(NamedTuple):
    """State of the springs, and room for a step.

    (spring,): ``load`` [Pa], ``whole``, ``middle`` and ``end`` loads of a step, ``past`` and its successors the
    displacements that touch each spring then; (element, spring): ``memory`` [m]; (3, element): weights of the memory,
    and of the old and the new load; (6,): displacement, velocity and acceleration of sphere and plate.
    """

    load: Floats
    memory: Floats
    halfway: Floats
    whole: Floats
    middle: Floats
    end: Floats
    past: Floats
    past_half: Floats
    past_end: Floats
    one: Floats
    half: Floats
    start_motion: Floats
    whole_motion: Floats
    half_motion: Floats
    end_motion: Floats


def room_for(n_springs: int, n_elements: int) -> Room:
    """Springs that never carried a load, and room for their steps."""
    memories = np.zeros((2, n_elements, n_springs))
    rows, weights, motions = np.zeros((7, n_springs)), np.zeros((2, 3, n_elements)), np.zeros((4, 6))
    return Room(rows[0], *memories, *rows[1:], *weights, *motions)


class Springs(NamedTuple):
    """A bed of springs, their material, and their state."""

    bed: SpringBed
    law: Elements
    room: Room


class Body(NamedTuple):
    """What falls onto what; the plate's numbers are 0 on a rigid flat."""

    mass: float = 0.0
    gravity: float = 0.0
    plate_mass: float = 0.0
    plate_stiffness: float = 0.0
    plate_damping: float = 0.0


class Rules(NamedTuple):
    """Numbers that stay the same during a contact: error [m/s] allowed in a step; when a body is at rest."""

    allowed: float
    longest: float
    rest_tolerance: float
    rest_period: float
    rest_speed: float


class Step(NamedTuple):
    """Outcome of a step (the springs in contact, NOT_NESTED or OUTGROWN), its error, and where it ends."""

    touched: int
    error: float
    half_way: float
    displacement: float
    force: float
    half_width: float
    compliance: float


@inner()
def means(x: float) -> tuple[float, float]:
    """Mean of exp(-x u) over u from 0 to 1, and of (1 - u) exp(-x u)."""
    if x < 0.05:
        late = 1.0 / 40320.0
        for divisor in (-5040.0, 720.0, -120.0, 24.0, -6.0, 2.0):
            late = late * x + 1.0 / divisor
        return 1.0 - x * late, late
    mean = -math.expm1(-x) / x
    return mean, (1.0 - mean) / x


@lean()
def weigh(law: Elements, dt: float, weights: Floats) -> tuple[float, float]:
    """Fill in the weights (3, element) of a step; return displacement per new load, and per old load."""
    compliance, late = law.instantaneous, 0.0
    for k in range(law.rate.size):
        mean, share = means(law.rate[k] * dt)
        weights[0, k] = math.exp(-law.rate[k] * dt)
        weights[1, k], weights[2, k] = law.flow[k] * dt * (mean - share), law.flow[k] * dt * share
        late += weights[1, k]
        compliance += weights[2, k]
    return compliance, late


@lean(fastmath=_FAST)
def look_ahead(gap: Floats, weights: Floats, late: float, memory: Floats, load: Floats, threshold: Floats) -> None:
    """Fill in the displacement (spring,) that touches each spring at the end of a step."""
    for j in range(load.size):
        threshold[j] = gap[j] + late * load[j]
    for k in range(weights.shape[1]):
        kept = weights[0, k]
        for j in range(load.size):
            threshold[j] += kept * memory[k, j]


@lean(fastmath=_FAST)
def advance(
    bed: SpringBed, law: Elements, dt: float, weights: Floats, memory: Floats, load: Floats, new: Floats, out: Floats
) -> tuple[float, float, float]:
    """Write the memory at the end of a step; return the energy then held, and the work, exact and by trapezoids.

    A load q that is linear in the step does the work ∫ q dw = [q w] − q' ∫ w dt, where rate ∫ w dt = flow ∫ q dt − [w].
    """
    held = exact = plain = swept = rises = 0.0
    for j in range(load.size):
        stiffness, rise = bed.stiffness[j], new[j] - load[j]
        swept += stiffness * rise * (load[j] + new[j])
        rises += stiffness * rise * rise
        held += 0.5 * law.instantaneous * stiffness * new[j] * new[j]
    for k in range(law.rate.size):
        kept, early, late = weights[0, k], weights[1, k], weights[2, k]
        pushed = turned = crossed = kelvin = 0.0
        for j in range(load.size):
            stiffness, rise, old = bed.stiffness[j], new[j] - load[j], memory[k, j]
            w = kept * old + early * load[j] + late * new[j]
            pushed += stiffness * (load[j] + new[j]) * (w - old)
            turned += stiffness * rise * (w + old)
            crossed += stiffness * rise * (w - old)
            kelvin += stiffness * w * w
            out[k, j] = w
        x, flow = law.rate[k] * dt, law.flow[k] * dt
        plain += 0.5 * pushed
        if x < 0.05:  # the difference of two large terms, as a series
            exact += (flow * rises - x * crossed) * (1.0 - x * x / 60.0) / 12.0
        else:
            exact += 0.5 * turned + (crossed - 0.5 * flow * swept) / x
        held += 0.5 * law.rate[k] / law.flow[k] * kelvin
    plain += 0.5 * law.instantaneous * swept
    return held, plain + exact, plain


@inner()
def move(body: Body, motion: Floats, dt: float, force: float, out: Floats) -> tuple[float, float]:
    """Fill in the motion after a step that ends under a force; return the approach then, and its answer to a force."""
    quarter = 0.25 * dt * dt
    answer = quarter / body.mass
    acceleration = body.gravity - force / body.mass
    out[0] = motion[0] + dt * motion[1] + quarter * (motion[2] + acceleration)
    out[1] = motion[1] + 0.5 * dt * (motion[2] + acceleration)
    out[2] = acceleration
    if body.plate_mass > 0.0:
        half = motion[4] + 0.5 * dt * motion[5]
        reached = motion[3] + dt * motion[4] + quarter * motion[5]
        inertia = body.plate_mass + 0.5 * dt * body.plate_damping + quarter * body.plate_stiffness
        out[5] = (force - body.plate_damping * half - body.plate_stiffness * reached) / inertia
        out[3], out[4] = reached + quarter * out[5], half + 0.5 * dt * out[5]
        answer += quarter / inertia
    return out[0] - out[3], answer


@inner()
def _solve(
    bed: SpringBed,
    threshold: Floats,
    compliance: float,
    control: int,
    goal: float,
    answer: float,
    before: float,
    load: Floats,
) -> tuple[int, float, float, float]:
    """Springs in contact, displacement, force and half width; of a body the approach without force is the goal."""
    displacement, scaled = goal, 0.0
    if control == FORCE:
        displacement, scaled = balance(bed, threshold, 0.0, 0.0, goal * compliance)
    elif control == INERTIA:
        displacement, scaled = balance(bed, threshold, compliance / answer, goal, 0.0)
    touched, force, half_width = press(bed, threshold, compliance, displacement, displacement < before, load)
    if control != DISPLACEMENT:
        force = goal if control == FORCE else max(scaled, 0.0) / compliance
    return touched, displacement, force, half_width


@inner()
def _pair(on: Springs, body: Body, control: int, dt: float, middle_goal: float, end_goal: float, before: float) -> Step:
    """Do one step whole and in two halves; the error is left to those who know what is allowed."""
    bed, law, room = on
    is_moving = control == INERTIA
    goal, answer = end_goal, 0.0
    compliance, late = weigh(law, dt, room.one)
    if is_moving:
        goal, answer = move(body, room.start_motion, dt, 0.0, room.whole_motion)
    free, whole_answer = goal, answer
    look_ahead(bed.gap, room.one, late, room.memory, room.load, room.past)
    touched, displacement, force, width = _solve(bed, room.past, compliance, control, goal, answer, before, room.whole)
    if touched < 0:
        return Step(touched, math.inf, 0.0, displacement, force, width, compliance)
    half, late = weigh(law, 0.5 * dt, room.half)
    goal = middle_goal
    if is_moving:
        goal, answer = move(body, room.start_motion, 0.5 * dt, 0.0, room.half_motion)
    look_ahead(bed.gap, room.half, late, room.memory, room.load, room.past_half)
    touched, half_way, push, width = _solve(bed, room.past_half, half, control, goal, answer, before, room.middle)
    if touched < 0:
        return Step(touched, math.inf, half_way, displacement, force, width, compliance)
    for k in range(law.rate.size):
        for j in range(bed.gap.size):
            kept = room.half[0, k] * room.memory[k, j]
            room.halfway[k, j] = kept + room.half[1, k] * room.load[j] + room.half[2, k] * room.middle[j]
    look_ahead(bed.gap, room.half, late, room.halfway, room.middle, room.past_end)
    for j in range(bed.gap.size):
        room.past_end[j] = (room.past[j] + 2.0 * room.past_end[j]) / 3.0
    blended, goal = (compliance + 2.0 * half) / 3.0, end_goal
    if is_moving:
        move(body, room.start_motion, 0.5 * dt, push, room.half_motion)
        goal, answer = move(body, room.half_motion, 0.5 * dt, 0.0, room.end_motion)
        goal, answer = (free + 2.0 * goal) / 3.0, (whole_answer + 2.0 * answer) / 3.0
    touched, reached, push, width = _solve(bed, room.past_end, blended, control, goal, answer, half_way, room.end)
    error = abs(displacement - reached)
    if is_moving and touched >= 0:
        move(body, room.start_motion, dt, force, room.whole_motion)
        alone = room.whole_motion[1]
        move(body, room.start_motion, dt, push, room.whole_motion)
        move(body, room.half_motion, 0.5 * dt, push, room.end_motion)
        end, whole = room.end_motion, room.whole_motion
        for i in range(6):
            end[i] = (whole[i] + 2.0 * end[i]) / 3.0
        end[2] = body.gravity - push / body.mass  # forces are in balance at the end
        if body.plate_mass > 0.0:
            end[5] = (push - body.plate_damping * end[4] - body.plate_stiffness * end[3]) / body.plate_mass
        error = abs(alone - end[1])
    return Step(touched, error, half_way, reached, push, width, blended)


@inner()
def _accept(on: Springs, dt: float) -> tuple[float, float, float]:
    """Bring the springs to the end of a step; return as :func:`advance` does."""
    bed, law, room = on
    for j in range(bed.gap.size):
        room.middle[j] = (room.load[j] + 4.0 * room.middle[j] + room.end[j]) / 6.0
    _, early, first = advance(bed, law, 0.5 * dt, room.half, room.memory, room.load, room.middle, room.halfway)
    held, late, second = advance(bed, law, 0.5 * dt, room.half, room.halfway, room.middle, room.end, room.memory)
    room.load[:] = room.end
    return held, early + late, first + second


@lean()
def cross(
    on: Springs,
    control: int,
    length: float,
    first: float,
    last: float,
    tolerance: float,
    scales: Floats,
    step: float,
    answer: Floats,
    counts: Any,
) -> int:
    """Cross an interval in which displacement or force goes from ``first`` to ``last`` in steps that adapt.

    ``tolerance`` is infinite for a jump. ``scales`` (3,): force and compliance to measure errors by, and the deepest
    approach so far; ``answer`` (7,) as of a March, changed in place, and the step to try next; ``counts`` (3,): steps,
    rejected ones, solutions. Returns DONE, TOO_MANY, NOT_NESTED or OUTGROWN.
    """
    bed, law, room = on
    elapsed, step = 0.0, min(step, length)
    nobody = Body(0.0, 0.0, 0.0, 0.0, 0.0)
    slope = (last - first) / length if length > 0.0 else 0.0  # a jump is one step of no length
    rigid, softest = law.instantaneous, scales[1]
    for _ in range(_MAX_STEPS_PER_INTERVAL):
        left = length - elapsed
        is_last = left <= 1.001 * step  # no sliver is left
        dt = left if is_last else step
        end_goal = last if is_last else first + slope * (elapsed + dt)
        made = _pair(on, nobody, control, dt, first + slope * (elapsed + 0.5 * dt), end_goal, answer[0])
        counts[2] += 3
        error = math.inf
        if made.touched == OUTGROWN:
            return OUTGROWN
        if made.touched == NOT_NESTED:
            # A step that is too long rings and looks like it; a profile that is not nested stays so in any step.
            if dt <= _SHORTEST * length:
                return NOT_NESTED
        else:
            # Springs that leave the contact carry no load in either solution, but differ in how far they have crept,
            # which counts as a load under slow loading.
            total = 0.0
            whole = law.instantaneous + room.one[2].sum()
            for j in range(bed.gap.size):
                crept = room.past_end[j] + (made.compliance - rigid) * room.end[j]
                crept -= room.past[j] + (whole - rigid) * room.whole[j]
                total += bed.stiffness[j] * (abs(room.whole[j] - room.end[j]) + abs(crept) / softest)
            largest = max(made.force, scales[0])
            error = total / largest if largest > 0.0 else 0.0
            if control == FORCE:
                # Against the deepest approach: without load the surface recovers towards none.
                scales[2] = max(scales[2], made.displacement)
                error = max(error, made.error / scales[2])
            error /= tolerance
        factor = MARGIN * min(max(error, 1e-12), 1e12) ** (-1.0 / 3.0)  # of third order
        if not error <= 1.0:
            counts[1] += 1
            step = dt * min(max(factor, SHRINK), MARGIN)
            continue
        counts[0] += 2
        answer[0], answer[1], answer[2] = made.displacement, made.force, made.half_width
        held, work, plain = _accept(on, dt)
        answer[3] += plain
        answer[4] += max(work - (held - answer[5]), 0.0)
        answer[5] = held
        # A step cut short by the end of the interval says nothing against the longer one.
        step = max(dt * min(max(factor, SHRINK), GROW), step if is_last else 0.0)
        if is_last:
            answer[6] = step
            return DONE
        elapsed += dt
    return TOO_MANY


@inner()
def _rests(now: Any, pace: Any, body: Body, rules: Rules) -> bool:
    """Look whether force and speed swing no more than allowed for a whole period; at rest it still creeps."""
    unbalanced = abs(now.force / (body.mass * body.gravity) - 1.0)
    unbalanced = max(unbalanced, abs(now.plate_velocity) / rules.rest_speed)
    pace.slowest = min(pace.slowest, now.velocity)
    pace.fastest = max(pace.fastest, now.velocity)
    pace.largest = max(pace.largest, unbalanced)
    if now.time - pace.rest_start < rules.rest_period:
        return False
    pace.leniency = _LENIENCY
    swing = 0.5 * (pace.fastest - pace.slowest) / rules.rest_speed
    resting = max(pace.largest, swing) < rules.rest_tolerance
    pace.rest_start, pace.largest = now.time, unbalanced
    pace.slowest = pace.fastest = now.velocity
    return resting


@lean()
def swing(
    on: Springs, body: Body, rules: Rules, until: float, now: Any, pace: Any, trail: Any, counts: Any
) -> tuple[int, int]:
    """Step a body in contact until the time ``until`` [s]; the springs, ``now`` and ``pace`` are changed in place.

    ``trail`` (step,) is filled with a record per step. Returns the records filled, and why it came back: DONE,
    RELEASED, RESTING, FULL, NOT_NESTED or OUTGROWN.
    """
    room = on.room
    row, start = 0, room.start_motion
    start[0], start[1], start[2] = now.position, now.velocity, now.acceleration
    start[3], start[4], start[5] = now.plate_displacement, now.plate_velocity, now.plate_acceleration
    while row < trail.size:
        left = until - now.time
        dt = min(pace.dt, rules.longest, left)
        ends, is_tiny = dt >= left, dt <= _SHORTEST * rules.longest
        made = _pair(on, body, INERTIA, dt, 0.0, 0.0, now.approach)
        counts[2] += 3
        if made.touched == OUTGROWN:
            return row, OUTGROWN
        if made.touched == NOT_NESTED:
            if is_tiny:
                return row, NOT_NESTED
            counts[1] += 1
            pace.dt = dt * SHRINK
            continue
        lifted = room.middle[0] <= 0.0 or room.end[0] <= 0.0
        if now.force > 0.0 and lifted and now.force > AT_LIFT_OFF * pace.peak and not is_tiny:
            # Next to where the load of the spring at the centre, which lets go last, would vanish.
            over = room.past_end[0] - made.displacement
            if room.middle[0] <= 0.0:
                over = room.past_half[0] - made.half_way
            over = max(over, 0.0) / made.compliance
            part = (0.5 if room.middle[0] <= 0.0 else 1.0) * room.load[0] / (room.load[0] + over)
            pace.dt = dt * min(max(0.98 * part, SHRINK), 0.98)
            continue
        if now.force > 0.0 and lifted:
            room.load[:] = 0.0
            now.force, now.contact_radius, now.acceleration = 0.0, 0.0, body.gravity
            if row > 0:  # at the time of the last step
                trail[row - 1] = now
            return row, RELEASED
        error = made.error / (rules.allowed * pace.leniency)
        factor = MARGIN * min(max(error, 1e-12), 1e12) ** (-1.0 / 3.0)  # of third order
        if not error <= 1.0:
            if is_tiny:
                return row, NOT_NESTED
            counts[1] += 1
            pace.dt = dt * min(max(factor, SHRINK), MARGIN)
            continue
        held, work, _ = _accept(on, dt)
        end = room.end_motion
        now.spring_work += work
        speed, halfway = (start[4], end[4]), room.half_motion[4]
        now.plate_loss += body.plate_damping * dt * (speed[0] ** 2 + 4.0 * halfway**2 + speed[1] ** 2) / 6.0
        start[:] = end
        now.position, now.velocity, now.acceleration = end[0], end[1], end[2]
        now.plate_displacement, now.plate_velocity, now.plate_acceleration = end[3], end[4], end[5]
        now.approach, now.force, now.contact_radius = end[0] - end[3], made.force, made.half_width
        now.stored, now.time = held, until if ends else now.time + dt
        pace.peak = max(pace.peak, now.force)
        pace.dt = max(dt * min(max(factor, SHRINK), GROW), pace.dt if ends else 0.0)
        counts[0] += 1
        trail[row] = now
        row += 1
        if now.force <= 0.0:
            return row, RELEASED
        if ends:
            return row, DONE
        if _rests(now, pace, body, rules):
            return row, RESTING
    return row, FULL


@dataclass(slots=True)
class March:
    """One contact, one material, one history.

    ``rtol`` is the error of force or approach over their largest values; ``limit`` the message when the contact reaches
    the end of the bed; ``answer`` (7,): displacement [m], force, contact half width [m], work of the indenter on the
    springs (trapezoids over the steps), heat of the material, exact for the load path taken, and energy held; force
    and energies per reduced modulus and unit depth of a line.
    """

    contact: SpringBed
    creep: Creep
    control: Control
    rtol: float
    limit: str
    room: Room = field(init=False)
    answer: Floats = field(default_factory=lambda: np.zeros(7))
    _counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))

    @property
    def counts(self) -> dict[str, int]:
        """Work done."""
        return dict(zip(("solver_steps", "rejected_steps", "solves"), self._counts.tolist(), strict=True))

    def run(self, time: Floats, value: Floats) -> Iterator[Floats]:
        """Yield the answer (7,) at every sample of a history of displacement [m], or force per tip (and unit depth)."""
        law, rtol = self.creep.elements, self.rtol
        self.room, self.answer[:] = room_for(self.contact.size, law.rate.size), 0.0
        springs = Springs(self.contact, law, self.room)
        control = DISPLACEMENT if self.control == "displacement" else FORCE
        softest = float(self.creep.compliance(float(time[-1] - time[0])))
        # A time below every relaxation time: a bound on the trace of the rates.
        fastest = np.inf
        if law.rate.size:
            fastest = 1.0 / (float(law.rate.max()) + float(law.flow.sum()) / self.creep.instantaneous)
        scales = np.array([0.0, softest, 1e-300])
        highest = -np.inf
        self.answer[0] = min(float(value[0]), 0.0) if control == DISPLACEMENT else 0.0
        tolerance = _STEP_SHARE * rtol**1.5 if law.rate.size else np.inf
        for n in range(time.size):
            last, before = float(value[n]), float(value[n - 1]) if n else 0.0
            length = float(time[n] - time[n - 1]) if n else 0.0
            if last > highest:  # the force that the slowest loading would show
                highest = scales[0] = last
                if control == DISPLACEMENT:
                    room = self.room.whole
                    scales[0] = press(self.contact, self.contact.gap, softest, last, False, room)[1]
            is_jump = length == 0.0
            if not (is_jump and n and last == before):
                step, allowed = float(self.answer[6]), np.inf if is_jump else tolerance
                goals = control, length, before, last, allowed, scales, step
                outcome = cross(springs, *goals, self.answer, self._counts)
                if outcome == OUTGROWN:
                    raise InputError(self.limit)
                if outcome != DONE:
                    problem = "the steps become too short"
                    if outcome == NOT_NESTED:
                        problem = (
                            "the contact stops being one that grows and shrinks about its centre, which independent "
                            "springs cannot follow"
                        )
                    raise InputError(
                        f"at {time[n]:g} s {problem}; give another rtol, more samples, or a material with more of an "
                        "instantaneous compliance"
                    )
            if is_jump:
                self.answer[6] = fastest
            yield self.answer

"""One contact of a falling sphere, from touch to lift-off or to rest, in adaptive steps.

Motion: average acceleration (Newmark), so that the change of kinetic and potential energy is the
trapezoid of force times displacement to rounding, at any step length. The only unknown of a step is
the approach; the force is a convex, increasing function of it, so that Newton's method cannot fail.
Error control: ``dt^3 a''/12``, the step's own error in velocity, against the speed of this bounce.
Step lengths come from a geometric ladder, so that the exponentials of the memory are computed once
per rung. Lift-off is located exactly: it is where the springless motion meets the central spring.

Only the springs that this contact can reach take part; the block grows when the contact does.

Plain steps are compiled (:mod:`._bounce_plain`); why, says ``ARCHITECTURE.md``. Creep
at rest has steps of its own (:mod:`._settling`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq

from labpipe.contact.impact._bounce_plain import plain_steps
from labpipe.contact.impact._bounce_step import (
    DISPLACEMENT,
    DWELL,
    FIRST,
    GROWTH,
    LONGEST,
    NEW,
    NEWTON_LIMIT,
    NEWTON_TOLERANCE,
    OLD,
    PAST,
    SAFETY,
    SHRINK,
    Pace,
    Trial,
)
from labpipe.contact.impact._motion import (
    AnnularContactError,
    Body,
    Counts,
    Record,
    Snapshot,
    Springs,
)
from labpipe.contact.impact._plate import PlateState
from labpipe.contact.impact._rest import RestTest
from labpipe.contact.impact._rungs import Ladder, Rung, rung_of
from labpipe.contact.memory import Array, Creep
from labpipe.errors import InputError

if TYPE_CHECKING:
    from labpipe.contact.impact._bounce_compiled import Table

# A plate's oscillation is followed with at least this many steps.
_STEPS_PER_PLATE_PERIOD = 40
# A contact that has lasted longer than the period at rest only rings down: its steps may err more.
_LENIENCY = 8.0
# Work that a step may take on average, in updates of one element of one spring.
_UPDATES_PER_STEP = 20_000
# Displacements in m below this are forgotten.
_FORGOTTEN = 1e-200
# A contact block that is outgrown is enlarged to this multiple of the contact radius.
_BLOCK_GROWTH = 1.3


@dataclass(slots=True)
class Stepper:
    """The state of sphere, plate and springs, and how it moves on.

    Parameters
    ----------
    creep : Creep
        Contact compliance.
    springs : Springs
        All springs; extended when the contact outgrows them.
    body : Body
        Mass, gravity, plate.
    tolerance : float
        Error in velocity of one step relative to ``speed_scale``.
    largest_radius : float [m]
        Beyond this contact radius the half-space theory is refused.
    max_steps : int
        Refuse to go on after so many steps.
    wanted : list of float [s]
        Instants, ascending, of which to keep a snapshot; steps end there.
    is_compiled : bool
        Take plain steps with :mod:`._bounce_compiled`.
    only_near : bool
        Solve for the springs that a contact can reach only.
    """

    creep: Creep
    springs: Springs
    body: Body
    tolerance: float
    time_scale: float
    speed_scale: float
    largest_radius: float
    expected_radius: float
    max_steps: int
    is_compiled: bool = False
    only_near: bool = True
    time: float = 0.0
    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    approach: float = 0.0
    force: float = 0.0
    plate: PlateState = field(default_factory=PlateState)
    spring_work: float = 0.0
    plate_loss: float = 0.0
    counts: Counts = field(default_factory=Counts)
    observe: Callable[[float], None] | None = None
    trail: list[Record] = field(default_factory=list)
    wanted: list[float] = field(default_factory=list)
    snapshots: list[Snapshot] = field(default_factory=list)
    memory: Array = field(init=False)
    block: Array = field(init=False)
    rows: Array = field(init=False)
    weighted: Array = field(init=False)
    moments: Array = field(init=False)
    gap: Array = field(init=False)
    weight: Array = field(init=False)
    inverse: Array = field(init=False)
    outer_stored: Array = field(init=False)
    outer_time: float = 0.0
    leniency: float = 1.0
    ladder: Ladder = field(init=False)
    table: "Table | None" = None
    previous: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        self.memory = self.creep.rest(self.springs.position.size)
        self.inverse = 0.5 * self.creep.inverse
        self.ladder = Ladder(self.creep, self.time_scale)

    # -- the free sphere -------------------------------------------------------------------------

    def free_stored(self) -> Array:
        """Energy (element,) in J that the unloaded springs hold now."""
        return self.inverse * ((self.memory * self.memory) @ self.springs.weight)

    def look_at_dent(self, until: float) -> None:
        """Keep the snapshots that are wanted of the free surface, up to a time [s]."""
        while self.wanted and self.wanted[0] <= until:
            time = self.wanted.pop(0)
            left = np.exp(-max(time - self.time, 0.0) * self.creep.rate)
            self.snapshots.append(Snapshot(time, np.zeros(1), left @ self.memory, 0.0))

    def fly(self, dt: float) -> None:
        """Move on without contact: ballistic, the dent and the plate relax, exactly."""
        self.look_at_dent(self.time + dt)
        gravity = self.body.gravity
        self.position += (self.velocity + 0.5 * gravity * dt) * dt
        self.velocity += gravity * dt
        self.memory *= np.exp(-dt * self.creep.rate)[:, None]
        if self.body.plate is not None:
            before = self.body.plate.energy(self.plate)
            self.plate = self.body.plate.free(self.plate, dt)
            self.plate_loss += before - self.body.plate.energy(self.plate)
        self.time += dt
        self.acceleration, self.force = gravity, 0.0
        self.approach = self.position - self.plate.displacement

    # -- one contact -----------------------------------------------------------------------------

    def touch(self, expected_radius: float, *, is_new: bool = True) -> None:
        """Begin a contact, or go on with one; springs out to the expected radius take part."""
        # What has decayed this far would only slow the processor down (subnormal numbers).
        self.memory[np.abs(self.memory) < _FORGOTTEN] = 0.0
        self.outer_time = self.time
        self.leniency = 1.0
        self._take_block(expected_radius)
        self.previous = (self.acceleration, 0.0)
        if is_new:
            self.trail.append(self._record(self._stored(0.0), 0.0))

    def take_trail(self) -> tuple[Record, ...]:
        """Return the records since the last call."""
        records = tuple(self.trail)
        self.trail.clear()
        return records

    def run(self, until: float, is_resting: RestTest) -> str:
        """Step until "lift-off", "rest" or the "end" of time."""
        pace = Pace(
            FIRST * self.time_scale,
            LONGEST * self.time_scale,
            self.time + is_resting.period,
            _LENIENCY * max(1.0, is_resting.speed / self.speed_scale),
        )
        if self.body.plate is not None:
            shortest_look = 1.0 / (_STEPS_PER_PLATE_PERIOD * self.body.plate.frequency)
            pace.longest = min(pace.longest, shortest_look)
        while True:
            stop = min([until, *self.wanted[:1]])
            if self.is_compiled and plain_steps(self, pace, stop, is_resting):
                return "rest"
            outcome = self._step(pace, stop)
            if outcome == "end" and stop < until:
                outcome = ""
            if outcome:
                self.give_back()
                return outcome
            if is_resting(self):
                return "rest"
            if self.time > pace.lenient_from:
                self.leniency = pace.leniency

    def _step(self, pace: "Pace", until: float) -> str:
        """Take one step; return how it ends the contact, or nothing."""
        while True:
            rung = self.ladder.below(min(pace.dt, pace.longest))
            remaining = until - self.time
            is_last = rung.weights.dt >= remaining
            if is_last:
                rung = rung_of(self.creep, remaining)
            trial = self._attempt(rung)
            lifted = trial.force <= 0.0
            if lifted and self.rows[OLD, 0] > 0.0:
                trial = self._at_lift_off(rung.weights.dt)
            error = self._error(trial)
            dt = trial.rung.weights.dt
            if error <= 1.0:
                break
            self.counts.rejected_steps += 1
            pace.dt = dt * max(SHRINK, SAFETY * error ** (-1 / 3))
        self._accept(trial)
        pace.dt = dt * (GROWTH if error <= 0.0 else min(GROWTH, SAFETY * error ** (-1 / 3)))
        if lifted:
            return "lift-off"
        return "end" if is_last else ""

    # -- one step --------------------------------------------------------------------------------

    def _predict(self, dt: float) -> tuple[float, float, float, float]:
        """Position and plate displacement after ``dt`` without force, and their answers to it."""
        quarter = 0.25 * dt * dt
        gravity = self.body.gravity
        position = self.position + dt * self.velocity + quarter * (self.acceleration + gravity)
        answer = quarter / self.body.mass
        if self.body.plate is None:
            return position, answer, 0.0, 0.0
        return position, answer, *self.body.plate.predict(self.plate, dt)

    def past(self, rung: Rung) -> Array:
        """Memory products of a step: the approach (spring,) that would leave each unloaded."""
        rows = self.rows
        np.matmul(rung.rows, self.block, out=rows[:2])
        reach = rung.weights.old_total * rows[OLD]
        reach += rows[PAST]
        reach += self.gap
        np.cumsum(self.weight * reach, out=self.moments[1:])
        self.counts.kernel_products += 1
        self.counts.spring_updates += self.block.size
        return reach

    def _attempt(self, rung: Rung) -> Trial:
        dt, compliance = rung.weights.dt, rung.weights.compliance
        free, answer, plate_free, plate_answer = self._predict(dt)
        target, total = free - plate_free, answer + plate_answer
        while True:
            reach = self.past(rung)
            approach, force = target, 0.0
            if target > reach.item(0):
                guess = target - total * self.force
                approach, scaled = self._solve(guess, target, total / compliance, reach)
                force = scaled / compliance
                approach = target - total * force
            if approach < reach.item(-2):
                break
            self.grow()
        position, plate = free - answer * force, self.plate
        if self.body.plate is not None:
            moved = plate_free + plate_answer * force
            plate = self.body.plate.follow(plate, dt, moved, force)
        return Trial(rung, approach, force, position, plate, reach)

    def _solve(
        self, approach: float, target: float, softness: float, reach: Array
    ) -> tuple[float, float]:
        """Newton on ``approach - target + softness * scaled_force = 0``: convex and increasing."""
        floor_value = reach.item(0)
        for _ in range(NEWTON_LIMIT):
            scaled, slope = self.springs.force(approach, reach, self.moments)
            change = (approach - target + softness * scaled) / (1.0 + softness * slope)
            approach -= change
            self.counts.newton_iterations += 1
            if abs(change) <= NEWTON_TOLERANCE * abs(approach - floor_value):
                break
        return approach, self.springs.force(approach, reach, self.moments)[0]

    def _check_nested(self, approach: float, reach: Array, load: Array) -> None:
        """Make sure that the springs in contact are the inner ones, as the force supposes."""
        if np.count_nonzero(load) != reach.searchsorted(approach):
            message = (
                f"at {self.time:.6g} s the surface would touch in a ring around the axis, which "
                "the springs of this solver cannot follow; use a smaller rtol"
            )
            raise AnnularContactError(message)

    def _error(self, trial: Trial) -> float:
        """Error in velocity of a trial step over what is allowed."""
        dt = trial.rung.weights.dt
        before, dt_before = self.previous
        acceleration = self.body.gravity - trial.force / self.body.mass
        slope = (acceleration - self.acceleration) / dt
        earlier = (self.acceleration - before) / dt_before if dt_before > 0.0 else 0.0
        curvature = abs(slope - earlier) * 2.0 / (dt + dt_before)
        allowed = self.leniency * self.tolerance * self.speed_scale
        return dt**3 * curvature / (12.0 * allowed)

    def _at_lift_off(self, longest: float) -> Trial:
        """Return the step that ends when the last spring, at the centre, lets go."""
        central, load, gap = self.block[:, 0], self.rows.item(OLD, 0), self.gap.item(0)

        def clearance(dt: float) -> float:
            if dt == 0.0:
                return self.creep.instantaneous * load
            weights = rung_of(self.creep, dt).weights
            free, _, plate, _ = self._predict(dt)
            past = float(weights.decay @ central) + weights.old_total * load
            return free - plate - gap - past

        dt = brentq(clearance, 0.0, longest, xtol=1e-15 * self.time_scale, rtol=1e-14)
        rung = rung_of(self.creep, dt)
        free, _, plate_free, _ = self._predict(dt)
        plate = self.plate
        if self.body.plate is not None:
            plate = self.body.plate.follow(plate, dt, plate_free, 0.0)
        reach = self.past(rung)
        # Rounding must not leave a trace of contact.
        approach = min(free - plate_free, reach.item(0))
        return Trial(rung, approach, 0.0, free, plate, reach)

    def _accept(self, trial: Trial) -> None:
        dt = trial.rung.weights.dt
        acceleration = self.body.gravity - trial.force / self.body.mass
        self.previous = (self.acceleration, dt)
        self.velocity += 0.5 * dt * (self.acceleration + acceleration)
        self.acceleration = acceleration
        if self.body.plate is not None:
            self.plate_loss += self.body.plate.loss(self.plate, trial.plate, dt)
        self.move_on(trial)

    def move_on(self, trial: Trial) -> None:
        """Update memory, ledger and record; what the two ways to step have in common."""
        rung, rows = trial.rung, self.rows
        compliance = rung.weights.compliance
        load = rows[NEW]
        np.subtract(trial.approach, trial.reach, out=load)
        np.maximum(load, 0.0, out=load)
        load /= compliance
        self._check_nested(trial.approach, trial.reach, load)
        np.multiply(load, self.weight, out=self.weighted[1])
        displacement = rows[DISPLACEMENT]
        before = self.weighted @ displacement
        np.multiply(load, compliance, out=displacement)
        displacement += trial.reach
        displacement -= self.gap
        self.block *= rung.weights.decay[:, None]
        self.block += rung.pair @ rows[OLD : NEW + 1]
        # One product gives every sum over springs that the ledger needs.
        sums = rows @ self.weighted.T
        self.spring_work += self._work(rung, sums, before.tolist())
        squared = sums.item(NEW, 1)
        rows[OLD] = load
        self.weighted[0] = self.weighted[1]
        self.time += rung.weights.dt
        self.position, self.approach = trial.position, trial.approach
        self.force, self.plate = trial.force, trial.plate
        radius = self.springs.contact_radius(trial.approach, trial.reach)
        self.trail.append(self._record(self._stored(squared), radius))
        self._look_at_springs(radius)
        self._count_step()

    def _look_at_springs(self, radius: float) -> None:
        """Keep a snapshot when this is the instant that is wanted."""
        # The last step before it ends there to rounding.
        if not self.wanted or self.time < self.wanted[0] * (1.0 - 1e-15) - 1e-300:
            return
        time = self.wanted.pop(0)
        load, displacement = self.rows[OLD].copy(), self.rows[DISPLACEMENT].copy()
        self.snapshots.append(Snapshot(time, load, displacement, radius))

    def _work(self, rung: Rung, sums: Array, before: list[float]) -> float:
        """Exact work ``int q dw`` on the springs in one step, for the loads inside it.

        ``before`` holds the sums of the displacements at the start with the old and new loads.
        """
        change = (sums[:, 1] - sums[:, 0]).tolist()
        integral = change[DWELL]
        integral += rung.old_integral * change[OLD] + rung.new_integral * change[NEW]
        work = sums.item(DISPLACEMENT, 1) - before[0]
        work -= (1.0 - rung.jump) * integral / rung.weights.dt
        if rung.jump > 0.0:
            work -= rung.jump * (before[1] - before[0])
            work -= rung.jump_compliance * (change[NEW] - change[OLD])
        return work

    def _count_step(self) -> None:
        self.counts.solver_steps += 1
        self.look_at_limits(self.time)

    def look_at_limits(self, time: float) -> None:
        """Refuse to go on after too much work; tell the progress otherwise."""
        counts = self.counts
        most_updates = _UPDATES_PER_STEP * self.max_steps
        if counts.solver_steps > self.max_steps or counts.spring_updates > most_updates:
            message = (
                f"{counts.solver_steps} steps of {self.gap.size} springs reached only {time:.6g} "
                "s: the material damps too little for so long a duration, or hardly has an "
                "instantaneous compliance; shorten the duration, raise max_steps or rtol"
            )
            raise InputError(message)
        if self.observe is not None:
            self.observe(time)

    def _record(self, stored: float, radius: float) -> Record:
        return Record(
            self.time,
            self.position,
            self.velocity,
            self.approach,
            self.force,
            radius,
            stored,
            self.spring_work,
            self.plate,
            self.plate_loss,
        )

    # -- the block of springs in use -------------------------------------------------------------

    def _take_block(self, radius: float) -> None:
        """Copy the springs out to a radius from all springs, adding new ones when needed."""
        if radius > self.largest_radius:
            message = (
                f"at {self.time:.6g} s the contact would be {radius:.4g} m in radius, more than "
                f"{self.largest_radius:.4g} m: beyond this the sphere is no half-space; use a "
                "stiffer material, a smaller mass or a lower drop"
            )
            raise InputError(message)
        if self.springs.position[-2] < radius:
            known = self.memory
            self.springs = self.springs.extended(radius)
            self.memory = self.creep.rest(self.springs.position.size)
            self.memory[:, : known.shape[1]] = known
        n = self.springs.position.size
        if self.only_near:
            n = min(self.springs.covering(radius) + 1, n)
        self.block = self.memory[:, :n].copy()
        self.gap = self.springs.gap[:n]
        self.weight = self.springs.weight[:n]
        self.rows = np.zeros((5, n))
        self.rows[DISPLACEMENT] = self.block.sum(axis=0)
        self.weighted = np.zeros((2, n))
        self.moments = np.zeros(n + 1)
        outer = self.memory[:, n:]
        self.outer_stored = self.inverse * ((outer * outer) @ self.springs.weight[n:])

    def give_back(self) -> None:
        """Write the block back and let the springs outside it relax up to now."""
        n = self.gap.size
        self.memory[:, :n] = self.block
        self.memory[:, n:] *= np.exp(-(self.time - self.outer_time) * self.creep.rate)[:, None]
        self.outer_time = self.time

    def grow(self) -> None:
        """Take more springs; the state of those in use stays."""
        known, weighted = self.rows, self.weighted
        self.give_back()
        n = self.gap.size
        self._take_block(_BLOCK_GROWTH * float(self.springs.position[n - 1]))
        self.rows[:, :n] = known
        self.weighted[:, :n] = weighted

    def _stored(self, squared_load: float) -> float:
        """Energy in J that all springs hold now; ``squared_load`` is summed with the weights."""
        held = float(self.inverse @ ((self.block * self.block) @ self.weight))
        held += 0.5 * self.creep.instantaneous * squared_load
        lag = self.time - self.outer_time
        if self.outer_stored.any():
            held += float(self.outer_stored @ np.exp(-2.0 * lag * self.creep.rate))
        return held

"""One contact of a falling sphere, from touch to lift-off or to rest, in adaptive steps.

Motion: average acceleration (Newmark), so that the change of kinetic and potential energy is the
trapezoid of force times displacement to rounding, at any step length. The only unknown of a step is
the approach; the force is a convex, increasing function of it, so that Newton's method cannot fail.
Error control: ``dt^3 a''/12``, the step's own error in velocity, against the speed of this bounce.
Step lengths come from a geometric ladder, so that the exponentials of the memory are computed once
per rung. Lift-off is located exactly: it is where the springless motion meets the central spring.

Only the springs that this contact can reach take part; the block grows when the contact does.

Compiled or not. A step costs 76-140 us in numpy, 8-19 us compiled (measured one after the other in
one process on a busy machine, 5 000 to 66 000 steps: 7 to 13 times less; the answers differ by
1e-14). Importing numba takes 0.2-0.4 s, loading the cached code 0.3-0.6 s, compiling it once per
installation 10-14 s. So a train of bounces gains even when nothing else in the process needs numba,
a sweep or a fit by an order of magnitude: plain steps are compiled by default.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from math import floor, log2
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import brentq

from labpipe.contact.compilation import said
from labpipe.contact.memory import Array, Creep
from labpipe.contact.motion import AnnularContactError, Body, Counts, Record, Snapshot, Springs
from labpipe.contact.plate import PlateState
from labpipe.contact.rest import RestTest
from labpipe.contact.rungs import RUNGS, Ladder, Rung, rung_of
from labpipe.errors import InputError

if TYPE_CHECKING:
    from labpipe.contact.bounce_compiled import Table

# The step grows and shrinks by at most these factors; the safety factor is on the step length.
_GROWTH, _SHRINK, _SAFETY = 2.0, 0.3, 0.9
# First step after touch, and longest step, as fractions of the time scale of the contact.
_FIRST, _LONGEST = 1e-4, 0.05
# A plate's oscillation is followed with at least this many steps.
_STEPS_PER_PLATE_PERIOD = 40
# A contact that has lasted longer than the period at rest only rings down: its steps may err more.
_LENIENCY = 8.0
# Steps that the compiled loop takes before their records are fetched, and the rungs it knows: down
# to 2^-32 of the longest step.
_BUFFER, _RUNGS_IN_TABLE = 4096, 128
_NEWTON_LIMIT = 60
# Work that a step may take on average, in updates of one element of one spring.
_UPDATES_PER_STEP = 20_000
# Displacements in m below this are forgotten.
_FORGOTTEN = 1e-200
# Newton converges quadratically: one more evaluation after this relative change is exact.
_NEWTON_TOLERANCE = 1e-8
# A contact block that is outgrown is enlarged to this multiple of the contact radius.
_BLOCK_GROWTH = 1.3


class _Trial(NamedTuple):
    """A step that was computed and not yet accepted."""

    rung: Rung
    approach: float
    force: float
    position: float
    plate: PlateState
    reach: Array


# Rows of the work buffer: unloaded displacement, its time integral, old load, new load,
# displacement. The first two are written by a trial, the others when it is accepted.
_PAST, _DWELL, _OLD, _NEW, _DISPLACEMENT = range(5)


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
        Take plain steps with :mod:`labpipe.contact.bounce_compiled`.
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
    _block: Array = field(init=False)
    _rows: Array = field(init=False)
    _weighted: Array = field(init=False)
    _moments: Array = field(init=False)
    _gap: Array = field(init=False)
    _weight: Array = field(init=False)
    _inverse: Array = field(init=False)
    _outer_stored: Array = field(init=False)
    _outer_time: float = 0.0
    _leniency: float = 1.0
    _ladder: Ladder = field(init=False)
    _table: "Table | None" = None
    _previous: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        self.memory = self.creep.rest(self.springs.position.size)
        self._inverse = 0.5 * self.creep.inverse
        self._ladder = Ladder(self.creep, self.time_scale)

    # -- the free sphere -------------------------------------------------------------------------

    def free_stored(self) -> Array:
        """Energy (element,) in J that the unloaded springs hold now."""
        return self._inverse * ((self.memory * self.memory) @ self.springs.weight)

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
        self._outer_time = self.time
        self._leniency = 1.0
        self._take_block(expected_radius)
        self._previous = (self.acceleration, 0.0)
        if is_new:
            self.trail.append(self._record(self._stored(0.0), 0.0))

    def take_trail(self) -> tuple[Record, ...]:
        """Return the records since the last call."""
        records = tuple(self.trail)
        self.trail.clear()
        return records

    def run(self, until: float, is_resting: RestTest) -> str:
        """Step until "lift-off", "rest" or the "end" of time."""
        pace = _Pace(
            _FIRST * self.time_scale,
            _LONGEST * self.time_scale,
            self.time + is_resting.period,
            _LENIENCY * max(1.0, is_resting.speed / self.speed_scale),
        )
        is_plain = self.body.plate is None
        if self.body.plate is not None:
            shortest_look = 1.0 / (_STEPS_PER_PLATE_PERIOD * self.body.plate.frequency)
            pace.longest = min(pace.longest, shortest_look)
        while True:
            stop = min([until, *self.wanted[:1]])
            if is_plain and self.is_compiled and self._plain_steps(pace, stop, is_resting):
                return "rest"
            outcome = self._step(pace, stop)
            if outcome == "end" and stop < until:
                outcome = ""
            if outcome:
                self._give_back()
                return outcome
            if is_resting(self):
                return "rest"
            if self.time > pace.lenient_from:
                self._leniency = pace.leniency

    def _step(self, pace: "_Pace", until: float) -> str:
        """Take one step; return how it ends the contact, or nothing."""
        while True:
            rung = self._ladder.below(min(pace.dt, pace.longest))
            remaining = until - self.time
            is_last = rung.weights.dt >= remaining
            if is_last:
                rung = rung_of(self.creep, remaining)
            trial = self._attempt(rung)
            lifted = trial.force <= 0.0
            if lifted and self._rows[_OLD, 0] > 0.0:
                trial = self._at_lift_off(rung.weights.dt)
                is_last = False
            error = self._error(trial)
            dt = trial.rung.weights.dt
            if error <= 1.0:
                break
            self.counts.rejected_steps += 1
            pace.dt = dt * max(_SHRINK, _SAFETY * error ** (-1 / 3))
        self._accept(trial)
        pace.dt = dt * (_GROWTH if error <= 0.0 else min(_GROWTH, _SAFETY * error ** (-1 / 3)))
        if lifted:
            return "lift-off"
        return "end" if is_last else ""

    def _plain_steps(self, pace: "_Pace", until: float, is_resting: RestTest) -> bool:
        """Take plain steps, compiled; true at rest, else the next one is for :meth:`_step`."""
        from labpipe.contact import bounce_compiled as compiled

        if self._table is None:
            top = floor(RUNGS * log2(_LONGEST))
            self._table = compiled.tabulate(self._ladder, top - _RUNGS_IN_TABLE, top)
        n, rows = self._gap.size, self._rows
        plain = self.springs.plain(n)
        line = compiled.Line(self._gap, self._weight, self.springs.position[:n], *plain)
        rules = compiled.Rules(
            self.body.mass,
            self.body.gravity,
            self.creep.instantaneous,
            until,
            self.time_scale,
            RUNGS,
            pace.longest,
            self.tolerance * self.speed_scale,
            pace.leniency,
            pace.lenient_from,
            _GROWTH,
            _SHRINK,
            _SAFETY,
            _NEWTON_LIMIT,
            _NEWTON_TOLERANCE,
            is_resting.tolerance,
            is_resting.period,
            is_resting.speed,
        )
        state = np.array(
            [
                *(self.time, self.position, self.velocity, self.acceleration, self.approach),
                *(self.force, self.spring_work, *self._previous, pace.dt, self._leniency),
                *(is_resting.start, is_resting.slowest, is_resting.fastest, is_resting.largest),
            ]
        )
        load, displacement = rows[_OLD].copy(), rows[_DISPLACEMENT].copy()
        buffer = np.empty((_BUFFER, compiled.N_RECORD))
        while True:
            counts = np.zeros(4, dtype=np.int64)
            try:
                filled, reason = compiled.plain_steps(
                    state, counts, rules, self._table, line, self._block, load, displacement,
                    self._inverse, buffer,
                )  # fmt: skip
            except OSError as error:
                # The compiled code could not be stored; nothing was stepped. Go on in numpy.
                warnings.warn(said(error), UserWarning, stacklevel=2)
                self.is_compiled = False
                return False
            self._take_records(buffer[:filled], counts.tolist())
            if reason != compiled.BUFFER_FULL:
                break
        values = state.tolist()
        self.time, self.position, self.velocity, self.acceleration, self.approach = values[:5]
        self.force, self.spring_work, before, dt_before, pace.dt, self._leniency = values[5:11]
        self._previous = (before, dt_before)
        is_resting.start, is_resting.slowest, is_resting.fastest, is_resting.largest = values[11:]
        rows[_OLD], rows[_DISPLACEMENT] = load, displacement
        np.multiply(load, self._weight, out=self._weighted[0])
        return reason == compiled.RESTING

    def _take_records(self, rows: Array, counts: list[int]) -> None:
        """Append what the compiled steps recorded and count what they did."""
        if self._outer_stored.any():
            lag = rows[:, :1] - self._outer_time
            rows[:, 6] += np.exp(-2.0 * lag * self.creep.rate) @ self._outer_stored
        loss = self.plate_loss
        self.trail.extend(Record._make((*row, self.plate, loss)) for row in rows.tolist())
        steps, rejected, newton, products = counts
        self.counts.rejected_steps += rejected
        self.counts.newton_iterations += newton
        self.counts.kernel_products += products
        self.counts.spring_updates += products * self._block.size
        self.counts.solver_steps += steps
        if len(rows):
            self._look_at_limits(float(rows[-1, 0]))

    def settle(self, until: float, growth: float) -> None:
        """Creep on under the weight alone, in steps that grow by a factor each."""
        dt = _LONGEST * self.time_scale
        weight = self.body.mass * self.body.gravity
        while self.time < until:
            remaining = min([until, *self.wanted[:1]]) - self.time
            rung = self._ladder.below(dt) if dt < remaining else rung_of(self.creep, remaining)
            trial = self._attempt_resting(rung, weight)
            if trial is None:
                # The surface would flow further in this step than the contact may spread.
                self.counts.rejected_steps += 1
                dt = 0.5 * rung.weights.dt
                continue
            self._accept_resting(trial, until)
            self.counts.rest_steps += 1
            dt *= growth
        self._give_back()

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

    def _past(self, rung: Rung) -> Array:
        """Memory products of a step: the approach (spring,) that would leave each unloaded."""
        rows = self._rows
        np.matmul(rung.rows, self._block, out=rows[:2])
        reach = rung.weights.old_total * rows[_OLD]
        reach += rows[_PAST]
        reach += self._gap
        np.cumsum(self._weight * reach, out=self._moments[1:])
        self.counts.kernel_products += 1
        self.counts.spring_updates += self._block.size
        return reach

    def _attempt(self, rung: Rung) -> _Trial:
        dt, compliance = rung.weights.dt, rung.weights.compliance
        free, answer, plate_free, plate_answer = self._predict(dt)
        target, total = free - plate_free, answer + plate_answer
        while True:
            reach = self._past(rung)
            approach, force = target, 0.0
            if target > reach.item(0):
                guess = target - total * self.force
                approach, scaled = self._solve(guess, target, total / compliance, reach)
                force = scaled / compliance
                approach = target - total * force
            if approach < reach.item(-2):
                break
            self._grow()
        position, plate = free - answer * force, self.plate
        if self.body.plate is not None:
            moved = plate_free + plate_answer * force
            plate = self.body.plate.follow(plate, dt, moved, force)
        return _Trial(rung, approach, force, position, plate, reach)

    def _solve(
        self, approach: float, target: float, softness: float, reach: Array
    ) -> tuple[float, float]:
        """Newton on ``approach - target + softness * scaled_force = 0``: convex and increasing."""
        floor_value = reach.item(0)
        for _ in range(_NEWTON_LIMIT):
            scaled, slope = self.springs.force(approach, reach, self._moments)
            change = (approach - target + softness * scaled) / (1.0 + softness * slope)
            approach -= change
            self.counts.newton_iterations += 1
            if abs(change) <= _NEWTON_TOLERANCE * abs(approach - floor_value):
                break
        return approach, self.springs.force(approach, reach, self._moments)[0]

    def _check_nested(self, approach: float, reach: Array, load: Array) -> None:
        """Make sure that the springs in contact are the inner ones, as the force supposes."""
        if np.count_nonzero(load) != reach.searchsorted(approach):
            message = (
                f"at {self.time:.6g} s the surface would touch in a ring around the axis, which "
                "the springs of this solver cannot follow; use a smaller rtol"
            )
            raise AnnularContactError(message)

    def _error(self, trial: _Trial) -> float:
        """Error in velocity of a trial step over what is allowed."""
        dt = trial.rung.weights.dt
        before, dt_before = self._previous
        acceleration = self.body.gravity - trial.force / self.body.mass
        slope = (acceleration - self.acceleration) / dt
        earlier = (self.acceleration - before) / dt_before if dt_before > 0.0 else 0.0
        curvature = abs(slope - earlier) * 2.0 / (dt + dt_before)
        allowed = self._leniency * self.tolerance * self.speed_scale
        return dt**3 * curvature / (12.0 * allowed)

    def _at_lift_off(self, longest: float) -> _Trial:
        """Return the step that ends when the last spring, at the centre, lets go."""
        central, load, gap = self._block[:, 0], self._rows.item(_OLD, 0), self._gap.item(0)

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
        reach = self._past(rung)
        # Rounding must not leave a trace of contact.
        approach = min(free - plate_free, reach.item(0))
        return _Trial(rung, approach, 0.0, free, plate, reach)

    def _accept(self, trial: _Trial) -> None:
        dt = trial.rung.weights.dt
        acceleration = self.body.gravity - trial.force / self.body.mass
        self._previous = (self.acceleration, dt)
        self.velocity += 0.5 * dt * (self.acceleration + acceleration)
        self.acceleration = acceleration
        if self.body.plate is not None:
            self.plate_loss += self.body.plate.loss(self.plate, trial.plate, dt)
        self._move_on(trial)

    def _move_on(self, trial: _Trial) -> None:
        """Update memory, ledger and record; what the two ways to step have in common."""
        rung, rows = trial.rung, self._rows
        compliance = rung.weights.compliance
        load = rows[_NEW]
        np.subtract(trial.approach, trial.reach, out=load)
        np.maximum(load, 0.0, out=load)
        load /= compliance
        self._check_nested(trial.approach, trial.reach, load)
        np.multiply(load, self._weight, out=self._weighted[1])
        displacement = rows[_DISPLACEMENT]
        before = self._weighted @ displacement
        np.multiply(load, compliance, out=displacement)
        displacement += trial.reach
        displacement -= self._gap
        self._block *= rung.weights.decay[:, None]
        self._block += rung.pair @ rows[_OLD : _NEW + 1]
        # One product gives every sum over springs that the ledger needs.
        sums = rows @ self._weighted.T
        self.spring_work += self._work(rung, sums, before.tolist())
        squared = sums.item(_NEW, 1)
        rows[_OLD] = load
        self._weighted[0] = self._weighted[1]
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
        load, displacement = self._rows[_OLD].copy(), self._rows[_DISPLACEMENT].copy()
        self.snapshots.append(Snapshot(time, load, displacement, radius))

    def _work(self, rung: Rung, sums: Array, before: list[float]) -> float:
        """Exact work ``int q dw`` on the springs in one step, for the loads inside it.

        ``before`` holds the sums of the displacements at the start with the old and new loads.
        """
        change = (sums[:, 1] - sums[:, 0]).tolist()
        integral = change[_DWELL]
        integral += rung.old_integral * change[_OLD] + rung.new_integral * change[_NEW]
        work = sums.item(_DISPLACEMENT, 1) - before[0]
        work -= (1.0 - rung.jump) * integral / rung.weights.dt
        if rung.jump > 0.0:
            work -= rung.jump * (before[1] - before[0])
            work -= rung.jump_compliance * (change[_NEW] - change[_OLD])
        return work

    def _count_step(self) -> None:
        self.counts.solver_steps += 1
        self._look_at_limits(self.time)

    def _look_at_limits(self, time: float) -> None:
        counts = self.counts
        most_updates = _UPDATES_PER_STEP * self.max_steps
        if counts.solver_steps > self.max_steps or counts.spring_updates > most_updates:
            message = (
                f"{counts.solver_steps} steps of {self._gap.size} springs reached only {time:.6g} "
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

    # -- rest ------------------------------------------------------------------------------------

    def _attempt_resting(self, rung: Rung, weight: float) -> _Trial | None:
        """Find the approach that carries the weight; None when the step is too long for it."""
        wanted = weight * rung.weights.compliance
        while True:
            reach = self._past(rung)
            loaded = int(np.count_nonzero(self._rows[_OLD]))
            approach = float(reach[: loaded + 1].max())
            for _ in range(_NEWTON_LIMIT):
                scaled, slope = self.springs.force(approach, reach, self._moments)
                if slope <= 0.0:
                    return None
                change = (scaled - wanted) / slope
                approach -= change
                self.counts.newton_iterations += 1
                if abs(change) <= _NEWTON_TOLERANCE * abs(approach - reach.item(0)):
                    break
            if approach < reach.item(-2):
                break
            self._grow()
        if np.count_nonzero(reach < approach) != reach.searchsorted(approach):
            return None
        plate = PlateState()
        if self.body.plate is not None:
            plate = PlateState(weight / self.body.plate.stiffness)
        position = approach + plate.displacement
        return _Trial(rung, approach, weight, position, plate, reach)

    def _accept_resting(self, trial: _Trial, until: float) -> None:
        self.velocity = (trial.position - self.position) / trial.rung.weights.dt
        self.acceleration = 0.0
        self._move_on(trial)
        if until - self.time < 1e-12 * until:
            self.time = until

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
        n = min(self.springs.covering(radius) + 1, self.springs.position.size)
        self._block = self.memory[:, :n].copy()
        self._gap = self.springs.gap[:n]
        self._weight = self.springs.weight[:n]
        self._rows = np.zeros((5, n))
        self._rows[_DISPLACEMENT] = self._block.sum(axis=0)
        self._weighted = np.zeros((2, n))
        self._moments = np.zeros(n + 1)
        outer = self.memory[:, n:]
        self._outer_stored = self._inverse * ((outer * outer) @ self.springs.weight[n:])

    def _give_back(self) -> None:
        """Write the block back and let the springs outside it relax up to now."""
        n = self._gap.size
        self.memory[:, :n] = self._block
        self.memory[:, n:] *= np.exp(-(self.time - self._outer_time) * self.creep.rate)[:, None]
        self._outer_time = self.time

    def _grow(self) -> None:
        """Take more springs; the state of those in use stays."""
        known, weighted = self._rows, self._weighted
        self._give_back()
        n = self._gap.size
        self._take_block(_BLOCK_GROWTH * float(self.springs.position[n - 1]))
        self._rows[:, :n] = known
        self._weighted[:, :n] = weighted

    def _stored(self, squared_load: float) -> float:
        """Energy in J that all springs hold now; ``squared_load`` is summed with the weights."""
        held = float(self._inverse @ ((self._block * self._block) @ self._weight))
        held += 0.5 * self.creep.instantaneous * squared_load
        lag = self.time - self._outer_time
        if self._outer_stored.any():
            held += float(self._outer_stored @ np.exp(-2.0 * lag * self.creep.rate))
        return held


@dataclass(slots=True)
class _Pace:
    """Length of the next step, its limit, and when errors may grow, by which factor."""

    dt: float
    longest: float
    lenient_from: float
    leniency: float

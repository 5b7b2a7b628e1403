"""A falling sphere from contact to contact: its state, and what its compiled steps hand back.

The steps themselves are in :mod:`._steps`. Here are the free flight, the
instant of lift-off (where the springless motion meets the central spring), steps that end at a
given time, creep at rest in steps that grow, and the springs in use: only those that this
contact can reach take part; the block grows when the contact does.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import floor, inf, log2
from typing import cast

import numpy as np
from scipy.optimize import brentq

from labpipe.arrays import Floats
from labpipe.contact.impact import _steps as kernel
from labpipe.contact.impact._motion import (
    COUNTS,
    MOTION,
    AnnularContactError,
    Body,
    Counts,
    Motion,
    Snapshot,
    Springs,
    Stillness,
    Trail,
    blank,
    motion,
)
from labpipe.contact.impact._plate import PlateState, modal
from labpipe.contact.impact._setup import FIRST_STEP, LONGEST_STEP
from labpipe.contact.impact._step_table import StepTable, step_table
from labpipe.contact.impact._steps import PACE, Block, Pace, Rules
from labpipe.contact.memory import Creep
from labpipe.errors import InputError

# A contact that has lasted longer than the period at rest only rings down: its steps may err more.
_LENIENCY = 8.0
# Work that a step may take on average, in updates of one element of one spring.
_UPDATES_PER_STEP = 20_000
# Displacements in m below this are forgotten.
_FORGOTTEN = 1e-200
# A contact block that is outgrown is enlarged to this multiple of the contact radius.
_BLOCK_GROWTH = 1.3
# Steps that are taken before limits and progress are looked at, and the lengths in their table:
# down to 2^-32 of the longest step.
_BATCH, _TABLE_LENGTHS = 4096, 129


@dataclass(slots=True)
class Stepper:
    """The state of sphere, plate and springs, and how it moves on.

    Contact lives in ``springs``, which are extended when the contact outgrows them, and ``memory`` (element, spring)
    [m] holds what all their elements moved between contacts; ``now`` is the state but for them. ``tolerance`` is the
    error in velocity of one step relative to ``speed_scale`` [m/s], which with ``time_scale`` [s] is that of a contact.
    Beyond ``largest_radius`` [m] of contact the half-space theory is refused, and the run after ``max_steps``.
    ``only_near`` solves for the springs that a contact can reach only, ``observe`` is told the time now and then, and
    steps end at the instants ``wanted`` [s], ascending, of which snapshots are kept.
    """

    creep_law: Creep
    springs: Springs
    body: Body
    stillness: Stillness
    tolerance: float
    time_scale: float
    speed_scale: float
    largest_radius: float
    max_steps: int
    only_near: bool = True
    observe: Callable[[float], None] | None = None
    wanted: list[float] = field(default_factory=list)
    now: Motion = field(default_factory=motion)
    counts: Counts = field(default_factory=lambda: cast("Counts", blank(COUNTS)))
    snapshots: list[Snapshot] = field(default_factory=list)
    memory: Floats = field(init=False)
    block: Block = field(init=False)
    rules: Rules = field(init=False)
    _pace: Pace = field(init=False)
    _table: StepTable = field(init=False)
    _trail: list[Trail] = field(default_factory=list)
    _batch: Trail = field(init=False)
    _inverse: Floats = field(init=False)
    _outer_stored: Floats = field(init=False)
    _outer_time: float = 0.0

    def __post_init__(self) -> None:
        self.memory = self.creep_law.rest(self.springs.position.size)
        self._inverse = 0.5 * self.creep_law.inverse
        top = floor(kernel.PER_OCTAVE * log2(LONGEST_STEP))
        lowest = top + 1 - _TABLE_LENGTHS
        octaves = np.arange(lowest, top + 1) / kernel.PER_OCTAVE
        self._table = step_table(self.creep_law, self.time_scale * 2.0**octaves)
        self._batch = np.recarray(_BATCH, MOTION)
        self._pace = cast("Pace", blank(PACE, slowest=-inf, fastest=inf, largest=inf))
        mass, stiffness, damping = modal(self.body.plate)
        self.rules = Rules(
            mass=self.body.mass,
            gravity=self.body.gravity,
            instantaneous=self.creep_law.instantaneous,
            base=self.time_scale,
            lowest=lowest,
            allowed=self.tolerance * self.speed_scale,
            rest_tolerance=self.stillness.tolerance,
            rest_period=self.stillness.period,
            rest_speed=self.stillness.speed,
            plate_speed=self.stillness.plate_speed,
            plate_mass=mass,
            plate_stiffness=stiffness,
            plate_damping=damping,
        )

    # -- the free sphere -------------------------------------------------------------------------

    @property
    def plate_state(self) -> PlateState:
        """How the plate moves."""
        now = self.now
        return PlateState(now.plate_displacement, now.plate_velocity, now.plate_acceleration)

    def free_stored(self) -> Floats:
        """Energy (element,) in J that the unloaded springs hold now."""
        return self._inverse * ((self.memory * self.memory) @ self.springs.weight)

    def look_at_dent(self, until: float) -> None:
        """Keep the snapshots that are wanted of the free surface, up to a time [s]."""
        while self.wanted and self.wanted[0] <= until:
            time = self.wanted.pop(0)
            left = np.exp(-max(time - self.now.time, 0.0) * self.creep_law.rate)
            self.snapshots.append(Snapshot(time, np.zeros(1), left @ self.memory, 0.0))

    def fly(self, dt: float) -> None:
        """Move on without contact: ballistic, the dent and the plate relax, exactly."""
        now, gravity, plate = self.now, self.body.gravity, self.body.plate
        self.look_at_dent(now.time + dt)
        now.position += (now.velocity + 0.5 * gravity * dt) * dt
        now.velocity += gravity * dt
        self.memory *= np.exp(-dt * self.creep_law.rate)[:, None]
        if plate is not None:
            before = self.plate_state
            after = plate.free(before, dt)
            now.plate_displacement, now.plate_velocity, now.plate_acceleration = after
            now.plate_loss += plate.energy(before) - plate.energy(after)
        now.time += dt
        now.acceleration, now.force = gravity, 0.0
        now.approach = now.position - now.plate_displacement

    # -- one contact -----------------------------------------------------------------------------

    def touch(self, expected_radius: float, *, is_new: bool = True) -> None:
        """Begin a contact, or go on with one; springs out to the expected radius take part."""
        # What has decayed this far would only slow the processor down (subnormal numbers).
        self.memory[np.abs(self.memory) < _FORGOTTEN] = 0.0
        now, pace = self.now, self._pace
        self._outer_time = now.time
        self._take_block(expected_radius)
        pace.acceleration_before, pace.dt_before = now.acceleration, 0.0
        pace.dt, pace.longest = FIRST_STEP * self.time_scale, LONGEST_STEP * self.time_scale
        pace.leniency, pace.lenient_from = 1.0, now.time + self.stillness.period
        pace.late_leniency = _LENIENCY * max(1.0, self.stillness.speed / self.speed_scale)
        self.rules = self.rules._replace(allowed=self.tolerance * self.speed_scale)
        if is_new:
            pace.rest_start, pace.largest = now.time, inf
            memory, weight = self.block.memory, self.block.weight
            now.stored = float(self._inverse @ ((memory * memory) @ weight))
            now.contact_radius = 0.0
            self._keep()

    def take_trail(self) -> Trail:
        """Return the records (step,) since the last call."""
        trail = np.concatenate(self._trail) if self._trail else np.empty(0, MOTION)
        self._trail.clear()
        return trail

    def run(self, until: float) -> str:
        """Step until "lift-off", "rest" or the "end" of time."""
        while True:
            stop = min([until, *self.wanted[:1]])
            outcome = self._many_steps(stop)
            if outcome in (kernel.LAST, kernel.OFF_TABLE, kernel.LIFTED):
                outcome, has_ended = self._single_step(outcome, stop)
                if has_ended and stop == until and outcome == kernel.ACCEPTED:
                    self._give_back()
                    return "end"
            if outcome == kernel.RELEASED:
                self._give_back()
                return "lift-off"
            if outcome == kernel.RESTING:
                return "rest"
            if outcome == kernel.OUTGROWN:
                self._grow()
            elif outcome == kernel.ANNULAR:
                self._refuse_a_ring()

    def creep(self, until: float, growth: float) -> None:
        """Creep on under the weight alone, in steps that grow by a factor each."""
        now, dt = self.now, LONGEST_STEP * self.time_scale
        while now.time < until:
            remaining = min([until, *self.wanted[:1]]) - now.time
            length = self._tabulated(dt)
            length = length if dt < remaining else remaining
            table = step_table(self.creep_law, np.array([length]))
            outcome = kernel.creep_step(now, self.rules, table, 0, self.block, self.counts)
            if outcome == kernel.OUTGROWN:
                self._grow()
            elif outcome == kernel.REJECTED:
                self.counts.rejected_steps += 1
                dt = 0.5 * length
            else:
                if until - now.time < 1e-12 * until:
                    now.time = until
                self._keep()
                self.look_at_limits()
                self._look_at_springs()
                dt *= growth
        self._give_back()

    def _many_steps(self, stop: float) -> int:
        """Take compiled steps of the table's lengths; return why they ended."""
        filled, outcome = kernel.steps(
            self.now, self._pace, self.rules, self._table, stop, self.block, self.counts, self._batch
        )
        if filled:
            self._keep(self._batch[:filled].copy())
            self.look_at_limits()
        return int(outcome)

    def _single_step(self, reason: int, stop: float) -> tuple[int, bool]:
        """Take the one step that the table has no length for; tell whether it ends at ``stop``."""
        pace, dt = self._pace, stop - self.now.time
        is_last, releases = reason == kernel.LAST, reason == kernel.LIFTED
        if reason == kernel.OFF_TABLE:
            dt = self._tabulated(min(pace.dt, pace.longest))
            is_last = dt >= stop - self.now.time
            dt = min(dt, stop - self.now.time)
        elif releases:
            dt = self._time_to_lift_off(pace.attempted)
        outcome = self._one_step(dt, releases=releases)
        if outcome == kernel.LIFTED:
            releases = True
            outcome = self._one_step(self._time_to_lift_off(dt), releases=True)
        if outcome != kernel.ACCEPTED:
            return outcome, False
        self._keep()
        self.look_at_limits()
        self._look_at_springs()
        if releases or self.now.force <= 0.0:
            return kernel.RELEASED, False
        if is_last:
            return outcome, True
        return (kernel.RESTING if kernel.rests(self.now, pace, self.rules) else outcome), False

    def _one_step(self, dt: float, *, releases: bool) -> int:
        table = step_table(self.creep_law, np.array([dt]))
        return int(kernel.one_step(self.now, self._pace, self.rules, table, 0, self.block, self.counts, releases))

    def _tabulated(self, dt: float) -> float:
        """Return the longest length of the table's series that is not longer than ``dt`` [s]."""
        place = floor(kernel.PER_OCTAVE * log2(dt / self.time_scale))
        return float(self.time_scale * 2.0 ** (place / kernel.PER_OCTAVE))

    def _time_to_lift_off(self, longest: float) -> float:
        """Time in s until the last spring, at the centre, lets go."""
        central, load = self.block.memory[:, 0], float(self.block.load[0])
        gap = float(self.block.gap[0])

        def clearance(dt: float) -> float:
            if dt == 0.0:
                return self.creep_law.instantaneous * load
            table = step_table(self.creep_law, np.array([dt]))
            free, _, plate, _ = kernel.free_motion(self.now, self.rules, dt)
            past = float(table.decay[0] @ central) + float(table.old_total[0]) * load
            return float(free - plate) - gap - past

        return float(brentq(clearance, 0.0, longest, xtol=1e-15 * self.time_scale, rtol=1e-14))

    # -- records, limits -------------------------------------------------------------------------

    def _keep(self, rows: Trail | None = None) -> None:
        """Put records on the trail, with the energy of the springs outside the block."""
        if rows is None:
            rows = np.array([self.now], MOTION)
        if self._outer_stored.any():
            lag = (rows["time"] - self._outer_time)[:, None]
            rows["stored"] += np.exp(-2.0 * lag * self.creep_law.rate) @ self._outer_stored
        self._trail.append(rows)

    def _look_at_springs(self) -> None:
        """Keep a snapshot when this is the instant that is wanted."""
        # The last step before it ends there to rounding.
        if not self.wanted or self.now.time < self.wanted[0] * (1.0 - 1e-15) - 1e-300:
            return
        load, displacement = self.block.load.copy(), self.block.displacement.copy()
        time = self.wanted.pop(0)
        self.snapshots.append(Snapshot(time, load, displacement, self.now.contact_radius))

    def look_at_limits(self) -> None:
        """Refuse to go on after too much work; tell the progress otherwise."""
        counts = self.counts
        most_updates = _UPDATES_PER_STEP * self.max_steps
        if counts.solver_steps > self.max_steps or counts.spring_updates > most_updates:
            raise InputError(
                f"{counts.solver_steps} steps of {self.springs.position.size} springs reached only {self.now.time:.6g} "
                "s: the material damps too little for so long a duration, or hardly has an instantaneous compliance; "
                "shorten the duration, raise max_steps or rtol"
            )
        if self.observe is not None:
            self.observe(self.now.time)

    def refuse_wide(self, radius: float) -> None:
        """Refuse a contact radius [m] that the sphere does not have."""
        if radius > self.largest_radius:
            raise InputError(
                f"at {self.now.time:.6g} s the contact would be {radius:.4g} m in radius, more "
                f"than {self.largest_radius:.4g} m: beyond this the sphere is no half-space; use a "
                "stiffer material, a smaller mass or a lower drop"
            )

    def _refuse_a_ring(self) -> None:
        raise AnnularContactError(
            f"at {self.now.time:.6g} s the surface would touch in a ring around the axis, which "
            "the springs of this solver cannot follow; use a smaller rtol"
        )

    # -- the block of springs in use -------------------------------------------------------------

    def _take_block(self, radius: float) -> None:
        """Copy the springs out to a radius from all springs, adding new ones when needed."""
        self.refuse_wide(radius)
        if self.springs.position[-2] < radius:
            known = self.memory
            self.springs = self.springs.extended(radius)
            self.memory = self.creep_law.rest(self.springs.position.size)
            self.memory[:, : known.shape[1]] = known
        springs, n = self.springs, self.springs.position.size
        if self.only_near:
            n = min(springs.covering(radius) + 1, n)
        memory = self.memory[:, :n].copy()
        self.block = Block(
            gap=springs.gap[:n],
            weight=springs.weight[:n],
            position=springs.position[:n],
            last_weight=springs.last_weight[:n],
            total=np.concatenate([[0.0], np.cumsum(springs.weight[:n])]),
            edge_bias=springs.edge_bias,
            memory=memory,
            inverse=self._inverse,
            load=np.zeros(n),
            displacement=memory.sum(axis=0),
            reach=np.zeros(n),
            moments=np.zeros(n + 1),
            new_load=np.zeros(n),
            new_displacement=np.zeros(n),
        )
        outer = self.memory[:, n:]
        self._outer_stored = self._inverse * ((outer * outer) @ springs.weight[n:])

    def _give_back(self) -> None:
        """Write the block back and let the springs outside it relax up to now."""
        n = self.block.gap.size
        lag = self.now.time - self._outer_time
        self.memory[:, :n] = self.block.memory
        self.memory[:, n:] *= np.exp(-lag * self.creep_law.rate)[:, None]
        self._outer_time = self.now.time

    def _grow(self) -> None:
        """Take more springs; the state of those in use stays."""
        known = self.block
        self._give_back()
        n = known.gap.size
        self._take_block(_BLOCK_GROWTH * float(self.springs.position[n - 1]))
        self.block.load[:n], self.block.displacement[:n] = known.load, known.displacement

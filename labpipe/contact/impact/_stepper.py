"""A sphere in contact, stepped spring by spring: where it regrows, comes to rest, or rests on rings."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Any, cast

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact.impact import _stepping as kernel
from labpipe.contact.impact._motion import MOTION, AnnularContactError, Counts, Motion, Stillness, Trail, blank
from labpipe.contact.impact._plate import Plate, modal
from labpipe.contact.impact._setup import FIRST_STEP, LONGEST_STEP
from labpipe.contact.impact._springs import Springs
from labpipe.contact.impact._stepping import PACE, Block, Pace, Rules
from labpipe.contact.memory import Creep

# A contact that has lasted longer than the period at rest only rings down: its steps may err more.
_LENIENCY = 8.0
# Displacements in m below this are forgotten.
_FORGOTTEN = 1e-200
# Springs that are outgrown are extended to this multiple of their reach.
_EXTENSION = 1.3
# Steps between two looks at limits and progress.
_BATCH = 4096


@dataclass(slots=True)
class Stepper:
    """The springs of one sphere, and how they move on with ``now`` and ``counts``, which are changed in place.

    ``memory`` (element, spring) [m] is the displacement of their elements; ``tolerance`` the error of a step in
    velocity relative to the speed of the contact, ``time_scale`` [s] its duration. ``look`` is called with the contact
    radius and the time after each batch of steps.
    """

    creep_law: Creep
    springs: Springs
    mass: float
    gravity: float
    plate: Plate | None
    stillness: Stillness
    tolerance: float
    time_scale: float
    now: Motion
    counts: Counts
    memory: Floats
    look: Callable[[float], None]
    _record: Any = field(init=False)
    _block: Block = field(init=False)
    _rules: Rules = field(init=False)
    _pace: Pace = field(init=False)
    _trail: list[Trail] = field(default_factory=list)
    _batch: Trail = field(default_factory=lambda: np.recarray(_BATCH, MOTION))

    def touch(self, speed: float, *, is_new: bool = True) -> None:
        """Begin a contact at a speed [m/s], or go on with one."""
        # What has decayed this far would only slow the processor down (subnormal numbers).
        self.memory[np.abs(self.memory) < _FORGOTTEN] = 0.0
        self._fill_block(np.zeros(self.springs.position.size))
        now, still = self.now, self.stillness
        self._rules = Rules(
            self.mass,
            self.gravity,
            self.creep_law.instantaneous,
            self.creep_law.fluidity,
            self.tolerance * speed,
            still.tolerance,
            still.period,
            still.speed,
            still.plate_speed,
            *modal(self.plate),
        )
        self._pace = cast("Pace", blank(PACE, slowest=-inf, fastest=inf, largest=inf, leniency=1.0))
        pace = self._pace
        pace.dt, pace.longest = FIRST_STEP * self.time_scale, LONGEST_STEP * self.time_scale
        pace.acceleration_before, pace.rest_start = now.acceleration, now.time
        pace.lenient_from = now.time + still.period
        pace.late_leniency = _LENIENCY * max(1.0, still.speed / speed)
        if is_new:
            now.stored, now.contact_radius = float(self.stored().sum()), 0.0
        self._record = now.record()
        if is_new:
            self._trail.append(np.array([self._record], MOTION))

    def run(self, until: float) -> str:
        """Step until "lift-off", "rest" or the "end" of time."""
        ends = {kernel.RELEASED: "lift-off", kernel.RESTING: "rest", kernel.ENDED: "end"}
        while True:
            filled, outcome = kernel.steps(
                self._record, self._pace, self._rules, until, self._block, self.counts, self._batch
            )
            self._trail.append(self._batch[:filled].copy())
            self.now.take(self._record)
            self.look(self.now.contact_radius)
            if outcome in ends:
                return ends[outcome]
            if outcome == kernel.OUTGROWN:
                self._extend()
            elif outcome == kernel.ANNULAR:
                raise AnnularContactError(
                    f"at {self.now.time:.6g} s the surface would touch in a ring around the axis, which "
                    "the springs of this solver cannot follow; use a smaller rtol"
                )

    def creep(self, until: float, growth: float) -> None:
        """Creep on under the weight alone, in steps that grow by a factor each."""
        now, dt = self.now, LONGEST_STEP * self.time_scale
        while now.time < until:
            length = min(dt, until - now.time)
            outcome = kernel.creep_step(self._record, self._rules, length, self._block, self.counts)
            if outcome == kernel.OUTGROWN:
                self._extend()
            elif outcome == kernel.REJECTED:
                self.counts.rejected_steps += 1
                dt = 0.5 * length
            else:
                if until - self._record.time < 1e-12 * until:
                    self._record.time = until
                self._trail.append(np.array([self._record], MOTION))
                now.take(self._record)
                self.look(now.contact_radius)
                dt *= growth

    def take_trail(self) -> Trail:
        """Return the records (step,) since the last call."""
        trail = np.concatenate(self._trail) if self._trail else np.empty(0, MOTION)
        self._trail.clear()
        return trail

    def stored(self) -> Floats:
        """Energy (element,) in J that the unloaded springs hold now."""
        return 0.5 * self.creep_law.inverse * ((self.memory * self.memory) @ self.springs.weight)

    def _fill_block(self, load: Floats) -> None:
        springs, creep, n, elements = self.springs, self.creep_law, self.springs.position.size, self.creep_law.rate.size
        reach, moments, new_load, new_displacement = np.zeros(n), np.zeros(n + 1), np.zeros(n), np.zeros(n)
        self._block = Block(
            gap=springs.gap,
            weight=springs.weight,
            position=springs.position,
            last_weight=springs.last_weight,
            total=np.concatenate([[0.0], np.cumsum(springs.weight)]),
            edge_bias=springs.edge_bias,
            C=creep.C,
            tau=creep.tau,
            inverse=0.5 * creep.inverse,
            memory=self.memory,
            load=load,
            displacement=self.memory.sum(axis=0) + creep.instantaneous * load,
            reach=reach,
            moments=moments,
            new_load=new_load,
            new_displacement=new_displacement,
            decay=np.zeros(elements),
            dwell=np.zeros(elements),
            old=np.zeros(elements),
            new=np.zeros(elements),
        )

    def _extend(self) -> None:
        """Add springs that never carried; the state of those in use stays."""
        known, load = self.memory, self._block.load
        self.look(float(self.springs.position[-2]))
        self.springs = self.springs.out_to(_EXTENSION * float(self.springs.position[-1]))
        if self.springs.position.size == load.size:
            self.look(inf)  # no sphere is left
        self.memory = self.creep_law.rest(self.springs.position.size)
        self.memory[:, : known.shape[1]] = known
        self._fill_block(np.concatenate([load, np.zeros(self.springs.position.size - load.size)]))

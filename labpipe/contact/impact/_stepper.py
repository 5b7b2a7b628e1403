"""A sphere in contact, stepped spring by spring: where it regrows, comes to rest, or rests on rings."""

from collections.abc import Callable
from math import ceil, inf, sqrt

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact import _stepping as kernel
from labpipe.contact._memory import Creep
from labpipe.contact._springs import OUTGROWN, SpringBed, sphere_bed
from labpipe.contact._stepping import Body, Rules, Springs, room_for
from labpipe.contact.impact._records import MOTION, Motion, Trail, blank
from labpipe.contact.impact._rings import ring_bed
from labpipe.contact.impact._setting import Scales, Setting, modal
from labpipe.errors import InputError

# Error [m/s] allowed in a step over (rtol)^(3/2) of the speed, measured on Ting's solutions.
_STEP_SHARE = 0.12
# First step after touch, and longest step, as fractions of the time scale of the contact.
_FIRST_STEP, _LONGEST_STEP = 1e-4, 0.05
# Springs per smallest contact radius expected, at rtol = 1e-4, and at most; rings per radius of the first contact.
_SPRINGS_PER_RADIUS, _MOST_SPRINGS = 40, 1500
_RINGS_PER_RADIUS, _MOST_RINGS_PER_RADIUS = 80, 1200
# Steps per decade of time at rest.
_STEPS_PER_DECADE = 12
# Rest is an amplitude below rtol times the static sag; a sphere whose rest is not followed stays where its swing and
# that of the plate are each below a larger part.
_STAYS = 0.3
# Springs that are outgrown are extended to this multiple of their reach.
_EXTENSION = 1.3
# Steps between two looks at limits and progress.
_BATCH = 4096

_PACE = np.dtype(
    [(name, np.float64) for name in ("dt", "leniency", "peak", "rest_start", "slowest", "fastest", "largest")]
)


class Stepper:
    """The springs of one sphere, and how they move on with ``now`` and ``counts``, which are changed in place.

    ``reach`` [m]: radius out to which there are springs; ``look`` is called with the contact radius after each batch
    of steps. The springs are at rest until their ``room.memory`` (element, spring) [m] is filled in.
    """

    def __init__(
        self,
        one: Setting,
        creep_law: Creep,
        expected: Scales,
        now: Motion,
        counts: dict[str, int],
        look: Callable[[float], None],
        reach: float,
    ) -> None:
        self.one, self.creep_law, self.expected, self.now = one, creep_law, expected, now
        self.counts, self.look, self.reach = counts, look, reach
        self._trail, self._batch, self._work = list[Trail](), np.recarray(_BATCH, MOTION), np.zeros(3, np.int64)
        finer = sqrt(1e-4 / one.rtol)
        if one.solver == "rings":
            per_radius = min(_RINGS_PER_RADIUS * finer, _MOST_RINGS_PER_RADIUS)
            self._spacing = one.ring_width or expected.radius / per_radius
        else:
            smallest = min(expected.rest_radius, expected.radius)
            self._spacing = max(smallest / (_SPRINGS_PER_RADIUS * finer), reach / _MOST_SPRINGS)
        self.bed = self._bed()
        self.room = room_for(self.bed.size, creep_law.rate.size)

    def _bed(self) -> SpringBed:
        """Springs of the solver out to the reach, or to the radius of an exact sphere."""
        one, spacing = self.one, self._spacing
        if one.solver == "rings":
            return ring_bed(self.reach, one.radius, spacing, one.profile)
        count = ceil(self.reach / spacing)
        if one.profile == "sphere":
            count = min(count, int(one.radius / spacing) - 2)
        return sphere_bed(one.radius, count * spacing, count, one.profile)

    def touch(self, speed: float, *, is_new: bool = True) -> None:
        """Begin a contact at a speed [m/s], or go on with one."""
        one, now, expected, room = self.one, self.now, self.expected, self.room
        # What has decayed this far would only slow the processor down (subnormal numbers).
        room.memory[np.abs(room.memory) < 1e-200] = 0.0
        room.load[:] = 0.0
        tolerance = _STAYS if one.rows_only else one.rtol
        period = max(expected.rest_period, 1.0 / one.plate.frequency if one.plate else 0.0)
        self._rules = Rules(
            allowed=(_STEP_SHARE * one.rtol) ** 1.5 * max(speed, expected.rest_speed),
            longest=_LONGEST_STEP * expected.duration,
            rest_tolerance=0.0 if one.full else tolerance,
            rest_period=period,
            rest_speed=expected.rest_speed,
        )
        start = _FIRST_STEP * expected.duration
        self._pace = blank(_PACE, dt=start, leniency=1.0, rest_start=now.time, slowest=-inf, fastest=inf, largest=inf)
        if is_new:
            now.stored, now.contact_radius = float(self.stored().sum()), 0.0
        self._record = now.record()
        if is_new:
            self._trail.append(np.array([self._record], MOTION))

    def run(self, until: float) -> str:
        """Step until "lift-off", "rest" or the "end" of time."""
        body = Body(self.one.mass, self.one.gravity, *modal(self.one.plate))
        ends = {kernel.RELEASED: "lift-off", kernel.RESTING: "rest", kernel.DONE: "end"}
        while True:
            springs = Springs(self.bed, self.creep_law.elements, self.room)
            state = self._record, self._pace, self._batch, self._work
            filled, outcome = kernel.swing(springs, body, self._rules, until, *state)
            self._trail.append(self._batch[:filled].copy())
            self.now.take(self._record)
            self._count()
            if outcome in ends:
                return ends[outcome]
            if outcome == OUTGROWN:
                self._extend()
            elif outcome != kernel.FULL:
                raise InputError(
                    f"at {self.now.time:.6g} s the surface would touch in a ring around the axis, which "
                    "the springs of this solver cannot follow; use a smaller rtol"
                )

    def creep(self, until: float) -> None:
        """Creep on under the weight alone, reported at times that grow by a factor each."""
        now, one, law = self.now, self.one, self.creep_law.elements
        weight, dt = one.mass * one.gravity, _LONGEST_STEP * self.expected.duration
        sag = weight / one.plate.stiffness if one.plate else 0.0
        answer = np.array([now.approach, weight, now.contact_radius, 0.0, 0.0, now.stored, dt])
        scales = np.array([weight, float(self.creep_law.compliance(until - now.time)), now.approach])
        tolerance = one.rtol**1.5
        self._trail.append(np.array([now.record()], MOTION))
        while now.time < until:
            if now.contact_radius > 0.8 * self.bed.edge[-1]:
                self._extend()
            end = min(now.time + dt, until)
            before, heat, held = now.time, answer[4], answer[5]
            loads = kernel.FORCE, end - now.time, weight, weight, tolerance, scales, float(answer[6])
            if kernel.cross(Springs(self.bed, law, self.room), *loads, answer, self._work) != kernel.DONE:
                raise InputError(f"the creep from {now.time:.6g} s on cannot be followed; use a smaller rtol")
            now.time, now.approach, now.force, now.contact_radius = end, float(answer[0]), weight, float(answer[2])
            now.spring_work += float(answer[4] - heat + answer[5] - held)
            now.stored, now.velocity = float(answer[5]), (now.approach + sag - now.position) / (end - before)
            now.position, now.acceleration = now.approach + sag, 0.0
            now.plate_displacement, now.plate_velocity, now.plate_acceleration = sag, 0.0, 0.0
            self._trail.append(np.array([now.record()], MOTION))
            self.counts["rest_steps"] += 1
            self._count()
            dt *= 10.0 ** (1.0 / _STEPS_PER_DECADE)

    def take_trail(self) -> Trail:
        """Return the records (step,) since the last call."""
        trail = np.concatenate(self._trail) if self._trail else np.empty(0, MOTION)
        self._trail.clear()
        return trail

    def stored(self) -> Floats:
        """Energy (element,) in J that the unloaded springs hold now."""
        return 0.5 * self.creep_law.inverse * (self.room.memory**2 @ self.bed.stiffness)

    def _count(self) -> None:
        steps, rejected, solutions = self._work.tolist()
        self._work[:] = 0
        for name, made in (("solver_steps", steps), ("rejected_steps", rejected), ("kernel_products", solutions)):
            self.counts[name] += made
        self.counts["spring_updates"] += solutions * self.room.memory.size
        self.look(self.now.contact_radius)

    def _extend(self) -> None:
        """Add springs that never carried; the state of those in use stays."""
        self.look(float(self.bed.edge[-2]))
        old, n = self.room, self.bed.size
        self.reach *= _EXTENSION
        self.bed = self._bed()
        if self.bed.size == n:
            self.look(inf)  # no sphere is left
        self.room = room_for(self.bed.size, self.creep_law.rate.size)
        self.room.memory[:, :n], self.room.load[:n] = old.memory, old.load

"""A sphere in contact, stepped spring by spring: where it regrows, comes to rest, or rests on rings."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, pi, sqrt
from typing import Any, cast

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact._memory import Creep, step_weights
from labpipe.contact.impact import _stepping as kernel
from labpipe.contact.impact._plate import modal
from labpipe.contact.impact._records import MOTION, Counts, Motion, Trail, blank
from labpipe.contact.impact._setting import Scales, Setting
from labpipe.contact.impact._springs import Springs, line_springs, ring_springs
from labpipe.contact.impact._stepping import MOST_RINGING, PACE, Block, Pace, Rules
from labpipe.errors import InputError

#: Step error for an error of rtol, (share * rtol)^(3/2) of the speed: restitution errs by 0.55 (step error)^(2/3), of
#: which a whole train of bounces may add up some ten; measured on Ting's solutions, as are the steps of one contact.
STEP_SHARE = 0.117
# First step after touch, and longest step, as fractions of the time scale of the contact.
FIRST_STEP, LONGEST_STEP = 1e-4, 0.05
# Springs per contact radius at rtol = 1e-4; their error falls with the square. Where the instantaneous compliance is
# too small to matter within one step, the pressure ends in a step at the edge: the error then falls only with the
# number of springs, so take more. Spacing is even up to a part of the smallest contact expected.
_SPRINGS_PER_RADIUS, _FINER_FOR_A_STEP, _CORE = 80, 12.0, 0.25
# Rings per radius of the first contact: later ones are smaller, so it takes more.
_RINGS_PER_RADIUS, _MOST_RINGS_PER_RADIUS = 120, 1200
# Steps per decade of time at rest, at rtol = 1e-4.
_STEPS_PER_DECADE = 12
# A contact that has lasted longer than the period at rest only rings down: its steps may err more.
_LENIENCY = 8.0
# Rest is an amplitude below rtol times the static sag, within these bounds; a sphere whose rest is not followed stays
# where its own swing and the plate's part of it are each below a larger part.
_REST_RANGE, _STAYS = (1e-5, 1e-3), 0.3
# A plate this many times heavier than the sphere swings as if it were alone.
_HEAVY_PLATE = 10.0
# Springs that are outgrown are extended to this multiple of their reach.
_EXTENSION = 1.3
# Steps between two looks at limits and progress.
_BATCH = 4096


class AnnularContactError(InputError):
    """The springs outside the contact would touch before those inside: steps or springs too coarse.

    A sphere does not do that; a step that rings does, where the material relaxes by a factor of
    thousands within it.
    """


@dataclass(slots=True)
class Stepper:
    """The springs of one sphere, and how they move on with ``now`` and ``counts``, which are changed in place.

    ``memory`` (element, spring) [m] is the displacement of their elements. ``look`` is called with the contact radius
    after each batch of steps.
    """

    one: Setting
    creep_law: Creep
    expected: Scales
    springs: Springs
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
        self.memory[np.abs(self.memory) < 1e-200] = 0.0
        self._fill_block(np.zeros(self.springs.position.size))
        one, creep, now, expected = self.one, self.creep_law, self.now, self.expected
        tolerance = _STAYS if one.rows_only else min(max(one.rtol, _REST_RANGE[0]), _REST_RANGE[1])
        period, plate_speed = expected.rest_period, inf
        if one.plate is not None:
            period = max(period, 1.0 / one.plate.frequency)
            plate_speed = _shaking_speed(one, creep, expected) if one.rows_only else expected.rest_speed
        self._rules = Rules(
            one.mass,
            one.gravity,
            creep.instantaneous,
            creep.fluidity,
            (STEP_SHARE * one.rtol) ** 1.5 * speed,
            tolerance if one.shortcuts.rest else 0.0,
            period,
            expected.rest_speed,
            plate_speed,
            *modal(one.plate),
        )
        self._pace = pace = cast("Pace", blank(PACE, slowest=-inf, fastest=inf, largest=inf, leniency=1.0))
        pace.dt, pace.longest = FIRST_STEP * expected.duration, LONGEST_STEP * expected.duration
        pace.acceleration_before, pace.rest_start = now.acceleration, now.time
        pace.lenient_from = now.time + period
        pace.late_leniency = _LENIENCY * max(1.0, expected.rest_speed / speed)
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

    def creep(self, until: float) -> None:
        """Creep on under the weight alone, in steps that grow by a factor each."""
        now, dt = self.now, LONGEST_STEP * self.expected.duration
        growth = 10.0 ** (sqrt(self.one.rtol / 1e-4) / _STEPS_PER_DECADE)
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
        springs, creep, n = self.springs, self.creep_law, self.springs.position.size
        self._block = Block(
            springs.gap,
            springs.weight,
            springs.position,
            springs.last_weight,
            np.concatenate([[0.0], np.cumsum(springs.weight)]),
            springs.edge_bias,
            creep.C,
            creep.tau,
            0.5 * creep.inverse,
            self.memory,
            load,
            self.memory.sum(axis=0) + creep.instantaneous * load,
            *(np.zeros(size) for size in (n, n + 1, n, n)),
            *np.zeros((4, creep.rate.size)),
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


def springs_for(one: Setting, creep: Creep, expected: Scales, reach: float) -> Springs:
    """Springs of the solver out to a radius [m], as fine as rtol asks."""
    finer = sqrt(1e-4 / one.rtol)
    # Steps of an impact, or of rest, may be long against the fastest relaxation.
    longest = max(expected.rest_period / 4.0, (one.duration - one.fall_time) / 10.0)
    looks = [step_weights(creep, float(dt)) for dt in np.geomspace(expected.duration / 400.0, longest, 8)]
    if any(look.old_total > MOST_RINGING * look.compliance for look in looks):
        finer *= _FINER_FOR_A_STEP
    if one.solver == "rings":
        # Rings cannot be made so fine: their number is limited.
        finer = min(finer, _MOST_RINGS_PER_RADIUS / _RINGS_PER_RADIUS)
        return ring_springs(
            reach, one.radius, one.ring_width or expected.radius / (_RINGS_PER_RADIUS * finer), one.profile
        )
    core = _CORE * min(expected.rest_radius, expected.radius)
    return line_springs(reach, one.radius, core, _SPRINGS_PER_RADIUS * finer, one.profile)


def _shaking_speed(one: Setting, creep: Creep, expected: Scales) -> float:
    """Speed [m/s] of a plate below which it does not shake the sphere off.

    The swing of the plate holds the energy of a lift-off then; or, as a heavy plate swings alone,
    its acceleration is that of gravity, raised by the resonance of the sphere on any contact from
    that of its weight at first to the largest.
    """
    plate = one.plate
    if plate is None:
        return inf
    ratio = plate.mass / one.mass
    by_energy = expected.rest_speed / sqrt(ratio)
    if ratio < _HEAVY_PLATE:
        return by_energy
    omega = 2.0 * pi * plate.frequency
    compliance = creep.instantaneous + (creep.C / (1.0 + 1j * omega * creep.tau)).sum() + creep.fluidity / (1j * omega)
    late = (0.75 * one.mass * one.gravity * one.radius * float(creep.compliance(one.duration))) ** (1 / 3)
    radii = max(expected.radius, late), expected.rest_radius
    least, most = (0.5 * one.mass * omega**2 * abs(compliance) / radius for radius in radii)
    in_phase = float(compliance.real) / abs(compliance)
    inertia = min(max(in_phase, least), most)  # over the stiffness, where the resonance is largest
    from_resonance = sqrt(max(1.0 + inertia * (inertia - 2.0 * in_phase), 0.0))
    return max(by_energy, from_resonance * one.gravity / omega)

"""Fall, bounce, rest: a drop as contacts and flights in turn.

Every contact up to a lift-off is collocated (:mod:`._bounce`). One that grows again before it lifts
off, or in which the sphere comes to rest, is stepped from there on (:mod:`._stepper`), as are all of
"rings"; when nothing swings any more, the contact creeps on quasi-statically. The surface keeps its
dents: memory is never reset between bounces.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from math import ceil, nan, pi, sqrt
from typing import cast

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact.impact._bounce import Bounce, Curves, Tables, bounce
from labpipe.contact.impact._dents import Dents
from labpipe.contact.impact._flight import time_of_flight
from labpipe.contact.impact._motion import COUNTS, Counts, Motion, Stillness, Trail, blank
from labpipe.contact.impact._plate import Plate, PlateState, modal
from labpipe.contact.impact._records import Fall
from labpipe.contact.impact._setting import Setting
from labpipe.contact.impact._setup import (
    LONGEST_STEP,
    MARGIN,
    Effort,
    Scales,
    growth,
    springs_for,
    step_tolerance,
    steps_per_contact,
)
from labpipe.contact.impact._stepper import Stepper
from labpipe.contact.impact._trajectory import Contact, Flight, Segment, peak
from labpipe.contact.memory import Creep
from labpipe.errors import InputError, LabpipeError

# A sphere that sinks in from a lower speed than this part of the speed at rest will not lift off
# again unless its material is all but elastic; down to here its energy is followed closely enough.
_SLOWEST_BOUNCE = 0.03
# Rest is an amplitude below rtol times the static sag, within these bounds.
_REST_RANGE = (1e-5, 1e-3)
# A sphere stays where its own swing and the plate's part of it are each below this part of the sag.
_STAYS = 0.3
# A plate this many times heavier than the sphere swings as if it were alone.
_HEAVY_PLATE = 10.0
# First and longest step of a collocated contact over the duration of the first one, and tolerance of a step
# over rtol: restitution errs by less than that, a long train by some ten times.
_FIRST, _LONGEST, _STEP_SHARE = 1e-6, 0.34, 0.05
# Work that a step may take on average, in updates of one element of one spring.
_UPDATES_PER_STEP = 20_000

#: Columns of an impact, by their names in the result.
COLUMNS = (
    "impact_time",
    "lift_off_time",
    "contact_duration",
    "impact_speed",
    "rebound_speed",
    "restitution",
    "peak_force",
    "peak_contact_radius",
    "peak_approach",
    "penetration",
    "energy_dissipated",
    "energy_stored",
)


@dataclass(slots=True)
class Train:
    """A drop from its release to its end: set up, then :meth:`run`.

    ``most`` is the number of impacts after which it ends, if any; ``observe`` is called with the time since first
    touch now and then. Afterwards ``rows`` holds a row per impact by :data:`COLUMNS`, times from the release, and
    ``error`` the largest energy that the motion mislaid over that of the drop.
    """

    setting: Setting
    tables: Tables
    effort: Effort
    expected: Scales
    most: int | None = None
    observe: Callable[[float], None] | None = None
    now: Motion = field(default_factory=Motion)
    counts: Counts = field(default_factory=lambda: cast("Counts", blank(COUNTS)))
    segments: list[Segment] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    final_touch: float = nan
    rest_start: float = nan
    dents: Dents = field(init=False)
    stepper: Stepper | None = None
    _begun: Motion | None = None
    _peaks: list[tuple[float, ...]] = field(default_factory=list)
    _mislaid: float = 0.0
    _worst: float = 0.0
    _deepest: float = 0.0

    def run(self) -> "Train":
        """Fall, bounce, rest.

        Raises InputError: the contact would be wider than the sphere, or there are too many steps.
        """
        setting, expected, now = self.setting, self.expected, self.now
        if expected.radius > setting.radius:
            raise InputError(
                f"the contact would be about {expected.radius:.3g} m in radius, wider than the sphere "
                f"({setting.radius:.3g} m): small-strain contact does not hold; use a stiffer "
                "material, a smaller mass or a lower drop"
            )
        self._refuse_endless()
        self.dents = Dents(self.tables.creep, has_energy=not self.effort.rows_only)
        end, touch = setting.duration - setting.fall_time, 0.0
        if setting.solver == "rings" or not self.effort.shortcuts.flights:
            self._step_on(MARGIN * expected.radius)
            # Rings touch first at the middle of the innermost, a little after the pole would.
            gap = float(self.stepper.springs.gap[0]) if self.stepper else 0.0
            touch = 2.0 * gap / (setting.speed + sqrt(setting.speed**2 + 2.0 * setting.gravity * gap)) if gap else 0.0
        start = Motion(time=-setting.fall_time, position=-setting.height, approach=-setting.height)
        silent, rate = np.zeros(self.tables.creep.rate.size), self.tables.creep.rate
        self._keep(Flight(start, min(touch, end), silent, silent, rate))
        now.velocity, now.acceleration = setting.speed, setting.gravity
        if touch < end:
            self._fly(touch)
            self._bounce(end)
        return self

    @property
    def error(self) -> float:
        """Largest numerical energy error of the motion over the energy of the drop."""
        return self._worst / (self.setting.mass * self.setting.gravity * max(self.setting.height, self._deepest))

    def _bounce(self, end: float) -> None:
        """Alternate contacts and flights."""
        now, least_speed = self.now, _SLOWEST_BOUNCE * self.expected.rest_speed
        while True:
            touched, speed = now.time, max(now.velocity, least_speed)
            if self._begun is None:
                self._begun = copy(now)
            if self.stepper is None and self._collocated(speed, end):
                outcome, flight = "lift-off", self._time_of_flight()
                if now.time < end and flight <= 0.0:  # the surface follows at once
                    self._step_on()
                    continue
            else:
                if self.stepper is None:
                    self._step_on()
                outcome, flight = self._stepped(speed, end)
            if outcome == "rest":
                self.final_touch, self.rest_start = touched, now.time
                if not self.effort.rows_only and self.stepper is not None:
                    self.stepper.creep(end, growth(self.effort.rtol))
                    self._keep_contact(self.stepper.take_trail(), is_resting=True)
                return
            if outcome == "end" or now.time >= end:
                return
            self._end_row()
            stop = min(now.time + flight, end)
            stored, dent = self._free_surface()
            self._keep(Flight(copy(now), stop, stored, dent, self.tables.creep.rate))
            if stop >= end or len(self.rows) == self.most:
                return
            self._fly(flight)
            self.counts.flights += 1

    # -- contacts --------------------------------------------------------------------------------

    def _collocated(self, speed: float, end: float) -> bool:
        """Follow a contact to its lift-off; false if there is none, and nothing has happened then."""
        one, scale = self.setting, self.expected.duration
        steps = _STEP_SHARE * self.effort.rtol * speed, _LONGEST * scale, _FIRST * scale
        fall = Fall(one.mass, one.gravity, one.radius, one.profile == "sphere", *modal(one.plate), *steps)
        found: Bounce | None = bounce(self.tables, fall, self.now, self.dents, self._mislaid, self.counts)
        if found is None:
            return False
        self._look(found.largest)
        self._mislaid, self._worst = found.mislaid, max(self._worst, found.worst)
        self._deepest = max(self._deepest, found.deepest)
        sunk = found.deepest - (self._begun.position if self._begun else 0.0)
        self._peaks.append((found.peak_force, found.largest, found.peak_approach, sunk))
        if not self.effort.rows_only:
            curves = Curves.of(self.tables, fall, found)
            self._keep(Contact(curves.natural(end), curves=curves))
        return True

    def _stepped(self, speed: float, end: float) -> tuple[str, float]:
        """Step one contact; return how it ends, and the time of flight after a lift-off."""
        stepper = self.stepper
        assert stepper is not None  # noqa: S101 - made by the caller
        stepper.touch(speed)
        flight = 0.0
        while (outcome := stepper.run(end)) == "lift-off" and (flight := self._time_of_flight()) <= 0.0:
            stepper.touch(speed, is_new=False)  # the surface follows at once
        self._keep_contact(stepper.take_trail())
        return outcome, flight

    def _keep_contact(self, records: Trail, *, is_resting: bool = False) -> None:
        """Put stepped records on the list, and look at their largest values and their energy."""
        if not records.size:
            return
        self._measure(records)
        if is_resting:
            last = self.segments[-1]
            assert isinstance(last, Contact)  # noqa: S101 - rest follows a contact
            records = np.concatenate([last.records[-1:], records])
        self._keep(Contact(records, is_resting=is_resting))

    def _measure(self, records: Trail) -> None:
        one, time = self.setting, records["time"]
        energy = 0.5 * one.mass * records["velocity"] ** 2 - one.mass * one.gravity * (records["position"] + one.height)
        energy = energy + records["spring_work"] + records["plate_loss"]
        if one.plate is not None:
            energy += one.plate.energy(PlateState(records["plate_displacement"], records["plate_velocity"]))
        self._mislaid = float(energy[-1])
        self._worst = max(self._worst, float(np.abs(energy).max()))
        self._deepest = max(self._deepest, float(np.abs(records["position"]).max()))
        sunk = records["position"] - (self._begun.position if self._begun else 0.0)
        looked_at = records["force"], records["contact_radius"], records["approach"], sunk
        self._peaks.append(tuple(peak(time, values) for values in looked_at))

    def _end_row(self) -> None:
        """Write the row of a contact that ended in a flight."""
        first, last, fall = self._begun, self.now, self.setting.fall_time
        assert first is not None  # noqa: S101 - it was touched
        incoming, outgoing = first.velocity, -last.velocity
        self.rows.append(
            (
                first.time + fall,
                last.time + fall,
                last.time - first.time,
                incoming,
                outgoing,
                outgoing / incoming if incoming > 0.0 else nan,
                *np.max(self._peaks, axis=0).tolist(),
                last.spring_work - last.stored - (first.spring_work - first.stored),
                last.stored,
            )
        )
        self._begun, self._peaks = None, []

    def _step_on(self, reach: float | None = None) -> None:
        """Go on with springs, out to a radius [m] or to where there are dents."""
        one, creep = self.setting, self.tables.creep
        reach = reach or MARGIN * (self.dents.layers[0].edge if self.dents.layers else self.expected.radius)
        springs = springs_for(one, creep, self.expected, self.effort, reach)
        self.stepper = Stepper(
            creep_law=creep,
            springs=springs,
            mass=one.mass,
            gravity=one.gravity,
            plate=one.plate,
            stillness=_stillness(one, creep, self.expected, self.effort),
            tolerance=step_tolerance(self.effort.rtol),
            time_scale=self.expected.duration,
            now=self.now,
            counts=self.counts,
            memory=self.dents.at(springs.position),
            look=self._look,
        )

    # -- flights ---------------------------------------------------------------------------------

    def _free_surface(self) -> tuple[Floats, Floats]:
        """Energy (element,) [J] that the free springs hold, and displacement (element,) [m] at the pole."""
        if self.stepper is None:
            return self.dents.stored(), self.dents.centre
        return self.stepper.stored(), self.stepper.memory[:, 0].copy()

    def _time_of_flight(self) -> float:
        one, now = self.setting, self.now
        fall = Fall(one.mass, one.gravity, one.radius, False, *modal(one.plate), 0.0, 0.0, 0.0)
        dent, rate = self._free_surface()[1], self.tables.creep.rate
        time = time_of_flight(fall, now.velocity, dent, rate, now.plate_displacement, now.plate_velocity)
        if time < 0.0:
            raise LabpipeError("the sphere does not come back to the plate")
        return float(time)

    def _fly(self, dt: float) -> None:
        """Move on without contact: ballistic, the dent and the plate relax, exactly; cut into steps on request."""
        now, gravity, plate = self.now, self.setting.gravity, self.setting.plate
        pieces = 1
        if not self.effort.shortcuts.flights:
            pieces = max(ceil(dt / (LONGEST_STEP * self.expected.duration)), 1)
            self.counts.solver_steps += pieces - 1
        for _ in range(pieces):
            piece = dt / pieces
            now.position += (now.velocity + 0.5 * gravity * piece) * piece
            now.velocity += gravity * piece
            now.time += piece
            if self.stepper is None:
                self.dents.relax(piece)
            else:
                self.stepper.memory *= np.exp(-piece * self.tables.creep.rate)[:, None]
            if plate is not None:
                before = PlateState(now.plate_displacement, now.plate_velocity, now.plate_acceleration)
                after = plate.free(before, piece)
                now.plate_displacement, now.plate_velocity, now.plate_acceleration = after
                now.plate_loss += plate.energy(before) - plate.energy(after)
        now.acceleration, now.force = gravity, 0.0
        now.approach = now.position - now.plate_displacement
        now.stored = float(self._free_surface()[0].sum())

    # -- limits ----------------------------------------------------------------------------------

    def _keep(self, segment: Segment) -> None:
        if not self.effort.rows_only:
            self.segments.append(segment)

    def _look(self, radius: float) -> None:
        """Refuse a contact radius [m] that the sphere does not have, and too much work; report the progress."""
        counts, most, now = self.counts, self.effort.max_steps, self.now
        if radius > self.setting.radius:
            raise InputError(
                f"at {now.time:.6g} s the contact would be {radius:.4g} m in radius, more "
                f"than {self.setting.radius:.4g} m: beyond this the sphere is no half-space; use a "
                "stiffer material, a smaller mass or a lower drop"
            )
        if counts.solver_steps > most or counts.spring_updates > _UPDATES_PER_STEP * most:
            raise InputError(
                f"{counts.solver_steps} steps reached only {now.time:.6g} "
                "s: the material damps too little for so long a duration, or hardly has an instantaneous compliance; "
                "shorten the duration, raise max_steps or rtol"
            )
        if self.observe is not None:
            self.observe(now.time)

    def _refuse_endless(self) -> None:
        """Refuse an elastic sphere that would bounce more often than there are steps."""
        setting, effort, creep = self.setting, self.effort, self.tables.creep
        is_damped = creep.n_terms or creep.fluidity or (setting.plate and setting.plate.damping_ratio)
        cycle = self.expected.duration + 2.0 * setting.speed / setting.gravity
        needed = steps_per_contact(effort.rtol) * setting.duration / cycle
        if not is_damped and needed > effort.max_steps:
            raise InputError(
                f"an elastic sphere never stops: {setting.duration:.4g} s would take about {needed:.2g} steps, more "
                f"than max_steps = {effort.max_steps}; shorten the duration, raise max_steps, or give the material a "
                "loss"
            )


def _stillness(setting: Setting, creep: Creep, expected: Scales, effort: Effort) -> Stillness:
    tolerance = _STAYS if effort.rows_only else min(max(effort.rtol, _REST_RANGE[0]), _REST_RANGE[1])
    if not effort.shortcuts.rest:
        tolerance = 0.0
    period, speed = expected.rest_period, expected.rest_speed
    if setting.plate is None:
        return Stillness(tolerance, period, speed)
    plate_speed = _shaking_speed(setting, setting.plate, creep, expected) if effort.rows_only else speed
    return Stillness(tolerance, max(period, 1.0 / setting.plate.frequency), speed, plate_speed)


def _shaking_speed(setting: Setting, plate: Plate, creep: Creep, expected: Scales) -> float:
    """Speed [m/s] of a plate below which it does not shake the sphere off.

    The swing of the plate holds the energy of a lift-off then; or, as a heavy plate swings alone,
    its acceleration is that of gravity, raised by the resonance of the sphere on any contact from
    that of its weight at first to the largest.
    """
    ratio = plate.mass / setting.mass
    by_energy = expected.rest_speed / sqrt(ratio)
    if ratio < _HEAVY_PLATE:
        return by_energy
    omega = 2.0 * pi * plate.frequency
    compliance = creep.instantaneous + (creep.C / (1.0 + 1j * omega * creep.tau)).sum() + creep.fluidity / (1j * omega)
    weight = setting.mass * setting.gravity
    late = (0.75 * weight * setting.radius * float(creep.compliance(setting.duration))) ** (1 / 3)
    radii = max(expected.radius, late), expected.rest_radius
    least, most = (0.5 * setting.mass * omega**2 * abs(compliance) / radius for radius in radii)
    in_phase = float(compliance.real) / abs(compliance)
    inertia = min(max(in_phase, least), most)  # over the stiffness, where the resonance is largest
    from_resonance = sqrt(max(1.0 + inertia * (inertia - 2.0 * in_phase), 0.0))
    return max(by_energy, from_resonance * setting.gravity / omega)

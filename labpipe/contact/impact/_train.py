"""Fall, bounce, rest: a drop as contacts and flights in turn.

Every contact up to a lift-off is collocated (:mod:`._bounce`). One that grows again before it lifts off, or in which
the sphere comes to rest, is stepped from there on (:mod:`._stepper`), as are all of "rings"; when nothing swings any
more, the contact creeps on. The surface keeps its dents: the sphere touches again on the residual dent.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from math import inf, nan, sqrt
from typing import Any

import numpy as np
from numpy.lib.recfunctions import structured_to_unstructured, unstructured_to_structured
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.optimize import brentq

from labpipe.arrays import Floats
from labpipe.contact.impact._bounce import Dents, bounce
from labpipe.contact.impact._records import MOTION, Fall, Motion, Tables, Trail
from labpipe.contact.impact._setting import Plate, Scales, Setting, modal
from labpipe.contact.impact._stepper import Stepper
from labpipe.errors import InputError, LabpipeError

#: Springs are laid out and taken into a contact this far beyond the radius expected.
MARGIN = 1.1
# A sphere that sinks in from a lower speed than this part of the speed at rest will not lift off
# again unless its material is all but elastic; down to here its energy is followed closely enough.
_SLOWEST_BOUNCE = 0.03
# First and longest step of a collocated contact over the duration of the first one, and tolerance of a step
# over rtol: restitution errs by less than that, a long train by some ten times.
_FIRST, _LONGEST, _COLLOCATED_SHARE = 1e-6, 0.34, 0.05
# Steps that one contact takes, and work that a step may take on average, in updates of one element of one spring.
_STEPS_PER_CONTACT, _UPDATES_PER_STEP = 20, 20_000

# Samples of a flight when no times are asked for, its ends included; looks within a period of a ringing plate.
_FLIGHT_SAMPLES, _LOOKS_PER_PERIOD = 26, 32

#: Units and names of the quantities of an impact, and those of them that a row holds.
ROWS = {
    "impact_time": ("s", "time of touch"),
    "lift_off_time": ("s", "time of lift-off"),
    "contact_duration": ("s", "duration of the contact"),
    "impact_speed": ("m/s", "speed at touch"),
    "rebound_speed": ("m/s", "speed at lift-off"),
    "restitution": ("1", "coefficient of restitution"),
    "peak_force": ("N", "largest contact force"),
    "peak_contact_radius": ("m", "largest contact radius"),
    "peak_pressure": ("Pa", "largest contact pressure, of Hertz's distribution"),
    "peak_approach": ("m", "largest approach"),
    "penetration": ("m", "largest depth of the sphere below its level at touch"),
    "energy_dissipated": ("J", "energy dissipated during the contact"),
    "energy_stored": ("J", "elastic energy remaining in the dent at lift-off"),
}
# Work done; counts only, so that they do not depend on the machine.
_COUNTS = ("solver_steps", "rejected_steps", "kernel_products", "spring_updates", "rest_steps", "flights")
COLUMNS = tuple(name for name in ROWS if name != "peak_pressure")


@dataclass(slots=True)
class Train:
    """A drop from its release to its end: set up, then :meth:`run`.

    It ends after ``most`` impacts, if any; ``observe`` is called with the time since first touch now and then;
    ``times`` (time,) [s] from there are asked for. Afterwards ``rows`` holds a row per impact by :data:`COLUMNS`, times
    from the release, and ``stretches`` the end of each contact and flight, its records at any times, its own times.
    """

    setting: Setting
    tables: Tables
    expected: Scales
    most: int | None = None
    observe: Callable[[float], None] | None = None
    times: Floats | None = None
    now: Motion = field(default_factory=Motion)
    counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_COUNTS, 0))
    rows: list[tuple[float, ...]] = field(default_factory=list)
    stretches: list[tuple[float, Callable[[Floats], Trail], Floats]] = field(default_factory=list)
    final_touch: float = nan
    rest_start: float = nan
    dents: Dents = field(init=False)
    stepper: Stepper | None = None
    _begun: Motion | None = None
    _peaks: list[tuple[float, ...]] = field(default_factory=list)
    _worst: float = 0.0
    _deepest: float = 0.0

    def run(self) -> "Train":
        """Fall, bounce, rest; a contact wider than the sphere, or too many steps, raise InputError."""
        setting, expected, now, creep = self.setting, self.expected, self.now, self.tables.creep
        self._look(expected.radius)
        is_damped = creep.n_terms or creep.fluidity or (setting.plate and setting.plate.damping_ratio)
        cycle = expected.duration + 2.0 * setting.speed / setting.gravity
        needed = _STEPS_PER_CONTACT * setting.duration / cycle
        if not is_damped and needed > setting.max_steps:
            raise InputError(
                f"an elastic sphere never stops: {setting.duration:.4g} s would take about {needed:.2g} steps, more "
                f"than max_steps = {setting.max_steps}; shorten the duration, raise max_steps, or give the material a "
                "loss"
            )
        self.dents = Dents(creep, has_energy=not setting.rows_only)
        end, touch = setting.duration - setting.fall_time, 0.0
        if setting.solver == "rings" or setting.full:
            # Rings touch first at the middle of the innermost, a little after the pole would.
            gap = float(self._step_on(MARGIN * expected.radius).bed.gap[0])
            touch = 2.0 * gap / (setting.speed + sqrt(setting.speed**2 + 2.0 * setting.gravity * gap)) if gap else 0.0
        start = Motion(time=-setting.fall_time, position=-setting.height, approach=-setting.height)
        self._keep_flight(start, min(touch, end), end)
        now.velocity, now.acceleration = setting.speed, setting.gravity
        if touch < end:
            if touch:
                self._fly(touch)
            self._bounce(end)
        return self

    @property
    def error(self) -> float:
        """Largest numerical energy error of the motion over the energy of the drop."""
        return self._worst / (self.setting.mass * self.setting.gravity * max(self.setting.height, self._deepest))

    def records(self) -> Trail:
        """All records (time,), at instants of the stretches' own or at the times that are asked for."""
        if self.times is None:
            return np.concatenate([at(own) for _, at, own in self.stretches])
        ends = [end for end, _, _ in self.stretches[:-1]]
        which = np.searchsorted(ends, self.times, side="right")
        return np.concatenate([self.stretches[n][1](self.times[which == n]) for n in np.unique(which)])

    def _bounce(self, end: float) -> None:
        """Alternate contacts and flights."""
        now, least_speed = self.now, _SLOWEST_BOUNCE * self.expected.rest_speed
        while True:
            touched, speed = now.time, max(now.velocity, least_speed)
            first = self._begun = self._begun or copy(now)
            if self.stepper is None and self._collocated(speed, end):
                outcome, flight = "lift-off", self._time_of_flight()
                if now.time < end and flight <= 0.0:  # the surface follows at once
                    self._step_on()
                    continue
            else:
                stepper, flight = self.stepper or self._step_on(), 0.0
                stepper.touch(speed)
                while (outcome := stepper.run(end)) == "lift-off" and (flight := self._time_of_flight()) <= 0.0:
                    stepper.touch(speed, is_new=False)  # the surface follows at once
                self._keep_contact(stepper.take_trail())
                if outcome == "rest":
                    self.final_touch, self.rest_start = touched, now.time
                    if not self.setting.rows_only:
                        stepper.creep(end)
                        self._keep_contact(stepper.take_trail(), is_resting=True)
                    return
            if outcome == "end" or now.time >= end:
                return
            # the row of a contact that ended in a flight
            fall, incoming, outgoing = self.setting.fall_time, first.velocity, -now.velocity
            self.rows.append(
                (
                    first.time + fall,
                    now.time + fall,
                    now.time - first.time,
                    incoming,
                    outgoing,
                    outgoing / incoming if incoming > 0.0 else nan,
                    *np.max(self._peaks, axis=0).tolist(),
                    now.spring_work - now.stored - (first.spring_work - first.stored),
                    now.stored,
                )
            )
            self._begun, self._peaks = None, []
            stop = min(now.time + flight, end)
            self._keep_flight(copy(now), stop, end)
            if stop >= end or len(self.rows) == self.most:
                return
            self._fly(flight)
            self.counts["flights"] += 1

    def _collocated(self, speed: float, end: float) -> bool:
        """Follow a contact to its lift-off; false if there is none, and nothing has happened then."""
        one, scale = self.setting, self.expected.duration
        steps = _COLLOCATED_SHARE * one.rtol * speed, _LONGEST * scale, _FIRST * scale
        fall = Fall(one.mass, one.gravity, one.radius, one.profile == "sphere", *modal(one.plate), *steps)
        found = bounce(self.tables, fall, self.now, self.dents, self.counts, self.times)
        if found is None:
            return False
        self._look(found.largest)
        position, velocity, _, _, *plate, loss, work = found.ends.T
        self._look_at_energy(position, velocity, work + loss, *plate)
        sunk = found.deepest - (self._begun.position if self._begun else 0.0)
        self._peaks.append((found.peak_force, found.largest, found.peak_approach, sunk))
        if found.course is not None:
            time = found.course["time"]
            own = np.append(time[time < min(time[-1], end)], min(time[-1], end))
            self.stretches.append((float(time[-1]), partial(stepped, found.course, one, False), own))
        return True

    def _keep_contact(self, records: Trail, *, is_resting: bool = False) -> None:
        """Put stepped records on the list, and look at their largest values and their energy."""
        if not records.size:
            return
        one, time = self.setting, records["time"]
        plate = records["plate_displacement"], records["plate_velocity"]
        taken = records["spring_work"] + records["plate_loss"]
        self._look_at_energy(records["position"], records["velocity"], taken, *plate)
        sunk = records["position"] - (self._begun.position if self._begun else 0.0)
        looked_at = records["force"], records["contact_radius"], records["approach"], sunk
        self._peaks.append(tuple(_peak(time, values) for values in looked_at))
        records["surface"] = records["approach"]
        if not one.rows_only:
            own = time[1:] if is_resting else time
            self.stretches.append((float(time[-1]), partial(stepped, records, one, is_resting), own))

    def _step_on(self, reach: float | None = None) -> Stepper:
        """Go on with springs, out to a radius [m] or to where there are dents."""
        reach = reach or MARGIN * (self.dents.layers[0].edge if self.dents.layers else self.expected.radius)
        given = self.setting, self.tables.creep, self.expected, self.now, self.counts
        self.stepper = Stepper(*given, self._look, reach)
        self.stepper.room.memory[:] = self.dents.at(self.stepper.bed.edge)
        return self.stepper

    def _free_surface(self) -> tuple[Floats, Floats]:
        """Energy (element,) [J] that the free springs hold, and displacement (element,) [m] at the pole."""
        if self.stepper is None:
            return self.dents.stored(), self.dents.centre
        return self.stepper.stored(), self.stepper.room.memory[:, 0].copy()

    def _keep_flight(self, start: Motion, stop: float, end: float) -> None:
        """Record a flight without the ends that its neighbours bring."""
        if not self.setting.rows_only:
            samples = np.linspace(start.time, stop, _FLIGHT_SAMPLES)
            own = samples[(1 if self.rows else 0) : (None if stop >= end else -1)]
            at = partial(flown, start, self.setting, *self._free_surface(), self.tables.creep.rate)
            self.stretches.append((stop, lambda times: at(times - start.time), own))

    def _time_of_flight(self) -> float:
        """Time [s] to the next touch; 0 where the surface follows at once, infinity where no touch is asked for."""
        now, one, dent, rate = self.now, self.setting, self._free_surface()[1], self.tables.creep.rate
        if now.velocity - now.plate_velocity + float(rate @ dent) >= 0.0:
            return 0.0
        if len(self.rows) + 1 == self.most:
            return inf
        return time_of_flight(now, one.gravity, dent, rate, one.plate)

    def _fly(self, dt: float) -> None:
        """Move on without contact: ballistic, the dent and the plate relax, exactly."""
        now, rate = self.now, self.tables.creep.rate
        now.take(flown(now, self.setting, *self._free_surface(), rate, np.array([dt]))[0])
        if self.stepper is None:
            self.dents.relax(dt)
        else:
            self.stepper.room.memory[:] *= np.exp(-dt * rate)[:, None]

    def _look_at_energy(self, position: Floats, velocity: Floats, taken: Floats, *plate: Floats) -> None:
        """Keep the largest error of the energy, which is 0 at the release and of which contacts have taken a part."""
        one = self.setting
        energy = 0.5 * one.mass * velocity**2 - one.mass * one.gravity * (position + one.height) + taken
        if one.plate is not None:
            energy += one.plate.energy(*plate)
        self._worst = max(self._worst, float(np.abs(energy).max()))
        self._deepest = max(self._deepest, float(np.abs(position).max()))

    def _look(self, radius: float) -> None:
        """Refuse a contact radius [m] that the sphere does not have, and too much work; report the progress."""
        counts, most, now = self.counts, self.setting.max_steps, self.now
        if radius > self.setting.radius:
            raise InputError(
                f"at {now.time:.6g} s the contact would be about {radius:.3g} m in radius, wider than the sphere "
                f"({self.setting.radius:.3g} m), which is no half-space then; use a stiffer material, a smaller mass "
                "or a lower drop"
            )
        if counts["solver_steps"] > most or counts["spring_updates"] > _UPDATES_PER_STEP * most:
            raise InputError(
                f"{counts['solver_steps']} steps reached only {now.time:.6g} "
                "s: the material damps too little for so long a duration, or hardly has an instantaneous compliance; "
                "shorten the duration, raise max_steps or rtol"
            )
        if self.observe is not None:
            self.observe(now.time)


def _peak(time: Floats, values: Floats) -> float:
    """Largest value, refined by the parabola through its neighbours."""
    i = int(np.argmax(values))
    if not 0 < i < values.size - 1:
        return float(values[i])
    before, after = time[i - 1] - time[i], time[i + 1] - time[i]
    low, high = values[i - 1] - values[i], values[i + 1] - values[i]
    curvature = (high / after - low / before) / (after - before)
    slope = low / before - curvature * before
    return float(values[i] - slope**2 / (4.0 * curvature)) if curvature < 0.0 else float(values[i])


def time_of_flight(start: Motion, gravity: float, dent: Floats, rate: Floats, plate: Plate | None) -> float:
    """Time [s] from lift-off, at which both part, to the next touch.

    ``dent``, ``rate`` (element,): displacements [m] of the elements of the central spring, and rates of recovery [1/s].
    On rigid ground the distance has one zero; a ringing plate is looked at within reach of its swing, which only falls.
    """
    velocity, u = start.velocity, start.plate_displacement

    def sunk(time: Any) -> Any:
        """Depth [m] to which the sphere, let alone, would have sunk into the surface, whose dent recovers."""
        raised = plate.free(u, start.plate_velocity, time)[0] - u if plate else 0.0
        return (velocity + 0.5 * gravity * time) * time - np.expm1(-np.multiply.outer(time, rate)) @ dent - raised

    reach = 0.0 if plate is None else sqrt(2.0 * plate.energy(u, start.plate_velocity) / plate.stiffness)
    longest = (-velocity + sqrt(velocity**2 + 4.0 * gravity * reach)) / gravity * 1.001
    looks = np.array([longest])
    if plate is not None:
        step = 1.0 / (plate.frequency * _LOOKS_PER_PERIOD)
        looks = step * np.arange(1, int(longest / step) + 2)
        highest = u + reach + float(np.maximum(dent, 0.0).sum())
        looks = looks[(velocity + 0.5 * gravity * looks) * looks + highest >= 0.0]
    touching = np.flatnonzero(sunk(looks) > 0.0)
    if not touching.size:
        raise LabpipeError("the sphere does not come back to the plate")
    end = float(looks[touching[0]])
    begin = 1e-9 * end if plate is None else max(end - step, 1e-9 * step)
    while sunk(begin) >= 0.0:
        begin *= 1e-2
        if begin < 1e-290 * end:
            return 0.0
    return float(brentq(sunk, begin, end, xtol=1e-300, rtol=8.9e-16))


def flown(start: Motion, body: Setting, stored: Floats, dent: Floats, rate: Floats, s: Floats) -> Trail:
    """Return records (time,) of a flight at times ``s`` [s] since its ``start``, known in closed form.

    ``stored`` (element,) [J]: energy of each element of the memory at the start; ``dent``, ``rate`` as above.
    """
    trail, gravity = np.zeros(s.size, MOTION), body.gravity
    trail["time"], trail["velocity"], trail["acceleration"] = start.time + s, start.velocity + gravity * s, gravity
    trail["approach"] = trail["position"] = start.position + (start.velocity + 0.5 * gravity * s) * s
    trail["surface"] = np.exp(-s[:, None] * rate) @ dent
    trail["stored"] = np.exp(-2.0 * s[:, None] * rate) @ stored
    trail["spring_work"], trail["plate_loss"] = start.spring_work, start.plate_loss
    if body.plate is not None:
        state = body.plate.free(start.plate_displacement, start.plate_velocity, s)
        trail["plate_displacement"], trail["plate_velocity"], trail["plate_acceleration"] = state
        trail["approach"] -= state[0]
        trail["plate_loss"] += body.plate.energy(start.plate_displacement, start.plate_velocity)
        trail["plate_loss"] -= body.plate.energy(*state[:2])
    return trail


def stepped(steps: Trail, body: Setting, is_resting: bool, times: Floats) -> Trail:
    """Return records (time,) of a contact, or of the creep of a body at rest, from those of its steps.

    Position and speed by Hermite's cubics, the others by monotone ones, so that none leaves the range of its steps.
    """
    row = np.minimum(np.searchsorted(steps["time"], times), steps.size - 1)
    if steps.size == 1 or np.array_equal(steps["time"][row], times):
        return steps[row]
    columns = structured_to_unstructured(steps)
    inside = np.clip(times, steps["time"][0], steps["time"][-1])
    trail: Trail = unstructured_to_structured(PchipInterpolator(steps["time"], columns)(inside), MOTION)
    trail["time"] = times
    if not is_resting:
        acceleration = body.gravity - steps["force"] / body.mass
        trail["velocity"] = CubicHermiteSpline(steps["time"], steps["velocity"], acceleration)(inside)
        trail["position"] = CubicHermiteSpline(steps["time"], steps["position"], steps["velocity"])(inside)
        trail["approach"] = trail["surface"] = trail["position"] - trail["plate_displacement"]
    return trail

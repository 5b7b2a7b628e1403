"""Fall, bounce, rest: a drop as contacts and flights in turn.

Contacts (:mod:`._stepper`) and flights (:mod:`._flight`) alternate; when
nothing swings any more, the contact creeps on quasi-statically. The surface keeps its dents: memory
is never reset between bounces.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from math import ceil, nan, pi, sqrt

import numpy as np

from labpipe.arrays import Floats
from labpipe.contact.impact._bounce import Bouncer
from labpipe.contact.impact._collocation import distinct
from labpipe.contact.impact._dataset import DropRun, Setting
from labpipe.contact.impact._flight import time_to_touch
from labpipe.contact.impact._motion import Body, Motion, Stillness, motion
from labpipe.contact.impact._plate import Plate, modal
from labpipe.contact.impact._setup import (
    LONGEST_STEP,
    MARGIN,
    Effort,
    Scales,
    growth,
    scales,
    springs_for,
    step_tolerance,
    steps_per_contact,
)
from labpipe.contact.impact._stepper import Stepper
from labpipe.contact.impact._trajectory import Contact, Flight, Segment
from labpipe.contact.memory import Condensed, Creep, condense
from labpipe.errors import InputError

# Terms may be folded away or frozen where that costs this part of rtol.
CONDENSE_SHARE = 0.01
# A sphere that sinks in from a lower speed than this part of the speed at rest will not lift off
# again unless its material is all but elastic; down to here its energy is followed closely enough.
SLOWEST_BOUNCE = 0.03
# Rest is an amplitude below rtol times the static sag, within these bounds.
_REST_RANGE = (1e-5, 1e-3)
# A sphere stays where its own swing and the plate's part of it are each below this part of the sag.
_STAYS = 0.3
# A plate this many times heavier than the sphere swings as if it were alone.
_HEAVY_PLATE = 10.0


def _stepper(
    setting: Setting, creep: Creep, expected: Scales, effort: Effort, observe: Callable[[float], None] | None
) -> Stepper:
    if expected.radius > setting.radius:
        raise InputError(
            f"the contact would be about {expected.radius:.3g} m in radius, wider than the sphere "
            f"({setting.radius:.3g} m): small-strain contact does not hold; use a stiffer "
            "material, a smaller mass or a lower drop"
        )
    return Stepper(
        creep_law=creep,
        springs=springs_for(setting, creep, expected, effort),
        body=Body(setting.mass, setting.gravity, setting.plate),
        stillness=_stillness(setting, creep, expected, effort),
        tolerance=step_tolerance(effort.rtol),
        time_scale=expected.duration,
        speed_scale=max(setting.speed, expected.rest_speed),
        largest_radius=setting.radius,
        max_steps=effort.max_steps,
        only_near=effort.shortcuts.near,
        observe=observe,
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


def _refuse_endless(setting: Setting, creep: Creep, expected: Scales, effort: Effort) -> None:
    """Refuse an elastic sphere that would bounce more often than there are steps."""
    is_damped = creep.n_terms or creep.fluidity or (setting.plate and setting.plate.damping_ratio)
    cycle = expected.duration + 2.0 * setting.speed / setting.gravity
    needed = steps_per_contact(effort.rtol) * setting.duration / cycle
    if not is_damped and needed > effort.max_steps:
        raise InputError(
            f"an elastic sphere never stops: {setting.duration:.4g} s would take about {needed:.2g} steps, more than "
            f"max_steps = {effort.max_steps}; shorten the duration, raise max_steps, or give the material a loss"
        )


def simulate(
    setting: Setting,
    creep: Creep,
    effort: Effort,
    looks: Floats | None,
    observe: Callable[[float], None] | None,
    *,
    first_contact_only: bool = False,
) -> DropRun:
    """Fall, bounce, rest.

    ``setting``: what was asked for; ``creep``: contact compliance, all terms; ``effort``: how finely; ``looks``
    (map_time,) [s]: instants, from the release, of which to keep the springs; ``observe``: told the time since first
    touch now and then; ``first_contact_only``: end at the first lift-off. Raises InputError: the contact would be wider
    than the sphere, or there are too many steps.
    """
    expected = scales(creep, setting.radius, setting.mass, setting.gravity, setting.speed)
    condensed = Condensed(creep, 0, 0)
    if effort.fold:
        tolerance = CONDENSE_SHARE * effort.rtol
        condensed = condense(creep, expected.duration, setting.duration, tolerance)
    bouncer = None
    if setting.solver == "mdr" and looks is None and effort.shortcuts.flights and effort.shortcuts.near:
        condensed = replace(condensed, creep=distinct(condensed.creep))
        bouncer = _bouncer(setting, condensed.creep, expected, effort)
    _refuse_endless(setting, condensed.creep, expected, effort)
    stepper = _stepper(setting, condensed.creep, expected, effort, observe)
    end = setting.duration - setting.fall_time
    if looks is not None:
        stepper.wanted = np.minimum(looks - setting.fall_time, end).tolist()
    # Rings touch first at the middle of the innermost, a little after the pole would.
    touch = _fall_further(setting, float(stepper.springs.gap[0]))
    fall = _at_release(setting)
    silent = np.zeros(condensed.creep.rate.size)
    segments: list[Segment] = [Flight(fall, min(touch, end), silent, silent, condensed.creep.rate)]
    final_touch = rest_start = nan
    stepper.now.velocity, stepper.now.acceleration = setting.speed, setting.gravity
    if touch < end:
        stepper.fly(touch)
        reach = MARGIN * expected.radius
        final_touch, rest_start = _bounce(stepper, bouncer, reach, end, segments, effort, first_contact_only)
    else:
        stepper.look_at_dent(end)
    return DropRun(
        segments,
        stepper.body,
        stepper.counts,
        condensed,
        stepper.springs,
        tuple(stepper.snapshots),
        final_touch,
        rest_start,
    )


def _fall_further(setting: Setting, gap: float) -> float:
    """Time in s to fall through a gap [m] that is left when the pole would touch."""
    if gap <= 0.0:
        return 0.0
    return 2.0 * gap / (setting.speed + sqrt(setting.speed**2 + 2.0 * setting.gravity * gap))


def _at_release(setting: Setting) -> Motion:
    height = -setting.height
    return motion(time=-setting.fall_time, position=height, approach=height)


def _bouncer(setting: Setting, creep: Creep, expected: Scales, effort: Effort) -> Bouncer:
    return Bouncer(
        creep=creep,
        mass=setting.mass,
        gravity=setting.gravity,
        radius=setting.radius,
        is_sphere=setting.profile == "sphere",
        plate=modal(setting.plate),
        duration=expected.duration,
        rtol=effort.rtol,
    )


def _bounce(
    stepper: Stepper,
    bouncer: Bouncer | None,
    reach: float,
    end: float,
    segments: list[Segment],
    effort: Effort,
    first_contact_only: bool,
) -> tuple[float, float]:
    """Alternate contacts and flights; return the last touch and the start of rest, or NaN."""
    now = stepper.now
    least_speed = SLOWEST_BOUNCE * stepper.stillness.speed
    while True:
        touched = now.time
        stepper.speed_scale = max(now.velocity, least_speed)
        curves = None if bouncer is None else bouncer.bounce(now, stepper.speed_scale, stepper.counts)
        if curves is not None and bouncer is not None:
            stepper.refuse_wide(curves.largest)
            stepper.look_at_limits()
            records = curves.natural(end)
            segments.append(Contact(records, curves=curves))
            if now.time >= end:
                return nan, nan
            outcome, flight = "lift-off", _time_of_flight(stepper, bouncer.dents.centre)
            if flight <= 0.0:
                stepper.memory, bouncer = bouncer.dents.at(stepper.springs.position), None
                continue
        else:
            if bouncer is not None:
                # It grows again or stays: from here on the springs are stepped.
                stepper.memory, bouncer = bouncer.dents.at(stepper.springs.position), None
            outcome, flight = _one_contact(stepper, end, reach)
            records = stepper.take_trail()
            segments.append(Contact(records))
        if outcome == "rest":
            settled = now.time
            if effort.rows_only:
                return touched, settled
            stepper.creep(end, growth(effort.rtol))
            creeping = stepper.take_trail()
            if creeping.size:
                whole = np.concatenate([records[-1:], creeping])
                segments.append(Contact(whole, is_resting=True))
            return touched, settled
        if outcome == "end":
            return nan, nan
        stop = min(now.time + flight, end)
        start = copy(now)
        stored = stepper.free_stored() if bouncer is None else bouncer.dents.stored()
        dent = stepper.springs.pole(stepper.memory) if bouncer is None else bouncer.dents.centre
        segments.append(Flight(start, stop, stored, dent, stepper.creep_law.rate))
        if stop >= end or first_contact_only:
            stepper.look_at_dent(end)
            return nan, nan
        _fly(stepper, flight, in_one_step=effort.shortcuts.flights)
        if bouncer is not None:
            bouncer.dents.relax(flight)
        reach = MARGIN * float(records["contact_radius"].max())


def _fly(stepper: Stepper, flight: float, *, in_one_step: bool) -> None:
    """Move through a flight [s], which is exact in one step and in many."""
    steps = 1 if in_one_step else ceil(flight / (LONGEST_STEP * stepper.time_scale))
    for _ in range(steps):
        stepper.fly(flight / steps)
    stepper.counts.flights += 1
    stepper.counts.solver_steps += steps - 1


def _one_contact(stepper: Stepper, end: float, reach: float) -> tuple[str, float]:
    """Run one contact; return how it ends, and the time of flight after a lift-off."""
    stepper.touch(reach)
    while True:
        outcome = stepper.run(end)
        if outcome != "lift-off":
            return outcome, 0.0
        flight = _time_of_flight(stepper, stepper.memory[:, 0])
        if flight > 0.0:
            return outcome, flight
        # The surface follows the sphere at once: no bounce, the contact goes on.
        stepper.touch(reach, is_new=False)


def _time_of_flight(stepper: Stepper, dent: Floats) -> float:
    body, rate = stepper.body, stepper.creep_law.rate
    return time_to_touch(
        stepper.now.velocity, body.gravity, np.ascontiguousarray(dent), rate, body.plate, stepper.plate_state
    )

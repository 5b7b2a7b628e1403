"""Drop a viscoelastic sphere on a rigid flat and follow every bounce until it rests.

:func:`drop` alternates contacts (:mod:`._bounce`) and flights
(:mod:`._flight`), and creeps on quasi-statically when nothing swings any more. The
surface keeps its dents: memory is never reset between bounces.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, inf, nan, sqrt
from time import perf_counter

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.contact.impact._bounce import Stepper
from labpipe.contact.impact._bounce_step import LONGEST
from labpipe.contact.impact._checks import Solver, checked, checked_times
from labpipe.contact.impact._compilation import why_not_compiled
from labpipe.contact.impact._dataset import (
    DropRun,
    Setting,
    dataset,
    mislaid_energy,
    thesis_dataset,
)
from labpipe.contact.impact._flight import time_to_touch, time_to_touch_plate
from labpipe.contact.impact._line_springs import Profile
from labpipe.contact.impact._motion import AnnularContactError, Body, Record
from labpipe.contact.impact._plate import Plate, PlateState
from labpipe.contact.impact._rest import RestTest
from labpipe.contact.impact._settling import settle
from labpipe.contact.impact._setup import (
    ALL_SHORTCUTS,
    MARGIN,
    Effort,
    Scales,
    Shortcuts,
    growth,
    scales,
    springs_for,
    step_tolerance,
    steps_per_contact,
)
from labpipe.contact.impact._thesis_scheme import RING_WIDTH, TIME_STEP, drop_thesis
from labpipe.contact.impact._trajectory import Contact, Flight, Segment
from labpipe.contact.memory import Array, Condensed, Creep, CreepMaterial, condense
from labpipe.errors import InputError

# Terms may be folded away or frozen where that costs this part of rtol.
_CONDENSE_SHARE = 0.01
# A sphere that sinks in from a lower speed than this part of the speed at rest will not lift off
# again unless its material is all but elastic; down to here its energy is followed closely enough.
_SLOWEST_BOUNCE = 0.03
# Rest is an amplitude below rtol times the static sag, within these bounds.
_REST_RANGE = (1e-5, 1e-3)
# Progress is told at steps of this part of the duration.
_PROGRESS_EVERY = 0.01
# A run that mislays more than this times rtol of the drop's energy (usual are 0.4 for one impact
# and 0.8 for a long train) is repeated once with rtol divided by the refinement, down to the limit.
_ENERGY_LIMIT, _REFINEMENT, _FINEST = 5.0, 10.0, 1e-6


def drop(
    material: CreepMaterial,
    radius: float,
    mass: float,
    height: float,
    duration: float,
    solver: Solver = "mdr",
    profile: Profile = "parabola",
    rtol: float = 1e-4,
    *,
    gravity: float = 9.81,
    plate: Plate | None = None,
    times: ArrayLike | None = None,
    maps: ArrayLike | None = None,
    ring_width: float | None = None,
    time_step: float | None = None,
    fold: bool = True,
    compiled: bool = True,
    shortcuts: Shortcuts = ALL_SHORTCUTS,
    max_steps: int = 1_000_000,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Drop a viscoelastic sphere on a rigid flat.

    Parameters
    ----------
    material : labpipe.materials.Prony
        Of the sphere (or of the flat, if the sphere is the rigid one).
    radius : float [m]
        Of the sphere.
    mass : float [kg]
        That falls: sphere and holder.
    height : float [m]
        Fall from rest to first touch; 0 starts in touch, at rest.
    duration : float [s]
        From the release, which is time 0.
    solver : "mdr", "rings" or "thesis"
        Independent springs on a graded line; rings of constant pressure (boundary elements), a
        separate way to the same answer; or the thesis's own scheme, as a reference only.
    profile : "parabola" or "sphere"
        Gap ``r^2/2R`` or the exact sphere; they differ by 0.1 % in force at a contact of a tenth of
        the radius.
    rtol : float
        Relative error to aim at for restitution, peak force and touch times, 1e-8 to 1e-2.
    gravity : float [m/s2]
        Default as in the references, 9.81.
    plate : Plate, optional
        Lets the substrate ring; by default it is rigid.
    times : array (time,) [s], optional
        Where to report; by default every step in contact, and samples of every flight.
    maps : array (map_time,) [s], optional
        Instants at which to give the pressure and the shape of the surface.
    ring_width : float [m], optional
        Of "rings" and "thesis"; by default from ``rtol``, and 4e-5.
    time_step : float [s], optional
        Of "thesis"; default 2e-4.
    fold : bool
        Fold terms far below the contact's time scale into one, and freeze those far above
        ``duration``, where this costs less than a hundredth of ``rtol``.
    compiled : bool
        Take the steps in compiled code (numba); False takes them in numpy, to the same answer. So
        does, with a warning, a process in which numba cannot be loaded or keep its code.
    shortcuts : Shortcuts
        Which parts of the work are left out; the answer is the same within `rtol`.
    max_steps : int
        Refuse rather than take more steps.
    progress : callable, optional
        Called now and then with the fraction of ``duration`` that is done.

    Returns
    -------
    Dataset
        Over ``time`` [s]: ``displacement`` [m], upwards positive, ``height`` at the release, 0 at
        first touch, negative when pressed in; ``velocity`` [m/s], upwards positive; ``approach``
        [m], of the bodies, inwards positive; ``force`` [N]; ``contact_radius`` [m]; the ledger
        ``kinetic_energy``, ``potential_energy``, ``stored_energy``, ``dissipated_energy`` and
        ``numerical_energy`` [J], whose sum is constant; with a plate ``plate_displacement``
        (downwards positive) and ``plate_energy``.
        Over ``impact``, one row per completed bounce: ``impact_time``, ``lift_off_time``,
        ``contact_duration`` [s], ``impact_speed``, ``rebound_speed`` [m/s], ``restitution``,
        ``peak_force`` [N], ``peak_contact_radius``, ``peak_approach`` [m], ``energy_dissipated``,
        ``energy_stored`` (still held by the dent at lift-off) [J].
        Scalars: ``final_contact_time``, the touch after which it never lifts off again, and
        ``rest_time``, after which it only creeps; NaN if ``duration`` ends before. With a plate
        ``rigid_restitution``, that of the first impact on a rigid substrate.
        With ``maps``, over (``map_time``, ``r``): ``pressure`` [Pa] and ``surface`` [m], the
        displacement of the sphere's surface towards its centre, up to 1.25 times the largest
        contact radius.
        ``attrs["work"]`` is JSON: steps, kernel products, flights, terms and springs used, seconds.

    Raises
    ------
    InputError
        A value is out of range; the contact would be wider than the sphere; the material damps so
        little that ``max_steps`` do not reach ``duration``.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> acrylic = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
    >>> result = drop(acrylic, radius=9.525e-3, mass=0.505, height=1.5e-3, duration=0.05)
    >>> [round(float(e), 3) for e in result.restitution]
    [0.729, 0.718]

    Notes
    -----
    Thesis equations (3.1)-(3.9), without its time stepping. The ledger counts the work on every
    spring exactly for the loads as they were assumed inside a step, so that what it calls
    dissipated never decreases; ``numerical_energy`` is what the discretisation mislaid, a measure
    of its error.
    """
    started = perf_counter()
    setting = checked(
        Setting(radius, mass, height, duration, solver, profile, rtol, gravity, plate)
    )
    wanted = None if times is None else checked_times("times", times, duration)
    looks = None if maps is None else checked_times("maps", maps, duration)
    creep = Creep.of(material)
    speed = sqrt(2.0 * gravity * height)
    observe = None if progress is None else _Throttle(progress, setting)
    if solver == "thesis":
        if looks is not None:
            message = 'the thesis\'s scheme draws no maps; use solver "rings" or "mdr"'
            raise InputError(message)
        thesis = drop_thesis(
            creep,
            radius,
            mass,
            gravity,
            speed,
            max(duration - setting.fall_time, 0.0),
            MARGIN * 2.0 * scales(creep, radius, mass, gravity, speed).radius,
            ring_width=RING_WIDTH if ring_width is None else ring_width,
            time_step=TIME_STEP if time_step is None else time_step,
            profile=profile,
            observe=observe,
        )
        return thesis_dataset(thesis, setting, wanted, perf_counter() - started)
    effort = Effort(rtol, ring_width, fold, compiled and _can_compile(), max_steps, shortcuts)
    run, mislaid = _refined(setting, creep, effort, looks, observe)
    rigid = None if plate is None else _rigid_restitution(setting, creep, effort)
    result = dataset(run, setting, wanted, rigid, perf_counter() - started)
    result.attrs["energy_error"] = mislaid
    return result


def _can_compile() -> bool:
    """Look whether steps can be compiled; if not, say so once per drop."""
    reason = why_not_compiled()
    if reason:
        warnings.warn(reason, UserWarning, stacklevel=3)
    return not reason


def _refined(
    setting: Setting,
    creep: Creep,
    effort: Effort,
    looks: Array | None,
    observe: Callable[[float], None] | None,
) -> tuple[DropRun, float]:
    """Simulate, and again more finely when the first run says that it was too coarse.

    It happens where the instantaneous compliance hardly matters (a modulus ratio beyond 1e3 with
    few terms): the pressure then ends in a step at the edge, and long steps ring. Returns also the
    energy mislaid, relative to that of the drop.
    """
    finer = replace(effort, rtol=effort.rtol / _REFINEMENT)
    may_refine = finer.rtol >= _FINEST
    try:
        run = _simulate(setting, creep, effort, looks, observe)
        mislaid = mislaid_energy(run, setting)
    except AnnularContactError:
        if not may_refine:
            raise
        mislaid = inf
    if mislaid > _ENERGY_LIMIT * setting.rtol and may_refine:
        run = _simulate(setting, creep, finer, looks, observe)
        mislaid = mislaid_energy(run, setting)
    if mislaid <= _ENERGY_LIMIT * setting.rtol:
        return run, mislaid
    message = (
        f"the discretisation mislaid {mislaid:.1e} of the drop's energy, more than rtol = "
        f"{setting.rtol:.0e} leads to expect; restitution and forces are about that uncertain. "
        "A smaller rtol improves them"
    )
    warnings.warn(message, UserWarning, stacklevel=3)
    return run, mislaid


@dataclass(slots=True)
class _Throttle:
    """Hand on the progress whenever another part of the duration is done."""

    progress: Callable[[float], None]
    setting: Setting
    told: float = 0.0

    def __call__(self, time: float) -> None:
        done = min((self.setting.fall_time + time) / self.setting.duration, 1.0)
        if done >= self.told + _PROGRESS_EVERY:
            self.told = done
            self.progress(done)


def _stepper(
    setting: Setting,
    creep: Creep,
    expected: Scales,
    effort: Effort,
    observe: Callable[[float], None] | None,
) -> Stepper:
    if expected.radius > setting.radius:
        message = (
            f"the contact would be about {expected.radius:.3g} m in radius, wider than the sphere "
            f"({setting.radius:.3g} m): small-strain contact does not hold; use a stiffer "
            "material, a smaller mass or a lower drop"
        )
        raise InputError(message)
    return Stepper(
        creep=creep,
        springs=springs_for(setting, creep, expected, effort),
        body=Body(setting.mass, setting.gravity, setting.plate),
        tolerance=step_tolerance(effort.rtol),
        time_scale=expected.duration,
        speed_scale=max(setting.speed, expected.rest_speed),
        largest_radius=setting.radius,
        expected_radius=MARGIN * expected.radius,
        max_steps=effort.max_steps,
        is_compiled=effort.compiled,
        only_near=effort.shortcuts.near,
        observe=observe,
    )


def _refuse_endless(setting: Setting, creep: Creep, expected: Scales, effort: Effort) -> None:
    """Refuse an elastic sphere that would bounce more often than there are steps."""
    is_damped = creep.n_terms or creep.fluidity or (setting.plate and setting.plate.damping_ratio)
    cycle = expected.duration + 2.0 * setting.speed / setting.gravity
    needed = steps_per_contact(effort.rtol) * setting.duration / cycle
    if not is_damped and needed > effort.max_steps:
        message = (
            f"an elastic sphere never stops: {setting.duration:.4g} s would take about "
            f"{needed:.2g} steps, more than max_steps = {effort.max_steps}; shorten the duration, "
            "raise max_steps, or give the material a loss"
        )
        raise InputError(message)


def _simulate(
    setting: Setting,
    creep: Creep,
    effort: Effort,
    looks: Array | None,
    observe: Callable[[float], None] | None,
    *,
    first_contact_only: bool = False,
) -> DropRun:
    """Fall, bounce, rest."""
    expected = scales(creep, setting.radius, setting.mass, setting.gravity, setting.speed)
    condensed = Condensed(creep, 0, 0)
    if effort.fold:
        tolerance = _CONDENSE_SHARE * effort.rtol
        condensed = condense(creep, expected.duration, setting.duration, tolerance)
    _refuse_endless(setting, condensed.creep, expected, effort)
    stepper = _stepper(setting, condensed.creep, expected, effort, observe)
    end = setting.duration - setting.fall_time
    if looks is not None:
        stepper.wanted = np.minimum(looks - setting.fall_time, end).tolist()
    # Rings touch first at the middle of the innermost, a little after the pole would.
    touch = _fall_further(setting, float(stepper.springs.gap[0]))
    fall = _at_release(setting)
    silent = np.zeros(condensed.creep.rate.size)
    segments: list[Segment] = [Flight(fall, min(touch, end), silent, condensed.creep.rate)]
    final_touch = rest_start = nan
    stepper.velocity, stepper.acceleration = setting.speed, setting.gravity
    if touch < end:
        stepper.fly(touch)
        stillness = min(max(effort.rtol, _REST_RANGE[0]), _REST_RANGE[1])
        rest = RestTest(
            stillness if effort.shortcuts.rest else 0.0,
            max(expected.rest_period, 1.0 / setting.plate.frequency if setting.plate else 0.0),
            expected.rest_speed,
        )
        final_touch, rest_start = _bounce(stepper, rest, end, segments, effort, first_contact_only)
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


def _at_release(setting: Setting) -> Record:
    height, rest = -setting.height, PlateState()
    return Record(-setting.fall_time, height, 0.0, height, 0.0, 0.0, 0.0, 0.0, rest, 0.0)


def _bounce(
    stepper: Stepper,
    rest: RestTest,
    end: float,
    segments: list[Segment],
    effort: Effort,
    first_contact_only: bool,
) -> tuple[float, float]:
    """Alternate contacts and flights; return the last touch and the start of rest, or NaN."""
    reach = stepper.expected_radius
    least_speed = _SLOWEST_BOUNCE * rest.speed
    while True:
        touched = stepper.time
        stepper.speed_scale = max(stepper.velocity, least_speed)
        rest.restart(touched)
        outcome, flight = _one_contact(stepper, rest, end, reach)
        records = stepper.take_trail()
        segments.append(Contact(records))
        if outcome == "rest":
            settled = stepper.time
            settle(stepper, end, growth(effort.rtol))
            creeping = stepper.take_trail()
            if creeping:
                segments.append(Contact((records[-1], *creeping), is_resting=True))
            return touched, settled
        if outcome == "end":
            return nan, nan
        stop = min(stepper.time + flight, end)
        stored = stepper.free_stored()
        segments.append(Flight(records[-1], stop, stored, stepper.creep.rate))
        if stop >= end or first_contact_only:
            stepper.look_at_dent(end)
            return nan, nan
        _fly(stepper, flight, in_one_step=effort.shortcuts.flights)
        reach = MARGIN * max(record.contact_radius for record in records)


def _fly(stepper: Stepper, flight: float, *, in_one_step: bool) -> None:
    """Move through a flight [s], which is exact in one step and in many."""
    steps = 1 if in_one_step else ceil(flight / (LONGEST * stepper.time_scale))
    for _ in range(steps):
        stepper.fly(flight / steps)
    stepper.counts.flights += 1
    stepper.counts.solver_steps += steps - 1


def _one_contact(stepper: Stepper, rest: RestTest, end: float, reach: float) -> tuple[str, float]:
    """Run one contact; return how it ends, and the time of flight after a lift-off."""
    stepper.touch(reach)
    while True:
        outcome = stepper.run(end, rest)
        if outcome != "lift-off":
            return outcome, 0.0
        flight = _time_of_flight(stepper)
        if flight > 0.0:
            return outcome, flight
        # The surface follows the sphere at once: no bounce, the contact goes on.
        stepper.touch(reach, is_new=False)


def _time_of_flight(stepper: Stepper) -> float:
    body, dent, rate = stepper.body, stepper.memory[:, 0], stepper.creep.rate
    if body.plate is None:
        return time_to_touch(stepper.velocity, body.gravity, dent, rate)
    return time_to_touch_plate(
        stepper.velocity, body.gravity, dent, rate, body.plate, stepper.plate
    )


def _rigid_restitution(setting: Setting, creep: Creep, effort: Effort) -> float:
    """Restitution of the first impact on a rigid substrate; NaN when it does not lift off."""
    rigid = replace(setting, plate=None)
    run = _simulate(rigid, creep, effort, None, None, first_contact_only=True)
    if len(run.segments) < 3 or not isinstance(run.segments[2], Flight):
        return nan
    contact = run.segments[1]
    assert isinstance(contact, Contact)  # noqa: S101 - the second segment follows the fall
    return -contact.records[-1].velocity / contact.records[0].velocity

"""Drop a viscoelastic sphere on a rigid flat and follow every bounce until it rests.

The bounces are simulated in :mod:`._simulate`, which is imported by the first drop
only: its steps are compiled, and loading the compiler takes a second.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, nan, sqrt
from time import perf_counter

import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.contact.impact._checks import Solver, checked, checked_times, warn_of_millimetres
from labpipe.contact.impact._dataset import DropRun, Setting, dataset, energy_error, thesis_dataset
from labpipe.contact.impact._line_springs import Profile
from labpipe.contact.impact._motion import AnnularContactError
from labpipe.contact.impact._plate import Plate
from labpipe.contact.impact._setup import ALL_SHORTCUTS, MARGIN, Effort, Shortcuts, scales
from labpipe.contact.impact._thesis_scheme import RING_WIDTH, TIME_STEP, drop_thesis
from labpipe.contact.impact._trajectory import Contact, Flight
from labpipe.contact.memory import Creep
from labpipe.errors import InputError
from labpipe.materials import Solid, solid
from labpipe.units import Measure, si

# Progress is told at steps of this part of the duration.
_PROGRESS_EVERY = 0.01
# A run that mislays more than this times rtol of the drop's energy (usual are 0.4 for one impact
# and 0.8 for a long train) is repeated once with rtol divided by the refinement, down to the limit.
MAX_STEPS = 1_000_000
ENERGY_LIMIT, _REFINEMENT, _FINEST = 5.0, 10.0, 1e-6


def drop(
    material: Solid,
    radius: Measure,
    mass: Measure,
    height: Measure,
    duration: Measure,
    solver: Solver = "mdr",
    profile: Profile = "parabola",
    rtol: float = 1e-4,
    *,
    gravity: Measure = 9.81,
    plate: Plate | None = None,
    times: ArrayLike | None = None,
    maps: ArrayLike | None = None,
    ring_width: float | None = None,
    time_step: float | None = None,
    fold: bool = True,
    shortcuts: Shortcuts = ALL_SHORTCUTS,
    max_steps: int = MAX_STEPS,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Drop a viscoelastic sphere on a rigid flat.

    Lengths, mass and times are numbers in SI or texts with a unit, ``"9.525 mm"``.

    Parameters
    ----------
    material : labpipe.materials.Prony, or str
        Of the sphere (or of the flat, if the sphere is the rigid one); a name or a file as
        :func:`labpipe.materials.solid` takes it.
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
        [m], of the bodies, inwards positive; ``reduced_gap`` [m], ``z_O - R + w`` on the axis, with
        ``w`` the displacement of the surface there: 0 in contact, positive in flight, in which the
        dent that is left counts; ``force`` [N]; ``contact_radius`` [m]; the ledger
        ``kinetic_energy``, ``potential_energy``, ``stored_energy``, ``dissipated_energy`` and
        ``numerical_energy`` [J], whose sum is constant; with a plate ``plate_displacement``
        (downwards positive) and ``plate_energy``.
        Over ``impact``, one row per completed bounce: ``impact_time``, ``lift_off_time``,
        ``contact_duration`` [s], ``impact_speed``, ``rebound_speed`` [m/s], ``restitution``,
        ``peak_force`` [N], ``peak_contact_radius``, ``peak_approach`` of sphere and substrate,
        ``penetration`` of the sphere below its level at touch [m], ``energy_dissipated``,
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

    Warns
    -----
    UserWarning
        The radius looks like millimetres; or the result is less accurate than asked for.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> acrylic = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
    >>> result = drop(acrylic, radius=9.525e-3, mass=0.505, height=1.5e-3, duration=0.05)
    >>> [round(float(e), 3) for e in result.restitution]
    [0.729, 0.718]

    Notes
    -----
    Thesis equations (3.1)-(3.9), without its time stepping. With "mdr" every contact up to a
    lift-off is collocated: Ting's solution (doi:10.1115/1.3625192) on the dents of the bounces
    before it. The contact in which the sphere comes to rest, or that grows again before it lifts
    off, is stepped spring by spring, as are all contacts of "rings", a run with ``maps`` and one
    without shortcuts. What the ledger calls dissipated never decreases; ``numerical_energy`` is the
    numerical energy error, a measure of the error of the run.
    """
    started = perf_counter()
    warn_of_millimetres(radius, mass, height)
    material, gravity = solid(material), si(gravity, "m/s2", "gravity")
    radius, mass = si(radius, "m", "radius"), si(mass, "kg", "mass")
    height, duration = si(height, "m", "height"), si(duration, "s", "duration")
    setting = checked(Setting(radius, mass, height, duration, solver, profile, rtol, gravity, plate))
    wanted = None if times is None else checked_times("times", times, duration)
    looks = None if maps is None else checked_times("maps", maps, duration)
    creep = Creep.of(material)
    speed = sqrt(2.0 * gravity * height)
    observe = None if progress is None else _Throttle(progress, setting)
    if solver == "thesis":
        if looks is not None:
            raise InputError('the thesis\'s scheme draws no maps; use solver "rings" or "mdr"')
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
    effort = Effort(rtol, ring_width, fold, max_steps, shortcuts)
    run, error = refined(setting, creep, effort, looks, observe)
    rigid = None if plate is None else _rigid_restitution(setting, creep, effort)
    result = dataset(run, setting, wanted, rigid, perf_counter() - started)
    result.attrs["energy_error"] = error
    return result


def refined(
    setting: Setting, creep: Creep, effort: Effort, looks: Floats | None, observe: Callable[[float], None] | None
) -> tuple[DropRun, float]:
    """Simulate, and again more finely when the first run says that it was too coarse.

    It happens where the instantaneous compliance hardly matters (a modulus ratio beyond 1e3 with
    few terms): the pressure then ends in a step at the edge, and long steps ring. Returns also the
    numerical energy error, relative to the energy of the drop.
    """
    from labpipe.contact.impact._simulate import simulate

    finer = replace(effort, rtol=effort.rtol / _REFINEMENT)
    may_refine = finer.rtol >= _FINEST
    try:
        run = simulate(setting, creep, effort, looks, observe)
        error = energy_error(run, setting)
    except AnnularContactError:
        if not may_refine:
            raise
        error = inf
    if error > ENERGY_LIMIT * setting.rtol and may_refine:
        run = simulate(setting, creep, finer, looks, observe)
        error = energy_error(run, setting)
    if error <= ENERGY_LIMIT * setting.rtol:
        return run, error
    message = (
        f"the numerical energy error is {error:.1e} of the drop's energy, more than expected for rtol = "
        f"{setting.rtol:.0e}; restitution and forces are uncertain by about as much. A smaller rtol reduces it"
    )
    warnings.warn(message, UserWarning, stacklevel=3)
    return run, error


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


def _rigid_restitution(setting: Setting, creep: Creep, effort: Effort) -> float:
    """Restitution of the first impact on a rigid substrate; NaN when it does not lift off."""
    from labpipe.contact.impact._simulate import simulate
    from labpipe.contact.impact._trains import COLUMNS, follow

    rigid = replace(setting, plate=None)
    if setting.solver == "mdr" and effort.shortcuts == ALL_SHORTCUTS:
        found = follow(creep, [rigid], 1, ENERGY_LIMIT * setting.rtol, fold=effort.fold)
        if not found.is_left[0]:
            row = dict(zip(COLUMNS, found.rows[0, 0].tolist(), strict=True))
            return row["rebound_speed"] / row["impact_speed"]
    run = simulate(rigid, creep, replace(effort, rows_only=True), None, None, first_contact_only=True)
    if len(run.segments) < 3 or not isinstance(run.segments[2], Flight):
        return nan
    contact = run.segments[1]
    assert isinstance(contact, Contact)  # noqa: S101 - the second segment follows the fall
    velocity = contact.records["velocity"]
    return float(-velocity[-1] / velocity[0])

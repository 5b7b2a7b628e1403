"""Drop a viscoelastic sphere on a flat: one drop with every bounce until it rests, or the first impacts of many."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import ceil, nan
from time import perf_counter
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.contact._memory import Creep, checked_times
from labpipe.contact._thesis_scheme import RING_WIDTH, TIME_STEP, drop_thesis
from labpipe.contact.impact._dataset import batch_dataset, dataset, thesis_dataset
from labpipe.contact.impact._records import Tables
from labpipe.contact.impact._rings import Profile, influence, surface_gap
from labpipe.contact.impact._setting import MAX_STEPS, Plate, Scales, Setting, Solver, exact, warn_of_millimetres
from labpipe.contact.impact._train import COLUMNS, MARGIN, Train
from labpipe.contact.sphere import Substrate, counter_compliance
from labpipe.errors import InputError
from labpipe.materials import Solid, solid
from labpipe.units import Measure

# A run that mislays more than this times rtol of the drop's energy says so; usual are 0.4 for one impact and 0.8 for a
# long train.
_ENERGY_LIMIT = 5.0


def drop(
    material: Solid,
    radius: Measure | None = None,
    mass: Measure | None = None,
    height: Measure | None = None,
    duration: Measure | None = None,
    solver: Solver = "mdr",
    profile: Profile = "parabola",
    rtol: float = 1e-4,
    *,
    gravity: Measure = 9.81,
    plate: Plate | None = None,
    substrate: Substrate = None,
    times: ArrayLike | None = None,
    ring_width: float | None = None,
    time_step: float | None = None,
    full: bool = False,
    max_steps: int = MAX_STEPS,
    progress: Callable[[float], None] | None = None,
    diameter: Measure | None = None,
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
        Independent springs; rings of constant pressure (boundary elements), a separate way to the same answer; or the
        thesis's own scheme, as a reference only.
    profile : "parabola" or "sphere"
        Gap ``r^2/2R`` or the exact sphere; they differ by 0.1 % in force at a contact of a tenth of the radius.
    rtol : float
        Relative error to aim at for restitution, peak force and touch times, 1e-8 to 1e-2.
    gravity : float [m/s2]
        Default as in the references, 9.81.
    plate : Plate, optional
        Lets the substrate ring; by default it is rigid.
    substrate : "sapphire", (float [Pa], float) or None
        Elastic counter-body: a name, or Young's modulus and Poisson's ratio; None is a rigid one.
    times : array (time,) [s], optional
        Where to report; by default every step in contact, and samples of every flight.
    ring_width : float [m], optional
        Of "rings" and "thesis"; by default from ``rtol``, and 4e-5.
    time_step : float [s], optional
        Of "thesis"; default 2e-4.
    full : bool
        Leave nothing out; the answer is the same within `rtol`. Otherwise terms far below the contact's time scale are
        folded into one and those far above ``duration`` frozen; contacts up to a lift-off are collocated; and the creep
        of a sphere at rest is followed in few steps.
    max_steps : int
        Refuse rather than take more steps.
    progress : callable, optional
        Called now and then with the fraction of ``duration`` that is done.
    diameter : float [m], optional
        Not taken: the error says which radius to give.

    Returns
    -------
    Dataset
        Over ``time`` [s]: ``displacement`` [m], upwards positive, ``height`` at the release, 0 at first touch, negative
        when pressed in; ``velocity`` [m/s], upwards positive; ``approach`` [m], of the bodies, inwards positive;
        ``reduced_gap`` [m], ``z_O - R + w`` on the axis, with ``w`` the displacement of the surface: 0 in contact,
        positive in flight, in which the dent that is left counts; ``force`` [N]; ``contact_radius`` [m]; the ledger
        ``kinetic_energy``, ``potential_energy``, ``stored_energy``, ``dissipated_energy`` and ``numerical_energy`` [J],
        whose sum is constant; with a plate ``plate_displacement`` (downwards positive) and ``plate_energy``.
        Over ``impact``, one row per completed bounce: ``impact_time``, ``lift_off_time``, ``contact_duration`` [s],
        ``impact_speed``, ``rebound_speed`` [m/s], ``restitution``, ``peak_force`` [N], ``peak_pressure`` [Pa], Hertz's
        3F/(2πa²) of the largest force and radius, ``peak_contact_radius``, ``peak_approach`` of sphere and substrate,
        ``penetration`` of the sphere below its level at touch [m], ``energy_dissipated``, ``energy_stored`` (still held
        by the dent at lift-off) [J].
        Scalars: ``final_contact_time``, the touch after which it never lifts off again, and ``rest_time``, after which
        it only creeps; NaN if ``duration`` ends before. With a plate ``rigid_restitution``, that of the first impact on
        a rigid substrate. ``attrs["work"]`` is JSON: steps, kernel products, flights, terms and springs used, seconds.

    Raises
    ------
    InputError
        A value is missing, out of range, or states an uncertainty; the contact would be wider than
        the sphere; the material damps so little that ``max_steps`` do not reach ``duration``.

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
    Thesis equations (3.1)-(3.9), without its time stepping. With "mdr" every contact up to a lift-off is collocated:
    Ting's solution (doi:10.1115/1.3625192) on the dents of the bounces before it. The contact in which the sphere comes
    to rest, or that grows again before it lifts off, is stepped spring by spring, as are all contacts of "rings" and of
    a full run. ``numerical_energy`` is a measure of the error of the run.
    """
    started = perf_counter()
    if diameter is not None:
        half = exact(diameter, "radius") / 2.0
        raise InputError(f'drop takes the radius: for diameter={diameter} give radius="{half * 1e3:.6g} mm"')
    given = {"radius": radius, "mass": mass, "height": height, "duration": duration}
    if missing := [name for name, value in given.items() if value is None]:
        raise InputError(f"drop needs {', '.join(missing)} as well")
    r, m, h, t = (exact(value, name) for name, value in given.items() if value is not None)
    warn_of_millimetres(radius or r, mass or m, height or h)
    setting = Setting(r, m, h, t, solver, profile, rtol, exact(gravity, "gravity"), plate, ring_width, full, max_steps)
    wanted = None if times is None else checked_times(times, t)
    creep = Creep.of(solid(material)).on(counter_compliance(substrate))
    expected = Scales.of(creep, setting)
    observe = None if progress is None else lambda since: progress(min((setting.fall_time + since) / t, 1.0))
    if solver == "thesis":
        width = RING_WIDTH if ring_width is None else ring_width
        count = ceil(MARGIN * 2.0 * expected.radius / width) + 1
        if count < 3:
            raise InputError(f"rings of {width:.3g} m: {count} in the contact, expected 3 or more")
        middle = np.linspace(0.5, count - 0.5, count) * width
        rings = influence(count) * width, surface_gap(middle, r, profile), width
        step, lasts = TIME_STEP if time_step is None else time_step, max(t - setting.fall_time, 0.0)
        run, work = drop_thesis(rings, creep.compliance, m, setting.gravity, setting.speed, lasts, step, observe)
        return thesis_dataset(run, work, setting, wanted, perf_counter() - started)
    tables = Tables.of(creep, expected.duration, t, rtol, fold=not full)
    train = Train(setting, tables, expected, None, observe, None if wanted is None else wanted - setting.fall_time)
    _run(train)
    rigid = None
    if plate is not None:
        rows = Train(replace(setting, plate=None, rows_only=True), tables, expected, 1).run().rows
        rigid = rows[0][COLUMNS.index("restitution")] if rows else nan
    return dataset(train, setting, wanted, rigid, perf_counter() - started)


def impacts(
    material: Solid | Sequence[Solid],
    radius: Measure | Sequence[Measure],
    mass: Measure | Sequence[Measure],
    height: Measure | Sequence[Measure],
    duration: Measure | Sequence[Measure],
    most: int = 1,
    profile: Profile = "parabola",
    rtol: float = 1e-4,
    *,
    gravity: Measure | Sequence[Measure] = 9.81,
    plate: Plate | Sequence[Plate | None] | None = None,
    substrate: Substrate | list[Substrate] = None,
) -> xr.Dataset:
    """Simulate the first impacts of many drops.

    The same answers as :func:`drop` within ``rtol``, at a fraction of its time. An argument given as a sequence has an
    entry for each drop; the others are shared.

    Parameters
    ----------
    material, radius, mass, height, duration, profile, rtol, gravity, plate, substrate
        As of :func:`drop`, its solver "mdr"; a list of substrates has an entry for each drop.
    most : int
        Impacts per drop, at most.

    Returns
    -------
    Dataset
        Over (``drop``, ``impact``), NaN for impacts that do not happen within the duration: the rows of :func:`drop`
        but pressure and energies. Over ``drop``: ``impacts``, how many happened; ``final_contact_time`` [s] as of
        :func:`drop`, NaN unless it came among these; ``solver_steps``. ``attrs["work"]`` is JSON.

    Raises
    ------
    InputError
        A value is out of range, sequences differ in length, or as :func:`drop`.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> acrylic = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
    >>> found = impacts(acrylic, "9.525 mm", "505 g", ["1 mm", "1.5 mm", "2 mm"], "40 ms")
    >>> found.restitution.values[:, 0].round(3).tolist()
    [0.722, 0.729, 0.733]
    """
    if most < 1:
        raise InputError(f"most is {most} impacts, expected at least 1")
    given: dict[str, Any] = {"radius": radius, "mass": mass, "height": height, "duration": duration}
    given |= {"gravity": gravity, "plate": plate, "material": material}
    under = list(map(counter_compliance, substrate)) if isinstance(substrate, list) else counter_compliance(substrate)
    given["substrate"] = under
    lengths = {name: len(values) for name, values in given.items() if isinstance(values, list | tuple | np.ndarray)}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise InputError(f"arguments given drop by drop must have an entry for each: {counts}")
    count = next(iter(lengths.values()), 1)
    drops = zip(*(values if name in lengths else [values] * count for name, values in given.items()), strict=True)
    alike = dict[Any, list[tuple[int, Solid, Setting]]]()
    for i, (*numbers, plate_of_one, of_one, compliance) in enumerate(drops):
        r, m, h, t, g = (exact(value, name) for value, name in zip(numbers, given, strict=False))
        warn_of_millimetres(*numbers[:3])
        one = Setting(r, m, h, t, "mdr", profile, rtol, g, plate_of_one, rows_only=True)
        key = of_one if isinstance(of_one, str) else id(of_one), compliance
        alike.setdefault(key, []).append((i, of_one, one))
    trains: dict[int, Train] = {}
    for (_, compliance), group in alike.items():
        creep = Creep.of(solid(group[0][1])).on(compliance)
        expected = [Scales.of(creep, one) for _, _, one in group]
        longest = max(one.duration for _, _, one in group)
        tables = Tables.of(creep, min(scale.duration for scale in expected), longest, rtol, fold=True)
        for (i, _, one), scale in zip(group, expected, strict=True):
            trains[i] = _run(Train(one, tables, scale, most))
    return batch_dataset([trains[i] for i in range(count)], most)


def _run(train: Train) -> Train:
    """Run a drop; warn of a larger numerical error than its tolerance stands for (a modulus ratio over 1e3)."""
    if not train.run().error <= _ENERGY_LIMIT * train.setting.rtol:
        warnings.warn(
            f"the numerical energy error is {train.error:.1e} of the drop's energy, more than expected for rtol = "
            f"{train.setting.rtol:.0e}; restitution and forces are uncertain by about as much. A smaller rtol reduces "
            "it",
            UserWarning,
            stacklevel=3,
        )
    return train

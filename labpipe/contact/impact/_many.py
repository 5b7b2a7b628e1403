"""The first impacts of many drops at once: tables of a material made once, one compiled call a contact, one result."""

import json
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from labpipe.arrays import Floats, Integers
from labpipe.contact.impact._checks import checked, warn_of_millimetres
from labpipe.contact.impact._dataset import ROWS, SCALARS, Setting, impact_rows
from labpipe.contact.impact._drop import ENERGY_LIMIT, MAX_STEPS, refined
from labpipe.contact.impact._line_springs import Profile
from labpipe.contact.impact._plate import Plate
from labpipe.contact.impact._setup import Effort
from labpipe.contact.memory import Creep
from labpipe.errors import InputError
from labpipe.materials import Solid, solid
from labpipe.units import Measure, si
from labpipe.variables import variable


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
    fold: bool = True,
) -> xr.Dataset:
    """Simulate the first impacts of many drops.

    The same answers as :func:`drop` within ``rtol``, at a fraction of its time: nothing is made but
    the rows of the impacts, and what a material needs is made once for all its drops. Whatever is
    given as a sequence has an entry for each drop; the rest is shared.

    Parameters
    ----------
    material, radius, mass, height, duration, profile, rtol, gravity, plate, fold
        As of :func:`drop`, its solver "mdr".
    most : int
        Impacts per drop, at most.

    Returns
    -------
    Dataset
        Over (``drop``, ``impact``), NaN for what does not happen within the duration:
        ``impact_time``, ``lift_off_time``, ``contact_duration`` [s], ``impact_speed``,
        ``rebound_speed`` [m/s], ``restitution``, ``peak_force`` [N], ``peak_contact_radius``,
        ``peak_approach``, ``penetration`` [m]. Over ``drop``: ``impacts``, how many happened;
        ``final_contact_time`` [s] as of :func:`drop`, NaN unless it came among these; ``solver_steps``.
        ``attrs["work"]`` is JSON: steps, rejected ones, impacts, and drops that were left to
        :func:`drop`, because the sphere stays or touches twice in one contact.

    Raises
    ------
    InputError
        A value is out of range, sequences differ in length, or as :func:`drop`.

    Warns
    -----
    UserWarning
        As :func:`drop`, for a drop that was left to it.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> acrylic = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
    >>> found = impacts(acrylic, "9.525 mm", "505 g", ["1 mm", "1.5 mm", "2 mm"], "40 ms")
    >>> found.restitution.values[:, 0].round(3).tolist()
    [0.731, 0.729, 0.727]
    """
    from labpipe.contact.impact._trains import COLUMNS, follow

    if most < 1:
        raise InputError(f"most is {most} impacts, expected at least 1")
    given = {
        "material": material,
        "radius": radius,
        "mass": mass,
        "height": height,
        "duration": duration,
        "gravity": gravity,
        "plate": plate,
    }
    cases = _cases(given, profile, rtol)
    rows = np.full((len(cases), most, len(COLUMNS)), np.nan)
    work, final, n_left = np.zeros((len(cases), 3), np.int64), np.full(len(cases), np.nan), 0
    for numbers in _by_material(cases):
        creep = Creep.of(solid(cases[numbers[0]].material))
        found = follow(creep, [cases[i].setting for i in numbers], most, ENERGY_LIMIT * rtol, fold=fold)
        rows[numbers], work[numbers] = found.rows, found.work
        for i in (i for i, leave in zip(numbers, found.is_left.tolist(), strict=True) if leave):
            rows[i], work[i, 0], final[i] = _one_by_one(cases[i], creep, most, COLUMNS, fold=fold)
            n_left += 1
    return _dataset(COLUMNS, rows, work, final, n_left)


class _Case(NamedTuple):
    """One drop."""

    material: Solid
    setting: Setting


def _cases(given: Mapping[str, Any], profile: Profile, rtol: float) -> list[_Case]:
    """Lay out the drops, each checked, from what is given for all or drop by drop."""
    lengths = {name: count for name, values in given.items() if (count := _count(values)) is not None}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise InputError(f"what is given drop by drop must have an entry for each: {told}")
    count = next(iter(lengths.values()), 1)
    columns = [values if name in lengths else [values] * count for name, values in given.items()]
    units = (("radius", "m"), ("mass", "kg"), ("height", "m"), ("duration", "s"), ("gravity", "m/s2"))
    cases = []
    for solid_of_one, *numbers, plate_of_one in zip(*columns, strict=True):
        r, m, h, t, g = (si(value, unit, name) for value, (name, unit) in zip(numbers, units, strict=True))
        setting = Setting(r, m, h, t, "mdr", profile, rtol, g, plate_of_one)
        cases.append(_Case(solid_of_one, checked(setting)))
    return cases


def _count(values: object) -> int | None:
    """Return how many entries something has that is given drop by drop."""
    return len(values) if isinstance(values, list | tuple | np.ndarray) else None


def _by_material(cases: Sequence[_Case]) -> list[list[int]]:
    """Gather the numbers of the drops of each material."""
    known: dict[Hashable, list[int]] = {}
    for i, (material, _) in enumerate(cases):
        known.setdefault(material if isinstance(material, str) else id(material), []).append(i)
    return list(known.values())


def _one_by_one(
    case: _Case, creep: Creep, most: int, columns: Sequence[str], *, fold: bool
) -> tuple[Floats, int, float]:
    """Rows (impact, column) of the general solver, its steps, and the touch after which it stays."""
    setting = case.setting
    warn_of_millimetres(setting.radius, setting.mass, setting.height)
    run, _ = refined(setting, creep, Effort(setting.rtol, None, fold, MAX_STEPS, rows_only=True), None, None)
    found = impact_rows(run, setting)
    rows = np.full((most, len(columns)), np.nan)
    happened = min(found["impact_time"].size, most)
    rows[:happened] = np.stack([found[name][:happened] for name in columns], axis=1)
    final = run.final_touch + setting.fall_time if found["impact_time"].size < most else np.nan
    return rows, run.counts.solver_steps, final


def _dataset(columns: Sequence[str], rows: Floats, work: Integers, final: Floats, n_left: int) -> xr.Dataset:
    """Assemble the result."""
    values = dict(zip(columns, np.moveaxis(rows, 2, 0), strict=True))
    values["contact_duration"] = values["lift_off_time"] - values["impact_time"]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = values["rebound_speed"] / values["impact_speed"]
    values["restitution"] = np.where(values["impact_speed"] > 0.0, ratio, np.nan)
    made: dict[str, object] = {name: variable(("drop", "impact"), value, *ROWS[name]) for name, value in values.items()}
    happened = np.isfinite(values["lift_off_time"]).sum(axis=1)
    made["impacts"] = variable("drop", happened, "1", "impacts that happened, at most those asked for")
    made["final_contact_time"] = variable("drop", final, *SCALARS["final_contact_time"])
    made["solver_steps"] = variable("drop", work[:, 0], "1", "steps of the solver")
    total = work.sum(axis=0).tolist()
    counts = {"solver_steps": total[0], "rejected_steps": total[1], "impacts": total[2], "left_to_drop": n_left}
    return xr.Dataset(made, attrs={"work": json.dumps(counts)})

"""The first impacts of many drops: tables of a material made once, drops side by side on all processors."""

import json
from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from labpipe.contact.impact._bounce import Tables
from labpipe.contact.impact._dataset import ROWS, SCALARS
from labpipe.contact.impact._drop import MAX_STEPS, refined
from labpipe.contact.impact._plate import Plate
from labpipe.contact.impact._setting import Setting, exact, warn_of_millimetres
from labpipe.contact.impact._setup import Effort, scales
from labpipe.contact.impact._springs import Profile
from labpipe.contact.impact._train import COLUMNS, Train
from labpipe.contact.memory import Creep
from labpipe.contact.sphere import Substrate, counter_compliance
from labpipe.errors import InputError
from labpipe.materials import Solid, solid
from labpipe.units import Measure
from labpipe.variables import variable

_ENERGIES = ("energy_dissipated", "energy_stored")


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
    substrate: Substrate = None,
    fold: bool = True,
) -> xr.Dataset:
    """Simulate the first impacts of many drops.

    The same answers as :func:`drop` within ``rtol``, at a fraction of its time: nothing is made but
    the rows of the impacts, and the tables of a material are made once for all its drops. An argument
    given as a sequence has an entry for each drop; the others are shared.

    Parameters
    ----------
    material, radius, mass, height, duration, profile, rtol, gravity, plate, substrate, fold
        As of :func:`drop`, its solver "mdr".
    most : int
        Impacts per drop, at most.

    Returns
    -------
    Dataset
        Over (``drop``, ``impact``), NaN for impacts that do not happen within the duration:
        ``impact_time``, ``lift_off_time``, ``contact_duration`` [s], ``impact_speed``,
        ``rebound_speed`` [m/s], ``restitution``, ``peak_force`` [N], ``peak_contact_radius``,
        ``peak_approach``, ``penetration`` [m]. Over ``drop``: ``impacts``, how many happened;
        ``final_contact_time`` [s] as of :func:`drop`, NaN unless it came among these; ``solver_steps``.
        ``attrs["work"]`` is JSON: steps, rejected ones, and impacts.

    Raises
    ------
    InputError
        A value is out of range, sequences differ in length, or as :func:`drop`.

    Warns
    -----
    UserWarning
        As :func:`drop`.

    Examples
    --------
    >>> from labpipe.materials import Prony
    >>> acrylic = Prony.from_creep(2e9, [0.25e-9], [1e-3], nu=0.35)
    >>> found = impacts(acrylic, "9.525 mm", "505 g", ["1 mm", "1.5 mm", "2 mm"], "40 ms")
    >>> found.restitution.values[:, 0].round(3).tolist()
    [0.731, 0.729, 0.727]
    """
    if most < 1:
        raise InputError(f"most is {most} impacts, expected at least 1")
    given: dict[str, Any] = {
        "radius": radius,
        "mass": mass,
        "height": height,
        "duration": duration,
        "gravity": gravity,
        "plate": plate,
        "material": material,
    }
    drops = _side_by_side(given)
    settings = []
    for *numbers, plate_of_one, _ in drops:
        r, m, h, t, g = (exact(value, name) for value, name in zip(numbers, given, strict=False))
        warn_of_millimetres(r, m, h)
        settings.append(Setting(r, m, h, t, "mdr", profile, rtol, g, plate_of_one))
    effort, compliance = Effort(rtol, None, fold, MAX_STEPS, rows_only=True), counter_compliance(substrate)
    trains: list[Train | None] = [None] * len(drops)
    for numbers in _by_material([drop[-1] for drop in drops]):
        creep = Creep.of(solid(drops[numbers[0]][-1])).on(compliance)
        found = _follow([settings[i] for i in numbers], creep, effort, most)
        for i, train in zip(numbers, found, strict=True):
            trains[i] = train
    return _dataset([train for train in trains if train is not None], most)


def _follow(settings: Sequence[Setting], creep: Creep, effort: Effort, most: int) -> list[Train]:
    """Follow the drops of one material with common tables."""
    expected = [scales(creep, one.radius, one.mass, one.gravity, one.speed) for one in settings]
    longest = max(one.duration for one in settings)
    tables = Tables.of(creep, min(scale.duration for scale in expected), longest, effort.rtol, fold=effort.fold)
    pairs = zip(settings, expected, strict=True)
    return [refined(one, creep, effort, tables, most, expected=scale) for one, scale in pairs]


def _side_by_side(given: dict[str, Any]) -> list[tuple[Any, ...]]:
    """Lay out the drops from arguments given for all or drop by drop."""
    lengths = {name: len(values) for name, values in given.items() if isinstance(values, list | tuple | np.ndarray)}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise InputError(f"arguments given drop by drop must have an entry for each: {counts}")
    count = next(iter(lengths.values()), 1)
    columns = [values if name in lengths else [values] * count for name, values in given.items()]
    return list(zip(*columns, strict=True))


def _by_material(materials: Sequence[Solid]) -> list[list[int]]:
    """Gather the numbers of the drops of each material."""
    known: dict[Hashable, list[int]] = {}
    for i, material in enumerate(materials):
        known.setdefault(material if isinstance(material, str) else id(material), []).append(i)
    return list(known.values())


def _dataset(trains: Sequence[Train], most: int) -> xr.Dataset:
    rows = np.full((len(trains), most, len(COLUMNS)), np.nan)
    for row, train in zip(rows, trains, strict=True):
        row[: len(train.rows)] = np.reshape(train.rows, (-1, len(COLUMNS)))
    values = {name: rows[..., i] for i, name in enumerate(COLUMNS) if name not in _ENERGIES}
    made: dict[str, object] = {name: variable(("drop", "impact"), value, *ROWS[name]) for name, value in values.items()}
    happened = [len(train.rows) for train in trains]
    made["impacts"] = variable("drop", np.array(happened), "1", "impacts that happened, at most those asked for")
    final = [train.final_touch + train.setting.fall_time for train in trains]
    made["final_contact_time"] = variable("drop", np.array(final), *SCALARS["final_contact_time"])
    steps = [int(train.counts.solver_steps) for train in trains]
    made["solver_steps"] = variable("drop", np.array(steps), "1", "steps of the solver")
    rejected = sum(int(train.counts.rejected_steps) for train in trains)
    counts = {"solver_steps": sum(steps), "rejected_steps": rejected, "impacts": sum(happened)}
    return xr.Dataset(made, attrs={"work": json.dumps(counts)})

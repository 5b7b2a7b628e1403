"""A dropped sphere simulated, with the sensitivities of its first impacts to every input.

A drop that the laser sees and one that is filmed through the disc are one model.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.materials import Prony
from labpipe.uncertainty import Source, budget_rows
from labpipe.units import Quantity
from labpipe.variables import variable
from pipelines.experiments.shared.counter_body import counter_body_of, modulus_of
from pipelines.experiments.shared.linear_range import linear_range
from pipelines.experiments.shared.material_choice import IMPACT_TIMES, resolve, variations
from pipelines.experiments.shared.model_inputs import table_of
from pipelines.experiments.shared.plate_under_drop import OF_PLATE, plate_inputs, resolve_plate

_UNCERTAIN = (
    "restitution",
    "impact_time",
    "peak_force",
    "peak_contact_radius",
    "contact_duration",
    "penetration",
    "impact_speed",
)
_COARSE = 1e-3  # tolerance of the simulations by which sensitivities are found
_LEAST_CHANGE = 1e-3  # relative change of an input by which a sensitivity is found
_STIFFER = 0.01  # the same of the modulus


class _Trial(NamedTuple):
    """A simulation with one input changed by a step: a solid, other numbers of the body or plate, or a rigid flat."""

    name: str
    given: Quantity
    step: float
    solid: Prony
    change: Mapping[str, float] = {}
    is_on_rigid: bool = False


def simulated_drop(
    settings: Any,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    duration: float,
    step: float,
    *,
    followed: int,
    of_budget: str,
    full: bool = False,
) -> xr.Dataset:
    """Simulate a drop, with the effect of its inputs' uncertainties on the first impacts.

    ``settings`` are those of a ball drop or of a contact area; the curve has a point each ``step`` of ``duration``
    [s] from the release. ``full`` disables the simulator's shortcuts; the numbers stay the same within ``rtol``.

    Returned is the result of :func:`labpipe.contact.drop` with, of the first ``followed`` impacts and NaN beyond,
    ``u_NAME`` (impact,) and ``slope_NAME`` (uncertain, impact) per SI unit; the inputs
    (:mod:`pipelines.experiments.shared.model_inputs`); and as JSON ``plate``, ``linear_range`` and the ``budget``
    of the variable ``of_budget`` at the first impact.
    """
    sphere, chosen = settings.sphere, settings.model
    solid, gravity = resolve(sphere, material_file, fitted), chosen.gravity.value
    under, floor = resolve_plate(settings.plate, plate), plate_inputs(settings.plate, plate)
    flat = counter_body_of(settings.counter_body)
    inputs = {"height": settings.height, "radius": sphere.radius, "mass": sphere.mass}
    inputs |= {f"{OF_PLATE}{name}": given for name, given in floor.items()}
    made = contact.drop(
        solid,
        sphere.radius.value,
        sphere.mass.value,
        settings.height.value,
        duration,
        chosen.solver,
        chosen.profile,
        chosen.rtol,
        gravity=gravity,
        times=np.arange(0.0, duration, step),
        plate=under,
        substrate=flat,
        full=full,
    )
    count = min(made.sizes["impact"], followed)
    trials = [_Trial("", settings.height, 1.0, solid)]
    for key, given in inputs.items():  # one without an uncertainty may be stated wrongly as well
        step = max(given.u, _LEAST_CHANGE * given.value)
        trials.append(_Trial(key, given, step, solid, {key: given.value + step}))
    for key, (given, step, other) in variations(sphere, material_file, fitted, IMPACT_TIMES).items():
        trials.append(_Trial(key, given, step, other))
    # compliances add up and go as 1/E: on a rigid flat a result differs by its slope times E
    trials += [
        _Trial(name, E, E.value, solid, is_on_rigid=True) for name, E in modulus_of(settings.counter_body).items()
    ]
    trials.append(_Trial("modulus", Quantity(1.0, 0.0, "1"), _STIFFER, solid.scaled(1.0 + _STIFFER)))
    found = {name: np.zeros((len(trials), 0)) for name in _UNCERTAIN}
    if count:
        values = [{name: given.value for name, given in inputs.items()} | dict(trial.change) for trial in trials]
        moved = [{name: one[f"{OF_PLATE}{name}"] for name in floor} for one in values]
        train = contact.impacts(
            [trial.solid for trial in trials],
            [one["radius"] for one in values],
            [one["mass"] for one in values],
            [one["height"] for one in values],
            duration,
            count,
            chosen.profile,
            max(chosen.rtol, _COARSE),
            gravity=gravity,
            plate=[None if under is None else replace(under, **one) for one in moved],
            substrate=[None if trial.is_on_rigid else flat for trial in trials],
        )
        found = {name: train[name].values for name in _UNCERTAIN}
        found["impact_time"] = found["impact_time"] - found["impact_time"][:, :1]  # compared from first contact
    made = _with_slopes(made, trials[1:], found, of_budget)
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    limits = linear_range(made, sphere, settings.height.value, material_file, fitted)
    known = {"linear_range": limits, "plate": None if under is None else asdict(under), "work": work}
    return made.assign_attrs({name: json.dumps(value) for name, value in known.items()})


def _with_slopes(made: xr.Dataset, trials: Sequence[_Trial], found: Mapping[str, Floats], of_budget: str) -> xr.Dataset:
    """Add sensitivities, and the effect of the inputs' uncertainties on the first impacts.

    ``found`` are results (1 + trial, impact) without a change and with that of each trial.
    """
    count, names = made.sizes["impact"], [trial.name for trial in trials]
    steps, u = (np.array(column)[:, None] for column in zip(*((t.step, t.given.u) for t in trials), strict=True))
    slopes = {name: (values[1:] - values[0]) / steps for name, values in found.items()}
    made = made.merge(table_of({trial.name: trial.given for trial in trials}))
    for name, slope in slopes.items():
        units, text = made[name].attrs["units"], f"standard uncertainty from {', '.join(names)}: {name}"
        whole = np.sqrt(np.sum(np.square(np.nan_to_num(slope) * u), axis=0))
        made[f"u_{name}"] = variable("impact", padded(whole, count), units, text)
        text = f"change per SI unit of input: {name}"
        made[f"slope_{name}"] = variable(("uncertain", "impact"), padded(slope.T, count).T, units, text)
    sources = [
        Source.of(trial.name, trial.given, float(np.nan_to_num(slope[0])))
        for trial, slope in zip(trials, slopes[of_budget], strict=True)
        if count and trial.given.u > 0.0
    ]
    return made.assign_attrs(budget=json.dumps(budget_rows(sources)))


def slopes_of(made: xr.Dataset, name: str, impact: int) -> dict[str, float]:
    """Return the derivatives of measured minus simulated, of a variable of one impact, to the inputs."""
    inputs, changes = made.variables["uncertain"].values, made.variables[f"slope_{name}"].values[:, impact]
    return {str(of): -float(slope) for of, slope in zip(inputs, changes, strict=True) if np.isfinite(slope)}


def padded(values: Floats, count: int) -> Floats:
    """Return values (impact, …) and NaN up to a number of impacts."""
    return np.concatenate([values, np.full((count - len(values), *values.shape[1:]), np.nan)])

"""The drop simulated, and the effect of its inputs' uncertainties on its impacts and on its path."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.materials import Prony
from labpipe.uncertainty import Source, budget_rows
from labpipe.units import Quantity
from labpipe.variables import variable
from pipelines.experiments.ball_drop.measured import padded
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.material_choice import IMPACT_TIMES, resolve, variations
from pipelines.experiments.shared.plate_under_drop import OF_PLATE, plate_inputs, resolve_plate

FOLLOWED = 20
"""Impacts whose sensitivities are found, and that are compared with the model one by one.

Three are compared; PEEK bounces a hundred times, and each impact costs a contact for every input.
"""
_UNCERTAIN = (
    "restitution",
    "impact_time",
    "peak_force",
    "peak_contact_radius",
    "contact_duration",
    "penetration",
    "impact_speed",
)
_CURVE_STEP = 5e-5  # s, spacing of the model's curve; contacts of 1 ms get twenty points
_COARSE = 1e-3  # tolerance of the simulations by which sensitivities are found
_LEAST_CHANGE = 1e-3  # relative change of an input by which a sensitivity is found
_STIFFER = 0.01  # the same of the modulus


class _Trial(NamedTuple):
    """A simulation with one input changed by a step: a solid, or other numbers of the body or plate."""

    name: str
    given: Quantity
    step: float
    solid: Prony
    change: Mapping[str, float] = {}


def model(
    repeats: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    *,
    settings: BallDrop,
    full: bool = False,
) -> xr.Dataset:
    """Simulate the drop as long as the record lasts, with the uncertainty of its inputs.

    ``full`` disables the simulator's shortcuts; the numbers stay the same within ``rtol``.
    """
    sphere, chosen = settings.sphere, settings.model
    solid = resolve(sphere, material_file, fitted)
    gravity, height = chosen.gravity.value, settings.height.value
    duration = float(np.sqrt(2 * height / gravity) + repeats["time"].max())
    substrate, floor = resolve_plate(settings.plate, plate), plate_inputs(settings.plate, plate)
    inputs = {"height": settings.height, "radius": sphere.radius, "mass": sphere.mass}
    inputs |= {f"{OF_PLATE}{name}": given for name, given in floor.items()}
    made = contact.drop(
        solid,
        sphere.radius.value,
        sphere.mass.value,
        height,
        duration,
        chosen.solver,
        chosen.profile,
        chosen.rtol,
        gravity=gravity,
        times=np.arange(0.0, duration, _CURVE_STEP),
        plate=substrate,
        fold=not full,
        shortcuts=contact.Shortcuts.chosen(full=full),
    )

    count = min(made.sizes["impact"], FOLLOWED)
    trials = [_Trial("", settings.height, 1.0, solid)]
    for key, given in inputs.items():  # one without an uncertainty may be stated wrongly as well
        step = max(given.u, _LEAST_CHANGE * given.value)
        trials.append(_Trial(key, given, step, solid, {key: given.value + step}))
    for key, (given, step, other) in variations(sphere, material_file, fitted, IMPACT_TIMES).items():
        trials.append(_Trial(key, given, step, other))
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
            plate=[None if substrate is None else replace(substrate, **one) for one in moved],
        )
        found = {name: train[name].values for name in _UNCERTAIN}
        found["impact_time"] = found["impact_time"] - found["impact_time"][:, :1]  # compared from first contact
    made = _with_uncertainty(made, trials[1:], found)
    made.attrs["plate"] = json.dumps(None if substrate is None else asdict(substrate))
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    made.attrs["work"] = json.dumps(work)
    return made


def _with_uncertainty(made: xr.Dataset, trials: Sequence[_Trial], found: Mapping[str, Floats]) -> xr.Dataset:
    """Add sensitivities, and the effect of the inputs' uncertainties on the first impacts and the path until then.

    ``found`` are results (1 + trial, impact) without a change and with that of each trial.
    """
    count, names = made.sizes["impact"], [trial.name for trial in trials]
    steps, u = (np.array(column)[:, None] for column in zip(*((t.step, t.given.u) for t in trials), strict=True))
    slopes = {name: (values[1:] - values[0]) / steps for name, values in found.items()}
    made = made.assign_coords(slope_input=np.array(names, dtype=str))
    for name, text in (("value", "value"), ("u", "standard uncertainty")):
        values = [getattr(trial.given, name) for trial in trials]
        made[f"input_{name}"] = variable("slope_input", values, "1", f"{text} of an input of the model, SI")
    for name, slope in slopes.items():
        units, text = made[name].attrs["units"], f"standard uncertainty from {', '.join(names)}: {name}"
        whole = np.sqrt(np.sum(np.square(np.nan_to_num(slope) * u), axis=0))
        made[f"u_{name}"] = variable("impact", padded(whole, count), units, text)
        text = f"change per SI unit of input: {name}"
        made[f"slope_{name}"] = variable(("slope_input", "impact"), padded(slope.T, count).T, units, text)
    squares = np.full(made["time"].shape, 0.0 if count else np.nan)
    for moved in path_by_input(made):
        squares += np.square(moved)
    text = "standard uncertainty from the inputs, from first contact on: displacement"
    made["u_displacement"] = variable("time", np.sqrt(squares), "m", text)
    sources = [
        Source.of(trial.name, trial.given, float(np.nan_to_num(slope[0])))
        for trial, slope in zip(trials, slopes["restitution"], strict=True)
        if count and trial.given.u > 0.0
    ]
    units = [trial.given.si for trial in trials]
    return made.assign_attrs(input_units=json.dumps(units), budget=json.dumps(budget_rows(sources)))


def path_by_input(made: xr.Dataset) -> Iterator[Floats]:
    """Yield the effect of one standard uncertainty of each uncertain input on the displacement (time,) [m].

    Times count from the first contact; NaN after the last impact whose sensitivities were found.
    """
    of_contact = ("impact_time", "contact_duration", "penetration")
    time, path = made["time"].values, made["displacement"].values
    touches, durations, depths = (made[name].values for name in of_contact)
    for i, u in enumerate(made["input_u"].values):
        if u > 0.0 and touches.size:
            slope, longer, deeper = (made[f"slope_{name}"].values[i][:FOLLOWED] for name in of_contact)
            whole = np.isfinite(durations[: slope.size] + depths[: slope.size] + longer + deeper)
            count = int(np.cumprod(whole).sum())  # a contact that the end of the record cuts has neither
            pairs = (touches, durations), (slope, longer)
            nodes, later = (np.stack((a[:count], a[:count] + b[:count]), axis=1).ravel() for a, b in pairs)
            deeper = deeper[:count] / depths[:count]
            faster = float(made["slope_impact_speed"].values[i][0])
            fall = np.where(time < touches[0], faster * (touches[0] - time), 0.0)
            up, down = (_moved(time, path, nodes, by * later, by * deeper) + by * fall for by in (u, -u))
            yield 0.5 * (up - down)


def _moved(time: Floats, path: Floats, nodes: Floats, later: Floats, deeper: Floats) -> Floats:
    """Return the path (time,) whose touches and lift-offs (2 impact,) come later; contacts are deeper by a share.

    The path between them is stretched: a contact in time, and a flight, as it is free, by the square in height too.
    """
    moved = nodes + later
    # a shift as long as a flight says nothing of the path any more
    if not moved.size or not np.all(np.diff(moved) > 0.0):
        return np.full(time.shape, np.nan)
    last = np.searchsorted(moved, time, side="right") - 1
    found = np.interp(np.where(last < 0, time, np.interp(time, moved, nodes, right=np.nan)), time, path)
    higher = np.square(np.diff(moved) / np.diff(nodes))
    higher[::2] = 1.0 + deeper
    return np.where(last < 0, found, found * np.append(higher, 1.0)[last])

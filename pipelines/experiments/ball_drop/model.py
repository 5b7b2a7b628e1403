"""The drop simulated, with the uncertainty of its inputs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.materials import Prony
from labpipe.units import Quantity
from pipelines.experiments.ball_drop._model_uncertainty import FOLLOWED, UNCERTAIN, with_uncertainty
from pipelines.experiments.ball_drop._swing import with_swing
from pipelines.experiments.ball_drop.measured import padded
from pipelines.experiments.ball_drop.settings import BallDrop
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.material_choice import IMPACT_TIMES, resolve, variations
from pipelines.experiments.shared.plate_under_drop import OF_PLATE, plate_inputs, resolve_plate

_CURVE_STEP = 5e-5  # s, spacing of the model's curve; contacts of 1 ms get twenty points
_COARSE = 1e-3  # tolerance of the simulations by which sensitivities are found
_LEAST_CHANGE = 1e-3  # relative change of an input by which a sensitivity is found
_MODULUS = "modulus"
_STIFFER = 0.01  # relative change of the modulus by which its sensitivity is found


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

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    sphere, chosen = settings.sphere, settings.model
    solid = resolve(sphere, material_file, fitted)
    gravity = chosen.gravity.value
    fall = np.sqrt(2 * settings.height.value / gravity)
    duration = float(fall + repeats["time"].max())
    times = np.arange(0.0, duration, _CURVE_STEP)
    body = {"height": settings.height, "radius": sphere.radius, "mass": sphere.mass}
    substrate = resolve_plate(settings.plate, plate)
    floor = plate_inputs(settings.plate, plate)
    inputs = body | {f"{OF_PLATE}{name}": quantity for name, quantity in floor.items()}
    solids = variations(sphere, material_file, fitted, IMPACT_TIMES)

    def values_of(change: Mapping[str, float]) -> tuple[dict[str, float], contact.Plate | None]:
        values = {**{name: quantity.value for name, quantity in inputs.items()}, **change}
        moved = {name: values[f"{OF_PLATE}{name}"] for name in floor}
        return values, None if substrate is None else replace(substrate, **moved)

    def simulate(other: Prony, rtol: float, times: Floats | None, change: Mapping[str, float]) -> xr.Dataset:
        values, beneath = values_of(change)
        return contact.drop(
            other,
            values["radius"],
            values["mass"],
            values["height"],
            duration,
            chosen.solver,
            chosen.profile,
            rtol,
            gravity=gravity,
            times=times,
            plate=beneath,
            fold=not full,
            shortcuts=contact.Shortcuts.chosen(full=full),
        )

    def bounces(trials: Sequence[_Trial], rtol: float, count: int) -> dict[str, Floats]:
        """Return each uncertain result (trial, impact), NaN where there is none."""
        if full or chosen.solver != "mdr":
            found = [simulate(trial.solid, rtol, None, trial.change) for trial in trials]
            return {name: np.stack([padded(one[name].values[:count], count) for one in found]) for name in UNCERTAIN}
        values, beneath = zip(*(values_of(trial.change) for trial in trials), strict=True)
        made = contact.impacts(
            [trial.solid for trial in trials],
            [one["radius"] for one in values],
            [one["mass"] for one in values],
            [one["height"] for one in values],
            duration,
            count,
            chosen.profile,
            rtol,
            gravity=gravity,
            plate=beneath,
        )
        return {name: made[name].values for name in UNCERTAIN}

    made = simulate(solid, chosen.rtol, times, {})
    # On a ringing plate a later touch meets it at another moment when the height changes, so the
    # body's sensitivities are those on the plate; a few per cent of a sensitivity do no harm.
    count = min(made.sizes["impact"], FOLLOWED)
    trials = [_Trial("", Quantity(0.0, 0.0, "1"), 1.0, solid)]
    for key, given in inputs.items():  # one without an uncertainty may be stated wrongly as well
        change = max(given.u, _LEAST_CHANGE * given.value)
        trials.append(_Trial(key, given, change, solid, {key: given.value + change}))
    trials += [_Trial(key, given, change, other) for key, (given, change, other) in solids.items()]
    trials.append(_Trial(_MODULUS, Quantity(1.0, 0.0, "1"), _STIFFER, solid.scaled(1.0 + _STIFFER)))
    found = (
        bounces(trials, max(chosen.rtol, _COARSE), count)
        if count
        else {name: np.zeros((len(trials), 0)) for name in UNCERTAIN}
    )
    # what is compared counts from the first contact
    found["impact_time"] = found["impact_time"] - found["impact_time"][:, :1]
    slopes = {
        trial.name: (trial.given, {name: (found[name][i] - found[name][0]) / trial.step for name in UNCERTAIN})
        for i, trial in enumerate(trials)
        if i > 0
    }
    made = with_uncertainty(made, slopes)

    def falls(heights: Floats, count: int) -> dict[str, Floats]:
        drops = [_Trial("", Quantity(0.0, 0.0, "m"), 0.0, solid, {"height": float(height)}) for height in heights]
        found = bounces(drops, max(chosen.rtol, _COARSE), count)
        return found | {"impact_time": found["impact_time"] - found["impact_time"][:, :1]}

    made = with_swing(made, repeats, substrate, settings.height.value, falls, min(IMPACTS, count))
    made.attrs["plate"] = json.dumps(None if substrate is None else asdict(substrate))
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    made.attrs["work"] = json.dumps(work)
    return made


class _Trial(NamedTuple):
    """A simulation with one input changed by a step: a solid, or another value of the body or plate."""

    name: str
    given: Quantity
    step: float
    solid: Prony
    change: Mapping[str, float] = {}

"""Bounces that a laser timed and contact radii that a film shows, as evidence on a material."""

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.errors import InputError
from labpipe.identification import Bounces, DropModel, Parameter, drop_evidence
from labpipe.workflow.session import Experiment
from pipelines.experiments.shared.material_evidence import Proof, assumed, nuisance
from pipelines.experiments.shared.plate_under_drop import plate_inputs, resolve_plate
from pipelines.figures.inputs import Inputs, referred

Array = NDArray[np.float64]

_LEAST_RELATIVE = 5e-4  # of a radius
_LEAST_OF_TIME = 5e-5  # of a time of touch: what simulated and recorded clocks are good for


def _body(experiment: Experiment) -> tuple[dict[str, str], list[Parameter]]:
    """Return mass and radius of a sphere; equal spheres are one."""
    sphere = experiment.settings.sphere  # type: ignore[attr-defined]
    names, unknowns = {}, []
    for role, given, text in (
        ("mass", sphere.mass, "mass that moves"),
        ("radius", sphere.radius, "radius of the sphere"),
    ):
        if given.u > 0.0:
            names[role] = f"{role} {given.value:g} {given.si}"
            unknowns.append(nuisance(names[role], given.value, given.u, given.si, text))
    return names, unknowns


def _drop_model(
    inputs: Inputs, experiment: Experiment, names: dict[str, str], unknowns: list[Parameter]
) -> DropModel:
    """Return the model of a drop, with the plate's mass among its unknowns."""
    settings: Any = experiment.settings
    found = None
    if settings.plate_from is not None:
        found = inputs.result(referred(settings.plate_from), "plate")
    plate = resolve_plate(settings.plate, found)
    mass = plate_inputs(settings.plate, found).get("mass")
    if plate is not None and mass is not None and mass.u > 0.0:
        names["plate"] = "mass of the plate"
        unknowns.append(
            nuisance(names["plate"], plate.mass, mass.u, "kg", "modal mass of the plate")
        )
    empty = np.empty(0, dtype=np.int64)
    return DropModel(
        settings.sphere.radius.value, settings.sphere.mass.value, settings.height.value,
        settings.model.gravity.value, empty, empty, empty, 0.0, 0.0, names,
        settings.model.profile, plate, settings.model.rtol,
    )  # fmt: skip


def _height(experiment: Experiment, heights: Array) -> Parameter:
    """Return the mean height of the repeats: the stated one, as far as it is repeated."""
    given = experiment.settings.height  # type: ignore[attr-defined]
    spread = float(np.std(heights, ddof=1)) if heights.size > 1 else 0.0
    sd = float(np.hypot(given.u, spread / np.sqrt(max(heights.size, 1))))
    if sd == 0.0:
        message = (
            f"{experiment.name}: the height is stated without an uncertainty; write it as "
            f'"{given.value * 1e3:g} ± 0.01 mm"'
        )
        raise InputError(message)
    name = f"{experiment.name} height"
    return nuisance(name, given.value, sd, "m", "mean height of the drops")


def ball_drop(inputs: Inputs, experiment: Experiment, impacts: int) -> Proof | str:
    """Gather times of touch and durations of contact, the mean of the repeats.

    The shape of the pulse that was fitted to the contacts is the same for all of them: it moves
    all durations alike, so it is one unknown, and leaves the times between touches as they are.
    """
    settings: Any = experiment.settings
    made = [inputs.result(experiment.name, "bounces", file) for file in settings.laser]
    count = min(impacts + 1, *(b.sizes["impact"] for b in made))
    if count < 2:
        return "fewer than two impacts were seen"
    touch = np.array([b["touch_time"].values[:count] - float(b["touch_time"][0]) for b in made])
    own = np.mean([_own_square(b, "touch_time", count) for b in made], axis=0)
    u_touch = np.maximum(np.sqrt(own), _scatter(touch)) / np.sqrt(len(made))
    u_touch = np.maximum(u_touch, _LEAST_OF_TIME * touch.mean(axis=0))
    table = inputs.result(experiment.name, "repeats").isel(impact=slice(count))
    names, unknowns = _body(experiment)
    height = _height(experiment, np.array([float(b["drop_height"]) for b in made]))
    trigger = nuisance(
        f"{experiment.name} trigger", 0.0, float(u_touch[0]), "s", "delay of the first contact"
    )
    pulse = nuisance("pulse shape", 0.0, 1.0, "1", "shape of the pulse, in its uncertainties")
    names |= {"height": height.name, "trigger": trigger.name, "pulse": pulse.name}
    unknowns += [height, trigger, pulse]
    none = np.full(count, np.nan)
    shared = np.mean([b["shared_u_contact_duration"].values[:count] ** 2 for b in made], axis=0)
    u_duration = np.sqrt(np.maximum(table["u_contact_duration"].values ** 2 - shared, 0.0))
    seen = Bounces(
        touch.mean(axis=0), u_touch, table["contact_duration"].values, u_duration, none, none,
        np.sqrt(shared),
    )  # fmt: skip
    return _proof_of_drop(inputs, experiment, seen, names, unknowns)


def _own_square(bounces: xr.Dataset, name: str, count: int) -> Array:
    """Return the squared uncertainty (impact,) without the part that the pulse's shape makes."""
    stated, shared = (bounces[f"{part}{name}"].values[:count] for part in ("u_", "shared_u_"))
    return np.asarray(np.maximum(stated**2 - shared**2, 0.0))


def _scatter(touch: Array) -> Array:
    """Return the scatter (impact,) of times between repeats that their heights do not explain.

    All times go with the root of the height: what repeats have in common with the mean is height.
    """
    if len(touch) < 3:
        return np.zeros(touch.shape[1])
    mean = touch.mean(axis=0)
    share = touch @ mean / (mean @ mean)
    rest = touch - share[:, None] * mean
    return np.asarray(np.sqrt(np.sum(rest**2, axis=0) / (len(touch) - 1)))


def contact_area(inputs: Inputs, experiment: Experiment, impacts: int) -> Proof | str:
    """Gather the largest contact radii of a film."""
    made = inputs.result(experiment.name, "impacts")
    count = min(impacts, made.sizes["impact"])
    if not count:
        return "no impact was seen in the film"
    film = inputs.result(experiment.name, "radius")
    relative = float(film.attrs["u_systematic_relative"])
    radius = made["peak_radius"].values[:count]
    u = np.sqrt(np.maximum(made["u_peak_radius"].values[:count] ** 2 - (relative * radius) ** 2,
                           (_LEAST_RELATIVE * radius) ** 2))  # fmt: skip
    names, unknowns = _body(experiment)
    height = _height(experiment, np.empty(0))
    pixel = nuisance(f"{experiment.name} scale", 1.0, relative, "1", "scale of the film")
    names |= {"height": height.name, "pixel": pixel.name}
    unknowns += [height, pixel]
    none = np.full(count, np.nan)
    seen = Bounces(none, none, none, none, radius, u)
    return _proof_of_drop(inputs, experiment, seen, names, unknowns)


def _proof_of_drop(
    inputs: Inputs, experiment: Experiment, seen: Bounces, names: dict[str, str],
    unknowns: list[Parameter],
) -> Proof:  # fmt: skip
    model = _drop_model(inputs, experiment, names, unknowns)
    evidence = drop_evidence(experiment.name, seen, model)
    solid = assumed(inputs, experiment)
    return Proof(
        float(solid.nu), evidence.model.window,
        tuple(unknowns), lambda rho: evidence,
    )  # fmt: skip

"""One experiment, ready to become evidence, and what session.toml says of its material."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labpipe.identification import Evidence, Parameter
from labpipe.materials import Prony
from labpipe.workflow.session import Experiment
from pipelines.experiments.shared.material_choice import resolve
from pipelines.figures.inputs import Inputs, referred

Array = NDArray[np.float64]

_HOLDERS = {
    "ball_drop": "sphere", "contact_area": "sphere", "relaxation": "substrate",
    "harmonic": "substrate",
}  # fmt: skip
"""The table of a kind that names the material."""


@dataclass(frozen=True, eq=False)
class Proof:
    """One experiment, ready to become evidence once the relaxation times are chosen.

    Attributes
    ----------
    nu : float
    window : tuple of float [s]
        Shortest and longest time of which it tells.
    unknowns : tuple of Parameter
        What it leaves unknown besides the material.
    build : callable
        Takes relaxation times (term,) and returns the evidence.
    """

    nu: float
    window: tuple[float, float]
    unknowns: tuple[Parameter, ...]
    build: Callable[[Array], Evidence]


def nuisance(name: str, mean: float, sd: float, unit: str, text: str) -> Parameter:
    """Return an unknown of an experiment."""
    return Parameter(name, mean, sd, unit, text, is_nuisance=True)


def choice(experiment: Experiment) -> Any:
    """Return the table that names the material."""
    return getattr(experiment.settings, _HOLDERS[experiment.kind])


def material_name(experiment: Experiment) -> str:
    """Return how the session names the material; another temperature is another material."""
    chosen = choice(experiment)
    name = chosen.material or chosen.material_from or chosen.material_file
    at = "" if chosen.temperature is None else f" at {chosen.temperature.value:g} degC"
    return referred(str(name)) + at


def assumed(inputs: Inputs, experiment: Experiment) -> Prony:
    """Return the material that the session assumes: only its Poisson's ratio is used."""
    chosen = choice(experiment)
    if chosen.material_from is not None:
        fitted = inputs.result(referred(chosen.material_from), "master_curve")
        return resolve(chosen, None, fitted)
    file = None if chosen.material_file is None else inputs.folder / chosen.material_file
    return resolve(chosen, file, None)


def references(experiment: Experiment) -> list[str]:
    """Return what an experiment takes from others: the plate under it, the assumed material."""
    plate = getattr(experiment.settings, "plate_from", None)
    found = [] if plate is None else [f"{referred(plate)}/plate"]
    material = choice(experiment).material_from
    return found if material is None else [*found, f"{referred(material)}/master_curve"]

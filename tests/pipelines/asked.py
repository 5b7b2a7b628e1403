"""Budgets of a processed experiment; an input that is said to be without effect has no row."""

from pathlib import Path

from pipelines.experiments import KINDS
from pipelines.experiments.shared.budget_quantity import Quantity
from pipelines.session import derive, opened

ITEMS = {
    "clock": "sampling",
    "first_touch": "zero",
    "tare": "zero",
    "drift": "zero",
    "stage": "zero",
    "pulse_shape": "noise",
    "phase": "noise",
    "force_amplitude": "noise",
    "amplitude": "noise",
    "tip_radius": "radius",
    "sphere_radius": "radius",
    "pixel_distance": "pixel size",
    "reference_length": "pixel size",
    "filter_gain": "filter lag",
    "mass_of_the_loads": "mass",
    "load": "mass",
    "mass_of_sphere": "mass",
    "plate_mass": "mass",
    "heights": "height",
    "inclination_and_gain": "inclination",
}
"""Names of inputs, and what of the list that is asked they are."""


def check(quantity: Quantity) -> None:
    acting = {ITEMS.get(n, n.replace("_", " ")) for n in quantity.inputs}
    said = ", ".join(names for names, _ in quantity.inert)
    for item in said.split(", "):
        assert item not in acting, (quantity.name, item)


def quantities(folder: Path, name: str) -> dict[str, Quantity]:
    """Return the quantities of a processed experiment by their names, each of them checked."""
    results = opened(folder)
    experiment = results.experiments[name]
    found = {q.name: q for q in derive(results, experiment, KINDS[experiment.kind].budget)}
    for quantity in found.values():
        check(quantity)
    return found

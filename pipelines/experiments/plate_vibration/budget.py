"""Budgets of a plate vibration: natural frequency, damping ratio, modal mass."""

from collections.abc import Iterator, Sequence
from math import isfinite

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input
from pipelines.experiments.plate_vibration.settings import PlateVibration
from pipelines.experiments.shared.budget_quantity import Factor, Quantity, clock, of_laser, product
from pipelines.experiments.shared.pages import present


def quantities(
    displacement: Sequence[xr.Dataset | None], table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration
) -> Iterator[Quantity]:
    """Yield natural frequency, damping ratio and modal mass of the plate."""
    moved = present(displacement)[0]  # the laser is the same for all drops
    yield _ringing("natural_frequency", "natural frequency", "Hz", moved, table)
    yield _ringing("damping_ratio", "damping ratio", "1", moved, table)
    if settings.sphere is not None and isfinite(mass := float(plate["mass"])):
        scale = of_laser(moved, -1.0)  # of an amplitude, with which the mass goes inversely
        scale["mass_of_sphere"] = (Input(*settings.sphere.mass), 1.0)
        # the momentum goes with the root of the height, and the mass is a weighted mean over the drops
        each, weights = plate["modal_mass"].values, plate["u_modal_mass"].values ** -2.0
        relative = np.array([0.5 * drops.height.u / drops.height.value for drops in settings.drops])
        heights = float(np.sqrt(np.nansum((weights * each * relative) ** 2)) / np.nansum(weights))
        rest = ("repeatability", float(plate["u_mass"]), max(float(np.isfinite(each).sum()) - 1.0, 1.0))
        yield product("modal mass", "kg", mass, scale, {"heights": Input(0.0, heights)}, rest=rest)


def _ringing(name: str, text: str, unit: str, moved: xr.Dataset, table: xr.Dataset) -> Quantity:
    own, total = table[f"u_{name}"].values, float(table[f"u_plate_{name}"])
    stated = Input(0.0, min(float(1.0 / np.sqrt(np.sum(1.0 / own**2))), total))
    times: dict[str, Factor] = {"clock": (clock(moved), -1.0)} if unit == "Hz" else {}  # damping is a ratio of times
    rest = ("repeatability", total, max(own.size - 1.0, 1.0))
    return product(text, unit, float(table[f"plate_{name}"]), times, {"noise": stated}, rest=rest)

"""Budgets of a plate vibration: natural frequency, damping ratio, modal mass."""

from collections.abc import Iterator, Sequence
from math import isfinite, tan

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.plate_vibration.settings import FallingBody, PlateVibration
from pipelines.experiments.shared.budget_quantity import Quantity, clock, of_laser, product
from pipelines.experiments.shared.pages import present


def quantities(
    displacement: Sequence[xr.Dataset | None], table: xr.Dataset, plate: xr.Dataset, *, settings: PlateVibration
) -> Iterator[Quantity]:
    """Yield natural frequency, damping ratio and modal mass of the plate."""
    moved = present(displacement)[0]  # the laser is the same for all drops
    yield _ringing("natural_frequency", "natural frequency", "Hz", moved, table)
    yield _ringing("damping_ratio", "damping ratio", "1", moved, table)
    if settings.sphere is not None and isfinite(float(plate["mass"])):
        yield _modal_mass(settings, settings.sphere, moved, plate)


def _ringing(name: str, text: str, unit: str, moved: xr.Dataset, table: xr.Dataset) -> Quantity:
    own, mean = table[f"u_{name}"].values, float(table[f"plate_{name}"])
    total = float(table[f"u_plate_{name}"])
    stated = min(float(1.0 / np.sqrt(np.sum(1.0 / own**2))), total)
    times = {"clock": clock(moved)} if unit == "Hz" else {}  # damping is a ratio of two times
    scatter = excess_uncertainty(total, stated, *(time.u * mean for time in times.values()))
    errors = {"noise": Input(0.0, stated), "repeatability": Input(0.0, scatter, "1", max(own.size - 1.0, 1.0))}
    return product(text, unit, mean, {name: (one, -1.0) for name, one in times.items()}, errors)


def _modal_mass(settings: PlateVibration, ball: FallingBody, moved: xr.Dataset, plate: xr.Dataset) -> Quantity:
    mass, scale = float(plate["mass"]), of_laser(moved, -1.0)  # of an amplitude, with which the mass goes inversely
    (gain, _), (tilt, _) = scale.values()
    parts = (mass * gain.u, mass * tan(tilt.value) * tilt.u, mass * ball.mass.u / ball.mass.value)
    # the momentum goes with the root of the height, and the mass is a weighted mean over the drops
    each, weights = plate["modal_mass"].values, plate["u_modal_mass"].values ** -2.0
    relative = np.array([0.5 * drops.height.u / drops.height.value for drops in settings.drops])
    heights = float(np.sqrt(np.nansum((weights * each * relative) ** 2)) / np.nansum(weights))
    rest = excess_uncertainty(float(plate["u_mass"]), *parts, heights)
    freedom = max(float(np.isfinite(each).sum()) - 1.0, 1.0)

    scale["mass_of_sphere"] = (Input(*ball.mass[:2], "kg"), 1.0)
    errors = {"heights": Input(0.0, heights), "repeatability": Input(0.0, rest, "kg", freedom)}
    return product("modal mass", "kg", mass, scale, errors)

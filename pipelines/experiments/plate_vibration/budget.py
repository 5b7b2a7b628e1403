"""Budgets of a plate vibration: natural frequency, damping ratio, modal mass."""

from collections.abc import Iterator, Sequence
from math import cos, hypot, isfinite

import numpy as np
import xarray as xr

from labpipe.uncertainty import Input, excess_uncertainty
from pipelines.experiments.plate_vibration.model import of_solids
from pipelines.experiments.plate_vibration.settings import FallingBody, PlateVibration
from pipelines.experiments.shared.budget_quantity import MEASURED, Quantity, clock
from pipelines.experiments.shared.material_choice import POISSONS_RATIO, TEMPERATURE
from pipelines.experiments.shared.pages import present

_NO_CAMERA = ("pixel size", "there is no camera")
_LAG = ("filter lag", "the moving average of the sensor delays all readings equally")
_OF_RINGING = (
    ("inclination, zero", "the amplitude scale does not affect frequency or decay"),
    _NO_CAMERA,
    _LAG,
    ("mass, radius, height, Poisson's ratio, temperature", "the impact conditions have no effect"),
)
_OF_MASS = (
    _NO_CAMERA,
    _LAG,
    ("zero", "the vibration is measured from its own mean"),
    ("sampling", "the effect of the clock, 5e-5, is a twentieth of that of the sphere's mass"),
)
_RADIUS = "it changes the duration of the impact, not its momentum"
_NOT_STATED = "stated without an uncertainty, or not stated"
_RHEOMETER = "DMA"


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
    values, own = table[name].values, table[f"u_{name}"].values
    total, mean = float(table[f"u_plate_{name}"]), float(table[f"plate_{name}"])
    stated = min(float(1.0 / np.sqrt(np.sum(1.0 / own**2))), total)
    inputs = {MEASURED: Input(mean, 0.0, unit), "noise": Input(0.0, stated, unit)}
    time = clock(moved) if name == "natural_frequency" else Input(1.0, 0.0)
    scatter = excess_uncertainty(total, stated, time.u * mean)
    inputs["repeatability"] = Input(0.0, scatter, unit, max(values.size - 1.0, 1.0))
    if time.u:
        inputs["clock"] = time

    def model(measured: float, noise: float, repeatability: float, clock: float = 1.0) -> float:
        return (measured + noise + repeatability) / clock

    return Quantity(
        text, unit, model, inputs, _OF_RINGING if time.u else (("sampling", "a ratio of two times"), *_OF_RINGING)
    )


def _modal_mass(settings: PlateVibration, ball: FallingBody, moved: xr.Dataset, plate: xr.Dataset) -> Quantity:
    mass, angle = float(plate["mass"]), float(moved["inclination"])
    gain = float(moved["u_gain"]) / float(moved["gain"])
    tilt = Input(angle, float(moved["u_inclination"]), "rad")
    parts = (mass * gain, mass * np.tan(angle) * tilt.u, mass * ball.mass.u / ball.mass.value)
    # the momentum goes with the root of the height, and the mass is a weighted mean over the drops
    each, weights = plate["modal_mass"].values, plate["u_modal_mass"].values ** -2.0
    relative = np.array([0.5 * drops.height.u / drops.height.value for drops in settings.drops])
    heights = float(np.sqrt(np.nansum((weights * each * relative) ** 2)) / np.nansum(weights))
    solids: dict[str, float] = {}
    for name, (given, _) in of_solids(plate).items():
        kind = next((k for k in (TEMPERATURE, POISSONS_RATIO) if name.startswith(k)), _RHEOMETER)
        solids[kind] = hypot(solids.get(kind, 0.0), given.u * float(plate["solid_mass"].sel(uncertain=name)))
    rest = excess_uncertainty(float(plate["u_mass"]), *map(float, parts), heights, *solids.values())
    silent = [name for name in (POISSONS_RATIO, TEMPERATURE) if name not in solids]
    inert = [("noise", "included in the repeatability"), *_OF_MASS, ("radius", _RADIUS)]
    inert += [(", ".join(silent), _NOT_STATED)] if silent else []
    return Quantity(
        "modal mass",
        "kg",
        lambda measured, gain, inclination, mass_of_sphere, **errors: (
            (measured + sum(errors.values())) * mass_of_sphere / ball.mass.value / gain * cos(inclination) / cos(angle)
        ),
        {
            MEASURED: Input(mass, 0.0, "kg"),
            "gain": Input(1.0, gain),
            "inclination": tilt,
            "mass_of_sphere": Input(ball.mass.value, ball.mass.u, "kg"),
            "heights": Input(0.0, heights, "kg"),
            "repeatability": Input(0.0, rest, "kg", max(float(np.isfinite(each).sum()) - 1.0, 1.0)),
        }
        | {name: Input(0.0, u, "kg") for name, u in solids.items()},
        tuple(inert),
    )

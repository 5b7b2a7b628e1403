"""The elastic flat under a sphere and the plate that carries it: as simulations take them, as inputs, and in words."""

import numpy as np
import xarray as xr

from labpipe import contact, signals
from labpipe.errors import InputError
from labpipe.report import value_with_uncertainty
from labpipe.units import Quantity
from pipelines.experiments.shared.material_choice import OF_LIBRARY
from pipelines.experiments.shared.settings import CounterBody, Flat, Plate, Sphere

OF_PLATE = "plate "
"""Beginning of the names of the plate's inputs, next to those of the body."""
_OF_PLATE = {"mass": "kg", "frequency": "Hz", "damping_ratio": "1"}


def counter_body_of(flat: Flat) -> "contact.CounterBody | None":
    """Return a flat as the simulations take it; None is a rigid one."""
    if isinstance(flat, CounterBody):
        return contact.CounterBody(flat.E.value, flat.nu, flat.E.u, "session.toml")
    return contact.counter_body(None if flat == "rigid" else flat)


def modulus_of(flat: Flat) -> dict[str, Quantity]:
    """Return the uncertain input that a flat is, by its name; none for a rigid one.

    Examples
    --------
    >>> modulus_of("sapphire")
    {'counter-body, sapphire': Quantity(value=403000000000.0, u=10000000000.0, si='Pa')}
    """
    body = counter_body_of(flat)
    name = "counter-body" if isinstance(flat, CounterBody) else f"{OF_LIBRARY}{flat}"
    return {} if body is None else {name: Quantity(body.E, body.u_E, "Pa")}


def described_flat(flat: Flat) -> str:
    """Write a flat for people.

    Examples
    --------
    >>> described_flat("sapphire"), described_flat("rigid")
    ('sapphire of E = (403 ± 10) GPa and ν = 0.235', 'a rigid flat')
    """
    body = counter_body_of(flat)
    if body is None:
        return "a rigid flat"
    name = "an elastic flat" if isinstance(flat, CounterBody) else str(flat)
    return f"{name} of E = {value_with_uncertainty(body.E, body.u_E, 'Pa')} and ν = {body.nu:g}"


def flat_rows(flat: Flat, sphere: Sphere, model: xr.Dataset) -> list[tuple[str, str, str]]:
    """Return the flat under a drop for a page, with its effect; and the inside of a sphere that is not homogeneous."""
    effect = "counter_body in session.toml"
    for name, modulus in modulus_of(flat).items():
        at = model["uncertain"].values.tolist().index(name)
        shorter = -float(model["slope_contact_duration"][at, 0]) * modulus.value / float(model["contact_duration"][0])
        effect = f"on a rigid one the first contact would last {100.0 * shorter:.2g} % less"
    rows = [("counter-body", described_flat(flat), effect)]
    surface, inside = sphere.temperature, sphere.inside
    if surface is not None and inside is not None and inside.u > surface.u:
        shown = f"{inside.value:g} ± {inside.u:.2g} °C"
        text = f"read at the surface: the inside may have any from there to {sphere.ambient.value:g} °C"
        rows.append(("temperature", shown, f"{text}; homogeneous = true in session.toml says that it has not"))
    return rows


def resolve_plate(given: Plate | None, found: xr.Dataset | None) -> "contact.Plate | None":
    """Return the plate of the model, that of session.toml or the result of a plate vibration; None is a rigid one."""
    inputs = plate_inputs(given, found)
    return contact.Plate(**{name: each.value for name, each in inputs.items()}) if inputs else None


def plate_inputs(given: Plate | None, found: xr.Dataset | None) -> dict[str, Quantity]:
    """Return the uncertain numbers of the plate by their names in :class:`labpipe.contact.Plate`.

    Raises
    ------
    InputError
        The plate vibration found no modal mass.
    """
    if found is None:
        return {} if given is None else {name: getattr(given, name) for name in _OF_PLATE}
    if not np.isfinite(float(found["mass"])):
        raise InputError(
            "the plate vibration found no modal mass; name its sphere (radius and mass) and drops of a "
            "material of a DMA experiment or of the library, or give plate = {mass, frequency, damping_ratio} here"
        )
    return {name: Quantity(float(found[name]), float(found[f"u_{name}"]), unit) for name, unit in _OF_PLATE.items()}


def floor_under(given: Plate | None, found: xr.Dataset | None, mass: Quantity) -> signals.Floor | None:
    """Return the plate as the analysis of impacts of a mass needs it, None where no plate is known."""
    if found is not None and not np.isfinite(float(found["mass"])):
        return None
    inputs = plate_inputs(given, found)
    return signals.Floor(mass.value / inputs["mass"].value, inputs["frequency"].value) if inputs else None

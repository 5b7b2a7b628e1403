"""The elastic flat under a sphere: as the simulations take it, as one of their inputs, and in words."""

import xarray as xr

from labpipe import contact
from labpipe.report import value_with_uncertainty
from labpipe.units import Quantity
from pipelines.experiments.shared.material_choice import OF_LIBRARY
from pipelines.experiments.shared.settings import CounterBody, Flat, Sphere


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

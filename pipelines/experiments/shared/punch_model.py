"""Model of the indentations of rubber: the elastic force of the punch, and the simulation.

The displacement of a test is the stage position minus that of first touch; the model gets the
measured one, whatever was commanded.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import westergaard
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.uncertainty import Source, combined_uncertainty
from labpipe.units import Quantity
from pipelines.experiments.shared import mach1_readings
from pipelines.experiments.shared.material_choice import Variation
from pipelines.experiments.shared.punch_settings import IndentationModel, Punch, Substrate

_RELATIVE_CHANGE = 1e-3  # of an input by which a sensitivity is found
_LEAST_SHIFT = 1e-7  # m of first touch for the same purpose: far above the solver's own error
_UNIT_MODULUS = 1e6  # Pa; a soft elastic solid whose force is divided by it
_INCOMPRESSIBLE = 0.5  # what a layer's ratio is taken for when no material is named


@dataclass(frozen=True, slots=True)
class Geometry:
    """What the elastic force depends on besides the modulus; m, ratio of Poisson."""

    radius: Quantity
    period: Quantity
    depth: Quantity
    tips: int
    thickness: float
    nu: float
    model: IndentationModel

    @classmethod
    def of(cls, punch: Punch, substrate: Substrate | None, model: IndentationModel, nu: float | None) -> "Geometry":
        """Gather it from the settings."""
        layer = None if substrate is None else substrate.thickness
        return cls(
            punch.radius,
            punch.period,
            punch.depth,
            punch.tips,
            np.inf if layer is None else layer.value,
            _INCOMPRESSIBLE if nu is None else nu,
            model,
        )

    def pressed(self, solid: Prony, time: Floats, depth: Floats) -> xr.Dataset:
        """Simulate the punch at displacements (sample,) [m] of times [s]."""
        profile, elements = self.model.profile, self.model.elements
        sizes = (self.radius.value, self.period.value, self.depth.value * self.tips)
        return contact.indent(solid, *sizes, time, depth, profile=profile, thickness=self.thickness, elements=elements)


def elastic_force(displacement: Floats, geometry: Geometry, **changed: float) -> Floats:
    """Return force over reduced modulus [m²] of an elastic contact at displacements [m].

    Parameters
    ----------
    displacement : array (n,) [m]
    geometry : Geometry
    **changed
        ``radius``, ``period`` or ``depth`` [m] instead of the geometry's, for sensitivities.

    Notes
    -----
    Closed forms for parabola and cosine on a half-plane (for the cosine eq. 2.17), boundary
    elements otherwise.
    """
    radius, period, depth = (changed.get(name, getattr(geometry, name).value) for name in ("radius", "period", "depth"))
    length = depth * geometry.tips
    profile = geometry.model.profile
    inside = np.maximum(np.asarray(displacement, float), 0.0)
    if profile != "circle" and np.isinf(geometry.thickness):
        state = westergaard.from_displacement(inside, radius, period, 1.0, profile)
        return np.asarray(state.force * length)
    order = np.argsort(inside)
    solid = Prony(_UNIT_MODULUS * (1 - geometry.nu**2), [], [], nu=geometry.nu)
    made = contact.indent(
        solid,
        radius,
        period,
        length,
        np.arange(inside.size, dtype=float),
        inside[order],
        profile=profile,
        thickness=geometry.thickness,
        elements=geometry.model.elements,
    )
    force = np.empty(inside.size)
    force[order] = made["force"].values / _UNIT_MODULUS
    return force


def relative_sources(displacement: float, u_touch: float, geometry: Geometry) -> list[Source]:
    """Return what makes the elastic force at a displacement uncertain, relative to the force."""
    at = np.array([displacement])
    force = float(elastic_force(at, geometry)[0])
    sources = []
    for name in ("radius", "period", "depth"):
        given: Quantity = getattr(geometry, name)
        change = _RELATIVE_CHANGE * given.value
        other = float(elastic_force(at, geometry, **{name: given.value + change})[0])
        slope = (other - force) / change / force
        label = {"radius": "tip radius", "period": "period", "depth": "length of a tip"}[name]
        sources.append(Source.of(label, given, slope))
    step = _RELATIVE_CHANGE * displacement
    other = float(elastic_force(at + step, geometry)[0])
    slope = (other - force) / step / force
    sources.append(Source("first touch", 0.0, u_touch, "m", -slope, "systematic"))
    return sources


def simulated(
    loads: xr.Dataset, touch: Quantity, solid: Prony, geometry: Geometry, others: Mapping[str, Variation]
) -> tuple[Floats, Floats, Floats, dict[str, Any]]:
    """Simulate a whole file with its measured displacement.

    Parameters
    ----------
    loads : Dataset
    touch : Quantity [m]
        Stage position of first touch.
    solid : Prony
    geometry : Geometry
    others : mapping of str to Variation
        What is uncertain of the solid.

    Returns
    -------
    force, u_force : array (sample,) [N]
        The uncertainty is that of first touch and of the punch's dimensions.
    of_solid : array (variation, sample) [N]
        Change of the force with each uncertainty of the solid, by its standard uncertainty.
    attrs : dict
        ``solver``, ``solver_reason``, ``datum`` and the JSON counts ``work``.
    """
    time = mach1_readings.clock(loads)
    if np.any(np.diff(time) < 0):
        message = "the blocks of the file overlap in time; their start times cannot be right"
        raise InputError(message)
    depth = loads["position_z"].values - touch.value
    kept = mach1_readings.history(time, depth)

    made = geometry.pressed(solid, time[kept], depth[kept])
    force = np.interp(time, time[kept], made["force"].values)
    deepest = float(depth.max())
    relative = combined_uncertainty(relative_sources(deepest, 0.0, geometry)) if deepest > 0 else 0.0
    attrs = {key: str(made.attrs[key]) for key in ("solver", "solver_reason", "datum")}
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    work |= {"history_samples": int(kept.size), "history_samples_total": int(time.size)}
    area = elastic_force(depth[kept], geometry)
    best = _superposed(time[kept], area, solid)

    def change(area: Floats, solid: Prony, u_per_step: float) -> Floats:
        made = (_superposed(time[kept], area, solid) - best) * u_per_step / (1.0 - geometry.nu**2)
        return np.interp(time, time[kept], made)

    # By Lee and Radok's superposition of elastic forces, J. Appl. Mech. 27 (1960) 438,
    # doi:10.1115/1.3644020: exact while the contact grows, and close enough for an uncertainty while
    # it recedes a little.
    shift = max(touch.u, _LEAST_SHIFT)
    u_touch = change(elastic_force(depth[kept] - shift, geometry), solid, touch.u / shift)
    of_solid = np.array([change(area, other.solid, other.given.u / other.change) for other in others.values()])
    return (
        force,
        np.hypot(u_touch, relative * force),
        of_solid.reshape(-1, time.size),
        attrs | {"work": json.dumps(work)},
    )


def _superposed(time: Floats, area: Floats, solid: Prony) -> Floats:
    """Return ∫ E(t − s) dA(s) for A linear between samples and 0 before [Pa m²]."""
    E, rho = np.asarray(solid.E), np.asarray(solid.rho)
    level = np.full(rho.size, area[0])
    force = solid.E_relaxed * area
    force[0] += float(E @ level)
    step = np.diff(time)
    x = step[:, None] / rho
    decay = np.exp(-x)
    gained = np.where(x > 0.0, -np.expm1(-x) / np.where(x > 0.0, x, 1.0), 1.0) * np.diff(area)[:, None]
    for n in range(step.size):
        level = level * decay[n] + gained[n]
        force[n + 1] += float(E @ level)
    return force

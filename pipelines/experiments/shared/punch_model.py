"""Model of the indentations of rubber: the elastic force of the punch, and the simulation.

The displacement of a test is the stage position minus that of first touch; the model gets the
measured one, whatever was commanded.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.line import westergaard
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.uncertainty import Source
from labpipe.units import Quantity
from labpipe.variables import variable, with_u
from pipelines.experiments.shared import mach1_readings, mach1_touch
from pipelines.experiments.shared.comparison_rows import FORCE_SCALE, STIFFNESS
from pipelines.experiments.shared.mach1_readings import relative_gain
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.shared.model_inputs import inputs_of, table_of
from pipelines.experiments.shared.punch_settings import Indentation, IndentationModel, Punch, Substrate

TOUCH = "first touch"
SHIFT = mach1_touch.STEP
"""m of first touch by which a derivative is found: far above the solver's own error."""
NOTHING_NAMED = "session.toml names no punch and no substrate, so nothing was simulated"
_DIMENSIONS = {"radius": "tip radius", "period": "period", "depth": "length of a tip"}
_RELATIVE_CHANGE = 1e-3  # of an input by which a sensitivity is found


@dataclass(frozen=True, slots=True)
class Geometry:
    """Quantities on which the elastic force depends in addition to the modulus; thickness in m, ratio of Poisson."""

    punch: Punch
    model: IndentationModel
    thickness: float
    nu: float

    @classmethod
    def of(cls, punch: Punch, substrate: Substrate | None, model: IndentationModel, nu: float | None) -> "Geometry":
        """Gather it from the settings; rubber of which nothing is named is incompressible and thick."""
        layer = None if substrate is None else substrate.thickness
        return cls(punch, model, np.inf if layer is None else layer.value, 0.5 if nu is None else nu)

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Radius and period of the tips, and their length together [m]."""
        return self.punch.radius.value, self.punch.period.value, self.punch.depth.value * self.punch.tips

    def enlarged(self, name: str) -> "Geometry":
        """Return it with one dimension of the punch larger by the relative change of a sensitivity."""
        given: Quantity = getattr(self.punch, name)
        larger = given._replace(value=(1.0 + _RELATIVE_CHANGE) * given.value)
        return replace(self, punch=msgspec.structs.replace(self.punch, **{name: larger}))

    def pressed(self, solid: Prony, time: Floats, depth: Floats) -> xr.Dataset:
        """Simulate the punch at displacements (sample,) [m] of times [s]."""
        sizes, profile, elements = self.sizes, self.model.profile, self.model.elements
        return contact.indent(solid, *sizes, time, depth, profile=profile, thickness=self.thickness, elements=elements)


def elastic_force(displacement: Floats, geometry: Geometry) -> Floats:
    """Return force over reduced modulus [m²] of an elastic contact at displacements [m].

    Closed forms for parabola and cosine on a half-plane (for the cosine eq. 2.17), boundary elements otherwise.
    """
    profile, inside = geometry.model.profile, np.maximum(np.asarray(displacement, float), 0.0)
    if profile != "circle" and np.isinf(geometry.thickness):
        radius, period, length = geometry.sizes
        return np.asarray(westergaard.from_displacement(inside, radius, period, 1.0, profile).force * length)
    order, force = np.argsort(inside), np.empty(inside.size)
    made = geometry.pressed(Prony(1e6, [], [], nu=geometry.nu), np.arange(inside.size, dtype=float), inside[order])
    force[order] = made["force"].values * (1.0 - geometry.nu**2) / 1e6
    return force


def relative_sources(displacement: float, u_touch: float, geometry: Geometry) -> list[Source]:
    """Return the sources of uncertainty of the elastic force at a displacement, relative to the force."""
    at = np.array([displacement])
    force = float(elastic_force(at, geometry)[0])

    def slope(changed: Floats) -> float:
        return (float(changed[0]) / force - 1.0) / _RELATIVE_CHANGE

    sources = []
    for name, label in _DIMENSIONS.items():
        given: Quantity = getattr(geometry.punch, name)
        sources.append(Source.of(label, given, slope(elastic_force(at, geometry.enlarged(name))) / given.value))
    deeper = elastic_force((1.0 + _RELATIVE_CHANGE) * at, geometry)
    sources.append(Source(TOUCH, 0.0, u_touch, "m", -slope(deeper) / displacement, "systematic"))
    return sources


def effects(loads: xr.Dataset, simulated: Floats, model: xr.Dataset) -> Floats:
    """Return the changes (effect, sample) [N] of measured minus simulated force by one u of each source of error.

    They are tare, gain and delay of the cell, and the inputs of the model, these behind the cell's filter.
    """
    of_cell = [np.full(simulated.size, float(loads["u_tare"])), relative_gain(loads) * loads["force"].values]
    of_cell += [mach1_readings.filter_delay(loads).u * np.gradient(simulated, float(loads["sampling_interval"][0]))]
    known = [(float(u), slope) for u, slope in zip(model["input_u"].values, model["slope"].values, strict=True) if u]
    return np.array([*of_cell, *(u * mach1_readings.passed(loads, slope.astype(float)) for u, slope in known)])


def inputs_behind(loads: xr.Dataset, model: xr.Dataset) -> dict[str, Quantity]:
    """Return the inputs of a comparison of forces: the cell's scale, a stiffness as a whole, and those of the model."""
    scale = Quantity(1.0, relative_gain(loads), "1")
    return {FORCE_SCALE: scale, STIFFNESS: Quantity(1.0, 0.0, "1")} | inputs_of(model)


def absent(settings: Indentation, found: xr.Dataset) -> str:
    """Return why nothing can be simulated where punch, substrate or first touch is missing."""
    is_named = settings.punch is not None and settings.substrate is not None
    return str(found.attrs["contact"]) if is_named else NOTHING_NAMED


def model(
    loads: xr.Dataset, found: xr.Dataset, file: Path | None, fitted: xr.Dataset | None, *, settings: Indentation
) -> xr.Dataset:
    """Simulate a whole file with its measured displacement, from the stage position of first touch, ``found``, on.

    Returns ``force`` (sample,) [N] before the cell's filter with its ``u_``, its inputs (:data:`.INPUTS`) and
    ``slope`` (uncertain, sample), the change of the force with each, SI. They are first touch, the punch and those of
    the solid; the number of tips has no uncertainty, but can be stated wrongly. Attributes say how it was made.
    Without punch, substrate and first touch there is nothing to simulate: the result says so.
    """
    from labpipe.identification import lee_radok_basis

    punch, substrate, touch = settings.punch, settings.substrate, mach1_readings.touch_of(found)
    if punch is None or substrate is None or not np.isfinite(touch.value):
        return xr.Dataset(attrs={"absent": absent(settings, found)})
    solid, time = resolve(substrate, file, fitted), mach1_readings.clock(loads)
    geometry = Geometry.of(punch, substrate, settings.model, float(solid.nu))
    if np.any(np.diff(time) < 0):
        raise InputError("the blocks of the file overlap in time; their start times cannot be right")
    depth = loads["position_z"].values - touch.value
    kept = mach1_readings.history(time, depth)
    made = geometry.pressed(solid, time[kept], depth[kept])
    force = np.interp(time, time[kept], made["force"].values)

    def superposed(area: Floats, solid: Prony) -> Floats:
        basis = lee_radok_basis(time[kept], area, np.asarray(solid.rho), geometry.nu, may_recede=True)
        return np.interp(time, time[kept], np.asarray(basis @ [solid.E_relaxed, *solid.E]))

    # By Lee and Radok's superposition of elastic forces, J. Appl. Mech. 27 (1960) 438,
    # doi:10.1115/1.3644020: exact while the contact grows, and close enough for an uncertainty while
    # it recedes a little.
    area, shift = elastic_force(depth[kept], geometry), max(touch.u, SHIFT)
    best, higher = superposed(area, solid), superposed(elastic_force(depth[kept] - shift, geometry), solid)
    slopes = {TOUCH: (touch, (higher - best) / shift)}
    deepest = float(depth.max())
    for source in relative_sources(deepest, 0.0, geometry)[:-1] if deepest > 0 else ():
        slopes[source.source] = Quantity(source.value, source.u, source.unit), source.sensitivity * force
    tips = float(geometry.punch.tips)
    slopes["number of tips"] = Quantity(tips, 0.0, "1"), force / tips
    # the force depends on the solid from one reading to the whole record
    times = float(np.median(np.diff(loads["time"].values))), float(np.ptp(time))
    others = variations(substrate, file, fitted, times)
    slopes |= {name: (o.given, (superposed(area, o.solid) - best) / o.change) for name, o in others.items()}
    slope = np.array([one for _, one in slopes.values()])
    u = np.linalg.norm(slope * [[given.u] for given, _ in slopes.values()], axis=0)
    work = json.loads(made.attrs["work"]) | {"history_samples": int(kept.size), "history_samples_total": time.size}
    work.pop("seconds", None)  # the clock has no place in a stored result
    attrs = {key: str(made.attrs[key]) for key in ("solver", "datum")} | {"work": json.dumps(work)}
    text = "simulated force, before the cell's filter"
    table = with_u("force", "sample", force, u, "N", text, "from first touch, punch and solid")
    text = "change of the simulated force with an input, SI"
    table["slope"] = variable(("uncertain", "sample"), slope.astype(np.float32), "1", text)
    return table_of({name: given for name, (given, _) in slopes.items()}).assign(table).assign_attrs(attrs)

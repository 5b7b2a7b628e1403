"""The drop simulated, with the uncertainty of its largest radius."""

import json
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.arrays import Floats
from labpipe.contact.sphere import hertz
from labpipe.imaging.fringes import edge_shift
from labpipe.materials import Prony
from labpipe.uncertainty import Source, budget_rows, combined_uncertainty
from labpipe.variables import variable, with_u
from pipelines.experiments.contact_area._peaks import WINDOW
from pipelines.experiments.contact_area.measured import edges_only
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.material_choice import resolve, variations
from pipelines.experiments.shared.material_inputs import kept_in
from pipelines.experiments.shared.plate_under_drop import plate_inputs, resolve_plate

_STEP = 2e-5  # s, spacing of the model's curve
_COARSE = 1e-4  # tolerance of the simulations by which sensitivities are found


def model(
    radius: xr.Dataset,
    impacts: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    *,
    settings: ContactArea,
    full: bool = False,
) -> xr.Dataset:
    """Simulate the drop for as long as the film lasts after its first contact.

    ``full`` takes the simulator's shortcuts away; the numbers stay the same within ``rtol``.
    """
    sphere = settings.sphere
    solid = resolve(sphere, material_file, fitted)
    gravity = settings.model.gravity.value
    fall = float(np.sqrt(2 * settings.height.value / gravity))
    begun = float(impacts["first_seen"][0]) if impacts.sizes["impact"] else 0.0
    duration = fall + float(radius["time"][-1]) - begun + 2 * WINDOW
    beneath = resolve_plate(settings.plate, plate)
    made = _simulated(settings, solid, beneath, duration, full)
    # a film that lost frames shows more impacts than its time has room for
    if 1 < made.sizes["impact"] < impacts.sizes["impact"]:
        duration += float(np.diff(made["impact_time"])[-1])
        made = _simulated(settings, solid, beneath, duration, full)
    largest = made["peak_contact_radius"].values
    of_material = _of_material(settings, material_file, fitted, beneath, made, duration) if largest.size else []
    relative_ones = [[*_of_body(settings), *each] for each in of_material]
    sources = (
        [s._replace(sensitivity=s.sensitivity * float(largest[0])) for s in relative_ones[0]] if largest.size else []
    )
    # impacts after those that are compared are as uncertain as the last of these
    each_u = [combined_uncertainty(relative_ones[min(i, len(relative_ones) - 1)]) for i in range(largest.size)]
    made["u_peak_contact_radius"] = variable(
        "impact", np.array(each_u) * largest, "m", "standard uncertainty from height, body and material: peak"
    )
    made.attrs |= {"budget": json.dumps(budget_rows(sources))} | kept_in(of_material)
    text = "distance of the edge of an adhesive contact from the Hertz-equivalent radius, at its largest"
    beyond = _edge_beyond(largest, made, solid, settings, radius)
    made = made.assign(with_u("adhesion_shift", "impact", *beyond, "m", text))
    weight = sphere.mass.value * gravity
    # a glass never relaxes in a film: its limits at rest are those of the times that the film shows
    brief = float(made["contact_duration"][0]) if largest.size else _STEP
    for name, time in (("brief", brief), ("lasting", duration - fall)):
        reduced = 1.0 / (float(solid.creep(time)) * (1 - float(solid.nu) ** 2))
        state = hertz.static_load(weight, sphere.radius.value, reduced)
        text = f"Hertz radius under the weight after a creep of {time:.2g} s"
        radius_at_rest = float(state.contact_radius)
        relative = combined_uncertainty(_at_rest(settings, material_file, fitted, solid, time))
        made = made.assign(with_u(f"static_radius_{name}", (), radius_at_rest, relative * radius_at_rest, "m", text))
    mass = plate_inputs(settings.plate, plate).get("mass")
    made.attrs["plate_mass"] = json.dumps(None if mass is None else [mass.value, mass.u])
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    made.attrs["work"] = json.dumps(work)
    return made


def _simulated(
    settings: ContactArea, solid: Prony, plate: contact.Plate | None, duration: float, full: bool
) -> xr.Dataset:
    return contact.drop(
        solid,
        settings.sphere.radius.value,
        settings.sphere.mass.value,
        settings.height.value,
        duration,
        settings.model.solver,
        settings.model.profile,
        settings.model.rtol,
        gravity=settings.model.gravity.value,
        plate=plate,
        times=np.arange(0.0, duration, _STEP),
        fold=not full,
        shortcuts=contact.Shortcuts.chosen(full=full),
    )


def _at_rest(
    settings: ContactArea, material_file: Path | None, fitted: xr.Dataset | None, solid: Prony, time: float
) -> list[Source]:
    """Return what makes a radius at rest uncertain, relative to it: a ~ (R m J)^(1/3)."""
    sphere = settings.sphere
    sources = [
        Source.of(name, q, 1.0 / (3.0 * q.value)) for name, q in (("radius", sphere.radius), ("mass", sphere.mass))
    ]
    compliance = float(solid.creep(time))
    for name, (q, step, other) in variations(sphere, material_file, fitted, (time, time)).items():
        sources.append(Source.of(name, q, float(np.log(float(other.creep(time)) / compliance)) / (3.0 * step)))
    return sources


def _edge_beyond(
    largest: Floats, made: xr.Dataset, solid: Prony, settings: ContactArea, radius: xr.Dataset
) -> tuple[Floats, Floats]:
    """Return how far outside Hertz's radius the edges of the largest contacts lie by JKR, with its uncertainty."""
    if not largest.size:
        return np.zeros(0), np.zeros(0)
    omega = np.pi / float(made["contact_duration"][0])
    reduced = abs(complex(solid.complex_modulus(omega))) / (1 - float(solid.nu) ** 2)
    given, light = settings.work_of_adhesion, settings.wavelength
    work, u_work = (None, 0.0) if given is None else (given.value, given.u)
    wavelength = None if light is None else light.value
    is_spot = bool(np.greater(*edges_only(radius)))
    return edge_shift(largest, settings.sphere.radius.value, reduced, work, u_work, wavelength, is_spot)


def _of_body(settings: ContactArea) -> list[Source]:
    """Return what makes the largest radius uncertain but for the material, relative to it: a ~ R^0.4 (m h)^0.2."""
    sphere = settings.sphere
    given = (("radius", sphere.radius, 0.4), ("mass", sphere.mass, 0.2), ("height", settings.height, 0.2))
    return [Source.of(name, q, power / q.value) for name, q, power in given]


def _of_material(
    settings: ContactArea,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: contact.Plate | None,
    made: xr.Dataset,
    duration: float,
) -> list[list[Source]]:
    """Return what of the material makes the largest radius of each of the first impacts uncertain, relative to it.

    By simulation: a later impact is slower by what those before it have lost.
    """
    time = float(made["contact_duration"][0]) / np.pi
    found = variations(settings.sphere, material_file, fitted, (time, time))
    count = min(IMPACTS, made.sizes["impact"])
    radii = contact.impacts(
        [resolve(settings.sphere, material_file, fitted), *(other for _, _, other in found.values())],
        settings.sphere.radius.value,
        settings.sphere.mass.value,
        settings.height.value,
        duration,
        count,
        settings.model.profile,
        _COARSE,
        gravity=settings.model.gravity.value,
        plate=plate,
    )["peak_contact_radius"].values
    changes = np.nan_to_num(np.log(radii[1:] / radii[0]))
    return [
        [
            Source.of(name, q, float(change[i]) / step)
            for (name, (q, step, _)), change in zip(found.items(), changes, strict=True)
        ]
        for i in range(count)
    ]

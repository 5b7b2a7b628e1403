"""The drop simulated, with the uncertainty of its largest radius."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.contact.sphere import hertz
from labpipe.imaging.fringes import edge_shift
from labpipe.materials import Prony
from labpipe.uncertainty import Source, budget_rows, combined_uncertainty
from labpipe.variables import variable, with_u
from pipelines.experiments.contact_area.measured import WINDOW, edges_only
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.material_choice import Variation, resolve, variations
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

    ``full`` disables the simulator's shortcuts; the numbers stay the same within ``rtol``.
    """
    sphere, chosen, height = settings.sphere, settings.model, settings.height
    solid = resolve(sphere, material_file, fitted)
    gravity, beneath = chosen.gravity.value, resolve_plate(settings.plate, plate)
    body = (sphere.radius.value, sphere.mass.value, height.value)

    def simulated(duration: float) -> xr.Dataset:
        return contact.drop(
            solid,
            *body,
            duration,
            chosen.solver,
            chosen.profile,
            chosen.rtol,
            gravity=gravity,
            plate=beneath,
            times=np.arange(0.0, duration, _STEP),
            fold=not full,
            shortcuts=contact.Shortcuts.chosen(full=full),
        )

    fall = float(np.sqrt(2 * height.value / gravity))
    begun = float(impacts["first_seen"][0]) if impacts.sizes["impact"] else 0.0
    duration = fall + float(radius["time"][-1]) - begun + 2 * WINDOW
    made = simulated(duration)
    # a film that lost frames shows more impacts than its time has room for
    if 1 < made.sizes["impact"] < impacts.sizes["impact"]:
        duration += float(np.diff(made["impact_time"])[-1])
        made = simulated(duration)
    largest = made["peak_contact_radius"].values
    first = float(made["contact_duration"][0]) if largest.size else _STEP

    # the largest radius, relative: a ~ R^0.4 (m h)^0.2 of the body; of the material by simulation, as a later impact
    # is slower by the losses of those before it
    given = (("radius", sphere.radius, 0.4), ("mass", sphere.mass, 0.2), ("height", height, 0.2))
    of_body = [Source.of(name, q, power / q.value) for name, q, power in given]
    of_material: list[list[Source]] = []
    if largest.size:
        found = variations(sphere, material_file, fitted, (first / np.pi, first / np.pi))
        solids, count = [solid, *(other for _, _, other in found.values())], min(IMPACTS, largest.size)
        trials = contact.impacts(
            solids, *body, duration, count, chosen.profile, _COARSE, gravity=gravity, plate=beneath
        )["peak_contact_radius"].values
        changes = np.nan_to_num(np.log(trials[1:] / trials[0]))
        of_material = [
            [
                Source.of(name, q, float(change[i]) / step)
                for (name, (q, step, _)), change in zip(found.items(), changes, strict=True)
            ]
            for i in range(count)
        ]
    relative = [[*of_body, *each] for each in of_material]
    sources = [s._replace(sensitivity=s.sensitivity * float(largest[0])) for each in relative[:1] for s in each]
    # impacts after those that are compared are as uncertain as the last of these
    each_u = [combined_uncertainty(relative[min(i, len(relative) - 1)]) for i in range(largest.size)]
    text = "standard uncertainty from height, body and material: peak"
    made["u_peak_contact_radius"] = variable("impact", np.array(each_u) * largest, "m", text)

    made = _with_edge(made, solid, radius, settings)
    for name, time in (("brief", first), ("lasting", duration - fall)):
        # a glass never relaxes in a film: its limits at rest are those of the times that the film shows
        text = f"Hertz radius under the weight after a creep of {time:.2g} s"
        at_rest = _at_rest(settings, variations(sphere, material_file, fitted, (time, time)), solid, time)
        made = made.assign(with_u(f"static_radius_{name}", (), *at_rest, "m", text))
    mass = plate_inputs(settings.plate, plate).get("mass")
    work = json.loads(made.attrs["work"])
    work.pop("seconds", None)  # the clock has no place in a stored result
    kept = {"budget": budget_rows(sources), "plate_mass": mass and [mass.value, mass.u], "work": work}
    return made.assign_attrs(**{n: json.dumps(value) for n, value in kept.items()}, **kept_in(of_material))


def _with_edge(made: xr.Dataset, solid: Prony, radius: xr.Dataset, settings: ContactArea) -> xr.Dataset:
    """Add the distance by JKR of the edges of the largest contacts from the Hertz-equivalent radius, with its u."""
    largest, beyond = made["peak_contact_radius"].values, (np.zeros(0), np.zeros(0))
    if largest.size:
        omega = np.pi / float(made["contact_duration"][0])
        reduced = abs(complex(solid.complex_modulus(omega))) / (1 - float(solid.nu) ** 2)
        work, light = settings.work_of_adhesion, settings.wavelength
        stated, u_stated = (None, 0.0) if work is None else (work.value, work.u)
        wavelength, is_spot = None if light is None else light.value, bool(np.greater(*edges_only(radius)))
        beyond = edge_shift(largest, settings.sphere.radius.value, reduced, stated, u_stated, wavelength, is_spot)
    text = "distance of the edge of an adhesive contact from the Hertz-equivalent radius, at its largest"
    return made.assign(with_u("adhesion_shift", "impact", *beyond, "m", text))


def _at_rest(settings: ContactArea, found: Mapping[str, Variation], solid: Prony, time: float) -> tuple[float, float]:
    """Return Hertz's radius [m] under the weight after a creep of some time [s], with its u: a ~ (R m J)^(1/3)."""
    radius, mass = settings.sphere.radius, settings.sphere.mass
    compliance = float(solid.creep(time))
    reduced = 1.0 / (compliance * (1 - float(solid.nu) ** 2))
    at_rest = hertz.static_load(mass.value * settings.model.gravity.value, radius.value, reduced).contact_radius
    sources = [Source.of(name, q, 1.0 / (3.0 * q.value)) for name, q in (("radius", radius), ("mass", mass))]
    sources += [
        Source.of(name, q, float(np.log(float(other.creep(time)) / compliance)) / (3.0 * step))
        for name, (q, step, other) in found.items()
    ]
    return float(at_rest), combined_uncertainty(sources) * float(at_rest)

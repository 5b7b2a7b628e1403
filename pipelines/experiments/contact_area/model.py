"""The drop simulated, with the uncertainty of its largest radius."""

from pathlib import Path

import numpy as np
import xarray as xr

from labpipe.contact.sphere import counter_compliance, hertz
from labpipe.imaging.fringes import edge_shift
from labpipe.uncertainty import Source, combined_uncertainty
from labpipe.variables import with_u
from pipelines.experiments.contact_area.measured import WINDOW, edges_only
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.comparison_rows import IMPACTS
from pipelines.experiments.shared.counter_body import counter_body_of, modulus_of
from pipelines.experiments.shared.drop_model import simulated_drop
from pipelines.experiments.shared.material_choice import resolve, variations


def model(
    radius: xr.Dataset,
    impacts: xr.Dataset,
    material_file: Path | None,
    fitted: xr.Dataset | None,
    plate: xr.Dataset | None,
    *,
    settings: ContactArea,
    full: bool = False,
    step: float = 2e-5,
) -> xr.Dataset:
    """Simulate the drop for as long as the film lasts after its first contact, a point of the curve each ``step`` [s].

    ``full`` disables the simulator's shortcuts; the numbers stay the same within ``rtol``.
    """
    sphere, sources = settings.sphere, (material_file, fitted, plate)
    fall = float(np.sqrt(2 * settings.height.value / settings.model.gravity.value))
    begun = float(impacts["first_seen"][0]) if impacts.sizes["impact"] else 0.0
    duration = fall + float(radius["time"][-1]) - begun + 2 * WINDOW
    of = "peak_contact_radius"
    made = simulated_drop(settings, *sources, duration, step, followed=IMPACTS, of_budget=of, full=full)
    solid = resolve(sphere, material_file, fitted)
    first = float(made["contact_duration"][0]) if made.sizes["impact"] else step
    flat, factor = counter_compliance(counter_body_of(settings.counter_body)), 1 - float(solid.nu) ** 2
    largest, beyond = made["peak_contact_radius"].values, (np.zeros(0), np.zeros(0))
    if largest.size:  # the edges of the largest contacts by JKR
        reduced = abs(complex(solid.complex_modulus(np.pi / first))) / factor
        work, light = settings.work_of_adhesion, settings.wavelength
        stated, u_stated = (None, 0.0) if work is None else (work.value, work.u)
        wavelength, is_spot = None if light is None else light.value, bool(np.greater(*edges_only(radius)))
        edge = (reduced / (1 + reduced * flat), stated, u_stated, wavelength, is_spot)
        beyond = edge_shift(largest, sphere.radius.value, *edge)
    text = "distance of the edge of an adhesive contact from the Hertz-equivalent radius, at its largest"
    made = made.assign(with_u("adhesion_shift", "impact", *beyond, "m", text))
    weight = sphere.mass.value * settings.model.gravity.value
    known = [Source.of(of, q, 1.0 / (3.0 * q.value)) for of, q in (("radius", sphere.radius), ("mass", sphere.mass))]
    for name, time in (("brief", first), ("lasting", duration - fall)):
        # a glass never relaxes in a film: its limits at rest, a ~ (R m J)^(1/3), are those of the times that it shows
        whole, parts = factor * float(solid.creep(time)) + flat, list(known)
        for of, (q, by, other) in variations(sphere, material_file, fitted, (time, time)).items():
            changed = (factor * float(other.creep(time)) + flat) / whole
            parts.append(Source.of(of, q, float(np.log(changed)) / (3.0 * by)))
        moduli = modulus_of(settings.counter_body).items()
        parts += [Source.of(of, E, -flat / (3.0 * whole * E.value)) for of, E in moduli]
        at_rest = float(hertz.static_load(weight, sphere.radius.value, 1.0 / whole).contact_radius)
        text = f"Hertz radius under the weight after a creep of {time:.2g} s"
        u = combined_uncertainty(parts) * at_rest
        made = made.assign(with_u(f"static_radius_{name}", (), at_rest, u, "m", text))
    return made

"""Extreme drops on a plate that swings: the ledger of energy, and springs against rings."""

import warnings
from collections.abc import Mapping
from math import sqrt
from typing import Any

import numpy as np
import xarray as xr

from labpipe import contact
from labpipe.contact.sphere import hertz
from tests.extremes.inputs import Random, below_zero, extreme_material
from tests.extremes.outcome import Case, Outcome, worst

#: Work that one drop may take before it is refused.
_MOST_STEPS = 3_000
#: The springs as they are asked for, and the rings, whose steps err as a whole, as a witness that errs less.
_SPRINGS_AND_WITNESS: tuple[dict[str, Any], ...] = ({}, {"solver": "rings", "rtol": 1e-5, "max_steps": 20_000})


def _drawn(random: Random) -> tuple[dict[str, Any], float]:
    """Draw 1 ug to 1 t, 1 um to 1 m in radius, a plate of any mass, 1 Hz to 10 MHz; and the speed at touch."""
    mass, height = 10 ** random.uniform(-9, 3), 10 ** random.uniform(-9, 0)
    plate = contact.Plate(
        mass=mass * 10 ** random.uniform(-2, 5),
        frequency=10 ** random.uniform(0, 7),
        damping_ratio=float(random.choice([0.0, 10 ** random.uniform(-4, -0.05)])),
    )
    body = {
        "material": extreme_material(random),
        "radius": f"{10 ** random.uniform(-6, 0)!r} m",  # as a text, which asks nobody whether millimetres were meant
        "mass": mass,
        "height": height,
        "plate": plate,
        "max_steps": _MOST_STEPS,
    }
    return body, sqrt(2.0 * 9.81 * height)


def any_drop_on_a_plate(random: Random) -> Outcome:
    """Energy bounds the error of every drop with its bounces; nothing is negative or created."""
    body, speed = _drawn(random)
    duration = speed / 9.81 * random.uniform(1.1, 4.0) + 10 ** random.uniform(-5, -2)
    found, said = _dropped(body, duration, rtol=1e-3)
    energy = body["mass"] * 9.81 * (body["height"] + float(found.approach.max()))
    error = float(np.abs(found.numerical_energy).max()) / energy
    series = ("displacement", "velocity", "force", "contact_radius", "stored_energy", "plate_displacement")
    finite = all(np.all(np.isfinite(found[name].values)) for name in series)
    return worst(
        (0.0 if said else error / 6e-3, "unreported energy error 6e-3 at rtol = 1e-3"),
        (below_zero(found.force.values), "a force below zero"),
        (below_zero(found.plate_energy.values), "a plate's energy below zero"),
        (0.0 if finite else np.inf, "a value that is not finite"),
    )


def plate_by_two_solvers(random: Random) -> Outcome:
    """Compare the first impact by springs and by rings, which share neither grid nor kernel."""
    body, speed = _drawn(random)
    material = body["material"]
    reduced = material.factor("contact") * material.E_relaxed
    longest = float(hertz.impact(speed, float(body["radius"].split()[0]), body["mass"], reduced).contact_duration)
    runs = []
    for options in _SPRINGS_AND_WITNESS:
        found, said = _dropped({**body, **options}, speed / 9.81 + 3.0 * longest)
        if said:
            return Outcome(0.0, "", "warned of its accuracy")
        runs.append(found)
    forces = [float(run.peak_force[0] if run.sizes["impact"] else run.force.max()) for run in runs]
    bounces = [float(run.restitution[0]) if run.sizes["impact"] else np.nan for run in runs]
    return worst(
        (abs(forces[0] / forces[1] - 1.0) / 4e-4, "peak forces of two solvers differ by 4e-4"),
        # A plate that meets the sphere may throw it back many times faster than it came.
        (
            np.nan_to_num(abs(bounces[0] - bounces[1]) / max(1.0, abs(bounces[1]))) / 4e-4,
            "restitution by two solvers differs by 4e-4",
        ),
    )


def _dropped(body: Mapping[str, Any], duration: float, rtol: float = 1e-4) -> tuple[xr.Dataset, bool]:
    """Return the drop, and whether it warned that it is less accurate than asked for."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = contact.drop(**{"rtol": rtol, **body}, duration=duration)
    return found, any("energy error" in str(warning.message) for warning in caught)


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {
    "any drop on a plate": (any_drop_on_a_plate, 100),
    "springs and rings on a plate": (plate_by_two_solvers, 40),
}

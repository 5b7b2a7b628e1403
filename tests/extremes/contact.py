"""Extreme cases of the periodic line, each checked against an independent method.

Every family is a function of a random generator. It makes one case far outside the ordinary, asks
for the answer, and returns how far that is from an independent one in units of what is allowed. A
refusal (:class:`~labpipe.errors.InputError`) is an answer too; anything else that is raised is a
defect and is let through.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from labpipe import contact
from labpipe.contact.line import westergaard
from labpipe.materials import Prony
from tests.extremes.inputs import Random, below_zero, extreme_material, extreme_times
from tests.extremes.outcome import Case, Outcome, worst


def elastic_line(random: Random) -> Outcome:
    """Any modulus, tip and period, from a few strips to nearly full contact: the closed form."""
    modulus, nu = 10 ** random.uniform(3, 12), float(random.uniform(0.0, 0.4999))
    period = 10 ** random.uniform(-6, 0)
    radius = period * 10 ** random.uniform(-0.5, 3)
    profile = str(random.choice(["parabola", "cosine"]))
    share = float(random.uniform(0.06, 0.47))
    reduced = modulus / (1.0 - nu**2)
    exact = westergaard.from_half_width(share * period, radius, period, reduced, profile)  # type: ignore[arg-type]
    solid = Prony(modulus, [], [], nu=nu)
    options: dict[str, Any] = {"profile": profile, "elements": 256}
    pressed = contact.indent(
        solid, radius, period, 1.0, [0.0], [float(exact.displacement)], outputs=("pressure",), **options
    )
    force = abs(float(pressed.force[0]) / float(exact.force) - 1.0)
    width = abs(float(pressed.contact_half_width[0]) / period - share) * 256
    return worst(
        (force / 5e-5, "relative error of a line's force 5e-5"),
        (width / 0.05, "error of a half width 0.05 strips"),
        (-float(pressed.pressure.min()), "a pressure below zero"),
    )


def line_history(random: Random) -> Outcome:
    """Press by a hostile history: second law, no negative pressure, finer steps agree."""
    material = extreme_material(random, 30)
    time = extreme_times(random, int(random.integers(2, 7)))
    thickness = float(random.choice([np.inf, 1e-3]))
    deepest = min(10 ** random.uniform(-6, -3.2), 0.3 * thickness)
    depth = deepest * random.uniform(-0.5, 1.0, time.size)
    profile = str(random.choice(["parabola", "circle", "cosine"]))

    def run(rtol: float) -> Any:
        return contact.indent(
            material, 2e-3, 8e-3, 1.0, time, depth, profile, thickness, 128, rtol=rtol, outputs=("energy", "pressure")
        )

    found, finer = run(1e-3), run(1e-5)
    force = found.force.values
    scale = max(float(force.max()), 1e-300)
    heat = found.dissipated_energy.values
    return worst(
        (
            float(np.abs(finer.force.values - force).max()) / scale / 5e-3,
            "difference to a hundredfold tolerance 5e-3 of the peak",
        ),
        (below_zero(found.pressure.values), "a pressure below zero"),
        (below_zero(force), "a force below zero"),
        (below_zero(np.diff(heat, prepend=0.0)), "dissipation that falls"),
        (0.0 if np.all(np.isfinite(force)) else np.inf, "a force that is no number"),
    )


#: Families and how many of their cases the tests try.
FAMILIES: Mapping[str, tuple[Case, int]] = {"elastic line": (elastic_line, 135), "history of a line": (line_history, 6)}

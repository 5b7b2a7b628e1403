"""Other materials and other temperatures of a dropped sphere, as explanations of a model that differs.

Each is simulated: a temperature acts through the shift law of the material, which is far from linear.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from labpipe import contact, materials
from labpipe.arrays import Floats
from labpipe.errors import InputError, LabpipeError
from labpipe.judging import IMPOSSIBLE, agreement
from labpipe.materials import Prony
from pipelines.experiments.shared.comparison_rows import IMPACTS, Row
from pipelines.experiments.shared.counter_body import counter_body_of, resolve_plate
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.material_choice import fitted_at, resolve
from pipelines.experiments.shared.proposals import POLYMERS
from pipelines.experiments.shared.settings import Sphere

_ACRONYMS = ("nbr", "peek", "ptfe")

SOURCES = ("material_file", "fitted", "plate")
"""Results by which the material and the plate of a drop are known."""


class Alternative(NamedTuple):
    """An alternative to a stated material: a sentence, and the differences (row,) that would be left.

    ``is_excluded``: it needs more than ten of the uncertainties that are stated of it.
    """

    sentence: str
    differences: Floats
    is_excluded: bool = False


def of_drop(
    rows: Sequence[Row],
    covariance: Floats,
    given: Given,
    settings: Any,
    *,
    reach: float = 60.0,
    nodes: int = 13,
    rtol: float = 1e-3,
) -> list[Alternative]:
    """Simulate a drop of the other polymers of library and session, and at the temperature that explains most.

    ``rows`` are the compared values, ``covariance`` (row, row) is that of their differences, and ``given`` holds
    :data:`SOURCES` of the stated drop. That temperature lies within the ``reach`` [K] of the stated one, between
    ``nodes`` that are simulated with the tolerance ``rtol``.
    """
    material_file, fitted, plate = map(given.get, SOURCES)
    measured: Mapping[str, xr.Dataset] = given.get("others") or {}
    sphere, source = settings.sphere, settings.sphere.source
    temperature = None if sphere.temperature is None else sphere.temperature.value
    known = {name: _solid(sphere, None, None, name, temperature) for name in POLYMERS if name != source}
    known |= {
        f"the material of {name}": _solid(sphere, None, curve, "", temperature) for name, curve in measured.items()
    }
    others = {name: solid for name, solid in known.items() if solid is not None}
    steps = [] if temperature is None else (temperature + np.linspace(-reach, reach, nodes)).tolist()
    warmer = {T: solid for T in steps if (solid := _solid(sphere, material_file, fitted, "", T)) is not None}
    solids = [resolve(sphere, material_file, fitted), *others.values(), *warmer.values()]
    gravity, height = settings.model.gravity.value, settings.height.value
    try:
        made = contact.impacts(
            solids,
            sphere.radius.value,
            sphere.mass.value,
            height,
            2 * IMPACTS * float(np.sqrt(2.0 * height / gravity)),  # no flight lasts longer than twice the fall
            IMPACTS,
            settings.model.profile,
            rtol,
            gravity=gravity,
            plate=resolve_plate(settings.plate, plate),
            substrate=counter_body_of(settings.counter_body),
        )
    except InputError:
        return []  # of no material can the stated sphere be simulated: its radius, mass or height is wrong
    columns = [
        np.zeros(len(solids)) if r.simulated is None else made[r.simulated[0]].values[:, r.simulated[1]] for r in rows
    ]
    expected = np.array(columns).T
    differences = np.array([row.difference or 0.0 for row in rows])
    left = differences - np.nan_to_num(expected[1:] - expected[0], nan=np.inf)
    found = [
        Alternative(f"the sphere is probably of {name.upper() if name in _ACRONYMS else name}, not of {source}", each)
        for name, each in zip(others, left, strict=False)
    ]
    of_warmer, temperatures = left[len(others) :], np.array(list(warmer))
    whole = np.isfinite(of_warmer).all(axis=1)
    if temperature is None or whole.sum() < 4:
        return found
    known_at = temperatures[whole]
    fine = np.linspace(known_at[0], known_at[-1], 100 * nodes)
    curves = CubicSpline(known_at, of_warmer[whole])(fine)
    best = int(np.argmin([agreement(each, covariance).chi2 for each in curves]))
    text = f"the temperature was probably {fine[best]:.1f} °C, not {temperature:.4g} °C (sphere.temperature)"
    is_excluded = abs(fine[best] - temperature) > IMPOSSIBLE * (sphere.inside.u or np.inf)
    return [*found, Alternative(text, curves[best], bool(is_excluded))]


def _solid(
    sphere: Sphere, file: Path | None, fitted: xr.Dataset | None, name: str, temperature: float | None
) -> Prony | None:
    """Return the stated solid, or a named one of the library, at a temperature; None where its shifts end before."""
    if fitted is not None:
        measured = fitted["temperature"].values
        is_known = temperature is None or measured.min() <= temperature <= measured.max()
        return fitted_at(fitted, temperature) if is_known else None
    try:
        return materials.load(name or file or sphere.source, temperature)
    except LabpipeError:
        return None

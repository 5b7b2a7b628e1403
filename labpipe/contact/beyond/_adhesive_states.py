"""Slow loading and unloading of an adhesive contact, as one Dataset."""

import numpy as np
import xarray as xr
from scipy.optimize import brentq

from labpipe.contact.beyond._adhesion import EQUILIBRIUM_DISTANCE, cohesive_stress, lost_energy, regime, tabor
from labpipe.contact.beyond._adhesive_mdr import adhesive_indentation, adhesive_pull_off, slope_of
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.units import require_positive
from labpipe.variables import variable

VALIDITY = "elastic (relaxed modulus), smooth, quasi-static, contact much narrower than the body"
# Smallest contact looked at, as a part of that under the load.
_SMALLEST = 1e-3
# Beyond this part of a sphere's radius the half-space is none.
_WIDEST_OF_SPHERE = 0.5


def adhesive_states(
    material: Prony,
    shape: str,
    size: float,
    work: float,
    load: float,
    equilibrium_distance: float = EQUILIBRIUM_DISTANCE,
    *,
    theory: str = "jkr",
    states: int = 200,
) -> xr.Dataset:
    """States of an adhesive contact from the smallest up to a load.

    ``material``: Its relaxed modulus counts. ``shape``, ``size``: See :func:`.slope_of`; no flat end, which has one
    state. ``work`` [J/m2]: Of adhesion, positive. ``load`` [N]: Largest, positive. ``equilibrium_distance`` [m]: For
    the cohesive stress and Tabor's parameter. ``states``: Contact radii, spaced by equal ratios. Returns: Over
    ``state``: ``contact_radius``, ``indentation``, ``cohesive_radius`` [m], ``force`` [N]; scalars ``pull_off`` [N],
    ``reduced_modulus`` [Pa] and, for a sphere, ``tabor`` and ``lost_energy`` [J]. States below that of the least
    force cannot be kept under a load. Raises InputError: A value is out of range, the material flows, or the load
    needs half the sphere.

    Examples
    --------
    >>> found = adhesive_states(Prony(1e6, [], [], nu=0.5), "parabola", 0.01, 0.05, 0.1)
    >>> round(float(found.pull_off) / (1.5 * np.pi * 0.05 * 0.01), 9)
    1.0
    """
    require_positive(work=work, load=load, size=size)
    if material.is_liquid or shape == "flat":
        raise InputError("slow loading needs a solid (E_relaxed above 0) and a profile that is not flat")
    if theory not in ("jkr", "maugis"):
        raise InputError(f'theory "{theory}" is unknown; use "jkr" or "maugis"')
    modulus = material.factor("contact") * material.E_relaxed
    slope = slope_of(shape, size)
    stress = None if theory == "jkr" else cohesive_stress(work, equilibrium_distance)

    def excess(log_radius: float) -> float:
        state = adhesive_indentation(slope, [np.exp(log_radius)], modulus, work)
        return float(state.force[0]) - load

    # Without adhesion the contact would be narrower; with it, wide enough for both.
    narrow = (load / modulus) ** 0.5 * 1e-6
    wide = _WIDEST_OF_SPHERE * size if shape != "cone" else 1e3 * (load / (size * modulus)) ** 0.5
    if not excess(np.log(wide)) > 0.0:
        raise InputError(f"under {load:g} N the contact would be wider than {wide:.3g} m; reduce the load")
    largest = float(np.exp(brentq(excess, np.log(narrow), np.log(wide), xtol=1e-12)))
    radii = np.geomspace(_SMALLEST * largest, largest, states)
    found = adhesive_indentation(slope, radii, modulus, work, stress)
    held = adhesive_pull_off(slope, modulus, work, (float(radii[0]), largest), stress)
    columns = {
        "contact_radius": ("m", "Contact radius", found.contact_radius),
        "force": ("N", "Force, positive when it presses", found.force),
        "indentation": ("m", "Indentation", found.indentation),
        "cohesive_radius": ("m", "Radius up to which the surfaces attract", found.cohesive_radius),
    }
    scalars = {
        "pull_off": ("N", "Pull-off force", held),
        "reduced_modulus": ("Pa", "Reduced modulus, relaxed", modulus),
    }
    attributes: dict[str, str] = {"theory": theory, "validity": VALIDITY}
    if shape != "cone":
        reach = tabor(size, modulus, work, equilibrium_distance)
        lost = lost_energy(size, modulus, work)
        scalars["tabor"] = ("1", "Tabor's parameter", reach)
        scalars["lost_energy"] = ("J", "Energy lost, closing and opening", lost)
        attributes["regime"] = regime(reach)
    variables = {n: variable("state", v, u, t) for n, (u, t, v) in columns.items()}
    single = {n: variable((), v, u, t) for n, (u, t, v) in scalars.items()}
    return xr.Dataset({**variables, **single}, attrs=attributes)

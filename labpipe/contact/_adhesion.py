r"""Adhesion of an elastic sphere to a rigid flat, and its weight in an impact.

Notation: reduced modulus E* = E/(1 − ν²), sphere radius R, work of adhesion w (the energy of both
surfaces less that of the interface), contact radius a. Forces are positive when they press.

Validity: elastic, smooth, quasi-static, a ≪ R. A viscoelastic solid sticks more firmly when it is
pulled off fast, at most by E_unrelaxed/E_relaxed [3]_, and real roughness reduces w by orders of
magnitude: the numbers here are upper bounds for a rough surface. Adhesion with memory (a crack that
moves while the bulk relaxes) has no closed form that could check a solver and is not offered.

References
----------
.. [1] K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. A 324 (1971) 301,
   https://doi.org/10.1098/rspa.1971.0141.
.. [2] K. L. Johnson, J. A. Greenwood, J. Colloid Interface Sci. 192 (1997) 326,
   https://doi.org/10.1006/jcis.1997.4984.
.. [3] B. N. J. Persson, E. A. Brener, Phys. Rev. E 71 (2005) 036123,
   https://doi.org/10.1103/PhysRevE.71.036123.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.units import require_positive
from labpipe.variables import variable

EQUILIBRIUM_DISTANCE = 0.3e-9
"""m; distance of two surfaces at which their attraction vanishes, of about an atom."""

WORK_OF_ADHESION = 0.05
"""J/m2; of a clean smooth polymer on glass or sapphire, the most to expect. Roughness and dust
take away most of it."""

# Share of the force or energy of an impact from which adhesion is said to matter: about the accuracy of a
# measured restitution.
_NOTICEABLE = 1e-3


class AdhesiveContact(NamedTuple):
    """States of an adhesive contact; every member has the shape of the contact radius.

    Contact radius [m]; force [N], positive when it presses; indentation [m], negative where the surface is drawn out.
    """

    contact_radius: Floats
    force: Floats
    indentation: Floats


def jkr(contact_radius: ArrayLike, radius: float, reduced_modulus: float, work: float) -> AdhesiveContact:
    """State at a contact radius: F = 4E*a³/3R − √(8πwE*a³), δ = a²/R − √(2πaw/E*).

    Parameters
    ----------
    contact_radius : array [m]
        Not negative. Below that of :func:`pull_off` a state cannot be kept.
    radius : float [m]
        Of the sphere.
    reduced_modulus : float [Pa]
        E*.
    work : float [J/m2]
        Of adhesion, w; 0 is Hertz.

    Raises
    ------
    InputError
        A value is out of range.

    Examples
    --------
    >>> state = jkr(1e-3, radius=0.01, reduced_modulus=1e6, work=0.05)
    >>> round(float(state.force), 5), round(float(state.indentation) * 1e6, 3)
    (0.09788, 82.275)
    """
    _require(radius, reduced_modulus, work)
    a = np.asarray(contact_radius, dtype=float)
    if not np.all((a >= 0.0) & np.isfinite(a)):
        raise InputError(f"contact_radius is {a} m, expected numbers from 0 up")
    force = 4.0 * reduced_modulus * a**3 / (3.0 * radius) - np.sqrt(8.0 * np.pi * work * reduced_modulus * a**3)
    indentation = a**2 / radius - np.sqrt(2.0 * np.pi * a * work / reduced_modulus)
    return AdhesiveContact(a, force, indentation)


def jkr_at_force(force: ArrayLike, radius: float, reduced_modulus: float, work: float) -> AdhesiveContact:
    """Stable state under a load: a³ = (3R/4E*)(F + 3πwR + √(6πwRF + (3πwR)²)).

    Raises
    ------
    InputError
        A force pulls harder than the contact holds, or a value is out of range.

    Examples
    --------
    >>> state = jkr_at_force(0.0, radius=0.01, reduced_modulus=1e6, work=0.05)
    >>> round(float(state.contact_radius) * 1e3, 4)
    0.4135
    """
    _require(radius, reduced_modulus, work)
    load = np.asarray(force, dtype=float)
    scale = 3.0 * np.pi * work * radius
    least = -0.5 * scale
    if not np.all(load >= least * (1.0 + 1e-12)):
        raise InputError(f"force is {load} N; the contact holds {-least:.4g} N and no more")
    root = np.sqrt(np.maximum(2.0 * scale * load + scale**2, 0.0))
    a = np.cbrt(0.75 * radius / reduced_modulus * (load + scale + root))
    return jkr(a, radius, reduced_modulus, work)._replace(force=load)


def tabor(
    radius: float, reduced_modulus: float, work: float, equilibrium_distance: float = EQUILIBRIUM_DISTANCE
) -> float:
    """Tabor's parameter μ = (R w²/(E*² z₀³))^{1/3}: height of the neck over the reach of forces.

    Examples
    --------
    >>> round(tabor(9.525e-3, 3.6e9, 0.05), 1)
    40.8
    """
    _require(radius, reduced_modulus, work)
    require_positive("m", equilibrium_distance=equilibrium_distance)
    reach = (radius * (work / reduced_modulus) ** 2) ** (1.0 / 3.0)
    return float(reach / equilibrium_distance)


def regime(tabor_parameter: float) -> str:
    """Name the theory that holds after [2]_: ``"JKR"`` from 5, ``"DMT"`` up to 0.1, ``"transition"`` between them."""
    return "JKR" if tabor_parameter >= 5.0 else "DMT" if tabor_parameter <= 0.1 else "transition"


def pull_off(radius: float, reduced_modulus: float, work: float) -> float:
    """Force [N] that parts the surfaces: 3/2 πwR in the range of JKR, below it the bound 2πwR of DMT.

    Examples
    --------
    >>> round(pull_off(9.525e-3, 3.6e9, 0.05) * 1e3, 3)
    2.244
    """
    factor = 1.5 if regime(tabor(radius, reduced_modulus, work)) == "JKR" else 2.0
    return float(factor * np.pi * work * radius)


def lost_energy(radius: float, reduced_modulus: float, work: float) -> float:
    """Energy [J] that closing and opening a JKR contact costs: 7.09 (w⁵R⁴/E*²)^{1/3}.

    The surfaces jump together at δ = 0 and part where dF/dδ is infinite; between the two the work
    ∫F dδ is lost to waves and heat.

    Examples
    --------
    >>> round(lost_energy(1.0, 1.0, 1.0), 3)
    7.092
    """
    _require(radius, reduced_modulus, work)
    # ∫F dδ up to the two contact radii, in units of (w⁵R⁴/E*²)^{1/3}.
    a = np.cbrt([np.pi / 8.0, 2.0 * np.pi])
    apart, together = 8.0 / 15.0 * a**5 - 4.0 / 3.0 * np.sqrt(2.0 * np.pi) * a**3.5 + np.pi * a**2
    return float((work**5 * radius**4 / reduced_modulus**2) ** (1.0 / 3.0) * (apart - together))


def adhesive_states(material: Prony, radius: float, work: float, load: float, states: int = 200) -> xr.Dataset:
    """Slow loading and unloading of a sphere after JKR, with the relaxed modulus.

    Parameters
    ----------
    material : Prony
        A solid.
    radius, work, load : float [m, J/m2, N]
        Of the sphere, of adhesion, and the largest load; positive.
    states : int
        Contact radii from a thousandth of the largest up to it, by equal ratios.

    Returns
    -------
    Dataset
        Over ``state``: ``contact_radius``, ``indentation`` [m], ``force`` [N]; scalars ``pull_off`` [N],
        ``reduced_modulus`` [Pa], ``tabor`` and ``lost_energy`` [J]. States below that of the least force cannot be kept
        under a load.

    Raises
    ------
    InputError
        A value is out of range, the material flows, or the contact would be wider than half the radius.

    Examples
    --------
    >>> found = adhesive_states(Prony(1e6, [], [], nu=0.5), 0.01, 0.05, 0.1)
    >>> round(float(found.force.min()) / (-1.5 * np.pi * 0.05 * 0.01), 3)
    1.0
    """
    require_positive("J/m2", work=work)
    require_positive("N", load=load)
    if material.is_liquid:
        raise InputError("slow loading needs a solid (E_relaxed above 0)")
    modulus = material.factor("contact") * material.E_relaxed
    largest = float(jkr_at_force(load, radius, modulus, work).contact_radius)
    if largest > 0.5 * radius:
        raise InputError(f"under {load:g} N the contact would be wider than {0.5 * radius:.3g} m; reduce the load")
    found = jkr(np.geomspace(1e-3 * largest, largest, states), radius, modulus, work)
    reach = tabor(radius, modulus, work)
    variables = {
        "contact_radius": variable("state", found.contact_radius, "m", "Contact radius"),
        "force": variable("state", found.force, "N", "Force, positive when it presses"),
        "indentation": variable("state", found.indentation, "m", "Indentation"),
        "pull_off": variable((), pull_off(radius, modulus, work), "N", "Pull-off force"),
        "reduced_modulus": variable((), modulus, "Pa", "Reduced modulus, relaxed"),
        "tabor": variable((), reach, "1", "Tabor's parameter"),
        "lost_energy": variable((), lost_energy(radius, modulus, work), "J", "Energy lost, closing and opening"),
    }
    validity = "elastic (relaxed modulus), smooth, quasi-static, contact much narrower than the body"
    return xr.Dataset(variables, attrs={"theory": "jkr", "regime": regime(reach), "validity": validity})


@dataclass(frozen=True, slots=True)
class AdhesionEstimate:
    """Adhesion relative to an impact; see :func:`adhesion_in_impact`.

    ``tabor``, ``regime``: Tabor's parameter with the modulus of the impact's time scale, and the theory that holds;
    ``pull_off``, ``pull_off_bound`` [N]: quasi-static force that parts the surfaces, and the most that a fast crack in
    this viscoelastic solid can make of it; ``lost_energy`` [J]: that closing and opening costs, of the elastic solid;
    ``force_share``: the bound over the peak force; ``verdict``: "negligible", of force and kinetic energy of the
    impact, or "may matter".
    """

    tabor: float
    regime: str
    pull_off: float
    pull_off_bound: float
    lost_energy: float
    force_share: float
    verdict: str


def adhesion_in_impact(
    material: Prony,
    radius: float,
    mass: float,
    speed: float,
    contact_duration: float,
    peak_force: float,
    work: float = WORK_OF_ADHESION,
) -> AdhesionEstimate:
    """Compare adhesion with an impact of a viscoelastic sphere.

    Parameters
    ----------
    material : Prony
    radius, mass : float [m, kg]
        Of the sphere, and the mass that falls.
    speed, contact_duration, peak_force : float [m/s, s, N]
        Of the impact, as :func:`labpipe.contact.drop` or a measurement gives them.
    work : float [J/m2]
        Of adhesion.

    Raises
    ------
    InputError
        A value is not positive.

    Notes
    -----
    A moving crack meets the modulus of its own rate: the work to part a viscoelastic solid is up to
    E_unrelaxed/E_relaxed times w at most. Shares are with that factor; a liquid
    (E_relaxed = 0) has no such bound and takes the modulus of the impact in its place.

    Examples
    --------
    >>> from labpipe.materials import load
    >>> found = adhesion_in_impact(load("acrylic"), 9.525e-3, 0.505, 0.17, 1.2e-3, 260.0)
    >>> found.verdict, f"{found.pull_off:.2g}"
    ('negligible', '0.0022')
    """
    require_positive(mass=mass, speed=speed, contact_duration=contact_duration, peak_force=peak_force)
    modulus = abs(complex(material.complex_modulus(np.pi / contact_duration, "contact")))
    relaxed = material.E_relaxed if not material.is_liquid else modulus / material.factor("contact")
    enhanced = work * material.E_unrelaxed / relaxed
    reach = tabor(radius, modulus, work)
    bound = 2.0 * np.pi * enhanced * radius
    shares = (float(bound / peak_force), lost_energy(radius, modulus, enhanced) / (0.5 * mass * speed**2))
    return AdhesionEstimate(
        tabor=reach,
        regime=regime(reach),
        pull_off=pull_off(radius, modulus, work),
        pull_off_bound=float(bound),
        lost_energy=lost_energy(radius, modulus, work),
        force_share=shares[0],
        verdict="negligible" if max(shares) < _NOTICEABLE else "may matter",
    )


def _require(radius: float, modulus: float, work: float) -> None:
    require_positive("m", radius=radius)
    require_positive("Pa", reduced_modulus=modulus)
    if not (np.isfinite(work) and work >= 0.0):
        raise InputError(f"work is {work} J/m2, expected a number from 0 up")

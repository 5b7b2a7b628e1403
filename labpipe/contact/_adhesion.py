r"""Adhesion of an elastic sphere to a rigid flat, and its weight in an impact.

Notation: reduced modulus E* = E/(1 − ν²), sphere radius R, work of adhesion w, contact radius a. Forces are positive
when they press. Valid for elastic, smooth, quasi-static contacts with a ≪ R. A viscoelastic solid sticks more firmly
when it is pulled off fast, at most by E_unrelaxed/E_relaxed [3]_; roughness reduces w by orders of magnitude.

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

from labpipe.arrays import Floats
from labpipe.errors import InputError
from labpipe.materials import Prony
from labpipe.units import require_positive
from labpipe.variables import variable

# Distance of two surfaces at which their attraction vanishes, of about an atom [m].
_EQUILIBRIUM_DISTANCE = 0.3e-9
# Share of the force or energy of an impact from which adhesion is said to matter: about the accuracy of a
# measured restitution.
_NOTICEABLE = 1e-3


@dataclass(frozen=True, slots=True)
class Jkr:
    """Adhesive contact [1]_ of a sphere of ``radius`` [m], with E* [Pa] and the work of adhesion [J/m2]; 0 is Hertz."""

    radius: float
    modulus: float
    work: float

    def __post_init__(self) -> None:
        require_positive("m", radius=self.radius)
        require_positive("Pa", reduced_modulus=self.modulus)
        if not (np.isfinite(self.work) and self.work >= 0.0):
            raise InputError(f"work is {self.work} J/m2, expected a number from 0 up")

    def state(self, a: Floats) -> tuple[Floats, Floats]:
        """Force [N] and indentation [m] at contact radii: F = 4E*a³/3R − √(8πwE*a³), δ = a²/R − √(2πaw/E*)."""
        force = 4.0 * self.modulus * a**3 / (3.0 * self.radius) - np.sqrt(8.0 * np.pi * self.work * self.modulus * a**3)
        return force, a**2 / self.radius - np.sqrt(2.0 * np.pi * a * self.work / self.modulus)

    def contact_radius(self, load: float) -> float:
        """Of the stable state under a load: a³ = (3R/4E*)(F + 3πwR + √(6πwRF + (3πwR)²))."""
        scale = 3.0 * np.pi * self.work * self.radius
        root = np.sqrt(2.0 * scale * load + scale**2)
        return float(np.cbrt(0.75 * self.radius / self.modulus * (load + scale + root)))

    @property
    def tabor(self) -> float:
        """Tabor's parameter μ = (R w²/(E*² z₀³))^{1/3}: height of the neck over the reach of forces."""
        return float(np.cbrt(self.radius * (self.work / self.modulus) ** 2) / _EQUILIBRIUM_DISTANCE)

    @property
    def regime(self) -> str:
        """The theory that holds after [2]_: ``"JKR"`` from μ = 5, ``"DMT"`` up to 0.1, ``"transition"`` between."""
        return "JKR" if self.tabor >= 5.0 else "DMT" if self.tabor <= 0.1 else "transition"

    @property
    def pull_off(self) -> float:
        """Force [N] that parts the surfaces: 3/2 πwR in the range of JKR, below it the bound 2πwR of DMT."""
        return float((1.5 if self.regime == "JKR" else 2.0) * np.pi * self.work * self.radius)

    @property
    def lost_energy(self) -> float:
        """Energy [J] that closing and opening the contact costs: 7.09 (w⁵R⁴/E*²)^{1/3}."""
        # The surfaces jump together at δ = 0 and part where dF/dδ is infinite: ∫F dδ between these contact radii.
        a = np.cbrt([np.pi / 8.0, 2.0 * np.pi])
        apart, together = 8.0 / 15.0 * a**5 - 4.0 / 3.0 * np.sqrt(2.0 * np.pi) * a**3.5 + np.pi * a**2
        return float(np.cbrt(self.work**5 * self.radius**4 / self.modulus**2) * (apart - together))


def adhesive_states(material: Prony, radius: float, work: float, load: float) -> xr.Dataset:
    """Slow loading and unloading of a sphere after JKR, with the relaxed modulus.

    Parameters
    ----------
    material : Prony
        A solid.
    radius, work, load : float [m, J/m2, N]
        Of the sphere, of adhesion, and the largest load; positive.

    Returns
    -------
    Dataset
        Over ``state``: ``contact_radius``, ``indentation`` [m], ``force`` [N]; scalars ``pull_off`` [N],
        ``reduced_modulus`` [Pa], ``tabor`` and ``lost_energy`` [J].

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
    contact = Jkr(radius, material.factor("contact") * material.E_relaxed, work)
    largest = contact.contact_radius(load)
    if largest > 0.5 * radius:
        raise InputError(f"under {load:g} N the contact would be wider than {0.5 * radius:.3g} m; reduce the load")
    radii = np.geomspace(1e-3 * largest, largest, 200)
    force, indentation = contact.state(radii)
    variables = {
        "contact_radius": variable("state", radii, "m", "Contact radius"),
        "force": variable("state", force, "N", "Force, positive when it presses"),
        "indentation": variable("state", indentation, "m", "Indentation"),
        "pull_off": variable((), contact.pull_off, "N", "Pull-off force"),
        "reduced_modulus": variable((), contact.modulus, "Pa", "Reduced modulus, relaxed"),
        "tabor": variable((), contact.tabor, "1", "Tabor's parameter"),
        "lost_energy": variable((), contact.lost_energy, "J", "Energy lost, closing and opening"),
    }
    validity = "elastic (relaxed modulus), smooth, quasi-static, contact much narrower than the body"
    return xr.Dataset(variables, attrs={"theory": "jkr", "regime": contact.regime, "validity": validity})


class AdhesionEstimate(NamedTuple):
    """Adhesion relative to an impact: forces in N, the bound that of a fast crack, ``force_share`` that over the peak.

    ``tabor`` and ``regime`` are those of the modulus of the impact's time scale; ``verdict`` is "negligible" in force
    and kinetic energy, or "may matter".
    """

    tabor: float
    regime: str
    pull_off: float
    pull_off_bound: float
    force_share: float
    verdict: str


def adhesion_in_impact(
    material: Prony,
    radius: float,
    mass: float,
    speed: float,
    contact_duration: float,
    peak_force: float,
    work: float = 0.05,
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
        Of adhesion; by default that of a clean smooth polymer on glass or sapphire, the most to expect.

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
    contact = Jkr(radius, modulus, work)
    bound = 2.0 * np.pi * enhanced * radius
    shares = (float(bound / peak_force), Jkr(radius, modulus, enhanced).lost_energy / (0.5 * mass * speed**2))
    verdict = "negligible" if max(shares) < _NOTICEABLE else "may matter"
    return AdhesionEstimate(contact.tabor, contact.regime, contact.pull_off, float(bound), shares[0], verdict)

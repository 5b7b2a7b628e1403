"""Whether adhesion matters in an impact: its force and energy compared with the impact's."""

from dataclasses import dataclass

import numpy as np

from labpipe.contact.beyond._adhesion import lost_energy, pull_off, regime, tabor
from labpipe.materials import Prony
from labpipe.units import require_positive

WORK_OF_ADHESION = 0.05
"""J/m2; of a clean smooth polymer on glass or sapphire, the most to expect. Roughness and dust
take away most of it."""

NOTICEABLE = 1e-3
"""Share of the impact's force or energy from which adhesion is said to matter: about what a
measured restitution is good to."""


@dataclass(frozen=True, slots=True)
class AdhesionEstimate:
    """Adhesion beside an impact; see :func:`adhesion_in_impact`.

    Attributes
    ----------
    tabor : float
        Tabor's parameter, with the modulus of the impact's time scale.
    regime : str
        Theory that holds: ``"JKR"``, ``"Maugis"`` or ``"DMT"``.
    pull_off : float [N]
        Quasi-static force that parts the surfaces.
    pull_off_bound : float [N]
        The most that a fast crack in this viscoelastic solid can make of it.
    lost_energy : float [J]
        That closing and opening the contact costs, of the elastic solid.
    force_share : float
        Upper bound beside the peak force.
    verdict : str
        ``"negligible"``, of the force and of the impact's kinetic energy, or ``"may matter"``.
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
    radius : float [m]
        Of the sphere.
    mass : float [kg]
        That falls.
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
    E_unrelaxed/E_relaxed times w (Persson and Brener 2005). Shares are with that factor; a liquid
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
    held = pull_off(radius, modulus, work, "maugis") if work > 0.0 else 0.0
    bound = 2.0 * np.pi * enhanced * radius
    shares = (float(bound / peak_force), lost_energy(radius, modulus, enhanced) / (0.5 * mass * speed**2))
    return AdhesionEstimate(
        tabor=reach,
        regime=regime(reach),
        pull_off=held,
        pull_off_bound=float(bound),
        lost_energy=lost_energy(radius, modulus, work),
        force_share=shares[0],
        verdict="negligible" if max(shares) < NOTICEABLE else "may matter",
    )

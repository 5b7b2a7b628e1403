"""The substrate as a damped oscillator: the plate under the sphere may vibrate.

The plate under the sapphire rings after an impact (thesis, appendix B). Its lowest mode is one mass
on a spring and a dashpot; its displacement ``u`` is positive downwards and 0 at rest::

    m u'' + c u' + k u = F,   k = m (2 pi f)^2,   c = 2 zeta m (2 pi f)
"""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np

from labpipe.errors import InputError
from labpipe.units import require_positive


@dataclass(frozen=True, slots=True)
class Plate:
    """A substrate that moves as one damped oscillator.

    Parameters
    ----------
    mass : float [kg]
        Modal mass under the contact.
    frequency : float [Hz]
        Undamped natural frequency.
    damping_ratio : float
        Fraction of critical damping, at least 0 and below 1.

    Raises
    ------
    InputError
        A value lies outside its range.

    Examples
    --------
    >>> plate = Plate(mass=2.0, frequency=100.0, damping_ratio=0.02)
    >>> round(plate.stiffness)
    789568
    """

    mass: float
    frequency: float
    damping_ratio: float = 0.0

    def __post_init__(self) -> None:
        require_positive(plate_mass=self.mass, plate_frequency=self.frequency)
        if not 0.0 <= self.damping_ratio < 1.0:
            message = f"the plate's damping ratio is {self.damping_ratio}, expected 0 to below 1: a plate that rings"
            raise InputError(message)

    @property
    def stiffness(self) -> float:
        """Stiffness k in N/m."""
        return self.mass * (2.0 * pi * self.frequency) ** 2

    @property
    def damping(self) -> float:
        """Dashpot constant c in N s/m."""
        return 2.0 * self.damping_ratio * self.mass * 2.0 * pi * self.frequency

    def energy(self, displacement: Any, velocity: Any) -> Any:
        """Kinetic and elastic energy [J] of the plate."""
        return 0.5 * (self.mass * velocity**2 + self.stiffness * displacement**2)

    def free(self, u: float, v: float, dt: Any) -> tuple[Any, Any, Any]:
        """Displacement [m], velocity and acceleration after ``dt`` [s] without force, exactly, from those at first."""
        omega = 2.0 * pi * self.frequency
        rate = self.damping_ratio * omega
        damped = omega * sqrt(1.0 - self.damping_ratio**2)
        envelope, c, s = np.exp(-rate * dt), np.cos(damped * dt), np.sin(damped * dt)
        displacement = envelope * (u * c + (v + rate * u) / damped * s)
        velocity = envelope * (v * c - (rate * v + omega**2 * u) / damped * s)
        pull = self.damping * velocity + self.stiffness * displacement
        return displacement, velocity, -pull / self.mass


def modal(plate: Plate | None) -> tuple[float, float, float]:
    """Mass [kg], stiffness [N/m] and damping [N s/m] as compiled steps take them; 0 for rigid ground."""
    return (plate.mass, plate.stiffness, plate.damping) if plate else (0.0, 0.0, 0.0)

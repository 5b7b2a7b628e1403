"""The substrate as a damped oscillator: the plate under the sphere may vibrate.

The plate under the sapphire rings after an impact (thesis, appendix B). Its lowest mode is one mass
on a spring and a dashpot; its displacement ``u`` is positive downwards and 0 at rest::

    m u'' + c u' + k u = F,   k = m (2 pi f)^2,   c = 2 zeta m (2 pi f)
"""

from dataclasses import dataclass
from math import isfinite, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from labpipe.arrays import Floats
from labpipe.errors import InputError


class PlateState(NamedTuple):
    """Displacement [m], velocity [m/s] and acceleration [m/s2] of the plate, downwards; at one time or many."""

    displacement: Any = 0.0
    velocity: Any = 0.0
    acceleration: Any = 0.0


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
        for name, value in (("mass", self.mass), ("frequency", self.frequency)):
            if not (isfinite(value) and value > 0.0):
                raise InputError(f"the plate's {name} is {value}, expected a finite positive number")
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

    def energy(self, state: PlateState) -> Any:
        """Kinetic and elastic energy of the plate in J."""
        return 0.5 * (self.mass * state.velocity**2 + self.stiffness * state.displacement**2)

    def free(self, state: PlateState, dt: float | Floats) -> PlateState:
        """State after ``dt`` [s] without force, exactly; several durations give a state of arrays."""
        omega = 2.0 * pi * self.frequency
        rate = self.damping_ratio * omega
        damped = omega * sqrt(1.0 - self.damping_ratio**2)
        envelope, c, s = np.exp(-rate * dt), np.cos(damped * dt), np.sin(damped * dt)
        u, v = state.displacement, state.velocity
        displacement = envelope * (u * c + (v + rate * u) / damped * s)
        velocity = envelope * (v * c - (rate * v + omega**2 * u) / damped * s)
        pull = self.damping * velocity + self.stiffness * displacement
        return PlateState(displacement, velocity, -pull / self.mass)


def modal(plate: Plate | None) -> tuple[float, float, float]:
    """Mass [kg], stiffness [N/m] and damping [N s/m] as compiled steps take them; 0 for rigid ground."""
    return (plate.mass, plate.stiffness, plate.damping) if plate else (0.0, 0.0, 0.0)

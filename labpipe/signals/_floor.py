"""The plate under an impact as one damped oscillator: how it swings while and after it is struck.

Part of the speed that a light plate does not return is the plate's, not the solid's, and where it springs
back within the contact it bends the pulse as gravity does. Both are known where its mass is.
"""

from typing import NamedTuple

import numpy as np

from labpipe.arrays import Floats


class Floor(NamedTuple):
    """A plate that moves as one damped oscillator.

    Attributes
    ----------
    share : float
        The mass that falls over the plate's modal mass.
    frequency : float [Hz]
    damping_ratio : float
    u_share, u_frequency : float
        Standard uncertainties.
    """

    share: float
    frequency: float
    damping_ratio: float
    u_share: float = 0.0
    u_frequency: float = 0.0

    def free(self, displacement: float, speed: float, lasts: Floats | float) -> tuple[Floats, Floats]:
        """Displacement and speed after so long [s] without force."""
        whole = 2.0 * np.pi * self.frequency
        rate = self.damping_ratio * whole
        damped = whole * np.sqrt(1.0 - self.damping_ratio**2)
        decay, c, s = np.exp(-rate * lasts), np.cos(damped * lasts), np.sin(damped * lasts)
        moved = decay * (displacement * c + (speed + rate * displacement) / damped * s)
        return moved, decay * (speed * c - (rate * speed + whole**2 * displacement) / damped * s)


class Met(NamedTuple):
    """How a plate moves during a contact: speed downwards [m/s], and the pull back [m/s2] of its spring and dashpot.

    ``u_speed`` is the standard uncertainty of its speed at lift-off and touch together.
    """

    speed: Floats
    pull: Floats
    u_speed: float


class Beneath(NamedTuple):
    """A plate with its displacement and speed downwards at a time [s].

    ``u_phase`` [rad] is how well the phase of the swing is known.
    """

    floor: Floor
    displacement: float = 0.0
    speed: float = 0.0
    time: float = 0.0
    u_phase: float = 0.0

    def since(self, origin: float) -> "Beneath":
        """Return the same with times that count from an origin [s]."""
        return self._replace(time=self.time - origin)

    def struck(self, touch: float, length: float, pulse: Floats) -> tuple[Met, "Beneath"]:
        """Follow the plate through a contact [s]; ``pulse`` (node,) [m/s2] is the acceleration of the body over it."""
        floor, whole = self.floor, 2.0 * np.pi * self.floor.frequency
        waited = max(touch - self.time, 0.0)
        u_phase = float(np.hypot(self.u_phase, 2.0 * np.pi * floor.u_frequency * waited))
        # a phase that is hardly known leaves less of the swing to be expected, and the rest to chance
        expected, chance = np.exp(-0.5 * u_phase**2), np.sqrt(0.5 * (1.0 - np.exp(-(u_phase**2))))
        start, speed = (float(x) for x in floor.free(self.displacement, self.speed, waited))
        swing = float(np.hypot(speed, whole * start))
        since = length * np.linspace(0.0, 1.0, pulse.size)
        step = floor.share * length / (pulse.size - 1)
        moved, moves = floor.free(expected * start, expected * speed, since)
        by_unit = floor.free(0.0, 1.0, since)
        forced = [step * np.convolve(pulse, answer)[: pulse.size] for answer in by_unit]
        displacement, velocity = moved + forced[0], moves + forced[1]
        pull = whole**2 * displacement + 2.0 * floor.damping_ratio * whole * velocity
        u_speed = float(np.hypot(2.0 * chance * swing, forced[1][-1] * floor.u_share / floor.share))
        after = Beneath(floor, float(displacement[-1]), float(velocity[-1]), touch + length, u_phase)
        return Met(velocity, pull, u_speed), after

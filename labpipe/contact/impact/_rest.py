"""When a contact has come to rest."""

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from labpipe.contact.impact._bounce import Stepper


@dataclass(slots=True)
class RestTest:
    """True when speed and force have swung no more than allowed over a whole period.

    Speed alone will not do: it vanishes at every turn. Its swing is taken, not its size, because a
    contact at rest still creeps.

    Parameters
    ----------
    tolerance : float
        Amplitude relative to the static sag.
    period : float [s]
        Of the sphere on its static sag.
    speed : float [m/s]
        Gravity times period over 2 pi: the speed that belongs to an amplitude of one sag.
    start, slowest, fastest, largest : float
        What the current period has seen.
    """

    tolerance: float
    period: float
    speed: float
    start: float = 0.0
    slowest: float = -inf
    fastest: float = inf
    largest: float = inf

    def restart(self, time: float) -> None:
        """Forget the past: a new contact begins."""
        self.start, self.largest = time, inf

    def __call__(self, stepper: "Stepper") -> bool:
        """Look at the state after a step."""
        weight = stepper.body.mass * stepper.body.gravity
        unbalanced = abs(stepper.force / weight - 1.0)
        if stepper.body.plate is not None:
            unbalanced = max(unbalanced, abs(stepper.plate.velocity) / self.speed)
        velocity = stepper.velocity
        self.slowest, self.fastest = min(self.slowest, velocity), max(self.fastest, velocity)
        self.largest = max(self.largest, unbalanced)
        if stepper.time - self.start < self.period:
            return False
        swing = 0.5 * (self.fastest - self.slowest) / self.speed
        is_resting = max(self.largest, swing) < self.tolerance
        self.start, self.largest = stepper.time, unbalanced
        self.slowest = self.fastest = velocity
        return is_resting

"""Prior knowledge of the shape of a contact's pulse."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import sqrtm

from labpipe.arrays import Floats

# A slow body feels gravity inside the contact, which flattens the pulse: r2 falls with g T / v, r4 rises.
_FLATNESS, _FLATNESS_BY_GRAVITY, _HEAVIEST = -0.227, -0.085, 4.0
_CREST, _CREST_BY_GRAVITY = 0.0275, 0.021


class ShapePrior(NamedTuple):
    """Prior of lean, flatness, skewness, crest and onset (r1 to r5) of the pulse.

    Each is ``at_no_loss + per_loss (1 - e) + per_loss_squared (1 - e)^2``, added to the elastic value for r2 and r4,
    within a standard deviation of ``spread + spread_per_loss (1 - e)^power``; ``root``: of the correlations.
    """

    per_loss: tuple[float, ...]
    spread: tuple[float, ...]
    spread_per_loss: tuple[float, ...]
    power: tuple[float, ...]
    per_loss_squared: tuple[float, ...] = (0.0,) * 5
    at_no_loss: tuple[float, ...] = (0.0,) * 5
    root: Floats = np.eye(5)


# In impacts of polymers of the same loss flatness, crest and onset rise and lean falls together, as steeply as the
# solid relaxes; skewness goes with lean only.
_TOGETHER, _LEAN_AND_SKEWNESS = 0.9, -0.3
_SIGN = np.array([-1.0, 1.0, 0.0, 1.0, 1.0])
_CORRELATION = _TOGETHER * np.outer(_SIGN, _SIGN)
np.fill_diagonal(_CORRELATION, 1.0)
_CORRELATION[0, 2] = _CORRELATION[2, 0] = _LEAN_AND_SKEWNESS

PRIORS = {
    "any": ShapePrior(
        (-1.1, 0.25, 0.15, 0.0, 0.15), (0.05, 0.03, 0.03, 0.01, 0.03), (0.45, 2.5, 0.35, 0.1, 0.5), (1, 2, 1, 1, 1)
    ),
    "polymer": ShapePrior(
        (-0.835, 0.096, 0.098, 0.014, 0.134),
        (0.002, 0.001, 0.001, 0.0003, 0.001),
        (0.25, 0.22, 0.06, 0.016, 0.28),
        (1.0, 1.25, 1.5, 1.0, 1.25),
        (-1.05, 0.837, -0.04, 0.001, 0.525),
        (0.0, 0.0015, 0.0, -0.0019, -0.005),
        np.asarray(sqrtm(_CORRELATION).real),
    ),
}
"""``"any"`` covers all laws of the study. ``"polymer"`` is for solids with a broad relaxation
spectrum, for which the five follow the loss, and each other: 700 impacts, by the drop simulator, of random sums of
one or two Cole–Cole relaxations (e = 0.2 to 0.995) on floors from rigid to 20 kg."""

SHAPE = ("lean", "flatness", "skewness", "crest", "onset")
"""Unknowns of the pulse's shape."""


class Floor(NamedTuple):
    """A plate under the contact that moves as one oscillator.

    ``share`` [1] is the mass that falls over the plate's modal mass, ``frequency`` [Hz] its natural frequency.
    """

    share: float
    frequency: float

    def speed(self, change: float, length: float) -> float:
        """Return its speed downwards [m/s] at lift-off, by an impulse in the middle of a contact of a length [s]."""
        return self.share * change * float(np.cos(np.pi * self.frequency * length))


class Character(NamedTuple):
    """Parts of the speed that the solid does not return, and that gravity takes; u of the first by the plate."""

    loss: float
    weight: float
    u_loss: float = 0.0


def expected_shape(prior: ShapePrior, known: Character) -> tuple[Floats, Floats]:
    """Mean and standard deviation of lean, flatness, skewness, crest and onset."""
    felt, loss = min(known.weight, _HEAVIEST), known.loss
    elastic = np.array([0.0, _FLATNESS + _FLATNESS_BY_GRAVITY * felt, 0.0, _CREST + _CREST_BY_GRAVITY * felt, 0.0])
    slope, bend = np.array(prior.per_loss), np.array(prior.per_loss_squared)
    mean = elastic + np.array(prior.at_no_loss) + loss * slope + loss**2 * bend
    spread = np.array(prior.spread) + np.array(prior.spread_per_loss) * loss ** np.array(prior.power)
    return mean, np.hypot(spread, (slope + 2.0 * loss * bend) * known.u_loss)

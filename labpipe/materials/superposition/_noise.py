"""Noise of storage and loss modulus, and the lack of fit of the model.

Left to the residuals alone, the ratio of the two noise levels can run away: one modulus is fitted ever better while all
misfit is called noise of the other. So the scatter of every sweep about its own smooth curve, which needs no
superposition, gives the noise (pure error); residuals beyond it are a lack of fit of the model, the same (relative) in
both moduli. Where both levels lie within the uncertainty of the scatter, the residuals decide.
"""

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials.superposition._joint_fit import Points

# Relative noise is never taken below this: cleaner data are limited by the grid of times.
_LEAST_NOISE = 1e-6
ASSUMED_NOISE = 0.02
#: A sweep needs this many points before a cubic leaves anything to judge.
LEAST_OF_SWEEP = 6
# All sweeps together need so many free residuals before their scatter is trusted (18 % on a level).
_LEAST_FREEDOM = 16
_DEGREE = 3
_MEDIAN_OF_NORMAL = NormalDist().inv_cdf(0.75)  # median of the absolute value of a standard normal number


@dataclass(frozen=True, slots=True)
class Noise:
    """Relative standard deviation of storage and loss about the model."""

    storage: float
    loss: float

    def scaled(self, storage: float, loss: float) -> "Noise":
        """Return the levels times two factors, not below the resolution of the grid."""
        return Noise(max(self.storage * storage, _LEAST_NOISE), max(self.loss * loss, _LEAST_NOISE))


@dataclass(frozen=True, slots=True)
class Scatter(Noise):
    """Noise of the sweeps about their own curves; ``freedom`` is the number of free residuals behind it."""

    freedom: int

    def holds(self, found: Noise) -> bool:
        """Return True where two levels agree with this scatter within its 95 % interval."""
        # the variance of a median of n values of density f is 1 / (4 n f^2), here of the absolute values of normal ones
        spread = 0.5 / (_MEDIAN_OF_NORMAL * 2.0 * NormalDist().pdf(_MEDIAN_OF_NORMAL))
        ratio = 1.0 + 2.0 * float(2.0 * spread / np.sqrt(self.freedom))
        shares = (found.storage / self.storage) ** 2, (found.loss / self.loss) ** 2
        return all(1.0 / ratio < share < ratio for share in shares)


def off_its_sweep(omega: Floats, values: Floats) -> Floats:
    """Return the distance of ln E from the cubic through a sweep, in units of that of one reading."""
    x, y = np.log(omega), np.log(values)
    base = np.linalg.qr(np.vander(x - x.mean(), min(_DEGREE, x.size - 2) + 1))[0]
    return np.asarray((y - base @ (base.T @ y)) / np.sqrt(np.maximum(1.0 - np.sum(base**2, axis=1), 1e-3)))


def scatter_of_sweeps(points: Points) -> Scatter | None:
    """Return the scatter of either modulus about a cubic per sweep; None if there is too little.

    The median of the absolute residuals is used, so that single outliers do not count.
    """
    sweeps = [points.isotherm == k for k in range(points.count)]
    sweeps = [mask for mask in sweeps if np.count_nonzero(mask) >= LEAST_OF_SWEEP]
    freedom = sum(int(np.count_nonzero(mask)) - _DEGREE - 1 for mask in sweeps)
    if freedom < _LEAST_FREEDOM:
        return None
    levels = []
    for values in (points.storage, points.loss):
        off = np.concatenate([off_its_sweep(points.omega[mask], values[mask]) for mask in sweeps])
        levels.append(float(np.median(np.abs(off))) / _MEDIAN_OF_NORMAL)
    return Scatter(max(levels[0], _LEAST_NOISE), max(levels[1], _LEAST_NOISE), freedom)


def next_noise(noise: Noise, factors: tuple[float, float], scatter: Scatter | None) -> Noise:
    """Return the levels that the residuals ask for.

    ``noise``: levels of the last fit; ``factors``: root mean square of its residuals in those units, free residuals
    counted; ``scatter``: scatter of the sweeps; without it the residuals decide alone.
    """
    found = noise.scaled(*factors)
    if scatter is None or scatter.holds(found):
        return found
    v_storage, v_loss = found.storage**2, found.loss**2
    s_storage, s_loss = scatter.storage**2, scatter.loss**2
    excess = 0.5 * (v_storage / s_storage + v_loss / s_loss)
    if excess <= 1.0:
        return scatter.scaled(float(np.sqrt(excess)), float(np.sqrt(excess)))
    # v'/(s' + m) + v''/(s'' + m) = 2 for the misfit m of the model: the positive root.
    half = 0.5 * (s_storage + s_loss - 0.5 * (v_storage + v_loss))
    rest = s_storage * s_loss - 0.5 * (v_storage * s_loss + v_loss * s_storage)
    misfit = float(-half + np.sqrt(max(half**2 - rest, 0.0)))
    return Noise(float(np.sqrt(s_storage + misfit)), float(np.sqrt(s_loss + misfit)))


def design_effect(noise: Noise, scatter: Scatter | None, points: Points) -> float:
    """Return the factor by which a lack of fit widens the covariance of a fit.

    Pure error differs from reading to reading; a lack of fit is common to the readings of a sweep, with the
    intraclass correlation r = (noise² − scatter²)/noise². Sweeps of n readings then are worth 1 + (n − 1) r
    times fewer (Kish's design effect). The modulus with the larger correlation counts.

    References
    ----------
    Kish, Survey Sampling, Wiley, 1965, ch. 5.
    """
    if scatter is None or scatter.holds(noise):
        return 1.0
    pure = min((scatter.storage / noise.storage) ** 2, (scatter.loss / noise.loss) ** 2)
    readings = points.omega.size / points.count
    return 1.0 + (readings - 1.0) * max(1.0 - pure, 0.0)

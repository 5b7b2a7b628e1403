"""Noise of storage and loss modulus, and the lack of fit of the model.

The residuals of a fit give the noise of either modulus. The scatter of every sweep about its own smooth curve,
which needs no superposition, is pure error; residuals beyond it are a lack of fit of the model.
"""

from dataclasses import dataclass

import numpy as np

from labpipe.arrays import Floats
from labpipe.materials.superposition._joint_fit import Points

#: Noise of the fit over scatter of the sweeps from which superposition is violated (the scatter of the fewest
#: sweeps that are judged is known to a fifth).
VIOLATED = 1.5
# Relative noise is never taken below this: cleaner data are limited by the grid of times.
_LEAST_NOISE = 1e-6
# A sweep needs this many points before a cubic leaves anything to judge, and all sweeps together
# this many free residuals before their scatter is trusted (18 % on a level).
_LEAST_POINTS, _LEAST_FREEDOM = 6, 16
_DEGREE = 3
_MEDIAN_OF_NORMAL = 0.6745  # median of the absolute value of a standard normal number
_MEDIAN_EFFICIENCY = 0.37  # of a variance from such a median


@dataclass(frozen=True, slots=True)
class Noise:
    """Relative standard deviation of storage and loss; of the scatter of sweeps also its degrees of freedom."""

    storage: float
    loss: float
    freedom: int = 0

    @property
    def reach(self) -> float:
        """Upper end of the 95 % interval of a variance over its estimate, from as many degrees of freedom."""
        return 1.0 + 2.0 * float(np.sqrt(2.0 / (_MEDIAN_EFFICIENCY * self.freedom)))

    def over(self, other: "Noise") -> tuple[float, float]:
        """Return the ratios to other levels."""
        return self.storage / other.storage, self.loss / other.loss


def noise_of(storage: float, loss: float, freedom: int = 0) -> Noise:
    """Return two levels, not below the resolution of the grid."""
    return Noise(max(storage, _LEAST_NOISE), max(loss, _LEAST_NOISE), freedom)


def with_misfit(noise: Noise, scatter: Noise | None) -> Noise:
    """Return the levels of a fit; where they exceed the scatter of the sweeps, both share the misfit of the model.

    Left to the residuals alone, one modulus would be fitted ever better there, and all misfit be noise of the other.
    """
    if scatter is None or max(noise.over(scatter)) ** 2 < scatter.reach:
        return noise
    pure = scatter.storage**2, scatter.loss**2
    misfit = 0.5 * max(noise.storage**2 - pure[0] + noise.loss**2 - pure[1], 0.0)
    return noise_of((pure[0] + misfit) ** 0.5, (pure[1] + misfit) ** 0.5)


def scatter_of_sweeps(points: Points) -> Noise | None:
    """Return the scatter of either modulus about a cubic per sweep; None if there is too little.

    The median of the absolute residuals is used, so that single outliers do not count.
    """
    residuals: list[Floats] = []
    freedom = 0
    for k in range(points.count):
        mask = points.isotherm == k
        if np.count_nonzero(mask) < _LEAST_POINTS:
            continue
        x = np.log(points.omega[mask])
        base = np.linalg.qr(np.vander(x - x.mean(), _DEGREE + 1))[0]
        share = np.sqrt(np.maximum(1.0 - np.sum(base**2, axis=1), 1e-3))
        freedom += x.size - _DEGREE - 1
        y = np.log([points.storage[mask], points.loss[mask]])
        residuals.append((y - y @ base @ base.T) / share)
    if freedom < _LEAST_FREEDOM:
        return None
    levels = np.median(np.abs(np.hstack(residuals)), axis=1) / _MEDIAN_OF_NORMAL
    return noise_of(float(levels[0]), float(levels[1]), freedom)


def design_effect(noise: Noise, scatter: Noise | None, points: Points) -> float:
    """Return the factor by which a lack of fit widens the covariance of a fit.

    Pure error differs from reading to reading; a lack of fit is common to the readings of a sweep, with the
    intraclass correlation r = (noise² − scatter²)/noise², the mean of both moduli. Sweeps of n readings then are worth
    1 + (n − 1) r times fewer (Kish's design effect). Levels within the 95 % interval of the scatter show no lack of
    fit.

    References
    ----------
    Kish, Survey Sampling, Wiley, 1965, ch. 5.
    """
    if scatter is None:
        return 1.0
    excess = float(np.mean(np.square(noise.over(scatter))))
    if excess < scatter.reach:
        return 1.0
    readings = points.omega.size / points.count
    return 1.0 + (readings - 1.0) * (1.0 - 1.0 / excess)

"""Comparison of alternative optics on the same frames, by the Bayesian information criterion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import AXES, Parameter, RingFit, fit_contact


@dataclass(frozen=True)
class Trial:
    """Fits of the same frames with the same optics and free parameters."""

    fits: tuple[RingFit, ...]

    @property
    def is_doubtful(self) -> bool:
        """Whether any frame is not explained down to its noise."""
        return any(fit.is_doubtful for fit in self.fits)

    @property
    def excess(self) -> float:
        """Mean squared misfit."""
        return float(np.mean([fit.misfit**2 for fit in self.fits]))

    @property
    def squares(self) -> float:
        """Sum over the frames of the mean square residual, in units of the noise."""
        return float(sum((fit.residual / max(fit.noise, 1e-6)) ** 2 for fit in self.fits))

    def mean(self, parameter: Parameter) -> tuple[float, float]:
        """Weighted mean over the frames, and its uncertainty from their scatter."""
        values = np.array([fit.parameters[parameter] for fit in self.fits])
        weights = np.array([1.0 / max(fit.deviation(parameter), 1e-12) ** 2 for fit in self.fits])
        mean = float((weights * values).sum() / weights.sum())
        chi_square = float((weights * (values - mean) ** 2).sum()) / max(len(values) - 1, 1)
        return mean, math.sqrt(max(chi_square, 1.0) / float(weights.sum()))

    def is_better_than(self, other: "Trial") -> bool:
        """Tell whether these optics explain the frames better, by the Bayesian information criterion.

        A pixel has the variance that the better optics leave, and errors of a model are shared by the pixels of a
        fringe, so that the sum of squares must also lose half of what exceeds noise.

        References
        ----------
        G. Schwarz, Ann. Statist. 6 (1978) 461, https://doi.org/10.1214/aos/1176344136
        """
        gain, penalty = 0.0, 0.0
        for one, old in zip(self.fits, other.fits, strict=True):
            gain += (old.residual**2 - one.residual**2) * one.pixels / max(one.residual, 1e-6) ** 2
            penalty += (1 + max(len(one.free) - len(old.free), 0)) * math.log(max(one.pixels, 2))
        return gain > penalty and 2.0 * self.excess < other.excess


def fit_frames(
    images: Sequence[NDArray[np.generic]], starts: Sequence[RingFit], view: View, extra: Sequence[Parameter]
) -> Trial | None:
    """Fit all frames with further parameters free; None when one of them fails."""
    free = tuple(dict.fromkeys((*view.settings.free, *extra)))
    settings = replace(view.settings, free=free)
    fits = []
    for image, start in zip(images, starts, strict=True):
        parameters = start.parameters.copy()
        if not set(AXES) & set(free):
            parameters[list(AXES)] = view.ellipse
        parameters[Parameter.PHASE], parameters[Parameter.SCALE] = view.optics.phase, 0.0
        fit = fit_contact(image, parameters, view.optics, settings, view.white)
        if fit is None:
            return None
        fits.append(fit)
    return Trial(tuple(fits))

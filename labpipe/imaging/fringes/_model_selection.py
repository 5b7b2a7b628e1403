"""Comparison of alternative optics on the same frames: a score test, and the Bayesian information criterion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import AXES, OPTICAL, Parameter, RingFit, cut_ring, fit_contact, ring_sums
from labpipe.imaging.fringes._ring_model import ring_limits


@dataclass(frozen=True)
class Trial:
    """Fits of the same frames with the same optics and free parameters."""

    fits: tuple[RingFit, ...]

    @property
    def excess(self) -> float:
        """Mean squared misfit."""
        return float(np.mean([fit.misfit**2 for fit in self.fits]))

    def mean(self, parameter: Parameter) -> tuple[float, float]:
        """Weighted mean over the frames, and its uncertainty from their scatter."""
        values = np.array([fit.parameters[parameter] for fit in self.fits])
        weights = np.array([1.0 / max(fit.deviation(parameter), 1e-12) ** 2 for fit in self.fits])
        mean = float((weights * values).sum() / weights.sum())
        chi_square = float((weights * (values - mean) ** 2).sum()) / max(len(values) - 1, 1)
        return mean, math.sqrt(max(chi_square, 1.0) / float(weights.sum()))

    def gain_over(self, other: "Trial", parameters: int = 1) -> float:
        """Return by how much these optics, with more parameters a frame, explain the frames better, by half the BIC.

        A pixel has the variance that the better optics leave.

        References
        ----------
        G. Schwarz, Ann. Statist. 6 (1978) 461, https://doi.org/10.1214/aos/1176344136
        """
        gain = 0.0
        for one, old in zip(self.fits, other.fits, strict=True):
            gain += (old.residual**2 - one.residual**2) * one.pixels / max(one.residual, 1e-6) ** 2
            gain -= parameters * math.log(max(one.pixels, 2))
        return gain


def fit_frames(
    images: Sequence[NDArray[np.generic]], starts: Sequence[RingFit], view: View, extra: Sequence[Parameter] = ()
) -> Trial | None:
    """Fit all frames with further parameters free; None when one of them fails."""
    free = tuple(dict.fromkeys((*view.settings.free, *extra)))
    settings = replace(view.settings, free=free)
    fits = []
    for image, start in zip(images, starts, strict=True):
        fit = fit_contact(image, begin_from(start.parameters, view, free), view.optics, settings, view.white)
        if fit is None:
            return None
        fits.append(fit)
    return Trial(tuple(fits))


def begin_from(parameters: Floats, view: View, free: Sequence[Parameter]) -> Floats:
    """Parameters to start from in a view, from those in another one, whose optics may be others."""
    parameters = parameters.copy()
    if not set(AXES) & set(free):
        parameters[list(AXES)] = view.ellipse
    parameters[Parameter.PHASE] = view.optics.phase
    parameters[[Parameter.SCALE, *OPTICAL]] = 0.0
    return parameters


def promised_gains(
    images: Sequence[NDArray[np.generic]], trial: Trial, view: View, groups: Sequence[Sequence[Parameter]]
) -> list[float]:
    """Fall of the sum of squares, in variances, that each group of parameters promises when it is free too.

    To first order, with one value for all frames: the score test (C. R. Rao, Proc. Camb. Phil. Soc. 44 (1948) 50,
    https://doi.org/10.1017/S0305004100023987).
    """
    added = list(dict.fromkeys(parameter for group in groups for parameter in group))
    bend, pull = np.zeros((len(added), len(added))), np.zeros(len(added))
    for image, fit in zip(images, trial.fits, strict=True):
        free = [parameter for parameter in fit.free if parameter not in added]
        limits = ring_limits(fit.radius, view.optics, view.settings.fringes, view.settings.least_spacing)
        ring = cut_ring(image, fit.parameters, *limits, view.white, view.settings.quick.max_pixels)
        if ring is None:
            continue
        sums = ring_sums(ring, fit.parameters, np.array([*free, *added], np.int64), view.optics)
        k, share = len(free), fit.pixels / max(sums.pixels, 1) / max(fit.residual, 1e-6) ** 2
        along = np.linalg.lstsq(sums.normal[:k, :k], sums.normal[:k, k:])[0]
        bend += share * (sums.normal[k:, k:] - sums.normal[k:, :k] @ along)
        pull += share * (sums.right[k:] - along.T @ sums.right[:k])
    gains = []
    for group in groups:
        at = [added.index(parameter) for parameter in group]
        gains.append(float(pull[at] @ np.linalg.pinv(bend[np.ix_(at, at)], rcond=1e-12) @ pull[at]))
    return gains

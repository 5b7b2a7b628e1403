"""What a whole film tells about its optics: phase in the contact, scale of the phase, ellipticity.

Each of them is taken from the largest contacts and then held for all frames. Left free in every
frame they would multiply the effect of every other error.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.contact_search import View
from labpipe.imaging.radius_fit import Parameter, RingFit, fit_contact

Floats = NDArray[np.float64]

#: Frames that are used, the largest contacts first.
_FRAMES = 8
#: A freed quantity is believed when it lowers the squared misfit by this factor, ...
_FACTOR = 2.0
#: ... the sum of squares by this many variances per frame, ...
_VARIANCES = 30.0
#: ... and differs from its assumed value by this many standard uncertainties.
_SIGNIFICANT = 5.0
#: Greatest logarithm of the phase scale that is believed: beyond it, R or the wavelength is wrong.
_MOST_SCALE = 0.1

_AXES = (Parameter.STRETCH, Parameter.SHEAR)


@dataclass(frozen=True)
class Calibration:
    """What a film tells about its optics.

    Attributes
    ----------
    phase_shift, u_phase_shift : float [rad]
        Phase in the contact relative to the assumed one.
    log_scale, u_log_scale : float [1]
        Logarithm of the phase scale relative to the assumed one.
    ellipse : (float, float)
        Stretch and shear of circles.
    frames : tuple of int
        Frames that were used.
    """

    phase_shift: float = 0.0
    u_phase_shift: float = 0.0
    log_scale: float = 0.0
    u_log_scale: float = 0.0
    ellipse: tuple[float, float] = (0.0, 0.0)
    frames: tuple[int, ...] = ()

    @property
    def is_usual(self) -> bool:
        """Whether all is as it was assumed."""
        return (self.phase_shift, self.log_scale, self.ellipse) == (0.0, 0.0, (0.0, 0.0))

    def applied(self, view: View) -> View:
        """Return the view with what was found."""
        optics = replace(
            view.optics,
            phase=view.optics.phase + self.phase_shift,
            phase_scale=view.optics.phase_scale * math.exp(self.log_scale),
        )
        return replace(view, optics=optics, ellipse=self.ellipse, alternatives=())


@dataclass(frozen=True)
class _Trial:
    """Fits of the same frames with one set of free parameters."""

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

    def is_better_than(self, other: "_Trial") -> bool:
        """Tell whether the misfit is much lower, and not by chance."""
        gain = sum(
            (a.residual**2 - b.residual**2) * b.pixels / max(b.noise, 1e-6) ** 2
            for a, b in zip(other.fits, self.fits, strict=True)
        )
        is_significant = gain > _VARIANCES * len(self.fits)
        return is_significant and self.excess * _FACTOR < other.excess


def calibrate(
    frame_of: Callable[[int], NDArray[np.generic]],
    fits: dict[int, RingFit],
    view: View,
    *,
    is_phase_free: bool,
    shape: str,
) -> Calibration:
    """Find phase, scale and ellipticity of a film.

    Parameters
    ----------
    frame_of : callable
        Reads a frame.
    fits : dict
        Fits by frame.
    view : View
        The view they were made with.
    is_phase_free : bool
        Whether the phase may be changed.
    shape : "auto", "circle" or "ellipse"
        Whether circles may be ellipses: if the film says so, no, or yes in every frame.

    Returns
    -------
    Calibration
        What differs from the assumptions beyond doubt; the assumptions else.
    """
    chosen = _choose(fits)
    if not chosen:
        return Calibration()
    images = [frame_of(index) for index in chosen]
    starts = [fits[index] for index in chosen]

    def attempt(extra: Sequence[Parameter], base: tuple[float, float]) -> _Trial | None:
        return _attempt(images, starts, view, tuple(extra), base)

    plain_axes = _AXES if shape == "ellipse" else ()
    best = attempt(plain_axes, (0.0, 0.0))
    if best is None:
        return Calibration()
    ellipse = (0.0, 0.0)
    if shape == "auto":
        oblique = attempt(_AXES, (0.0, 0.0))
        if oblique is not None and oblique.is_better_than(best):
            ellipse = (oblique.mean(Parameter.STRETCH)[0], oblique.mean(Parameter.SHEAR)[0])
            best = attempt(plain_axes, ellipse) or oblique
    candidates: list[tuple[float, Parameter, _Trial]] = []
    for parameter in (Parameter.PHASE, Parameter.SCALE):
        if parameter is Parameter.PHASE and not is_phase_free:
            continue
        trial = attempt((*plain_axes, parameter), ellipse)
        if trial is None or not trial.is_better_than(best):
            continue
        assumed = view.optics.phase if parameter is Parameter.PHASE else 0.0
        value, deviation = trial.mean(parameter)
        if abs(value - assumed) > _SIGNIFICANT * deviation:
            candidates.append((trial.excess, parameter, trial))
    result = Calibration(ellipse=ellipse, frames=chosen)
    if not candidates:
        return result
    _, parameter, trial = min(candidates, key=lambda candidate: candidate[0])
    value, deviation = trial.mean(parameter)
    if parameter is Parameter.PHASE:
        shift = value - view.optics.phase
        return replace(result, phase_shift=shift, u_phase_shift=deviation)
    if abs(value) > _MOST_SCALE:
        return result
    return replace(result, log_scale=value, u_log_scale=deviation)


def _choose(fits: dict[int, RingFit]) -> tuple[int, ...]:
    """Frames whose radius is best known among the larger contacts."""
    radius = {index: float(fit.parameters[Parameter.RADIUS]) for index, fit in fits.items()}
    if not radius:
        return ()
    largest = max(radius.values())
    large = [index for index, value in radius.items() if value > 0.5 * largest]
    # Contacts that hardly move and are seen from all sides come first.
    large.sort(key=lambda index: (fits[index].deviation(Parameter.RADIUS), index))
    return tuple(sorted(large[:_FRAMES]))


def _attempt(
    images: Sequence[NDArray[np.generic]],
    starts: Sequence[RingFit],
    view: View,
    extra: tuple[Parameter, ...],
    ellipse: tuple[float, float],
) -> _Trial | None:
    """Fit all frames with further parameters free; None when one of them fails."""
    free = tuple(dict.fromkeys(view.settings.free + extra))
    settings = replace(view.settings, free=free)
    fits = []
    for image, start in zip(images, starts, strict=True):
        parameters = start.parameters.copy()
        if Parameter.STRETCH not in extra:
            parameters[[Parameter.STRETCH, Parameter.SHEAR]] = ellipse
        parameters[Parameter.PHASE] = view.optics.phase
        parameters[Parameter.SCALE] = 0.0
        fit = fit_contact(image, parameters, view.optics, settings, view.white)
        if fit is None:
            return None
        fits.append(fit)
    return _Trial(tuple(fits))

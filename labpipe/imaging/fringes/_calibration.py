"""Calibration of the optics from a whole film: phase, phase scale, blur, ellipticity.

Each of them is taken from the largest contacts and then held for all frames. Left free in every
frame they would multiply the effect of every other error.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._ring_fit import Parameter, RingFit, fit_contact
from labpipe.imaging.fringes._search import View

#: Frames that are used, the largest contacts first.
_FRAMES = 8
#: A freed quantity is believed when it lowers the squared misfit by this factor, ...
_FACTOR = 2.0
#: ... the sum of squares by this many variances per frame, ...
_VARIANCES = 30.0
#: ... and differs from its assumed value by this many standard uncertainties.
_SIGNIFICANT = 5.0
#: Greatest logarithm of the phase scale that is believed: a factor of two.
_MOST_SCALE = 0.7
#: Standard deviations (px) of the image of a point that are tried.
_BLURS = (0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5)
#: Frames in which they are tried.
_BLUR_FRAMES = 4

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
    blur : float [px]
        Standard deviation of the image of a point.
    frames : tuple of int
        Frames that were used.
    doubted_phase : float [rad]
        What the film shows where the caller's phase was kept; NaN when they agree.
    """

    phase_shift: float = 0.0
    u_phase_shift: float = 0.0
    log_scale: float = 0.0
    u_log_scale: float = 0.0
    ellipse: tuple[float, float] = (0.0, 0.0)
    blur: float = 0.0
    frames: tuple[int, ...] = ()
    doubted_phase: float = math.nan

    @property
    def is_usual(self) -> bool:
        """Whether all is as it was assumed."""
        is_circle = self.ellipse == (0.0, 0.0)
        return is_circle and (self.phase_shift, self.log_scale, self.blur) == (0.0, 0.0, 0.0)

    def applied(self, view: View) -> View:
        """Return the view with what was found."""
        optics = replace(
            view.optics,
            phase=view.optics.phase + self.phase_shift,
            phase_scale=view.optics.phase_scale * math.exp(self.log_scale),
            blur=self.blur,
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


class _Attempt(Protocol):
    """Fits the chosen frames with further parameters free, some things being known."""

    def __call__(self, extra: Sequence[Parameter], known: Calibration, count: int = ...) -> _Trial | None:
        """Return the fits, or None when one of them fails."""


def calibrate(
    frame_of: Callable[[int], NDArray[np.generic]],
    fits: dict[int, RingFit],
    view: View,
    *,
    is_phase_free: bool,
    shape: str,
    rough: Sequence[Parameter] = (),
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
    rough : sequence of Parameter
        Which of phase and scale the view has from single frames, so that they are found anew.

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

    def attempt(extra: Sequence[Parameter], known: Calibration, count: int = _FRAMES) -> _Trial | None:
        seen = known.applied(view)
        return _attempt(images[:count], starts[:count], seen, tuple(extra))

    plain_axes = _AXES if shape == "ellipse" else ()
    result = Calibration(frames=chosen)
    best = attempt(plain_axes, result)
    if best is None:
        return Calibration()
    if shape == "auto":
        oblique = attempt(_AXES, result)
        if oblique is not None and oblique.is_better_than(best):
            axes = (oblique.mean(Parameter.STRETCH)[0], oblique.mean(Parameter.SHEAR)[0])
            result = replace(result, ellipse=axes)
            best = attempt(plain_axes, result) or oblique
    if rough:
        trial = attempt((*plain_axes, *rough), result)
        if trial is not None:
            result = _with_rough(trial, result, rough, view)
            best = attempt(plain_axes, result) or best
    # Blur may hide behind a wrong phase or scale, or the other way round: hence twice.
    for _ in range(2):
        candidates = [
            _find_blur(attempt, plain_axes, result, best),
            _find_optics(attempt, plain_axes, result, best, Parameter.PHASE, view),
            _find_optics(attempt, plain_axes, result, best, Parameter.SCALE, view),
        ]
        better = [candidate for candidate in candidates if candidate is not None]
        if not better:
            break
        trial, found = min(better, key=lambda candidate: candidate[0].excess)
        if found.phase_shift != result.phase_shift and not is_phase_free:
            # The scale would be bent to make up for a phase that is not what it is said to be.
            return replace(result, doubted_phase=view.optics.phase + found.phase_shift)
        result = found
        best = attempt(plain_axes, result) or trial
    return result


def _with_rough(trial: _Trial, known: Calibration, rough: Sequence[Parameter], view: View) -> Calibration:
    """Take phase and scale from a trial that left them free."""
    if Parameter.PHASE in rough:
        phase, u = trial.mean(Parameter.PHASE)
        known = replace(known, phase_shift=phase - view.optics.phase, u_phase_shift=u)
    if Parameter.SCALE in rough:
        scale, u = trial.mean(Parameter.SCALE)
        known = replace(known, log_scale=scale, u_log_scale=u)
    return known


def _find_blur(
    attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial
) -> tuple[_Trial, Calibration] | None:
    """Blur that leaves least, when it explains the frames much better than none."""
    if known.blur or not any(fit.model_deviation > 0.0 for fit in best.fits):
        return None
    sharp = _Trial(best.fits[:_BLUR_FRAMES])
    tried: dict[float, _Trial] = {}
    for blur in _BLURS:
        trial = attempt(axes, replace(known, blur=blur), _BLUR_FRAMES)
        if trial is None:
            break
        tried[blur] = trial
        if trial.excess > 4.0 * min(other.excess for other in tried.values()) + 1e-6:
            break
    if not tried:
        return None
    blur = min(tried, key=lambda value: tried[value].excess)
    if not tried[blur].is_better_than(sharp):
        return None
    found = replace(known, blur=blur)
    trial = attempt(axes, found)
    return None if trial is None else (trial, found)


def _find_optics(
    attempt: _Attempt, axes: Sequence[Parameter], known: Calibration, best: _Trial, parameter: Parameter, view: View
) -> tuple[_Trial, Calibration] | None:
    """Phase or scale that the film shows, when it explains the frames much better."""
    trial = attempt((*axes, parameter), known)
    if trial is None or not trial.is_better_than(best):
        return None
    value, deviation = trial.mean(parameter)
    if parameter is Parameter.PHASE:
        shift = value - view.optics.phase
        if abs(shift - known.phase_shift) <= _SIGNIFICANT * deviation:
            return None
        return trial, replace(known, phase_shift=shift, u_phase_shift=deviation)
    scale = known.log_scale + value
    if abs(value) <= _SIGNIFICANT * deviation or abs(scale) > _MOST_SCALE:
        return None
    return trial, replace(known, log_scale=scale, u_log_scale=deviation)


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
    images: Sequence[NDArray[np.generic]], starts: Sequence[RingFit], view: View, extra: tuple[Parameter, ...]
) -> _Trial | None:
    """Fit all frames with further parameters free; None when one of them fails."""
    free = tuple(dict.fromkeys(view.settings.free + extra))
    settings = replace(view.settings, free=free)
    fits = []
    for image, start in zip(images, starts, strict=True):
        parameters = start.parameters.copy()
        if Parameter.STRETCH not in extra:
            parameters[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
        parameters[Parameter.PHASE] = view.optics.phase
        parameters[Parameter.SCALE] = 0.0
        fit = fit_contact(image, parameters, view.optics, settings, view.white)
        if fit is None:
            return None
        fits.append(fit)
    return _Trial(tuple(fits))

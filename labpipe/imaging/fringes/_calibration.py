"""Calibration of the optics of a film from its largest contacts: phase, scale, ellipse, blur, coherence, beams, flat.

Each of them is determined from several frames and then held for all. Left free in every frame they would multiply the
effect of every other error. The alternatives are compared in :mod:`._model_selection`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._model_selection import Trial, fit_frames
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import AXES, LIGHT, Parameter, RingFit

#: Frames that are used, the best known of the larger contacts first, and how many of them search a scale of values.
_FRAMES, _FEW = 8, 4
#: Values of each property that are tried: blur (px), relative variance of the wavenumber, ratio of harmonics, and
#: radius of a flat as a share of the smallest radius of the frames.
_LADDERS = {
    "blur": (0.4, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0, 2.5),
    "spread": (1e-4, 4e-4, 1.5e-3, 5e-3),
    "beams": (-0.35, -0.2, -0.1, -0.05, 0.05, 0.1),
    "flat": (0.3, 0.5, 0.65, 0.8, 0.9),
}


@dataclass(frozen=True)
class Calibration:
    """Optics that a film shows beyond doubt where they differ from the assumed ones.

    ``phase_shift`` [rad] and ``log_scale``, logarithm of the phase scale, are relative to the assumed ones; ``ellipse``
    is stretch and shear of circles; ``properties`` are names and values of blur, spread, beams and flat of
    :class:`.Optics`; ``has_uneven_light``: light falls off differently along x and y; ``doubted_phase`` [rad] is shown
    by the film where the caller's was kept.
    """

    phase_shift: float = 0.0
    u_phase_shift: float = 0.0
    log_scale: float = 0.0
    u_log_scale: float = 0.0
    ellipse: tuple[float, float] = (0.0, 0.0)
    properties: tuple[tuple[str, float], ...] = ()
    has_uneven_light: bool = False
    frames: tuple[int, ...] = ()
    doubted_phase: float = math.nan

    @property
    def is_usual(self) -> bool:
        """Whether all is as it was assumed."""
        return replace(self, frames=(), doubted_phase=0.0) == Calibration(doubted_phase=0.0)

    def applied(self, view: View) -> View:
        """Return the view with these optics."""
        optics = replace(
            view.optics,
            phase=view.optics.phase + self.phase_shift,
            phase_scale=view.optics.phase_scale * math.exp(self.log_scale),
            **dict(self.properties),
        )
        light = LIGHT if self.has_uneven_light else ()
        settings = replace(view.settings, free=tuple(dict.fromkeys((*view.settings.free, *light))))
        return replace(view, optics=optics, settings=settings, ellipse=self.ellipse, alternatives=())


def calibrate(
    frame_of: Callable[[int], NDArray[np.generic]],
    fits: dict[int, RingFit],
    view: View,
    *,
    is_phase_free: bool,
    is_auto: bool,
) -> Calibration:
    """Find the optics of a film from its fits, made with a view; ``frame_of`` reads a frame.

    Contacts may be ellipses where ``is_auto``; a phase that is not free is not changed.
    """
    chosen = _choose(fits)
    if not chosen:
        return Calibration()
    images = [frame_of(index) for index in chosen]
    starts = [fits[index] for index in chosen]

    def attempt(known: Calibration, *extra: Parameter, is_quick: bool = False) -> Trial | None:
        seen = known.applied(view)
        if is_quick:
            seen = replace(seen, settings=seen.settings.quick)
            return fit_frames(images[:_FEW], starts[:_FEW], seen, extra)
        return fit_frames(images, starts, seen, extra)

    result = Calibration(frames=chosen)
    best = attempt(result)
    if best is None:
        return Calibration()
    # One property may hide behind another: each round accepts the best alternative and begins anew.
    for _ in range(len(_LADDERS) + 4):
        found = _best_alternative(attempt, result, best, view, is_auto=is_auto)
        if found is None:
            break
        trial, better = found
        if better.phase_shift != result.phase_shift and not is_phase_free:
            # The scale would be bent to make up for a phase that is not the stated one.
            return replace(result, doubted_phase=view.optics.phase + better.phase_shift)
        best, result = trial, better
    return result


Attempt = Callable[..., Trial | None]


def _best_alternative(
    attempt: Attempt, known: Calibration, best: Trial, view: View, *, is_auto: bool
) -> tuple[Trial, Calibration] | None:
    """Alternative that explains the frames best, if it does so better than what is known."""
    candidates: list[tuple[Trial | None, Calibration]] = []
    axes = attempt(known, *AXES) if is_auto and known.ellipse == (0.0, 0.0) else None
    if axes is not None:
        ellipse = axes.mean(Parameter.STRETCH)[0], axes.mean(Parameter.SHEAR)[0]
        candidates.append((axes, replace(known, ellipse=ellipse)))
    # a wrong ruler or wavelength is commoner than another phase, which explains fringes nearly as well
    scaled, phased = attempt(known, Parameter.SCALE), attempt(known, Parameter.PHASE)
    if scaled is not None:
        value, u = scaled.mean(Parameter.SCALE)
        if abs(known.log_scale + value) <= 0.1:  # beyond it, R or the wavelength is wrong
            candidates.append((scaled, replace(known, log_scale=known.log_scale + value, u_log_scale=u)))
    if phased is not None:
        value, u = phased.mean(Parameter.PHASE)
        candidates.append((phased, replace(known, phase_shift=value - view.optics.phase, u_phase_shift=u)))
    if best.is_doubtful:
        names = [name for name in _LADDERS if name not in dict(known.properties)]
        candidates += [_searched(attempt, known, best, name) for name in names]
        if not known.has_uneven_light:
            uneven = replace(known, has_uneven_light=True)
            candidates.append((attempt(uneven), uneven))
    better = [(trial, found) for trial, found in candidates if trial is not None and trial.is_better_than(best)]
    if not better:
        return None
    # of those that explain the frames nearly as well the first, which is the commonest
    least = min(trial.excess for trial, _ in better)
    found = next(found for trial, found in better if trial.excess <= 1.2 * least)
    trial = attempt(found)
    return None if trial is None or not trial.is_better_than(best) else (trial, found)


def _searched(attempt: Attempt, known: Calibration, best: Trial, name: str) -> tuple[Trial | None, Calibration]:
    """Value of a property that leaves least: the best of its ladder, then of the vertex of a parabola through three."""
    unit = min(fit.radius for fit in best.fits) if name == "flat" else 1.0
    tried: dict[float, float] = {}

    def with_value(value: float) -> Calibration:
        return replace(known, properties=(*known.properties, (name, value * unit)))

    def squares(value: float) -> float:
        trial = attempt(with_value(value) if value else known, is_quick=True)
        tried[value] = math.inf if trial is None else trial.squares
        return tried[value]

    at = min((0.0, *_LADDERS[name]), key=squares)
    if at == 0.0:
        return None, known
    values = sorted(tried)
    place = values.index(at)
    around = values[max(place - 1, 0) : place + 2]
    if len(around) == 3 and all(math.isfinite(tried[value]) for value in around):
        bend, slope, _ = np.polyfit(np.array(around) - at, [tried[value] for value in around], 2)
        squares(at - float(slope / (2.0 * bend)))
        at = min(tried, key=lambda value: tried[value])
    found = with_value(at)
    return attempt(found), found


def _choose(fits: dict[int, RingFit]) -> tuple[int, ...]:
    """Frames whose radius is best known among the larger contacts that do not recede: their gap is Hertz's."""
    if not fits:
        return ()
    largest = max(fit.radius for fit in fits.values())
    large = [index for index, fit in fits.items() if fit.radius > 0.5 * largest]
    growing = [index for index in large if index - 1 not in fits or fits[index].radius > 0.999 * fits[index - 1].radius]
    large = growing if len(growing) > 2 else large
    # Contacts that hardly move and are seen from all sides come first.
    large.sort(key=lambda index: (fits[index].deviation(Parameter.RADIUS), index))
    return tuple(sorted(large[:_FRAMES]))

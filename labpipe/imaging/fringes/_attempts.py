"""Fits of a film's chosen frames under one assumption after the other, each begun where the last one ended."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._gains import Gains
from labpipe.imaging.fringes._lens_blur import LEAST_SHAPED
from labpipe.imaging.fringes._ring_fit import RingFit, fit_ring, ring_around
from labpipe.imaging.fringes._ring_parameters import ASSUMED, AXES, EVEN, HARMONICS, Parameter
from labpipe.imaging.fringes._together import what_is_found
from labpipe.imaging.fringes._trials import FEW_FRAMES, MOST_FRAMES, Calibration, Trial
from labpipe.imaging.fringes._view import View

#: Residual of the last fit of a frame over that of the first from which it is no start for the next.
_NO_WORSE = 1.02
#: Evaluations of a fit: what explains the frames settled within 5.
_ITERATIONS = 8
#: Blur that is allowed for at the border over the first one that is larger than was allowed for.
_WIDER = 1.3
#: What of the optics is fitted.
_NAMES = {
    Parameter.PHASE: "phase",
    Parameter.SCALE: "phase_scale",
    Parameter.BLUR: "blur",
    Parameter.SPREAD: "spread",
    Parameter.FOCUS: "focus",
}


class Attempts:
    """Fits the chosen frames with further parameters free, some things being known: see :class:`.Attempt`.

    It starts from fits of them, made with one view.
    """

    def __init__(self, images: Sequence[NDArray[np.generic]], starts: Sequence[RingFit], view: View) -> None:
        self._images = images
        self._view = view
        self._first: list[tuple[RingFit, View]] = [(fit, view) for fit in starts]
        self._widest = view.optics.blur
        self._last: dict[tuple[Parameter, ...], list[tuple[RingFit, View]]] = {}
        self._ended: dict[object, list[tuple[RingFit, View]]] = {}
        self._made: dict[tuple[tuple[Parameter, ...], View, int], Trial | None] = {}
        self._gains: tuple[Trial, Gains] | None = None

    def __call__(
        self, extra: Sequence[Parameter], known: Calibration, count: int = MOST_FRAMES, pixels: int | None = None
    ) -> Trial | None:
        """Return the fits, or None when one of them fails; what settled before is not fitted again."""
        extra, seen = tuple(sorted(set(extra))), self._seen(known, pixels, extra)
        count = min(count, len(self._images))
        key = extra, seen, count
        if key not in self._made or not (pixels or _is_settled(self._made[key])):
            self._made[key] = self._fit(seen, extra, count)
        return self._made[key]

    def begin_from(self, trial: Trial, extra: Sequence[Parameter], known: Calibration) -> None:
        """Start all that follows from a trial, and forget what was tried before."""
        seen = self._seen(known, None, extra)
        self._first = [(fit, seen) for fit in trial.fits]
        self._last.clear()
        self._ended.clear()
        # what all pixels of all frames told holds, in the noise that is known now
        noise = tuple(fit.between for fit in trial.fits)
        count = len(self._images)
        whole = {key: made for key, made in self._made.items() if key[2] == count and not key[1].settings.is_rough}
        self._made = {key: made and Trial(made.fits, noise) for key, made in whole.items()}
        self._made[tuple(sorted(set(extra))), seen, count] = Trial(trial.fits, noise)

    def keep(self, places: Sequence[int], trial: Trial, extra: Sequence[Parameter], known: Calibration) -> None:
        """Go on with some of the frames alone, from a trial of these."""
        self._images = [self._images[place] for place in places]
        self._made.clear()
        self.begin_from(trial, extra, known)

    def gains(self, trial: Trial, known: Calibration) -> Gains:
        """Return what a trial's frames would gain by all else that may be fitted."""
        if self._gains is None or self._gains[0] is not trial:
            seen = self._seen(known, None)
            self._gains = trial, Gains(self._images[:FEW_FRAMES], trial.fits[:FEW_FRAMES], seen)
        return self._gains[1]

    def _seen(self, known: Calibration, pixels: int | None, extra: Sequence[Parameter] = ()) -> View:
        # what is free has no value that is known
        second, turned, third = (known.harmonics[k] * (p not in extra) for k, p in enumerate(HARMONICS))
        ellipse = (0.0, 0.0) if set(AXES) <= set(extra) else known.ellipse
        seen = replace(known, harmonics=(second, turned, third), ellipse=ellipse).applied(self._view)
        if pixels is None:
            # what else may be wrong is asked of what is known alone
            asks = tuple(dict.fromkeys((*ASSUMED, *AXES, *what_is_found(known)))) if set(extra) <= set(AXES) else ()
            return replace(seen, settings=replace(seen.settings, asks=asks))
        most = min(pixels, seen.settings.max_pixels)
        return replace(seen, settings=replace(seen.settings, max_pixels=most, is_rough=True))

    def _fit(self, view: View, extra: tuple[Parameter, ...], count: int) -> Trial | None:
        """Fit frames with further parameters free."""
        free = tuple(dict.fromkeys(view.settings.free + extra))
        if Parameter.BLUR in extra:
            # a motion and a blur are hardly told from each other: that stands for both
            free = tuple(p for p in free if p is not Parameter.SMEAR)
        settings = replace(view.settings, free=free, max_iterations=_ITERATIONS)
        last = self._last.setdefault(free, [])
        # All that is tried is compared on the same pixels: what a blur leaves out at the border is left out of all.
        if view.optics.blur > max(self._widest, LEAST_SHAPED):
            self._widest = _WIDER * view.optics.blur
        widest = replace(view.optics, blur=self._widest)
        fits: list[RingFit] = []
        for place, image in enumerate(self._images[:count]):
            first = self._first[place]
            ring = ring_around(image, _parameters(*first, view, extra), widest, settings, view.levels)
            if ring is None:
                return None
            fit = fit_ring(ring, self._start(place, view, extra, free), view.optics, settings)
            # neighbours differ by the noise whatever is assumed
            fits.append(replace(fit, noise=first[0].between, between=first[0].between) if settings.is_rough else fit)
        ended = [(fit, view) for fit in fits]
        last[: len(fits)] = self._ended[free, view.optics] = ended
        return Trial(tuple(fits), tuple(fit.between for fit, _ in self._first[:count]))

    def _start(self, place: int, view: View, extra: tuple[Parameter, ...], free: tuple[Parameter, ...]) -> Floats:
        """Return what to start from: the same by some pixels, the last one alike, or where one with more free ended."""
        start = self._first[place]
        for last in (self._ended.get((free, view.optics), []), self._last[free]):
            if place < len(last) and last[place][0].residual < _NO_WORSE * start[0].residual:
                start = last[place]
                break
        best, least = _parameters(*start, view, extra), start[0].residual ** 2
        for wider, made in self._last.items():
            if place >= len(made) or not set(free) < set(wider) or not _differ_by_free(*made[place], view):
                continue
            slid, squares = _slid(*made[place], _parameters(*made[place], view, extra), view, free)
            if squares < least:
                best, least = slid, squares
        return best


def _is_settled(trial: Trial | None) -> bool:
    """Tell whether fitting again would bring nothing."""
    return trial is None or all(fit.is_converged for fit in trial.fits)


def _differ_by_free(fit: RingFit, seen: View, view: View) -> bool:
    """Tell whether the optics of two views differ by nothing but what was free in a fit with the first one."""
    changed = {name: getattr(view.optics, name) for p, name in _NAMES.items() if p in fit.free}
    return replace(seen.optics, **changed) == view.optics


def _slid(
    fit: RingFit, seen: View, parameters: Floats, view: View, free: tuple[Parameter, ...]
) -> tuple[Floats, float]:
    """Return where a fit would end with some of what was free held at these parameters, and what it would leave there.

    To first order, in the square of the residual.
    """
    held = [p for p in fit.free if p not in free]
    before = fit.parameters[held] + [_beyond(p, seen) - _beyond(p, view) for p in held]
    kept, left_out = ([fit.free.index(p) for p in some] for some in (free, held))
    pull = np.linalg.lstsq(fit.inverse[np.ix_(left_out, left_out)], parameters[held] - before)[0]
    parameters[list(free)] = fit.parameters[list(free)] + fit.inverse[np.ix_(kept, left_out)] @ pull
    parameters[Parameter.SMEAR] = max(float(parameters[Parameter.SMEAR]), 0.0)
    return parameters, fit.residual**2 + float((parameters[held] - before) @ pull) / max(fit.pixels, 1)


def _beyond(parameter: Parameter, view: View) -> float:
    """Return from where a parameter counts in a view."""
    if parameter is Parameter.SCALE:
        return math.log(view.optics.phase_scale)
    if parameter is Parameter.BLUR:
        return view.optics.blur**2
    return float(getattr(view.optics, _NAMES[parameter])) if parameter in (Parameter.SPREAD, Parameter.FOCUS) else 0.0


def _parameters(start: RingFit, before: View, view: View, extra: tuple[Parameter, ...]) -> Floats:
    """Return what to start from in a view, from a fit in another one.

    What the lens blurs in this view and did not in that one was taken for a motion.
    """
    parameters = start.parameters.copy()
    if Parameter.STRETCH not in extra:
        parameters[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
    parameters[Parameter.PHASE] = view.optics.phase
    parameters[Parameter.SCALE] = 0.0
    beyond = before.optics.blur**2 + float(parameters[Parameter.BLUR]) - view.optics.blur**2
    beyond += float(parameters[Parameter.SMEAR]) / EVEN
    parameters[[Parameter.BLUR, Parameter.SPREAD, Parameter.FOCUS, Parameter.SHAPE]] = 0.0
    if Parameter.BLUR in extra:
        parameters[[Parameter.BLUR, Parameter.SMEAR]] = beyond, 0.0
    elif Parameter.SMEAR in view.settings.free:
        parameters[Parameter.SMEAR] = max(EVEN * beyond, 0.0)
    for place, harmonic in zip(HARMONICS, view.harmonics, strict=True):
        if place not in extra:
            parameters[place] = harmonic
    return parameters

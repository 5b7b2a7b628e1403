"""Fits of a film's chosen frames under one assumption after the other, each begun where the last one ended."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._fingerprint import round_share
from labpipe.imaging.fringes._gains import Gains, gains_of
from labpipe.imaging.fringes._lens_blur import LEAST_SHAPED
from labpipe.imaging.fringes._ring_fit import RingFit, fit_ring, ring_around
from labpipe.imaging.fringes._ring_parameters import ASSUMED, AXES, EVEN, HARMONICS, Parameter
from labpipe.imaging.fringes._trials import FEW_FRAMES, FEW_PIXELS, MOST_FRAMES, Calibration, Trial
from labpipe.imaging.fringes._view import View

#: Residual of the last fit of a frame over that of the first from which it is no start for the next.
_NO_WORSE = 1.02
#: Evaluations of a fit: what explains the frames settled within 5.
_ITERATIONS = 8
#: Blur that is allowed for at the border over the first one that is larger than was allowed for.
_WIDER = 1.3


class Attempts:
    """Fits the chosen frames with further parameters free, some things being known: see :class:`.Attempt`.

    Parameters
    ----------
    images : sequence of arrays (row, column)
        Grey levels.
    starts : sequence of RingFit
        Fits of them.
    view : View
        The view that these were made with.
    """

    def __init__(self, images: Sequence[NDArray[np.generic]], starts: Sequence[RingFit], view: View) -> None:
        self._images = images
        self._view = view
        self._first: list[tuple[RingFit, float]] = [(fit, view.optics.blur) for fit in starts]
        self._widest = view.optics.blur
        self._last: dict[object, list[tuple[RingFit, float]]] = {}
        self._made: dict[object, Trial | None] = {}
        self._told: tuple[Trial, float] | None = None
        self._gains: tuple[Trial, Gains] | None = None

    def __call__(
        self, extra: Sequence[Parameter], known: Calibration, count: int = MOST_FRAMES, pixels: int | None = None
    ) -> Trial | None:
        """Return the fits, or None when one of them fails; what was asked before is not fitted again."""
        seen = self._seen(known, pixels)
        key = tuple(extra), seen, count
        if key not in self._made:
            self._made[key] = self._fit(seen, tuple(extra), count)
        return self._made[key]

    def begin_from(self, trial: Trial, extra: Sequence[Parameter], known: Calibration) -> None:
        """Start all that follows from a trial, and forget what was tried before."""
        seen = self._seen(known, None)
        self._first = [(fit, seen.optics.blur) for fit in trial.fits]
        self._last.clear()
        self._made.clear()
        self._made[tuple(extra), seen, MOST_FRAMES] = trial

    def keep(self, places: Sequence[int], trial: Trial, extra: Sequence[Parameter], known: Calibration) -> None:
        """Go on with some of the frames alone, from a trial of these."""
        self._images = [self._images[place] for place in places]
        self.begin_from(trial, extra, known)

    def round_share(self, trial: Trial, known: Calibration) -> float:
        """Return the share of the squared errors of the model that functions of the distance would explain."""
        if self._told is None or self._told[0] is not trial:
            seen = self._seen(known, None)
            self._told = trial, round_share(self._images[:FEW_FRAMES], trial.fits[:FEW_FRAMES], seen)
        return self._told[1]

    def gains(self, trial: Trial, known: Calibration) -> Gains:
        """Return what some pixels of a trial's frames would gain by all else that may be fitted."""
        if self._gains is None or self._gains[0] is not trial:
            seen = self._seen(known, FEW_PIXELS)
            self._gains = trial, gains_of(self._images[:FEW_FRAMES], trial.fits[:FEW_FRAMES], seen)
        return self._gains[1]

    def _seen(self, known: Calibration, pixels: int | None) -> View:
        seen = known.applied(self._view)
        if pixels is None:
            return replace(seen, settings=replace(seen.settings, asks=(*ASSUMED, *AXES)))
        return replace(seen, settings=replace(seen.settings, max_pixels=pixels, tells_memory=False, asks=()))

    def _fit(self, view: View, extra: tuple[Parameter, ...], count: int) -> Trial | None:
        """Fit frames with further parameters free."""
        free = tuple(dict.fromkeys(view.settings.free + extra))
        settings = replace(view.settings, free=free, max_iterations=_ITERATIONS)
        last = self._last.setdefault(free, [])
        # All that is tried is compared on the same pixels: what a blur leaves out at the border is left out of all.
        if view.optics.blur > max(self._widest, LEAST_SHAPED):
            self._widest = _WIDER * view.optics.blur
        widest = replace(view.optics, blur=self._widest)
        fits: list[RingFit] = []
        for place, image in enumerate(self._images[:count]):
            start = first = self._first[place]
            if place < len(last) and last[place][0].residual < _NO_WORSE * first[0].residual:
                start = last[place]
            ring = ring_around(image, _parameters(*first, view, extra), widest, settings, view.levels)
            if ring is None:
                return None
            fits.append(fit_ring(ring, _parameters(*start, view, extra), view.optics, settings))
        last[: len(fits)] = [(fit, view.optics.blur) for fit in fits]
        return Trial(tuple(fits), tuple(fit.between for fit, _ in self._first[:count]))


def _parameters(start: RingFit, blur: float, view: View, extra: tuple[Parameter, ...]) -> Floats:
    """Return what to start from in a view, from a fit in another one with a blur (px) of its own.

    What the lens blurs in this view and did not in that one was taken for a motion.
    """
    parameters = start.parameters.copy()
    if Parameter.STRETCH not in extra:
        parameters[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
    parameters[Parameter.PHASE] = view.optics.phase
    parameters[Parameter.SCALE] = 0.0
    if Parameter.SMEAR in view.settings.free:
        beyond = blur**2 + float(parameters[Parameter.BLUR]) - view.optics.blur**2
        parameters[Parameter.SMEAR] = max(float(parameters[Parameter.SMEAR]) + EVEN * beyond, 0.0)
    parameters[[Parameter.BLUR, Parameter.SPREAD, Parameter.FOCUS]] = 0.0
    for place, harmonic in zip(HARMONICS, view.harmonics, strict=True):
        if place not in extra:
            parameters[place] = harmonic
    return parameters

"""Find phase and scale of the fringes in a frame that the stated optics do not explain.

A contact may show any phase, from dark to bright, and the stated wavelength or radius may be
wrong. Fringes of every phase and of scales between half and twice the stated one are compared with
the radial profile about the spots of a frame, all radii of contact at once; what explains it best
is fitted with phase and scale free, and believed when it leaves little and is a contact.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT, is_contact
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._phase_scan import Guess, guesses
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import PARAMETERS, Parameter
from labpipe.imaging.fringes._second_colour import find_colours
from labpipe.imaging.fringes._spots import Spot
from labpipe.imaging.fringes._view import View

#: Places looked at.
_PLACES = 3
#: Pixels of a trial, and fringes of the two fits of one.
_PIXELS, _NEAR, _FAR = 12_000, 1.5, 3.0
#: Evaluations of one of them: where other optics explained a frame they settled sooner.
_ITERATIONS = 8
#: Misfit of the first fringes from which a start is none: right ones left 0.1 at most.
_UNEXPLAINED = 0.3
#: Frames that are searched in a film, and below which one that is explained is enough.
_MOST_TRIED, _FEW_TRIED = 6, 3
#: Differences of phase (rad) and logarithm of the scale below which two frames agree.
_SAME_PHASE, _SAME_SCALE = 0.4, 0.03
#: Difference from the stated phase (rad) below which that is kept.
_STATED_PHASE = 0.1
#: Difference of the second colour's wavenumber over that of the first below which they agree.
_SAME_RATIO = 0.06


class OtherOptics:
    """Learns phase and scale from frames that the stated optics leave unexplained.

    Two frames must agree before they are taken, so that the rings of a body that comes close, or
    dust, do not decide for a film.

    Parameters
    ----------
    result : FilmResult
        Its view is replaced.
    is_phase_free : bool
        Whether the phase may be other than stated.
    """

    def __init__(self, result: FilmResult, *, is_phase_free: bool) -> None:
        self._result = result
        self._is_phase_free = is_phase_free
        self._tried: dict[int, Looks] = {}
        self._found: list[RingFit] = []
        self._is_done = False

    def learns_from(self, looks: Looks, index: int) -> bool:
        """Look at a frame that shows no contact; tell whether the film's view has changed."""
        if self._is_done or len(self._tried) >= _MOST_TRIED or index in self._tried:
            return False
        if not looks.have_structure or looks.show_only_sphere(self._result.view.optics):
            return False
        self._tried[index] = looks
        fit = find_optics(looks, self._result.view, is_phase_free=self._is_phase_free)
        if fit is None:
            return False
        agreeing = any(_is_like(fit.parameters, other.parameters) for other in self._found)
        self._found.append(fit)
        return agreeing and self._take(fit)

    def takes_single(self) -> bool:
        """Take the only optics found in a film that nothing else explains, or else light of two colours."""
        is_few = len(self._tried) < _FEW_TRIED
        return (len(self._found) == 1 and is_few and self._take(self._found[0])) or self._takes_colours(is_few)

    def _takes_colours(self, is_one_enough: bool) -> bool:
        view, found = self._result.view, list[tuple[RingFit, tuple[float, float]]]()
        for looks in self._tried.values():
            both = find_colours(looks, view, is_phase_free=self._is_phase_free)
            if both is None:
                continue
            found.append(both)
            if is_one_enough or any(_is_same_light(both, other) for other in found[:-1]):
                self._result.view = replace(view, optics=replace(view.optics, colour=both[1]))
                return self._take(both[0])
        return False

    def _take(self, fit: RingFit) -> bool:
        view = self._result.view
        log_scale, phase = float(fit.parameters[Parameter.SCALE]), float(fit.parameters[Parameter.PHASE])
        if _turn(phase, view.optics.phase) < _STATED_PHASE:
            phase = view.optics.phase  # the calibration tells it better, from all frames
        if abs(log_scale) < _SAME_SCALE:
            log_scale = 0.0  # one frame knows it worse than who stated R and wavelength
        scale = view.optics.phase_scale * math.exp(log_scale)
        optics = replace(view.optics, phase=phase, phase_scale=scale)
        self._result.view = replace(view, optics=optics)
        self._tried.clear()
        self._found.clear()
        self._is_done = True
        return True


def _turn(one: float, other: float) -> float:
    """Angle (rad) between two phases."""
    return abs(math.remainder(one - other, 2.0 * math.pi))


def _is_like(one: Floats, other: Floats) -> bool:
    """Tell whether the parameters of two fits agree in phase and scale."""
    scale = abs(float(one[Parameter.SCALE] - other[Parameter.SCALE]))
    return _turn(float(one[Parameter.PHASE]), float(other[Parameter.PHASE])) < _SAME_PHASE and scale < _SAME_SCALE


def _is_same_light(one: tuple[RingFit, tuple[float, float]], other: tuple[RingFit, tuple[float, float]]) -> bool:
    """Tell whether two fits agree in phase, scale and the second colour."""
    return abs(one[1][0] - other[1][0]) < _SAME_RATIO and _is_like(one[0].parameters, other[0].parameters)


def rebase(result: FilmResult, fits: dict[int, RingFit]) -> None:
    """Make phase and scale that most of the fits found those of the film, and their scales relative to it."""
    phases = [float(fit.parameters[Parameter.PHASE]) for fit in fits.values()]
    if phases and _turn(float(np.median(phases)), result.view.optics.phase) > _STATED_PHASE:
        result.view = replace(result.view, optics=replace(result.view.optics, phase=float(np.median(phases))))
    scales = np.array([float(fit.parameters[Parameter.SCALE]) for fit in fits.values()])
    if not len(scales) or np.median(np.abs(scales)) <= _SAME_SCALE:
        return
    usual = float(np.median(scales))
    if np.mean(np.abs(scales - usual) < _SAME_SCALE) < 0.5:
        return
    optics = result.view.optics
    result.view = replace(result.view, optics=replace(optics, phase_scale=optics.phase_scale * math.exp(usual)))
    for index, fit in fits.items():
        parameters = fit.parameters.copy()
        parameters[Parameter.SCALE] -= usual
        fits[index] = replace(fit, parameters=parameters)


def find_optics(looks: Looks, view: View, *, is_phase_free: bool) -> RingFit | None:
    """Fit the contact of a frame with the scale of its fringes, and the phase where it is free, other than stated.

    None when no fringes explain the frame.
    """
    for spot in islice(_places(looks), _PLACES):
        for guess in guesses(looks.frame, view, spot.x, spot.y, spot.radius):
            found = _fit_guess(looks.frame, view, guess, (spot.x, spot.y), is_phase_free=is_phase_free)
            if found is not None:
                return found
    return None


def _places(looks: Looks) -> Iterator[Spot]:
    """Yield circles about which there may be rings; centres of rings are looked for last."""
    yield from looks.spots
    yield from looks.centres


def _fit_guess(
    frame: NDArray[np.generic], view: View, guess: Guess, centre: tuple[float, float], *, is_phase_free: bool
) -> RingFit | None:
    """Fit from a guess with phase and scale free, from the first fringes outwards."""
    start = np.zeros(PARAMETERS)
    start[[Parameter.X, Parameter.Y]] = centre
    start = guess.start(start)
    if not is_phase_free:
        # The stated phase may be that of the dark or of the bright contact.
        start[Parameter.PHASE] = view.optics.phase
        start[Parameter.MODULATION] *= math.copysign(1.0, math.cos(guess.phase - view.optics.phase))
    seen = replace(view, optics=replace(view.optics, phase_scale=view.optics.phase_scale * math.exp(guess.log_scale)))
    extra: tuple[Parameter, ...] = (Parameter.PHASE,) if is_phase_free else ()
    plain = tuple(p for p in view.settings.free if p is not Parameter.SMEAR)
    trials = ((_NEAR, (*plain, *extra)), (_FAR, (*view.settings.free, *extra, Parameter.SCALE)))
    fit: RingFit | None = None
    for fringes, free in trials:
        settings = FitSettings(
            fringes,
            view.settings.least_spacing,
            free,
            max_pixels=_PIXELS,
            max_iterations=_ITERATIONS,
            tells_memory=fringes == _FAR,
        )
        fit = fit_contact(frame, start, seen.optics, settings, view.levels)
        if fit is None or fit.misfit > _UNEXPLAINED:
            return None
        start = fit.parameters
    if fit is None or fit.misfit > GOOD_MISFIT:
        return None
    seen = replace(seen, optics=replace(seen.optics, phase=float(fit.parameters[Parameter.PHASE])))
    if not is_contact(frame, seen, fit):
        return None
    parameters = fit.parameters.copy()
    parameters[Parameter.SCALE] += guess.log_scale
    return replace(fit, parameters=parameters)

"""Fit frame after frame, each from what the frames before it showed, and again with other optics."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.imaging.films import FilmReader
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT, SMALL_CONTACT, is_contact, visibility_of
from labpipe.imaging.fringes._blank_frames import FilmResult, look_without_fringes
from labpipe.imaging.fringes._interference import Optics
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._optics_search import OtherOptics
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import HARMONICS, Parameter
from labpipe.imaging.fringes._search import NO_WORSE, Vain, fit_like, search_contact
from labpipe.imaging.fringes._trial_fits import fit_edge
from labpipe.imaging.fringes._view import View

#: Jump of the radius (px) up to which a fit is started from the frame before.
_SMALL_JUMP = 2.0
#: The optics as they are stated are doubted when of so many first contacts of a film so many are not explained.
_DOUBTS, _DOUBTED = 3, 2

#: Share of the usual visibility of the fringes below which those of a small contact are none, and the fewest frames
#: that tell what is usual.
_FAINT, _SEVERAL = 0.3, 5


def is_doubted(result: FilmResult, fits: dict[int, RingFit], stated: Optics) -> bool:
    """Tell whether the first contacts of a film are not explained by the optics as they are stated."""
    first = [fits[index] for index in sorted(fits)[:_DOUBTS]]
    usual = result.view.settings.free
    unexplained = sum(fit.model_deviation > 0.0 or fit.free != usual for fit in first)
    return len(first) == _DOUBTS and (unexplained >= _DOUBTED or result.view.optics != stated)


def follow(
    reader: FilmReader,
    result: FilmResult,
    read: Flags,
    known: dict[int, RingFit],
    other: OtherOptics | None,
    stated: Optics | None = None,
) -> dict[int, RingFit]:
    """Fit frame after frame, each from what the frames before it showed.

    While none is explained, ``other`` looks for optics that explain them, and all is begun anew
    when it finds some; None keeps those there are. With optics as they are ``stated`` it ends early when these are
    doubted. Of the frames to be read, those that are known are not fitted again, and those without a contact are
    added to the blanks of the result; fits are returned by frame.
    """
    view = result.view
    fits: dict[int, RingFit] = {}
    last: RingFit | None = None
    vain = Vain()
    for index in map(int, np.flatnonzero(read)):
        fit = known.get(index)
        if fit is None:
            looks = Looks(reader.whole(index))
            fit = _next_fit(looks, view, last, _expected(fits, known, index), vain)
        if fit is None:
            if last is None and not known and other is not None and other.learns_from(looks, index):
                return follow(reader, result, read, {}, None, stated)
            result.blanks[index] = look_without_fringes(looks, view)
        else:
            result.blanks.pop(index, None)  # of an earlier round with other optics
            fits[index] = last = fit
            if stated is not None and len(fits) == _DOUBTS and is_doubted(result, fits, stated):
                return fits
    if not fits and other is not None and other.takes_single():
        return follow(reader, result, read, {}, None)
    return fits


def leave_faint(reader: FilmReader, result: FilmResult) -> None:
    """Take for a sphere close by what was fitted as a small contact with far fainter fringes than all others.

    Light and surfaces are those of the film: fringes of a contact are as dark in all its frames.
    """
    shown = {index: visibility_of(fit, result.view) for index, fit in result.fits.items()}
    usual = float(np.median(list(shown.values()))) if len(shown) >= _SEVERAL else 0.0
    for index in [index for index, visibility in shown.items() if visibility < _FAINT * usual]:
        if result.fits[index].parameters[Parameter.RADIUS] < SMALL_CONTACT * result.view.newton_spot:
            del result.fits[index]
            result.blanks[index] = look_without_fringes(Looks(reader.whole(index)), result.view)


def _expected(fits: dict[int, RingFit], known: dict[int, RingFit], index: int) -> Floats | None:
    """Parameters that a frame may have by the two before it or by that before it and the next one known, else None."""
    last = fits.get(index - 1)
    if last is None:
        return None
    following = min((other for other in known if other > index), default=None)
    if following is None:
        return last.parameters if index - 2 in fits else None
    expected = last.parameters.copy()
    moved = [Parameter.RADIUS, Parameter.X, Parameter.Y]
    expected[moved] += (known[following].parameters[moved] - expected[moved]) / (following - index + 1)
    return expected


def _next_fit(looks: Looks, view: View, last: RingFit | None, expected: Floats | None, vain: Vain) -> RingFit | None:
    """Fit a frame from what is expected if it is like that, from the centre of the last contact, or from nothing."""
    if last is None:
        return search_contact(looks, view, None, vain)
    if expected is not None:
        fit = _warm_fit(looks.frame, view, last, expected)
        if fit is not None:
            return fit
    centre = (float(last.parameters[Parameter.X]), float(last.parameters[Parameter.Y]))
    # What served the last contact serves this film: what it cannot fit is something else.
    served = view.served_by(last.free)
    fit = fit_like(looks, view, last) if served.alternatives else None
    return search_contact(looks, served, centre, vain) if fit is None else fit


def _warm_fit(frame: NDArray[np.generic], view: View, last: RingFit, expected: Floats) -> RingFit | None:
    """Fit from expected parameters with what was free in the last contact; None when the radius is another one."""
    settings = replace(view.settings, free=last.free, max_iterations=8)
    fit = fit_contact(frame, expected, view.optics, settings, view.levels)
    if fit is None or not fit.is_converged:
        return None
    jump = abs(float(fit.parameters[Parameter.RADIUS] - expected[Parameter.RADIUS]))
    is_like = jump < _SMALL_JUMP and fit.misfit <= max(GOOD_MISFIT, NO_WORSE * last.misfit)
    return fit if is_like and is_contact(frame, view, fit) else None


def refit(
    reader: FilmReader, result: FilmResult, read: Flags, fits: dict[int, RingFit], *, stays_blank: bool
) -> dict[int, RingFit]:
    """Fit frames again, from the fits before by frame, with the optics calibrated from the film.

    Those in which nothing was found before are left out where that ``stays_blank``; blanks of the result are replaced.
    """
    view = result.view
    calibrated = zip(result.calibration.frames, result.calibration.fits, strict=False)
    # one that the optics do not explain well is another contact, as of an open gap
    made = {frame: fit for frame, fit in calibrated if fit.misfit <= GOOD_MISFIT and fit.is_converged}
    known = result.blanks.copy() if stays_blank else {}
    result.blanks.clear()
    found: dict[int, RingFit] = {}
    last: RingFit | None = None
    vain, plain = Vain(), replace(view, alternatives=())
    for index in map(int, np.flatnonzero(read)):
        if index in known:
            # rings that were taken for a soft edge may be rings that are blurred
            edges = known[index].edges if view.optics.blur else ()
            fit = next(filter(None, (fit_edge(reader.whole(index), plain, edge) for edge in edges)), None)
            if fit is None:
                result.blanks[index] = known[index]
            else:
                found[index] = last = fit
            continue
        looks = Looks(reader.whole(index))
        fit = made.get(index)
        if fit is None and index in fits:
            start = fits[index].parameters.copy()
            start[Parameter.PHASE], start[Parameter.SCALE] = view.optics.phase, 0.0
            start[[Parameter.BLUR, Parameter.SPREAD, Parameter.FOCUS]] = 0.0
            start[list(HARMONICS)] = view.harmonics
            if Parameter.STRETCH not in view.settings.free:
                start[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
            fit = fit_contact(looks.frame, start, view.optics, view.settings, view.levels)
        if fit is not None and not (_explains(fit, fits[index]) and is_contact(looks.frame, view, fit)):
            fit = None
        fit = fit or _next_fit(looks, view, last, None, vain)
        if fit is None:
            result.blanks[index] = look_without_fringes(looks, view)
        else:
            found[index] = last = fit
    return found


def _explains(fit: RingFit, before: RingFit) -> bool:
    """Tell whether a fit leaves little, or no more than one before it, so that no search would leave less."""
    return fit.misfit <= max(GOOD_MISFIT, before.misfit)

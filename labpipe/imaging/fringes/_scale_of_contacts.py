"""The scale of the fringes in each contact of a film by itself: whether the lens was changed between them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.films import FilmReader
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._open_gap import has_free_gap
from labpipe.imaging.fringes._optics_search import find_optics
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._view import View

#: Contacts that are looked at, those with the largest radius first, how many frames of one, and how many are searched.
_CONTACTS, _FRAMES, _SEARCHED = 4, 2, 5
#: Times the squares that the found phase leaves, which the stated one may leave: form and light miss as much.
_AS_WELL = 1.02
#: Differences of the logarithm of the scale below which frames agree that were searched for it, its
#: standard deviation from which a frame does not tell it unless searched, and how many must agree.
_SAME, _ROUGH, _AGREE = 0.05, 0.01, 2


def scales_of_contacts(reader: FilmReader, result: FilmResult, stated: View) -> dict[int, tuple[float, float]]:
    """Fit the largest frames of each contact again with the scale of the fringes free, before it opens.

    Beside a contact that opens, a body still recovers from its dent, and the gap is wider than Hertz's.
    A pixel that is stated wrongly makes a film find another phase of the light, which would hold the
    scale where it is stated: the stated phase is kept where it explains the frames as well with a scale
    of their own, and both are free where it does not. Where the stated R or wavelength is so wrong that no
    fit leads to the scale, or only the edge of the spot was found, it is searched for, and told where such
    frames agree.

    It is searched for from the view as ``stated``: what was found in a film of such frames is no better. Told are, by
    frame, the natural logarithm of the phase scale over that of the film, and its standard uncertainty.
    """
    sizes = {i: edge.half_radius for i, edge in result.edges.items()}
    sizes |= {i: float(fit.parameters[Parameter.RADIUS]) for i, fit in result.fits.items()}
    frames = np.array(sorted(sizes), int)
    if not frames.size:
        return {}
    radius = np.array([sizes[i] for i in frames.tolist()])
    seen = np.zeros(len(result.resting) + 1, bool)
    seen[[*result.fits, *result.edges, *result.filled]] = True
    seen[:-1] |= result.resting
    # frames without a contact between them part two contacts
    contact = np.cumsum(~seen)[frames]
    tops = {number: np.flatnonzero(contact == number) for number in np.unique(contact)}
    largest = sorted(tops.values(), key=lambda places: -radius[places].max())[:_CONTACTS]
    chosen, wide = (
        [i for places in largest for i in _growing(frames[places], radius[places], count)]
        for count in (_FRAMES, _SEARCHED)
    )
    fitted = [i for i in chosen if i in result.fits]
    closed = [i for i in fitted if not has_free_gap(result.fits[i])]
    phase, shift = result.view.optics.phase, result.calibration.phase_shift
    fits = _fitted(reader, result, closed, phase, (Parameter.SCALE,))
    if shift:
        usual = _fitted(reader, result, closed, phase - shift, (Parameter.SCALE,))
        explains = _squares(usual) <= _AS_WELL * _squares(fits)
        fits = usual if explains else _fitted(reader, result, closed, phase, (Parameter.SCALE, Parameter.PHASE))
    fits |= {i: result.fits[i] for i in fitted if i not in closed}
    fits = {i: fit for i, fit in fits.items() if fit.is_converged}
    scales = {i: (float(fit.parameters[Parameter.SCALE]), fit.deviation(Parameter.SCALE)) for i, fit in fits.items()}
    told = {i for i, (_, u) in scales.items() if u < _ROUGH}
    untold = [] if told.issuperset(chosen) else [i for i in wide if i not in told]
    return scales | _searched(reader, untold, stated, result.log_scale)


def _searched(reader: FilmReader, frames: list[int], stated: View, known: float) -> dict[int, tuple[float, float]]:
    """Search frames for the scale of their fringes over that which is `known`; what two or more of them agree on."""
    fits: dict[int, RingFit] = {}
    for place, i in enumerate(frames):
        if len(fits) + len(frames) - place < _AGREE:
            return {}
        fit = find_optics(Looks(reader.whole(i)), stated, is_phase_free=True)
        if fit is not None:
            fits[i] = fit
    scales = {i: float(fit.parameters[Parameter.SCALE]) - known for i, fit in fits.items()}
    if not fits or np.ptp(list(scales.values())) > _SAME:
        return {}
    return {i: (scales[i], fit.deviation(Parameter.SCALE)) for i, fit in fits.items()}


def _growing(frames: NDArray[np.int64], radius: Floats, count: int) -> list[int]:
    """Return so many of the largest frames of a contact while it grows."""
    grows = int(np.argmax(radius)) + 1
    return [int(i) for i in frames[:grows][np.argsort(-radius[:grows])[:count]]]


def _fitted(
    reader: FilmReader, result: FilmResult, frames: list[int], phase: float, free: tuple[Parameter, ...]
) -> dict[int, RingFit]:
    """Fit frames again from a phase of the light, more of the parameters being free."""
    view = result.view
    settings = replace(view.settings, free=(*dict.fromkeys((*view.settings.free, *free)),))
    found: dict[int, RingFit] = {}
    for i in frames:
        start = result.fits[i].parameters.copy()
        start[Parameter.PHASE] = phase
        fit = fit_contact(reader.whole(i), start, replace(view.optics, phase=phase), settings, view.levels)
        if fit is not None:
            found[i] = fit
    return found


def _squares(fits: dict[int, RingFit]) -> float:
    """Return the mean square of what fits leave, over all pixels."""
    return sum(fit.pixels * fit.residual**2 for fit in fits.values()) / max(sum(fit.pixels for fit in fits.values()), 1)

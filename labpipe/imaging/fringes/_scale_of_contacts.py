"""The scale of the fringes in each contact of a film by itself: whether the lens was changed between them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.films import FilmReader
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._open_gap import has_free_gap
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import Parameter

#: Contacts that are looked at, those with the largest radius first, and how many frames of one.
_CONTACTS, _FRAMES = 4, 2
#: Times the squares that the found phase leaves, which the stated one may leave: form and light miss as much.
_AS_WELL = 1.02


def scales_of_contacts(reader: FilmReader, result: FilmResult) -> dict[int, tuple[float, float]]:
    """Fit the largest frames of each contact again with the scale of the fringes free, before it opens.

    Beside a contact that opens, a body still recovers from its dent, and the gap is wider than Hertz's.
    A pixel that is stated wrongly makes a film find another phase of the light, which would hold the
    scale where it is stated: the stated phase is kept where it explains the frames as well with a scale
    of their own, and both are free where it does not.

    Parameters
    ----------
    reader : FilmReader
        The film.
    result : FilmResult
        With its fits.

    Returns
    -------
    dict
        By frame the natural logarithm of the phase scale over that of the film, and its standard
        uncertainty.
    """
    frames = np.array(sorted(result.fits), int)
    if not frames.size:
        return {}
    radius = np.array([float(result.fits[i].parameters[Parameter.RADIUS]) for i in frames])
    seen = np.zeros(len(result.resting) + 1, bool)
    seen[[*result.fits, *result.edges, *result.filled]] = True
    seen[:-1] |= result.resting
    # frames without a contact between them part two contacts
    contact = np.cumsum(~seen)[frames]
    tops = {number: np.flatnonzero(contact == number) for number in np.unique(contact)}
    largest = sorted(tops.values(), key=lambda places: -radius[places].max())[:_CONTACTS]
    chosen = [i for places in largest for i in _growing(frames[places], radius[places])]
    closed = [i for i in chosen if not has_free_gap(result.fits[i])]
    phase, shift = result.view.optics.phase, result.calibration.phase_shift
    fits = _fitted(reader, result, closed, phase, (Parameter.SCALE,))
    if shift:
        stated = _fitted(reader, result, closed, phase - shift, (Parameter.SCALE,))
        explains = _squares(stated) <= _AS_WELL * _squares(fits)
        fits = stated if explains else _fitted(reader, result, closed, phase, (Parameter.SCALE, Parameter.PHASE))
    fits |= {i: result.fits[i] for i in chosen if i not in closed}
    return {
        i: (float(fit.parameters[Parameter.SCALE]), fit.deviation(Parameter.SCALE))
        for i, fit in sorted(fits.items())
        if fit.is_converged
    }


def _growing(frames: NDArray[np.int64], radius: Floats) -> list[int]:
    """Return the largest frames of a contact while it grows."""
    grows = int(np.argmax(radius)) + 1
    return [int(i) for i in frames[:grows][np.argsort(-radius[:grows])[:_FRAMES]]]


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

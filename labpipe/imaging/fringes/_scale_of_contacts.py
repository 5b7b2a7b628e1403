"""The scale of the fringes in each contact of a film by itself: whether the lens was changed between them."""

from dataclasses import replace

import numpy as np

from labpipe.imaging.films import FilmReader
from labpipe.imaging.fringes._blank_frames import FilmResult
from labpipe.imaging.fringes._open_gap import has_free_gap
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import Parameter

#: Contacts that are looked at, those with the largest radius first, and how many frames of one.
_CONTACTS, _FRAMES = 4, 2


def scales_of_contacts(reader: FilmReader, result: FilmResult) -> dict[int, tuple[float, float]]:
    """Fit the largest frames of each contact again with the scale of the fringes free, before it opens.

    Beside a contact that opens, a body still recovers from its dent, and the gap is wider than Hertz's.

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
    view = result.view
    settings = replace(view.settings, free=(*dict.fromkeys((*view.settings.free, Parameter.SCALE)),))
    found: dict[int, tuple[float, float]] = {}
    for places in largest:
        grows = places[: int(np.argmax(radius[places])) + 1]
        for index in frames[grows[np.argsort(-radius[grows])[:_FRAMES]]].tolist():
            fit: RingFit | None = result.fits[index]
            if not has_free_gap(result.fits[index]):
                start = result.fits[index].parameters
                fit = fit_contact(reader.whole(index), start, view.optics, settings, view.white)
            if fit is not None and fit.is_converged:
                found[index] = float(fit.parameters[Parameter.SCALE]), fit.deviation(Parameter.SCALE)
    return found

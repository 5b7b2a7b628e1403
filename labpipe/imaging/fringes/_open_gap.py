"""Contacts with a gap that is not Hertz's: on a surface that still recovers from its dent.

Beside any contact that does not stick the gap opens like (r - a)^(3/2); only the factor depends on the history of the
body. Its radius follows from the first fringes with that factor free; higher powers of r - a show in the difference
between fits of fewer and of more fringes.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import Parameter, RingFit, fit_contact
from labpipe.imaging.fringes._ring_model import edge_width
from labpipe.imaging.fringes._search import is_contact

#: Fringes of Hertz's gap over which the power law is taken to hold; its error shows over one more.
_NEAR_FRINGES = 2.0
#: Factors of the gap that are tried, and between which it must come out.
_FACTORS, _LEAST_FACTOR, _MOST_FACTOR = (1.0, 0.7, 0.45), 0.3, 1.1


def has_free_gap(fit: RingFit) -> bool:
    """Tell whether the factor of the gap was fitted in this frame."""
    return Parameter.SCALE in fit.free


def is_doubtful(fit: RingFit) -> bool:
    """Tell whether the gap in a frame seems not to be Hertz's, beyond chance."""
    return (fit.misfit > 0.02 and fit.is_doubtful) or has_free_gap(fit)


def fit_open_gap(
    frame: NDArray[np.generic], view: View, starts: Sequence[Floats], old: RingFit | None
) -> RingFit | None:
    """Fit a contact with the factor of its gap free, from several starts; ``old`` is the fit of Hertz's gap.

    The difference between few and many fringes is part of its model deviation. None when it leaves more than half of
    the squared misfit of Hertz's gap, or does not explain the frame.
    """
    free = tuple(dict.fromkeys((*view.settings.free, Parameter.SCALE)))
    near = replace(view.settings, fringes=_NEAR_FRINGES, free=free)
    best: RingFit | None = None  # of some of the pixels, from every start, what leaves least
    for start in starts:
        width = edge_width(float(start[Parameter.RADIUS]), view.optics)
        for factor, below in itertools.product(_FACTORS, (0.0, 0.5)):
            trial = start.copy()
            trial[Parameter.RADIUS] = max(trial[Parameter.RADIUS] - below * width, 1.0)
            trial[Parameter.SCALE] = math.log(factor)
            trial[Parameter.SMEAR] = min(trial[Parameter.SMEAR], (0.3 * width) ** 2)
            fit = fit_contact(frame, trial, view.optics, near.quick, view.white)
            if fit is not None and _is_right(fit) and (best is None or fit.misfit < best.misfit):
                best = fit
    if best is None:
        return None
    found = fit_contact(frame, best.parameters, view.optics, near, view.white)
    if found is None or not _is_right(found) or not is_contact(frame, view, found):
        return None
    if old is not None and not has_free_gap(old) and found.misfit**2 > 0.5 * old.misfit**2:
        return None
    other = fit_contact(frame, found.parameters, view.optics, replace(near, fringes=_NEAR_FRINGES + 1.0), view.white)
    spread = found.deviation(Parameter.RADIUS)
    if other is not None:
        spread = max(spread, abs(other.radius - found.radius))
    return replace(found, model_deviation=math.hypot(found.model_deviation, spread))


def _is_right(fit: RingFit) -> bool:
    """Tell whether a fit explains the frame by a factor that a contact can have, and that is not Hertz's."""
    factor = math.exp(fit.value(Parameter.SCALE))
    is_other = abs(factor - 1.0) > 0.02
    return is_other and _LEAST_FACTOR < factor < _MOST_FACTOR and fit.misfit <= 0.03

"""Tell light of so many colours that its fringes are gone after the first few, so that one wavelength fits none."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.fringes._acceptance import profile_of
from labpipe.imaging.fringes._interference import scaled_gap
from labpipe.imaging.fringes._radial_scan import faded
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._view import View

#: Relative standard deviations of the wavenumbers that are tried, and the least at which fringes fade too early.
_BANDS, _WIDE = (0.0, 0.03, 0.06, 0.09, 0.12, 0.15, 0.18, 0.22, 0.26, 0.3), 0.15
#: Misfit below which a fit is not doubted, and the squares that fading fringes leave at most over those of the fit:
#: 0.2 to 0.8 in white light, 2 and more where such a band came out in other light.
_NOTABLE, _LEAVES = 0.01, 0.9


def fades_early(frame: NDArray[np.generic], view: View, fit: RingFit) -> bool:
    """Tell whether fringes that fade as in white light explain what is around a fit better than its own do.

    It is fitted in light of one colour: a motion stands in for what fades.
    """
    if fit.misfit < _NOTABLE:
        return False
    window, terms, _ = profile_of(frame, view, fit)
    own = window.left_by_all(terms[[0, 2, 3]])
    still = fit.parameters.copy()
    still[[Parameter.SMEAR, Parameter.BLUR]] = 0.0
    window, terms, distance = profile_of(frame, view, replace(fit, parameters=still))
    scale = view.optics.phase_scale * math.exp(float(still[Parameter.SCALE]))
    phase = scale * scaled_gap(distance, float(still[Parameter.RADIUS]), view.optics.flat)
    left = [window.left_by_all(faded(phase, (0.0, band)) * terms[[0, 2, 3]]) for band in _BANDS]
    likeliest = int(np.argmin(left))
    return left[likeliest] < _LEAVES * own and _BANDS[likeliest] >= _WIDE

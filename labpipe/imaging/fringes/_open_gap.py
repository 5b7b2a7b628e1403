"""Fit contacts with a non-Hertzian gap: on a surface that still recovers from its dent.

Beside any contact that does not stick the gap opens like (r - a)^(3/2); only the factor depends on
the history of the body. A contact that recedes faster than the surface recovers, or that comes back
before it has, opens more slowly than Hertz's. Its radius follows from the first fringes with that
factor free. What higher powers of r - a would change shows in the difference between fits of fewer
and of more fringes.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._acceptance import is_clear, is_contact
from labpipe.imaging.fringes._radial_scan import edge_width
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._view import View

#: Fringes of Hertz's gap over which the power law is taken to hold, and over which its error shows.
_NEAR_FRINGES, _FAR_FRINGES = 2.0, 3.0
#: Factors of the gap that are tried, and between which it must come out: an iteration that is held at
#: the least factor it may take, 1/e, has found none.
_FACTORS, _LEAST_FACTOR, _MOST_FACTOR = (1.0, 0.7, 0.45), 0.38, 1.1
#: Logarithm of the factor from which the gap counts as other than Hertz's.
_NOTABLE = 0.02
#: Radii that are tried: below a start by these shares of the width of the first bright ring.
_BELOW = (0.0, 0.5)
#: Pixels and evaluations of a trial.
_PIXELS, _ITERATIONS = 12_000, 12
#: Share of the squared misfit that a factor of the gap explains to first order, below which none is sought:
#: it was 0.96 and more where the gap was not Hertz's, 0.00 beside astigmatism, coma and stray light.
_HINT = 0.1
#: Misfit from which a fit of Hertz's gap is doubted, greatest one of a fit of another gap, and the
#: share of the squared misfit before that it must stay below.
DOUBTFUL_MISFIT, _MOST_MISFIT, _SHARE = 0.02, 0.03, 0.5


def has_free_gap(fit: RingFit) -> bool:
    """Tell whether the factor of the gap was fitted in this frame."""
    return Parameter.SCALE in fit.free


def is_doubtful(fit: RingFit) -> bool:
    """Tell whether the gap in a frame seems not to be Hertz's, beyond chance, and another factor would help."""
    is_worse = fit.misfit > DOUBTFUL_MISFIT and fit.worst_deviation > 0.0
    return (is_worse and explained_by_gap(fit) > _HINT) or has_free_gap(fit)


def explained_by_gap(fit: RingFit) -> float:
    """Return the share of the squared misfit that a factor of the gap would explain, to first order."""
    beyond = (fit.residual**2 - fit.noise**2) * fit.pixels
    return fit.expected_gain((Parameter.SCALE,)) * fit.noise**2 / max(beyond, 1e-12)


def fit_open_gap(
    frame: NDArray[np.generic], view: View, starts: Sequence[Floats], old: RingFit | None
) -> RingFit | None:
    """Fit a contact with the factor of its gap free, from where it may be, ``old`` being the fit of Hertz's gap.

    The difference between few and many fringes is its ``spread``; None when it explains the frame hardly better than
    Hertz's gap, or not well.
    """
    free = tuple(dict.fromkeys((*view.settings.free, Parameter.SCALE)))
    near = replace(view.settings, fringes=_NEAR_FRINGES, free=free)
    best = _best_trial(frame, view, starts, near)
    if best is None:
        return None
    found = fit_contact(frame, best.parameters, view.optics, near, view.levels)
    if found is None or not _is_right(found) or not is_contact(frame, view, found):
        return None
    is_old_good = old is not None and not has_free_gap(old)
    if is_old_good and old is not None and found.misfit**2 > _SHARE * old.misfit**2:
        return None
    far = replace(near, fringes=_FAR_FRINGES)
    other = fit_contact(frame, found.parameters, view.optics, far, view.levels)
    spread = found.deviation(Parameter.RADIUS)
    if other is not None:
        change = other.parameters[Parameter.RADIUS] - found.parameters[Parameter.RADIUS]
        spread = max(spread, abs(float(change)))
    return replace(found, spread=spread)


def _best_trial(frame: NDArray[np.generic], view: View, starts: Sequence[Floats], near: FitSettings) -> RingFit | None:
    """Fit some of the pixels from every start, and keep what leaves least."""
    quick = replace(near, max_pixels=_PIXELS, max_iterations=_ITERATIONS)
    best: RingFit | None = None
    for start in starts:
        width = edge_width(float(start[Parameter.RADIUS]), view.optics)
        for factor in _FACTORS:
            for below in _BELOW:
                trial = start.copy()
                trial[Parameter.RADIUS] = max(trial[Parameter.RADIUS] - below * width, 1.0)
                trial[Parameter.SCALE] = math.log(factor)
                trial[Parameter.SMEAR] = min(trial[Parameter.SMEAR], (0.3 * width) ** 2)
                fit = fit_contact(frame, trial, view.optics, quick, view.levels)
                # Without light to modulate, as inside the contact, anything fits.
                if fit is None or not _is_right(fit) or not is_clear(view, fit):
                    continue
                if best is None or fit.misfit < best.misfit:
                    best = fit
    return best


def _is_right(fit: RingFit) -> bool:
    """Tell whether a fit explains the frame by a factor that a contact can have."""
    log_factor = float(fit.parameters[Parameter.SCALE])
    is_other = abs(log_factor) > _NOTABLE
    is_possible = _LEAST_FACTOR < math.exp(log_factor) < _MOST_FACTOR
    return is_other and is_possible and fit.misfit <= _MOST_MISFIT

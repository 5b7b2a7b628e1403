"""The scale of the image by the fringes themselves: sphere and wavelength are a ruler as well."""

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from pipelines.experiments.contact_area.measured import EDGE, FRINGE_FIT, OPEN_GAP

_OPENED = 0.02  # relative, by which a gap that is fitted as wider may change the scale of its fringes
_EVEN, _ENOUGH = 2.0, 4
"""Standard deviations of the factor of such gaps, over at least so many frames, by which it may at most: what is
worn or blurred alters small contacts otherwise than large ones, a wrong length all of them alike."""
_FORM = 0.7
"""A whole sphere enlarges the scale of the first three fringes by this times (a/R)² against the
paraboloid that is fitted, both by the method of dimensionality reduction: 0.75 to 0.70 for a/R of 0.045
to 0.115. A body that is worn or ground lies between the two."""
_LIGHT = 1e-3
"""Relative, what the cone of the light and the lens make of the fringes' scale: (1 + cos)/2 at 3°."""


class FringeScale(NamedTuple):
    """What fringes say of 1/(λ R) over what is stated of it, in lengths of the stated pixel.

    ``ratio`` is found over stated, ``u`` without what is stated of pixel, sphere and wavelength; ``n`` frames are
    behind it.
    """

    ratio: float
    u: float
    n: int


def fringe_scale(
    radius: xr.Dataset, impacts: xr.Dataset, sphere_radius: float, *, open_too: bool = False
) -> FringeScale | None:
    """Take it from the growing first contact; None where no fringes tell it.

    While the first contact of a body grows, its gap is Hertz's, whatever the body remembers; beside
    later ones it still recovers from its dent (Ting, https://doi.org/10.1115/1.3625192). Where no gap
    is Hertz's, as with a wrong wavelength, `open_too` takes those that were fitted as wider.
    """
    if "own_scale" not in radius or not impacts.sizes["impact"]:
        return None
    own, u, time = (radius[name].values for name in ("own_scale", "u_own_scale", "time"))
    is_first = (time >= float(impacts["first_seen"][0])) & (time <= float(impacts["last_seen"][0]))
    is_growing = is_first & (time <= float(impacts["peak_time"][0]))
    known, method = is_first & np.isfinite(own) & np.isfinite(u), radius["method"].values
    # beside an edge the scale was searched for, and told where frames agree
    by_search = known & (method == EDGE)
    told = np.flatnonzero(known & (method == FRINGE_FIT) | by_search)
    is_open = open_too and not told.size
    told = np.flatnonzero(known & (method == OPEN_GAP)) if is_open else told
    edges = np.count_nonzero(is_first & (method == EDGE))
    if not told.size or (edges >= np.count_nonzero(is_first & (method != EDGE)) and not by_search.any()):
        return None  # nor where most frames show none: the others may be wrong as well
    form = _FORM * float(np.mean(radius["radius"].values[told]) / sphere_radius) ** 2
    ratio = float(radius.attrs["phase_scale_ratio"]) * float(np.mean(own[told])) / (1.0 + 0.5 * form)
    scatter = float(np.std(own[told])) / sqrt(max(told.size - 1, 1))
    random = max(float(np.sqrt(np.sum(u[told] ** 2))) / told.size, scatter)
    opened = _opened(radius["gap_factor"].values[is_growing & (method == OPEN_GAP)]) if is_open else 0.0
    return FringeScale(ratio, ratio * hypot(random, form / sqrt(12.0), _LIGHT, opened), int(told.size))


def _opened(factor: Floats) -> float:
    """Return the relative uncertainty of the scale by gaps of so many times Hertz's in one growing contact."""
    return _OPENED if factor.size < _ENOUGH else min(_OPENED, _EVEN * float(np.std(factor)))

"""Decide whether a fit shows a contact: rings beyond doubt, no soft edge and no sphere that only touches."""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._interference import SAMPLES_PER_PIXEL, ring_limits, scaled_gap
from labpipe.imaging.fringes._radial_scan import Window, edge_width, faded, is_edge, left_by_sphere, radial_profile
from labpipe.imaging.fringes._ring_fit import RingFit
from labpipe.imaging.fringes._ring_parameters import HARMONICS, VISIBILITY, Parameter
from labpipe.imaging.fringes._ring_sums import NONE_FREE, tabulate
from labpipe.imaging.fringes._view import View

#: Misfit from which another explanation is looked for.
GOOD_MISFIT = 0.04
#: Greatest travel in the exposure as a share of the radius: at 2 there is no contact at first.
_MOST_TRAVEL = 1.5
#: Travel in the exposure, in widths of the first bright ring, from which fringes may be mistaken
#: for a soft edge.
_LONG_TRAVEL = 0.5
#: Blur, in widths of the first bright ring, from which the same holds.
_STRONG_BLUR = 0.25
#: A plain edge is believed against a fit when it leaves less than this multiple of the squares that
#: the fit leaves.
_FRINGES_SURE = 2.0
#: Least visibility, and least modulation in units of its uncertainty.
_LEAST_VISIBILITY, _LEAST_SIGNIFICANCE = 0.02, 10.0
#: Light is never negative, so that fringes have a visibility of one at most; clipped light and
#: cameras that are not linear were seen to fit with a fifth more.
_MOST_VISIBILITY = 1.5
#: Contacts smaller than this many Newton spots are compared with a sphere that does not press.
SMALL_CONTACT = 4.0
#: Multiple of the squares that a contact leaves which a sphere must leave, and light that loses contrast outwards in
#: which both are seen: twice the share by which the phase of a cone's rays falls behind in the mean, and the relative
#: standard deviation of the wavenumbers.
_CONTACT_SURE = 2.0
_SPREADS = ((0.0, 0.0), (0.03, 0.0), (0.045, 0.0), (0.03, 0.025))
#: Least number of rings in which a fit is compared with edges and spheres.
_LEAST_RINGS = 24
#: Greatest uncertainty of a radius as a share of it.
_MOST_UNCERTAINTY = 0.1
#: Pixels of a ring that must lie in the frame, at least.
LEAST_PIXELS = 200


def visibility_of(fit: RingFit, view: View) -> float:
    """Return the visibility of the fringes of a fit."""
    light = float(fit.parameters[Parameter.GAIN]) - view.black
    return abs(float(fit.parameters[Parameter.MODULATION])) / light


def is_clear(view: View, found: RingFit, *, by_some: bool = False) -> bool:
    """Tell whether a fit shows rings beyond doubt, around a circle that can be a contact.

    By some of the pixels it need not do so whatever the course of the visibility over the place: all will tell.
    """
    radius = float(found.parameters[Parameter.RADIUS])
    modulation = abs(float(found.parameters[Parameter.MODULATION]))
    light = float(found.parameters[Parameter.GAIN]) - view.black
    return (
        found.pixels >= LEAST_PIXELS
        and found.misfit <= view.most_misfit
        and light > 0.0
        and _LEAST_VISIBILITY * light <= modulation <= _MOST_VISIBILITY * light
        and modulation >= _LEAST_SIGNIFICANCE * found.deviation(Parameter.MODULATION, VISIBILITY if by_some else ())
        and radius > view.least_radius
        and found.leverage > 0.0
        and found.deviation(Parameter.RADIUS) < _MOST_UNCERTAINTY * radius
    )


def is_contact(frame: NDArray[np.generic], view: View, found: RingFit, *, by_some: bool = False) -> bool:
    """Decide whether a fit, of all pixels or of some, shows a contact, and not a sphere close by or something else."""
    if not is_clear(view, found, by_some=by_some):
        return False
    radius = float(found.parameters[Parameter.RADIUS])
    travel = math.sqrt(max(float(found.parameters[Parameter.SMEAR]), 0.0))
    if travel > _MOST_TRAVEL * radius:
        return False
    may_be_edge = _may_be_edge(view, found)
    is_small = radius < SMALL_CONTACT * view.newton_spot
    if not may_be_edge and not is_small:
        return True
    window, terms, distance = profile_of(frame, view, found)
    if not window.is_seen:
        return not may_be_edge
    if may_be_edge and is_edge(window, terms[0], _FRINGES_SURE):
        return False
    return not (is_small and _is_sphere(window, terms, distance, view, found))


def _is_sphere(window: Window, terms: Floats, distance: Floats, view: View, found: RingFit) -> bool:
    """Tell whether a sphere explains a profile nearly as well as a contact, either in light that fades outwards."""
    blur, has_harmonics = _blur_of(view, found), bool(found.parameters[list(HARMONICS)].any())
    phase = view.optics.phase_scale * scaled_gap(distance, float(found.parameters[Parameter.RADIUS]), view.optics.flat)
    spheres, contacts = [], []
    for spread in _SPREADS:
        band = spread[0], math.hypot(spread[1], math.sqrt(view.optics.spread))
        spheres.append(left_by_sphere(window, distance, view.optics, blur, band, has_harmonics=has_harmonics))
        lagging = terms[0] - 0.5 * spread[0] * phase * terms[3]
        contacts.append(window.left_by_all(faded(phase, spread) * np.stack([lagging, terms[2]])))
    return min(spheres) < _CONTACT_SURE * min(contacts)


def shows_edge(frame: NDArray[np.generic], view: View, found: RingFit) -> bool:
    """Tell whether a plain edge explains what is around a fit as well."""
    if not _may_be_edge(view, found):
        return False
    window, terms, _ = profile_of(frame, view, found)
    return window.is_seen and is_edge(window, terms[0], _FRINGES_SURE)


def _may_be_edge(view: View, found: RingFit) -> bool:
    """Tell whether a motion of the radius, or a blur, is so wide that fringes look like a soft edge."""
    travel = math.sqrt(max(float(found.parameters[Parameter.SMEAR]), 0.0))
    edge = edge_width(float(found.parameters[Parameter.RADIUS]), view.optics)
    return travel > _LONG_TRAVEL * edge or _blur_of(view, found) > _STRONG_BLUR * edge


def _blur_of(view: View, found: RingFit) -> float:
    """Return the standard deviation (px) of the image of a point in a fit."""
    return math.sqrt(max(view.optics.blur**2 + float(found.parameters[Parameter.BLUR]), 0.0))


def profile_of(frame: NDArray[np.generic], view: View, found: RingFit) -> tuple[Window, Floats, Floats]:
    """Profile about the centre of a fit, the term that was fitted with its derivatives, and the distances."""
    x, y, radius = (float(found.parameters[p]) for p in (Parameter.X, Parameter.Y, Parameter.RADIUS))
    settings = view.settings
    inner, outer = ring_limits(radius, view.optics, settings.fringes, settings.least_spacing)
    width = min(1.0, (outer - inner) / _LEAST_RINGS)
    first, last = math.ceil(inner / width), math.floor(outer / width)
    stretch, shear = (float(found.parameters[p]) for p in (Parameter.STRETCH, Parameter.SHEAR))
    profile, counts = radial_profile(frame, x, y, width, last, (stretch, shear))
    table, _ = tabulate((inner, outer), found.parameters, NONE_FREE, view.optics)
    distance = (np.arange(last - first, dtype=np.float64) + first + 0.5) * width
    index = (distance - table.start) * SAMPLES_PER_PIXEL
    terms = np.stack([np.interp(index, np.arange(table.values.shape[1]), line) for line in table.values[:4]])
    return Window(profile, counts, first, last - first), terms, distance

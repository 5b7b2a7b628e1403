"""Find the contact in one frame, or decide that there is none."""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from labpipe.imaging.contact_spot import find_spots, reduce_frame
from labpipe.imaging.fringes import SAMPLES_PER_PIXEL, Optics, radial_table, ring_limits
from labpipe.imaging.radial_scan import (
    Match,
    Templates,
    best_matches,
    edge_width,
    is_edge,
    make_templates,
    radial_profile,
    sphere_score,
)
from labpipe.imaging.radius_fit import (
    PARAMETERS,
    FitSettings,
    Parameter,
    RingFit,
    cut_ring,
    fit_contact,
    fit_ring,
)

Floats = NDArray[np.float64]

#: Share of the profile's variance that fringes must explain before a frame is fitted.
_LEAST_SCORE = 0.5
#: Circles tried in one frame.
_MOST_SPOTS = 4
#: Pixels and evaluations of the fits that find out what a frame shows.
_QUICK_PIXELS, _QUICK_ITERATIONS = 12_000, 12
#: Least ratio of the structure in a reduced frame to its noise.
_LEAST_STRUCTURE = 8.0
#: Residual beyond the noise, as a share of the modulation, from which a fit is not believed:
#: measured 0.03 for R 2 % wrong, 0.04 for light of low coherence, 0.3 for a disc without fringes.
MOST_MISFIT = 0.2
#: Misfit from which another explanation is looked for.
GOOD_MISFIT = 0.04
#: Greatest travel in the exposure as a share of the radius: at 2 there is no contact at first.
MOST_TRAVEL = 1.5
#: Travel in the exposure, in widths of the first bright ring, from which fringes may be mistaken
#: for a soft edge.
_LONG_TRAVEL = 0.5
#: Least visibility, and least modulation in units of its uncertainty.
_LEAST_VISIBILITY, _LEAST_SIGNIFICANCE = 0.1, 10.0
#: Contacts smaller than this many Newton spots are compared with a sphere that does not press.
_SMALL_CONTACT = 4.0
#: A contact is at least this share of a Newton spot; smaller ones are not told from touching.
_LEAST_RADIUS = 0.8
#: A sphere without load must fit worse than a contact by this factor in the squared misfit, and by
#: this many variances.
_WORSE, _WORSE_VARIANCES = 2.0, 50.0
#: Greatest uncertainty of a radius as a share of it.
_MOST_UNCERTAINTY = 0.1
#: Share of the ring's pixels that must lie in the frame.
_LEAST_PIXELS = 200


@dataclass(frozen=True)
class View:
    """What all frames of a film have in common.

    Attributes
    ----------
    optics : Optics
        The interference.
    settings : FitSettings
        How frames are fitted.
    shape : (int, int)
        Rows and columns.
    black, white : float
        Grey level of darkness, and from which pixels are saturated.
    ellipse : (float, float)
        Stretch and shear of circles.
    may_be_elliptic : bool
        Whether ellipses may be tried where circles do not fit.
    """

    optics: Optics
    settings: FitSettings
    shape: tuple[int, int]
    black: float
    white: float
    ellipse: tuple[float, float] = (0.0, 0.0)
    may_be_elliptic: bool = True

    @property
    def newton_spot(self) -> float:
        """Radius (px) at half brightness of the central spot of a sphere that just touches."""
        return math.sqrt(math.pi / self.optics.phase_scale)

    @property
    def templates(self) -> Templates | None:
        """Contacts to compare profiles with."""
        settings = self.settings
        return make_templates(self.shape, self.optics, settings.fringes, settings.least_spacing)


def search_contact(
    frame: NDArray[np.generic], view: View, centre: tuple[float, float] | None = None
) -> RingFit | None:
    """Find and fit the contact in a frame without knowing where it is.

    Parameters
    ----------
    frame : array (row, column)
        Grey levels.
    view : View
        Optics and settings.
    centre : (float, float), optional [px]
        Where the contact was in other frames; tried first.

    Returns
    -------
    RingFit or None
        None when nothing in the frame is a contact that shows fringes.
    """
    if not has_structure(frame):
        return None
    if centre is not None:
        found = fit_at(frame, view, *centre)
        if found is not None:
            return found
    for spot in find_spots(frame)[:_MOST_SPOTS]:
        found = fit_at(frame, view, spot.x, spot.y)
        if found is not None:
            return found
    return None


def has_structure(frame: NDArray[np.generic]) -> bool:
    """Tell whether there is more in a frame than noise."""
    small, factor = reduce_frame(frame)
    line = np.asarray(frame[:: max(1, frame.shape[0] // 64)], np.float32)
    noise = float(np.median(np.abs(np.diff(line, axis=1)))) / 0.954
    smooth = cv2.GaussianBlur(small, (3, 3), 0.8)
    low, high = np.percentile(smooth, (0.1, 99.9))
    return float(high - low) > _LEAST_STRUCTURE * max(noise, 0.3) / (2.0 * factor)


def fit_at(frame: NDArray[np.generic], view: View, x: float, y: float) -> RingFit | None:
    """Fit the contact around a known centre (to about a pixel), of whatever radius."""
    templates = view.templates
    if templates is None:
        return None
    profile, counts = radial_profile(frame, x, y, templates.width, templates.bins)
    best: RingFit | None = None
    for match in best_matches(profile, counts, templates):
        if match.score < _LEAST_SCORE or match.radius < _LEAST_RADIUS * view.newton_spot:
            continue
        if match.radius < _SMALL_CONTACT * view.newton_spot:
            left = 1.0 - sphere_score(profile, counts, match, templates)
            if _WORSE * left < 1.0 - match.score:
                continue
        found = fit_from(frame, view, start_of(match, view, x, y))
        if found is None or not is_contact(frame, view, found):
            continue
        if best is None or found.misfit < best.misfit:
            best = found
        if best.misfit < GOOD_MISFIT:
            break
    if best is None:
        return None
    settings = replace(view.settings, free=best.free)
    return fit_contact(frame, best.parameters, view.optics, settings, view.white)


def start_of(match: Match, view: View, x: float, y: float) -> Floats:
    """Parameters to start a fit from."""
    start = np.zeros(PARAMETERS)
    start[Parameter.RADIUS] = match.radius
    start[[Parameter.X, Parameter.Y]] = x, y
    start[[Parameter.GAIN, Parameter.MODULATION]] = match.gain, match.modulation
    start[Parameter.PHASE] = view.optics.phase
    start[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
    start[Parameter.SMEAR] = match.travel**2
    return start


def fit_from(frame: NDArray[np.generic], view: View, start: Floats) -> RingFit | None:
    """Fit part of the pixels in two steps, from the first fringe outwards.

    The first fringe needs less of a start than the finer ones farther out.
    """
    quick = replace(view.settings, max_pixels=_QUICK_PIXELS, max_iterations=_QUICK_ITERATIONS)
    near = replace(quick, fringes=1.0)
    first = fit_contact(frame, start, view.optics, near, view.white)
    if first is None or first.pixels < _LEAST_PIXELS:
        return None
    found = fit_contact(frame, first.parameters, view.optics, quick, view.white)
    axes = (Parameter.STRETCH, Parameter.SHEAR)
    is_settled = found is not None and found.misfit < GOOD_MISFIT
    if is_settled or not view.may_be_elliptic or axes[0] in view.settings.free:
        return found
    # Circles do not fit: perhaps the view is oblique.
    free = view.settings.free + axes
    first = fit_contact(frame, start, view.optics, replace(near, free=free), view.white)
    if first is None:
        return found
    ellipse = fit_contact(
        frame, first.parameters, view.optics, replace(quick, free=free), view.white
    )
    return ellipse if ellipse is not None and ellipse.misfit < GOOD_MISFIT else found


def is_contact(frame: NDArray[np.generic], view: View, found: RingFit) -> bool:
    """Decide whether a fit shows a contact, and not a sphere close by or something else."""
    radius = float(found.parameters[Parameter.RADIUS])
    modulation = abs(float(found.parameters[Parameter.MODULATION]))
    light = float(found.parameters[Parameter.GAIN]) - view.black
    is_clear = (
        found.pixels >= _LEAST_PIXELS
        and found.misfit <= MOST_MISFIT
        and light > 0.0
        and modulation >= _LEAST_VISIBILITY * light
        and modulation >= _LEAST_SIGNIFICANCE * found.deviation(Parameter.MODULATION)
        and radius > _LEAST_RADIUS * view.newton_spot
        and found.deviation(Parameter.RADIUS) < _MOST_UNCERTAINTY * radius
    )
    if not is_clear:
        return False
    travel = math.sqrt(max(float(found.parameters[Parameter.SMEAR]), 0.0))
    if travel > MOST_TRAVEL * radius:
        return False
    if travel > _LONG_TRAVEL * edge_width(radius, view.optics) and _is_edge(frame, view, found):
        return False
    return radius > _SMALL_CONTACT * view.newton_spot or not _is_sphere(frame, view, found)


def _is_edge(frame: NDArray[np.generic], view: View, found: RingFit) -> bool:
    """Tell whether what looks like smeared fringes is just a soft edge."""
    x, y, radius = (
        float(found.parameters[p]) for p in (Parameter.X, Parameter.Y, Parameter.RADIUS)
    )
    travel = math.sqrt(max(float(found.parameters[Parameter.SMEAR]), 0.0))
    settings = view.settings
    inner, outer = ring_limits(radius, view.optics, settings.fringes, settings.least_spacing)
    first, last = math.ceil(inner), math.floor(outer)
    profile, counts = radial_profile(frame, x, y, 1.0, last)
    if not (counts[first:last] > 0).all():
        return False
    table = radial_table(first, last, radius, travel, view.optics)
    places = first + 0.5 + np.arange(last - first)
    index = (places - table.start) * SAMPLES_PER_PIXEL
    template = np.interp(index, np.arange(table.values.shape[1]), table.values[0])
    return is_edge(profile, counts, template, first)


def _is_sphere(frame: NDArray[np.generic], view: View, found: RingFit) -> bool:
    """Tell whether a sphere that touches or hovers fits nearly as well as a contact.

    It is the contact of radius 0; its height shifts the phase.
    """
    others = tuple(p for p in found.free if p not in (Parameter.RADIUS, Parameter.SMEAR))
    settings = replace(view.settings, free=(*others, Parameter.PHASE), max_iterations=8)
    radius = float(found.parameters[Parameter.RADIUS])
    inner, outer = ring_limits(
        radius, view.optics, view.settings.fringes, view.settings.least_spacing
    )
    ring = cut_ring(frame, found.parameters, inner, outer, view.white, view.settings.max_pixels)
    if ring is None:
        return False
    best = math.inf
    for shift in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi):
        start = found.parameters.copy()
        start[Parameter.RADIUS] = 0.0
        start[Parameter.SMEAR] = 0.0
        start[Parameter.PHASE] += shift
        best = min(best, fit_ring(ring, start, view.optics, settings).residual)
    noise = found.noise**2
    contact_excess = max(found.residual**2 - noise, 0.0)
    sphere_excess = best**2 - noise
    is_worse = sphere_excess > _WORSE * contact_excess
    return not (
        is_worse and (best**2 - found.residual**2) * found.pixels > _WORSE_VARIANCES * noise
    )

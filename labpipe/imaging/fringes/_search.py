"""Find the contact in one frame, or decide that there is none."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._edge import Edge, corrected_radius
from labpipe.imaging.fringes._interference import SAMPLES_PER_PIXEL, Optics, radial_table, ring_limits
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._radial_scan import (
    Match,
    Templates,
    Window,
    best_matches,
    edge_width,
    is_edge,
    is_only_sphere,
    is_sphere,
    make_templates,
    radial_profile,
    template_of,
)
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import HARMONICS, LIGHT, PARAMETERS, Parameter

#: Share of the profile's variance that fringes must explain before a frame is fitted.
_LEAST_SCORE = 0.5
#: Circles looked at in one frame, and how many of them are fitted, the likeliest first.
_MOST_SPOTS, _MOST_FITS = 4, 3
#: Pixels and evaluations of the fits that find out what a frame shows.
_QUICK_PIXELS, _QUICK_ITERATIONS = 12_000, 12
#: Misfit of a fit from which its start is nonsense, and of the first fringe from which another
#: explanation does not explain it either: right ones left 0.6 and 0.1 at most.
_NONSENSE, _UNEXPLAINED = 1.0, 0.3
#: Distance (px) below which a circle is taken for one that nothing explained before, and in how many
#: frames nothing did.
_SAME_CIRCLE, _TWICE = 1.5, 2
#: Residual beyond the noise, as a share of the modulation, from which a fit is not believed:
#: measured 0.03 for R 2 % wrong, 0.04 for light of low coherence; 0.1 and more for fits of
#: something else.
MOST_MISFIT = 0.1
#: Misfit from which another explanation is looked for.
GOOD_MISFIT = 0.04
#: Greatest travel in the exposure as a share of the radius: at 2 there is no contact at first.
MOST_TRAVEL = 1.5
#: Travel in the exposure, in widths of the first bright ring, from which fringes may be mistaken
#: for a soft edge.
_LONG_TRAVEL = 0.5
#: Blur, in widths of the first bright ring, from which the same holds.
_STRONG_BLUR = 0.25
#: Widths of the first bright ring by which an axis differs from a circle that its profile tells of.
_ROUND = 0.25
#: A plain edge is believed at once when it leaves less than this share of the squares that the
#: nearest template leaves, and against a fit when it leaves less than this multiple.
_EDGE_SURE, _FRINGES_SURE = 0.4, 2.0
#: Least visibility, and least modulation in units of its uncertainty.
_LEAST_VISIBILITY, _LEAST_SIGNIFICANCE = 0.1, 10.0
#: Light is never negative, so that fringes have a visibility of one at most; clipped light and
#: cameras that are not linear were seen to fit with a fifth more.
_MOST_VISIBILITY = 1.5
#: A sphere is believed at once when it leaves less than this share of the squares that the nearest
#: template leaves: that is up to half a pixel off.
_SPHERE_SURE = 0.65
#: Contacts smaller than this many Newton spots are compared with a sphere that does not press.
_SMALL_CONTACT = 4.0
#: A contact is at least this share of a Newton spot; smaller ones are not distinguished from
#: touching.
_LEAST_RADIUS = 0.8
#: Least number of rings in which a fit is compared with edges and spheres.
_LEAST_RINGS = 24
#: Greatest uncertainty of a radius as a share of it.
_MOST_UNCERTAINTY = 0.1
#: Square of the blur (px²) from which it is sought, and the share of the misfit of a long travel in
#: the exposure that a blur must stay below to be the better reason for soft fringes.
_FIRST_BLUR, _BLUR_BEFORE_TRAVEL = 2.0, 0.5
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
        Grey level of darkness, below which pixels are clipped, and from which they are saturated.
    ellipse : (float, float)
        Stretch and shear of circles.
    harmonics : (float, float, float)
        See :data:`HARMONICS`.
    alternatives : tuple of tuples of Parameter
        What else may be freed where the usual fit fails.
    """

    optics: Optics
    settings: FitSettings
    shape: tuple[int, int]
    black: float
    white: float
    ellipse: tuple[float, float] = (0.0, 0.0)
    harmonics: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alternatives: tuple[tuple[Parameter, ...], ...] = ()

    @property
    def levels(self) -> tuple[float, float]:
        """Return the grey levels at which pixels are clipped; numbers that are no counts are not."""
        return self.black if math.isfinite(self.white) else -math.inf, self.white

    @property
    def newton_spot(self) -> float:
        """Radius (px) at half brightness of the central spot of a sphere that just touches."""
        return math.sqrt(math.pi / self.optics.phase_scale)

    @property
    def least_radius(self) -> float:
        """Radius (px) below which a contact is not told from a sphere that just touches."""
        return _LEAST_RADIUS * self.newton_spot

    @property
    def templates(self) -> Templates | None:
        """Contacts to compare profiles with."""
        settings = self.settings
        return make_templates(self.shape, self.optics, settings.fringes, settings.least_spacing)


class Vain:
    """Circles in the frames of a film that no other explanation than the usual one fits either.

    What stands there still, a speck of dust or a disc without fringes, is not tried again.
    """

    def __init__(self) -> None:
        self._circles: list[Floats] = []

    def view_of(self, view: View, x: float, y: float, radius: float) -> View:
        """Return the view of a circle (px): without alternatives where they failed before."""
        circle = np.array([x, y, radius])
        known = sum(bool(np.abs(circle - other).max() < _SAME_CIRCLE) for other in self._circles)
        return replace(view, alternatives=()) if known >= _TWICE else view

    def add(self, x: float, y: float, radius: float) -> None:
        """Remember a circle (px)."""
        self._circles.append(np.array([x, y, radius]))


def search_contact(
    looks: Looks,
    view: View,
    centre: tuple[float, float] | None = None,
    vain: Vain | None = None,
    is_otherwise: Callable[[], bool] = lambda: False,
) -> RingFit | None:
    """Find and fit the contact in a frame without knowing where it is.

    Parameters
    ----------
    looks : Looks
        The frame.
    view : View
        Optics and settings.
    centre : (float, float), optional [px]
        Where the contact was in other frames; tried first.
    vain : Vain, optional
        What was tried in vain in other frames of the film.
    is_otherwise : callable, optional
        Tells, once the usual fit has failed, that the frame is explained by something that is not sought here.

    Returns
    -------
    RingFit or None
        None when nothing in the frame is a contact that shows fringes.
    """
    if not looks.have_structure:
        return None
    frame = looks.frame
    is_sphere_there = centre is not None and is_only_sphere(frame, *centre, view.optics)
    if centre is not None and not is_sphere_there:
        found = fit_at(frame, view, *centre)
        if found is not None:
            return found
    if is_sphere_there or looks.show_only_sphere(view.optics):
        return None
    spots = looks.spots[:_MOST_SPOTS]
    sights = [sight for spot in spots for sight in look_at(frame, view, spot.x, spot.y)]
    sights.sort(key=lambda sight: -sight[0].score)
    plain = replace(view, alternatives=())
    usual = []
    for match, x, y in sights[:_MOST_FITS]:
        usual.append(fit_from(frame, plain, start_of(match, view, x, y)))
        found = _whole_fit(frame, plain, usual[-1])
        if found is not None:
            return found
    if is_otherwise():
        return None
    tried = list(zip(sights[:_MOST_FITS], usual, strict=True))
    return _search_with_alternatives(looks, view, tried, Vain() if vain is None else vain)


def _search_with_alternatives(
    looks: Looks, view: View, tried: list[tuple[tuple[Match, float, float], RingFit | None]], vain: Vain
) -> RingFit | None:
    """Fit what the usual fit has not explained with whatever else may be free."""
    frame = looks.frame
    # Uneven light, blur and an oblique view lead the comparison astray more than they do an edge.
    edges = (looks.edge(spot, view.black) for spot in looks.spots[:_MOST_SPOTS])
    for edge in (edge for edge in edges if edge is not None):
        circle = edge.x, edge.y, edge.half_radius
        found = fit_edge(frame, vain.view_of(view, *circle), edge)
        if found is not None:
            return found
        vain.add(*circle)
    for (match, x, y), first in tried:
        circle = x, y, match.radius
        if first is not None:
            start = start_of(match, view, x, y)
            other = otherwise(frame, vain.view_of(view, *circle), start, first)
            found = None if other is first else _whole_fit(frame, view, other)
            if found is not None:
                return found
            vain.add(*circle)
    # Perhaps there is a spot that no threshold separates from uneven light.
    for spot in looks.centres:
        circle = spot.x, spot.y, 0.0
        found = fit_at(frame, vain.view_of(view, *circle), spot.x, spot.y)
        if found is not None:
            return found
        vain.add(*circle)
    return None


def look_at(frame: NDArray[np.generic], view: View, x: float, y: float) -> list[tuple[Match, float, float]]:
    """Contacts that the rings around a point resemble, with that point."""
    templates = view.templates
    if templates is None:
        return []
    profile, counts = radial_profile(frame, x, y, templates.width, templates.bins)
    matches = []
    for match in best_matches(profile, counts, templates):
        if match.score < _LEAST_SCORE or match.radius < view.least_radius:
            continue
        term, first = template_of(match, templates)
        window = Window(profile, counts, first, len(term))
        distance = (np.arange(len(term), dtype=np.float64) + first + 0.5) * templates.width
        if window.is_seen and is_edge(window, term, _EDGE_SURE):
            continue
        is_small = match.radius < _SMALL_CONTACT * view.newton_spot
        if is_small and is_sphere(window, term, distance, view.optics, _SPHERE_SURE):
            continue
        matches.append((match, x, y))
    return matches


def fit_at(frame: NDArray[np.generic], view: View, x: float, y: float) -> RingFit | None:
    """Fit the contact around a known centre (to about a pixel), of whatever radius."""
    for match, *_ in look_at(frame, view, x, y):
        found = fit_match(frame, view, match, x, y)
        if found is not None:
            return found
    return None


def fit_match(frame: NDArray[np.generic], view: View, match: Match, x: float, y: float) -> RingFit | None:
    """Fit from a match, with some of the pixels until it proves to be a contact."""
    return _whole_fit(frame, view, fit_from(frame, view, start_of(match, view, x, y)))


def _whole_fit(frame: NDArray[np.generic], view: View, found: RingFit | None) -> RingFit | None:
    """Fit all pixels from a fit of some of them, if it proves to be a contact."""
    if found is None or not is_contact(frame, view, found):
        return None
    settings = replace(view.settings, free=found.free)
    final = fit_contact(frame, found.parameters, view.optics, settings, view.levels)
    return final if final is not None and is_clear(view, final) else None


def start_of(match: Match, view: View, x: float, y: float) -> Floats:
    """Parameters to start a fit from."""
    start = np.zeros(PARAMETERS)
    start[Parameter.RADIUS] = match.radius
    start[[Parameter.X, Parameter.Y]] = x, y
    start[[Parameter.GAIN, Parameter.MODULATION]] = match.gain, match.modulation
    start[Parameter.PHASE] = view.optics.phase
    start[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
    start[list(HARMONICS)] = view.harmonics
    start[Parameter.SMEAR] = match.travel**2
    return start


def start_at_edge(edge: Edge, view: View) -> Floats:
    """Parameters to start a fit from where a spot has its edge."""
    sign = math.copysign(1.0, math.cos(view.optics.phase))
    start = np.zeros(PARAMETERS)
    start[Parameter.RADIUS] = max(corrected_radius(edge, view.optics)[0], 1.0)
    start[[Parameter.X, Parameter.Y]] = edge.x, edge.y
    start[Parameter.GAIN] = 0.5 * (edge.inside + edge.outside)
    start[Parameter.MODULATION] = 0.5 * sign * (edge.inside - edge.outside)
    start[Parameter.PHASE] = view.optics.phase
    start[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
    start[list(HARMONICS)] = view.harmonics
    return start


def fit_edge(frame: NDArray[np.generic], view: View, edge: Edge) -> RingFit | None:
    """Fit the fringes beside the edge of a spot; None when they do not explain it well."""
    found = fit_from(frame, view, start_at_edge(edge, view))
    if found is None or found.misfit > GOOD_MISFIT:
        return None
    final = fit_contact(frame, found.parameters, view.optics, replace(view.settings, free=found.free), view.levels)
    return final if final is not None and final.misfit <= GOOD_MISFIT and is_contact(frame, view, final) else None


def fit_from(frame: NDArray[np.generic], view: View, start: Floats) -> RingFit | None:
    """Fit part of the pixels in two steps, from the first fringe outwards.

    The first fringe needs less of a start than the finer ones farther out.
    """
    quick = replace(view.settings, max_pixels=_QUICK_PIXELS, max_iterations=_QUICK_ITERATIONS)
    # only where it ends counts of the first step
    near = replace(quick, fringes=1.0, tells_memory=False)
    first = fit_contact(frame, start, view.optics, near, view.levels)
    if first is None or first.pixels < _LEAST_PIXELS:
        return None
    found = fit_contact(frame, first.parameters, view.optics, quick, view.levels)
    return None if found is None else otherwise(frame, view, start, found)


def otherwise(frame: NDArray[np.generic], view: View, start: Floats, found: RingFit) -> RingFit:
    """Fit with the alternatives what the usual fit does not explain; the usual fit where none does better."""
    alternatives, least = view.alternatives, min(GOOD_MISFIT, found.misfit)
    quick = replace(view.settings, max_pixels=_QUICK_PIXELS, max_iterations=_QUICK_ITERATIONS)
    if found.has_negative_light and LIGHT in alternatives:
        free = (*view.settings.free, *LIGHT)
        trial = fit_contact(frame, found.parameters, view.optics, replace(quick, free=free), view.levels)
        if trial is not None and trial.misfit < GOOD_MISFIT:
            return trial
    if found.misfit < GOOD_MISFIT:
        if not _has_long_travel(view, found):
            return found
        alternatives = tuple(extra for extra in alternatives if Parameter.BLUR in extra)
        least = _BLUR_BEFORE_TRAVEL * found.misfit
    elif found.misfit > _NONSENSE:
        return found
    near = replace(quick, fringes=1.0, tells_memory=False)
    # Perhaps the view is oblique or out of focus, R or the wavelength is not what it is said to
    # be, or there are many beams.
    for extra in alternatives:
        free = (*view.settings.free, *extra)
        other = start.copy()
        other[Parameter.SMEAR] = 0.0
        other[Parameter.BLUR] = _FIRST_BLUR if Parameter.BLUR in extra else 0.0
        # A blur and a travel are hardly told from each other by the first fringe alone.
        started = tuple(p for p in free if p != Parameter.SMEAR) if Parameter.BLUR in extra else free
        first = fit_contact(frame, other, view.optics, replace(near, free=started), view.levels)
        if first is None or first.misfit > _UNEXPLAINED:
            continue
        trial = fit_contact(frame, first.parameters, view.optics, replace(quick, free=free), view.levels)
        if trial is not None and trial.misfit < least:
            return trial
    return found


def is_clear(view: View, found: RingFit) -> bool:
    """Tell whether a fit shows rings beyond doubt, around a circle that can be a contact."""
    radius = float(found.parameters[Parameter.RADIUS])
    modulation = abs(float(found.parameters[Parameter.MODULATION]))
    light = float(found.parameters[Parameter.GAIN]) - view.black
    return (
        found.pixels >= _LEAST_PIXELS
        and found.misfit <= MOST_MISFIT
        and light > 0.0
        and _LEAST_VISIBILITY * light <= modulation <= _MOST_VISIBILITY * light
        and modulation >= _LEAST_SIGNIFICANCE * found.deviation(Parameter.MODULATION)
        and radius > view.least_radius
        and found.deviation(Parameter.RADIUS) < _MOST_UNCERTAINTY * radius
    )


def is_contact(frame: NDArray[np.generic], view: View, found: RingFit) -> bool:
    """Decide whether a fit shows a contact, and not a sphere close by or something else."""
    if not is_clear(view, found):
        return False
    radius = float(found.parameters[Parameter.RADIUS])
    travel = math.sqrt(max(float(found.parameters[Parameter.SMEAR]), 0.0))
    if travel > MOST_TRAVEL * radius:
        return False
    edge = edge_width(radius, view.optics)
    oblique = math.hypot(float(found.parameters[Parameter.STRETCH]), float(found.parameters[Parameter.SHEAR]))
    # The mean around the centre of an ellipse is softer than its rings; but a shadow is no ellipse.
    is_ellipse = oblique * radius > _ROUND * edge and found.misfit < 0.5 * GOOD_MISFIT
    may_be_edge = (_has_long_travel(view, found) or _blur_of(view, found) > _STRONG_BLUR * edge) and not is_ellipse
    is_small = radius < _SMALL_CONTACT * view.newton_spot
    if not may_be_edge and not is_small:
        return True
    window, term, distance = _profile_of(frame, view, found)
    if not window.is_seen:
        return not may_be_edge
    if may_be_edge and is_edge(window, term, _FRINGES_SURE):
        return False
    seen = replace(view.optics, blur=_blur_of(view, found))
    return not (is_small and is_sphere(window, term, distance, seen))


def _has_long_travel(view: View, found: RingFit) -> bool:
    """Tell whether the radius moves so far in the exposure that fringes look like a soft edge."""
    travel = math.sqrt(max(float(found.parameters[Parameter.SMEAR]), 0.0))
    return travel > _LONG_TRAVEL * edge_width(float(found.parameters[Parameter.RADIUS]), view.optics)


def _blur_of(view: View, found: RingFit) -> float:
    """Return the standard deviation (px) of the image of a point in a fit."""
    return math.sqrt(max(view.optics.blur**2 + float(found.parameters[Parameter.BLUR]), 0.0))


def _profile_of(frame: NDArray[np.generic], view: View, found: RingFit) -> tuple[Window, Floats, Floats]:
    """Profile about the centre of a fit, the term that was fitted, and its distances."""
    x, y, radius = (float(found.parameters[p]) for p in (Parameter.X, Parameter.Y, Parameter.RADIUS))
    travel = math.sqrt(max(float(found.parameters[Parameter.SMEAR]), 0.0))
    settings = view.settings
    scale = math.exp(float(found.parameters[Parameter.SCALE]))
    optics = replace(view.optics, phase_scale=view.optics.phase_scale * scale, blur=_blur_of(view, found))
    inner, outer = ring_limits(radius, view.optics, settings.fringes, settings.least_spacing)
    width = min(1.0, (outer - inner) / _LEAST_RINGS)
    first, last = math.ceil(inner / width), math.floor(outer / width)
    profile, counts = radial_profile(frame, x, y, width, last)
    table = radial_table(inner, outer, radius, travel, optics)
    distance = (np.arange(last - first, dtype=np.float64) + first + 0.5) * width
    index = (distance - table.start) * SAMPLES_PER_PIXEL
    term = np.interp(index, np.arange(table.values.shape[1]), table.values[0])
    return Window(profile, counts, first, last - first), term, distance

"""Find the contact in one frame, or decide that there is none."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT, SMALL_CONTACT, is_clear, is_contact
from labpipe.imaging.fringes._edge import Edge, corrected_radius
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._radial_scan import (
    Match,
    Window,
    best_matches,
    is_edge,
    is_sphere,
    radial_profile,
    template_of,
)
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import EVEN, Parameter
from labpipe.imaging.fringes._spots import Spot
from labpipe.imaging.fringes._touch import left_by_only_sphere
from labpipe.imaging.fringes._trial_fits import fit_edge, fit_from, fit_some, shows_rings, start_of
from labpipe.imaging.fringes._view import View

#: What a fit leaves over what the last one did up to which it shows the same contact.
NO_WORSE = 1.2
#: Share of the profile's variance that fringes must explain before a frame is fitted.
_LEAST_SCORE = 0.5
#: Circles looked at in one frame, and how many of them are fitted, the likeliest first.
_MOST_SPOTS, _MOST_FITS, _MOST_CENTRES = 4, 3, 1
#: Distance (px) below which a circle is taken for one that nothing explained before, and in how many
#: frames nothing did.
_SAME_CIRCLE, _TWICE = 1.5, 2
#: A plain edge is believed at once when it leaves less than this share of the squares that the
#: nearest template leaves.
_EDGE_SURE = 0.4
#: A sphere is believed at once when it leaves less than this share of the squares that the nearest
#: template leaves: that is up to half a pixel off.
_SPHERE_SURE = 0.65


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
    looks: Looks, view: View, centre: tuple[float, float] | None = None, vain: Vain | None = None
) -> RingFit | None:
    """Find and fit the contact in a frame without knowing where it is; None when none shows fringes.

    The centre (px) in other frames is tried first, and what was in vain in them is not tried again.
    """
    if not looks.have_structure:
        return None
    frame = looks.frame
    is_sphere_there = centre is not None and left_by_only_sphere(frame, *centre, view.optics) is not None
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
    discs = cache(lambda: _discs(looks, view, spots))
    for match, x, y in sights[:_MOST_FITS]:
        found = _whole_fit(frame, plain, fit_from(frame, plain, start_of(match, view, x, y)))
        if found is not None:
            return found
        # Where a disc without rings is seen others are about what noise makes of the even light around it.
        if discs():
            break
    edges = (edge for edge in looks.edges(spots, view.black) if edge not in discs())
    found = _fit_at_edges(frame, view, edges, Vain() if vain is None else vain)
    if found is not None or discs():
        return found
    # Perhaps there is a spot that no threshold separates from uneven light.
    at_centres = (fit_at(frame, view, spot.x, spot.y) for spot in looks.centres[:_MOST_CENTRES])
    return next((fit for fit in at_centres if fit is not None), None)


def _discs(looks: Looks, view: View, spots: Sequence[Spot]) -> list[Edge]:
    """Edges of spots around which there are no rings that a fit could explain."""
    return [edge for edge in looks.edges(spots, view.black) if not shows_rings(looks.frame, view, edge)]


def _fit_at_edges(frame: NDArray[np.generic], view: View, edges: Iterable[Edge], vain: Vain) -> RingFit | None:
    """Fit beside edges what the usual fit has not explained, with whatever else may be free.

    Uneven light, blur and an oblique view lead the comparison astray more than they do an edge.
    """
    for edge in edges:
        circle = edge.x, edge.y, edge.half_radius
        found = fit_edge(frame, vain.view_of(view, *circle), edge)
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
        is_small = match.radius < SMALL_CONTACT * view.newton_spot
        if is_small and is_sphere(window, term, distance, view.optics, _SPHERE_SURE):
            continue
        matches.append((match, x, y))
    return matches


def fit_at(frame: NDArray[np.generic], view: View, x: float, y: float) -> RingFit | None:
    """Fit the contact around a known centre (to about a pixel), of whatever radius.

    All pixels are fitted only where some of them prove that there is a contact.
    """
    for match, *_ in look_at(frame, view, x, y):
        found = _whole_fit(frame, view, fit_from(frame, view, start_of(match, view, x, y)))
        if found is not None:
            return found
    return None


def fit_like(looks: Looks, view: View, last: RingFit) -> RingFit | None:
    """Fit the contact where the last one was, with what was free there and as it came out; of whatever radius.

    A blur and a travel are hardly told from each other by some of the pixels: the blur stands for both there.
    """
    start, free = last.parameters.copy(), last.free
    if Parameter.BLUR in free:
        free = tuple(p for p in free if p is not Parameter.SMEAR)
        start[Parameter.BLUR] = max(start[Parameter.BLUR] + start[Parameter.SMEAR] / EVEN, 0.0)
        start[Parameter.SMEAR] = 0.0
    for radius in _radii_about(looks, view, float(start[Parameter.X]), float(start[Parameter.Y])):
        start[Parameter.RADIUS] = max(radius, 1.0)
        found = fit_some(looks.frame, view, start, free)
        if found is not None and found.misfit <= max(GOOD_MISFIT, NO_WORSE * last.misfit):
            return _whole_fit(looks.frame, view, found, last.free)
    return None


def _radii_about(looks: Looks, view: View, x: float, y: float) -> Iterator[float]:
    """Radii (px) that a contact about a point may have: by its rings, and by the edge of the likeliest spot."""
    for match, *_ in look_at(looks.frame, view, x, y):
        yield match.radius
    for edge in looks.edges(looks.spots[:1], view.black):
        yield float(corrected_radius(edge, view.optics)[0])


def _whole_fit(
    frame: NDArray[np.generic], view: View, found: RingFit | None, free: tuple[Parameter, ...] | None = None
) -> RingFit | None:
    """Fit all pixels from a fit of some of them, if it proves to be a contact; ``free`` as there if not given."""
    if found is None or not is_contact(frame, view, found, by_some=True):
        return None
    settings = replace(view.settings, free=free or found.free)
    final = fit_contact(frame, found.parameters, view.optics, settings, view.levels)
    return final if final is not None and is_clear(view, final) else None

"""Fit the contact that may be at a start with some of the pixels, by the usual parameters or by others.

A start is a profile that resembles one, the edge of a spot, or any parameters. What the usual fit does
not explain is fitted with whatever else may be free: blur, an oblique view, another scale, many beams,
uneven light.
"""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT, LEAST_PIXELS, is_contact
from labpipe.imaging.fringes._edge import Edge, corrected_radius
from labpipe.imaging.fringes._gains import Gains, in_order
from labpipe.imaging.fringes._interference import distance_at_phase
from labpipe.imaging.fringes._phase_scan import guesses
from labpipe.imaging.fringes._radial_scan import Match, Window, left_by_edge, radial_profile
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import AXES, HARMONICS, LIGHT, PARAMETERS, RADIAL, Parameter
from labpipe.imaging.fringes._view import View

#: Pixels and evaluations of the fits that find out what a frame shows.
_QUICK_PIXELS, _QUICK_ITERATIONS = 12_000, 12
#: Misfit of a fit from which its start is nonsense, and of the first fringe from which another
#: explanation does not explain it either: right ones left 0.6 and 0.1 at most. Misfit of the first fringe by the usual
#: fit from which a start is far off: 1.4 at most around contacts.
_NONSENSE, _UNEXPLAINED, _FAR_OFF = 1.0, 0.3, 2.0
#: Misfit from which no other explanation is tried beside the ones before.
_SURE_MISFIT = 0.02
#: Share of what the usual fit leaves that functions of the distance would explain: below, none of them does (they had
#: 0.53 and more where they did), and above, nothing else does (0.61 and less).
_UNEVEN, _ROUND = 0.45, 0.8
#: Fringes over which a plain edge is told from rings, and share of the squares that it leaves at most where there are
#: none: sharp and blurred discs left up to 0.0005, rings out of focus by 6 px 0.0011 and more.
_RINGS, _PLAIN = 3.0, 0.0006
#: Radius of a spot over that of a contact at its edge, by which phases are compared, and share of the variance of a
#: profile that another phase must explain: 0.996 where it was that, 0.88 and less where the scale was another.
_WIDER, _TURNED = 1.15, 0.95
#: Square of the blur (px²) from which it is sought.
_FIRST_BLUR = 2.0


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
    start[list(AXES)] = edge.oblique if any(edge.oblique) else view.ellipse
    start[list(HARMONICS)] = view.harmonics
    return start


def shows_rings(frame: NDArray[np.generic], view: View, edge: Edge) -> bool:
    """Tell whether more is seen around a spot than a plain edge, beside which no gap opens."""
    outer = math.ceil(distance_at_phase(2.0 * math.pi * _RINGS, edge.half_radius, view.optics))
    first = max(math.floor(2.0 * edge.half_radius - outer), 0)
    profile, counts = radial_profile(frame, edge.x, edge.y, 1.0, outer, edge.oblique)
    window = Window(profile, counts, first, outer - first)
    return not window.is_seen or left_by_edge(window, outer - first, is_exact=True) > _PLAIN * window.squares


def _quick(view: View) -> FitSettings:
    """How some pixels are fitted to find out what a frame shows."""
    return replace(view.settings, max_pixels=_QUICK_PIXELS, max_iterations=_QUICK_ITERATIONS, asks=())


def fit_edge(frame: NDArray[np.generic], view: View, edge: Edge) -> RingFit | None:
    """Fit the fringes beside the edge of a spot; None when they do not explain it well.

    Where it is an ellipse, and may be one, its axes are free whatever else is tried.
    """
    if any(edge.oblique) and AXES in view.alternatives:
        view = replace(view, settings=replace(view.settings, free=tuple(dict.fromkeys((*view.settings.free, *AXES)))))
    found = fit_from(frame, view, start_at_edge(edge, view))
    if found is None or found.misfit > GOOD_MISFIT:
        return None
    final = fit_contact(frame, found.parameters, view.optics, replace(view.settings, free=found.free), view.levels)
    return final if final is not None and final.misfit <= GOOD_MISFIT and is_contact(frame, view, final) else None


def fit_some(frame: NDArray[np.generic], view: View, start: Floats, free: tuple[Parameter, ...]) -> RingFit | None:
    """Fit some of the pixels with these parameters; None when too few of them lie in the frame."""
    quick = replace(_quick(view), free=free)
    found = fit_contact(frame, start, view.optics, quick, view.levels)
    return None if found is None or found.pixels < LEAST_PIXELS else found


def fit_from(frame: NDArray[np.generic], view: View, start: Floats) -> RingFit | None:
    """Fit part of the pixels in two steps, from the first fringe outwards.

    The first fringe needs less of a start than the finer ones farther out.
    """
    quick = _quick(view)
    # only where it ends counts of the first step
    near = replace(quick, fringes=1.0, tells_memory=False)
    first = fit_contact(frame, start, view.optics, near, view.levels)
    if first is None or first.pixels < LEAST_PIXELS or first.misfit > _FAR_OFF:
        return None
    found = fit_contact(frame, first.parameters, view.optics, quick, view.levels)
    return None if found is None else _otherwise(frame, view, start, found)


def _otherwise(frame: NDArray[np.generic], view: View, start: Floats, found: RingFit) -> RingFit:
    """Fit with the alternatives what the usual fit does not explain; the usual fit where none does better."""
    best, usual = found, view.settings.free
    if found.has_negative_light and LIGHT in view.alternatives:
        light = replace(_quick(view), free=(*usual, *LIGHT))
        trial = fit_contact(frame, found.parameters, view.optics, light, view.levels)
        if trial is not None and trial.misfit < GOOD_MISFIT:
            return trial
    if not GOOD_MISFIT <= found.misfit <= _NONSENSE:
        return found
    if any(Parameter.PHASE in extra for extra in view.alternatives):
        turned = _turned(frame, view, start)
        if turned is not None and turned.misfit < _SURE_MISFIT:
            return turned
    # Perhaps the view is oblique or out of focus, R or the wavelength is not what it is said to
    # be, or there are many beams. Those that differ by what is free already are one.
    ways = {frozenset((*usual, *extra)): extra for extra in reversed(view.alternatives) if not set(extra) <= set(usual)}
    likely, share = list(reversed(ways.values())), math.nan
    if len(likely) > 1:
        gains = Gains([frame], [found], replace(view, settings=_quick(view)))
        share = gains.round_share
        likely = in_order({of: max(gains.share(of), 1.0 - share if LIGHT[0] in of else 0.0) for of in likely})
    for extra in likely:
        is_radial = set(extra).difference(usual) <= set(RADIAL)
        if share < _UNEVEN if is_radial else share > _ROUND:
            continue
        # Where light is uneven the usual fit finds the circle, and the first fringe tells the light worse than all.
        begin = found.parameters if LIGHT[0] in extra else start
        trial = _trial(frame, view, begin, (*usual, *extra))
        if trial is not None and trial.misfit < best.misfit:
            best = trial
            if best.misfit < _SURE_MISFIT:
                break
    return best


def _turned(frame: NDArray[np.generic], view: View, start: Floats) -> RingFit | None:
    """Fit with the phase free what rings of the stated scale about a start resemble; None where it fails."""
    x, y, radius = (float(start[p]) for p in (Parameter.X, Parameter.Y, Parameter.RADIUS))
    guess = next(guesses(frame, view, x, y, _WIDER * radius, np.zeros(1)), None)
    if guess is None or guess.score < _TURNED:
        return None
    return _trial(frame, view, guess.start(start), (*view.settings.free, Parameter.PHASE))


def _trial(frame: NDArray[np.generic], view: View, start: Floats, free: tuple[Parameter, ...]) -> RingFit | None:
    """Fit some pixels with these free, uneven light at once, else from the first fringe out; None where it fails."""
    free = tuple(dict.fromkeys(free))
    if LIGHT[0] in free:
        return fit_some(frame, view, start, free)
    quick = replace(_quick(view), free=free)
    other = start.copy()
    # A blur and a travel are hardly told from each other by the first fringe alone.
    is_blurred = Parameter.BLUR in free
    other[Parameter.SMEAR] = 0.0
    other[Parameter.BLUR] = (other[Parameter.BLUR] or _FIRST_BLUR) if is_blurred else 0.0
    started = tuple(p for p in free if p != Parameter.SMEAR) if is_blurred else free
    near = replace(quick, fringes=1.0, tells_memory=False, free=started)
    first = fit_contact(frame, other, view.optics, near, view.levels)
    if first is None or first.misfit > _UNEXPLAINED:
        return None
    return fit_contact(frame, first.parameters, view.optics, quick, view.levels)

"""Fit frames again from what the contacts in the frames beside them tell.

Motion in the exposure and a gap that is not Hertz's hide a contact from a search that knows nothing of it;
the radius and its rate of change follow from the frames before and after.
"""

import math
from dataclasses import replace

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.films import FilmReader
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT, is_contact
from labpipe.imaging.fringes._blank_frames import FilmResult, look_without_fringes
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._open_gap import fit_open_gap, is_doubtful
from labpipe.imaging.fringes._radial_scan import edge_width
from labpipe.imaging.fringes._ring_fit import RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import Parameter
from labpipe.imaging.fringes._search import fit_at
from labpipe.imaging.fringes._trial_fits import fit_from, shows_rings, start_at_edge
from labpipe.imaging.fringes._view import View

#: A contact beside another differs from what is expected by this share of the other's radius at
#: most, and its centre lies within this share of its own radius from the other's.
_MOST_CHANGE, _SAME_CENTRE = 0.5, 0.3
_CIRCLE = (Parameter.RADIUS, Parameter.X, Parameter.Y)
#: Frames after one that no gap explains in which none is sought, and what they leave at most against it.
_SAME_DOUBT, _NO_WORSE = 16, 1.2
#: Frames before and after from which motion is estimated.
_NEIGHBOURS = 3
#: Travel in the exposure, in widths of the first bright ring, tried when nothing tells it.
_UNKNOWN_TRAVELS = (1.5, 4.0)


def fit_blurred_frames(
    reader: FilmReader, result: FilmResult, time: Floats, exposure: Floats | None, read: Flags
) -> None:
    """Fit blurred frames again, starting from where their neighbours say the contact was.

    Twice, because a repaired frame helps its neighbours; what no neighbour helps anew is not tried again.
    """
    tried: dict[int, dict[int, RingFit]] = {}
    for _ in range(2):
        for index in map(int, np.flatnonzero(read)):
            old = result.fits.get(index)
            if old is not None and old.misfit <= GOOD_MISFIT and old.is_converged:
                continue
            near = _neighbours(result.fits, index)
            if not near or _is_same(near, tried.get(index)):
                continue
            tried[index] = near
            fit = _fit_blurred(reader, result.view, index, near, time, exposure)
            if fit is not None and (old is None or fit.residual < old.residual):
                result.fits[index] = fit


def _is_same(near: dict[int, RingFit], before: dict[int, RingFit] | None) -> bool:
    """Tell whether the fits around a frame are the ones it was tried with before."""
    return before is not None and near.keys() == before.keys() and all(near[i] is before[i] for i in near)


def fit_open_gaps(reader: FilmReader, result: FilmResult, time: Floats, read: Flags) -> None:
    """Fit the frames again in which the gap is not Hertz's, with the factor of the gap free.

    What no gap explains in one frame none explains in those after it, unless they leave more.
    """
    vain, last = 0.0, -_SAME_DOUBT
    for index in map(int, np.flatnonzero(read)):
        old = result.fits.get(index)
        if index in reader.damaged or (old is not None and not is_doubtful(old)):
            continue
        if old is not None and index - last < _SAME_DOUBT and old.misfit < _NO_WORSE * vain:
            continue
        near = _neighbours(result.fits, index)
        frame = reader.whole(index)
        is_poor = old is not None and old.misfit > GOOD_MISFIT  # it may have another radius than the contact
        blank = look_without_fringes(Looks(frame), result.view) if is_poor else result.blanks.get(index)
        edges = () if blank is None else blank.edges
        starts = [old.parameters.copy()] if old is not None else []
        if near:
            beside = min(near, key=lambda other: abs(other - index))
            start = near[beside].parameters.copy()
            start[Parameter.RADIUS] = max(expected_radius(near, index, time)[0], 1.0)
            starts.append(start)
        starts += [start_at_edge(edge, result.view) for edge in edges if shows_rings(frame, result.view, edge)]
        fit = fit_open_gap(frame, result.view, starts, old)
        if fit is not None and (old is not None or not near or _continues(fit, near, index, time)):
            result.fits[index] = fit
        if old is not None:
            vain, last = (old.misfit, index) if fit is None else (0.0, index)


def _continues(fit: RingFit, near: dict[int, RingFit], index: int, time: Floats) -> bool:
    """Tell whether a fit lies where the contacts of frames close by are, as large as expected."""
    beside = near[min(near, key=lambda other: abs(other - index))]
    radius, x, y = (float(fit.parameters[p]) for p in _CIRCLE)
    usual, usual_x, usual_y = (float(beside.parameters[p]) for p in _CIRCLE)
    change = abs(radius - expected_radius(near, index, time)[0])
    away = math.hypot(x - usual_x, y - usual_y)
    return change < _MOST_CHANGE * usual and away < _SAME_CENTRE * radius


def _neighbours(fits: dict[int, RingFit], index: int) -> dict[int, RingFit]:
    """Believable fits of frames close by, when one of them is next to the frame."""
    near = {
        other: fits[other]
        for other in range(index - _NEIGHBOURS, index + _NEIGHBOURS + 1)
        if other != index and other in fits and fits[other].misfit <= GOOD_MISFIT
    }
    return near if {index - 1, index + 1} & near.keys() else {}


def _fit_blurred(
    reader: FilmReader, view: View, index: int, near: dict[int, RingFit], time: Floats, exposure: Floats | None
) -> RingFit | None:
    """Best fit of a frame from the radius and the travel that its neighbours tell."""
    beside = min(near, key=lambda other: abs(other - index))
    start = near[beside].parameters.copy()
    start[Parameter.SCALE] = 0.0
    radius, rate = expected_radius(near, index, time)
    if not radius > 0.0:
        return None
    edge = edge_width(radius, view.optics)
    travels = [edge * share for share in _UNKNOWN_TRAVELS]
    if exposure is not None and math.isfinite(rate):
        travels.insert(0, abs(rate) * float(exposure[index]))
    frame = reader.whole(index)
    # What served the contact beside it serves this film.
    view = view.served_by(near[beside].free)
    best = fit_at(frame, view, float(start[Parameter.X]), float(start[Parameter.Y]))
    for travel in travels:
        if best is not None and best.misfit <= GOOD_MISFIT:
            break
        start[Parameter.RADIUS], start[Parameter.SMEAR] = radius, travel**2
        fit = fit_from(frame, view, start)
        if fit is None:
            continue
        settings = replace(view.settings, free=fit.free)
        fit = fit_contact(frame, fit.parameters, view.optics, settings, view.levels)
        is_right = (
            fit is not None
            and fit.is_converged
            and abs(float(fit.parameters[Parameter.RADIUS]) - radius) < 0.5 * radius
            and is_contact(frame, view, fit)
        )
        if fit is not None and is_right and (best is None or fit.residual < best.residual):
            best = fit
    return best


def expected_radius(near: dict[int, RingFit], index: int, time: Floats) -> tuple[float, float]:
    """Radius (px) in a frame and its rate of change (px/s) from the frames around it.

    The square of the radius goes with the approach of the bodies and is smooth in time; a
    parabola is laid through it.
    """
    frames = sorted(near, key=lambda other: (abs(other - index), other))[:4]
    t = np.array([time[other] - time[index] for other in frames])
    squares = np.array([float(near[other].parameters[Parameter.RADIUS]) ** 2 for other in frames])
    if len(frames) == 1 or np.ptp(t) == 0.0:
        return math.sqrt(squares[0]), math.nan
    span = float(np.abs(t).max())
    degree = min(2, len(frames) - 1)
    bend = np.polynomial.Polynomial.fit(t / span, squares, degree, domain=(-1.0, 1.0))
    square = max(float(bend(0.0)), 0.0)
    radius = math.sqrt(square)
    if radius == 0.0:
        return 0.0, math.nan
    return radius, float(bend.deriv()(0.0)) / span / (2.0 * radius)

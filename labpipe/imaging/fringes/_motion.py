"""Motion of a contact from frame to frame: fits from the neighbours, contact or not, acceleration in the exposure.

The square of the radius goes with the approach of the bodies and is smooth in time, so that the frames before and
after a frame predict its radius and the rate and acceleration with which it changes.
"""

import math
from dataclasses import replace

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.films import FilmReader
from labpipe.imaging.fringes._dark_disc import look_without_fringes, runs_of
from labpipe.imaging.fringes._edge import corrected_radius
from labpipe.imaging.fringes._film_result import FilmResult
from labpipe.imaging.fringes._frame_features import FrameFeatures
from labpipe.imaging.fringes._open_gap import fit_open_gap, has_free_gap, is_doubtful
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import Parameter, RingFit, fit_contact
from labpipe.imaging.fringes._ring_model import edge_width
from labpipe.imaging.fringes._search import GOOD_MISFIT, fit_at, fit_from, is_contact

#: Radius, in Newton spots, from which a contact is beyond doubt: the spot of a sphere without load is smaller.
_BEYOND_DOUBT = 2.0
#: Share of the usual visibility of the fringes of a film below which those of a small contact are no contact's.
_FAINT = 0.3
#: Frames that a small contact lasts, and frames with fringes that tell their usual visibility.
_LASTS, _SEVERAL = 3, 5


def fit_from_neighbours(
    reader: FilmReader, result: FilmResult, time: Floats, exposure: Floats | None, read: Flags
) -> None:
    """Fit frames again from what the frames around them predict: blurred ones (twice), and those of an open gap."""
    frames = list(map(int, np.flatnonzero(read)))
    for _ in range(2):
        for index in frames:
            old = result.fits.get(index)
            near = {} if old is not None and old.misfit <= GOOD_MISFIT and old.is_converged else _near(result, index)
            fit = _fit_blurred(reader, result.view, index, near, time, exposure) if near else None
            if fit is not None and (old is None or fit.residual < old.residual):
                result.fits[index] = fit
    for index in frames:
        old = result.fits.get(index)
        near = _near(result, index)
        if index in reader.damaged or (old is not None and not is_doubtful(old)) or (old is None and not near):
            continue
        starts = [old.parameters.copy()] if old is not None else []
        if near:
            start = near[min(near, key=lambda other: abs(other - index))].parameters.copy()
            start[Parameter.RADIUS] = max(predicted_radius(near, index, time)[0], 1.0)
            starts.append(start)
            for edge in result.blanks[index].edges if index in result.blanks else ():
                starts.append(start.copy())
                starts[-1][Parameter.RADIUS] = corrected_radius(edge, result.view.optics)[0]
        fit = fit_open_gap(reader.whole(index), result.view, starts, old)
        if fit is not None and old is None:  # it must lie where the contacts of frames close by are, and be as large
            other = near[min(near, key=lambda other: abs(other - index))]
            is_large = abs(fit.radius - predicted_radius(near, index, time)[0]) < 0.5 * other.radius
            fit = fit if is_large and math.dist(fit.centre, other.centre) < 0.3 * fit.radius else None
        if fit is not None:
            result.fits[index] = fit


def _near(result: FilmResult, index: int) -> dict[int, RingFit]:
    """Believable fits of three frames before and after, when one of them is next to the frame."""
    others = (other for other in range(index - 3, index + 4) if other != index and other in result.fits)
    near = {other: result.fits[other] for other in others if result.fits[other].misfit <= GOOD_MISFIT}
    return near if {index - 1, index + 1} & near.keys() else {}


def predicted_radius(near: dict[int, RingFit], index: int, time: Floats) -> tuple[float, float]:
    """Radius (px) in a frame and its rate of change (px/s) by a parabola through a² in four frames around it."""
    frames = sorted(near, key=lambda other: (abs(other - index), other))[:4]
    t = np.array([time[other] - time[index] for other in frames])
    squares = np.array([near[other].radius ** 2 for other in frames])
    if len(frames) == 1 or np.ptp(t) == 0.0:
        return math.sqrt(squares[0]), math.nan
    span = float(np.abs(t).max())
    bend = np.polynomial.Polynomial.fit(t / span, squares, min(2, len(frames) - 1), domain=(-1.0, 1.0))
    radius = math.sqrt(max(float(bend(0.0)), 0.0))
    return (radius, float(bend.deriv()(0.0)) / span / (2.0 * radius)) if radius else (0.0, math.nan)


def _fit_blurred(
    reader: FilmReader, view: View, index: int, near: dict[int, RingFit], time: Floats, exposure: Floats | None
) -> RingFit | None:
    """Best fit of a frame from the radius and the travel that its neighbours predict."""
    start = near[min(near, key=lambda other: abs(other - index))].parameters.copy()
    start[Parameter.SCALE] = 0.0
    radius, rate = predicted_radius(near, index, time)
    if not radius > 0.0:
        return None
    travels = [share * edge_width(radius, view.optics) for share in (1.5, 4.0)]  # where nothing predicts it
    if exposure is not None and math.isfinite(rate):
        travels.insert(0, abs(rate) * float(exposure[index]))
    frame = reader.whole(index)
    best = fit_at(frame, view, start[Parameter.X], start[Parameter.Y])
    for travel in travels:
        if best is not None and best.misfit <= GOOD_MISFIT:
            break
        start[Parameter.RADIUS], start[Parameter.SMEAR] = radius, travel**2
        fit = fit_from(frame, view, start)
        if fit is None:
            continue
        fit = fit_contact(frame, fit.parameters, view.optics, replace(view.settings, free=fit.free), view.white)
        is_right = fit is not None and fit.is_converged and abs(fit.radius - radius) < 0.5 * radius
        if fit is not None and is_right and is_contact(frame, view, fit):
            best = fit if best is None or fit.residual < best.residual else best
    return best


def decide_contacts(reader: FilmReader, result: FilmResult, time: Floats) -> None:
    """Take small contacts that do not agree with the frames around them for a sphere that touches or hovers.

    A contact grows from nothing and returns to it within its duration. In coherent light a sphere that hovers differs
    from one that touches by the phase of its rings only, so that a single frame does not decide: a contact of up to two
    Newton spots counts when it lasts for three frames or belongs to one that grows larger, and its fringes are as
    clear as those of the other contacts.
    """
    view = result.view
    runs = runs_of(sorted(result.fits.keys() | set(map(int, np.flatnonzero(result.resting)))))
    visibility = {index: fit.visibility(view.black) for index, fit in result.fits.items()}
    usual = float(np.median(list(visibility.values()))) if len(visibility) >= _SEVERAL else 0.0
    for run in runs:
        fitted = [index for index in run if index in result.fits]
        largest = max((result.fits[index].radius for index in fitted), default=math.inf)
        is_small = largest < _BEYOND_DOUBT * view.optics.newton_spot
        is_brief = len(run) < _LASTS < len(time)
        for index in fitted if is_small else ():
            if is_brief or visibility[index] < _FAINT * usual:
                fit = result.fits.pop(index)
                result.undecided[index] = fit.radius + 2.0 * fit.deviation(Parameter.RADIUS)
                result.blanks[index] = look_without_fringes(FrameFeatures(reader.whole(index)), view)


def allow_for_acceleration(reader: FilmReader, result: FilmResult, time: Floats, exposure: Floats | None) -> None:
    """Allow for the acceleration of the radius within the exposure.

    A frame is the mean over its exposure e. The fit lets a² change evenly; a second derivative of a² shifts the mean,
    and with it the radius by e² (a²)''/(48 a) at a turn of the motion, more where the radius travels over fringes.
    Its estimate from the frames around enters the model of the frame, and its uncertainty that of the radius.
    """
    before = dict(result.fits)
    for index, fit in before.items():
        half = 0.0 if exposure is None else 0.5 * float(exposure[index])
        bend, u = _bend(before, index, time, half, fit)
        width = edge_width(fit.radius, result.view.optics)
        # mean of t² over the exposure is 1/3; where the travel is wider than a fringe its ends decide, where t² is 1
        far = (fit.travel / width) ** 4
        share = (1.0 / 6.0 + far / (1.0 + far) / 3.0) / max(fit.radius, 1.0)
        moved = fit
        if fit.travel > 0.25 * width and abs(bend) > 0.0 and not has_free_gap(fit):
            start = fit.parameters.copy()
            start[Parameter.BEND] = bend
            settings = replace(result.view.settings, free=fit.free)
            again = fit_contact(reader.whole(index), start, result.view.optics, settings, result.view.white)
            moved = again if again is not None and again.is_converged and again.misfit < GOOD_MISFIT else fit
        if moved is fit:
            moved = replace(fit, parameters=fit.parameters.copy())
            moved.parameters[Parameter.RADIUS] -= share * bend
            moved.parameters[Parameter.BEND] = bend
        else:
            share = max(share, abs(moved.radius - fit.radius) / abs(bend))
        result.fits[index] = replace(moved, model_deviation=max(fit.model_deviation, moved.model_deviation))
        # where it travels by more than itself it begins or ends within the exposure
        result.motion[index] = max(share * u, 0.3 * fit.travel * (fit.travel > fit.radius))


def _bend(fits: dict[int, RingFit], index: int, time: Floats, half: float, fit: RingFit) -> tuple[float, float]:
    """Half of (a²)'' times the square of half the exposure (px²), and its standard uncertainty.

    By a cubic through the four frames of the contact that are nearest in time; what a parabola through three of them
    differs by, and noise, make the uncertainty. Without so many frames the radius may change evenly as well as its
    square, which differ by a quarter of the square of the travel.
    """
    near = sorted((other for other in range(index - 3, index + 4) if other in fits), key=lambda k: (abs(k - index), k))
    usual = float(np.median(np.diff(time))) if len(time) > 1 else math.inf
    near = [other for other in near if abs(time[other] - time[index]) < 8.0 * max(usual, 2.0 * half)][:4]
    if len(near) < 3 or not half > 0.0 or len({time[other] for other in near}) < len(near):
        return 0.0, 0.25 * fit.travel**2
    t = np.array([(time[other] - time[index]) / half for other in near])
    squares = np.array([fits[other].radius ** 2 for other in near])
    noise = np.array(
        [2.0 * fits[o].radius * math.hypot(fits[o].deviation(Parameter.RADIUS), fits[o].model_deviation) for o in near]
    )
    parabola = _second_derivative(t[:3])
    bend = 0.5 * float(parabola @ squares[:3])
    if len(near) == 3:
        return bend, math.hypot(0.5 * float(np.linalg.norm(parabola * noise[:3])), 0.5 * bend)
    cubic = _second_derivative(t)
    better = 0.5 * float(cubic @ squares)
    return better, math.hypot(0.5 * float(np.linalg.norm(cubic * noise)), 0.5 * (better - bend), 0.05 * better)


def _second_derivative(t: Floats) -> Floats:
    """Weights of values at several times in the second derivative at 0 of the polynomial through them."""
    return np.asarray(2.0 * np.linalg.inv(np.vander(t, increasing=True))[2])

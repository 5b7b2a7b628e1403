"""Measure the contact in every frame of a film: frame selection, start values, acceptance."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats
from labpipe.frames import FrameSource
from labpipe.imaging.films import FilmReader, Place, frames_in_windows, plan_reading, without_stuck_pixels
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT, is_contact
from labpipe.imaging.fringes._arguments import FilmOptions, exposure_times
from labpipe.imaging.fringes._blank_frames import FilmResult, choose_edges, find_filled, look_without_fringes
from labpipe.imaging.fringes._calibration import calibrate
from labpipe.imaging.fringes._interference import Optics, make_optics
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._misfit import weigh_misfits
from labpipe.imaging.fringes._open_gap import fit_open_gap, is_doubtful
from labpipe.imaging.fringes._optics_search import OtherOptics, rebase
from labpipe.imaging.fringes._radial_scan import edge_width
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit, fit_contact
from labpipe.imaging.fringes._ring_parameters import BEAMS, COATING, HARMONICS, LIGHT, USUAL, Parameter
from labpipe.imaging.fringes._rows_of_contacts import leave_out_rows
from labpipe.imaging.fringes._scale_of_contacts import scales_of_contacts
from labpipe.imaging.fringes._search import Vain, fit_at, search_contact
from labpipe.imaging.fringes._trial_fits import fit_from, start_at_edge
from labpipe.imaging.fringes._view import View

#: Wavelength assumed for the edge of the spot when it is not known: the middle of white light.
NOMINAL_WAVELENGTH = 550e-9
#: Finest fringes used (px). The model averages over pixels, so that fringes count down to where
#: they alias.
LEAST_SPACING = 2.0
#: Shorter films are read whole; of longer ones, frames this far apart are looked at first.
_SHORT_FILM, _FIRST_STEPS = 96, (64, 16, 4)
#: Frames of a film that is calibrated from a few of them when of so many of its first contacts so many
#: are not explained; those few, evenly spread, and how many of them must show a contact.
_LONG_FILM, _DOUBTS, _DOUBTED, _PILOTS, _ENOUGH = 20, 3, 2, 12, 8
#: Distance (px) below which two contacts count as in one place.
_SAME_PLACE = 8.0
#: Change of the radius over a stretch of rest, as a share of it, above which it is no rest.
_REST_CHANGE = 0.01
#: Jump of the radius (px) up to which a fit is started from the frame before.
_SMALL_JUMP = 2.0
#: A contact beside another differs from what is expected by this share of the other's radius at
#: most, and its centre lies within this share of its own radius from the other's.
_MOST_CHANGE, _SAME_CENTRE = 0.5, 0.3
#: Share of its longer side below which the shorter side of a frame makes it a strip.
_STRIP = 0.25
_CIRCLE = (Parameter.RADIUS, Parameter.X, Parameter.Y)
#: Frames after one that no gap explains in which none is sought, and what they leave at most against it.
_SAME_DOUBT, _NO_WORSE = 16, 1.2
#: Frames before and after from which motion is estimated.
_NEIGHBOURS = 3
#: Travel in the exposure, in widths of the first bright ring, tried when nothing tells it.
_UNKNOWN_TRAVELS = (1.5, 4.0)


def measure_film(film: FrameSource, options: FilmOptions) -> FilmResult:
    """Find the contact in every frame.

    Parameters
    ----------
    film : FrameSource
        The film.
    options : FilmOptions
        Checked arguments.
    """
    reader = FilmReader(film)
    wanted = np.asarray(film.valid, bool).copy()
    if options.windows is not None:
        wanted &= frames_in_windows(film.time, options.windows)
    film, stuck = without_stuck_pixels(film, wanted, reader.whole)
    if stuck.count:
        reader = FilmReader(film)
    view = _make_view(reader, options, wanted)
    result = FilmResult(view, np.zeros(len(film), bool))
    result.stuck = stuck
    result.is_phase_given = options.phase is not None
    result.has_fringes = options.wavelength is not None and view.templates is not None
    if result.has_fringes:
        read = _follow_film(reader, result, options, wanted)
        _repair(reader, result, film.time, exposure_times(film, options), read)
        _open_gaps(reader, result, film.time, read)
        weigh_misfits(reader, result)
    else:
        for index in map(int, np.flatnonzero(wanted)):
            result.blanks[index] = look_without_fringes(Looks(reader.whole(index)), view)
    broken = np.flatnonzero(~np.asarray(film.valid, bool))
    result.lost_rows = reader.lost_rows
    result.damaged = reader.damaged | set(map(int, broken))
    result.leave_out(reader.damaged)
    choose_edges(result)
    leave_out_rows(reader, result)
    find_filled(result)
    result.scales = scales_of_contacts(reader, result)
    result.work = reader.work() | {
        "fits": len(result.fits),
        "evaluations": sum(fit.evaluations for fit in result.fits.values()),
    }
    return result


def _make_view(reader: FilmReader, options: FilmOptions, wanted: Flags) -> View:
    """Optics and settings before the calibration from the film."""
    film = reader.film
    wavelength = NOMINAL_WAVELENGTH if options.wavelength is None else options.wavelength
    phase = math.pi if options.phase is None else options.phase
    optics = make_optics(options.pixel_size, options.sphere_radius, wavelength, phase)
    free: tuple[Parameter, ...] = USUAL
    if options.shape == "ellipse":
        free = (*USUAL, Parameter.STRETCH, Parameter.SHEAR)
    axes = (Parameter.STRETCH, Parameter.SHEAR)
    oblique = (axes, (*axes, Parameter.SCALE)) if _shape(film, options) == "auto" else ()
    turned = (COATING,) if options.phase is None else ()
    both = ((*axes, *BEAMS),) if oblique else ()
    alternatives = ((Parameter.BLUR,), *oblique, (Parameter.SCALE,), BEAMS, LIGHT, (*LIGHT, *BEAMS), *turned, *both)
    settings = FitSettings(options.fringes, LEAST_SPACING, free)
    black, white = film.levels
    if wanted.any() and reader.whole(int(wanted.argmax())).dtype.kind == "f":
        # Nothing tells from where numbers that are no counts are saturated.
        white = math.inf
    return View(optics, settings, (film.shape[1], film.shape[2]), black, white, alternatives=alternatives)


def _shape(film: FrameSource, options: FilmOptions) -> str:
    """Return the shape that contacts may have.

    A thin strip shows rings in one direction, where an ellipse is not told from another scale: it is
    the scale that is asked for, or a wrong one would be drawn as an oblique view.
    """
    is_strip = min(film.shape[1:]) < _STRIP * max(film.shape[1:])
    return "circle" if is_strip and options.shape == "auto" else options.shape


def _follow_film(reader: FilmReader, result: FilmResult, options: FilmOptions, wanted: Flags) -> Flags:
    """Fit the frames that need it; learn about the optics on the way. Return the frames read."""
    read = wanted
    fits: dict[int, RingFit] = {}
    stated = result.view.optics
    other = OtherOptics(result, is_phase_free=options.phase is None)
    if not options.full and wanted.sum() > _SHORT_FILM:
        read, fits = _gate(reader, result, wanted, other)
    count = int(read.sum())
    is_long = count >= _LONG_FILM
    fits = _follow(reader, result, read, fits, other, stated if is_long else None)
    pilots: dict[int, RingFit] = {}
    few = np.zeros_like(read)
    if is_long and _is_doubted(result, fits, stated):
        few[np.flatnonzero(read)[np.linspace(0, count - 1, _PILOTS).round().astype(int)]] = True
        pilots = _follow(reader, result, few, {i: fit for i, fit in fits.items() if few[i]}, other)
        fits |= pilots
    if len(pilots) >= _ENOUGH:
        # What is found once holds for all frames: they are fitted once, with it.
        pilots = _calibrate(reader, result, few, pilots, options, stated)
        fits = _follow(reader, result, read, pilots, None)
    else:
        fits = _follow(reader, result, read, fits, other) if few.any() else fits
        fits = _calibrate(reader, result, read, fits, options, stated)
    result.log_scale = math.log(result.view.optics.phase_scale / stated.phase_scale)
    result.fits = fits
    opened = _doubtful_rest(result)
    if opened.any():
        result.resting &= ~opened
        result.fits |= _follow(reader, result, opened, {}, None)
    return read | opened


def _is_doubted(result: FilmResult, fits: dict[int, RingFit], stated: Optics) -> bool:
    """Tell whether the first contacts of a film are not explained by the optics as they are stated."""
    first = [fits[index] for index in sorted(fits)[:_DOUBTS]]
    usual = result.view.settings.free
    unexplained = sum(fit.model_deviation > 0.0 or fit.free != usual for fit in first)
    return len(first) == _DOUBTS and (unexplained >= _DOUBTED or result.view.optics != stated)


def _calibrate(
    reader: FilmReader, result: FilmResult, read: Flags, fits: dict[int, RingFit], options: FilmOptions, stated: Optics
) -> dict[int, RingFit]:
    """Calibrate the optics from the fits of some frames; fit these anew where that changes the optics."""
    rebase(result, fits)
    optics = result.view.optics
    rough = (
        *((Parameter.PHASE,) if optics.phase != stated.phase else ()),
        *((Parameter.SCALE,) if optics.phase_scale != stated.phase_scale else ()),
    )
    result.calibration = calibrate(
        reader.whole,
        fits,
        result.view,
        is_phase_free=options.phase is None,
        shape=_shape(reader.film, options),
        rough=rough,
        log_stated=math.log(stated.phase_scale / optics.phase_scale),
    )
    if result.calibration.is_usual and optics == stated:
        return fits
    before, result.view = result.view, result.calibration.applied(result.view)
    return _refit(reader, result, read, fits, stays_blank=_has_same_rings(before, result.view))


def _has_same_rings(one: View, other: View) -> bool:
    """Tell whether rings lie at the same radii and are fitted by as many parameters.

    A blur or harmonics change how a ring looks, not where it is: what showed no contact shows none then.
    """
    radii = [(v.optics.phase, v.optics.phase_scale, v.optics.flat, v.ellipse) for v in (one, other)]
    return radii[0] == radii[1] and set(other.settings.free) <= set(one.settings.free)


def _doubtful_rest(result: FilmResult) -> Flags:
    """Frames taken for rest that do not lie between two contacts of nearly the same radius."""
    doubtful = np.zeros(len(result.resting), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], result.resting.astype(np.int8), [0]])))
    for first, end in edges.reshape(-1, 2):
        before, after = result.fits.get(int(first) - 1), result.fits.get(int(end))
        is_rest = False
        if before is not None and after is not None:
            one, other = (float(fit.parameters[Parameter.RADIUS]) for fit in (before, after))
            is_rest = abs(one - other) < _REST_CHANGE * one
        doubtful[first:end] = not is_rest
    return doubtful


def _gate(
    reader: FilmReader, result: FilmResult, wanted: Flags, other: OtherOptics
) -> tuple[Flags, dict[int, RingFit]]:
    """Look at frames far apart, then at thin bands of all others; return what to read whole."""
    known: dict[int, RingFit | None] = {}
    frames = np.flatnonzero(wanted)
    for step in _FIRST_STEPS:
        for index in map(int, frames[::step]):
            looks = Looks(reader.whole(index))
            if index not in known:
                known[index] = search_contact(looks, result.view, None, None, partial(other.explains, looks, index))
            if all(fit is None for fit in known.values()) and other.learns_from(looks, index):
                known = {before: search_contact(Looks(reader.whole(before)), result.view) for before in known}
        if any(fit is not None for fit in known.values()) or other.takes_single():
            known = {i: fit or search_contact(Looks(reader.whole(i)), result.view) for i, fit in known.items()}
            break
    fits = {index: fit for index, fit in known.items() if fit is not None}
    contact = {index: fit is not None for index, fit in known.items()}
    places = [_place_of(fit, result.view) for fit in fits.values()]
    plan = plan_reading(reader, wanted, contact, _distinct(places))
    result.resting = plan.is_resting
    return plan.read, fits


def _place_of(fit: RingFit, view: View) -> Place:
    """Where and how bright a contact is."""
    p = fit.parameters
    light, modulation = float(p[Parameter.GAIN]), float(p[Parameter.MODULATION])
    inside = light + modulation * math.cos(view.optics.phase)
    return Place(float(p[Parameter.X]), float(p[Parameter.Y]), inside, 0.5 * (inside + light))


def _distinct(places: list[Place]) -> list[Place]:
    """Leave out places that lie close to one before: a few bands see all contacts."""
    chosen: list[Place] = []
    for place in places:
        near = (abs(place.x - old.x) + abs(place.y - old.y) < _SAME_PLACE for old in chosen)
        if not any(near):
            chosen.append(place)
    return chosen


def _follow(
    reader: FilmReader,
    result: FilmResult,
    read: Flags,
    known: dict[int, RingFit],
    other: OtherOptics | None,
    stated: Optics | None = None,
) -> dict[int, RingFit]:
    """Fit frame after frame, each from what the frames before it showed.

    While none is explained, ``other`` looks for optics that explain them, and all is begun anew
    when it finds some. With optics as they are ``stated`` it ends early when these are doubted.
    """
    view = result.view
    fits: dict[int, RingFit] = {}
    last: RingFit | None = None
    before: RingFit | None = None
    vain = Vain()
    for index in map(int, np.flatnonzero(read)):
        fit = known.get(index)
        if fit is None:
            looks = Looks(reader.whole(index))
            if last is None and not known and other is not None:
                fit = search_contact(looks, view, None, vain, partial(other.explains, looks, index))
            else:
                fit = _next_fit(looks, view, last, before, vain)
        if fit is None:
            if last is None and not known and other is not None and other.learns_from(looks, index):
                return _follow(reader, result, read, {}, None, stated)
            result.blanks[index] = look_without_fringes(looks, view)
            before = None
        else:
            result.blanks.pop(index, None)  # of an earlier round with other optics
            fits[index] = fit
            last, before = fit, fits.get(index - 1)
            if stated is not None and len(fits) == _DOUBTS and _is_doubted(result, fits, stated):
                return fits
    if not fits and other is not None and other.takes_single():
        return _follow(reader, result, read, {}, None)
    for index in () if other is None else other.passed(fits):
        fit = _next_fit(Looks(reader.whole(index)), view, last, None, vain)
        if fit is not None:
            result.blanks.pop(index, None)
            fits[index] = fit
    return fits


def _next_fit(looks: Looks, view: View, last: RingFit | None, before: RingFit | None, vain: Vain) -> RingFit | None:
    """Fit a frame from the last contact if it is like it, from its centre, or from nothing."""
    if last is None:
        return search_contact(looks, view, None, vain)
    if before is not None:
        fit = _warm_fit(looks.frame, view, last)
        if fit is not None:
            return fit
    centre = (float(last.parameters[Parameter.X]), float(last.parameters[Parameter.Y]))
    # What served the last contact serves this film: what it cannot fit is something else.
    extra = tuple(p for p in last.free if p not in view.settings.free)
    view = replace(view, alternatives=(extra,) if extra else ())
    return search_contact(looks, view, centre, vain)


def _warm_fit(frame: NDArray[np.generic], view: View, last: RingFit) -> RingFit | None:
    """Fit from the parameters of the frame before; None when the contact has changed more."""
    settings = replace(view.settings, free=last.free, max_iterations=8)
    fit = fit_contact(frame, last.parameters, view.optics, settings, view.levels)
    if fit is None or not fit.is_converged:
        return None
    jump = abs(float(fit.parameters[Parameter.RADIUS] - last.parameters[Parameter.RADIUS]))
    is_like = jump < _SMALL_JUMP and fit.misfit <= max(GOOD_MISFIT, 1.2 * last.misfit)
    return fit if is_like and is_contact(frame, view, fit) else None


def _refit(
    reader: FilmReader, result: FilmResult, read: Flags, fits: dict[int, RingFit], *, stays_blank: bool
) -> dict[int, RingFit]:
    """Fit all frames again with the optics calibrated from the film.

    ``stays_blank`` leaves out the frames in which nothing was found before.
    """
    view = result.view
    known = result.blanks.copy() if stays_blank else {}
    result.blanks.clear()
    found: dict[int, RingFit] = {}
    last: RingFit | None = None
    vain = Vain()
    for index in map(int, np.flatnonzero(read)):
        if index in known:
            result.blanks[index] = known[index]
            continue
        looks = Looks(reader.whole(index))
        fit: RingFit | None = None
        if index in fits:
            start = fits[index].parameters.copy()
            start[Parameter.PHASE], start[Parameter.SCALE] = view.optics.phase, 0.0
            start[Parameter.BLUR] = 0.0
            start[list(HARMONICS)] = view.harmonics
            if Parameter.STRETCH not in view.settings.free:
                start[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
            fit = fit_contact(looks.frame, start, view.optics, view.settings, view.levels)
            if fit is not None and (not _explains(fit, fits[index]) or not is_contact(looks.frame, view, fit)):
                fit = None
        fit = fit or _next_fit(looks, view, last, None, vain)
        if fit is None:
            result.blanks[index] = look_without_fringes(looks, view)
        else:
            found[index] = last = fit
    return found


def _explains(fit: RingFit, before: RingFit) -> bool:
    """Tell whether a fit leaves little, or no more than one before it, so that no search would leave less."""
    return fit.misfit <= max(GOOD_MISFIT, before.misfit)


def _repair(reader: FilmReader, result: FilmResult, time: Floats, exposure: Floats | None, read: Flags) -> None:
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


def _open_gaps(reader: FilmReader, result: FilmResult, time: Floats, read: Flags) -> None:
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
        starts += [start_at_edge(edge, result.view) for edge in edges]
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

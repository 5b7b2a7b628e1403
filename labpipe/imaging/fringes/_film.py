"""Measurement of the contact in every frame of a film: the frames that are read, and the order of their fits."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags
from labpipe.frames import FrameSource
from labpipe.imaging.films import FilmReader, Place, frames_in_windows, plan_reading, without_stuck_pixels
from labpipe.imaging.fringes._adhesive_edge import NOMINAL_WAVELENGTH
from labpipe.imaging.fringes._arguments import FilmOptions, exposure_times
from labpipe.imaging.fringes._calibration import calibrate
from labpipe.imaging.fringes._dark_disc import choose_edges, find_filled, look_without_fringes
from labpipe.imaging.fringes._film_result import FilmResult
from labpipe.imaging.fringes._frame_features import FrameFeatures
from labpipe.imaging.fringes._motion import allow_for_acceleration, decide_contacts, fit_from_neighbours
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import AXES, LIGHT, USUAL, FitSettings, Parameter, RingFit, fit_contact
from labpipe.imaging.fringes._ring_model import make_optics
from labpipe.imaging.fringes._search import GOOD_MISFIT, is_contact, search_contact

#: Shorter films are read whole; of longer ones, frames this far apart are looked at first.
_SHORT_FILM, _FIRST_STEPS = 96, (64, 16, 4)


def measure_film(film: FrameSource, options: FilmOptions) -> FilmResult:
    """Find the contact in every frame of a film, with checked arguments."""
    reader = FilmReader(film)
    wanted = np.asarray(film.valid, bool).copy()
    if options.windows is not None:
        wanted &= frames_in_windows(film.time, options.windows)
    repaired, hot = without_stuck_pixels(film, wanted, reader.whole)
    if hot.count:
        reader = FilmReader(repaired)
    view = _make_view(reader, options, wanted)
    result = FilmResult(view, np.zeros(len(film), bool), hot_pixels=hot.count)
    result.has_fringes = options.wavelength is not None and view.templates is not None
    if result.has_fringes:
        read = _follow_film(reader, result, options, wanted)
        exposure = exposure_times(film, options)
        fit_from_neighbours(reader, result, film.time, exposure, read)
        decide_contacts(reader, result, film.time)
        allow_for_acceleration(reader, result, film.time, exposure)
    else:
        for index in map(int, np.flatnonzero(wanted)):
            result.blanks[index] = look_without_fringes(FrameFeatures(reader.whole(index)), view)
    broken = np.flatnonzero(~np.asarray(film.valid, bool))
    result.damaged = reader.damaged | set(map(int, broken))
    for index in reader.damaged:
        result.blanks.pop(index, None)
        result.fits.pop(index, None)
    choose_edges(result, any_disc=options.any_disc)
    find_filled(result)
    evaluations = sum(fit.evaluations for fit in result.fits.values())
    result.work = reader.work() | {"fits": len(result.fits), "evaluations": evaluations}
    return result


def _make_view(reader: FilmReader, options: FilmOptions, wanted: Flags) -> View:
    """Optics and settings before the calibration from the film."""
    film = reader.film
    wavelength = NOMINAL_WAVELENGTH if options.wavelength is None else options.wavelength
    phase = math.pi if options.phase is None else options.phase
    optics = make_optics(options.pixel_size, options.sphere_radius, wavelength, phase)
    free = (*USUAL, *AXES) if options.shape == "ellipse" else USUAL
    oblique = (AXES,) if _may_be_oblique(film, options) else ()
    settings = FitSettings(options.fringes, free=free)
    black, white = film.levels
    if wanted.any() and reader.whole(int(wanted.argmax())).dtype.kind == "f":
        white = math.inf  # numbers that are no counts do not show where they are saturated
    alternatives = (*oblique, (Parameter.SCALE,), LIGHT)
    return View(optics, settings, (film.shape[1], film.shape[2]), black, white, alternatives=alternatives)


def _may_be_oblique(film: FrameSource, options: FilmOptions) -> bool:
    """Tell whether contacts may be ellipses when the film says so.

    A strip four times as long as wide shows rings in one direction, where an ellipse cannot be distinguished from
    another scale: it is the scale that is asked for, or a wrong one would be taken for an oblique view.
    """
    return options.shape == "auto" and 4 * min(film.shape[1:]) >= max(film.shape[1:])


def _follow_film(reader: FilmReader, result: FilmResult, options: FilmOptions, wanted: Flags) -> Flags:
    """Fit the frames that need it, and calibrate the optics on the way. Return the frames read."""
    read = wanted
    fits: dict[int, RingFit] = {}
    if not options.full and wanted.sum() > _SHORT_FILM:
        read, fits = _gate(reader, result, wanted)
    fits = _follow(reader, result, read, fits)
    if not fits and options.phase is None:
        fits = _with_other_phase(reader, result, read)
    is_auto, is_phase_free = _may_be_oblique(reader.film, options), options.phase is None
    result.calibration = calibrate(reader.whole, fits, result.view, is_phase_free=is_phase_free, is_auto=is_auto)
    stated = math.pi if options.phase is None else options.phase
    if not result.calibration.is_usual or result.view.optics.phase != stated:
        result.view = result.calibration.applied(result.view)
        fits = _refit(reader, result, read, fits)
    result.fits = fits
    opened = _doubtful_rest(result)
    if opened.any():
        result.resting &= ~opened
        result.fits |= _follow(reader, result, opened, {})
    return read | opened


def _doubtful_rest(result: FilmResult) -> Flags:
    """Frames taken for rest that do not lie between contacts of nearly the same radius, or next to one that moves.

    Bands of rows show no change of up to a hundred uncertainties of the radius: where it turns it was not at rest.
    """
    doubtful = np.zeros(len(result.resting), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], result.resting.astype(np.int8), [0]])))
    for first, end in edges.reshape(-1, 2).tolist():
        before, after = result.fits.get(first - 1), result.fits.get(end)
        is_rest = before is not None and after is not None
        if before is not None and after is not None:
            around = [result.fits[k] for k in (*range(first - 6, first), *range(end, end + 6)) if k in result.fits]
            u = [math.hypot(fit.deviation(Parameter.RADIUS), before.deviation(Parameter.RADIUS)) for fit in around]
            moves = any(abs(fit.radius - before.radius) > 5.0 * u[k] for k, fit in enumerate(around))
            is_rest = abs(before.radius - after.radius) < 0.01 * before.radius and not moves
        doubtful[first:end] = not is_rest
    return doubtful


def _gate(reader: FilmReader, result: FilmResult, wanted: Flags) -> tuple[Flags, dict[int, RingFit]]:
    """Look at frames far apart, then at thin bands of all others; return what to read whole."""
    known: dict[int, RingFit | None] = {}
    frames = np.flatnonzero(wanted)
    for step in _FIRST_STEPS:
        for index in map(int, frames[::step]):
            if index not in known:
                known[index] = search_contact(FrameFeatures(reader.whole(index)), result.view)
        if any(fit is not None for fit in known.values()):
            break
    fits = {index: fit for index, fit in known.items() if fit is not None}
    contact = {index: fit is not None for index, fit in known.items()}
    places: list[Place] = []
    for index, fit in fits.items():
        place = _place_of(reader.whole(index), fit)
        if all(abs(place.x - old.x) + abs(place.y - old.y) > 8.0 for old in places):  # a few bands see all contacts
            places.append(place)
    plan = plan_reading(reader, wanted, contact, places)
    result.resting = plan.is_resting
    return plan.read, fits


def _place_of(frame: NDArray[np.generic], fit: RingFit) -> Place:
    """Position and brightness of a contact: its optics may differ from the stated ones, its frame shows it."""
    (x, y), light = fit.centre, fit.value(Parameter.GAIN)
    rows, columns = np.ogrid[: frame.shape[0], : frame.shape[1]]
    inside = frame[(columns - x) ** 2 + (rows - y) ** 2 < max(0.7 * fit.radius, 1.0) ** 2]
    return Place(x, y, fit.radius, float(np.median(inside.astype(float))) if inside.size else light, light)


def _follow(reader: FilmReader, result: FilmResult, read: Flags, known: dict[int, RingFit]) -> dict[int, RingFit]:
    """Fit frame after frame, each from what the frames before it showed."""
    fits: dict[int, RingFit] = {}
    last: RingFit | None = None
    for index in map(int, np.flatnonzero(read)):
        fit = known.get(index)
        if fit is None:
            features = FrameFeatures(reader.whole(index))
            fit = _next_fit(features, result.view, last, fits.get(index - 1))
            if fit is None:
                result.blanks[index] = look_without_fringes(features, result.view)
                continue
        result.blanks.pop(index, None)
        fits[index] = last = fit
    return fits


def _next_fit(features: FrameFeatures, view: View, last: RingFit | None, one: RingFit | None = None) -> RingFit | None:
    """Fit a frame as the one before it, from the centre of the last contact, or from nothing."""
    if last is None:
        return search_contact(features, view)
    if one is not None:
        fit = _warm_fit(features.frame, view, one)
        if fit is not None:
            return fit
    if last.free == view.settings.free:
        # The usual fit serves this film: what it cannot fit is something else.
        view = replace(view, alternatives=())
    return search_contact(features, view, last.centre)


def _warm_fit(frame: NDArray[np.generic], view: View, one: RingFit) -> RingFit | None:
    """Fit from the frame before; None when the contact has changed by more than two pixels."""
    settings = replace(view.settings, free=one.free, max_iterations=8)
    fit = fit_contact(frame, one.parameters, view.optics, settings, view.white)
    if fit is None or not fit.is_converged:
        return None
    is_like = abs(fit.radius - one.radius) < 2.0 and fit.misfit <= max(GOOD_MISFIT, 1.2 * one.misfit)
    return fit if is_like and is_contact(frame, view, fit) else None


def _with_other_phase(reader: FilmReader, result: FilmResult, read: Flags) -> dict[int, RingFit]:
    """Look for contacts that are neither dark nor bright, in some two dozen of the frames."""
    optics = replace(result.view.optics, phase=result.view.optics.phase - 0.5 * math.pi)
    view = replace(result.view, optics=optics)
    places = np.flatnonzero(read)
    found = ((i, search_contact(FrameFeatures(reader.whole(i)), view)) for i in places[:: max(1, len(places) // 24)])
    fits = {int(index): fit for index, fit in found if fit is not None}
    if fits:
        result.view = view
    return fits


def _refit(reader: FilmReader, result: FilmResult, read: Flags, fits: dict[int, RingFit]) -> dict[int, RingFit]:
    """Fit all frames again with the calibrated optics."""
    view = result.view
    result.blanks.clear()
    found: dict[int, RingFit] = {}
    last: RingFit | None = None
    for index in map(int, np.flatnonzero(read)):
        features = FrameFeatures(reader.whole(index))
        fit: RingFit | None = None
        if index in fits:
            start = fits[index].parameters.copy()
            start[Parameter.PHASE], start[Parameter.SCALE] = view.optics.phase, 0.0
            if not set(AXES) & set(view.settings.free):
                start[list(AXES)] = view.ellipse
            fit = fit_contact(features.frame, start, view.optics, view.settings, view.white)
            if fit is not None and (fit.misfit > GOOD_MISFIT or not is_contact(features.frame, view, fit)):
                fit = None
        fit = fit or _next_fit(features, view, last)
        if fit is None:
            result.blanks[index] = look_without_fringes(features, view)
        else:
            found[index] = last = fit
    return found

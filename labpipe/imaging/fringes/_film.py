"""Measurement of the contact in every frame of a film: the frames that are read, and the order of their fits."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags
from labpipe.frames import FrameSource
from labpipe.imaging.films import LONGEST_REST, FilmReader, Place, plan_reading, without_stuck_pixels
from labpipe.imaging.fringes._adhesive_edge import NOMINAL_WAVELENGTH
from labpipe.imaging.fringes._arguments import FilmOptions, exposure_times
from labpipe.imaging.fringes._calibration import PROPERTIES, Calibration, Properties, calibrate
from labpipe.imaging.fringes._dark_disc import choose_edges, find_filled, look_without_fringes, runs_of
from labpipe.imaging.fringes._film_result import FilmResult
from labpipe.imaging.fringes._frame_features import FrameFeatures
from labpipe.imaging.fringes._model_selection import begin_from
from labpipe.imaging.fringes._motion import allow_for_acceleration, decide_contacts, fit_from_neighbours
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._ring_fit import ASSUMED, AXES, USUAL, FitSettings, Parameter, RingFit, fit_contact
from labpipe.imaging.fringes._ring_model import make_optics
from labpipe.imaging.fringes._search import GOOD_MISFIT, is_contact, search_contact, search_optics

#: Frames in which other optics than the stated ones are looked for.
_TRIED = 6


def measure_film(film: FrameSource, options: FilmOptions) -> FilmResult:
    """Find the contact in every frame of a film, with checked arguments."""
    reader = FilmReader(film)
    wanted = np.asarray(film.valid, bool).copy()
    repaired, hot = without_stuck_pixels(film, wanted, reader.whole)
    if hot.count:
        reader = FilmReader(repaired)
    # optics and settings before the calibration from the film
    wavelength = NOMINAL_WAVELENGTH if options.wavelength is None else options.wavelength
    phase = math.pi if options.phase is None else options.phase
    optics = make_optics(options.pixel_size, options.sphere_radius, wavelength, phase)
    settings = FitSettings(options.fringes, free=(*USUAL, *AXES) if options.shape == "ellipse" else USUAL)
    black, white = reader.film.levels
    if wanted.any() and reader.whole(int(wanted.argmax())).dtype.kind == "f":
        white = math.inf  # numbers that are no counts do not show where they are saturated
    view = View(optics, settings, (reader.film.shape[1], reader.film.shape[2]), black, white)
    has_fringes = options.wavelength is not None and view.templates is not None
    result = FilmResult(view, np.zeros(len(film), bool), note=hot.note, has_fringes=has_fringes)
    if result.has_fringes:
        read = _follow_film(reader, result, options, wanted)
        exposure = exposure_times(film, options)
        fit_from_neighbours(reader, result, film.time, exposure, read)
        decide_contacts(reader, result, film.time)
        allow_for_acceleration(reader, result, film.time, exposure)
    else:
        for index in map(int, np.flatnonzero(wanted)):
            result.blanks[index] = look_without_fringes(FrameFeatures(reader.whole(index)), view)
    result.damaged = reader.damaged | set(map(int, np.flatnonzero(~np.asarray(film.valid, bool))))
    for index in reader.damaged:
        result.blanks.pop(index, None)
        result.fits.pop(index, None)
    choose_edges(result, any_disc=options.any_disc)
    find_filled(result)
    fits = result.fits.values()
    result.work = reader.work() | {"fits": len(fits), "evaluations": sum(fit.evaluations for fit in fits)}
    return result


def _follow_film(reader: FilmReader, result: FilmResult, options: FilmOptions, wanted: Flags) -> Flags:
    """Fit the frames that need it, and calibrate the optics on the way. Return the frames read."""
    read = wanted
    fits: dict[int, RingFit] = {}
    if not options.full and wanted.sum() > LONGEST_REST:
        read, fits = _gate(reader, result, wanted)
    fits = _follow(reader, result, read, fits)
    # in a strip four times as long as wide an ellipse cannot be distinguished from another scale
    is_round = options.shape != "auto" or 4 * min(reader.film.shape[1:]) < max(reader.film.shape[1:])
    is_left_out = {AXES: is_round, (Parameter.PHASE,): options.phase is not None}
    properties = tuple(group for group in PROPERTIES if not is_left_out.get(group, False))
    stated = result.view
    known = _search_optics(reader, result, fits, properties)
    if not known.is_usual:
        result.view = known.applied(stated)
        fits = _follow(reader, result, read, {})
    result.calibration, _ = calibrate(reader.whole, fits, stated, known, properties)
    view = result.calibration.applied(stated)
    if view != result.view:
        result.view = view
        fits = _follow(reader, result, read, fits)
    result.fits = fits
    # Bands of rows show no change of up to a hundred uncertainties of the radius: frames taken for rest that do not lie
    # between contacts of nearly the same radius, or next to one that moves, were not at rest.
    opened = np.zeros(len(result.resting), bool)
    for run in runs_of(np.flatnonzero(result.resting).tolist()):
        first, end = run[0], run[-1] + 1
        around = [result.fits[k] for k in (*range(first - 6, first), *range(end, end + 6)) if k in result.fits]
        radii = np.array([fit.radius for fit in around])
        noise = max((fit.deviation(Parameter.RADIUS) for fit in around), default=0.0)
        is_bounded = first - 1 in result.fits and end in result.fits
        opened[run] = not is_bounded or np.ptp(radii) > min(7.0 * noise, 0.01 * radii.max())
    if opened.any():
        result.resting &= ~opened
        result.fits |= _follow(reader, result, opened, {})
    return read | opened


def _gate(reader: FilmReader, result: FilmResult, wanted: Flags) -> tuple[Flags, dict[int, RingFit]]:
    """Look at frames far apart, then at thin bands of all others; return what to read whole."""
    known: dict[int, RingFit | None] = {}
    frames = np.flatnonzero(wanted)
    step = LONGEST_REST
    while step > 1 and not any(known.values()):
        for index in map(int, frames[::step]):
            if index not in known:
                known[index] = search_contact(FrameFeatures(reader.whole(index)), result.view)
        step //= 4
    fits = {index: fit for index, fit in known.items() if fit is not None}
    contact = {index: fit is not None for index, fit in known.items()}
    places: list[Place] = []
    for index, fit in fits.items():
        frame, (x, y), light = reader.whole(index), fit.centre, fit.value(Parameter.GAIN)
        rows, columns = np.ogrid[: frame.shape[0], : frame.shape[1]]
        # its optics may differ from the stated ones: its frame shows how bright it is
        inside = frame[(columns - x) ** 2 + (rows - y) ** 2 < max(0.7 * fit.radius, 1.0) ** 2]
        place = Place(x, y, fit.radius, float(np.median(inside.astype(float))) if inside.size else light, light)
        if all(abs(place.x - old.x) + abs(place.y - old.y) > 8.0 for old in places):  # a few bands see all contacts
            places.append(place)
    plan = plan_reading(reader, wanted, contact, places)
    result.resting = plan.is_resting
    return plan.read, fits


def _follow(reader: FilmReader, result: FilmResult, read: Flags, starts: dict[int, RingFit]) -> dict[int, RingFit]:
    """Fit frame after frame, each from what is known of it, from the frame before it, or from nothing.

    ``starts`` are fits of some frames, perhaps with other optics. The frame before is left out where the radius changes
    by two pixels from frame to frame.
    """
    fits: dict[int, RingFit] = {}
    last: RingFit | None = None
    for index in map(int, np.flatnonzero(read)):
        features = FrameFeatures(reader.whole(index))
        likely, before = starts.get(index), fits.get(index - 1)
        usual = result.view.settings
        fit = None if likely is None else _fit_again(features.frame, result.view, likely, usual, math.inf)
        earlier = fits.get(index - 2, before)
        if fit is None and before is not None and earlier is not None and abs(before.radius - earlier.radius) < 2.0:
            quick = replace(usual, free=before.free, max_iterations=8)
            fit = _fit_again(features.frame, result.view, before, quick, 2.0)
        if fit is None:
            fit = search_contact(features, result.view, None if last is None else last.centre)
        if fit is None:
            result.blanks[index] = look_without_fringes(features, result.view)
        else:
            result.blanks.pop(index, None)
            fits[index] = last = fit
    return fits


def _fit_again(
    frame: NDArray[np.generic], view: View, one: RingFit, settings: FitSettings, most: float
) -> RingFit | None:
    """Fit a contact that is like another one, its radius changed by so much at most (px)."""
    fit = fit_contact(frame, begin_from(one.parameters, view, settings.free), view.optics, settings, view.white)
    if fit is None or not (fit.is_converged or most == math.inf):
        return None
    is_like = abs(fit.radius - one.radius) < most and fit.misfit <= max(GOOD_MISFIT, 1.2 * one.misfit)
    return fit if is_like and is_contact(frame, view, fit) else None


def _search_optics(
    reader: FilmReader, result: FilmResult, fits: dict[int, RingFit], properties: Properties
) -> Calibration:
    """Look for other optics in some frames whose spots are larger than any contact that the stated ones explain.

    Two of them must agree in phase and scale, where there are more than two, so that no sphere that hovers decides.
    """
    largest = max((fit.radius for fit in fits.values()), default=0.0)
    spots = {
        index: max((edge.half_radius for edge in blank.edges), default=0.0) for index, blank in result.blanks.items()
    }
    frames = [index for index, radius in spots.items() if radius > 1.2 * largest]
    found: list[Calibration] = []
    for index in frames[:: max(1, len(frames) // _TRIED)]:
        one = search_optics(FrameFeatures(reader.whole(index)), result.view, properties)
        if one is None:
            continue
        for other in found:
            turn, scale = (one.changes.get(p, 0.0) - other.changes.get(p, 0.0) for p in ASSUMED)
            if abs(math.remainder(turn, math.pi)) < 0.4 and abs(scale) < 0.03:
                return one
        if len(frames) < 3:
            return one
        found.append(one)
    return Calibration()

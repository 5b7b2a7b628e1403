"""Measure the contact in every frame of a film: which frames are read, with which optics, in what order."""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags
from labpipe.frames import FrameSource
from labpipe.imaging.films import (
    FilmReader,
    Place,
    frames_in_windows,
    plan_reading,
    without_reflection,
    without_stuck_pixels,
)
from labpipe.imaging.fringes._acceptance import GOOD_MISFIT
from labpipe.imaging.fringes._adhesive_edge import NOMINAL_WAVELENGTH
from labpipe.imaging.fringes._arguments import FilmOptions, exposure_times
from labpipe.imaging.fringes._blank_frames import (
    FilmResult,
    choose_edges,
    count_patterned,
    find_filled,
    look_without_fringes,
)
from labpipe.imaging.fringes._calibration import calibrate
from labpipe.imaging.fringes._coherence import fades_early
from labpipe.imaging.fringes._frame_by_frame import follow, is_doubted, leave_faint, refit
from labpipe.imaging.fringes._interference import Optics, make_optics
from labpipe.imaging.fringes._looks import Looks
from labpipe.imaging.fringes._misfit import weigh_misfits
from labpipe.imaging.fringes._neighbours import fit_blurred_frames, fit_open_gaps
from labpipe.imaging.fringes._optics_search import OtherOptics, rebase
from labpipe.imaging.fringes._ring_fit import FitSettings, RingFit
from labpipe.imaging.fringes._ring_parameters import AXES, BEAMS, COATING, LIGHT, USUAL, Parameter
from labpipe.imaging.fringes._rows_of_contacts import leave_out_rows
from labpipe.imaging.fringes._scale_of_contacts import scales_of_contacts
from labpipe.imaging.fringes._search import search_contact
from labpipe.imaging.fringes._view import View

#: Finest fringes used (px). The model averages over pixels, so that fringes count down to where
#: they alias.
_LEAST_SPACING = 2.0
#: Shorter films are read whole; of longer ones, frames this far apart are looked at first.
_SHORT_FILM, _FIRST_STEPS = 96, (64, 16, 4)
#: Frames of a film that is calibrated from a few of them when its first contacts are not explained;
#: those few, evenly spread, and how many of them must show a contact.
_LONG_FILM, _PILOTS, _ENOUGH = 20, 12, 8
#: Contacts that tell whether fringes fade as in white light.
_FIRST = 3
#: Share of the radius within which a contact is as bright as it is.
_WELL_INSIDE = 0.7
#: Distance (px) below which two contacts count as in one place.
_SAME_PLACE = 8.0
#: Change of the radius over a stretch of rest, as a share of it, above which it is no rest.
_REST_CHANGE = 0.01
#: Frames beside a rest that tell whether the contact moves there, and standard deviations by which it does.
_BESIDE, _MOVED = 6, 5.0
#: Share of its longer side below which the shorter side of a frame makes it a strip.
_STRIP = 0.25
#: A film that is explained, see :func:`_left`.
_NOTHING_LEFT = (0, 0.0)


def measure_film(film: FrameSource, options: FilmOptions) -> FilmResult:
    """Find the contact in every frame of a film, with checked arguments."""
    reader = FilmReader(film)
    wanted = np.asarray(film.valid, bool).copy()
    if options.windows is not None:
        wanted &= frames_in_windows(film.time, options.windows)
    film, stuck = without_stuck_pixels(film, wanted, reader.whole)
    if stuck.count:
        reader = FilmReader(film)
    result = _measured(reader, options, wanted)
    if _left(result) != _NOTHING_LEFT:
        unreflected, reflecting = without_reflection(film, wanted, reader.whole)
        other = _measured(FilmReader(unreflected), options, wanted) if reflecting else result
        if _left(other) < _left(result):
            result, other.reflecting = other, reflecting
    result.stuck = stuck
    return result


def _left(result: FilmResult) -> tuple[int, float]:
    """Frames in which fringes explain no contact, and the largest misfit of the others, where it is one."""
    misfits = [fit.misfit for fit in result.fits.values() if fit.misfit > GOOD_MISFIT]
    return len(result.blanks), max(misfits, default=0.0)


def _measured(reader: FilmReader, options: FilmOptions, wanted: Flags) -> FilmResult:
    """Find the contact in every frame of a film whose pixels follow the scene."""
    film = reader.film
    view = _make_view(reader, options, wanted)
    result = FilmResult(view, np.zeros(len(film), bool))
    result.is_phase_given = options.phase is not None
    result.has_fringes = options.wavelength is not None and view.templates is not None
    read = _follow_film(reader, result, options, wanted) if result.has_fringes else wanted
    if result.has_fringes:
        leave_faint(reader, result)
        fit_blurred_frames(reader, result, film.time, exposure_times(film, options), read)
        fit_open_gaps(reader, result, film.time, read)
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
    count_patterned(reader, result)
    result.scales = scales_of_contacts(reader, result, view)
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
        free = (*USUAL, *AXES)
    is_oblique = _shape(film, options) == "auto"
    oblique, both = ((AXES,), ((*AXES, *BEAMS),)) if is_oblique else ((), ())
    turned = (COATING,) if options.phase is None else ()
    alternatives = ((Parameter.BLUR,), *oblique, (Parameter.SCALE,), BEAMS, LIGHT, (*LIGHT, *BEAMS), *turned, *both)
    settings = FitSettings(options.fringes, _LEAST_SPACING, free)
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
    fits = follow(reader, result, read, fits, other, stated if is_long else None)
    if _fade_early(reader, result, fits):
        result.has_fringes = False
        result.resting[:] = False
        return wanted
    pilots: dict[int, RingFit] = {}
    few = np.zeros_like(read)
    if is_long and is_doubted(result, fits, stated):
        few[np.flatnonzero(read)[np.linspace(0, count - 1, _PILOTS).round().astype(int)]] = True
        pilots = follow(reader, result, few, {i: fit for i, fit in fits.items() if few[i]}, other)
        fits |= pilots
    if len(pilots) >= _ENOUGH:
        # What is found once holds for all frames: they are fitted once, with it.
        pilots = _calibrate(reader, result, few, pilots, options, stated)
        fits = follow(reader, result, read, pilots, None)
    else:
        fits = follow(reader, result, read, fits, other) if few.any() else fits
        fits = _calibrate(reader, result, read, fits, options, stated)
    result.log_scale = math.log(result.view.optics.phase_scale / stated.phase_scale)
    result.fits = fits
    opened = _doubtful_rest(result)
    if opened.any():
        result.resting &= ~opened
        result.fits |= follow(reader, result, opened, {}, None)
    return read | opened


def _fade_early(reader: FilmReader, result: FilmResult, fits: dict[int, RingFit]) -> bool:
    """Tell whether most of the first contacts show that fringes fade as in white light."""
    first = sorted(fits)[:_FIRST]
    return 2 * sum(fades_early(reader.whole(i), result.view, fits[i]) for i in first) > len(first)


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
    worst = max(fits[index].misfit for index in result.calibration.frames)
    before, result.view = result.view, result.calibration.applied(result.view).known_to(worst)
    return refit(reader, result, read, fits, stays_blank=_has_same_rings(before, result.view))


def _has_same_rings(one: View, other: View) -> bool:
    """Tell whether rings lie at the same radii and are fitted by as many parameters.

    A blur or harmonics change how a ring looks, not where it is: what showed no contact shows none then.
    """
    radii = [(v.optics.phase, v.optics.phase_scale, v.optics.flat, v.ellipse) for v in (one, other)]
    return radii[0] == radii[1] and set(other.settings.free) <= set(one.settings.free)


def _doubtful_rest(result: FilmResult) -> Flags:
    """Frames taken for rest that do not lie between two contacts of nearly the same radius, or beside one that moves.

    Bands of rows show no change of up to a hundred standard uncertainties of the radius: where it turns round
    it was not at rest.
    """
    doubtful = np.zeros(len(result.resting), bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], result.resting.astype(np.int8), [0]])))
    for first, end in edges.reshape(-1, 2).tolist():
        before, after = result.fits.get(first - 1), result.fits.get(end)
        is_rest = False
        if before is not None and after is not None:
            one, other = (float(fit.parameters[Parameter.RADIUS]) for fit in (before, after))
            beside = ((before, range(first - _BESIDE, first)), (after, range(end, end + _BESIDE)))
            is_moving = any(_moves(fit, result.fits.get(k)) for fit, frames in beside for k in frames)
            is_rest = abs(one - other) < _REST_CHANGE * one and not is_moving
        doubtful[first:end] = not is_rest
    return doubtful


def _moves(one: RingFit, other: RingFit | None) -> bool:
    """Tell whether two contacts differ in their radii, and not by chance."""
    if other is None:
        return False
    change = abs(float(one.parameters[Parameter.RADIUS] - other.parameters[Parameter.RADIUS]))
    return change > _MOVED * math.hypot(one.deviation(Parameter.RADIUS), other.deviation(Parameter.RADIUS))


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
                known[index] = search_contact(looks, result.view)
            if all(fit is None for fit in known.values()) and other.learns_from(looks, index):
                known = {before: search_contact(Looks(reader.whole(before)), result.view) for before in known}
        if any(fit is not None for fit in known.values()) or other.takes_single():
            known = {i: fit or search_contact(Looks(reader.whole(i)), result.view) for i, fit in known.items()}
            break
    fits = {index: fit for index, fit in known.items() if fit is not None}
    contact = {index: fit is not None for index, fit in known.items()}
    places = [_place_of(reader.whole(index), fit) for index, fit in fits.items()]
    plan = plan_reading(reader, wanted, contact, _distinct(places))
    result.resting = plan.is_resting
    return plan.read, fits


def _place_of(frame: NDArray[np.generic], fit: RingFit) -> Place:
    """Where a contact is, and how bright: its optics may be others than stated, its frame shows it."""
    x, y, radius, light = fit.parameters[[Parameter.X, Parameter.Y, Parameter.RADIUS, Parameter.GAIN]].tolist()
    rows, columns = np.ogrid[: frame.shape[0], : frame.shape[1]]
    inside = frame[(columns - x) ** 2 + (rows - y) ** 2 < max(_WELL_INSIDE * radius, 1.0) ** 2]
    return Place(x, y, radius, float(np.median(inside)) if inside.size else light, light)


def _distinct(places: list[Place]) -> list[Place]:
    """Leave out places that lie close to one before: a few bands see all contacts."""
    chosen: list[Place] = []
    for place in places:
        near = (abs(place.x - old.x) + abs(place.y - old.y) < _SAME_PLACE for old in chosen)
        if not any(near):
            chosen.append(place)
    return chosen

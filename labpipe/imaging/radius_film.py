"""Measure the contact in every frame of a film: which frames, from where, and what to believe."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from labpipe.errors import InputError
from labpipe.frames import FrameSource
from labpipe.imaging.contact_edge import Edge, find_edge
from labpipe.imaging.contact_search import (
    GOOD_MISFIT,
    MOST_MISFIT,
    View,
    fit_at,
    fit_from,
    has_structure,
    is_contact,
    search_contact,
)
from labpipe.imaging.contact_spot import find_spots
from labpipe.imaging.fringe_calibration import Calibration, calibrate
from labpipe.imaging.fringes import make_optics
from labpipe.imaging.gating import FilmReader, frames_in_windows, plan_reading
from labpipe.imaging.radial_scan import edge_width
from labpipe.imaging.radius_fit import USUAL, FitSettings, Parameter, RingFit, fit_contact

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Wavelength assumed for the edge of the spot when it is not known: the middle of white light.
NOMINAL_WAVELENGTH = 550e-9
#: Finest fringes used (px); below two they alias.
LEAST_SPACING = 3.0
#: Shorter films are read whole; of longer ones, frames this far apart are looked at first.
_SHORT_FILM, _FIRST_STEPS = 96, (64, 16, 4)
#: Frames looked at for a contact of unusual phase.
_PHASE_FRAMES = 24
#: Jump of the radius (px) up to which a fit is started from the frame before.
_SMALL_JUMP = 2.0
#: Frames before and after from which motion is estimated.
_NEIGHBOURS = 3
#: A spot without fringes next to a contact with fringes has an edge softer than this share of the
#: radius at most; one alone must be as sharp as this many widths of the first bright ring.
_SOFT_BESIDE, _SOFT_ALONE = 0.4, 1.5
#: Least radius, in Newton spots, of a spot without fringes: touching alone shows a smaller one.
_LEAST_SPOT = 1.5
#: Travel in the exposure, in widths of the first bright ring, tried when nothing tells it.
_UNKNOWN_TRAVELS = (1.5, 4.0)


@dataclass(frozen=True)
class FilmOptions:
    """Arguments of :func:`labpipe.imaging.contact_radius`, under the same names."""

    pixel_size: float
    sphere_radius: float
    wavelength: float | None
    exposure: float | NDArray[np.float64] | None = None
    phase: float | None = None
    shape: str = "auto"
    fringes: float = 3.0
    full: bool = False
    windows: tuple[tuple[float, float], ...] | None = None


@dataclass
class FilmResult:
    """What was found in a film.

    Attributes
    ----------
    view : View
        Optics as used.
    fits, edges : dict
        By frame: fits of the fringes, and edges where there are none.
    resting : bool array (frame,)
        Frames that look like the contacts before and after and were not read.
    calibration : Calibration
        What the film told about its optics.
    has_fringes : bool
        False when the wavelength is unknown or pixels are too coarse.
    work : dict
        Counts.
    """

    view: View
    resting: Flags
    fits: dict[int, RingFit] = field(default_factory=dict)
    edges: dict[int, Edge] = field(default_factory=dict)
    calibration: Calibration = field(default_factory=Calibration)
    has_fringes: bool = True
    work: dict[str, int] = field(default_factory=dict)


def check_film(film: FrameSource, options: FilmOptions) -> None:
    """Refuse arguments outside their range.

    Raises
    ------
    InputError
        With what was found and what was expected.
    """
    lengths = {
        "pixel_size": (options.pixel_size, 1e-9, 1e-3),
        "sphere_radius": (options.sphere_radius, 1e-6, 10.0),
    }
    if options.wavelength is not None:
        lengths["wavelength"] = (options.wavelength, 100e-9, 20e-6)
    for name, (value, low, high) in lengths.items():
        if not low <= value <= high:
            message = f"{name} must lie between {low:g} and {high:g} m, found {value} m"
            raise InputError(message)
    if options.shape not in {"auto", "circle", "ellipse"}:
        message = f'shape must be "auto", "circle" or "ellipse", found {options.shape!r}'
        raise InputError(message)
    if not 0.5 <= options.fringes <= 20.0:
        message = f"fringes must be between 0.5 and 20, found {options.fringes}"
        raise InputError(message)
    if options.phase is not None and not math.isfinite(options.phase):
        message = f"phase must be a finite angle in rad, found {options.phase}"
        raise InputError(message)
    if len(film.shape) != 3 or min(film.shape[1:]) < 16:
        message = f"frames must be grey images of 16 x 16 px or more, found {film.shape}"
        raise InputError(message)
    if options.exposure is not None:
        exposure = np.asarray(options.exposure, float)
        is_shaped = exposure.shape in {(), (len(film),)}
        if not is_shaped or not (np.isfinite(exposure) & (exposure >= 0.0)).all():
            message = (
                f"exposure must be one time in s or one per frame ({len(film)}), not negative; "
                f"found {options.exposure}"
            )
            raise InputError(message)


def exposure_times(film: FrameSource, options: FilmOptions) -> Floats | None:
    """Exposure time of every frame in s, from the caller or the film; None when unknown."""
    exposure = film.exposure if options.exposure is None else options.exposure
    if exposure is None:
        return None
    return np.broadcast_to(np.asarray(exposure, float), (len(film),))


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
    view = _make_view(film, options)
    wanted = np.asarray(film.valid, bool).copy()
    if options.windows is not None:
        wanted &= frames_in_windows(film.time, options.windows)
    result = FilmResult(view, np.zeros(len(film), bool))
    result.has_fringes = options.wavelength is not None and view.templates is not None
    if result.has_fringes:
        read = _follow_film(reader, result, options, wanted)
        _repair(reader, result, film.time, exposure_times(film, options), read)
    else:
        read = wanted
    _find_edges(reader, result, read)
    result.work = reader.work() | {
        "fits": len(result.fits),
        "evaluations": sum(fit.evaluations for fit in result.fits.values()),
    }
    return result


def _make_view(film: FrameSource, options: FilmOptions) -> View:
    """Optics and settings as they are before the film has told more."""
    wavelength = NOMINAL_WAVELENGTH if options.wavelength is None else options.wavelength
    phase = math.pi if options.phase is None else options.phase
    optics = make_optics(options.pixel_size, options.sphere_radius, wavelength, phase)
    free: tuple[Parameter, ...] = USUAL
    if options.shape == "ellipse":
        free = (*USUAL, Parameter.STRETCH, Parameter.SHEAR)
    settings = FitSettings(options.fringes, LEAST_SPACING, free)
    black, white = film.levels
    return View(
        optics,
        settings,
        (film.shape[1], film.shape[2]),
        black,
        white,
        may_be_elliptic=options.shape == "auto",
    )


def _follow_film(
    reader: FilmReader, result: FilmResult, options: FilmOptions, wanted: Flags
) -> Flags:
    """Fit the frames that need it; learn about the optics on the way. Return the frames read."""
    read = wanted
    fits: dict[int, RingFit] = {}
    if not options.full and wanted.sum() > _SHORT_FILM:
        read, fits = _gate(reader, result, wanted)
    fits = _follow(reader, result.view, read, fits)
    if not fits and options.phase is None:
        fits = _other_phase(reader, result, read)
    result.calibration = calibrate(
        reader.whole, fits, result.view, is_phase_free=options.phase is None, shape=options.shape
    )
    if not result.calibration.is_usual or result.view.optics.phase != _make_phase(options):
        result.view = result.calibration.applied(result.view)
        fits = _refit(reader, result.view, read, fits)
    result.fits = fits
    return read


def _make_phase(options: FilmOptions) -> float:
    return math.pi if options.phase is None else options.phase


def _gate(
    reader: FilmReader, result: FilmResult, wanted: Flags
) -> tuple[Flags, dict[int, RingFit]]:
    """Look at frames far apart, then at thin bands of all others; return what to read whole."""
    known: dict[int, RingFit | None] = {}
    places = np.flatnonzero(wanted)
    for step in _FIRST_STEPS:
        for index in map(int, places[::step]):
            if index not in known:
                known[index] = search_contact(reader.whole(index), result.view)
        if any(fit is not None for fit in known.values()):
            break
    fits = {index: fit for index, fit in known.items() if fit is not None}
    rows = [float(fit.parameters[Parameter.Y]) for fit in fits.values()]
    contact = {index: fit is not None for index, fit in known.items()}
    plan = plan_reading(reader, wanted, contact, rows)
    result.resting = plan.is_resting
    return plan.read, fits


def _follow(
    reader: FilmReader, view: View, read: Flags, known: dict[int, RingFit]
) -> dict[int, RingFit]:
    """Fit frame after frame, each from what the frames before it showed."""
    fits: dict[int, RingFit] = {}
    last: RingFit | None = None
    before: RingFit | None = None
    for index in map(int, np.flatnonzero(read)):
        fit = known.get(index) or _next_fit(reader.whole(index), view, last, before)
        if fit is not None:
            fits[index] = fit
            last, before = fit, fits.get(index - 1)
        else:
            before = None
    return fits


def _next_fit(
    frame: NDArray[np.generic], view: View, last: RingFit | None, before: RingFit | None
) -> RingFit | None:
    """Fit a frame from the last contact if it is like it, from its centre, or from nothing."""
    if last is None:
        return search_contact(frame, view)
    if before is not None:
        fit = _warm_fit(frame, view, last)
        if fit is not None:
            return fit
    centre = (float(last.parameters[Parameter.X]), float(last.parameters[Parameter.Y]))
    return search_contact(frame, view, centre)


def _warm_fit(frame: NDArray[np.generic], view: View, last: RingFit) -> RingFit | None:
    """Fit from the parameters of the frame before; None when the contact has changed more."""
    settings = replace(view.settings, free=last.free, max_iterations=8)
    fit = fit_contact(frame, last.parameters, view.optics, settings, view.white)
    if fit is None or not fit.is_converged:
        return None
    jump = abs(float(fit.parameters[Parameter.RADIUS] - last.parameters[Parameter.RADIUS]))
    is_like = jump < _SMALL_JUMP and fit.misfit <= max(GOOD_MISFIT, 1.2 * last.misfit)
    return fit if is_like and is_contact(frame, view, fit) else None


def _other_phase(reader: FilmReader, result: FilmResult, read: Flags) -> dict[int, RingFit]:
    """Look for contacts that are neither dark nor bright, in some of the frames."""
    optics = replace(result.view.optics, phase=result.view.optics.phase - 0.5 * math.pi)
    view = replace(result.view, optics=optics)
    places = np.flatnonzero(read)
    some = places[:: max(1, len(places) // _PHASE_FRAMES)]
    fits = {}
    for index in map(int, some):
        fit = search_contact(reader.whole(index), view)
        if fit is not None:
            fits[index] = fit
    if fits:
        result.view = view
    return fits


def _refit(
    reader: FilmReader, view: View, read: Flags, fits: dict[int, RingFit]
) -> dict[int, RingFit]:
    """Fit all frames again with the optics that the film has told."""
    found: dict[int, RingFit] = {}
    last: RingFit | None = None
    for index in map(int, np.flatnonzero(read)):
        frame = reader.whole(index)
        fit: RingFit | None = None
        if index in fits:
            start = fits[index].parameters.copy()
            start[Parameter.PHASE], start[Parameter.SCALE] = view.optics.phase, 0.0
            if Parameter.STRETCH not in view.settings.free:
                start[[Parameter.STRETCH, Parameter.SHEAR]] = view.ellipse
            fit = fit_contact(frame, start, view.optics, view.settings, view.white)
            if fit is not None and (fit.misfit > GOOD_MISFIT or not is_contact(frame, view, fit)):
                fit = None
        fit = fit or _next_fit(frame, view, last, None)
        if fit is not None:
            found[index] = last = fit
    return found


def _repair(
    reader: FilmReader,
    result: FilmResult,
    time: Floats,
    exposure: Floats | None,
    read: Flags,
) -> None:
    """Fit blurred frames again, starting from where their neighbours say the contact was.

    Twice, because a repaired frame helps its neighbours.
    """
    for _ in range(2):
        for index in map(int, np.flatnonzero(read)):
            old = result.fits.get(index)
            if old is not None and old.misfit <= GOOD_MISFIT and old.is_converged:
                continue
            near = _neighbours(result.fits, index)
            if not near:
                continue
            fit = _fit_blurred(reader, result.view, index, near, time, exposure)
            if fit is not None and (old is None or fit.residual < old.residual):
                result.fits[index] = fit


def _neighbours(fits: dict[int, RingFit], index: int) -> dict[int, RingFit]:
    """Believable fits of frames close by, when one of them is next to the frame."""
    near = {
        other: fits[other]
        for other in range(index - _NEIGHBOURS, index + _NEIGHBOURS + 1)
        if other != index and other in fits and fits[other].misfit <= GOOD_MISFIT
    }
    return near if {index - 1, index + 1} & near.keys() else {}


def _fit_blurred(
    reader: FilmReader,
    view: View,
    index: int,
    near: dict[int, RingFit],
    time: Floats,
    exposure: Floats | None,
) -> RingFit | None:
    """Best fit of a frame from the radius and the travel that its neighbours tell."""
    beside = min(near, key=lambda other: abs(other - index))
    start = near[beside].parameters.copy()
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
        fit = fit_contact(frame, fit.parameters, view.optics, view.settings, view.white)
        is_right = (
            fit is not None
            and fit.misfit <= MOST_MISFIT
            and fit.is_converged
            and abs(float(fit.parameters[Parameter.RADIUS]) - radius) < 0.5 * radius
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


def _find_edges(reader: FilmReader, result: FilmResult, read: Flags) -> None:
    """Measure the edge of spots in frames whose fringes could not be fitted."""
    for index in map(int, np.flatnonzero(read)):
        if index in result.fits:
            continue
        frame = reader.whole(index)
        if has_structure(frame):
            edge = _edge_in(frame, result, index)
            if edge is not None:
                result.edges[index] = edge


def _edge_in(frame: NDArray[np.generic], result: FilmResult, index: int) -> Edge | None:
    """Edge of the contact in a frame without usable fringes, or None when there is no contact."""
    view = result.view
    beside = result.fits.get(index - 1) or result.fits.get(index + 1)
    circles = [(spot.x, spot.y, spot.radius, spot.polarity) for spot in find_spots(frame)]
    wanted = -1
    if result.fits:
        known = beside or next(iter(result.fits.values()))
        wanted = -1 if known.parameters[Parameter.MODULATION] > 0.0 else 1
    for x, y, radius, polarity in circles:
        if polarity != wanted or radius < view.newton_spot:
            continue
        edge = find_edge(frame, x, y, radius, view.black)
        if edge is not None and _is_contact_edge(edge, view, result, beside):
            return edge
    return None


def _is_contact_edge(edge: Edge, view: View, result: FilmResult, beside: RingFit | None) -> bool:
    """Decide whether a round spot without fringes is a contact."""
    is_dark = edge.inside < edge.outside
    expected = not result.fits or is_dark == (
        next(iter(result.fits.values())).parameters[Parameter.MODULATION] > 0.0
    )
    if edge.half_radius < _LEAST_SPOT * view.newton_spot or not expected:
        return False
    if beside is None:
        sharp = _SOFT_ALONE * max(edge_width(edge.half_radius, view.optics), 1.0)
        return edge.softness <= max(sharp, 2.0)
    away = math.hypot(
        edge.x - float(beside.parameters[Parameter.X]),
        edge.y - float(beside.parameters[Parameter.Y]),
    )
    return edge.softness <= _SOFT_BESIDE * edge.half_radius and away < 0.3 * edge.half_radius

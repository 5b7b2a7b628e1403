"""Search for the contact in one frame, and the decision whether a fit shows one."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.imaging.fringes._calibration import Calibration, Properties, calibrate
from labpipe.imaging.fringes._frame_features import FrameFeatures, radial_profile
from labpipe.imaging.fringes._model_selection import begin_from, fit_frames
from labpipe.imaging.fringes._optics_state import View
from labpipe.imaging.fringes._point_contact_test import Window, is_edge, is_sphere, shows_only_sphere
from labpipe.imaging.fringes._ring_fit import AXES, OPTICAL, Parameter, RingFit, fit_contact, tabulate
from labpipe.imaging.fringes._ring_model import SAMPLES_PER_PIXEL, edge_width, ring_limits
from labpipe.imaging.fringes._templates import Match, any_matches, best_matches

#: Misfit from which another explanation is looked for, and from which a fit is not believed: 0.1 for other things.
GOOD_MISFIT, MOST_MISFIT = 0.04, 0.1
#: Radius, in Newton spots, up to which a contact is compared with a sphere that does not press.
_SMALL_CONTACT = 4.0


def search_contact(features: FrameFeatures, view: View, centre: tuple[float, float] | None = None) -> RingFit | None:
    """Find and fit the contact in a frame without knowing where it is; None when nothing shows its fringes.

    The ``centre`` (px) of the contact in other frames is tried first.
    """
    if not features.has_structure:
        return None
    frame = features.frame
    if centre is not None:
        found = fit_at(frame, view, *centre)
        if found is not None:
            return found
    sights = [(match, spot) for spot in features.centres for match in _matches_at(frame, view, spot.x, spot.y)]
    sights.sort(key=lambda sight: -sight[0].score)
    fits = (_fit_match(frame, view, match, spot.x, spot.y) for match, spot in sights[:3])
    return next((fit for fit in fits if fit is not None), None)


def _matches_at(frame: NDArray[np.generic], view: View, x: float, y: float) -> list[Match]:
    """Contacts that the rings around a point resemble: fringes explain a third of the variance of the profile."""
    templates = view.templates
    if templates is None:
        return []
    profile, counts = radial_profile(frame, x, y, templates.width, templates.bins)
    small = _SMALL_CONTACT * view.optics.newton_spot
    matches = []
    for match in best_matches(profile, counts, templates, view.optics.phase):
        if match.score < 1.0 / 3.0 or match.radius < view.least_radius:
            continue
        if match.radius > small and shows_only_sphere(profile, counts, templates.width, view.optics):
            continue
        window = Window(profile, counts, match.first, len(match.term))
        # the nearest template is up to a third of a ring off: an edge that leaves much less is believed at once, unless
        # a blur makes the first fringe one
        is_sharp = view.optics.blur < 0.25 * edge_width(match.radius, view.optics)
        if is_sharp and window.is_seen and is_edge(window, match.term, 0.4):
            continue
        distance = (np.arange(len(match.term), dtype=np.float64) + match.first + 0.5) * templates.width
        if match.radius < small and is_sphere(window, match.term, distance, view.optics):
            continue
        matches.append(match)
    return matches


def fit_at(frame: NDArray[np.generic], view: View, x: float, y: float) -> RingFit | None:
    """Fit the contact around a known centre (to about a pixel), of whatever radius."""
    fits = (_fit_match(frame, view, match, x, y) for match in _matches_at(frame, view, x, y))
    return next((found for found in fits if found is not None), None)


def _fit_match(frame: NDArray[np.generic], view: View, match: Match, x: float, y: float) -> RingFit | None:
    """Fit from a match, with some of the pixels until it proves to be a contact."""
    found = fit_from(frame, view, _start_of(match, view, x, y))
    if found is None or not is_contact(frame, view, found):
        return None
    final = fit_contact(frame, found.parameters, view.optics, replace(view.settings, free=found.free), view.white)
    return final if final is not None and is_clear(view, final) else None


def _start_of(match: Match, view: View, x: float, y: float) -> Floats:
    """Parameters of a match around a centre."""
    start = np.zeros(len(Parameter))
    start[Parameter.RADIUS], start[Parameter.SMEAR] = match.radius, match.variant.travel**2
    start[[Parameter.X, Parameter.Y]] = x, y
    start[[Parameter.GAIN, Parameter.MODULATION, Parameter.PHASE]] = match.gain, match.modulation, match.phase
    start[Parameter.SCALE], start[Parameter.BLUR] = match.variant.log_scale, match.variant.blur**2
    start[list(AXES)] = view.ellipse
    return start


def fit_from(frame: NDArray[np.generic], view: View, start: Floats) -> RingFit | None:
    """Fit part of the pixels, the first fringe before the finer ones farther out: it needs less of a start.

    Where Hertz's gap leaves too much its factor is free too: beside a body that recedes from a dent it opens less.
    """
    best: RingFit | None = None
    for free in (view.settings.free, (*view.settings.free, Parameter.SCALE)):
        quick = replace(view.settings.quick, free=free)
        first = fit_contact(frame, start, view.optics, replace(quick, fringes=1.0), view.white)
        if first is None or first.pixels < 200:
            return best
        fit = fit_contact(frame, first.parameters, view.optics, quick, view.white)
        if fit is None or fit.misfit < GOOD_MISFIT:
            return fit or best
        best, start = best or fit, start.copy()
        start[Parameter.SMEAR] = 0.0
    return best


def search_optics(features: FrameFeatures, view: View, properties: Properties) -> Calibration | None:
    """Find optics with which a frame that the stated ones leave unexplained shows a contact.

    The search starts from what explains the profile about a spot best, of fringes of every phase, of other scales, and
    blurred; all ``properties`` are calibrated from there, or those that this needs and then others.
    """
    if view.templates is None or not features.has_structure:
        return None
    frame, quick = features.frame, replace(view, settings=view.settings.quick)
    open_ = [p for group in properties for p in group if p not in OPTICAL[2:]]  # spread and flat are not needed
    tries: dict[float, tuple[RingFit, Calibration]] = {}  # the best start of each kind
    usual = view.templates
    for spot in features.centres:
        profile, counts = radial_profile(frame, spot.x, spot.y, usual.width, usual.bins)
        if shows_only_sphere(profile, counts, usual.width, view.optics):
            continue
        sizes = (spot.radius, 0.8 * spot.radius)  # the steepest ring lies up to a fifth outside the contact
        likely = (m for size in sizes for m in any_matches(profile, counts, usual, view.optics, size))
        for match in {(m.radius, m.variant): m for m in likely if m.score >= 0.5}.values():
            start = _start_of(match, view, spot.x, spot.y)
            turn = match.phase - view.optics.phase
            if Parameter.PHASE not in open_:
                start[Parameter.MODULATION] *= math.copysign(1.0, math.cos(turn))
            rough = {p: float(start[p]) for p in open_} | ({Parameter.PHASE: turn} if Parameter.PHASE in open_ else {})
            # where one kind of phase and scale explains nearly as much as another the stated one is likelier
            needed = {p: value for p, value in rough.items() if abs(value) > (0.5 if p is Parameter.PHASE else 0.0)}
            for known, most in ((Calibration(rough), GOOD_MISFIT), (Calibration(needed), 1.5 * MOST_MISFIT)):
                seen = known.applied(quick)
                fit = fit_from(frame, seen, begin_from(start, seen, ()))
                trial = None if fit is None else fit_frames([frame], [fit], seen, tuple(known.changes))
                least = tries[most][0].misfit if most in tries else most
                if trial is not None and trial.fits[0].misfit < least:
                    tries[most] = trial.fits[0], known
    explained: list[tuple[float, Calibration]] = []
    for fit, known in tries.values():
        found, best = calibrate(lambda _: frame, {0: fit}, quick, known, properties)
        final, seen = (fit if best is None else best.fits[0]), found.applied(view)
        is_large = final.misfit <= GOOD_MISFIT and final.radius > 2.0 * seen.optics.newton_spot
        if is_large and is_contact(frame, seen, final):
            explained.append((final.residual, found))
    return min(explained, key=lambda one: one[0])[1] if explained else None


def is_clear(view: View, found: RingFit) -> bool:
    """Tell whether a fit shows rings beyond doubt, around a circle that can be a contact.

    The radius is known to a tenth, the modulation to a tenth, at least 200 pixels are seen, and the visibility lies
    between 0.1 and 1.5: light is never negative, and clipped light was seen to fit with a fifth more than 1.
    """
    modulation = abs(found.value(Parameter.MODULATION))
    light = found.value(Parameter.GAIN) - view.black
    return (
        found.pixels >= 200
        and found.misfit <= MOST_MISFIT
        and light > 0.0
        and 0.1 * light <= modulation <= 1.5 * light
        and modulation >= 10.0 * found.deviation(Parameter.MODULATION)
        and found.radius > view.least_radius
        and 0.0 < found.deviation(Parameter.RADIUS) < 0.1 * found.radius
    )


def is_contact(frame: NDArray[np.generic], view: View, found: RingFit) -> bool:
    """Decide whether a fit shows a contact, and not a sphere close by, a soft edge or something else."""
    # at twice the radius there is no contact at the beginning of the exposure
    if not is_clear(view, found) or found.travel > 1.5 * found.radius:
        return False
    may_be_edge = found.travel > 0.5 * edge_width(found.radius, view.optics)
    is_small = found.radius < _SMALL_CONTACT * view.optics.newton_spot
    if not may_be_edge and not is_small:
        return True
    # the profile about the centre of the fit, and the term that was fitted
    settings = view.settings
    inner, outer = ring_limits(found.radius, view.optics, settings.fringes, settings.least_spacing)
    width = min(1.0, (outer - inner) / 24)
    first, last = math.ceil(inner / width), math.floor(outer / width)
    axes = found.value(Parameter.STRETCH), found.value(Parameter.SHEAR)
    profile, counts = radial_profile(frame, *found.centre, width, last, axes)
    start, table = tabulate((inner, outer), found.parameters, view.optics)
    distance = (np.arange(last - first, dtype=np.float64) + first + 0.5) * width
    term = np.interp((distance - start) * SAMPLES_PER_PIXEL, np.arange(table.shape[1]), table[0])
    window = Window(profile, counts, first, last - first)
    if not window.is_seen:
        return not may_be_edge
    if may_be_edge and is_edge(window, term, 2.0):
        return False
    return not (is_small and is_sphere(window, term, distance, view.optics))

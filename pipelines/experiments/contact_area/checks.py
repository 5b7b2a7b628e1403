"""Whether a film of a contact can be believed: its size, fringes, flights, and order of frames."""

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import hypot, inf, isfinite, log, nan, sqrt

import numpy as np
import xarray as xr

from labpipe.judging import (
    DOUBTFUL,
    SLIPS,
    Cause,
    Check,
    Level,
    bounded,
    compared,
    explain,
    in_words,
    not_made,
    stated,
    too_large,
)
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.contact_area._flight_checks import (
    begins_late,
    flights_alike,
    none_missed,
    restitution_by_radii,
)
from pipelines.experiments.contact_area._frame_checks import contacts_whole, frame_checks, none_lost, summits_seen
from pipelines.experiments.contact_area._image_checks import image_checks, in_view
from pipelines.experiments.contact_area.comparison import FRAMES, PLATE, SCALE, WAVELENGTH, plate_mass, rows
from pipelines.experiments.contact_area.measured import LATER, brightness, edges_only
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared import fall_checks, judgements
from pipelines.experiments.shared.alternatives import of_drop
from pipelines.experiments.shared.comparison_rows import Row
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.film_frames import CAUSES, explained, not_smoothed, whole_film
from pipelines.experiments.shared.film_light import exposed, lit, not_written
from pipelines.experiments.shared.film_stated import is_rate_used, of_rate, stated_twice
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title, times_over
from pipelines.experiments.shared.material_inputs import material_inputs
from pipelines.experiments.shared.plate_under_drop import OF_PLATE

_LASTS = 0.03
"""Relative, by which gravity and losses (restitutions of 0.4 to 0.93) change a contact's duration over a²."""
_LARGEST = 0.5
"""Contact radius over the sphere's above which no drop of a solid gets."""
_CLOCK = 1e-4
"""Relative uncertainty of the frame rate of a camera."""
_LIKE_MODEL = (1.6, 0.1)
"""Factor by which a contact radius may miss the model (a ~ E^-0.2: ten times in the modulus), and
the relative uncertainty of that."""
_LOSSES = 0.03
"""Relative difference of two following restitutions, of speed and of the ringing plate."""
_LOSSES_KNOWN = 1.03, 0.012
"""Where a model shows how restitution changes with speed: factor by which the first flight may miss what follows, and
its relative uncertainty, of a plate that swings and of another grade."""
_BY_RADII = 1.05
"""The same factor where the radii of two impacts tell restitution, by the model's law of both."""
_WAVELENGTHS = (405e-9, 450e-9, 488e-9, 520e-9, 532e-9, 546.1e-9, 589.3e-9, 632.8e-9, 650e-9, 660e-9)
_OF_LINES = 5e-3  # by which lamps and diodes differ from them: they lie so close that more would hit one by chance
_ASLANT, _MOST_ASLANT = ", or the camera looks aslant at the disc", 0.94
"""What shortens lengths as well, and the factor of a camera at 20°."""
_LATE = ", or the film begins too late, after an earlier impact"
_SPOILED = ", or something alters the rings (a bubble or liquid in the gap, a gamma in the grey levels)"
_SLIGHT = 0.05  # relative, up to which that changes the scale of fringes
_NEAR, _OF_HEIGHT = 3.0, ", or the drop is of another height than stated"
"""Factor of the frame rate, below which a wrong height may be meant."""
_UNSEEN = "frames of the flights were lost or left out, as by bursts, and those after them numbered on, or are repeated"
_ALWAYS = 0.98  # of all frames in contact: no flight is seen
_STICKS = 1.0  # J/m²
_OF_FORM = 1.5e-3  # relative, by which a sphere differs from a paraboloid, and a cone of light from a ray
_ANEW = 0.75  # of the first largest radius, from which a contact after the third impact is of another drop
_ZIGZAG = 0.03  # of the largest radius, by which a contact does not shrink before it grows on
_MENDS = {"region": "region"}  # setting, by the reason of the error
_FAILED = CAUSES | {
    "region": "region does not lie in the images",
    "radius": "the calibration record is of another view or day, or the film is not what the session says",
    "impacts": "the film shows no contact: it is of another view or drop, or its scale or wavelength is wrong",
}
ORDER = "order of the impacts"
RADIUS, FRINGE, FLIGHT, DURATION = "largest radius", "spacing of the fringes", "first flight", "duration of the contact"


_SOURCES = ("material_file", "fitted", "plate")
TITLES = {
    **judgements.OF_FILM,
    "fringes": Title(
        "Sphere, wavelength and image scale determine the spacing of the fringes.",
        (
            "spacing of the fringes", "visibility of the fringes", "fringes are resolved", "shape of the rings",
            "one scale of the fringes",
        ),
    ),
    "contacts": Title(
        "A contact stays in place, grows, then shrinks, without gaps.",
        (
            "contact and flight", "middle of the contacts", "place of the contacts", "growth of the contact",
            "contacts without gaps", "course of the contacts", "frames of the contacts", "contacts in view",
        ),
    ),
    "contact radius": Title(
        "Hertz: a ∝ R^0.4 (m h)^0.2 E^-0.2; a contact is smaller than its sphere.",
        ("largest radius", "contact radius over the sphere's", "radius at rest", "work of adhesion"),
    ),
    "contact duration": Title("The first contact lasts as long as its radius tells.", ("duration of the contact",)),
    "flights": Title(
        "Each flight lasts 2 v/g, with v from the stated height and the radii of the contacts.",
        ("first flight", "impacts in turn", "durations of the flights", "end of the film"),
    ),
    "order of the impacts": Title("No impact is harder than the one before.", (ORDER,)),
}  # fmt: skip


@judgements.judging(
    "radius",
    "impacts",
    "model",
    "comparison",
    *_SOURCES,
    rests_on=("sphere.material_from", "plate_from"),
    titles=TITLES,
    plate_from=OF_PLATE,
)
def judgement(given: Given, basis: judgements.Basis, settings: ContactArea, context: Context) -> Scene:
    """Judge one film; what gave no result is judged by that."""
    radius, impacts = given.get("radius"), given.get("impacts")
    whole = whole_film(context, settings.film)
    checks = [explained(check, whole) for check in judgements.failed_steps(context, _FAILED, _MENDS)]
    body = settings.sphere.radius.value, settings.sphere.mass.value
    checks.append(fall_checks.body_stated(*body))
    checks += [judgements.day_known(radius, settings.camera, settings.film), _sticks(settings)]
    checks.append(not_smoothed(context, settings.film))
    if radius is not None:
        checks += stated_twice(radius, settings.film, settings.frame_rate, settings.exposure)
        checks += given.each((_fringes, _visible, _method, _flies, image_checks))
        checks += [
            lit(settings.film, brightness(radius), radius["in_contact"].values.astype(bool), radius["time"].values),
            exposed(radius, settings.film),
        ]
        written = not_written(radius, settings.film)
        checks += [written] if written.level else []
        checks += frame_checks(radius, whole, settings)
    if radius is not None and impacts is not None and impacts.sizes["impact"]:
        checks += given.each((_size, _like_model, _order, _flight, _duration, _rest, _steady, _ends))
        checks += given.each((contacts_whole, none_lost, none_missed, flights_alike))
        # where frames of a flight are lost it ends too soon for any height
        alike = checks[-1]
        checks = judgements.because(checks, alike.cause if alike.level else "", FLIGHT, log_ratio=nan)
        summits = summits_seen(radius, impacts, settings)
        checks.append(summits)
        checks = judgements.because(checks, written.cause if written.level else "", FLIGHT, DURATION, log_ratio=nan)
        # where impacts do not follow each other, what is held against the stated height is another one
        order = next(c for c in checks if c.name == ORDER)
        is_wrong = order.level not in (None, "note")
        checks = judgements.because(checks, order.cause if is_wrong else "", FLIGHT, DURATION, log_ratio=nan)
    causes = given.each([_causes])
    is_told = any(FLIGHT in one.checks for one in explain(checks, causes))
    lost = [
        replace(c, cause=_UNSEEN) if c.name == FLIGHT and c.level and not (c.cause or is_told) else c for c in checks
    ]
    return Scene(
        lost,
        causes,
        given.each([rows]),
        given.ask(_inputs),
        {FRAMES: Quantity(0.0, 1.0, "1")},
        basis=basis,
        measured_by=judgements.measured_by(settings.sphere),
        alternatives=partial(
            of_drop, settings=settings, column=_simulated, **{name: given.get(name) for name in _SOURCES}
        ),
    )


def _simulated(row: Row) -> tuple[str, int] | None:
    """Return which result of a simulation a row compares, and of which impact."""
    title, _, number = row.quantity.partition(", impact ")
    return ("peak_contact_radius", int(number) - 1) if title == "largest radius" else None


def _inputs(
    settings: ContactArea, radius: xr.Dataset | None = None, model: xr.Dataset | None = None
) -> dict[str, Quantity]:
    """Return values and uncertainties of what the rows depend on."""
    relative = 0.0 if radius is None else float(radius.attrs["u_systematic_relative"])
    sphere = settings.sphere
    light = {} if settings.wavelength is None else {WAVELENGTH: settings.wavelength}
    plate = None if model is None else plate_mass(model)
    beneath = {} if plate is None else {PLATE: plate}
    return (
        light
        | beneath
        | {
            "radius": sphere.radius,
            "mass": sphere.mass,
            "height": settings.height,
            "modulus": Quantity(1.0, 0.0, "1"),
            SCALE: Quantity(1.0, relative, "1"),
        }
        | material_inputs(model)
    )


def _fringes(radius: xr.Dataset, settings: ContactArea, impacts: xr.Dataset | None = None) -> Check:
    light, body = settings.wavelength, settings.sphere.radius
    ratio = float(radius.attrs.get("phase_scale_ratio", nan))
    if light is None or not isfinite(ratio) or not edges_only(radius)[1]:
        return not_made(FRINGE, "a wavelength, and fringes that the film resolves")
    scale = 2 * float(radius.attrs["u_systematic_relative"])
    u = hypot(scale, light.u / light.value, body.u / body.value)
    message = (
        f"{settings.film}: R times wavelength is {in_words(1 / ratio, 4)} times what is stated, by the fringes "
        f"(in this light a sphere of {in_words(1e3 * body.value / ratio, 4)} mm in radius, stated are "
        f"{in_words(1e3 * body.value, 4)} mm), or else a pixel {in_words(sqrt(ratio), 4)} times as long"
    )
    u_ratio = ratio * hypot(float(radius.attrs.get("u_phase_scale_ratio", 0.0)), _OF_FORM)
    return compared(FRINGE, message, ratio, u_ratio, 1.0, u, file=settings.film)


def _sticks(settings: ContactArea) -> Check:
    """Hold the stated work of adhesion against those of smooth polymers."""
    name = "work of adhesion"
    given = settings.work_of_adhesion
    if given is None:
        return not_made(name, "a work of adhesion")
    cause = "work_of_adhesion is in another unit than was typed (mJ/m²), or that of tearing soft adhesives apart"
    level: Level | None = "doubtful" if given.value > _STICKS else None
    text = f"{quantity(given.value, 'J/m2')} are stated"
    return stated(name, text, level, cause=cause, setting="work_of_adhesion")


def _visible(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Hold the fitted visibility against that of dark fringes without any light."""
    name = "visibility of the fringes"
    values = radius["visibility"].values if "visibility" in radius else np.empty(0)
    values = values[np.isfinite(values)]
    if settings.wavelength is None or values.size < 3:
        return not_made(name, "a wavelength, and three frames with fringes")
    seen, u = float(np.median(values)), max(float(np.std(values)) / sqrt(values.size), 0.02)
    phase = float(radius.attrs.get("phase", np.nan))
    message = f"{settings.film}: visibility {seen:.2f}, phase in the contact {phase:.2f} rad"
    found = bounded(name, message, seen, u, at_most=1.0, setting="wavelength")
    light = quantity(settings.wavelength.value, "m")
    cause = (
        f"the wavelength of {light} is not that of the film's light, or the sphere's radius or the scale of the "
        "image is wrong: fringes lie where these put none"
    )
    return replace(found, cause=cause)


def _method(radius: xr.Dataset, settings: ContactArea) -> Check:
    name = "fringes are resolved"
    edges, fringes = edges_only(radius)
    if settings.wavelength is None:
        return not_made(name, "the wavelength of monochromatic light")
    frames = "1 frame" if edges == 1 else f"{edges} frames"
    message = f"{settings.film}: {frames} measured by the edge of the spot, {fringes} by fringes"
    level: Level | None = "doubtful" if edges > fringes else "note" if edges else None
    if edges <= fringes:
        cause = "contacts are small or move fast there, or something hides or spoils their fringes: look at these"
    else:
        cause = "fringes are not resolved: a scale of another view, another wavelength, a lens out of focus or covered"
        better = [check.cause for check in (exposed(radius, settings.film), in_view(radius, settings)) if check.level]
        cause = better[0] if better else cause
    return stated(name, message, level, cause=cause, file=settings.film)


def _largest(impacts: xr.Dataset) -> tuple[float, float]:
    return float(impacts["peak_radius"][0]), float(impacts["u_peak_radius"][0])


def _size(impacts: xr.Dataset, settings: ContactArea) -> Check:
    name = "contact radius over the sphere's"
    seen, own = _largest(impacts)
    body = settings.sphere.radius
    ratio = seen / body.value
    u = ratio * hypot(own / seen, body.u / body.value)
    message = f"{settings.film}: {quantity(seen, 'm')} in a sphere of {quantity(body.value, 'm')}: {ratio:.3g}"
    cause = f"the scale in {settings.camera} is wrong or of another view, or sphere.radius is"
    return bounded(name, message, ratio, u, at_most=_LARGEST, file=settings.camera, cause=cause)


def _like(name: str, message: str, ratio: float, allowed: float, u: float, file: str) -> Check:
    """Hold a ratio against one within a factor, so that causes may be told from it."""
    found = bounded(name, message, log(ratio), u, at_least=-log(allowed), at_most=log(allowed), file=file)
    return replace(found, log_ratio=log(ratio), u_log_ratio=u)


def _like_model(impacts: xr.Dataset, settings: ContactArea, model: xr.Dataset | None = None) -> Check:
    if model is None or not model.sizes["impact"]:
        return not_made(RADIUS, "a model of the drop")
    seen, expected = _largest(impacts)[0], float(model["peak_contact_radius"][0])
    message = f"{settings.film}: {quantity(seen, 'm')} seen, {quantity(expected, 'm')} expected"
    allowed, u = _LIKE_MODEL
    return _like(RADIUS, message, seen / expected, allowed, u, settings.film)


def _order(impacts: xr.Dataset, settings: ContactArea) -> Check:
    name = ORDER
    a, u = impacts["peak_radius"].values, impacts["u_peak_radius"].values
    if a.size < 2:
        return not_made(name, "two impacts")
    rise, own = np.diff(a), np.hypot(u[1:], u[:-1])
    at = int(np.argmax(rise / own))
    ends, begins = (quantity(float(impacts[n][i]), "s") for n, i in (("last_seen", at), ("first_seen", at + 1)))
    message = f"{settings.film}: {quantity(a[at], 'm')} at impact {at + 1}, {quantity(a[at + 1], 'm')} at the next"
    joined = f"the film is of two drops, joined between {ends} and {begins}, or frames of impact {at + 1} were lost"
    cause = f"the frames stand in reverse order, or {joined}"
    if a.size > 2:
        cause = "the frames stand in reverse order" if np.all(rise > DOUBTFUL * own) else joined
    found = bounded(name, message, float(rise[at]), float(own[at]), at_most=0.0, file=settings.film, cause=cause)
    later = [one for one in json.loads(impacts.attrs.get(LATER, "[]")) if one[1] > max(_ANEW * a[0], a[-1])]
    if found.level or not later:
        return found
    begins, (_, size) = quantity(later[0][0], "s"), later[0]
    text = (
        f"{settings.film}: {quantity(a[-1], 'm')} at impact {a.size}, {quantity(size, 'm')} in a later one, at {begins}"
    )
    cause = f"another drop begins before {begins}: the first was measured; cut the film there for the other"
    return stated(name, text, "note", cause=cause, file=settings.film)


def _flies(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Look for flight: before the first impact, and after it."""
    name = "contact and flight"
    touches = radius["in_contact"].values.astype(bool)
    share = float(touches.mean()) if touches.size else 0.0
    message = f"{settings.film}: contact in {share * 100:.0f} % of the frames"
    if share > _ALWAYS:
        cause = "the film is of a sphere at rest, of another view, or a mark in the image is taken for a contact"
        return stated(name, message, "impossible", cause=cause, file=settings.film)
    if touches.size and touches[0]:
        cause = "the film begins too late: its first impact is not the first one, or is cut"
        text = f"{message}, from the first frame on"
        return stated(name, text, "doubtful", cause=cause, file=settings.film)
    return stated(name, message, None, file=settings.film)


def _ends(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea) -> Check:
    """Look for a film whose last frame shows the only impact that it holds."""
    name = "end of the film"
    time = radius["time"].values
    lasts = float(impacts["last_seen"][-1] - impacts["first_seen"][-1])
    ends_in_it = impacts.sizes["impact"] == 1 and float(impacts["last_seen"][-1]) >= float(time[-1])
    if not ends_in_it or isfinite(float(impacts["static_radius"])):
        return stated(name, f"{settings.film}: goes on after the first contact", None, file=settings.film)
    text = f"{settings.film}: the film ends {quantity(lasts, 's')} after the first contact began, still in contact"
    cause = "the film was stopped or cut too soon: its largest contact may not be the impact's"
    return stated(name, text, "doubtful", cause=cause, file=settings.film)


def _flight(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea, model: xr.Dataset | None = None) -> Check:
    """Hold the first flight against the stated height and the restitution by the second flight."""
    peak = impacts["peak_time"].values
    if peak.size < 2 or (peak.size < 3 and (model is None or model.sizes["impact"] < 2)):
        return not_made(FLIGHT, "three impacts, or two and a model")
    gravity = settings.model.gravity.value
    count = min(peak.size, 3) - 1
    seen = [_seen_lasting(radius, impacts, i) for i in range(count)]
    touches = np.array([shortest for shortest, _ in seen])
    alike, allowed, rough = 1.0, 1.1, _LOSSES
    if model is not None and model.sizes["impact"] > 2:
        # that of a wrong mass lasts otherwise than what the frames show
        touches = np.clip(model["contact_duration"].values[:count], touches, [longest for _, longest in seen])
        # how restitution changes with speed hardly depends on what it is, nor on the material's grade
        bounced = model["restitution"].values
        alike, allowed, rough = float(bounced[0] / bounced[1]), *_LOSSES_KNOWN
    flights = np.diff(peak[:3]) - touches
    if not np.all(flights > 0):
        return not_made(FLIGHT, "flights that last longer than contacts")
    first, by = float(flights[0]), "the second flight"
    if flights.size > 1 or model is None:
        e = alike * float(flights[-1]) / first
    else:
        e, rough = restitution_by_radii(impacts, model, float(radius.attrs["u_systematic_relative"]))
        by, alike, allowed = "the radii of the two", 1.0, _BY_RADII
    expected = 2 * e * sqrt(2 * settings.height.value / gravity)
    message = (
        f"{settings.film}: the first flight lasts {quantity(first, 's')}, expected are {quantity(expected, 's')} "
        f"for e = {e:.3f} by {by}"
    )
    shown = 0.5 * settings.height.u / settings.height.value
    found = _like(FLIGHT, message, first / expected, allowed, hypot(rough, shown), settings.film)
    loose = _like(FLIGHT, message, first / (expected / alike), 1.1, hypot(_LOSSES, shown), settings.film)
    if flights.size < 2:
        return replace(found, level="doubtful") if found.level else found
    # by how a model's restitution changes nothing is impossible: the material may be another
    return replace(found, level=loose.level or "doubtful") if found.level else loose


def _seen_lasting(radius: xr.Dataset, impacts: xr.Dataset, i: int) -> tuple[float, float]:
    """Return the shortest and the longest time [s] that a contact lasted, by the frames that show it and not."""
    first, last = float(impacts["first_seen"][i]), float(impacts["last_seen"][i])
    time = radius["time"].values[radius["valid"].values.astype(bool)]
    before, after = time[time < first], time[time > last]
    return last - first, float(after[0] - before[-1]) if before.size and after.size else inf


def _duration(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea, model: xr.Dataset | None = None) -> Check:
    """Hold the first contact's duration against its radius: both go with mass and modulus by the same law."""
    if model is None or not model.sizes["impact"]:
        return not_made(DURATION, "a model of the drop")
    if in_view(radius, settings).level:
        return not_made(DURATION, "contacts whose middle the images show")
    shortest, longest = _seen_lasting(radius, impacts, 0)
    if not isfinite(longest):
        return not_made(DURATION, "a frame before and one after the first contact")
    seen, own = 0.5 * (shortest + longest), (longest - shortest) / sqrt(24.0)
    a, u_a = _largest(impacts)
    expected = float(model["contact_duration"][0]) * (a / float(model["peak_contact_radius"][0])) ** 2
    height, body = settings.height, settings.sphere.radius
    u = hypot(2 * u_a / a, 0.5 * height.u / height.value, body.u / body.value, _LASTS)
    message = (
        f"{settings.film}: contact for {quantity(seen, 's')}; one of {quantity(a, 'm')} in radius lasts "
        f"{quantity(expected, 's')} at the speed of the stated height"
    )
    return compared(DURATION, message, seen, own, expected, u * expected, file=settings.film, setting="height")


def _rest(impacts: xr.Dataset, settings: ContactArea) -> Check:
    name = "radius at rest"
    rest, u = float(impacts["static_radius"]), float(impacts["u_static_radius"])
    if not (isfinite(rest) and isfinite(u)):
        return not_made(name, "a film that lasts until rest")
    seen, own = _largest(impacts)
    message = f"{settings.film}: {quantity(rest, 'm')} at rest, {quantity(seen, 'm')} in the first impact"
    return bounded(name, message, rest - seen, hypot(u, own), at_most=0.0, file=settings.film)


def _steady(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea) -> Check:
    """Look for a frame that interrupts the growth or the fall of a contact."""
    name = "growth of the contact"
    time, a, u = (radius[n].values for n in ("time", "radius", "u_radius"))
    worst, at = 0.0, -1
    for first, last in zip(impacts["first_seen"].values, impacts["last_seen"].values, strict=True):
        run = np.flatnonzero((time >= first) & (time <= last) & np.isfinite(a) & np.isfinite(u))
        if run.size < 5:
            continue
        y = a[run]
        # the median of three does not follow one frame to a top of its own
        smooth = np.convolve(y, np.ones(3) / 3, "same")
        top = int(np.argmax(smooth))
        level = np.concatenate([np.maximum.accumulate(y[: top + 1]), np.maximum.accumulate(y[:top:-1])[::-1]])
        gap = level - y - 10 * u[run]
        if gap.max() / y.max() > worst:
            worst, at = float(gap.max() / y.max()), int(radius["frame"].values[run[int(np.argmax(gap))]])
    if worst > _ZIGZAG:
        text = f"{settings.film}: about frame {at} the contact shrinks by {worst * 100:.0f} % and grows on"
        cause = f"frames near {at} are exchanged, repeated or lost"
        return stated(name, text, "doubtful", cause=cause, file=settings.film)
    return stated(name, f"{settings.film}: contacts grow and shrink steadily", None, file=settings.film)


def _stiffer(k: float) -> str:
    return f"some {in_words(max(k, 1 / k), 1)} times {'stiffer' if k > 1.0 else 'softer'}"


def _causes(
    settings: ContactArea, radius: xr.Dataset | None = None, impacts: xr.Dataset | None = None
) -> Iterator[Cause]:
    light, body = settings.wavelength, settings.sphere.radius
    if light is not None:
        colour = times_over("the wavelength", light.value, "m", "wavelength in session.toml")
        yield Cause(
            {FRINGE: 1.0},
            lambda k: f"{colour(k)}{_SPOILED * (abs(log(k)) < _SLIGHT)}",
            tuple(light.value / known for known in _WAVELENGTHS if abs(light.value / known - 1) > 0.01),
            slack=_OF_LINES,
            u=(light.u or usual_uncertainty(light)) / light.value,
            setting="wavelength",
        )
    yield Cause(
        {FRINGE: -2.0, RADIUS: 1.0, DURATION: -2.0},
        lambda k: (
            f"lengths come out {too_large(k)}: the scale in {settings.camera} is wrong"
            + (", of another view" if abs(log(k)) > log(3.0) else _ASLANT if _MOST_ASLANT < k < 1.0 else "")
        ),
        SLIPS["length"] + SLIPS["gain"] + SLIPS["view"],
        u=inf if radius is None else float(radius.attrs["u_systematic_relative"]) or inf,
        file=settings.camera,
        setting="values.pixel_length",
    )
    yield Cause(
        {FRINGE: 1.0, RADIUS: -0.4, DURATION: 1.0},
        times_over("the sphere's radius", body.value, "m", "sphere.radius in session.toml"),
        SLIPS["decimal"],
        u=(body.u or usual_uncertainty(body)) / body.value,
        setting="sphere.radius",
    )
    yield Cause(
        {FLIGHT: -1.0, DURATION: -1.0},
        lambda k: of_rate(k, _OF_HEIGHT * (1 / _NEAR < k < _NEAR)),
        SLIPS["interval"],
        u=_CLOCK,
        file="" if is_rate_used(settings.frame_rate, radius) else settings.film,
        setting="frame_rate" if is_rate_used(settings.frame_rate, radius) else "",
    )
    height = times_over("the drop height", settings.height.value, "m", "height in session.toml")
    yield Cause(
        {FLIGHT: -0.5, RADIUS: -0.2, DURATION: 0.5},
        lambda k: f"{height(k)}{_LATE * begins_late(k, radius, impacts, settings)}",
        SLIPS["decimal"],
        u=(settings.height.u or usual_uncertainty(settings.height)) / settings.height.value,
        setting="height",
    )
    mass = times_over("the moving mass", settings.sphere.mass.value, "kg", "sphere.mass in session.toml")
    yield Cause(
        {RADIUS: -0.2},
        lambda k: f"{mass(k)}; or the polymer is another than stated, {_stiffer(k)} in the impact",
        SLIPS["mass"],
        only_usual=True,
        setting="sphere.mass",
    )

"""Checks of a film of a contact: its frames and light, fringes, contacts, radius, duration, flights, and order."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from math import hypot, inf, isfinite, nan, sqrt

import numpy as np
import xarray as xr

from labpipe.judging import DOUBTFUL, IMPOSSIBLE, Check, Level, bounded, compared, in_words, not_made
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.contact_area.comparison import FRAMES, SCALE, WAVELENGTH, largest_radii, rows
from pipelines.experiments.contact_area.measured import edges_only
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared import fall_checks, judgements
from pipelines.experiments.shared.alternatives import SOURCES, of_drop
from pipelines.experiments.shared.film_checks import LONGER, exposed, exposure_stated, of_film, of_frames, wrong_rate
from pipelines.experiments.shared.film_frames import meanings
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title
from pipelines.experiments.shared.model_inputs import inputs_of
from pipelines.experiments.shared.record_checks import longest_run

_BY_SPEED = (0.055, 0.03)
"""Relative uncertainty of the first restitution by the second one, at another speed, and where a model shows how it
changes with speed."""
_WAVELENGTHS = (450e-9, 520e-9, 532e-9, 589.3e-9, 632.8e-9, 650e-9)
_OF_LINES = 5e-3  # by which lamps and diodes differ from them: they lie so close that more would hit one by chance
_OF_FORM = 1.5e-3  # relative, by which a sphere differs from a paraboloid, and a cone of light from a ray
_FAILED = {
    "region": "region does not lie in the images",
    "radius": "the calibration record is of another view or day, or the film is not what the session says",
    "impacts": "the film shows no contact: it is of another view or drop, or its scale or wavelength is wrong",
}
ORDER = "order of the impacts"
RADIUS, FRINGE, FLIGHT = "largest radius", "spacing of the fringes", "first flight"
TITLES = {
    **judgements.OF_FILM,
    "fringes": Title(
        "Sphere, wavelength and image scale determine the spacing of the fringes.",
        (FRINGE, "fringes are resolved"),
    ),
    "contacts": Title(
        "A contact stays in place and shows in every frame of an impact; between impacts the sphere flies.",
        ("contact and flight", "place of the contacts"),
    ),
    "contact radius": Title(
        "Hertz: a ∝ R^0.4 (m h)^0.2 E^-0.2.", (RADIUS,)
    ),
    "flights": Title(
        "A flight lasts 2 v/g, with v from the stated height and the restitution.", (FLIGHT,)
    ),
    "order of the impacts": Title("No impact is harder than the one before.", (ORDER,)),
}  # fmt: skip


@judgements.judging(
    "radius", "impacts", "model", "comparison", *SOURCES, rests_on=("sphere.material_from", "plate_from"), titles=TITLES
)
def judgement(given: Given, basis: judgements.Basis, settings: ContactArea, context: Context) -> Scene:
    """Judge one film; a step without a result is judged by its error."""
    radius, impacts, sphere = given.get("radius"), given.get("impacts"), settings.sphere
    checks = of_film(context, settings, radius, _FAILED, {"region": "region"})
    checks.append(fall_checks.body_stated(sphere.radius.value, sphere.mass.value))
    checks.append(judgements.day_known(radius, settings.camera, settings.film))
    if radius is not None:
        checks += _of_frames(radius, impacts, settings)
        checks += _of_contacts(radius, settings)
    checks += given.each([_of_impacts])
    own = 0.0 if radius is None else float(radius.attrs["u_systematic_relative"])
    of_radius, of_height = {FRINGE: 1.0, RADIUS: -0.4}, {FLIGHT: -0.5, RADIUS: -0.2}
    mass = judgements.stated_wrongly({RADIUS: -0.2}, "the moving mass", sphere.mass, "sphere.mass", "mass", inf)

    def of_mass(k: float) -> str:
        other = f"some {in_words(max(k, 1 / k), 1)} times {'stiffer' if k > 1.0 else 'softer'} in the impact"
        return f"{mass.say(k)}; or the polymer is another than stated, {other}"

    causes = [
        judgements.wrong_scale({FRINGE: -2.0, RADIUS: 1.0}, settings.camera, own or inf),
        judgements.stated_wrongly(of_radius, "the sphere's radius", sphere.radius, "sphere.radius"),
        wrong_rate({FLIGHT: -1.0}, settings.frame_rate, radius, settings.film, fall_checks.CLOCK),
        judgements.stated_wrongly(of_height, "the drop height", settings.height, "height"),
        replace(mass, say=of_mass, only_usual=True),
    ]
    if (light := settings.wavelength) is not None:
        colour = judgements.stated_wrongly({FRINGE: 1.0}, "the wavelength", light, "wavelength")
        lines = tuple(light.value / known for known in _WAVELENGTHS if abs(light.value / known - 1) > 0.01)
        causes.insert(0, replace(colour, usual=lines, slack=_OF_LINES))
    if any(check.name == RADIUS and check.level for check in checks):  # which no clock changes
        causes = [cause for cause in causes if set(cause.effects) != {FLIGHT}]
    inputs = {SCALE: Quantity(1.0, own, "1")} | inputs_of(given.get("model")) | ({WAVELENGTH: light} if light else {})
    return Scene(
        checks,
        causes,
        given.each([rows]),
        inputs,
        {FRAMES: Quantity(0.0, 1.0, "1")},
        basis=basis,
        measured_by=judgements.measured_by(sphere),
        alternatives=partial(of_drop, given=given, settings=settings),
    )


def _of_frames(radius: xr.Dataset, impacts: xr.Dataset | None, settings: ContactArea) -> Iterator[Check]:
    """Evaluate the exposure, times and order of the frames, and whether the sphere flies in some of them."""
    film, frame, time = settings.film, radius["frame"].values, radius["time"].values
    touches, is_sound = (radius[name].values.astype(bool) for name in ("in_contact", "valid"))
    yield exposure_stated(radius, film, settings.exposure)
    contacts = [] if impacts is None else zip(impacts["first_seen"].values, impacts["last_seen"].values, strict=True)
    inside = [(time[:-1] >= first) & (time[1:] <= last) for first, last in contacts]
    moves = np.any([np.zeros(time.size - 1, bool), *inside], axis=0)
    # of a repeated image the same centre is found, which noise would move
    alike = [np.abs(np.diff(radius[c])) < 1e-3 * radius[f"u_{c}"].values[1:] for c in ("centre_x", "centre_y")]
    is_copy = touches[1:] & (np.diff(frame) == 1) & np.all(alike, axis=0)
    # the area goes with the depth and so is smooth where a contact begins
    a, u = radius["radius"].values, radius["u_radius"].values
    measured = touches & np.isfinite(a * u)
    noise = float(np.median(2 * a[measured] * u[measured])) if measured.any() else 0.0
    square = np.where(touches, a**2, np.where(is_sound, 0.0, nan))
    yield from of_frames(film, frame, time, moves, is_copy, square, noise=noise, missed=~touches)
    level: Level | None = None
    text, cause = f"contact in {100 * touches.mean():.0f} % of the frames", ""
    if longest_run(~touches)[0] < 2:
        level = "impossible"
        cause = "the film is of a sphere at rest, of another view, or a mark in the image is taken for a contact"
    elif touches[0]:
        level, text = "doubtful", f"{text}, from the first frame on"
        cause = "the film begins too late: its first impact is not the first one, or is cut"
    yield Check("contact and flight", f"{film}: {text}", level, cause=cause, file=film)


def _of_contacts(radius: xr.Dataset, settings: ContactArea) -> Iterator[Check]:
    """Compare the spacing of the fringes with wavelength, radius and scale, and look for a contact that jumps."""
    light, body, film = settings.wavelength, settings.sphere.radius, settings.film
    edges, fringes = edges_only(radius)
    ratio = float(radius.attrs.get("phase_scale_ratio", nan))
    if light is None:
        yield not_made(FRINGE, "the wavelength of monochromatic light")
    elif fringes and isfinite(ratio):
        u = hypot(2 * float(radius.attrs["u_systematic_relative"]), light.u / light.value, body.u / body.value)
        u_ratio = ratio * hypot(float(radius.attrs.get("u_phase_scale_ratio", 0.0)), _OF_FORM)
        apart = f"{100 * (1 / ratio - 1):.1f} %"
        message = f"{film}: fringe spacing agrees with sphere, wavelength and scale (difference {apart})"
        if abs(ratio - 1.0) > DOUBTFUL * hypot(u_ratio, u):
            message = f"{film}: by the fringes radius times wavelength differs by {apart} from the stated values, or a "
            message += f"pixel is {100 * abs(sqrt(ratio) - 1):.2g} % {'longer' if ratio > 1 else 'shorter'} than stated"
        yield compared(FRINGE, message, ratio, u_ratio, 1.0, u, file=film)
    if light is not None:
        message = f"{film}: {edges} frames measured by the edge of the spot, {fringes} by fringes"
        level: Level | None = "doubtful" if edges > fringes else "note" if edges else None
        cause = "contacts are small or move fast there, or something hides or spoils their fringes: look at these"
        if level == "doubtful":
            cause = "fringes are not resolved: a scale of another view, another wavelength, a lens out of focus or "
            cause = exposed(radius, film).cause or f"{cause}covered"
        yield Check("fringes are resolved", message, level, cause=cause, file=film)

    name, method = "place of the contacts", meanings(radius["method"])
    at = np.flatnonzero(np.isfinite(radius["radius"].values) & (method != "between_equal_frames") & (method != "none"))
    if at.size < 2:
        yield not_made(name, "contacts in two frames, and their centres")
        return
    x, y, u_x, u_y = (radius[c].values[at] for c in ("centre_x", "centre_y", "u_centre_x", "u_centre_y"))
    time, frame = radius["time"].values[at], radius["frame"].values[at]
    # a poor fit moves radius and centre together
    own = np.sqrt(u_x**2 + u_y**2 + (radius["u_radius"].values[at] / float(radius["pixel_size"])) ** 2)
    step, u_step = np.hypot(np.diff(x), np.diff(y)), np.hypot(own[1:], own[:-1])
    is_next = (np.diff(at) == 1) & (np.diff(time) < LONGER * float(np.median(np.diff(time))))
    jumps = is_next & (step > np.maximum(IMPOSSIBLE * u_step, 1.0)) & np.isfinite(u_step)
    text = "no contact jumps in the image"
    if jumps.any():
        k, more = int(np.argmax(np.where(jumps, step, 0.0))), int(jumps.sum()) - 1
        text = f"the contact jumps by {step[k]:.3g} px to frame {frame[k + 1]}{f', and {more} times more' * bool(more)}"
    cause = "the bench, the camera or the plate was knocked or moved, the lens was refocused, or frames are exchanged"
    yield Check(name, f"{film}: {text}", "doubtful" if jumps.any() else None, cause=cause, file=film)


def _of_impacts(
    radius: xr.Dataset,
    impacts: xr.Dataset,
    settings: ContactArea,
    model: xr.Dataset | None = None,
    comparison: xr.Dataset | None = None,
) -> Iterator[Check]:
    """Compare the first radius with the model, radii in their order, and the first flight with the stated height."""
    (a, u), film, cause = largest_radii(impacts, comparison), settings.film, ""
    if not a.size:
        return
    of_radius = list[Check]()
    if model is None or not model.sizes["impact"]:
        of_radius.append(not_made(RADIUS, "a model of the drop"))
    else:
        seen, expected = float(a[0]), float(model["peak_contact_radius"][0])
        text = f"{film}: {quantity(seen, 'm')} seen, {quantity(expected, 'm')} expected"
        u_expected = 0.2 * judgements.u_modulus(settings.sphere) * expected
        of_radius.append(compared(RADIUS, text, seen, 0.0, expected, u_expected, file=film))
    if a.size > 1:
        rise, own = np.diff(a), np.hypot(u[1:], u[:-1])
        at = int(np.argmax(rise / own))
        ends, begins = (quantity(float(impacts[n][i]), "s") for n, i in (("last_seen", at), ("first_seen", at + 1)))
        text = f"{film}: {quantity(a[at], 'm')} at impact {at + 1}, {quantity(a[at + 1], 'm')} at the next"
        cause = f"the film is of two drops, joined between {ends} and {begins}, or frames of impact {at + 1} were lost"
        touches = radius["in_contact"].values.astype(bool)
        if touches[0] and not touches[-1]:
            cause = "the frames are in reverse order: contact from the first frame on, a free sphere at the end"
        elif np.all(rise > DOUBTFUL * own):
            cause = "the frames are in reverse order" + f", or {cause}" * (a.size == 2)
        order = bounded(ORDER, text, float(rise[at]), float(own[at]), at_most=0.0, file=film, cause=cause)
        cause = order.cause
        yield order
    # where impacts do not follow each other another one is compared with the first
    yield from judgements.because(of_radius, cause, RADIUS, file=film, log_ratio=nan)

    peak = impacts["peak_time"].values[:3]
    # a contact lasts from within the interval before its first frame to within that after its last one
    touches = (impacts["last_seen"] - impacts["first_seen"]).values[:2] + float(np.median(np.diff(radius["time"])))
    if peak.size < 3 or min(flights := (np.diff(peak) - touches).tolist()) <= 0.0:
        yield not_made(FLIGHT, "three impacts, and flights that last longer than contacts")
        return
    alike, rough = 1.0, _BY_SPEED[0]
    if model is not None and model.sizes["impact"] > 2:
        # how restitution changes with speed hardly depends on what the body is
        alike, rough = float(model["restitution"][0] / model["restitution"][1]), _BY_SPEED[1]
    first, e = flights[0], alike * flights[1] / flights[0]
    expected = 2 * e * sqrt(2 * settings.height.value / settings.model.gravity.value)
    text = f"{film}: the first flight lasts {quantity(first, 's')}, expected are {quantity(expected, 's')} "
    text += f"for e = {e:.3f} by the second flight"
    u_expected = expected * hypot(rough, 0.5 * settings.height.u / settings.height.value)
    flight = compared(FLIGHT, text, first, 0.0, expected, u_expected, file=film)
    # where impacts do not follow each other another flight is compared with the stated height
    yield from judgements.because([flight], cause, FLIGHT, log_ratio=nan)

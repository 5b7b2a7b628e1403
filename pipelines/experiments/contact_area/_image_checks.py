"""Whether the images of a contact are of one view: its place, the shape of its rings, dark or bright."""

import json
from collections.abc import Iterator
from math import acos, cos, degrees, isfinite, sqrt

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.judging import Check, Level, in_words, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.contact_area._axes import axes_ratio
from pipelines.experiments.contact_area.measured import FRINGE_FIT, OPEN_GAP, READ, edges_only
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.film_light import LIGHT

_FEWEST = 8  # frames whose centres make a place
_STEADY, _CONTRADICTS = 1.0, 10.0  # px and standard uncertainties by which a contact does not jump
_PLAY, _WANDERS = 25e-6, 4.0
"""Play (m) of a guide, by which contacts stand apart, and multiple of it beyond which the camera moved."""
_MANY, _EACH, _ALIKE = 6, 3.0, 4.0
"""Frames of a contact that tell whether it moves in the image, and standard uncertainties by which each does and by
which their speeds may differ where the image creeps."""
_SMEARED, _TOO_SHARP = 4, 0.4  # frames with a smear to compare, and the share of the stated one that says it is wrong
_MATTERS, _DECIDES = 0.5, 2.0
"""Of the uncertainty of the scale, by which unequal axes may change a radius untold, and from which on they are most of
what is not known of it."""


def image_checks(radius: xr.Dataset, settings: ContactArea) -> Iterator[Check]:
    """Look for contacts beside the image, that move in it or are bright, and rings that are no circles."""
    yield from (check(radius, settings) for check in (in_view, _stays, _shutter, _round, _positive))


def in_view(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Look for contacts of which the images, or the region that is stated, show a part of the rim alone."""
    name = "middle of the contacts"
    view = json.loads(radius.attrs.get(LIGHT, "{}")).get("view")
    known = np.isin(radius["method"].values, READ) & np.isfinite(radius["radius"].values)
    if view is None or not known.any():
        return not_made(name, "contacts, and the size of the images")
    first = (0.0, 0.0) if settings.region is None else np.min(settings.region, axis=0)
    place = np.column_stack([radius[axis].values[known] for axis in ("centre_x", "centre_y")]) - first
    beside = int(np.any((place < -0.5) | (place > np.array(view[::-1]) - 0.5), axis=1).sum())
    what = "the images" if settings.region is None else "region"
    text = f"{settings.film}: the middle lies beside {what} in {beside} of {place.shape[0]} frames with a contact"
    if beside <= 0.5 * place.shape[0]:
        return stated(name, text, None, file=settings.film)
    cause = (
        "the images were cropped beside the contact, or the camera looks past it"
        if settings.region is None
        else "region is not around the contact, or is not in px of the images, x to the right and y down"
    )
    level: Level = "doubtful" if np.greater(*edges_only(radius)) else "note"
    setting = "" if settings.region is None else "region"
    return stated(name, text, level, cause=cause, file="" if setting else settings.film, setting=setting)


def _shutter(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Hold the stated exposure against how far fringes are smeared, which a lens out of focus does as well."""
    name = "exposure by the fringes"
    read = np.isin(radius["method"].values, (FRINGE_FIT, OPEN_GAP))
    # Hertz: the area goes with the depth, so that its slope tells the speed of the radius
    beside = np.flatnonzero(read[1:-1] & (read[2:] & read[:-2])) + 1
    time, a = radius["time"].values, radius["radius"].values
    speed = np.abs(a[beside + 1] ** 2 - a[beside - 1] ** 2) / (time[beside + 1] - time[beside - 1]) / (2.0 * a[beside])
    moved = speed * (0.0 if settings.exposure is None else settings.exposure.value)
    told = moved > float(radius["pixel_size"])
    if "travel" not in radius or np.count_nonzero(told) < _SMEARED:
        return not_made(name, "a stated exposure in which contacts move by a pixel, in four frames")
    seen, moved = radius["travel"].values[beside[told]], moved[told]
    at = int(np.argsort(seen / moved)[moved.size // 2])
    text = (
        f"{settings.film}: fringes of frame {int(radius['frame'].values[beside[told][at]])} are smeared by "
        f"{quantity(float(seen[at]), 'm', 2)}; in the stated exposure the contact moves by "
        f"{quantity(float(moved[at]), 'm', 2)}"
    )
    level: Level | None = "doubtful" if seen[at] < _TOO_SHARP * moved[at] else None
    cause = "exposure is not that of this film, or its unit is wrong; or the frame rate is wrong"
    return stated(name, text, level, cause=cause, setting="exposure")


def _round(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Look for rings that are ellipses, as a camera sees them that looks aslant."""
    name = "shape of the rings"
    found = axes_ratio(radius)
    if found is None:
        return not_made(name, "fringes that the film resolves")
    ratio, angle = found
    if ratio == 1.0:
        return stated(name, f"{settings.film}: the rings are circles", None, file=settings.film)
    half = 1.0 - sqrt(ratio)
    own = float(radius["u_pixel_size"] / radius["pixel_size"])
    level: Level | None = "doubtful" if half > _DECIDES * own else "note" if half > _MATTERS * own else None
    text = (
        f"{settings.film}: the rings are ellipses, {100 * (1 - ratio):.2g} % narrower than long (the longer axis at "
        f"{degrees(angle):.0f}° to the rows), as circles look at {degrees(acos(ratio)):.2g}° from straight; radii are "
        f"those of equal area, {100 * half:.2g} % below the longer half axis"
    )
    cause = "the camera looks aslant at the disc, or its pixels are not square: measure the scale both ways"
    cause = cause if level else ""
    return stated(name, text, level, cause=cause, file=settings.film, setting="camera")


def _stays(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Look for contacts that jump in the image, or stand at several places."""
    name = "place of the contacts"
    known = np.isin(radius["method"].values, READ) & np.isfinite(radius["radius"].values)
    at = np.flatnonzero(known)
    if at.size < _FEWEST or "centre_x" not in radius:
        return not_made(name, "contacts in eight frames, and their centres")
    x, y, u_x, u_y = (radius[c].values[at] for c in ("centre_x", "centre_y", "u_centre_x", "u_centre_y"))
    time, frame = radius["time"].values[at], radius["frame"].values[at]
    # what moves the radius of a poor fit moves its centre as well
    own = np.sqrt(u_x**2 + u_y**2 + (radius["u_radius"].values[at] / float(radius["pixel_size"])) ** 2)
    step, u = np.hypot(np.diff(x), np.diff(y)), np.hypot(own[1:], own[:-1])
    is_one = (np.diff(at) == 1) & (np.diff(time) < 1.5 * float(np.median(np.diff(time))))
    jumps = is_one & (step > _CONTRADICTS * u) & (step > _STEADY) & np.isfinite(u)
    cause = "the bench, the camera or the plate was knocked or moved"
    if jumps.any():
        # where it shakes, every step is one
        k = int(np.argmax(np.where(jumps, step, 0.0)))
        times = f", and {jumps.sum() - 1} times more" if jumps.sum() > 1 else ""
        text = f"{settings.film}: the contact jumps by {step[k]:.3g} px to frame {frame[k + 1]}{times}"
        return stated(name, text, "doubtful", cause=f"{cause} at that frame, or it shakes", file=settings.film)
    runs = [run for run in np.split(np.arange(at.size), np.flatnonzero(~is_one) + 1) if run.size > 2]
    places = np.array([[np.median(x[run]), np.median(y[run])] for run in runs]).reshape(-1, 2)
    creeps = _creep(time, np.column_stack([x, y]), own, runs)
    apart = np.hypot(*np.diff(places, axis=0).T) if len(runs) > 1 else np.zeros(1)
    k = int(np.argmax(apart))
    far, play = float(apart[k]), _PLAY / float(radius["pixel_size"])
    text = f"{settings.film}: the contacts stand within {far:.3g} px of each other"
    if creeps is not None and (moved := creeps * float(np.ptp(radius["time"].values))) > _STEADY:
        text = f"{settings.film}: every contact drifts in the image, evenly, by {in_words(moved, 2)} px during the film"
        cause += ": it creeps; radii do not suffer"
        level: Level = "doubtful" if moved > _WANDERS * play else "note"
        return stated(name, text, level, cause=cause, file=settings.film)
    if far <= play:
        return stated(name, text, None, file=settings.film)
    text = f"{settings.film}: the contact from frame {frame[runs[k + 1][0]]} on stands {far:.3g} px from the last"
    cause += " in the flight before, the sphere's guide has play, or two films were joined"
    return stated(name, text, "doubtful" if far > _WANDERS * play else "note", cause=cause, file=settings.film)


def _creep(time: Floats, place: Floats, own: Floats, runs: list[NDArray[np.int64]]) -> float | None:
    """Return the speed (px/s) at which the middle (frame, axis) of each contact moves alike; None where none does.

    A contact sticks, and what makes one larger or smaller lets its middle stay. Two contacts tell a speed, each by
    itself.
    """
    told: list[tuple[Floats, float]] = []
    for run in (run for run in runs if run.size >= _MANY):
        since = time[run] - np.average(time[run], weights=own[run] ** -2)
        weight = since / own[run] ** 2
        speed = weight @ place[run] / (weight @ since)
        left = place[run] - np.average(place[run], axis=0, weights=own[run] ** -2) - np.outer(since, speed)
        spread = float(np.sum((left / own[run][:, None]) ** 2)) / (2 * run.size - 4)
        told.append((speed, float(spread / (weight @ since))))
    if len(told) < 2:
        return None
    of_all = np.average([speed for speed, _ in told], axis=0, weights=[1.0 / square for _, square in told])
    size = float(np.hypot(*of_all))
    is_told = size > 0.0 and all(
        speed @ of_all / size > _EACH * sqrt(square) and np.hypot(*(speed - of_all)) < _ALIKE * sqrt(square)
        for speed, square in told
    )
    return size if is_told else None


def _positive(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Look for contacts that are brighter than the gap around them."""
    name = "dark contacts"
    phase = float(radius.attrs.get("phase", np.nan))
    if settings.wavelength is None or not isfinite(phase) or not edges_only(radius)[1]:
        return not_made(name, "a wavelength, and fringes that the film resolves")
    if cos(phase) < 0.0:
        return stated(name, f"{settings.film}: contacts are dark", None, file=settings.film)
    cause = "the images are negative (inverted grey levels), or plate or sphere is coated or wet; radii do not suffer"
    return stated(name, f"{settings.film}: contacts are bright", "note", cause=cause, file=settings.film)

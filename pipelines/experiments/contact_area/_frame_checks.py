"""Whether a film of a contact shows every frame once, whole, at its time, and where the contact is largest."""

import json
from math import nan

import numpy as np
import xarray as xr

from labpipe.judging import Check, not_made, stated
from labpipe.report import quantity
from pipelines.experiments.contact_area.measured import FRINGE_FIT, READ
from pipelines.experiments.contact_area.settings import ContactArea
from pipelines.experiments.shared.film_frames import no_copies, sound_frames
from pipelines.experiments.shared.frame_order import in_order, lost

_NAMED = 5  # frames that a sentence names
_WHOLE = 5  # frames of an impact, from which on the largest radius lies between the first and the last
_ALIKE = 0.5  # of the frames of a contact, that fringes tell where its course is judged
_LATE = 1.5  # of the usual interval between frames in contact, from which some are missing


def frame_checks(radius: xr.Dataset, whole: Check, settings: ContactArea) -> list[Check]:
    """Look for frames that are damaged, blank, repeated, exchanged, or at a wrong time.

    ``whole`` tells what the file lacks.
    """
    sound = sound_frames(radius["valid"].values.astype(bool), whole, settings.film)
    checks = [of(radius, settings) for of in (_times, _blanked, _copies, _in_order)]
    return [*checks, sound]


def summits_seen(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea) -> Check:
    """Look for contacts in which frames are missing beside the largest radius that was seen."""
    name = "frames of the contacts"
    time, a = radius["time"].values, np.nan_to_num(radius["radius"].values)
    steps = np.diff(time)
    seen = [
        np.flatnonzero((time >= first) & (time <= last))
        for first, last in zip(impacts["first_seen"].values, impacts["last_seen"].values, strict=True)
    ]
    inside = np.concatenate([steps[at[:-1]] for at in seen])
    usual = float(np.median(inside)) if inside.size else nan
    tops = [int(at[np.argmax(a[at])]) for at in seen]
    lost = [k for top in tops for k in (top - 1, top) if 0 <= k < steps.size and steps[k] > _LATE * usual]
    if not lost:
        return stated(name, f"{settings.film}: frames are there about every largest radius", None)
    at, frames = lost[0], radius["frame"].values
    text = f"{settings.film}: {quantity(float(steps[at]), 's')} pass between frames {frames[at]} and {frames[at + 1]}, "
    text += f"usual are {quantity(usual, 's')}; one of them shows the largest radius of a contact"
    cause = "the camera recorded in bursts or dropped frames: the contact may have been larger between them"
    return stated(name, text, "doubtful", cause=cause, file=settings.film)


def none_lost(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea) -> Check:
    """Look for frames that are missing within a contact whose others were numbered anew."""
    name = "course of the contacts"
    time, frame = radius["time"].values, radius["frame"].values
    area, u = radius["radius"].values ** 2, 2 * radius["radius"].values * radius["u_radius"].values
    known, method = np.isfinite(area) & np.isfinite(u), radius["method"].values
    for number, (first, last) in enumerate(zip(impacts["first_seen"].values, impacts["last_seen"].values, strict=True)):
        at = np.flatnonzero((time >= first) & (time <= last) & known)
        steps = np.diff(time[at])
        # of uneven frames the times tell, and what changes from one method to another is no loss
        if not steps.size or steps.max() > _LATE * steps.min() or np.mean(method[at] == FRINGE_FIT) < _ALIKE:
            continue
        found = lost(area[at], float(np.sqrt(np.mean(u[at] ** 2))))
        if found is not None:
            before = int(frame[at[found]])
            text = (
                f"{settings.film}: the area of the contact in impact {number + 1} is smooth only if frames are missing "
                f"after frame {before}"
            )
            cause = f"frames after frame {before} were lost, and the others numbered anew: no time of theirs tells it"
            return stated(name, text, "doubtful", cause=cause, file=settings.film)
    return stated(name, f"{settings.film}: the areas of all contacts are smooth", None, file=settings.film)


def contacts_whole(radius: xr.Dataset, impacts: xr.Dataset, settings: ContactArea) -> Check:
    """Look for frames without a contact between frames that show it."""
    name = "contacts without gaps"
    time, frame = radius["time"].values, radius["frame"].values
    shows = radius["in_contact"].values.astype(bool) | ~radius["valid"].values.astype(bool)
    inside = np.zeros(time.size, bool)
    for first, last in zip(impacts["first_seen"].values, impacts["last_seen"].values, strict=True):
        inside |= (time > first) & (time < last)
    lost = frame[inside & ~shows]
    cause = (
        "the contact is hidden there or its fringes are spoiled (glare, speckle, blur, a lost image), or frames beside "
        "each other are exchanged: look at these"
    )
    halved = _halved(radius, impacts)
    if not lost.size and halved is None:
        return stated(name, f"{settings.film}: every frame of an impact shows its contact", None)
    if halved is not None:
        number, at, beside = halved
        text = f"{settings.film}: impact {number} is largest in frame {frame[at]}, and frame {frame[beside]} beside it "
        return stated(name, f"{text}shows no contact", "doubtful", cause=cause, file=settings.film)
    which = ", ".join(str(int(k)) for k in lost[:_NAMED]) + (", …" if lost.size > _NAMED else "")
    named, show = ("frame", "shows") if lost.size == 1 else ("frames", "show")
    text = f"{settings.film}: {named} {which} within an impact {show} no contact"
    return stated(name, text, "doubtful", cause=cause, file=settings.film)


def _halved(radius: xr.Dataset, impacts: xr.Dataset) -> tuple[int, int, int] | None:
    """Find an impact that begins or ends at its largest: its number, that frame, and the one beside it."""
    time, a = radius["time"].values, np.nan_to_num(radius["radius"].values)
    for number, (first, last) in enumerate(zip(impacts["first_seen"].values, impacts["last_seen"].values, strict=True)):
        seen = np.flatnonzero((time >= first) & (time <= last))
        if seen.size < _WHOLE:
            continue
        usual = float(np.median(np.diff(time[seen])))
        for at, beside in ((seen[0], seen[0] - 1), (seen[-1], seen[-1] + 1)):
            is_next = 0 <= beside < time.size and abs(time[beside] - time[at]) < _LATE * usual
            if is_next and bool(radius["valid"].values[beside]) and a[at] == a[seen].max() > 0.0:
                return number + 1, int(at), int(beside)
    return None


def _times(radius: xr.Dataset, settings: ContactArea) -> Check:
    name = "times of the frames"
    steps = np.diff(radius["time"].values)
    wrong = np.flatnonzero(~(steps > 0))
    if wrong.size:
        at = int(radius["frame"].values[wrong[0] + 1])
        text = f"{settings.film}: frame {at} is not later than the one before ({wrong.size} such frames)"
        cause = f"frames are exchanged or repeated at frame {at}"
        return stated(name, text, "impossible", cause=cause, file=settings.film)
    return stated(name, f"{settings.film}: {steps.size + 1} frames in order", None, file=settings.film)


def _blanked(radius: xr.Dataset, settings: ContactArea) -> Check:
    name = "whole frames"
    if "blanked" not in radius.attrs:
        return not_made(name, "the frames")
    found = {int(i): int(size) for i, size in json.loads(radius.attrs["blanked"]).items()}
    if not found:
        return stated(name, f"{settings.film}: no pixels are missing in frames about a contact", None)
    first, size = next(iter(found.items()))
    more = f"; {len(found)} such frames" if len(found) > 1 else ""
    text = f"{settings.film}: {size} pixels in a row of frame {first} are blank, those before them are not{more}"
    cause = f"pixels of frame {first} were lost: the film was not copied whole, was damaged, or the light failed"
    return stated(name, text, "doubtful", cause=cause, file=settings.film)


def _copies(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Look for frames whose pixels are those of the one before, or that are measured alike to the last digit."""
    read = np.isin(radius["method"].values, READ)
    # at rest a frame like the one before is not read again
    same = read[1:] & read[:-1]
    for column in ("radius", "centre_x", "centre_y"):
        if column in radius:
            same &= np.diff(radius[column].values) == 0.0
    frame = radius["frame"].values
    return no_copies(settings.film, frame, same | np.isin(frame[1:], json.loads(radius.attrs.get("repeated", "[]"))))


def _in_order(radius: xr.Dataset, settings: ContactArea) -> Check:
    """Look for exchanged frames by the area, which goes with the depth and so is smooth where a contact begins."""
    touches, a, u = (radius[n].values for n in ("in_contact", "radius", "u_radius"))
    area = np.where(touches, a**2, np.where(radius["valid"], 0.0, nan))
    measured = touches & np.isfinite(a * u)
    noise = float(np.median(2 * a[measured] * u[measured])) if measured.any() else 0.0
    return in_order(settings.film, radius["frame"].values, area, noise, radius["time"].values, ~touches)

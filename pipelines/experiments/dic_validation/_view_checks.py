"""Whether the camera of a falling holder stands still and upright, and sees one scale all along the motion."""

import json
from math import cos, degrees, isfinite, nan

import numpy as np
import xarray as xr

from labpipe.judging import Check, Level, in_words, not_made, stated
from labpipe.report import quantity, value_with_uncertainty
from pipelines.experiments.dic_validation import viewing_angle
from pipelines.experiments.dic_validation.measured import statuses
from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.experiments.shared.record_checks import Trace, swing_at_rest

BEGINNING = "beginning of the film"
_NO_MOTION = "four frames of a motion that is clear of the noise"
_MATTERS = 0.5  # of the uncertainty of the scale, by which the camera's angle may change lengths untold
_ASIDE = 0.15  # px to either side, beyond what the interpolation between pixels leaves
_CREEPS = 0.5  # px to one side during a film
_FEWEST = 40  # frames
_SURE = 10.0  # standard uncertainties of a speed that is no noise
_BEFORE = 2e-3  # s before the release, while which something may move already
_FIRST, _MOVES = 12, 0.15  # frames that tell how fast it moves in the first, and the share of its top speed that counts
_SWINGS, _ONE = 0.02, 4.0
"""Of the fall, by which a swing or a drift spoils it; standard uncertainties by which two speeds are one, or none."""
_STILL, _PASSES, _CLEAR = 5, 6, 0.02
"""First frames that tell a level, the times that a swing passes it, and the part of the motion of one such step."""
_IN_NOISE = 10.0  # standard uncertainties from lowest to highest, within which nothing moves
_MOST_DOWN, _SLOW = 0.95, 5.0  # of a way down that is timed, and times as long as a fall that it takes if driven


def direction(motion: xr.Dataset, settings: DicValidation) -> Check:
    """Look for a motion aslant in the image: of a camera that is turned, or of another body."""
    name = "direction of the motion"
    angle, u = float(motion["direction"]), float(motion["u_direction"])
    if not isfinite(angle):
        return not_made(name, _NO_MOTION)
    text = f"{settings.film}: the holder moves at {value_with_uncertainty(degrees(angle), degrees(u), 'deg')} "
    text += f"to the image's columns, whose vertical part is {in_words(100 * (1 - cos(angle)), 2)} % shorter"
    if abs(angle) > viewing_angle.STRAIGHT:
        cause = "the film was turned when it was exported, or tracking.body follows something else than the holder"
        return stated(name, text, "doubtful", cause=cause, file=settings.film, setting="tracking.body")
    matters = 1.0 - cos(angle) > _MATTERS * float(motion["u_pixel_size"] / motion["pixel_size"])
    text += "; displacements are those along the motion"
    cause = "the camera is turned about its axis, or the holder is led aslant"
    return stated(name, text, "note" if matters else None, cause=cause, file=settings.film)


def tilt(motion: xr.Dataset, settings: DicValidation) -> Check:
    """Look for a camera that looks up or down, which makes lengths along the motion too short."""
    name = "tilt of the camera"
    angle, u = float(motion["tilt"]), float(motion["u_tilt"])
    if not isfinite(angle):
        return not_made(name, _NO_MOTION)
    short = 1.0 - cos(angle or viewing_angle.most_unseen(u))
    matters = short > _MATTERS * float(motion["u_pixel_size"] / motion["pixel_size"])
    level: Level | None = "note" if matters else None
    if angle == 0.0:
        hidden = in_words(degrees(viewing_angle.most_unseen(u)), 2)
        text = f"{settings.film}: the holder does not grow or shrink; a tilt up to {hidden}° would not be seen, "
        text += f"nor displacements that are too short by {100 * short:.2g} %"
        cause = "where the camera may be tilted, a longer fall tells by how much"
        return stated(name, text, level, cause=cause, file=settings.film)
    shown = value_with_uncertainty(degrees(angle), degrees(u), "deg")
    if settings.camera_distance is not None:
        text = f"{settings.film}: the camera looks up or down by {shown}; displacements are longer by "
        text += f"{100 * short:.2f} % for it"
        return stated(name, text, None)
    text = f"{settings.film}: at a usual distance of {quantity(viewing_angle.USUAL_DISTANCE, 'm')} the camera looks up "
    text += f"or down by {shown}, and displacements are too short by {100 * short:.2f} %"
    cause = "the camera is tilted: state camera_distance, and displacements are corrected"
    return stated(name, text, level, cause=cause, file=settings.film, setting="camera_distance")


def one_scale(motion: xr.Dataset, settings: DicValidation) -> Check:
    """Look for a holder that grows or shrinks in the image while it moves."""
    name = "one scale along the motion"
    growth = float(motion["growth"])
    if not isfinite(growth):
        return not_made(name, _NO_MOTION)
    change = abs(growth) * float(np.nanmax(np.abs(motion["displacement"].values)))
    matters = change > _MATTERS * float(motion["u_pixel_size"] / motion["pixel_size"])
    text = f"{settings.film}: the length of one pixel changes by {100 * change:.2f} % along the motion"
    cause = (
        "the camera looks up or down at the motion, the holder comes closer or goes away, or zoom or focus changes"
        if matters
        else ""
    )
    return stated(name, text, "note" if matters else None, cause=cause, file=settings.film)


def still_before(motion: xr.Dataset, bounces: xr.Dataset | None, settings: DicValidation) -> Check:
    """Look for one frequency in a holder that should hang still before its release."""
    name = "vibration before the release"
    time, y = motion["time"].values, motion["displacement"].values
    release = np.nan if bounces is None else float(bounces["release_time"])
    end = int(np.searchsorted(time, release - _BEFORE)) if isfinite(release) else 0
    if end < _FEWEST:
        return not_made(name, f"{_FEWEST} frames before the release")
    trace = Trace(settings.film, time, y)
    found = swing_at_rest(trace, slice(0, end), _FEWEST)
    if found is None:
        return stated(name, f"{settings.film}: the holder hangs still before its release", None)
    f, amplitude = found
    text = f"{settings.film}: before its release the holder swings at {f:.3g} Hz by ± {quantity(amplitude, 'm')}"
    cause = f"the camera, its mirror, its lamp or the holder vibrates at {f:.3g} Hz: fasten it"
    level: Level = "doubtful" if 2 * amplitude > _SWINGS * trace.travel else "note"
    return stated(name, text, level, cause=cause, file=settings.film)


def stands(motion: xr.Dataset, bounces: xr.Dataset | None, settings: DicValidation) -> Check:
    """Look for a holder that moves at one speed before its release: it is the image that creeps."""
    name = "level before the release"
    time, y = motion["time"].values, motion["displacement"].values
    release = nan if bounces is None else float(bounces["release_time"])
    held = np.flatnonzero((time < release - _BEFORE) & np.isfinite(y))
    if held.size < 2 * _FIRST:
        return not_made(name, f"{2 * _FIRST} frames before the release")
    told = []
    for at in np.array_split(held, 2):  # a swing moves it to and fro
        fit, spread = np.polyfit(time[at] - time[at[0]], y[at], 1, cov=True)
        told.append((float(fit[0]), float(spread[0, 0])))
    (before, u_before), (after, u_after) = told
    speed = (before / u_before + after / u_after) / (1.0 / u_before + 1.0 / u_after)
    moved = abs(speed) * float(np.ptp(time))
    is_one = abs(before - after) < _ONE * float(np.sqrt(u_before + u_after))
    creeps = is_one and all(each * speed > _ONE * abs(speed) * float(np.sqrt(u)) for each, u in told)
    if not creeps or moved < _CREEPS * float(motion["pixel_size"]):
        return stated(name, f"{settings.film}: the image does not creep along the fall", None, file=settings.film)
    text = f"{settings.film}: the holder's image creeps {'up' if speed > 0.0 else 'down'} before the release, in the "
    text += f"whole film by {quantity(moved, 'm', 2)} if it goes on so"
    cause = "the camera or its stand creeps, and displacements with it: fasten it"
    level: Level = "doubtful" if moved > _SWINGS * float(np.nanmax(y) - np.nanmin(y)) else "note"
    return stated(name, text, level, cause=cause, file=settings.film)


def no_fall(motion: xr.Dataset, gravity: float) -> str:
    """Say how something moves that was not let go: it swings about its first level, or goes down too slowly."""
    known = np.flatnonzero(np.isfinite(motion["displacement"].values))
    time, y = motion["time"].values[known], motion["displacement"].values[known]
    if known.size <= _FEWEST:
        return ""
    moved = y - np.median(y[:_STILL])
    if np.ptp(moved) < _IN_NOISE * float(np.median(motion["u_displacement"].values[known])):
        return (
            "what is followed hangs still throughout: the film was triggered at another time, or ends before the "
            "release, or tracking.body is on what stands still"
        )
    through = np.flatnonzero(np.diff(moved > 0.0) & (np.abs(np.diff(moved)) > _CLEAR * np.ptp(moved)))
    shown = "; its displacement is on the experiment's page and in the step motion"
    if through.size >= _PASSES:
        f = (through.size - 1) / 2.0 / float(time[through[-1]] - time[through[0]])
        amplitude = quantity(float(np.max(np.abs(moved))), "m", 2)
        return (
            f"what is followed swings about its first level by up to {amplitude}, at about {f:.3g} Hz: it vibrates, as "
            f"the plate does, and was not dropped{shown}"
        )
    down = -float(np.min(moved))
    lowest = int(np.argmax(moved <= -_MOST_DOWN * down))
    begun = int(np.flatnonzero(moved[: lowest + 1] >= -(1.0 - _MOST_DOWN) * down)[-1]) if down > 0.0 else 0
    seen, free = float(time[lowest] - time[begun]), float(np.sqrt(2.0 * max(down, 0.0) / gravity))
    if not 0.0 < _SLOW * free < seen:
        return ""
    way, took, falls = quantity(down, "m", 2), quantity(seen, "s", 2), quantity(free, "s", 2)
    return (
        f"what is followed takes {took} to go down by {way}, which a free fall does in {falls}: it is driven or "
        f"held, as a punch is, or the frame rate is far too low{shown}"
    )


def begins_at_rest(motion: xr.Dataset, settings: DicValidation) -> Check:
    """Look for a film that begins after the release, or after the first impact."""
    name = BEGINNING
    known = np.flatnonzero(np.isfinite(motion["displacement"].values))
    time, y = motion["time"].values[known], motion["displacement"].values[known]
    if known.size <= _FIRST:
        return not_made(name, f"{_FIRST} frames with the holder")
    fit, spread = np.polyfit(time[:_FIRST] - time[0], y[:_FIRST], 2, cov=True)
    speed, fastest = float(fit[1]), float(np.max(np.abs(np.diff(y) / np.diff(time))))
    if abs(speed) < max(_SURE * float(np.sqrt(spread[1, 1])), _MOVES * fastest):
        return stated(name, f"{settings.film}: the holder is at rest in the first frame", None, file=settings.film)
    text = f"{settings.film}: the holder moves {'up' if speed > 0.0 else 'down'} by {quantity(abs(speed), 'm/s')} in "
    text += "the first frame"
    if speed < 0.0:
        cause = "the film begins too late, after the release: where the holder hung is not seen"
        return stated(name, text, "note", cause=cause, file=settings.film)
    cause = "the film begins too late, after an impact: the first that it shows is a later one of the drop, and weaker"
    return stated(name, text, "doubtful", cause=cause, file=settings.film)


def sideways(track: xr.Dataset, settings: DicValidation) -> Check:
    """Look for a holder's image that swings or drifts aside: along the fall that hides in the motion."""
    name = "motion across the fall"
    of_body = track.isel(point=0)
    across, along = (np.where(of_body["valid"], of_body[of].values, np.nan) for of in ("dx", "dy"))
    known = np.flatnonzero(np.isfinite(across * along))
    if known.size < _FEWEST:
        return not_made(name, f"{_FEWEST} frames with the holder")
    # a camera that is turned, or a holder that turns, moves it aside as it moves along; what creeps does evenly
    time = track["time"].values[known]
    columns = np.column_stack([time - time[0], np.vander(along[known] / max(np.ptp(along[known]), 1.0), 3)])
    fitted, *_ = np.linalg.lstsq(columns, across[known])
    trace = Trace(settings.film, time, across[known] - columns @ fitted)
    found, drift = swing_at_rest(trace, slice(0, known.size), _FEWEST), abs(fitted[0]) * float(np.ptp(time))
    if (found is None or found[1] < _ASIDE) and drift > max(_CREEPS, np.ptp(trace.reading)):
        text = f"{settings.film}: the holder's image drifts aside, evenly, by {drift:.2g} px during the film"
        cause = "the camera or its stand creeps, or the holder slides or turns: along the fall it may move as much"
        return stated(name, text, "note", cause=cause, file=settings.film)
    if found is None or found[1] < _ASIDE:
        return stated(name, f"{settings.film}: the holder falls straight", None, file=settings.film)
    f, amplitude = found
    text = f"{settings.film}: the holder's image swings aside by ± {amplitude:.2g} px at {f:.3g} Hz"
    cause = f"the camera, its mirror or the holder vibrates at {f:.3g} Hz: along the fall it may move the image as much"
    return stated(name, text, "note", cause=cause, file=settings.film)


def seen_whole(track: xr.Dataset, settings: DicValidation) -> Check:
    """Look for what stands still before the holder though no obstruction is stated."""
    name = "view of the holder"
    nothing = [f"[{number}]" for number in json.loads(track.attrs.get("hides_nothing", "[]"))]
    if nothing:
        text = f"{settings.film}: in tracking.obstructions{' and '.join(nothing)} the pattern moves with the holder: "
        text += "nothing stands there, and what may hide the holder elsewhere is not left out by it"
        cause = "the polygon is not drawn in px of the first image, x to the right and y down, or is of another film"
        return stated(name, text, "note", cause=cause, file=settings.film, setting="tracking.obstructions")
    hidden = int((statuses(track) == "occluded").sum()) if "status" in track else 0
    if not hidden:
        return stated(name, f"{settings.film}: nothing else was found before the holder", None, file=settings.film)
    cause = (
        "a rod, a scale bar or a line burned into the images, dust on a window, or what is seen around the holder: "
        "draw tracking.obstructions around it"
    )
    text = f"{settings.film}: in {hidden} frames something hides a part of the holder, which has no value there"
    return stated(name, text, "note", cause=cause, file=settings.film, setting="tracking.obstructions")

"""Checks of a film of a falling holder: its frames and light, view, rest, free fall, bounces, and the laser."""

from collections.abc import Iterator
from dataclasses import replace
from math import exp, hypot, nan

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.judging import Cause, Check, Level, compared, in_words, not_made, stated
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from labpipe.workflow.fields import REFERENCE
from pipelines.experiments.dic_validation.comparison import rows
from pipelines.experiments.dic_validation.measured import statuses
from pipelines.experiments.dic_validation.settings import DicValidation
from pipelines.experiments.shared import fall_checks, judgements
from pipelines.experiments.shared.fall_checks import HEIGHT, Fall, G
from pipelines.experiments.shared.film_frames import CAUSES, explained, frame_times, no_copies, sound_frames, whole_film
from pipelines.experiments.shared.film_light import exposed
from pipelines.experiments.shared.film_stated import of_rate, stated_twice, wrong_rate
from pipelines.experiments.shared.frame_order import in_order
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.judgements import Scene, Title

_GRAVITY = Quantity(9.81, 0.0, "m/s2")
_BETWEEN_DAYS = 0.01
"""Relative difference of two drops from one height, set anew on another day."""
_FOUND = 0.9  # of the frames in which the holder should be found
_SOLVED, _ALIKE = 1e-4, 1e-6
"""By which places [px] and correlations of one image differ that is solved for from other
beginnings; noise changes them by more."""
_MOSTLY = 0.5  # of the frames that have no value for one reason
_GROWS = 2e-3  # least relative jump of the image's size
_UPSIDE_DOWN = "the film is upside down: the camera was, or the film was turned or mirrored when it was exported"
_MENDS = {f"tracking.{name}": f"tracking.{name}" for name in ("body", "body_subset", "line")}
_MENDS |= {name: f"tracking.{name}" for name in ("regions", "covers", "obstructions")}
_POLYGON = "the polygon is not drawn in px of the first image, x to the right and y down, or around something else"
_KNOCKED = 0.02  # of the travel, by which a level jumps that counts
_STEP = 0.02  # of the usual interval between frames, by which others may differ
_FEWEST_BENDS = 20  # bends of the motion that tell its noise
_IN_NOISE, _RETURNS = 10.0, 0.3
"""Standard deviations of noise of a jump, and the share of it by which the frames beside it may bend."""
_SURE = 10.0  # standard uncertainties of a speed that is no noise
_FIRST, _MOVES = 12, 0.15  # frames that tell how fast it moves in the first, and the share of its top speed that counts
_FAILED = CAUSES | {
    reason: f"{setting} does not lie in the images" if reason == setting else _POLYGON
    for reason, setting in _MENDS.items()
}
_FAILED |= {
    "track": "the film is not what the session says, or was not copied whole",
    "motion": "the calibration record is of another view or day, or tracking.body is not on the holder",
    "bounces": "the film shows no drop or a part of it: another film, a cut one, or tracking.body is not on the holder "
    "(as in a film that was turned or mirrored)",
}
GAIN = "scale against the laser"
BEGINNING = "beginning of the film"
_BY_JUMPS = ("coefficients of restitution", HEIGHT)
_STEPS = ("track", "motion", "bounces", "comparison", "laser")


TITLES = {
    **judgements.OF_FILM,
    "view of the holder": Title(
        "The holder is found in every frame.",
        (
            "holder is found",
        ),
    ),
    "rest before the release": Title(
        "Before its release the holder is at rest.",
        (BEGINNING, "level between frames"),
    ),
    "free fall": Title(
        "Every flight is a parabola with the acceleration of gravity.",
        ("direction of the fall", G, "durations of the flights"),
    ),
    "order of the bounces": Title(
        "0 < e < 1: every rebound is lower than the one before.",
        ("coefficients of restitution",),
    ),
    "comparison with the laser": Title(
        "Film and laser show one height and one scale of length.", (HEIGHT, GAIN)
    ),
}  # fmt: skip


@judgements.judging(*_STEPS, rests_on=("laser_experiment",), expected=("comparison", "laser"), titles=TITLES)
def judgement(given: Given, basis: judgements.Basis, settings: DicValidation, context: Context) -> Scene:
    """Judge one film; a step without a result is judged by its error."""
    track, motion, bounces, comparison, laser = map(given.get, _STEPS)
    whole = whole_film(context, settings.film)
    checks = [explained(check, whole) for check in judgements.failed_steps(context, _FAILED, _MENDS)]
    checks.append(judgements.day_known(motion, settings.camera, settings.film))
    if track is not None:
        checks += stated_twice(track, settings.film, settings.frame_rate)
        found = _found(track, settings)
        if whole.level and found.level:  # frames that the file lacks show no holder
            found = replace(found, cause=whole.cause, setting="")
        # of a holder that is not found, what the images show is the better cause
        checks = judgements.because(checks, found.cause if found.level else "", "step motion")
        along = track["dy"].isel(point=0).values
        checks += [found, _copies(track, settings), in_order(settings.film, track["frame"].values, along)]
        is_sound = np.ones(int(track["frame"][-1]) + 1, bool)  # frames that were not read are assumed to be
        if "status" in track:
            is_sound[track["frame"].values] = statuses(track) != "frame_damaged"
        checks.append(sound_frames(is_sound, whole, settings))
        checks.append(exposed(track, settings.film))
    if motion is not None:
        steady = _steady(track, motion, bounces, settings)
        times = _times(motion, bounces, settings)
        # where no bounce was found, times and levels of the frames are the better cause
        better = next((c.cause for c in (times, steady) if c.level), "")
        checks = judgements.because(checks, better, "step bounces")
        checks += [times, steady]
        begins = _begins_at_rest(motion, settings)
        checks.append(begins)
    if motion is not None and bounces is not None and bounces.sizes["impact"]:
        fall = Fall(settings.film, bounces, float(motion.attrs["u_systematic_relative"]))
        height = _height(fall, laser)
        checks += [
            fall_checks.direction(fall, _UPSIDE_DOWN, file=settings.film, setting=""),
            fall_checks.acceleration(fall, _GRAVITY),
            *judgements.because([height], begins.cause if begins.level == "doubtful" else "", HEIGHT, log_ratio=nan),
            fall_checks.restitution(fall),
            fall_checks.flight_durations(fall, _GRAVITY),
        ]
    if any(check.cause == fall_checks.BACKWARDS for check in checks):
        checks = judgements.because(checks, fall_checks.BACKWARDS, HEIGHT, BEGINNING, log_ratio=nan, setting="")
    if motion is not None and steady.level:  # a level that jumps makes rebounds of another height
        checks = judgements.because(checks, steady.cause, *_BY_JUMPS, log_ratio=nan, file=settings.film, setting="")
    if comparison is not None and "gain" in comparison:
        gain, wrong = _gain(comparison, settings), {c.name for c in checks if c.level}
        # of two drops that are not alike, or not in one time, no scale can be told
        is_other, is_untimed = HEIGHT in wrong and G not in wrong, G in wrong and HEIGHT not in wrong
        if not gain.cause and (is_other or is_untimed):
            g = next(check.log_ratio for check in checks if check.name == G)
            cause = of_rate(exp(g / 2)) if is_untimed else f"the film shows another drop than {_laser(settings)}"
            gain = replace(gain, cause=cause, log_ratio=nan)
        checks.append(gain)
    another = f"the film may show another drop than {_laser(settings)}: another sphere, height or day"
    return Scene(checks, list(_causes(track, settings)), given.each([rows]), basis=basis, unstated=another)


def _found(track: xr.Dataset, settings: DicValidation) -> Check:
    name = "holder is found"
    share = float(track["valid"].isel(point=0).mean())
    level: Level | None = None if share >= _FOUND else "doubtful"
    message = f"{settings.film}: the holder was found in {100 * share:.1f} % of the frames"
    cause = (
        "damaged or missing frames, a film that is upside down, or tracking.body, [x to the right, y down], is not on "
    )
    cause += "the holder"
    status = statuses(track) if "status" in track else np.empty(0, str)
    if status.size and np.mean(status == "saturated") > _MOSTLY:
        cause = "the film is over-exposed or dark: the holder's pixels lie at white or at black"
    return stated(name, message, level, cause=cause, setting="tracking.body")


def _times(motion: xr.Dataset, bounces: xr.Dataset | None, settings: DicValidation) -> Check:
    time = motion["time"].values
    begin, end = time[:-1], time[1:]
    if bounces is None:  # after rest only every eighth frame is read
        usual = np.abs(end - begin - np.median(end - begin)) < _STEP * np.median(end - begin)
        moves = np.arange(begin.size) < np.flatnonzero(usual).max(initial=0)
    else:
        release, rest = (float(bounces[name]) for name in ("release_time", "rest_time"))
        moves = ~((end <= release) | (begin >= rest))
    return frame_times(settings.film, np.arange(time.size), time, moves)


def _copies(track: xr.Dataset, settings: DicValidation) -> Check:
    """Look for frames that show the holder exactly as the frame before, within the tolerance of the solver."""
    of_body, frame = track.isel(point=0), track["frame"].values
    limits = (("dx", _SOLVED), ("dy", _SOLVED), ("zncc", _ALIKE))
    alike = np.all([np.abs(np.diff(of_body[of].values)) <= limit for of, limit in limits], axis=0)
    return no_copies(settings.film, frame, alike & (np.diff(frame) == 1))


def _steady(track: xr.Dataset | None, motion: xr.Dataset, bounces: xr.Dataset | None, settings: DicValidation) -> Check:
    """Look for a place or a size of the holder's image that jumps between two frames."""
    name, time, y = "level between frames", motion["time"].values, motion["displacement"].values
    if np.isfinite(np.diff(y, 2)).sum() < _FEWEST_BENDS:
        return not_made(name, "twenty frames in a row")
    # where bounces are not found, smaller jumps count too
    found = _jump(time, y, 0.0 if bounces is None else _KNOCKED * float(np.nanmax(y) - np.nanmin(y)))
    cause = "frames were lost, two films were joined, the camera or its mirror was knocked, or the track slipped"
    seen = "" if found is None else f"place jumps by {quantity(found[1], 'm')}"
    if track is not None:  # a change of size shifts the image too
        body = track.isel(point=0)
        size = 0.5 * (body["stretch_x"].values + body["stretch_y"].values)
        grown = _jump(body["time"].values, size, _GROWS)
        if grown is not None:
            found, seen = grown, f"image {'grows' if grown[1] > 0.0 else 'shrinks'} by {100 * abs(grown[1]):.2f} %"
            cause = "zoom, focus or distance of the lens changed within the film, films of two views were joined, or "
            cause += "tracking.body holds more than the holder: draw tracking.regions around what moves"
    if found is None:
        return stated(name, f"{settings.film}: no displacement jumps", None, file=settings.film)
    when = quantity(float(motion["time"][found[0] + 1]), "s")
    text = f"{settings.film}: the holder's {seen} between two frames at {when}"
    return stated(name, text, "doubtful", cause=cause, file=settings.film)


def _jump(time: Floats, y: Floats, least: float) -> tuple[int, float] | None:
    """Find the largest jump of a level between two frames: the speed before and after it is one.

    A bounce bends the motion one way. A jump bends it one way and back in the next frame.

    ``y`` (frame,) jumps by ``least`` or more of its unit. Returns the last frame before the jump, and its size, or
    None.
    """
    steps = np.diff(time)
    bend = np.diff(y, 2)
    even = np.abs(steps - np.median(steps)) < _STEP * np.median(steps)
    bend = np.where(even[1:] & even[:-1], bend, np.nan)
    known = bend[np.isfinite(bend)]
    if known.size < _FEWEST_BENDS:
        return None
    noise = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    one, back = bend[1:-2], bend[2:-1]
    size = np.where(one * back < 0, np.minimum(np.abs(one), np.abs(back)), 0.0)
    beside = np.maximum(np.abs(bend[:-3]), np.abs(bend[3:]))
    # where nothing is known beside it, nothing is told
    jumps = np.flatnonzero((size > max(_IN_NOISE * noise, least)) & (beside < _RETURNS * size))
    if not jumps.size:
        return None
    at = int(jumps[np.argmax(size[jumps])]) + 2
    return at, float(y[at + 1] - y[at])


def _begins_at_rest(motion: xr.Dataset, settings: DicValidation) -> Check:
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


def _height(fall: Fall, laser: xr.Dataset | None) -> Check:
    if laser is None or not laser.sizes.get("impact"):
        return not_made(HEIGHT, "a laser experiment")
    seen, own = fall.value("drop_height")
    expected = float(laser["incoming_speed"][0]) ** 2 / (2 * _GRAVITY.value)
    u = hypot(own, seen * fall.relative)
    message = f"{fall.name}: the holder fell {fall_checks.shown(seen, u, 'm')}, at the laser {quantity(expected, 'm')}"
    other = _BETWEEN_DAYS * expected
    return compared(HEIGHT, message, seen, u, expected, other, allowance=3 * other, file=fall.name)


def _laser(settings: DicValidation) -> str:
    return (settings.laser_experiment or "").removeprefix(REFERENCE)


def _gain(comparison: xr.Dataset, settings: DicValidation) -> Check:
    gain = float(comparison["gain"])
    expected, u = 1.0, float(comparison["expected_u_gain"])
    message = f"{settings.film}: lengths are {1 / gain:.4g} times those of the laser" if gain else settings.film
    other = hypot(u, _BETWEEN_DAYS)
    if gain < 0.0:
        return not_made(GAIN, "a film that shows the laser's motion and not its opposite")
    return compared(
        GAIN, message, gain, float(comparison["u_gain"]), expected, other, allowance=0.03, file=settings.camera
    )


def _causes(track: xr.Dataset | None, settings: DicValidation) -> Iterator[Cause]:
    yield judgements.wrong_scale({G: 1.0, HEIGHT: 1.0, GAIN: -1.0}, settings.camera)
    yield wrong_rate({G: 2.0}, settings.frame_rate, track, settings.film)

    def of_height(factor: float) -> str:
        text = f"the film is of a drop from a height {in_words(factor)} times that of {_laser(settings)}"
        return f"{text}: film or laser_experiment is another one"

    yield Cause({HEIGHT: 1.0}, of_height, setting="laser_experiment")

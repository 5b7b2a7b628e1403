"""Checks of a film: whole, in order, steadily lit and exposed, with the rate and exposure that a session states."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from labpipe.arrays import Flags, Floats, Integers
from labpipe.errors import EXCHANGED
from labpipe.frames import FrameSource, IncompleteFilmWarning
from labpipe.judging import SLIPS, Cause, Check, Level, in_words, not_made, stated
from labpipe.report import quantity
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.shared.exclusions import excluded

CAUSES = {
    EXCHANGED: "width and height are exchanged in the header of the film, which was edited or damaged: export it again"
}
"""Fault of a film, by the reason of the error that it ends in."""
_NOT_WHOLE = "the film was not copied whole, or is damaged: copy it from the camera again"
_MANY, _MOST = 0.2, 0.5  # of the frames, that make a film doubtful and impossible when they are damaged
_LONGER = 1.5  # of the usual interval between frames, from which some are missing, and of neighbouring ones
_AROUND = 8  # frames read on either side of a contact
_EVERY = 4  # rows and columns of which one is read for the light
_SPREAD = 48  # frames spread over a film whose light is measured, in addition to those that matter
_BRIGHT = 99.0  # percentile that a dark contact does not reach before it fills the view
_CLIPPED, _MOSTLY = 0.002, 0.25  # share of white pixels that is reported, and that spoils a film
DARK = 0.5
"""Share of the usual brightness below which a frame is dark: lamps flicker, but do not fall to half for a frame."""
LIGHT, _SAID = "light", "said_by_file"
_ROUNDED = 0.01  # relative difference of a rate or exposure as a person writes it and as a camera sets it
_BURST = 5.0  # percentile of the intervals that is the one within bursts
_NEAR = 3.0  # factor of the rate, below which another explanation may be meant
_IN_NOISE, _LEFT = 10.0, 0.3
"""Multiple of the usual bend from which a frame is an outlier, and share of the bends that may be left
about two frames which were exchanged back."""
_TRIED = 40  # frames that stand out most; all their pairs are tried
_BESIDE = np.arange(-2, 3)


def whole_film(context: Context, film: str) -> Check:
    """Report the warning of the reader of a film about frames that its file lacks, or that are damaged."""
    warned = (w.text for w in context.warnings if w.category == IncompleteFilmWarning.__name__)
    text = next(warned, "").removeprefix(f"{Path(film).name}: ")
    level: Level | None = "note" if text else None
    message = f"{film}: {text or 'no frame is missing in the file'}"
    return stated("whole film", message, level, cause=_NOT_WHOLE, file=film)


def sound_frames(is_sound: Flags, whole: Check, settings: Any) -> Check:
    """Count damaged frames of a film, without those that are excluded; ``whole`` describes a few of them better."""
    bad = np.flatnonzero(~(is_sound | excluded(settings, "frames", is_sound.size)))
    share = bad.size / max(is_sound.size, 1)
    if whole.level and share < _MANY:
        return whole
    text = f"{settings.film}: {bad.size} damaged {'frame' if bad.size == 1 else 'frames'}"
    text += f", the first is frame {bad[0]}" if bad.size else ""
    level: Level | None = "impossible" if share > _MOST else "doubtful" if share >= _MANY else "note"
    return stated("sound frames", text, level if bad.size else None, cause=_NOT_WHOLE, file=settings.film)


def explained(failed: Check, whole: Check) -> Check:
    """Give a step that failed on a film that is not whole that cause, where nothing better is known."""
    is_known = failed.setting or failed.cause in CAUSES.values()
    is_of_film = whole.level and failed.level == "impossible" and not is_known
    return replace(failed, cause=whole.cause) if is_of_film else failed


def about_contacts(is_seen: Flags) -> Integers:
    """Return the frames that show a contact, and their neighbours."""
    return np.flatnonzero(np.convolve(is_seen, np.ones(2 * _AROUND + 1))[_AROUND : len(is_seen) + _AROUND] > 0)


def repeated(film: FrameSource, is_seen: Flags) -> list[int]:
    """Find the frames about a contact whose every pixel is that of the frame before.

    ``is_seen`` (frame,) are those that show a contact and were measured.
    """
    before: np.ndarray = np.empty(0)
    found, last = [], -1
    for i in (int(i) for i in about_contacts(is_seen) if film.valid[i]):
        image = film[i]
        if last == i - 1 and np.array_equal(image, before):
            found.append(i)
        before, last = image, i
    return found


def no_copies(film: str, frame: Integers, alike: Flags) -> Check:
    """Judge frames by whether each (frame - 1,) is measured as the one before: noise forbids it."""
    at = np.flatnonzero(alike)
    if not at.size:
        return stated("frames differ", f"{film}: no frame equals the one before", None, file=film)
    first = int(frame[at[0] + 1])
    frames = "frame equals" if at.size == 1 else "frames equal"
    text = f"{film}: {at.size} {frames} the one before, the first is frame {first}"
    return stated("frames differ", text, "doubtful", cause=f"frame {first} is a repeated frame", file=film)


def frame_times(film: str, frame: Integers, time: Floats, is_within: Flags) -> Check:
    """Look for frames that are not later than the one before, or that are missing in a motion.

    ``is_within`` (frame - 1,) are the intervals in which something moves; elsewhere a camera may skip frames.
    """
    name, steps = "times of the frames", np.diff(time)
    wrong = np.flatnonzero(~(steps > 0))
    if wrong.size:
        at = int(frame[wrong[0] + 1])
        text = f"{film}: frame {at} is not later than the one before ({wrong.size} such frames)"
        return stated(name, text, "impossible", cause=f"frames are exchanged or repeated at frame {at}", file=film)
    usual = float(np.median(steps[is_within])) if is_within.any() else np.inf
    lost = np.flatnonzero(is_within & (steps > _LONGER * usual))
    if not lost.size:
        return stated(name, f"{film}: {time.size} frames in order", None, file=film)
    count = int(np.sum(np.round(steps[lost] / usual) - 1))
    frames, when = "frame is" if count == 1 else "frames are", quantity(float(time[lost[0]]), "s")
    text = f"{film}: {count} {frames} missing in the motion, the first after frame {frame[lost[0]]} at {when}"
    cause = "the camera dropped frames or recorded in bursts: the motion between them was not seen"
    return stated(name, text, "doubtful", cause=cause, file=film)


def in_order(
    film: str, frames: Integers, y: Floats, noise: float = 0.0, time: Floats | None = None, missed: Flags | None = None
) -> Check:
    """Look for two frames that were exchanged; frames without a value are left out."""
    name, known = "order of the frames", np.flatnonzero(np.isfinite(y))
    found = exchanged(y[known], noise, None if time is None else time[known], None if missed is None else missed[known])
    if found is None:
        return stated(name, f"{film}: no frames are exchanged", None, file=film)
    first, second = (int(frames[known[k]]) for k in found)
    text = f"{film}: frames {first} and {second} show what would follow smoothly at each other's place"
    return stated(name, text, "doubtful", cause=f"frames {first} and {second} are exchanged", file=film)


def exchanged(
    y: Floats, noise: float = 0.0, time: Floats | None = None, missed: Flags | None = None
) -> tuple[int, int] | None:
    """Find two frames that stand at each other's place in a film.

    A body moves smoothly but at impacts, where no exchange makes the motion smoother.

    ``y`` (frame,) is measured in each frame, all numbers, with the standard uncertainty ``noise`` where that exceeds
    their scatter. Where the steps of ``time`` (frame,), in any unit, are uneven nothing is smooth over
    frames. ``missed`` (frame,) are frames in which something may have been overlooked: next to another that is no
    exchange. Returns the places of the two, the earlier first, or None.
    """
    if not y.size:
        return None
    bends = _bends(y, np.arange(y.size))
    out = bends > _IN_NOISE * max(noise, 1.4826 * float(np.median(bends)))
    if time is not None and time.size > 4:  # the two steps on either side of a frame are as long as each other
        around = np.lib.stride_tricks.sliding_window_view(np.pad(np.diff(time), 2, mode="edge"), 4)
        out &= around.max(axis=1) < _LONGER * np.abs(around).min(axis=1)
    places = np.flatnonzero(out)
    places = np.sort(places[np.argsort(bends[places])[-_TRIED:]])
    best, found = _LEFT, None
    for i, j in combinations(places.tolist(), 2):
        if j == i + 1 and missed is not None and missed[i : j + 1].any():
            continue
        near = np.unique(np.clip(np.concatenate([i + _BESIDE, j + _BESIDE]), 0, y.size - 1))
        back = y.copy()
        back[[i, j]] = y[[j, i]]
        left = float(_bends(back, near).sum() / _bends(y, near).sum())
        if left < best:
            best, found = left, (i, j)
    return found


def _bends(y: Floats, at: Integers) -> Floats:
    """Return how far values lie from the cubic through the two neighbours on either side."""
    before2, before, after, after2 = (y[np.clip(at + step, 0, y.size - 1)] for step in (-2, -1, 1, 2))
    return np.abs(y[at] - (4.0 * (before + after) - before2 - after2) / 6.0)


def light_of(film: FrameSource, wanted: Iterable[int]) -> str:
    """Measure the brightness of frames and the share of their pixels that are white, as JSON.

    Frames all over the film are added to those that are ``wanted``. Returned are ``brightness`` by frame over that of
    the film, ``clipped``, the share of pixels at the grey level ``level`` of white, and ``view``, rows and columns.
    """
    spread = np.linspace(0, len(film) - 1, min(_SPREAD, len(film))).round().astype(int)
    black, white = film.levels
    bright: dict[int, float] = {}
    clipped: list[float] = []
    for i in (i for i in sorted({*map(int, wanted), *map(int, spread)}) if film.valid[i]):
        image = np.asarray(film[i])[::_EVERY, ::_EVERY]
        bright[i] = float(np.percentile(image, _BRIGHT)) - black
        clipped.append(float(np.mean(image >= white)))
    usual = float(np.median(list(bright.values()))) if bright else 0.0
    brightness = {str(i): b / usual for i, b in bright.items()} if usual > 0.0 else {}
    share = float(np.mean(clipped)) if clipped else 0.0
    return json.dumps({"brightness": brightness, "clipped": share, "level": white, "view": list(film.shape[1:])})


def exposed(found: xr.Dataset, film: str) -> Check:
    """Look for grey levels that were cut off."""
    if LIGHT not in found.attrs:
        return not_made("exposure", "the frames")
    light = json.loads(found.attrs[LIGHT])
    share = light["clipped"]
    if share < _CLIPPED:
        return stated("exposure", f"{film}: no grey level is cut off", None, file=film)
    text = f"{film}: {in_words(100 * share, 2)} % of the pixels lie at the highest grey level, {light['level']:.0f}"
    cause = "the film is over-exposed (saturated): less light, a shorter exposure or a smaller aperture"
    return stated("exposure", text, "doubtful" if share > _MOSTLY else "note", cause=cause, file=film)


def lit(film: str, brightness: dict[int, float], counts: Flags, time: Floats) -> Check:
    """Look for frames without light.

    Brightness is by frame, over that of the film or of the frames around it; ``counts`` (frame,) are those that are
    measured: a dark frame next to one changes the result.
    """
    name = "light of the frames"
    if not brightness:
        return not_made(name, "the frames")
    dark = np.array(sorted(i for i, b in brightness.items() if b < DARK), int)
    if not dark.size:
        return stated(name, f"{film}: no frame is dark", None, file=film)
    runs = np.split(dark, np.flatnonzero(np.diff(dark) > 1) + 1)
    lost = [run for run in runs if counts[max(run[0] - 1, 0) : run[-1] + 2].any()]
    first = int((lost or runs)[0][0])
    text = f"{film}: {dark.size} of {len(brightness)} sampled frames are dark; frame {first}, at "
    text += f"{quantity(float(time[first]), 's')}, has {100 * max(brightness[first], 0.0):.0f} % of the usual light"
    cause = "the light failed, flickers or is pulsed, or the shutter dropped: dark frames show nothing"
    return stated(name, text, "doubtful" if lost else "note", cause=cause, file=film)


def said_by_file(film: FrameSource) -> str:
    """Return rate and exposure in a film's own file, as JSON.

    There are ``intervals`` between the frames, the usual one and that within bursts [s], empty where
    the times come from a stated rate; ``exposure`` [s], None where the file does not say it.
    """
    steps = np.diff(film.time) if getattr(film, "header", None) is not None else np.empty(0)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    intervals = [float(np.median(steps)), float(np.percentile(steps, _BURST))] if steps.size else []
    known = np.empty(0) if film.exposure is None else film.exposure[np.isfinite(film.exposure)]
    return json.dumps({"intervals": intervals, "exposure": float(np.median(known)) if known.size else None})


def stated_twice(
    found: xr.Dataset, film: str, frame_rate: Quantity | None, exposure: Quantity | None = None
) -> Iterator[Check]:
    """Compare rate and exposure of session.toml with those of the film's file, where both state them."""
    said = json.loads(found.attrs.get(_SAID, "{}"))
    if frame_rate is not None and said.get("intervals"):
        rates = [1.0 / interval for interval in said["intervals"]]
        text = f"{film}: by its own times, which are used, it has {quantity(rates[0], 'Hz')}; "
        text += f"session.toml says frame_rate = {quantity(frame_rate.value, 'Hz')}"
        is_other = all(_differ(rate, frame_rate) for rate in rates)
        cause = "frame_rate has no effect on a film that holds its times: delete it"
        cause += "; it is that of playback or of another film, or the times in the film are wrong" * is_other
        yield stated("frame rate stated", text, "doubtful" if is_other else "note", cause=cause, setting="frame_rate")
    if exposure is None or not (said.get("exposure") or "time" in found):
        return
    own, given = said.get("exposure"), quantity(exposure.value, "s")
    level: Level | None = None
    cause = "exposure is not that of this film, or its unit is wrong"
    if own:  # of the shutter: a flash is shorter, nothing is longer
        text = f"{film}: the shutter was open for {quantity(own, 's')}; session.toml says exposure = {given}, which is "
        text += "used"
        if _differ(own, exposure):
            level = "doubtful" if exposure.value > own else "note"
        if level == "note":
            cause = "right if a flash lit the frames, otherwise delete exposure: the film holds its own"
    else:
        interval = float(np.percentile(np.diff(found["time"].values), _BURST)) if found["time"].size > 1 else np.inf
        text = f"{film}: a frame each {quantity(interval, 's')}; session.toml says exposure = {given}"
        level = "impossible" if exposure.value - 4.0 * exposure.u > (1.0 + _ROUNDED) * interval else None
        cause += "; or the frame rate is"
    yield stated("exposure stated", text, level, cause=cause, setting="exposure")


def _differ(value: float, given: Quantity) -> bool:
    return abs(value - given.value) > _ROUNDED * given.value + 4.0 * given.u


def wrong_rate(
    effects: Mapping[str, float],
    frame_rate: Quantity | None,
    found: xr.Dataset | None,
    film: str,
    u: float = inf,
    otherwise: str = "",
) -> Cause:
    """Return the mistake that the times of a film are wrong, or ``otherwise`` where the factor is below three."""
    own = found is not None and json.loads(found.attrs.get(_SAID, "{}")).get("intervals")
    is_stated = frame_rate is not None and not own  # a film with times of its own ignores a stated rate

    def say(k: float) -> str:
        too = f"{in_words(k)} times too short" if k > 1.0 else f"{in_words(1 / k)} times too long"
        other = otherwise * (1 / _NEAR < k < _NEAR)
        return f"the frame rate is {in_words(k)} times the true one{other}: times come out {too}"

    setting = "frame_rate" if is_stated else ""
    return Cause(effects, say, SLIPS["interval"], u=u, file="" if is_stated else film, setting=setting)

"""Checks of a film: whole, in order, not over-exposed, with the exposure that a session states."""

import json
from collections.abc import Iterator, Mapping
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
from labpipe.judging import DOUBTFUL, SLIPS, Cause, Check, Level, doubtful_among, in_words, not_made
from labpipe.report import quantity
from labpipe.signals import deviation
from labpipe.units import Quantity
from labpipe.workflow.context import Context
from pipelines.experiments.shared.exact_values import usual_uncertainty
from pipelines.experiments.shared.judgements import failed_steps

CAUSES = {
    EXCHANGED: "width and height are exchanged in the header of the film, which was edited or damaged: export it again"
}
"""Fault of a film, by the reason of the error that it ends in."""
_NOT_WHOLE = "the film was not copied whole, or is damaged: copy it from the camera again"
LONGER = 1.5
"""Factor of the usual interval between frames, from which some are missing, and of neighbouring ones."""
LIGHT, _SAID = "light", "said_by_file"
_BESIDE = np.arange(-2, 3)


def of_film(
    context: Context, settings: Any, found: xr.Dataset | None, causes: Mapping[str, str], mends: Mapping[str, str]
) -> list[Check]:
    """Evaluate the steps that failed, and whether a film is whole and its grey levels are not cut off.

    ``found`` is what was measured in its frames; ``causes`` and ``mends`` are those of failed steps.
    """
    film = settings.film
    warned = (w.text for w in context.warnings if w.category == IncompleteFilmWarning.__name__)
    text = next(warned, "").removeprefix(f"{Path(film).name}: ")
    level: Level | None = "note" if text else None
    message = f"{film}: {text or 'the file is complete'}"
    whole = Check("whole film", message, level, cause=_NOT_WHOLE, file=film)
    checks = []
    for failed in failed_steps(context, {**CAUSES, **causes}, mends):
        # what fails on a film that is not whole has that cause, where nothing better is known
        is_known = failed.setting or failed.cause in CAUSES.values() or failed.level != "impossible"
        checks.append(failed if is_known or not text else replace(failed, cause=_NOT_WHOLE))
    return checks if found is None else [*checks, whole, exposed(found, film)]


def of_frames(
    film: str, frame: Integers, time: Floats, is_within: Flags, is_copy: Flags, y: Floats, **options: Any
) -> Iterator[Check]:
    """Look for frames that are not later than the one before, missing in a motion, repeated or exchanged.

    ``is_within`` (frame - 1,) are the intervals in which something moves; elsewhere a camera may skip frames.
    ``is_copy`` (frame - 1,) are frames that are measured as the one before, which noise forbids. ``y`` and ``options``
    are those of :func:`exchanged`.
    """
    steps, cause, text = np.diff(time), "", f"{time.size} frames in order"
    usual = float(np.median(steps[is_within])) if is_within.any() else np.inf
    wrong, lost = np.flatnonzero(~(steps > 0)), np.flatnonzero(is_within & (steps > LONGER * usual))
    level: Level | None = "impossible" if wrong.size else "doubtful" if lost.size else None
    if wrong.size:
        at = int(frame[wrong[0] + 1])
        text = f"frame {at} is not later than the one before ({wrong.size} such frames)"
        cause = f"frames are exchanged or repeated at frame {at}"
    elif lost.size:
        count = int(np.sum(np.round(steps[lost] / usual) - 1))
        frames, when = "frame is" if count == 1 else "frames are", quantity(float(time[lost[0]]), "s")
        text = f"{count} {frames} missing in the motion, the first after frame {frame[lost[0]]} at {when}"
        cause = "the camera dropped frames or recorded in bursts: the motion between them was not seen"
    yield Check("times of the frames", f"{film}: {text}", level, cause=cause, file=film)

    cause, text = "", "no frame equals the one before"
    if (copies := np.flatnonzero(is_copy)).size:
        first = int(frame[copies[0] + 1])
        frames = "frame equals" if copies.size == 1 else "frames equal"
        text = f"{copies.size} {frames} the one before, the first is frame {first}"
        cause = f"frame {first} is a repeated frame"
    yield Check("frames differ", f"{film}: {text}", "doubtful" if cause else None, cause=cause, file=film)

    cause, text = "", "no frames are exchanged"
    if (places := exchanged(y, time=time, **options)) is not None:
        one, other = (int(frame[place]) for place in places)
        text = f"frames {one} and {other} show what would follow smoothly at each other's place"
        cause = f"frames {one} and {other} are exchanged"
    yield Check("order of the frames", f"{film}: {text}", "doubtful" if cause else None, cause=cause, file=film)


def exchanged(
    y: Floats,
    noise: float = 0.0,
    time: Floats | None = None,
    missed: Flags | None = None,
    *,
    tried: int = 40,
    left: float = 0.3,
) -> tuple[int, int] | None:
    """Find two frames that stand at each other's place in a film.

    A body moves smoothly but at impacts, where no exchange makes the motion smoother.

    ``y`` (frame,) is measured in each frame, NaN in those to be left out, with the standard uncertainty ``noise`` where
    that exceeds their scatter. Where the steps of ``time`` (frame,), in any unit, are uneven nothing is smooth over
    frames. ``missed`` (frame,) are frames in which something may have been overlooked: next to another that is no
    exchange. Of the frames that stand out most, ``tried``, all pairs are; of the bends about two of them a part may be
    ``left`` when they are exchanged back. Returns the places of the two, the earlier first, or None.
    """
    known = np.flatnonzero(np.isfinite(y))
    if not known.size:
        return None
    y, bends = y[known], _bends(y[known], np.arange(known.size))
    out = bends > doubtful_among(known.size) * max(noise, deviation(bends))
    if time is not None and known.size > 4:  # the two steps on either side of a frame are as long as each other
        steps = np.pad(np.diff(time[known]), 2, mode="edge")
        around = np.lib.stride_tricks.sliding_window_view(steps, 4)
        out &= around.max(axis=1) < LONGER * np.abs(around).min(axis=1)
    best, found = left, None
    likely = np.flatnonzero(out)
    for i, j in combinations(sorted(likely[np.argsort(bends[likely])[-tried:]].tolist()), 2):
        if j == i + 1 and missed is not None and missed[known[i : j + 1]].any():
            continue
        near = np.unique(np.clip(np.concatenate([i + _BESIDE, j + _BESIDE]), 0, y.size - 1))
        back = y.copy()
        back[[i, j]] = y[[j, i]]
        part = float(_bends(back, near).sum() / _bends(y, near).sum())
        if part < best:
            best, found = part, (int(known[i]), int(known[j]))
    return found


def _bends(y: Floats, at: Integers) -> Floats:
    """Return how far values lie from the cubic through the two neighbours on either side."""
    before2, before, after, after2 = (y[np.clip(at + step, 0, y.size - 1)] for step in (-2, -1, 1, 2))
    return np.abs(y[at] - (4.0 * (before + after) - before2 - after2) / 6.0)


def light_of(film: FrameSource, count: int = 48) -> str:
    """Measure the share of white pixels in so many frames all over a film; JSON, with the grey level of white."""
    white = film.levels[1]
    spread = np.linspace(0, len(film) - 1, min(count, len(film))).round().astype(int)
    clipped = [np.mean(np.asarray(film[int(i)]) >= white) for i in spread if film.valid[i]]
    return json.dumps({"clipped": float(np.mean(clipped)) if clipped else 0.0, "level": white})


def exposed(found: xr.Dataset, film: str, *, reported: float = 0.002, spoiled: float = 0.25) -> Check:
    """Look for grey levels that were cut off; a share of white pixels is ``reported``, or the film ``spoiled``."""
    if LIGHT not in found.attrs:
        return not_made("exposure", "the frames")
    light = json.loads(found.attrs[LIGHT])
    share = light["clipped"]
    if share < reported:
        return Check("exposure", f"{film}: no grey level is cut off", None, file=film)
    text = f"{film}: {in_words(100 * share, 2)} % of the pixels lie at the highest grey level, {light['level']:.0f}"
    cause = "the film is over-exposed (saturated): less light, a shorter exposure or a smaller aperture"
    return Check("exposure", text, "doubtful" if share > spoiled else "note", cause=cause, file=film)


def said_by_file(film: FrameSource) -> str:
    """Return rate and exposure in a film's own file, as JSON.

    ``interval`` [s] is that between frames, within bursts, None where the times come from a stated rate;
    ``exposure`` [s], None where the file does not say it.
    """
    steps = np.diff(film.time) if getattr(film, "header", None) is not None else np.empty(0)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    known = np.empty(0) if film.exposure is None else film.exposure[np.isfinite(film.exposure)]
    interval = float(steps.min()) if steps.size else None
    return json.dumps({"interval": interval, "exposure": float(np.median(known)) if known.size else None})


def exposure_stated(found: xr.Dataset, film: str, exposure: Quantity | None) -> Check:
    """Compare the exposure of session.toml with that of the film's file, else with the interval between frames."""
    name, own = "exposure stated", json.loads(found.attrs.get(_SAID, "{}")).get("exposure")
    if exposure is None or not (own or "time" in found):
        return not_made(name, "an exposure in session.toml")
    # a shutter that was open for longer is right where a flash lit the frames; nothing is longer than an interval
    interval = float(np.diff(found["time"].values).min()) if "time" in found else np.inf
    limit, what = (own, "the shutter was open for") if own else (interval, "a frame each")
    own_u = exposure.u or usual_uncertainty(exposure)
    is_longer = exposure.value - limit > min(DOUBTFUL * own_u, (LONGER - 1.0) * limit)
    text = (
        f"{film}: {what} {quantity(limit, 's')}; session.toml says exposure = {quantity(exposure.value, 's')}, which "
        "is used"
    )
    cause = "exposure is not that of this film, or its unit is wrong; or the frame rate is"
    level: Level | None = None if not is_longer else "doubtful" if own else "impossible"
    return Check(name, text, level, cause=cause, setting="exposure")


def wrong_rate(
    effects: Mapping[str, float], frame_rate: Quantity | None, found: xr.Dataset | None, film: str, u: float = inf
) -> Cause:
    """Return the mistake that the times of a film are wrong."""
    own = found is not None and json.loads(found.attrs.get(_SAID, "{}")).get("interval")
    is_stated = frame_rate is not None and not own  # a film with times of its own ignores a stated rate

    def say(k: float) -> str:
        too = f"{in_words(k)} times too short" if k > 1.0 else f"{in_words(1 / k)} times too long"
        return f"the frame rate is {in_words(k)} times the true one: times come out {too}"

    setting = "frame_rate" if is_stated else ""
    return Cause(effects, say, SLIPS["interval"], u=u, file="" if is_stated else film, setting=setting)

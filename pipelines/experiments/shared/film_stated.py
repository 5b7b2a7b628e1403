"""Frame rate and exposure in the file of a film, compared with those that a session states."""

import json
from collections.abc import Iterator, Mapping
from math import inf

import numpy as np
import xarray as xr

from labpipe.frames import FrameSource
from labpipe.judging import SLIPS, Cause, Check, Level, in_words, stated
from labpipe.report import quantity
from labpipe.units import Quantity

_ROUNDED = 0.01
"""Relative difference of one rate or exposure as a person writes it and as a camera sets it."""
_BURST = 5.0  # percentile of the intervals that is the one within bursts
_NEAR = 3.0  # factor of the rate, below which another explanation may be meant
_SAID = "said_by_file"


def said_by_file(film: FrameSource) -> str:
    """Return rate and exposure in a film's own file, as JSON.

    There are ``intervals`` between the frames, the usual one and that within bursts [s], empty where
    the times come from a stated rate; ``exposure`` [s], None where the file does not say it.
    """
    steps = np.diff(film.time) if getattr(film, "header", None) is not None else np.empty(0)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    known = () if film.exposure is None else film.exposure[np.isfinite(film.exposure)]
    return json.dumps(
        {
            "intervals": [float(np.median(steps)), float(np.percentile(steps, _BURST))] if steps.size else [],
            "exposure": float(np.median(known)) if len(known) else None,
        }
    )


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
        if is_other:
            cause = "frame_rate is that of playback or of another film and has no effect here: delete it; or the times "
            cause += "in the film are wrong"
        level: Level = "doubtful" if is_other else "note"
        yield stated("frame rate stated", text, level, cause=cause, setting="frame_rate")
    if exposure is None or not (said.get("exposure") or "time" in found):
        return
    own, given = said.get("exposure"), quantity(exposure.value, "s")
    worst: Level | None = None
    cause = "exposure is not that of this film, or its unit is wrong"
    if own:  # of the shutter: a flash is shorter, nothing is longer
        text = f"{film}: the shutter was open for {quantity(own, 's')}; session.toml says exposure = {given}, which is "
        text += "used"
        if _differ(own, exposure):
            worst = "doubtful" if exposure.value > own else "note"
        if worst == "note":
            cause = "right if a flash lit the frames, otherwise delete exposure: the film holds its own"
    else:
        interval = float(np.percentile(np.diff(found["time"].values), _BURST)) if found["time"].size > 1 else np.inf
        text = f"{film}: a frame each {quantity(interval, 's')}; session.toml says exposure = {given}"
        worst = "impossible" if exposure.value - 4.0 * exposure.u > (1.0 + _ROUNDED) * interval else None
        cause += "; or the frame rate is"
    yield stated("exposure stated", text, worst, cause=cause, setting="exposure")


def _differ(value: float, given: Quantity) -> bool:
    return abs(value - given.value) > _ROUNDED * given.value + 4.0 * given.u


def of_rate(k: float, otherwise: str = "") -> str:
    """Say that the frame rate is so many times the true one, or another explanation."""
    too = f"{in_words(k)} times too short" if k > 1.0 else f"{in_words(1 / k)} times too long"
    return f"the frame rate is {in_words(k)} times the true one{otherwise}: times come out {too}"


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

    def say(factor: float) -> str:
        return of_rate(factor, otherwise * (1 / _NEAR < factor < _NEAR))

    setting = "frame_rate" if is_stated else ""
    return Cause(effects, say, SLIPS["interval"], u=u, file="" if is_stated else film, setting=setting)

"""What a film says of itself against what a session states of it: the rate and the exposure of its frames."""

import json
from collections.abc import Iterator

import numpy as np
import xarray as xr

from labpipe.arrays import Floats
from labpipe.frames import FrameSource
from labpipe.judging import Check, in_words, stated
from labpipe.report import quantity
from labpipe.units import Quantity

_ROUNDED = 0.01
"""Relative difference of one rate or exposure as a person writes it and as a camera sets it."""
_BURST = 5.0  # percentile of the intervals that is the one within bursts
_SAID = "said_by_file"


def said_by_file(film: FrameSource) -> str:
    """Return what a film's file itself says, as JSON.

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


def is_rate_used(frame_rate: Quantity | None, found: xr.Dataset | None) -> bool:
    """Tell whether the times of a film come from a stated rate: it has none of its own."""
    own = found is not None and json.loads(found.attrs.get(_SAID, "{}")).get("intervals")
    return frame_rate is not None and not own


def stated_twice(
    found: xr.Dataset, film: str, frame_rate: Quantity | None, exposure: Quantity | None = None
) -> Iterator[Check]:
    """Hold what session.toml states of a film against what its file says, where both do."""
    said = json.loads(found.attrs.get(_SAID, "{}"))
    if frame_rate is not None and said.get("intervals"):
        yield _rate(film, said["intervals"], frame_rate)
    if exposure is not None and said.get("exposure"):
        yield _exposure(film, said["exposure"], exposure)
    elif exposure is not None and "time" in found:
        yield _within_a_frame(film, found["time"].values, exposure)


def _within_a_frame(film: str, time: Floats, given: Quantity) -> Check:
    """Hold a stated exposure against the time from one frame to the next."""
    name = "exposure stated"
    interval = float(np.percentile(np.diff(time), _BURST)) if time.size > 1 else np.inf
    text = f"{film}: a frame each {quantity(interval, 's')}; session.toml says exposure = {quantity(given.value, 's')}"
    is_longer = given.value - 4.0 * given.u > (1.0 + _ROUNDED) * interval
    cause = "exposure is not that of this film, or its unit is wrong; or the frame rate is"
    return stated(name, text, "impossible" if is_longer else None, cause=cause, setting="exposure")


def _differ(value: float, given: Quantity) -> bool:
    return abs(value - given.value) > _ROUNDED * given.value + 4.0 * given.u


def _rate(film: str, intervals: list[float], given: Quantity) -> Check:
    name = "frame rate stated"
    rates = [1.0 / interval for interval in intervals]
    text = f"{film}: by its own times, which are used, it has {quantity(rates[0], 'Hz')}; "
    text += f"session.toml says frame_rate = {quantity(given.value, 'Hz')}"
    if not all(_differ(rate, given) for rate in rates):
        cause = "frame_rate has no effect on a film that holds its times: delete it"
        return stated(name, text, "note", cause=cause, setting="frame_rate")
    cause = (
        "frame_rate is that of playback or of another film and has no effect here: delete it; or the times in the "
        "film are wrong"
    )
    return stated(name, text, "doubtful", cause=cause, setting="frame_rate")


def _exposure(film: str, own: float, given: Quantity) -> Check:
    """Hold a stated exposure against the shutter's: a flash is shorter, nothing is longer."""
    name = "exposure stated"
    text = f"{film}: the shutter was open for {quantity(own, 's')}; session.toml says exposure = "
    text += f"{quantity(given.value, 's')}, which is used"
    if not _differ(own, given):
        return stated(name, text, None, setting="exposure")
    cause = (
        "exposure is not that of this film, or its unit is wrong"
        if given.value > own
        else "right if a flash lit the frames, otherwise delete exposure: the film holds its own"
    )
    return stated(name, text, "doubtful" if given.value > own else "note", cause=cause, setting="exposure")


def of_rate(k: float, otherwise: str = "") -> str:
    """Say that the frame rate is so many times the true one, or what else explains it."""
    too = f"{in_words(k)} times too short" if k > 1.0 else f"{in_words(1 / k)} times too long"
    return f"the frame rate is {in_words(k)} times the true one{otherwise}: times come out {too}"

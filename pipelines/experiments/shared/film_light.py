"""The light of a film: dark frames, and grey levels that its camera cut off."""

import json
from collections.abc import Iterable

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.frames import FrameSource
from labpipe.judging import Check, in_words, not_made, stated
from labpipe.report import quantity

_EVERY = 4  # rows and columns of which one is read
_MOST = 48  # frames spread over a film, in addition to those that matter
_BRIGHT = 99.0  # percentile that a dark contact does not reach before it fills the view
_CLIPPED, _MOSTLY = 0.002, 0.25  # share of white pixels that is reported, and that spoils a film
DARK = 0.5
"""Share of the usual brightness below which a frame is dark: lamps flicker, but do not fall to half for a frame."""
LIGHT = "light"


def light_of(film: FrameSource, wanted: Iterable[int]) -> str:
    """Measure the brightness of frames and the share of their pixels that are white, as JSON.

    Frames all over the film are added to those that are ``wanted``. Returned are ``brightness`` by frame over that of
    the film, ``clipped``, the share of pixels at the grey level ``level`` of white, and ``view``, rows and columns.
    """
    spread = np.linspace(0, len(film) - 1, min(_MOST, len(film))).round().astype(int)
    chosen = [i for i in sorted({*map(int, wanted), *map(int, spread)}) if film.valid[i]]
    black, white = film.levels
    bright: dict[int, float] = {}
    clipped: list[float] = []
    for i in chosen:
        image = np.asarray(film[i])[::_EVERY, ::_EVERY]
        bright[i] = float(np.percentile(image, _BRIGHT)) - black
        clipped.append(float(np.mean(image >= white)))
    usual = float(np.median(list(bright.values()))) if bright else 0.0
    brightness = {str(i): b / usual for i, b in bright.items()} if usual > 0.0 else {}
    share = float(np.mean(clipped)) if clipped else 0.0
    return json.dumps({"brightness": brightness, "clipped": share, "level": white, "view": list(film.shape[1:])})


def exposed(found: xr.Dataset, film: str) -> Check:
    """Look for grey levels that were cut off."""
    name = "exposure"
    if LIGHT not in found.attrs:
        return not_made(name, "the frames")
    light = json.loads(found.attrs[LIGHT])
    share = light["clipped"]
    if share < _CLIPPED:
        return stated(name, f"{film}: no grey level is cut off", None, file=film)
    text = f"{film}: {in_words(100 * share, 2)} % of the pixels lie at the highest grey level, {light['level']:.0f}"
    cause = "the film is over-exposed (saturated): less light, a shorter exposure or a smaller aperture"
    return stated(name, text, "doubtful" if share > _MOSTLY else "note", cause=cause, file=film)


def lit(film: str, brightness: dict[int, float], counts: NDArray[np.bool_], time: NDArray[np.float64]) -> Check:
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

"""The light of a film: frames in which it failed, and grey levels that its camera cut off."""

import json
from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from labpipe.frames import FrameSource
from labpipe.judging import Check, in_words, not_made, stated
from labpipe.report import quantity

_EVERY = 4  # rows and columns of which one is looked at
_MOST = 48  # frames spread over a film, beside those that matter
_BRIGHT = 99.0  # percentile that a dark contact does not reach before it fills the view
_HEAPED, _BESIDE = 3.0, 3
"""Ratio of the pixels at one grey level to those at each of so many levels below it from which they
are heaped there: noise spreads any bright plane over more levels than one."""
_CLIPPED, _MOSTLY = 0.002, 0.25  # share of pixels at that level that is told, and that spoils a film
_FEW_LEVELS = 16.0  # between black and bright places, below which grey levels are coarser than noise
_FLICKERS = 2.0  # ratio of bright to dim frames, each beyond a twentieth of them, that is told
DARK = 0.5
"""Share of the usual brightness below which a frame is dark: lamps flicker, but do not fall to half for a frame."""
LIGHT = "light"


def light_of(film: FrameSource, wanted: Iterable[int]) -> str:
    """Measure how bright frames are, and how many of their pixels lie at one highest level, as JSON.

    Frames that are wanted matter; others all over the film are added. There are ``brightness`` by frame over that of
    the film, ``clipped``, the share of pixels at the highest grey level ``level``, ``view``, rows and columns,
    and ``used``, the grey levels from black to bright places.
    """
    sound = np.asarray(film.valid, bool)
    spread = np.linspace(0, len(film) - 1, min(_MOST, len(film))).round().astype(int)
    chosen = [i for i in sorted({*map(int, wanted), *map(int, spread)}) if sound[i]]
    bright: dict[int, float] = {}
    black, _ = film.levels
    images = []
    for i in chosen:
        image = np.asarray(film[i])[::_EVERY, ::_EVERY]
        bright[i] = float(np.percentile(image, _BRIGHT)) - black
        images.append(image)
    usual = float(np.median(list(bright.values()))) if bright else 0.0
    seen = np.stack(images) if images else np.empty((0, 0, 0), np.uint8)
    share, level = _heap(seen)
    shown: dict[str, Any] = {"brightness": {str(i): b / usual for i, b in bright.items()} if usual > 0.0 else {}}
    shown |= {"clipped": share, "level": level, "view": list(film.shape[1:])}
    return json.dumps(shown | ({"used": usual / _apart(seen)} if seen.dtype.kind in "iu" else {}))


def _apart(levels: NDArray[np.integer]) -> int:
    """Return by how much grey levels differ at least: those of fewer bits stand apart in more."""
    shown = np.unique(levels.astype(np.int64))
    return int(np.gcd.reduce(np.diff(shown))) if shown.size > 1 else 1


def _heap(levels: NDArray[Any]) -> tuple[float, float]:
    """Return share and level of pixels heaped at the upper end of the grey levels."""
    if levels.dtype.kind not in "iu" or not levels.size:
        return 0.0, 0.0
    shown, counts = np.unique(levels.astype(np.int64), return_counts=True)
    # pixels that are stuck at white lie above the level at which another camera's grey was cut off
    apart = _apart(shown)
    for at in np.flatnonzero(counts >= _CLIPPED * levels.size)[::-1]:
        below = counts[(shown < shown[at]) & (shown >= shown[at] - _BESIDE * apart)]
        is_end = int(counts[at + 1 :].sum()) < _CLIPPED * counts[at]
        if is_end and counts[at] > _HEAPED * below.max(initial=0):
            return float(counts[at] / levels.size), float(shown[at])
    return 0.0, 0.0


def exposed(found: xr.Dataset, film: str) -> Check:
    """Look for grey levels that were cut off."""
    name = "exposure"
    if LIGHT not in found.attrs:
        return not_made(name, "the frames")
    light = json.loads(found.attrs[LIGHT])
    share, level = light["clipped"], light["level"]
    used = light.get("used", _FEW_LEVELS)
    if share < _CLIPPED and used < _FEW_LEVELS:
        text = f"{film}: bright places lie {in_words(used, 2)} grey levels above black"
        cause = "the film is under-exposed (dark): more light, a longer exposure or a larger aperture"
        return stated(name, text, "note", cause=cause, file=film)
    if share < _CLIPPED:
        return stated(name, f"{film}: no grey level is cut off", None, file=film)
    text = f"{film}: {in_words(100 * share, 2)} % of the pixels lie at the highest grey level, {level:.0f}"
    cause = "the film is over-exposed (saturated): less light, a shorter exposure or a smaller aperture"
    return stated(name, text, "doubtful" if share > _MOSTLY else "note", cause=cause, file=film)


def lit(film: str, brightness: dict[int, float], counts: NDArray[np.bool_], time: NDArray[np.float64]) -> Check:
    """Look for frames without light.

    Brightness is by frame, over that of the film or of the frames around it; ``counts`` (frame,) are those that show
    what is measured: dark frames beside one change the result.
    """
    name = "light of the frames"
    if not brightness:
        return not_made(name, "the frames")
    dark = np.array(sorted(i for i, b in brightness.items() if b < DARK), int)
    dim, bright = np.quantile(list(brightness.values()), [0.05, 0.95]).tolist()
    if not dark.size and bright > _FLICKERS * dim:
        text = f"{film}: bright frames have {in_words(bright / dim, 2)} times the light of dim ones"
        cause = "the light flickers or fades; each frame is measured in its own light"
        return stated(name, text, "note", cause=cause, file=film)
    if not dark.size:
        return stated(name, f"{film}: no frame is dark", None, file=film)
    runs = np.split(dark, np.flatnonzero(np.diff(dark) > 1) + 1)
    lost = [run for run in runs if counts[max(run[0] - 1, 0) : run[-1] + 2].any()]
    first = int((lost or runs)[0][0])
    text = f"{film}: {dark.size} of {len(brightness)} frames looked at are dark; frame {first}, at "
    text += f"{quantity(float(time[first]), 's')}, has {100 * max(brightness[first], 0.0):.0f} % of the usual light"
    cause = "the light failed, flickers or is pulsed, or the shutter dropped: dark frames show nothing"
    return stated(name, text, "doubtful" if lost else "note", cause=cause, file=film)

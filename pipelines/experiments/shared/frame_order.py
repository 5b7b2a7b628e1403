"""Order of a film's frames: two that were exchanged."""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.judging import Check, stated

_IN_NOISE, _LEFT = 10.0, 0.3
"""Multiple of the usual bend from which a frame is an outlier, and share of the bends that may be left
about two frames which were exchanged back."""
_UNEVEN = 1.5  # times the shortest step about a frame, from which on steps are uneven
_MOST = 40  # frames that stand out most; all their pairs are tried
_NEAR = np.arange(-2, 3)


def exchanged(
    y: Floats, noise: float = 0.0, time: Floats | None = None, missed: NDArray[np.bool_] | None = None
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
    least = _IN_NOISE * max(noise, 1.4826 * float(np.median(bends)))
    out = np.flatnonzero((bends > least) & _evenly(y.size if time is None else time))
    out = np.sort(out[np.argsort(bends[out])[-_MOST:]])
    best, found = _LEFT, None
    for i, j in combinations(out.tolist(), 2):
        if j == i + 1 and missed is not None and missed[i : j + 1].any():
            continue
        near: NDArray[np.int64] = np.unique(np.clip(np.concatenate([i + _NEAR, j + _NEAR]), 0, y.size - 1))
        back = y.copy()
        back[[i, j]] = y[[j, i]]
        left = float(_bends(back, near).sum() / _bends(y, near).sum())
        if left < best:
            best, found = left, (i, j)
    return found


def _evenly(time: Floats | int) -> NDArray[np.bool_]:
    """Find the frames about which two steps on either side are as long as each other."""
    steps = np.ones(time - 1) if isinstance(time, int) else np.diff(time)
    if steps.size < 4:
        return np.ones(steps.size + 1, dtype=bool)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(steps, 2, mode="edge"), 4)
    return np.asarray(around.max(axis=1) < _UNEVEN * np.abs(around).min(axis=1))


def _bends(y: Floats, at: NDArray[np.int64]) -> Floats:
    """Return how far values lie from the cubic through the two neighbours on either side."""
    before2, before, after, after2 = (y[np.clip(at + step, 0, y.size - 1)] for step in (-2, -1, 1, 2))
    return np.abs(y[at] - (4.0 * (before + after) - before2 - after2) / 6.0)


def in_order(
    film: str,
    frames: NDArray[np.integer],
    y: Floats,
    noise: float = 0.0,
    time: Floats | None = None,
    missed: NDArray[np.bool_] | None = None,
) -> Check:
    """Look for two frames that were exchanged; frames without a value are left out."""
    name = "order of the frames"
    known = np.flatnonzero(np.isfinite(y))
    found = exchanged(y[known], noise, None if time is None else time[known], None if missed is None else missed[known])
    if found is None:
        return stated(name, f"{film}: no frames are exchanged", None, file=film)
    first, second = (int(frames[known[k]]) for k in found)
    text = f"{film}: frames {first} and {second} show what would follow smoothly at each other's place"
    return stated(name, text, "doubtful", cause=f"frames {first} and {second} are exchanged", file=film)

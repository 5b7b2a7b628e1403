"""Order of a film's frames: two that stand at each other's place, and those that were lost and numbered over."""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats
from labpipe.judging import Check, stated

_IN_NOISE, _LEFT = 10.0, 0.3
"""Multiple of the usual bend from which a frame stands out, and share of the bends that may be left
about two frames which were exchanged back."""
_UNEVEN = 1.5  # times the shortest step about a frame, from which on steps are uneven
_MOST = 40  # frames that stand out most; all their pairs are tried
_NEAR = np.arange(-2, 3)
_ROUGH, _SMOOTHER = 0.005, 3.0
"""Of the largest value, what a smooth course may leave of measured ones, and by which factor frames that are put back
must make it smoother: the areas of contacts without a loss leave 0.0023 and get 1.2 times smoother at most."""
_DEGREE, _FEWEST, _LOST = 6, 10, 12  # of the course, and frames that tell it; those that may be lost together
_WITHIN = 60  # frames of a course that are looked at: of more every so many, since those lost are as many more


def exchanged(
    y: Floats, noise: float = 0.0, time: Floats | None = None, missed: NDArray[np.bool_] | None = None
) -> tuple[int, int] | None:
    """Find two frames that stand at each other's place in a film.

    A body moves smoothly but at impacts, where no exchange makes the motion smoother.

    ``y`` (frame,) is what is measured in each frame, all numbers, with the standard uncertainty ``noise`` where that is
    more than what the frames show. Where the steps of ``time`` (frame,), in any unit, are uneven nothing is smooth over
    frames. ``missed`` (frame,) are frames in which something may have been overlooked: beside another that is no
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


def lost(y: Floats, noise: float = 0.0) -> int | None:
    """Find after which frame others of a smooth course are missing, though no step in time tells it.

    ``y`` (frame,): what is measured in each frame, one step of time after another; all numbers, the largest above 0;
    ``noise``: standard uncertainty of y. Returns the last frame before the gap; None where putting frames back makes
    the course no smoother.
    """
    every = -(-y.size // _WITHIN)
    seen = y[::every]
    if seen.size < _FEWEST:
        return None
    x = np.arange(seen.size, dtype=float)
    rough, allowed = _roughness(x, seen), max(_ROUGH * float(seen.max()), _SMOOTHER * noise)
    if rough < allowed:
        return None
    gaps = [(at, count) for at in range(2, seen.size - 1) for count in range(1, _LOST + 1)]
    left = [_roughness(x + count * (x >= at), seen) for at, count in gaps]
    best = int(np.argmin(left))
    return every * gaps[best][0] - 1 if left[best] < min(allowed, rough / _SMOOTHER) else None


def _roughness(x: Floats, y: Floats) -> float:
    """Return what a polynomial leaves of values, as a standard deviation."""
    places = np.polynomial.chebyshev.chebvander(2.0 * (x - x[0]) / (x[-1] - x[0]) - 1.0, _DEGREE)
    rest = y - places @ np.linalg.lstsq(places, y)[0]
    return float(np.sqrt(np.sum(rest**2) / (y.size - _DEGREE - 1)))


def _evenly(time: Floats | int) -> NDArray[np.bool_]:
    """Tell the frames about which two steps on either side are as long as each other."""
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

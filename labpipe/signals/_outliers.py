"""Outliers: short runs of readings that leave a record and return to it.

A Hampel identifier on residuals: each candidate run is compared with a cubic through the readings on both sides, in
units of their scatter about it. An impact bends a record but does not interrupt it: the scatter grows with the kink,
and the first and last reading of a contact continue the readings outside; both must deviate in a run of outliers.
"""

from typing import NamedTuple

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.signals._noise import estimate_noise

LONGEST_RUN = 10  # readings of one run that are left out; a longer interruption hides motion
_THRESHOLD, _NEIGHBOURS = 8.0, 8  # in units of the noise, and readings on either side that a run is compared with


class Outliers(NamedTuple):
    """Readings that leave a record and return to it.

    ``flags`` (n,) marks the readings to leave out, ``runs`` holds the first and the last index of each run of them.
    """

    flags: Flags
    runs: list[tuple[int, int]]

    def message(self, time: Floats) -> str:
        """Return the runs as a sentence: their readings, counted from 1, and their times [s]."""
        numbers = [str(a + 1) if a == b else f"{a + 1}-{b + 1}" for a, b in self.runs[:5]]
        named = [f"{number} (at {time[run[0]]:.6g} s)" for number, run in zip(numbers, self.runs, strict=False)]
        more = f" and {len(self.runs) - 5} runs more" if len(self.runs) > 5 else ""
        noun, verb = ("reading", "deviates") if self.flags.sum() == 1 else ("readings", "deviate")
        return f"{noun} {', '.join(named)}{more} {verb} from the readings around, left out"


def outliers(values: Floats, time: Floats | None = None, *, noise: float | None = None, ends: bool = True) -> Outliers:
    """Find short runs of readings that leave a record and return to it.

    Parameters
    ----------
    values : array (n,)
        Readings in any unit; NaN where there is none.
    time : array (n,), optional [s]
        Increasing; default evenly spaced.
    noise : float, optional
        Standard deviation of the readings; default estimated from the record.
    ends : bool
        Whether a run may lie at an end of the record; not where one reading before or after a step is a measurement.

    Notes
    -----
    The first and the last reading of a run deviate by eight times the noise and the scatter of the eight readings on
    either side. A run at either end of the record must leave it by more than eight of its largest steps, and step to it
    further than twice its own steps: motion may begin or end there. A pulse of four readings or more that rises and
    falls smoothly is kept: its first and last readings deviate by less than half of its height, and its second
    differences are below 1.5 times that height.

    References
    ----------
    R. K. Pearson et al., Generalized Hampel filters, EURASIP J. Adv. Signal Process. 2016, 87,
    doi:10.1186/s13634-016-0383-6.
    """
    values = np.asarray(values, float)
    flags = np.zeros(values.size, bool)
    read = np.flatnonzero(np.isfinite(values))
    times = np.arange(values.size, dtype=float) if time is None else np.asarray(time, float)
    if noise is None and read.size >= 2 * _NEIGHBOURS:
        noise = estimate_noise(values[read] - values[read[0]], times[read]).sigma
    while noise and read.size >= 2 * _NEIGHBOURS:  # every round flags a reading or is the last
        is_whole = read.size == values.size
        wild = _round(*((times, values) if is_whole else (times[read], values[read])), noise, ends)
        if not wild:
            break
        flags[read[wild]] = True
        read = np.delete(read, wild)
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)) if flags.any() else np.zeros(0, int)
    runs = [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return Outliers(flags, runs)


def _round(t: Floats, y: Floats, sigma: float, ends: bool) -> list[int]:
    """Return the readings of all runs that do not overlap."""
    n, interval = y.size, np.diff(t)
    bend = np.abs(np.diff(np.diff(y) / interval))
    # Readings far from the line through the two readings before, and through the two behind.
    enters = 2 + _above(bend * interval[1:], sigma)
    leaves = _above(bend * interval[:-1], sigma)
    enters = np.append(1, enters) if abs(y[1] - y[0]) > _THRESHOLD * sigma else enters
    leaves = np.append(leaves, n - 2) if abs(y[-2] - y[-1]) > _THRESHOLD * sigma else leaves
    firsts, lasts = set(enters.tolist()), set(leaves.tolist())
    taken: list[int] = []
    used = np.zeros(n, bool)
    for length in range(1, LONGEST_RUN + 1):
        candidates = {i for i in firsts if i + length - 1 in lasts}
        if ends:
            candidates |= {n - length} & firsts | ({0} if length - 1 in lasts else set())
        for first in sorted(candidates):
            around = slice(max(first - _NEIGHBOURS, 0), first + length + _NEIGHBOURS)
            if not used[around].any():
                wild = _deviating(t[around], y[around], first - around.start, length, sigma)
                taken += (first + np.flatnonzero(wild)).tolist()
                used[first : first + length] = wild.any()
    return taken


def _above(away: Floats, sigma: float) -> Integers:
    """Return which distances exceed the noise and the median of those around, so more than half of them."""
    places = np.flatnonzero(away > _THRESHOLD * sigma)
    found = []
    for some in np.array_split(places, places.size // 4096 + 1):
        near = np.abs(some[:, None] + np.arange(-2 * _NEIGHBOURS, 2 * _NEIGHBOURS + 1))
        near = np.clip(away.size - 1 - np.abs(away.size - 1 - near), 0, None)  # mirrored at both ends
        found.append(some[np.sum(away[some, None] > _THRESHOLD * away[near], axis=1) > 2 * _NEIGHBOURS])
    return np.concatenate(found)


def _deviating(t: Floats, y: Floats, first: int, length: int, sigma: float) -> Flags:
    """Return which readings of a run deviate from the curve through the readings around it; none if it is no run."""
    inside = np.zeros(y.size, bool)
    inside[first : first + length] = True
    before, after = first, y.size - first - length
    none = np.zeros(length, bool)
    at_end = min(before, after) < 4
    degree = 1 if at_end else 3
    if before + after < 2 * (degree + 1):
        return none
    scale = t[-1] - t[0]
    design = np.vander((t - t[first]) / scale, degree + 1)
    solution, *_ = np.linalg.lstsq(design[~inside], y[~inside], rcond=None)
    residual = y - design @ solution
    outer = residual[~inside]
    scatter = max(sigma, float(np.sqrt(np.sum(outer**2) / (outer.size - degree - 1))))
    # the curve itself is uncertain, most of all where it is extrapolated
    covariance = np.linalg.inv(design[~inside].T @ design[~inside])
    limit = _THRESHOLD * scatter * np.sqrt(1.0 + np.sum((design[inside] @ covariance) * design[inside], axis=1))
    if at_end:
        steps = np.abs(np.diff(y))[~(inside[1:] | inside[:-1])]
        limit = np.maximum(limit, _THRESHOLD * float(steps.max(initial=0.0)))
        if not (before and after):  # motion may begin or end here: the step to the record is twice any within the run
            own = np.abs(np.diff(y[max(first - 1, 0) : first + length + 1]))
            across, within = (own[0], own[1:]) if before else (own[-1], own[:-1])
            if within.size and across < 2.0 * within.max():
                return none
    off = np.abs(residual[inside])
    edges = [i for i, there in ((0, before), (-1, after)) if there]
    bend = np.abs(np.diff(residual[max(first - 1, 0) : first + length + 1], 2)).max(initial=0.0)
    is_abrupt = bend > 1.5 * off.max() or all(off[i] > 0.5 * off.max() for i in edges)
    return off > limit if is_abrupt and all(off[i] > limit[i] for i in edges) else none

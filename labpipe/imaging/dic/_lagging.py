"""Find what stands still before a specimen by the points that it holds back, once the film is known.

What stands out clearly before a faint pattern holds a subset back by far more than its misfit tells. Most other
points tell where the subset should be. There, what stands still misfits, and without it the subset moves with them.
"""

import numpy as np

from labpipe.arrays import Flags, Floats, Integers
from labpipe.imaging.dic._attempt import Attempt
from labpipe.imaging.dic._before import Looking, noise_shown
from labpipe.imaging.dic._reference import Status
from labpipe.imaging.dic._standing import Votes
from labpipe.imaging.dic._table import Table
from labpipe.imaging.dic._tracker import Tracker

#: Frames that are looked at, those of the largest motion, and how many where nothing stands before the first of
#: them; and points that tell the motion.
_FRAMES, _SOME, _FEWEST = 6, 2, 12
#: Standard deviations by which a point lags behind, the same over what most points scatter by, and share of the motion.
_LAGS, _BEYOND_SCATTER, _SHARE = 4.0, 4.0, 0.1
#: Rounds of the fit of the motion of most, and scatter within which a point counts as one of them.
_ROUNDS, _MOST = 4, 3.0
#: Displacement (px) of what is there beyond which pixels misfit.
_STEP = 0.1
#: Points of a frame that are looked at.
_LOOKED_AT = 400


def held_back(tracker: Tracker, table: Table, indices: Integers, is_static: Flags) -> Votes:
    """Count in how many of the frames of the largest motion pixels stand still before points that lag behind.

    ``tracker``: has gone through the film; ``table``: what it found; ``indices``: integer (frame,), frames of the
    table in the film; ``is_static``: bool (frame,), those of the reference.
    """
    votes = Votes.none(tracker.reference.mean.shape)
    is_found = (table.status == Status.OK) & ~is_static[:, None]
    rows = np.flatnonzero(is_found.sum(axis=1) >= _FEWEST)
    moved = np.where(is_found[rows], np.hypot(table.motion[rows, :, 0], table.motion[rows, :, 3]), 0.0)
    farthest = rows[np.argsort(moved.sum(axis=1) / is_found[rows].sum(axis=1))[::-1]]
    for row in farthest[:_FRAMES].tolist():
        if votes.frames == _SOME and not votes.any:
            break
        attempt = table.attempt(row, is_found[row])
        told, lags = _lagging(tracker, attempt)
        votes.frames += 1
        chosen = np.flatnonzero(lags)[:: max(int(lags.sum()) // _LOOKED_AT, 1)]
        if len(chosen):
            tracker.solver.use(tuple(table.growth[row].tolist()))
            _, loaded = tracker.film.read_whole(int(indices[row]))
            _, usual, amplified = noise_shown(tracker, attempt)
            looking = Looking(tracker, loaded, attempt, usual * amplified, 0.0, _STEP)
            looking.release(chosen, told[chosen])
            looking.vote(np.flatnonzero(attempt.trusted & ~lags), votes)
    return votes


def _lagging(tracker: Tracker, attempt: Attempt) -> tuple[Floats, Flags]:
    """Motions (point, 6) that most points tell of each, and which points lag behind theirs."""
    trusted = np.flatnonzero(attempt.trusted)
    subsets, motion = tracker.reference.subsets, attempt.motion[trusted]
    value, away = motion[:, [0, 3]], tracker.places[trusted] - tracker.places[trusted].mean(axis=0)
    columns = np.concatenate([np.ones((len(away), 1)), away / max(float(np.abs(away).max()), 1.0)], axis=1)
    noise = attempt.residual[trusted] / subsets.level[trusted, 2]
    variance = np.maximum(noise * (subsets.inverse[trusted, 0, 0] + subsets.inverse[trusted, 3, 3]), 1e-12)
    told, near = np.broadcast_to(np.median(value, axis=0), value.shape), np.ones(len(trusted), bool)
    for _ in range(_ROUNDS):
        apart = np.hypot(*(value - told).T) / np.sqrt(variance)
        near = apart <= _MOST * max(float(np.median(apart)), 0.5)
        weighed = columns * (near / variance)[:, None]
        told = columns @ np.linalg.lstsq(weighed.T @ columns, weighed.T @ value)[0]
    apart = np.hypot(*(value - told).T) / np.sqrt(variance)
    beyond = max(_LAGS, _BEYOND_SCATTER * float(np.median(apart[near])))
    lags = np.zeros(len(attempt.trusted), bool)
    lags[trusted] = (apart > beyond) & (((told - value) * told).sum(axis=1) > _SHARE * np.square(told).sum(axis=1))
    every = np.broadcast_to(np.median(motion, axis=0), attempt.motion.shape).copy()
    every[trusted, 0], every[trusted, 3] = told.T
    return every, lags

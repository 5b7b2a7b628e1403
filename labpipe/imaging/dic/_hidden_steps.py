"""Edges that moved on in whole pixels before the picture was blurred, and what that hides of a motion.

A pattern that was sampled by points and blurred afterwards, as a drawn or scaled film is, holds nothing near half
a wave per px that would tell so. Each of its edges stands up to half a pixel off. Where those of a subset step
alike, nothing misfits, and all of that is an error of the motion; the other points of the frame tell it, and
displacements that gather at whole pixels.
"""

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.dic._places import powers

#: Variance (px²) along one axis of what is rounded to whole pixels.
_WHOLE = 1.0 / 12.0
#: Variance (px²) of a shift that parts of most subsets tell from which steps may be what misfits.
_STEPS = 0.05**2
#: Points of a frame that tell a gathering at whole pixels; scatter (px) about a smooth motion below which there is
#: none; mean cosine of their phase beyond that of the smooth motion from which there is, and the same by chance times
#: the root of the points; and how far (px) most lie from the smooth motion at most: two bodies do not follow one.
_MANY, _SCATTER, _GATHERED, _BY_CHANCE, _FOLLOWS, _MOST = 20, 0.1, 0.1, 1.0, 0.75, 0.9
#: Rounds of the smooth motion that most follow, the multiple of their median distance beyond which they count less, and
#: what keeps its normal matrix regular where all points lie in a line.
_ROUNDS, _FAR, _LEAST = 10, 3.0, 1e-9


def hidden_steps(is_found: Flags, spread: Floats, inverse: Floats) -> Floats:
    """Variance (frame, point, 2) [px²] along x and y that each motion has at least by what most others misfit by.

    ``is_found``: bool (frame, point), which motions count; ``spread``: (frame, point, 2 or more) [px²], variances
    along x and y that parts of the subsets tell; NaN where they do not; ``inverse``: (point, 2) [px²/grey²],
    variances along x and y by noise of variance 1.

    Notes
    -----
    Frames in which most points match, though in most frames they do not, show motions of nearly whole pixels.
    """
    usual = np.full(len(is_found), np.nan)
    both = np.where(is_found, spread[..., :2].sum(axis=2), np.nan)
    told = np.isfinite(both)
    for k in np.flatnonzero(told.sum(axis=1) > 0.5 * is_found.sum(axis=1)).tolist():
        if np.median(both[k, told[k]]) > _STEPS:
            usual[k] = np.median(both[k, told[k]] / inverse[told[k]].sum(axis=1))
    seen = np.isfinite(usual)
    if 2 * seen.sum() > is_found.any(axis=1).sum():
        usual[~seen] = np.median(usual[seen])
    least = np.minimum(np.nan_to_num(usual)[:, None, None] * inverse, _WHOLE)
    return np.asarray(least * is_found[..., None])


def gathered_steps(places: Floats, value: Floats, is_found: Flags) -> Floats:
    """Variance (frame, point, 2) [px²] along x and y that motions have at least which gather at whole pixels.

    ``places``: (point, 2) [px], where the points are in the reference; ``value``: (frame, point, 2 or more) [px],
    displacements; ``is_found``: bool (frame, point), which of them count.

    Notes
    -----
    Where displacements gather in half of the frames that spread them, they do so in the others.
    """
    about = np.full((len(is_found), 2), np.nan)
    for k in np.flatnonzero(is_found.sum(axis=1) >= _MANY).tolist():
        for axis in range(2):
            moved = value[k, is_found[k], axis]
            if moved.std() > _SCATTER:
                about[k, axis] = _gathered(places[is_found[k]], moved)
    gathers = about > 0.0
    # two bodies a pixel apart gather as well, in one frame of many; where all move alike, all gather at one place
    if not gathers.any() or 2 * gathers.sum() < np.isfinite(about).sum():
        return np.zeros((*is_found.shape, 2))
    about[~gathers] = np.median(about[gathers])
    return np.asarray(about[:, None, :] * is_found[..., None])


def _gathered(places: Floats, moved: Floats) -> float:
    """Variance [px²] about a smooth motion of displacements (point,) that gather at whole pixels; 0 if they do not."""
    columns = powers((places - places.mean(axis=0)) / np.maximum(np.ptp(places, axis=0), 1.0))
    weight = np.ones(len(moved))
    for _ in range(_ROUNDS):
        weighed = columns.T * weight
        smooth = columns @ np.linalg.solve(weighed @ columns + _LEAST * len(moved) * np.eye(6), weighed @ moved)
        apart = moved - smooth
        follows = np.abs(apart) < _FOLLOWS
        variance = float(np.square(apart[follows]).mean()) if follows.any() else 0.0
        if variance < _SCATTER**2:
            return 0.0
        weight = 1.0 / (1.0 + np.square(apart / max(_FAR * float(np.median(np.abs(apart))), 1e-6)))
    if follows.mean() < _MOST:
        return 0.0
    # errors that gather nowhere blur the phases of the smooth motion
    expected = np.cos(2.0 * np.pi * smooth).mean() * np.exp(-2.0 * np.pi**2 * variance)
    gathered = np.cos(2.0 * np.pi * moved).mean() - expected
    return variance if gathered > _GATHERED + _BY_CHANCE / np.sqrt(len(moved)) else 0.0

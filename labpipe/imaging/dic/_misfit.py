"""What a subset that misfits by more than noise makes of its motion: another uncertainty, or none."""

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.dic._motion_uncertainty import EDGE, ONE_WAY, least_told, one_way
from labpipe.imaging.dic._reference import Reference

#: Shift (px) along the weakest direction that a misfit may hide at most, in patterns beyond
#: :data:`.ONE_WAY` and beyond :data:`.EDGE`, and how many standard deviations of the residual of noise it is beyond it.
_HIDDEN, _HIDDEN_BY_EDGE, _SIGNIFICANT = 1.0, 0.2, 4.0
#: Share of its frames in which a point shows its own noise, the largest multiple of what points of its
#: brightness show that it may be, and the multiple from which a point is hit by what misfits.
_BETTER, _BRIGHTER, _HIT = 0.1, 1.5, 2.0
#: Standard deviations by which that share lies below the mean by chance.
_BELOW_MEAN = 1.28
#: Standard deviations, and share of the noise, by which a misfit exceeds noise at least.
_BY_CHANCE, _LEAST_EXCESS = 4.0, 0.12
#: Variance of a pixel over that of rounding below which a film has no noise, and what whole levels hide of a motion
#: there: a share of the one that would change a pixel by rounding, beyond so many px.
_NOISELESS, _HIDDEN_SHARE, _HARDLY = 0.9, 0.25, 0.1
#: Points that a line needs, its rounds, and the weight of those below it.
_LEAST_POINTS, _ROUNDS, _BELOW = 8, 12, 4.0
#: Width over which pixels share a misfit, as a share of that of the subset.
_SHARED = 0.2


def is_beyond_texture(
    noise: Floats, own: float, spread: float, texture: Floats, strongest: Floats, pixels: float
) -> Flags:
    """Tell which results misfit by more than a wrong place along the weakest direction would.

    Where a pattern is an edge or a grating with little else, the correlation hardly falls at a wrong
    place along it, and the uncertainty, which takes the residual for noise, does not know of it. But
    the residual there is larger than noise by what the faint texture leaves unmatched.

    Parameters
    ----------
    noise : array (result,) [grey²]
        Variance of a pixel as the residual shows it.
    own, spread : float [grey²], [1]
        Variance of a pixel without a misfit, and its relative variance times the pixels.
    texture, strongest : arrays (result,) [grey²/px²]
        As in :class:`.Variances`.
    pixels : float
        Number of pixels.
    """
    excess = (noise - own) * pixels - _SIGNIFICANT * np.sqrt((2.0 + spread) * pixels) * own
    hidden = np.where(strongest > EDGE * texture, _HIDDEN_BY_EDGE, _HIDDEN)
    return np.asarray((strongest > ONE_WAY * texture) & (excess > hidden**2 * texture))


def misfits_of_edges(
    reference: Reference,
    found: Flags,
    deviation: Floats,
    covariance: Floats,
    texture: Floats,
    strongest: Floats,
    noise: Floats,
    is_static: Flags,
) -> Flags:
    """Tell which results (frame, point) on edges misfit as a wrong place along them would, or tell hardly one.

    Parameters
    ----------
    reference : Reference
    found : bool array (frame, usable point)
        Results that are asked about.
    deviation, covariance : arrays (frame, usable point, ...) [px], [px²]
        Of the motions by noise.
    texture, strongest, noise : arrays (frame, usable point)
        As in :class:`.Variances`.
    is_static : bool array (frame,)
    """
    weak = found & ((strongest > ONE_WAY * texture) | one_way(reference.subsets))
    is_doubtful = np.zeros(found.shape, bool)
    for n in np.flatnonzero(weak.any(axis=0)).tolist():
        k = int(np.argmax(weak[:, n]))
        weakest = float(least_told(deviation[k, n], covariance[k, n]))
        own, spread = reference.own_noise(n, noise[is_static, n], weakest)
        pixels = float(reference.subsets.level[n, 2])
        beyond = is_beyond_texture(noise[:, n], own, spread, texture[:, n], strongest[:, n], pixels)
        # of an edge, more than half of what resists along it is the reference's own noise
        by_noise = own * reference.noise.slope / reference.noise.static_frames
        beyond |= (texture[:, n] < pixels * by_noise) & (strongest[:, n] > EDGE * texture[:, n])
        is_doubtful[:, n] = weak[:, n] & beyond
    return is_doubtful


def hidden_by_levels(reference: Reference, noise: Floats) -> Floats:
    """Variance (frame, point, 3) [px²] along x and y, and covariance, of a motion that whole grey levels hide.

    Without noise, a pixel follows the motion of what hardly varies only when that changes it by half a level.

    Parameters
    ----------
    reference : Reference
    noise : array (frame, usable point) [grey²]
        As in :class:`.Variances`.
    """
    subsets = reference.subsets
    inverse = subsets.inverse[:, [0, 3, 0], [0, 3, 3]] * (reference.rounding * subsets.level[:, 2])[:, None]
    motion = np.sqrt(np.maximum(inverse[:, 0] + inverse[:, 1], 1e-30))
    share = _HIDDEN_SHARE * np.maximum(1.0 - _HARDLY / motion, 0.0)
    is_hidden = np.clip(1.0 - noise / (_NOISELESS * max(reference.rounding, 1e-30)), 0.0, 1.0)
    return np.asarray(np.nan_to_num(is_hidden)[..., None] * (share**2)[:, None] * inverse)


def still_noise(reference: Reference, noise: Floats, is_static: Flags) -> tuple[Floats, Floats]:
    """Variance [grey²] of a pixel around each usable point (point,) before anything moves, see :meth:`.own_noise`.

    Parameters
    ----------
    reference : Reference
    noise : array (frame, usable point) [grey²]
        As in :class:`.Variances`.
    is_static : bool array (frame,)

    Returns
    -------
    variance, spread : arrays (point,) [grey²], [1]
    """
    shown = np.where(noise[is_static] > 0.0, noise[is_static], 0.0)
    seen = (shown > 0.0).sum(axis=0)
    variance, spread = shown.sum(axis=0) / np.maximum(seen, 1), 2.0 / np.maximum(seen, 1)
    for n in np.flatnonzero(seen == 0).tolist():
        variance[n], spread[n] = reference.own_noise(n, shown[:0, n], reference.weakest_slopes(n))
    return variance, spread


def misfit_factor(
    noise: Floats, is_static: Flags, pixels: Floats, grey: Floats, still: tuple[Floats, Floats], texture: Floats
) -> Floats:
    """Factor (frame, point) of the standard uncertainty where a subset misfits by more than noise.

    What stands before the specimen, a reflection, or lines of another moment do not move with the
    subset. What they leave in the residual is no noise: neighbouring pixels share it, so that it
    moves the answer as few independent places would.

    Parameters
    ----------
    noise : array (frame, point) [grey²]
        Variance of a pixel as the residual shows it; NaN where nothing was found.
    is_static : bool array (frame,)
        Frames averaged into the reference.
    pixels, grey : arrays (point,) [1], [grey levels]
        Number of pixels of the subsets, and their mean.
    still : (array (point,), array (point,)) [grey²], [1]
        See :func:`still_noise`; infinite where a misfit may be one of interpolation.
    texture : array (frame, point) [grey²/px²]
        As in :class:`.Variances`.

    Notes
    -----
    A point's own noise is what it shows in its better frames, but not much more than points of its
    brightness mostly show: bright places are noisier than dark ones, and a subset that misfits in
    every frame shows none without misfit. Nor is it more than before anything moved, times what the
    noise of all points has grown by in a frame.

    Of edges that are sampled before they are blurred each moves on in steps of whole pixels. Where those of
    a subset step alike, they leave no misfit, and move it all the more: what most points of a frame misfit by,
    as a shift, all of them do.
    """
    factor = np.ones(noise.shape)
    moved = np.where(noise[~is_static] > 0.0, noise[~is_static], np.nan)
    found = np.flatnonzero(np.isfinite(moved).any(axis=0))
    if not len(found):
        return factor
    own = np.full(noise.shape[1], np.nan)
    better, middle = _quantiles(moved[:, found], (_BETTER, 0.5))
    own[found] = better * (1.0 + _BELOW_MEAN * np.sqrt(2.0 / pixels[found]))
    usual = _usual(own[found], grey[found])
    own[found] = np.minimum(own[found], _BRIGHTER * usual)
    # What is hit in most frames is hit in the others as well, where it moves too little to show much.
    is_hit = middle > _HIT * own[found]
    own[found[is_hit]] = np.minimum(own[found], usual)[is_hit]
    before, spread = still
    (grown,) = _quantiles(np.where(np.isfinite(before), moved / before, np.nan).T, (0.25,))
    known = before * np.fmax(grown, 1.0)[:, None]
    noisiest = own * (1.0 + _by_chance(pixels, 2.0)), known * (1.0 + _by_chance(pixels, 2.0 + spread))
    excess = np.maximum(np.nan_to_num(moved - np.fmin(*noisiest)), 0.0)
    squares = np.where(np.isfinite(moved), excess * pixels / texture[~is_static], np.nan)
    (usual_shift,) = _quantiles(squares.T, (0.5,))
    excess = np.fmax(excess, usual_shift[:, None] * texture[~is_static] / pixels)
    factor[~is_static] = np.sqrt(1.0 + _SHARED**2 * pixels * np.nan_to_num(excess / moved))
    return factor


def _by_chance(pixels: Floats, spread: Floats | float) -> Floats:
    """Share of a noise by which a residual exceeds it by chance, from the spread of both times the pixels."""
    return np.maximum(_BY_CHANCE * np.sqrt(spread / pixels), _LEAST_EXCESS)


def _quantiles(values: Floats, shares: tuple[float, ...]) -> list[Floats]:
    """Quantiles of every column without its NaN; numpy's own go through columns with NaN one by one."""
    ordered = np.sort(values, axis=0)  # NaN last
    last = np.isfinite(ordered).sum(axis=0) - 1
    found = []
    for share in shares:
        place = share * last
        low = np.floor(place).astype(int)
        pair = np.take_along_axis(ordered, np.stack([low, np.minimum(low + 1, last)]), axis=0)
        found.append(np.asarray(pair[0] + (place - low) * (pair[1] - pair[0])))
    return found


def _usual(noise: Floats, grey: Floats) -> Floats:
    """Lower edge of the noise of points as a line over their brightness: that of counted light is one."""
    level = np.full(len(noise), np.quantile(noise, 0.25))
    if len(noise) < _LEAST_POINTS or np.ptp(grey) == 0.0:
        return level
    columns = np.stack([np.ones(len(grey)), grey / np.ptp(grey)], axis=1)
    for _ in range(_ROUNDS):
        weight = np.where(noise < level, _BELOW, 1.0) / level
        line, *_ = np.linalg.lstsq(columns * weight[:, None], noise * weight, rcond=None)
        if line[1] <= 0.0:
            return np.full(len(noise), np.quantile(noise, 0.25))
        level = np.maximum(columns @ line, 0.3 * level)
    return level

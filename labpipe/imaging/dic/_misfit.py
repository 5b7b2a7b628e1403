"""What a subset that misfits by more than noise makes of its motion: another uncertainty, or none."""

from functools import cached_property

import numpy as np

from labpipe.arrays import Flags, Floats
from labpipe.imaging.dic._motion_uncertainty import one_way
from labpipe.imaging.dic._reference import Reference
from labpipe.imaging.dic._subsets import Subsets
from labpipe.imaging.dic._undersampling import sharpness

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
#: Relative variance of the variance of noise that what is nearest to half a wave per px tells, times the pixels.
_QUICK = 4.0
#: Squared slopes along the strongest direction over those along the weakest up to which parts tell the variance: edges
#: of one direction may misfit alike in all of them.
_SIDED = 4.0
#: Share of what the parts of a subset tell themselves of its variance, the rest is what those of most tell over that
#: of their residuals as noise; and share of all that where most tell it as a misfit of their texture. Least that parts
#: tell over the variance of noise: an edge through all of them may misfit alike.
_SHARES, _LEAST_TOLD = (0.5, 0.2), 0.36


def hidden_by_levels(reference: Reference, noise: Floats) -> Floats:
    """Variance (frame, point, 3) [px²] along x and y, and covariance, of a motion that whole grey levels hide.

    Without noise, a pixel follows the motion of what hardly varies only when that changes it by half a level.

    ``noise``: (frame, usable point) [grey²], as in :class:`.Variances`.
    """
    subsets = reference.subsets
    inverse = subsets.inverse[:, [0, 3, 0], [0, 3, 3]] * (reference.rounding * subsets.level[:, 2])[:, None]
    motion = np.sqrt(np.maximum(inverse[:, 0] + inverse[:, 1], 1e-30))
    share = _HIDDEN_SHARE * np.maximum(1.0 - _HARDLY / motion, 0.0)
    is_hidden = np.clip(1.0 - noise / (_NOISELESS * max(reference.rounding, 1e-30)), 0.0, 1.0)
    return np.asarray(np.nan_to_num(is_hidden)[..., None] * (share**2)[:, None] * inverse)


class StillNoise:
    """Noise of the points before anything moves, as the frames go by."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._shown: list[Floats] = []

    def see(self, residual: Floats) -> None:
        """Take in the residual (point,) [grey²] of a static frame."""
        frames, pixels = self._reference.noise.static_frames, self._reference.subsets.level[:, 2]
        if frames > 1:
            self._shown.append(residual / (pixels * self._reference.noise.own * (1.0 - 1.0 / frames)))

    @cached_property
    def most(self) -> Floats:
        """Residual (point,) [grey²] of a frame, as noise summed over a subset, beyond which it is more."""
        reference, pixels = self._reference, self._reference.subsets.level[:, 2]
        if not self._shown:
            return np.asarray(reference.most_noise * pixels * (1.0 + _by_chance(pixels, 2.0 + _QUICK)))
        static = np.reshape(self._shown, (-1, len(pixels)))
        variance, spread = still_noise(reference, static, np.ones(len(static), bool))
        return np.asarray(variance * pixels * (1.0 + _by_chance(pixels, 2.0 + spread)))

    @property
    def least(self) -> Floats:
        """The same of rounding: below it, whole levels hide what misfits."""
        return np.asarray(_NOISELESS * self._reference.rounding * self._reference.subsets.level[:, 2])

    @cached_property
    def sharp(self) -> Floats:
        """The same below which a point holds more near half a wave per px than interpolation is exact for."""
        sums, of_noise, least = sharpness(self._reference)
        return np.asarray(
            (sums - least) / of_noise / (1.0 + _by_chance(self._reference.subsets.level[:, 2], 2.0 + _QUICK))
        )


def still_noise(reference: Reference, noise: Floats, is_static: Flags) -> tuple[Floats, Floats]:
    """Variance [grey²] of a pixel around each usable point (point,) before anything moves, see :meth:`.own_noise`.

    ``noise``: (frame, usable point) [grey²], as in :class:`.Variances`; ``is_static``: bool (frame,).

    Returns ``variance``, ``spread``: (point,) [grey²], [1].
    """
    shown = np.where(noise[is_static] > 0.0, noise[is_static], 0.0)
    seen = (shown > 0.0).sum(axis=0)
    variance, spread = shown.sum(axis=0) / np.maximum(seen, 1), 2.0 / np.maximum(seen, 1)
    for n in np.flatnonzero(seen == 0).tolist():
        variance[n], spread[n] = reference.own_noise(n, shown[:0, n])
    return variance, spread


def take_spread(
    subsets: Subsets, deviation: Floats, covariance: Floats, spread: Floats, texture: Floats, strongest: Floats
) -> Flags:
    """Give motions the variance that parts of their subsets tell, where it was measured; tell where (frame, point).

    ``deviation``, ``covariance``: (frame, usable point, 3) and (frame, usable point) [px, px, rad], [px²], of the
    motions, if all of the residual were noise; changed in place; ``spread``: (frame, usable point, 3) [px²], see
    :func:`.misfit_spread`; ``texture``, ``strongest``: (frame, usable point) [grey²/px²], as in
    :class:`.Variances`.

    Notes
    -----
    What the parts of one subset tell is uncertain, and of edges that step alike there may be no misfit at all: part
    of it is what most points of the frame tell, as a misfit of their texture.
    """
    own = np.square(deviation[..., :2])
    both, told = own.sum(axis=2), spread[..., :2].sum(axis=2)
    is_found = np.isfinite(both) & ~(strongest > _SIDED * texture) & ~one_way(subsets, _SIDED)
    is_told = np.isfinite(told) & is_found
    rows = np.flatnonzero(is_told.any(axis=1))
    if not len(rows):
        return is_told
    is_taken = is_told | (is_found & (is_told.sum(axis=1) > 0.5 * is_found.sum(axis=1))[:, None])
    ratio, of_texture = np.ones((2, len(told), 1))
    ratio[rows, 0], of_texture[rows, 0] = (
        _quantiles(np.where(is_told, part, np.nan)[rows].T, (0.5,))[0]
        for part in (told / np.maximum(both, 1e-30), told * texture)
    )
    prior = ratio[..., None] * own
    misfit = (of_texture / np.maximum(texture * ratio * both, 1e-30))[..., None] * prior
    is_common = (is_taken & ~is_told).any(axis=1) | (is_told == is_found).all(axis=1)
    found = np.where(is_told[..., None], np.fmax(spread[..., :2], _LEAST_TOLD * own), prior)
    found = _SHARES[0] * found + (1.0 - _SHARES[0]) * prior
    found[is_common] += _SHARES[1] * (misfit - found)[is_common]
    grown = np.where(is_taken[..., None], np.sqrt(found / np.maximum(own, 1e-30)), 1.0)
    deviation[..., :2] *= grown
    deviation[..., 2] *= np.sqrt(np.square(grown).mean(axis=2))
    covariance *= grown.prod(axis=2)
    return is_taken


def misfit_factor(
    noise: Floats,
    is_static: Flags,
    pixels: Floats,
    grey: Floats,
    still: tuple[Floats, Floats],
    texture: Floats,
    is_taken: Flags,
) -> Floats:
    """Factor (frame, point) of the standard uncertainty where a subset misfits by more than noise.

    What stands before the specimen, a reflection, or lines of another moment do not move with the
    subset. What they leave in the residual is no noise: neighbouring pixels share it, so that it
    moves the answer as few independent places would.

    ``noise``: (frame, point) [grey²], variance of a pixel as the residual shows it; NaN where nothing was found;
    ``is_static``: bool (frame,), frames averaged into the reference; ``pixels``, ``grey``: (point,) [1], [grey
    levels], number of pixels of the subsets, and their mean; ``still``: (array (point,), array (point,)) [grey²],
    [1], see :func:`still_noise`; infinite where a misfit may be one of interpolation; ``texture``: (frame, point)
    [grey²/px²], as in :class:`.Variances`.

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
    most = np.broadcast_to(np.fmin(*noisiest), moved.shape)
    # what all misfit by alike, their own parts tell
    (usual_noise,) = _quantiles(moved.T, (0.5,))
    most = np.where(is_taken[~is_static], _HIT * np.fmax(usual_noise[:, None], most), most)
    excess = np.maximum(np.nan_to_num(moved - most), 0.0)
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

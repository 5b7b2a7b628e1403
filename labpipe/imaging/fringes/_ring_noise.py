"""Tell what a fit leaves of errors of the model from noise with a memory: speckle, stray fringes.

An error of the model is the same all along a ring, or changes slowly there. What changes faster is
noise, even where neighbouring pixels share it.
"""

import math

import numpy as np
from scipy.fft import dct

from labpipe.arrays import Flags, Floats, Integers

#: Sectors of a ring, and most bins across it.
SECTORS, MOST_BINS = 48, 64
#: Harmonics along a ring that count as slow, of both phases, on a whole ring; and how many of the
#: next ones tell the level of the noise.
_SLOW, _NEXT = 5, 12
#: Fewest sectors of a bin, and pixels in one.
_LEAST_SECTORS, _LEAST_PIXELS = 20, 2
#: Standard deviations by which slow residuals must exceed noise to count as errors of the model.
_SIGNIFICANT = 3.0
#: Weights of the products of sectors so many places apart, for noise that reaches over a sector.
_WEIGHTS = (1.0, 2.0 / 3.0, 1.0 / 3.0)
#: Relative size of what keeps a ring without one of its parts from telling nothing of a parameter.
_RIDGE = 1e-9


def slow_power(sums: Floats, counts: Floats) -> float | None:
    """Mean square of what the residuals hold beyond noise that changes along the rings.

    Parameters
    ----------
    sums, counts : arrays (bin, sector) [grey levels], [1]
        Residuals summed over the pixels of a cell, and the number of these.

    Returns
    -------
    float or None [grey levels squared]
        0 when it is there by chance; None when too little of the ring is seen to tell.
    """
    total = power = variance = 0.0
    is_seen = counts >= _LEAST_PIXELS
    numbers = is_seen.sum(axis=1)
    parts: list[tuple[Floats, Floats]] = []
    for number in np.unique(numbers[numbers >= _LEAST_SECTORS]).tolist():
        rows = np.flatnonzero(numbers == number)
        order = _from_gap(is_seen[rows])[:, :number]
        mean = sums[rows[:, None], order] / counts[rows[:, None], order]
        parts.append((np.asarray(dct(mean, norm="ortho", axis=1)) ** 2, counts[rows].sum(axis=1)))
    for wave, weight in parts:
        number = wave.shape[1]
        slow = max(1, round(_SLOW * number / sums.shape[1]))
        level = wave[:, slow : slow + _NEXT].mean(axis=1)
        total += float(weight.sum())
        power += float((weight * (wave[:, :slow].sum(axis=1) - slow * level)).sum()) / number
        # Each power of a harmonic scatters by √2 of its mean.
        variance += float(((weight * level / number) ** 2).sum()) * 2.0 * slow * (1.0 + slow / _NEXT)
    if total < 0.5 * counts.sum() or total == 0.0:
        return None
    return power / total if power > _SIGNIFICANT * math.sqrt(variance) else 0.0


def _from_gap(is_seen: Flags) -> Integers:
    """Sectors of each bin in their order from the end of its widest gap on, those that are not seen last."""
    size = is_seen.shape[1]
    places = np.arange(size)
    # the last sector that is seen before each, twice around
    last = np.maximum.accumulate(np.where(np.hstack([is_seen, is_seen]), np.arange(2 * size), -1), axis=1)
    before = last[:, size - 1 : -1]
    # of equal gaps the one across the first sector comes last
    gaps = np.where(is_seen, np.maximum(2 * (size - 1 + places - before) - (before < size), 0), 0)
    start = gaps.argmax(axis=1)[:, None]
    return np.argsort(np.where(is_seen, (places - start) % size, size), axis=1, kind="stable")


def clustered(scores: Floats, inverse: Floats) -> Floats:
    """Covariance of the parameters for noise that neighbouring pixels share.

    Parameters
    ----------
    scores : array (sector, parameter)
        Sums of residuals times slopes.
    inverse : array (parameter, parameter)
        Of the normal matrix.
    """
    used = scores[np.abs(scores).sum(axis=1) > 0.0]
    size = scores.shape[1]
    middle = np.zeros((size, size))
    for apart, weight in enumerate(_WEIGHTS):
        product = scores.T @ np.roll(scores, apart, axis=0)
        middle += weight * (product if apart == 0 else product + product.T)
    spare = max(len(used) - size, 1) / max(len(used), 1)
    return np.asarray(inverse @ middle @ inverse / spare)


def unsteadiness(normals: Floats, pulls: Floats, place: int) -> float:
    """Variance of a parameter by how it changes as each part of the ring is left out: a jackknife.

    Errors of the model that differ from part to part pull at it in the parts as they do in the whole;
    only what is the same in all of them stays hidden.

    Parameters
    ----------
    normals : array (part, parameter, parameter)
        Normal matrices of the parts.
    pulls : array (part, parameter)
        Sums of residuals times slopes, which cancel over all parts.
    place : int
        Which parameter.

    References
    ----------
    B. Efron, The Jackknife, the Bootstrap and Other Resampling Plans (1982), chapter 3,
    https://doi.org/10.1137/1.9781611970319
    """
    used = np.flatnonzero(normals[:, place, place] > 0.0)
    total = normals.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    others = (total - normals[used]) / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
    changes = np.linalg.solve(others, -(pulls[used] / scale)[:, :, None])[:, place, 0] / scale[place]
    return float((changes**2).sum()) * (len(used) - 1) / max(len(used), 1)

"""Partition of a record by smoothness: the longest pieces that a cubic describes.

Bottom-up over dyadic intervals. Each interval is represented by the triangular factor of its
least-squares problem, so two neighbours merge with one small factorisation and the whole tree
costs a time linear in the number of samples. Two halves stay separate when together they describe
the samples better by more than their additional parameters are worth.
"""

from math import comb

import numpy as np

from labpipe.arrays import Floats

LEAF = 4
"""Samples in the smallest interval."""

_ORDER = 4  # parameters of a piece: a cubic
_PRICE = 3.0  # chi-square that a parameter must gain: between Akaike (2) and Bayes (log n)


def smooth_lengths(position: Floats, values: Floats) -> Floats:
    """Length of the smooth piece around every leaf of :data:`LEAF` samples.

    Parameters
    ----------
    position : array (n,)
        Increasing abscissa.
    values : array (n,)
        Samples in units of their noise (standard deviation 1).

    Returns
    -------
    array (ceil(n / LEAF),)
        Number of samples of the dyadic interval that holds the leaf.
    """
    levels = _factors(position, values)
    cost = levels[0] + _PRICE * _ORDER
    keeps = [np.ones(len(cost), bool)]
    for residual in levels[1:]:
        own = residual + _PRICE * _ORDER
        parts = cost[0::2] + cost[1::2]
        keeps.append(own <= parts)
        cost = np.minimum(own, parts)
    lengths = np.zeros(1)
    for level in range(len(levels) - 1, -1, -1):
        lengths = np.where((lengths == 0.0) & keeps[level], float(LEAF * 2**level), lengths)
        if level:
            lengths = np.repeat(lengths, 2)
    return lengths[: -(-len(values) // LEAF)]


def graded(lengths: Floats, slope: float = 0.5) -> Floats:
    """Let lengths grow at most with the distance from shorter ones.

    A long piece that ends just inside an impact would otherwise bring its coarse knots there.
    """
    centre = (np.arange(len(lengths)) + 0.5) * LEAF
    rising = np.minimum.accumulate(lengths - slope * centre) + slope * centre
    falling = np.minimum.accumulate((lengths + slope * centre)[::-1])[::-1] - slope * centre
    result: Floats = np.minimum(rising, falling)
    return result


def _factors(position: Floats, values: Floats) -> list[Floats]:
    """Residual sum of squares of the cubic fit, of all intervals, level by level."""
    n = len(values)
    n_leaves = 1 << max(int(np.ceil(np.log2(max(n / LEAF, 1.0)))), 0)
    padding = n_leaves * LEAF - n
    weight = np.pad(np.ones(n), (0, padding)).reshape(-1, LEAF)
    t = np.pad(position, (0, padding), mode="edge").reshape(-1, LEAF)
    y = np.pad(values, (0, padding)).reshape(-1, LEAF)
    low, high = t[:, 0], t[:, -1]
    centre, half = _frame(low, high)
    u = (t - centre[:, None]) / half[:, None]
    columns = [weight * u**power for power in range(_ORDER)] + [weight * y]
    padded = np.pad(np.stack(columns, axis=-1), ((0, 0), (0, _ORDER + 1 - LEAF), (0, 0)))
    triangle = _triangle(padded)
    residuals = [triangle[:, _ORDER, _ORDER] ** 2]
    while len(triangle) > 1:
        low, high = low[0::2], high[1::2]
        new_centre, new_half = _frame(low, high)
        shifted = [_shifted(triangle[side::2], centre[side::2], half[side::2], new_centre, new_half) for side in (0, 1)]
        triangle = _triangle(np.concatenate(shifted, axis=1))
        centre, half = new_centre, new_half
        residuals.append(triangle[:, _ORDER, _ORDER] ** 2)
    return residuals


def _triangle(blocks: Floats) -> Floats:
    """R of the QR factorisation of every block."""
    return np.asarray(np.linalg.qr(blocks, mode="r"))


def _frame(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Centre and half length, by which the powers stay between -1 and 1."""
    return (low + high) / 2, np.where(high > low, (high - low) / 2, 1.0)


def _shifted(triangle: Floats, centre: Floats, half: Floats, new_centre: Floats, new_half: Floats) -> Floats:
    """Express the columns of the triangle in the powers of the parent interval."""
    shift, scale = (centre - new_centre) / new_half, half / new_half
    change = np.zeros((len(centre), _ORDER + 1, _ORDER + 1))
    change[:, _ORDER, _ORDER] = 1.0
    for power in range(_ORDER):
        for lower in range(power + 1):
            change[:, lower, power] = comb(power, lower) * shift ** (power - lower) * scale**lower
    return triangle @ change

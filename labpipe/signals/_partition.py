"""Partition of a record by smoothness: the longest pieces that a cubic describes.

Bottom-up over dyadic intervals. Each interval is represented by the triangular factor of its
least-squares problem, so two neighbours merge with one small factorisation and the whole tree
costs a time linear in the number of samples. Two halves stay separate when together they describe
the samples better by more than their additional parameters are worth.
"""

import math

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import compiled

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
    count = 1
    while count * LEAF < values.size:
        count *= 2
    residuals = np.empty(2 * count - 1)
    _tree(position, values, np.empty((count, _ORDER + 1, _ORDER + 1)), residuals)
    levels, end = [], 0
    while count:
        levels.append(residuals[end : end + count])
        end, count = end + count, count // 2
    return levels


@compiled(error_model="numpy")
def _tree(position: Floats, values: Floats, triangle: Floats, residuals: Floats) -> None:
    """Fill in the residuals of all leaves, of all pairs, and so on; ``triangle`` is work space."""
    n, count = values.size, triangle.shape[0]
    low, high = np.empty(count), np.empty(count)
    stacked = np.empty((2 * _ORDER + 2, _ORDER + 1))
    for leaf in range(count):
        first, end = min(leaf * LEAF, n - 1), min(leaf * LEAF + LEAF, n)
        low[leaf] = position[first]
        high[leaf] = position[end - 1]
        centre, half = _frame(low[leaf], high[leaf])
        for r in range(stacked.shape[0]):
            sample = leaf * LEAF + r
            inside = r < LEAF and sample < n
            power = 1.0 if inside else 0.0
            for c in range(_ORDER):
                stacked[r, c] = power
                power *= (position[sample] - centre) / half if inside else 0.0
            stacked[r, _ORDER] = values[sample] if inside else 0.0
        _triangle(stacked, triangle[leaf])
        residuals[leaf] = triangle[leaf, _ORDER, _ORDER] ** 2
    filled = count
    while count > 1:
        count //= 2
        for node in range(count):
            centre, half = _frame(low[2 * node], high[2 * node + 1])
            for child in range(2 * node, 2 * node + 2):
                own_centre, own_half = _frame(low[child], high[child])
                shift, scale = (own_centre - centre) / half, own_half / half
                _shifted(triangle[child], shift, scale, stacked, (child - 2 * node) * (_ORDER + 1))
            low[node], high[node] = low[2 * node], high[2 * node + 1]
            _triangle(stacked, triangle[node])
            residuals[filled + node] = triangle[node, _ORDER, _ORDER] ** 2
        filled += count


@compiled(error_model="numpy")
def _triangle(block: Floats, triangle: Floats) -> None:
    """R (5, 5) of the factorisation QR of a block (10, 5), by Householder; the block is used up."""
    rows, columns = block.shape
    for c in range(columns):
        size = 0.0
        for r in range(c, rows):
            size += block[r, c] ** 2
        size = -math.copysign(math.sqrt(size), block[c, c])
        triangle[c, c] = size
        if size != 0.0:
            block[c, c] -= size
        for other in range(c + 1, columns):
            along = 0.0
            if size != 0.0:
                for r in range(c, rows):
                    along += block[r, c] * block[r, other]
                along /= size * block[c, c]
                for r in range(c, rows):
                    block[r, other] += along * block[r, c]
            triangle[c, other] = block[c, other]
            triangle[other, c] = 0.0


@compiled(error_model="numpy")
def _frame(low: float, high: float) -> tuple[float, float]:
    """Centre and half length, by which the powers stay between -1 and 1."""
    return (low + high) / 2, ((high - low) / 2 if high > low else 1.0)


@compiled(error_model="numpy")
def _shifted(triangle: Floats, shift: float, scale: float, result: Floats, first: int) -> None:
    """Put the columns (5, 5), expressed in the powers of the parent interval, from row ``first`` on.

    They are those of ``shift + scale u``.
    """
    for row in range(_ORDER + 1):
        one, first_power = triangle[row, 0], scale * triangle[row, 1]
        second_power, third_power = scale**2 * triangle[row, 2], scale**3 * triangle[row, 3]
        to = result[first + row]
        to[0] = one
        to[1] = shift * one + first_power
        to[2] = shift * (shift * one + 2.0 * first_power) + second_power
        to[3] = shift * (shift * (shift * one + 3.0 * first_power) + 3.0 * second_power) + third_power
        to[_ORDER] = triangle[row, _ORDER]

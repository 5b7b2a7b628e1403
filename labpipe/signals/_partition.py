"""Partition of a record by smoothness: the longest pieces that a cubic describes.

Bottom-up over dyadic intervals. Each interval is represented by the triangular factor of its
least-squares problem, so two neighbours merge with one small factorisation and the whole tree
costs a time linear in the number of samples. Two halves stay separate when together they describe
the samples better by more than their additional parameters are worth.
"""

import math

import numpy as np

from labpipe.arrays import Floats
from labpipe.compilation import inner, lean

LEAF = 4
"""Samples in the smallest interval."""

_ORDER = 4  # parameters of a piece: a cubic
_SLOPE = 0.5  # by which lengths may grow with the distance from shorter ones
_PRICE = 3.0  # chi-square that a parameter must gain: between Akaike (2) and Bayes (log n)


def smooth_lengths(position: Floats, values: Floats) -> Floats:
    """Length of the smooth piece around every leaf of :data:`LEAF` samples.

    ``position`` (n,): Increasing abscissa. ``values`` (n,): Samples in units of their noise (standard deviation 1).
    Returns (ceil(n / LEAF): Number of samples of the dyadic interval that holds the leaf.
    """
    count = 2
    while count * LEAF < values.size:
        count *= 2
    residuals, side, end = np.empty(count - 1), _ORDER + 1, 0
    _tree(position, values, np.zeros((count // 2, side, side)), np.empty((2 * LEAF, side)), residuals)
    cost = np.full(count, _PRICE * _ORDER)  # a cubic passes through the samples of a leaf
    keeps = [np.ones(count, bool)]
    while count > 1:
        count //= 2
        own = residuals[end : end + count] + _PRICE * _ORDER
        end += count
        parts = cost[0::2] + cost[1::2]
        keeps.append(own <= parts)
        cost = np.minimum(own, parts)
    lengths = np.zeros(1)
    for level in range(len(keeps) - 1, -1, -1):
        lengths = np.where((lengths == 0.0) & keeps[level], float(LEAF * 2**level), lengths)
        if level:
            lengths = np.repeat(lengths, 2)
    return lengths[: -(-len(values) // LEAF)]


def graded(lengths: Floats) -> Floats:
    """Let lengths grow at most with the distance from shorter ones.

    A long piece that ends just inside an impact would otherwise bring its coarse knots there.
    """
    centre = (np.arange(len(lengths)) + 0.5) * LEAF
    rise = _SLOPE * centre
    rising = np.minimum.accumulate(lengths - rise) + rise
    falling = np.minimum.accumulate((lengths + rise)[::-1])[::-1] - rise
    return np.minimum(rising, falling)


@lean()
def _tree(position: Floats, values: Floats, triangle: Floats, below: Floats, residuals: Floats) -> None:
    """Fill in the residuals of all pairs of leaves, of pairs of pairs, and so on.

    ``triangle`` (pair, 5, 5), of zeros, and ``below`` (8, 5) are work space.
    """
    n, count, size = values.size, triangle.shape[0], below.shape[0]
    for pair in range(count):
        first, end = pair * size, min(pair * size + size, n)
        residuals[pair] = 0.0
        if first < end:
            centre, half = _frame(position[first], position[end - 1])
            for r in range(end - first):
                power = 1.0
                for c in range(_ORDER):
                    below[r, c] = power
                    power *= (position[first + r] - centre) / half
                below[r, _ORDER] = values[first + r]
            _reduce(triangle[pair], below, end - first)
            residuals[pair] = triangle[pair, _ORDER, _ORDER] ** 2
    filled = count
    while count > 1:
        count //= 2
        size *= 2
        for node in range(count):
            first, middle, end = node * size, node * size + size // 2, min(node * size + size, n)
            top = triangle[node]
            if middle >= end:  # nothing on the right: the frame is that of the left part
                for r in range(_ORDER + 1):
                    for c in range(_ORDER + 1):
                        top[r, c] = triangle[2 * node, r, c]
            else:
                centre, half = _frame(position[first], position[end - 1])
                _shift(triangle[2 * node], position[first], position[middle - 1], centre, half, top)
                _shift(triangle[2 * node + 1], position[middle], position[end - 1], centre, half, below)
                _reduce(top, below, 0)
            residuals[filled + node] = top[_ORDER, _ORDER] ** 2
        filled += count


@inner()
def _reduce(top: Floats, below: Floats, full: int) -> None:
    """Make ``top`` R (5, 5) of the factorisation QR of itself with the rows below it.

    That is so many ``full`` rows, or, with none, another triangle (5, 5). It is used up.
    """
    for c in range(_ORDER + 1):
        rows = full if full else c + 1
        square = top[c, c] ** 2
        for r in range(rows):
            square += below[r, c] ** 2
        if square > 0.0:
            size = -math.copysign(math.sqrt(square), top[c, c])
            pivot = top[c, c] - size
            over = 1.0 / (size * pivot)
            top[c, c] = size
            for other in range(c + 1, _ORDER + 1):
                along = pivot * top[c, other]
                for r in range(rows):
                    along += below[r, c] * below[r, other]
                along *= over
                top[c, other] += along * pivot
                for r in range(rows):
                    below[r, other] += along * below[r, c]


@inner()
def _frame(low: float, high: float) -> tuple[float, float]:
    """Centre and half length, by which the powers stay between -1 and 1."""
    return (low + high) / 2, ((high - low) / 2 if high > low else 1.0)


@inner()
def _shift(triangle: Floats, low: float, high: float, centre: float, half: float, result: Floats) -> None:
    """Express a triangle from ``low`` to ``high`` in the powers of its parent's interval."""
    own_centre, own_half = _frame(low, high)
    shift, scale = (own_centre - centre) / half, own_half / half
    for row in range(_ORDER + 1):
        one, first_power = triangle[row, 0], scale * triangle[row, 1]
        second_power, third_power = scale**2 * triangle[row, 2], scale**3 * triangle[row, 3]
        to = result[row]
        to[0] = one
        to[1] = shift * one + first_power
        to[2] = shift * (shift * one + 2.0 * first_power) + second_power
        to[3] = shift * (shift * (shift * one + 3.0 * first_power) + 3.0 * second_power) + third_power
        to[_ORDER] = triangle[row, _ORDER]

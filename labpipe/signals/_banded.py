"""Selected inverse of a symmetric positive definite band matrix, in time linear in its size.

The variance of a fitted spline needs only those entries of the inverse that lie inside the band.
Odd-even block elimination gives exactly these: half of the blocks are eliminated at once, the rest
form a block tridiagonal matrix of half the size, and so on; every level is a handful of batched
small products.
"""

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats


def selected_inverse(band: Floats) -> Floats:
    """Return the entries of the inverse that lie inside the band.

    Parameters
    ----------
    band : array (width + 1, n)
        Lower form as in :func:`scipy.linalg.cholesky_banded`: ``band[d, j] = A[j + d, j]``;
        the matrix is symmetric and positive definite.

    Returns
    -------
    array (width + 1, n)
        ``A^-1`` in the same form; entries beyond the end of a diagonal are 0.

    Examples
    --------
    >>> selected_inverse(np.array([[2.0, 2.0], [1.0, 0.0]])).round(4).tolist()
    [[0.6667, 0.6667], [-0.3333, 0.0]]
    """
    width, n = band.shape[0] - 1, band.shape[1]
    size = max(width, 1)
    count = -(-n // size)
    full = np.zeros((width + 1, count * size))
    full[:, :n] = band
    for d in range(1, width + 1):
        full[d, max(n - d, 0) :] = 0.0
    full[0, n:] = 1.0
    diagonal = np.zeros((count, size, size))
    below = np.zeros((max(count - 1, 0), size, size))
    for d in range(width + 1):
        (block_i, i), (block_j, j), same, column = _places(d, count, size)
        diagonal[block_i[same], i[same], j[same]] = full[d, column[same]]
        diagonal[block_i[same], j[same], i[same]] = full[d, column[same]]
        other = ~same
        below[block_j[other], i[other], j[other]] = full[d, column[other]]
    inverse_diagonal, inverse_below = _block_inverse(diagonal, below)
    result = np.zeros_like(full)
    for d in range(width + 1):
        (block_i, i), (block_j, j), same, column = _places(d, count, size)
        result[d, column[same]] = inverse_diagonal[block_i[same], i[same], j[same]]
        other = ~same
        result[d, column[other]] = inverse_below[block_j[other], i[other], j[other]]
    for d in range(1, width + 1):
        result[d, max(n - d, 0) :] = 0.0
    return result[:, :n]


def quadratic_form(first: NDArray[np.intp], rows: Floats, inverse: Floats) -> Floats:
    """Evaluate ``r A^-1 r`` for rows with few neighbouring non-zeros.

    Parameters
    ----------
    first : array (m,)
        Column of each row's first non-zero.
    rows : array (m, width + 1)
        The non-zeros.
    inverse : array (width + 1, n)
        From :func:`selected_inverse`.

    Returns
    -------
    array (m,)
    """
    total = np.zeros(len(first))
    for i in range(rows.shape[1]):
        for j in range(i + 1):
            weight = 1.0 if i == j else 2.0
            total += weight * rows[:, i] * rows[:, j] * inverse[i - j, first + j]
    return np.maximum(total, 0.0)


_Place = tuple[NDArray[np.intp], NDArray[np.intp]]


def _places(d: int, count: int, size: int) -> tuple[_Place, _Place, NDArray[np.bool_], NDArray[np.intp]]:
    """Block and place inside the block of row and column of the d-th diagonal."""
    column = np.arange(max(count * size - d, 0))
    block_i, i = np.divmod(column + d, size)
    block_j, j = np.divmod(column, size)
    return (block_i, i), (block_j, j), block_i == block_j, column


def _transpose(blocks: Floats) -> Floats:
    return blocks.transpose(0, 2, 1)


def _block_inverse(diagonal: Floats, below: Floats) -> tuple[Floats, Floats]:
    """Diagonal blocks of the inverse and those just below, of a block tridiagonal matrix."""
    if len(diagonal) == 1:
        return np.asarray(np.linalg.inv(diagonal)), below
    odd = diagonal[1::2]
    n_odd = len(odd)
    inverse_even = np.linalg.inv(diagonal[0::2])
    left = below[0::2]  # A[odd i, even i]
    right = below[1::2]  # A[even i + 1, odd i]
    n_right = len(right)
    eliminated = odd - left @ inverse_even[:n_odd] @ _transpose(left)
    eliminated[:n_right] -= _transpose(right) @ inverse_even[1 : 1 + n_right] @ right
    coupling = -left[1:] @ inverse_even[1:n_odd] @ right[: n_odd - 1]
    odd_diagonal, odd_below = _block_inverse(eliminated, coupling)

    gain_right = -inverse_even[:n_odd] @ _transpose(left)  # even i <- odd i
    gain_left = -inverse_even[1 : 1 + n_right] @ right  # even i + 1 <- odd i
    even_odd = gain_right @ odd_diagonal
    even_odd[1:] += gain_left[: n_odd - 1] @ _transpose(odd_below)
    next_even_odd = gain_left @ odd_diagonal[:n_right]
    next_even_odd[: n_odd - 1] += gain_right[1:] @ odd_below
    even = inverse_even
    even[:n_odd] += even_odd @ _transpose(gain_right)
    even[1 : 1 + n_right] += next_even_odd @ _transpose(gain_left)

    inverse = np.empty_like(diagonal)
    inverse[0::2], inverse[1::2] = even, odd_diagonal
    inverse_below = np.empty_like(below)
    inverse_below[0::2], inverse_below[1::2] = _transpose(even_odd), next_even_odd
    return inverse, inverse_below

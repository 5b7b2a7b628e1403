"""Solution and selected inverse of a symmetric positive definite band matrix, compiled.

The variance of a fitted spline needs only those entries of the inverse that lie inside the band.
They follow from the factor from the last row to the first [1]_, in time linear in the size. The
band is as wide as a quintic spline's, a constant: loops of a known length become straight code.

References
----------
.. [1] K. Takahashi, J. Fagan, M.-S. Chin, Proc. 8th PICA Conf. (1973) 63; see A. M. Erisman,
   W. F. Tinney, Comm. ACM 18 (1975) 177, https://doi.org/10.1145/360680.360704
"""

from labpipe.arrays import Floats
from labpipe.compilation import lean

WIDTH = 5
"""Diagonals below the main one."""


@lean()
def factored(band: Floats, n: int) -> bool:
    """Replace the lower band of a matrix by its factors ``L D L'``; False if that fails.

    ``band[j, d] = A[j + d, j]``, of shape (n + WIDTH, WIDTH + 1); what stands beyond the end of a
    diagonal, in its last rows too, is set to 0. ``D`` is kept as its inverse.
    """
    for j in range(n + WIDTH):
        for d in range(max(n - j, 0), WIDTH + 1):
            if j + d >= n:
                band[j, d] = 0.0
    for j in range(n):
        if not band[j, 0] > 0.0:
            return False
        inverse = 1.0 / band[j, 0]
        band[j, 0] = inverse
        for d in range(1, WIDTH + 1):
            share = band[j, d] * inverse
            for e in range(d, WIDTH + 1):
                band[j + d, e - d] -= share * band[j, e]
        for d in range(1, WIDTH + 1):
            band[j, d] *= inverse
    return True


@lean()
def solve(factor: Floats, x: Floats, n: int) -> None:
    """Replace the right-hand side ``x`` (n + WIDTH,) by the solution, with :func:`factored`."""
    for j in range(n, n + WIDTH):
        x[j] = 0.0
    for j in range(n):
        for d in range(1, WIDTH + 1):
            x[j + d] -= factor[j, d] * x[j]
    for j in range(n - 1, -1, -1):
        total = x[j] * factor[j, 0]
        for d in range(1, WIDTH + 1):
            total -= factor[j, d] * x[j + d]
        x[j] = total


@lean()
def inverse_of_factor(factor: Floats, inverse: Floats, n: int) -> None:
    """Fill in the entries (n + WIDTH, WIDTH + 1) of ``A^-1`` inside the band; the others 0."""
    for j in range(n, n + WIDTH):
        for d in range(WIDTH + 1):
            inverse[j, d] = 0.0
    for j in range(n - 1, -1, -1):
        on = factor[j, 0]
        for i in range(1, WIDTH + 1):
            total = 0.0
            for k in range(1, WIDTH + 1):
                total -= factor[j, k] * inverse[j + min(i, k), abs(i - k)]
            inverse[j, i] = total
            on -= factor[j, i] * total
        inverse[j, 0] = on

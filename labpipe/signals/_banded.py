"""Solution and selected inverse of a symmetric positive definite band matrix, compiled.

The variance of a fitted spline needs only those entries of the inverse that lie inside the band.
They follow from Cholesky's factor from the last column to the first [1]_, in time linear in the
size.

References
----------
.. [1] K. Takahashi, J. Fagan, M.-S. Chin, Proc. 8th PICA Conf. (1973) 63; see A. M. Erisman,
   W. F. Tinney, Comm. ACM 18 (1975) 177, https://doi.org/10.1145/360680.360704
"""

import math

from labpipe.arrays import Floats
from labpipe.compilation import compiled


@compiled(error_model="numpy")
def cholesky(band: Floats) -> bool:
    """Replace the lower band (width + 1, n) of a matrix by its factor's; False if that fails.

    ``band[d, j] = A[j + d, j]``; what stands beyond the end of a diagonal is set to 0.
    """
    width, n = band.shape[0] - 1, band.shape[1]
    for j in range(n):
        inside = min(width, n - 1 - j)
        for d in range(inside + 1, width + 1):
            band[d, j] = 0.0
        if not band[0, j] > 0.0:
            return False
        root = math.sqrt(band[0, j])
        band[0, j] = root
        for d in range(1, inside + 1):
            band[d, j] /= root
        for d in range(1, inside + 1):
            for e in range(d, inside + 1):
                band[e - d, j + d] -= band[d, j] * band[e, j]
    return True


@compiled(error_model="numpy")
def solve(factor: Floats, right: Floats, x: Floats) -> None:
    """Solve ``A x = right`` (n,) with the factor of :func:`cholesky`, and fill in ``x`` (n,)."""
    width, n = factor.shape[0] - 1, factor.shape[1]
    for j in range(n):
        x[j] = right[j]
    for j in range(n):
        x[j] /= factor[0, j]
        for d in range(1, min(width, n - 1 - j) + 1):
            x[j + d] -= factor[d, j] * x[j]
    for j in range(n - 1, -1, -1):
        for d in range(1, min(width, n - 1 - j) + 1):
            x[j] -= factor[d, j] * x[j + d]
        x[j] /= factor[0, j]


@compiled(error_model="numpy")
def inverse_of_factor(factor: Floats, inverse: Floats) -> None:
    """Fill in the entries (width + 1, n) of ``A^-1`` inside the band; the others 0.

    ``factor`` is that of :func:`cholesky`.
    """
    width, n = factor.shape[0] - 1, factor.shape[1]
    for j in range(n - 1, -1, -1):
        inside = min(width, n - 1 - j)
        for i in range(inside + 1, width + 1):
            inverse[i, j] = 0.0
        for i in range(inside, 0, -1):
            total = 0.0
            for k in range(1, inside + 1):
                low, high = min(i, k), max(i, k)
                total += factor[k, j] * inverse[high - low, j + low]
            inverse[i, j] = -total / factor[0, j]
        total = 1.0 / factor[0, j]
        for k in range(1, inside + 1):
            total -= factor[k, j] * inverse[k, j]
        inverse[0, j] = total / factor[0, j]

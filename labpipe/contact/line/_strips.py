r"""Springs of a periodic line contact: the influence of its strips, factored once.

The half period is folded onto the strips at 0, Δx, 2Δx, ... and ordered from the centre outwards;
see :mod:`labpipe.contact.springs._bed` for the meaning of the factor.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import LinAlgError, cholesky, solve_triangular

from labpipe.arrays import Floats
from labpipe.contact.line._kernels import LineKernel
from labpipe.contact.springs import EDGE_OFFSET, SpringBed
from labpipe.errors import InputError

# The last strips before a half-plane closes carry the logarithmic singularity of full contact.
_OPEN_STRIPS = 3
# Springs beyond the reach: two locate the edge, the others are for comfort.
_SPARE_SPRINGS = 16


class FoldedLine(NamedTuple):
    """The factored half period behind a line's spring bed, for pressures and surfaces."""

    factor: Floats
    scale: Floats
    counts: Floats


def line_bed(kernel: LineKernel, profile: Floats, reach: float, limit: str) -> tuple[SpringBed, FoldedLine]:
    """Factor the half period of a symmetric profile from the centre outwards.

    ``profile`` (n,) [m] is the height of the indenter above its lowest point at x = 0, Δx, 2Δx, ..., fewer values than
    ``elements/2 + 1`` when it ends before; only strips that an approach of ``reach`` [m] can touch are factored, all
    for infinity; ``limit`` is the message when the contact reaches the last strip. There is one spring per strip that
    can be touched, and the factor for :func:`line_pressure`. A layer too thin for its strips, whose influence matrix is
    not positive definite, raises InputError.
    """
    half = kernel.elements // 2
    # Constants are in the null space of a half-plane: the last strip has no spring.
    available = half + 1 if kernel.mean_compliance > 0.0 else half
    available = min(available, profile.size)
    # Contact grows monotonically on a half-plane; a layer may bulge, so there every strip has to be looked at.
    is_plain = kernel.mean_compliance == 0.0
    near = int(1.3 * np.count_nonzero(profile[:available] <= reach)) + _SPARE_SPRINGS
    n = min(available, near) if is_plain else available
    while True:
        bed, folded = _factor(kernel, profile[:n], limit)
        if n == available or bed.gap[-1] > reach:
            break
        n = min(available, 2 * n)
    reached = np.flatnonzero(bed.gap <= reach)
    keep = min(n, (int(reached[-1]) if reached.size else 0) + _SPARE_SPRINGS)
    open_springs = 0 if n == half + 1 else _OPEN_STRIPS
    if keep < available:
        # The rest lies beyond the reach: running into it would be a mistake of this module.
        open_springs = 1
    bed = SpringBed(
        bed.gap[:keep],
        bed.stiffness[:keep],
        bed.edge[:keep],
        open_springs,
        limit,
        full_width=min((keep - 0.5) * kernel.spacing, 0.5 * kernel.period),
    )
    return bed, FoldedLine(folded.factor[:keep, :keep], folded.scale[:keep], folded.counts[:keep])


def _factor(kernel: LineKernel, profile: Floats, limit: str) -> tuple[SpringBed, FoldedLine]:
    matrix, counts = folded_matrix(kernel, profile.size)
    try:
        factor = cholesky(matrix.T, lower=True, overwrite_a=True, check_finite=False)  # as LAPACK stores it
    except LinAlgError:
        raise InputError(
            "the influence matrix is not positive definite in double precision: the layer is too "
            "thin (or too nearly incompressible) for this period; give a thicker layer"
        ) from None
    both = np.stack([counts, counts * profile], axis=1)
    solved: Floats = solve_triangular(factor, both, lower=True, check_finite=False)
    scale, reduced = solved.T
    index = np.arange(profile.size)
    bed = SpringBed(
        gap=reduced / scale,
        stiffness=kernel.spacing * scale**2,
        edge=kernel.spacing * np.maximum(index - EDGE_OFFSET, 0.0),
        open_springs=0,
        limit=limit,
    )
    return bed, FoldedLine(factor, scale, counts)


def folded_matrix(kernel: LineKernel, n: int) -> tuple[Floats, Floats]:
    """Influence matrix (n, n) of the folded half period, made symmetric, and the strip counts (n,).

    Strip 0 (and the one at half a period) occurs once, every other one twice.
    """
    influence = kernel.influence  # even about 0, so that sums of indices wrap around for themselves
    apart = sliding_window_view(np.concatenate([influence[n - 1 : 0 : -1], influence[:n]]), n)[::-1]
    together = sliding_window_view(np.concatenate([influence, influence[: max(2 * n - 1 - influence.size, 0)]]), n)[:n]
    matrix: Floats = apart + together
    matrix *= 2.0
    counts = np.full(n, 2.0)
    once = [0, n - 1] if n == kernel.elements // 2 + 1 else [0]
    for strip in once:
        counts[strip] = 1.0
        matrix[strip] *= 0.5
        matrix[:, strip] *= 0.5
    return matrix, counts


def line_pressure(kernel: LineKernel, folded: FoldedLine, load: Floats) -> Floats:
    """Pressure (..., element), centred on x = 0 at index N/2, from spring loads (..., spring)."""
    scaled = np.atleast_2d(load * folded.scale)
    half = solve_triangular(folded.factor, scaled.T, lower=True, trans="T", check_finite=False).T
    n, size = half.shape[-1], kernel.elements
    full = np.zeros((half.shape[0], size))
    centre = size // 2
    full[:, centre : centre + min(n, centre)] = half[:, :centre]
    full[:, centre - n + 1 : centre + 1] = half[:, ::-1]
    return full.reshape(*load.shape[:-1], size)

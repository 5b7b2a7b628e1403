"""How far parts of a subset contradict each other about its motion.

A residual of white noise moves an answer by what its mean square tells. Errors of interpolation between
too few pixels, and edges that were blurred in the reference, lie where the slopes are, and neighbouring
pixels share them: then the parts of a subset disagree by more, and their disagreement is the
uncertainty.
"""

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.imaging.dic._spline import LANES, PADDING
from labpipe.imaging.dic._subset_cutting import Subsets
from labpipe.imaging.dic._subset_kernel import COLUMNS, scatter_subsets

#: Width of a block (px): that of an edge with what interpolation makes of it.
_BLOCK = 6


def scatter_of_blocks(
    subsets: Subsets,
    coefficients: Floats32,
    order: int,
    chosen: Integers,
    motion: Floats,
    gain: Floats,
    *,
    origin: tuple[int, int],
    window: tuple[float, float, float, float],
    model: int,
) -> tuple[Floats, Floats]:
    """Variances of u, v, their covariance, and the variance of the turn (point, 4), and what sharp edges add.

    In px² and rad².

    Parameters
    ----------
    subsets, coefficients, order, chosen, origin, window, model
        As in :func:`.solve`.
    motion, gain : arrays (point, 6) and (point,)
        The solution.

    Notes
    -----
    Every pixel moves the answer by its residual times its weight in the solution. Sums of that over
    blocks of six pixels, each against the answer of all others (the jackknife), scatter as the answer
    does. Edges that run with the columns or rows are seen at one phase all along, so that what pixels of
    one column or row have in common beyond their blocks is added, as is more where few blocks hold all edges.

    References
    ----------
    A. C. Cameron, J. B. Gelbach, D. L. Miller, J. Bus. Econ. Stat. 29 (2011) 238-249,
    https://doi.org/10.1198/jbes.2010.07136
    """
    scatter = np.zeros((len(chosen), 8))
    if not len(chosen):
        return scatter[:, :4], scatter[:, 4:]
    width = 2 * int(subsets.half[chosen].max()) + 1
    count = -(-width // _BLOCK)
    scatter_subsets(
        coefficients,
        order,
        (float(origin[0] - PADDING), float(origin[1] - PADDING)),
        window,
        np.ascontiguousarray(chosen, np.int64),
        subsets.layout,
        subsets.packed,
        subsets.level,
        subsets.moments,
        subsets.model(model).inverse,
        model,
        _BLOCK,
        np.ascontiguousarray(motion),
        np.ascontiguousarray(gain),
        scatter,
        np.zeros((width, 2 * LANES + width), np.float32),
        np.zeros((2, count, width, 3)),
        np.zeros((4 + count, COLUMNS)),
    )
    return scatter[:, :4], scatter[:, 4:]

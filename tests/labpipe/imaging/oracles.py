"""Plain numpy and scipy twins of the compiled kernels."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from labpipe.arrays import Floats
from labpipe.imaging.dic._kernels import compose_with_inverse
from labpipe.imaging.dic._spline import NODE_SLOPES, NODE_WEIGHTS
from labpipe.imaging.dic._subsets import _RIGID_FROM_AFFINE


def prefilter_oracle(image: NDArray[np.generic], order: int) -> NDArray[np.float64]:
    """Compute the coefficients with ``scipy.ndimage`` in float64, without border.

    Parameters
    ----------
    image : array (row, column)
        Grey levels.
    order : 3 or 5
        Cubic or quintic.

    Returns
    -------
    array (row, column)
        The coefficients that :func:`prefilter` approximates in float32.
    """
    return np.asarray(spline_filter(image, order, output=np.float64, mode="mirror"))


def solve_oracle(
    reference: NDArray[np.generic],
    image: NDArray[np.generic],
    centre: tuple[int, int],
    half: int,
    is_rigid: bool,
    order: int,
    motion: Floats,
    *,
    tolerance: float = 1e-6,
    max_iterations: int = 30,
) -> tuple[Floats, float]:
    """Match one subset with ``scipy.ndimage`` in float64: the check on ``solve``.

    Parameters
    ----------
    reference, image : arrays (row, column)
        Grey levels.
    centre : (x, y) [px]
        Centre pixel of the subset.
    half : int [px]
        Half width.
    is_rigid : bool
        Translation and rotation, or affine.
    order : 3 or 5
        Spline order.
    motion : array (6,) [px]
        Start.
    tolerance : float [px]
        Step at which to stop.
    max_iterations : int
        Steps allowed.

    Returns
    -------
    motion : array (6,)
        As in :class:`Solution`.
    zncc : float
        Correlation at the solution.
    """
    i, j = np.mgrid[-half : half + 1, -half : half + 1].astype(float)
    area = np.s_[centre[1] - half : centre[1] + half + 1, centre[0] - half : centre[0] + half + 1]
    before, after = prefilter_oracle(reference, order), prefilter_oracle(image, order)

    def slope(axis: int) -> Floats:
        result = before
        for along in (0, 1):
            weights = NODE_SLOPES if along == axis else NODE_WEIGHTS
            result = np.apply_along_axis(
                lambda line, w=weights[order]: np.correlate(np.pad(line, len(w) // 2, mode="reflect"), w, "valid"),
                along,
                result,
            )
        return np.asarray(result[area])

    gx, gy = slope(1), slope(0)
    f = np.asarray(reference, float)[area]
    f = f - f.mean()
    images = np.stack([gx, gx * j, gx * i, gy, gy * j, gy * i])
    basis = _RIGID_FROM_AFFINE if is_rigid else np.eye(6)
    jacobian = np.concatenate([np.tensordot(basis, images, 1), f[None], np.ones_like(f)[None]]).reshape(
        len(basis) + 2, -1
    )
    p = np.array(motion, float)
    zncc = math.nan
    for _ in range(max_iterations):
        x = centre[0] + j + p[0] + p[1] * j + p[2] * i
        y = centre[1] + i + p[3] + p[4] * j + p[5] * i
        g = map_coordinates(after, [y, x], order=order, prefilter=False, mode="mirror")
        g = g - g.mean()
        zncc = float((f * g).sum() / math.sqrt((f**2).sum() * (g**2).sum()))
        gain = (f**2).sum() / (f * g).sum()
        found, *_ = np.linalg.lstsq(jacobian.T, (gain * g - f).ravel(), rcond=None)
        step = basis.T @ found[:-2]
        compose_with_inverse(p, step, is_rigid)
        if np.hypot(step[0], step[3]) < tolerance:
            break
    return p, zncc


def plain_lines(
    x: Floats,
    y: Floats,
    along_x: Floats,
    along_y: Floats,
    weight: Floats,
    shape: tuple[int, int],
    cell: float,
    margin: float,
    reach: int,
) -> Floats:
    """Add up the weights of the lines that go through each cell, counted once a cell width.

    The numpy twin of :func:`labpipe.imaging.fringes._vote_kernel.count_lines`, to the same bits.
    """
    rows, columns = shape
    steps = (np.arange(-reach, reach + 1) * cell)[:, None]
    column = np.floor((x + steps * along_x + margin) / cell).astype(np.int64)
    row = np.floor((y + steps * along_y + margin) / cell).astype(np.int64)
    is_inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    weights = np.broadcast_to(weight, column.shape)[is_inside]
    cells = row[is_inside] * columns + column[is_inside]
    votes: Floats = np.bincount(cells, weights, minlength=rows * columns).astype(np.float64)
    return votes.reshape(rows, columns)

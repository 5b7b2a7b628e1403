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
    """Compute the coefficients that ``prefilter`` approximates in float32 by ``scipy.ndimage``, without border."""
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
    """Match one subset with ``scipy.ndimage`` in float64: the motion (6,) and the correlation, as ``solve`` finds them.

    ``centre`` is (x, y), ``half`` the half width in px; the solver stops at a step below ``tolerance`` px.
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

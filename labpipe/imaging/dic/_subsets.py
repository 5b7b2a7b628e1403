"""Square subsets of the reference image and their normal equations, prepared once.

A motion is six numbers ``(u, u_x, u_y, v, v_x, v_y)``: the pixel at (j, i) from the subset's
centre moves to ``(j + u + u_x j + u_y i, i + v + v_x j + v_y i)``. A rigid motion is the same with
the matrix of a rotation. Importing this module imports numba.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.compilation import njit
from labpipe.imaging.dic._kernels import AFFINE, FAST
from labpipe.imaging.dic._spline import LANES

#: Below this relative eigenvalue of the balanced normal matrix the components of a motion are not independent.
_LEAST_EIGENVALUE = 1e-4
#: Slopes below this share of the grey level per px are rounding errors of float32.
_LEAST_SLOPE = 1e-4
_RIGID_FROM_AFFINE = np.array([[1, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, -1, 0, 1, 0]], float)


@dataclass(frozen=True)
class Subsets:
    """Everything that the solver needs of the reference, computed once.

    Attributes
    ----------
    layout : integer array (point, 5)
        Centre pixel x and y, half width (px; the subset is ``2 half + 1`` wide), place in the
        packed arrays, and length of a row there.
    shape : int8 array (point,)
        ``RIGID``, ``AFFINE`` or ``AUTO``.
    packed : float32 array (4, ...)
        Grey levels less their mean, slope in x, slope in y, and 1 where a pixel counts; rows filled up with zeros.
    level : array (point, 3)
        Mean grey level, sum of squares about it, and number of pixels.
    moments : array (point, 2, 6)
        Sums of the six steepest-descent images, alone and times the grey level.
    normal : array (point, 6, 6)
        Normal matrix of the motion, gain and offset eliminated.
    rigid, affine : arrays (point, 6, 6)
        Its inverse within the rigid and the affine motions; zero where the texture does not determine them.
    """

    layout: Integers
    shape: NDArray[np.int8]
    packed: Floats32
    level: Floats
    moments: Floats
    normal: Floats
    rigid: Floats
    affine: Floats

    def __len__(self) -> int:
        """Return the number of subsets."""
        return len(self.layout)

    @property
    def arrays(self) -> tuple[Integers, NDArray[np.int8], Floats32, Floats, Floats, Floats, Floats, Floats]:
        """All arrays in their order, as compiled code takes them."""
        return (
            self.layout, self.shape, self.packed, self.level, self.moments, self.normal, self.rigid, self.affine
        )  # fmt: skip

    @property
    def half(self) -> Integers:
        """Half width of each subset (px)."""
        return self.layout[:, 2]

    @property
    def inverse(self) -> Floats:
        """Inverse normal matrix (point, 6, 6) within the motions that each subset is solved for at first."""
        return np.where((self.shape == AFFINE)[:, None, None], self.affine, self.rigid)


def cut_subsets(
    image: Floats32,
    gradient_x: Floats32,
    gradient_y: Floats32,
    centres: Integers,
    half: Integers,
    shape: NDArray[np.int8],
    inside: Flags | None = None,
    visible: Sequence[Flags] | None = None,
) -> Subsets:
    """Cut the subsets out of the reference and prepare their normal equations.

    Parameters
    ----------
    image, gradient_x, gradient_y : float32 arrays (row, column)
        Reference and the slopes of its spline at the pixels.
    centres : integer array (point, 2) [px]
        Centre pixels (x, y); every subset must lie inside the image.
    half : integer array (point,) [px]
        Half widths.
    shape : int8 array (point,)
        ``RIGID``, ``AFFINE`` or ``AUTO``.
    inside : bool array (row, column), optional
        Pixels of the reference that count; by default all.
    visible : list of bool arrays (row, column), optional
        Pixels of each subset that are not hidden in the frame.
    """
    count = len(half)
    width = 2 * half + 1
    stride = -(-width // LANES) * LANES
    start = np.concatenate([[0], np.cumsum(width * stride)])
    layout = np.column_stack([centres, half, start[:-1], stride]).astype(np.int64)
    packed = np.zeros((4, int(start[-1])), np.float32)
    for n, (x, y, h, place, pitch) in enumerate(layout.tolist()):
        counts = packed[3, place : place + (2 * h + 1) * pitch].reshape(-1, pitch)[:, : 2 * h + 1]
        counts[:] = 1.0 if inside is None else inside[y - h : y + h + 1, x - h : x + h + 1]
        if visible is not None:
            counts *= visible[n]
    level, moments, normal = np.zeros((count, 3)), np.zeros((count, 2, 6)), np.zeros((count, 6, 6))
    _cut(image, gradient_x, gradient_y, layout, packed, level, moments, normal)
    pixels, energy = (np.maximum(level[:, k], least)[:, None, None] for k, least in ((2, 1.0), (1, 1e-30)))
    ones, greys = moments[:, 0], moments[:, 1]
    normal -= ones[:, :, None] * ones[:, None, :] / pixels
    normal -= greys[:, :, None] * greys[:, None, :] / energy
    least = level[:, 2] * (_LEAST_SLOPE * level[:, 0]) ** 2
    is_flat = (normal[:, 0, 0] <= least) | (normal[:, 3, 3] <= least)
    rigid, affine = _inverted(normal, _RIGID_FROM_AFFINE), _inverted(normal, np.eye(6))
    rigid[is_flat] = affine[is_flat] = 0.0
    return Subsets(layout, np.ascontiguousarray(shape, np.int8), packed, level, moments, normal, rigid, affine)


def _inverted(normal: Floats, basis: Floats) -> Floats:
    """Invert within the allowed motions; zero where the subset does not determine them."""
    reduced = basis @ normal @ basis.T
    scale = np.sqrt(np.maximum(np.diagonal(reduced, axis1=1, axis2=2), 0.0))
    balance = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    balanced = reduced * balance[:, :, None] * balance[:, None, :]
    # With ones on the diagonal the smallest eigenvalue measures how independent the motions are.
    is_solvable = np.linalg.eigvalsh(balanced)[:, 0] > _LEAST_EIGENVALUE
    inverse = np.zeros_like(reduced)
    inverse[is_solvable] = np.linalg.inv(balanced[is_solvable])
    inverse *= balance[:, :, None] * balance[:, None, :]
    return np.ascontiguousarray(basis.T @ inverse @ basis)


@njit(cache=True, nogil=True, fastmath=FAST)
def _cut(
    image: Floats32,
    gradient_x: Floats32,
    gradient_y: Floats32,
    layout: Integers,
    packed: Floats32,
    level: Floats,
    moments: Floats,
    normal: Floats,
) -> None:
    """Pack the subsets, of which ``packed[3]`` says what counts, and sum what the normal equations need."""
    for n in range(len(layout)):
        x, y, h, place, pitch = layout[n]
        width = 2 * h + 1
        total = pixels = 0.0
        for i in range(width):
            for k in range(width):
                w = packed[3, place + i * pitch + k]
                total += w * image[y + i - h, x + k - h]
                pixels += w
        level[n, 0], level[n, 2] = total / max(pixels, 1.0), pixels
        # the six steepest-descent images, the grey levels about their mean, and the weights
        stack = np.empty((8, width, width), np.float32)
        for i in range(width):
            for k in range(width):
                at = place + i * pitch + k
                w = packed[3, at]
                packed[0, at] = w * (image[y + i - h, x + k - h] - level[n, 0])
                packed[1, at] = gx = w * gradient_x[y + i - h, x + k - h]
                packed[2, at] = gy = w * gradient_y[y + i - h, x + k - h]
                stack[0, i, k], stack[1, i, k], stack[2, i, k] = gx, gx * (k - h), gx * (i - h)
                stack[3, i, k], stack[4, i, k], stack[5, i, k] = gy, gy * (k - h), gy * (i - h)
                stack[6, i, k], stack[7, i, k] = packed[0, at], w
        flat = stack.reshape(8, width * width)
        products = np.dot(flat, flat.T)
        normal[n], level[n, 1] = products[:6, :6], products[6, 6]
        moments[n, 0], moments[n, 1] = products[7, :6], products[6, :6]

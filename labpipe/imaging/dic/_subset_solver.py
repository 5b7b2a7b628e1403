"""Match square subsets of a reference image in another one: inverse-compositional Gauss–Newton.

The criterion is the zero-normalised sum of squared differences, in its least-squares form: the
motion is found together with a gain and an offset of the grey levels. Gradients come from the
reference only, so noise of the deformed image does not bias the result, and the matrix of the
normal equations is inverted once per subset. Importing this module imports numba.

A motion is six numbers ``(u, u_x, u_y, v, v_x, v_y)``: the pixel at (j, i) from the subset's
centre moves to ``(j + u + u_x j + u_y i, i + v + v_x j + v_y i)``. A rigid motion is the same with
the matrix of a rotation.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import compiled
from labpipe.imaging.dic._spline import LANES, PADDING
from labpipe.imaging.dic._subset_kernel import FAST, LEFT_WINDOW, NO_TEXTURE, NOT_CONVERGED, SOLVED, solve_subsets

__all__ = ["LEFT_WINDOW", "NOT_CONVERGED", "NO_TEXTURE", "SOLVED", "Solution", "Subsets", "cut_subsets", "solve"]


#: Error that may be left by stopping (px): a tenth of the least noise of a large subset.
DEFAULT_TOLERANCE = 5e-5
#: Two or three evaluations are usual; more than this means that the start was wrong.
DEFAULT_ITERATIONS = 30
#: A subset may hang over the border of the frame by less than this (px): the noise of a point
#: that rests at the border. The spline is mirrored there.
OVERHANG = 0.5

# Below this the motion is not determined in every direction (a single edge, a flat subset).
_LEAST_EIGENVALUE = 1e-4
# Slopes below this share of the grey level per px are rounding errors of float32.
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
    is_rigid : bool array (point,)
        Translation and rotation, or the full affine motion.
    packed : float32 array (3, ...)
        Grey levels less their mean, slope in x, slope in y; rows filled up with zeros.
    level : array (point, 2)
        Mean grey level and sum of squares about it.
    moments : array (point, 2, 6)
        Sums of the six steepest-descent images, alone and times the grey level.
    normal : array (point, 6, 6)
        Normal matrix of the motion, gain and offset eliminated.
    inverse : array (point, 6, 6)
        Its inverse within the allowed motions; zero where there is no texture.
    """

    layout: Integers
    is_rigid: NDArray[np.bool_]
    packed: Floats32
    level: Floats
    moments: Floats
    normal: Floats
    inverse: Floats

    def __len__(self) -> int:
        """Return the number of subsets."""
        return len(self.layout)

    @property
    def x(self) -> Integers:
        """Column of each centre (px)."""
        return self.layout[:, 0]

    @property
    def y(self) -> Integers:
        """Row of each centre (px)."""
        return self.layout[:, 1]

    @property
    def half(self) -> Integers:
        """Half width of each subset (px)."""
        return self.layout[:, 2]


@dataclass(frozen=True)
class Solution:
    """What the solver found for each subset, in the order asked for.

    Attributes
    ----------
    motion : array (point, 6)
        ``(u, u_x, u_y, v, v_x, v_y)``, px and px per px.
    zncc : array (point,) [1]
        Zero-normalised cross-correlation at the solution.
    gain : array (point,) [1]
        Factor from the frame's grey levels to those of the reference.
    residual : array (point,)
        Sum of squared differences in grey levels of the reference, gain and offset fitted.
    iterations : array (point,)
        Evaluations of the subset in the frame.
    code : array (point,)
        ``SOLVED``, ``LEFT_WINDOW``, ``NOT_CONVERGED`` or ``NO_TEXTURE``.
    """

    motion: Floats
    zncc: Floats
    gain: Floats
    residual: Floats
    iterations: Integers
    code: Integers


def cut_subsets(
    image: Floats32,
    gradient_x: Floats32,
    gradient_y: Floats32,
    centres: Integers,
    half: Integers,
    is_rigid: NDArray[np.bool_],
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
    is_rigid : bool array (point,)
        Motion allowed for each subset.

    Returns
    -------
    Subsets
        A subset whose normal matrix is singular has ``inverse`` zero and is answered with
        ``NO_TEXTURE``.
    """
    count = len(half)
    width = 2 * half + 1
    stride = -(-width // LANES) * LANES
    start = np.concatenate([[0], np.cumsum(width * stride)])
    layout = np.column_stack([centres, half, start[:-1], stride]).astype(np.int64)
    packed = np.zeros((3, int(start[-1])), np.float32)
    level, moments = np.zeros((count, 2)), np.zeros((count, 2, 6))
    normal = np.zeros((count, 6, 6))
    _cut(image, gradient_x, gradient_y, layout, packed, level, moments, normal)
    energy = np.where(level[:, 1] > 0, level[:, 1], 1.0)[:, None, None]
    ones, greys = moments[:, 0], moments[:, 1]
    normal -= ones[:, :, None] * ones[:, None, :] / (width**2)[:, None, None]
    normal -= greys[:, :, None] * greys[:, None, :] / energy
    inverse = invert_within(normal, is_rigid)
    least = width**2 * (_LEAST_SLOPE * level[:, 0]) ** 2
    is_flat = (normal[:, 0, 0] <= least) | (normal[:, 3, 3] <= least)
    inverse[is_flat] = 0.0
    return Subsets(layout, is_rigid, packed, level, moments, normal, inverse)


def invert_within(normal: Floats, is_rigid: NDArray[np.bool_]) -> Floats:
    """Invert normal matrices within the motions that each subset is allowed.

    Parameters
    ----------
    normal : array (point, 6, 6)
        Normal matrices of the affine motion.
    is_rigid : bool array (point,)
        Which subsets shift and turn only.

    Returns
    -------
    array (point, 6, 6)
        Zero where the subset does not determine its motion.
    """
    inverse = np.zeros_like(normal)
    for group, basis in ((is_rigid, _RIGID_FROM_AFFINE), (~is_rigid, np.eye(6))):
        if group.any():
            inverse[group] = _invert(normal[group], basis)
    return inverse


def _invert(normal: Floats, basis: Floats) -> Floats:
    """Invert within the motions of a basis."""
    reduced = basis @ normal @ basis.T
    scale = np.sqrt(np.maximum(np.diagonal(reduced, axis1=1, axis2=2), 0.0))
    balance = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0)
    balanced = reduced * balance[:, :, None] * balance[:, None, :]
    # With ones on the diagonal the smallest eigenvalue measures how independent the motions are.
    is_solvable = np.linalg.eigvalsh(balanced)[:, 0] > _LEAST_EIGENVALUE
    inverse = np.zeros_like(reduced)
    inverse[is_solvable] = np.linalg.inv(balanced[is_solvable])
    inverse *= balance[:, :, None] * balance[:, None, :]
    return basis.T @ inverse @ basis


@compiled(nogil=True, fastmath=FAST)
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
    """Pack the subsets; sums of squares by rows, so that the inner loops stay one-dimensional."""
    for n in range(len(layout)):
        x, y, h, place, pitch = layout[n]
        width = 2 * h + 1
        total = 0.0
        for i in range(-h, h + 1):
            row = image[y + i, x - h : x + h + 1]
            for k in range(np.uint64(width)):
                total += row[k]
        level[n, 0] = total / (width * width)
        mean = np.float32(level[n, 0])
        for i in range(-h, h + 1):
            row = image[y + i, x - h : x + h + 1]
            slope_x = gradient_x[y + i, x - h : x + h + 1]
            slope_y = gradient_y[y + i, x - h : x + h + 1]
            f = packed[0, place : place + width]
            gx = packed[1, place : place + width]
            gy = packed[2, place : place + width]
            xx0 = xx1 = xx2 = xy0 = xy1 = xy2 = yy0 = yy1 = yy2 = np.float32(0)
            x0 = x1 = y0 = y1 = fx0 = fx1 = fy0 = fy1 = ff = np.float32(0)
            for k in range(np.uint64(width)):
                j = np.float32(np.int32(k)) - np.float32(h)
                a, b, c = slope_x[k], slope_y[k], row[k] - mean
                f[k], gx[k], gy[k] = c, a, b
                ff += c * c
                x0 += a
                x1 += a * j
                y0 += b
                y1 += b * j
                fx0 += c * a
                fx1 += c * a * j
                fy0 += c * b
                fy1 += c * b * j
                xx0 += a * a
                xx1 += a * a * j
                xx2 += a * a * j * j
                xy0 += a * b
                xy1 += a * b * j
                xy2 += a * b * j * j
                yy0 += b * b
                yy1 += b * b * j
                yy2 += b * b * j * j
            level[n, 1] += ff
            first = (x0, x1, y0, y1, fx0, fx1, fy0, fy1)
            second = (xx0, xx1, xx2, xy0, xy1, xy2, yy0, yy1, yy2)
            _scatter(first, second, float(i), moments[n], normal[n])
            place += pitch


@compiled(nogil=True)
def _scatter(
    first: tuple[np.float32, ...], second: tuple[np.float32, ...], i: float, moments: Floats, normal: Floats
) -> None:
    """Add a row's sums, taken with 1, j, j², to those of the six steepest-descent images.

    These are the two gradients times (1, j, i); ``i`` is constant along the row.
    """
    in_j = (0, 1, 0)
    in_i = (1.0, 1.0, i)
    for a in range(3):
        for gradient in range(2):
            moments[0, 3 * gradient + a] += in_i[a] * first[2 * gradient + in_j[a]]
            moments[1, 3 * gradient + a] += in_i[a] * first[4 + 2 * gradient + in_j[a]]
        for b in range(3):
            power = in_j[a] + in_j[b]
            factor = in_i[a] * in_i[b]
            normal[a, b] += factor * second[power]
            normal[a, 3 + b] += factor * second[3 + power]
            normal[3 + b, a] += factor * second[3 + power]
            normal[3 + a, 3 + b] += factor * second[6 + power]


def solve(
    subsets: Subsets,
    coefficients: Floats32,
    order: int,
    chosen: Integers,
    motion: Floats,
    *,
    origin: tuple[int, int],
    window: tuple[float, float, float, float],
    tolerance: float = DEFAULT_TOLERANCE,
    max_iterations: int = DEFAULT_ITERATIONS,
) -> Solution:
    """Find the motions of chosen subsets in one frame.

    Parameters
    ----------
    subsets : Subsets
        The reference.
    coefficients : array from :func:`.prefilter`
        Spline coefficients of the frame or of a rectangle of it.
    order : 3 or 5
        Spline order of the coefficients.
    chosen : integer array (point,)
        Which subsets to match.
    motion : array (point, 6) [px]
        Start, usually the prediction from the frames before.
    origin : (x, y) [px]
        Frame position of the first pixel of the rectangle.
    window : (left, right, top, bottom) [px]
        Frame coordinates that a subset's corners must not leave; at most :data:`OVERHANG`
        outside the rectangle.
    tolerance : float [px]
        Iterate until the next step is expected to be smaller than this.
    max_iterations : int
        Evaluations allowed per subset.

    Returns
    -------
    Solution
        In the order of ``chosen``.

    References
    ----------
    Z. Jiang et al., Opt. Lasers Eng. 65 (2015) 93-102,
    https://doi.org/10.1016/j.optlaseng.2014.06.011
    """
    count = len(chosen)
    found = np.array(motion, np.float64, order="C").reshape(count, 6)
    quality = np.full((count, 3), np.nan)
    counts = np.zeros((count, 2), np.int64)
    if count:
        corner = (float(origin[0] - PADDING), float(origin[1] - PADDING))
        solve_subsets(
            coefficients,
            order,
            corner,
            window,
            np.ascontiguousarray(chosen, np.int64),
            subsets.layout,
            subsets.is_rigid,
            subsets.packed,
            subsets.level,
            subsets.moments,
            subsets.normal,
            subsets.inverse,
            tolerance,
            max_iterations,
            found,
            quality,
            counts,
            np.zeros((3, 9)),
            np.zeros(2 * LANES + 2 * int(subsets.half.max()) + 1, np.float32),
        )
    return Solution(found, quality[:, 2], quality[:, 0], quality[:, 1], counts[:, 0], counts[:, 1])

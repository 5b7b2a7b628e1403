"""Compiled loops of the subset solver: interpolation along rows, normal equations, Gauss–Newton iteration.

Importing this module imports numba.
"""

import math

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import njit
from labpipe.imaging.dic._spline import LANES

#: Result codes of the solver.
SOLVED, LEFT_WINDOW, NOT_CONVERGED, NO_TEXTURE = range(4)
#: Shapes: translation and rotation; the affine motion; the first, and the second where the residual shows a strain.
RIGID, AFFINE, AUTO = range(3)

# A first step has no history: a step of e px leaves an error below e²/2 (measured: 0.2 e²).
_FIRST_SHRINK = 0.5
# Longest stretch of a step: noise then holds three quarters of the squared slopes.
_MOST_RELAXATION = 4.0
# A start may be off by this much (px, root mean square over a subset): one step leaves less than half its square.
_OFF = 0.01
# Share of its uncertainty that may be left of a displacement: it adds less than 1 % of the variance.
_NEGLIGIBLE = 0.03
_Weights = tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]
_Buffers = tuple[Floats32, Floats32, Floats32, Integers, Floats32, Floats32, Floats32]
# Sums over a subset may be reordered and fused; NaN must still compare as NaN.
FAST = {"reassoc", "contract", "nsz", "arcp"}


@njit(cache=True, nogil=True, fastmath=FAST)
def _sample_row(
    coefficients: Floats32, order: int, x: float, y: float, step_x: float, step_y: float, width: int, result: Floats32
) -> None:
    """Interpolate a row of pixels whose positions advance by (1 + step_x, step_y).

    The row is cut where the whole part of the position, less the pixel's number, changes: within
    such a run all taps lie side by side in memory and the loop becomes vector instructions.
    """
    done = 0
    dx, dy = np.float32(step_x), np.float32(step_y)
    while done < width:
        px = x + (1.0 + step_x) * done
        py = y + step_y * done
        column = math.floor(px)
        row = math.floor(py)
        left_x = px - column
        left_y = py - row
        run = float(width - done)
        if step_x > 0.0:
            run = min(run, math.ceil((1.0 - left_x) / step_x))
        elif step_x < 0.0:
            run = min(run, math.floor(left_x / -step_x) + 1.0)
        if step_y > 0.0:
            run = min(run, math.ceil((1.0 - left_y) / step_y))
        elif step_y < 0.0:
            run = min(run, math.floor(left_y / -step_y) + 1.0)
        count = max(int(run), 1)
        lanes = np.uint64((count + LANES - 1) // LANES * LANES)
        fx = np.float32(left_x)
        fy = np.float32(left_y)
        out = result[done:]
        _sample_run(coefficients, order, row - 2, column - 2, fx, fy, dx, dy, lanes, out)
        done += count


@njit(cache=True, nogil=True, fastmath=FAST)
def _cubic_weights(t: np.float32) -> _Weights:
    """Cubic B-spline at t + 2, t + 1, t, 1 - t, 2 - t, 3 - t, of which the first and the last are 0."""
    zero = np.float32(0.0)
    one = np.float32(1.0)
    sixth = np.float32(1.0 / 6.0)
    s = one - t
    w0 = s * s * s * sixth
    w3 = t * t * t * sixth
    w1 = np.float32(2.0 / 3.0) + t * t * (np.float32(0.5) * t - one)
    return zero, w0, w1, one - w0 - w1 - w3, w3, zero


@njit(cache=True, nogil=True, fastmath=FAST)
def _quintic_weights(t: np.float32) -> _Weights:
    """Quintic B-spline at t + 2, t + 1, t, 1 - t, 2 - t, 3 - t."""
    one = np.float32(1.0)
    s = one - t
    t2 = t * t
    s2 = s * s
    w0 = s2 * s2 * s * np.float32(1.0 / 120.0)
    w5 = t2 * t2 * t * np.float32(1.0 / 120.0)
    middle = np.float32(66.0 / 120.0)
    half = np.float32(0.5)
    quarter = np.float32(0.25)
    twelfth = np.float32(1.0 / 12.0)
    w2 = middle + t2 * (t2 * (quarter - twelfth * t) - half)
    w3 = middle + s2 * (s2 * (quarter - twelfth * s) - half)
    # The second weight follows from the first moment, the fifth from the sum being 1:
    # the weights at -2..3 sum to 1 and their mean position is t.
    rest = one - w0 - w2 - w3 - w5
    moment = t + w0 * np.float32(2.0) - w3 - np.float32(3.0) * w5
    w4 = (moment + rest) * np.float32(1.0 / 3.0)
    return w0, rest - w4, w2, w3, w4, w5


@njit(cache=True, nogil=True, fastmath=FAST)
def _product(
    lines: tuple[Floats32, Floats32, Floats32, Floats32, Floats32, Floats32], k: np.uint64, a: _Weights, b: _Weights
) -> np.float32:
    """Sum of 36 coefficients from place ``k`` of six lines, weighted along (a) and across (b) the lines."""
    c0, c1, c2, c3, c4, c5 = lines
    i1, i2, i3, i4, i5 = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4), np.uint64(5)
    a0, a1, a2, a3, a4, a5 = a
    r0 = a0 * c0[k] + a1 * c0[k + i1] + a2 * c0[k + i2] + a3 * c0[k + i3] + a4 * c0[k + i4] + a5 * c0[k + i5]
    r1 = a0 * c1[k] + a1 * c1[k + i1] + a2 * c1[k + i2] + a3 * c1[k + i3] + a4 * c1[k + i4] + a5 * c1[k + i5]
    r2 = a0 * c2[k] + a1 * c2[k + i1] + a2 * c2[k + i2] + a3 * c2[k + i3] + a4 * c2[k + i4] + a5 * c2[k + i5]
    r3 = a0 * c3[k] + a1 * c3[k + i1] + a2 * c3[k + i2] + a3 * c3[k + i3] + a4 * c3[k + i4] + a5 * c3[k + i5]
    r4 = a0 * c4[k] + a1 * c4[k + i1] + a2 * c4[k + i2] + a3 * c4[k + i3] + a4 * c4[k + i4] + a5 * c4[k + i5]
    r5 = a0 * c5[k] + a1 * c5[k + i1] + a2 * c5[k + i2] + a3 * c5[k + i3] + a4 * c5[k + i4] + a5 * c5[k + i5]
    return b[0] * r0 + b[1] * r1 + b[2] * r2 + b[3] * r3 + b[4] * r4 + b[5] * r5


@njit(cache=True, nogil=True, fastmath=FAST)
def _sample_run(
    coefficients: Floats32,
    order: int,
    row: int,
    column: int,
    fx: np.float32,
    fy: np.float32,
    dx: np.float32,
    dy: np.float32,
    lanes: np.uint64,
    out: Floats32,
) -> None:
    """Evaluate the spline for a run of pixels whose coefficients begin at (row, column)."""
    c0 = coefficients[row, column:]
    c1 = coefficients[row + 1, column:]
    c2 = coefficients[row + 2, column:]
    c3 = coefficients[row + 3, column:]
    c4 = coefficients[row + 4, column:]
    c5 = coefficients[row + 5, column:]
    lines = (c0, c1, c2, c3, c4, c5)
    if order == 3:
        for k in range(lanes):
            step = np.float32(np.int32(k))
            out[k] = _product(lines, k, _cubic_weights(fx + dx * step), _cubic_weights(fy + dy * step))
    else:
        for k in range(lanes):
            step = np.float32(np.int32(k))
            out[k] = _product(lines, k, _quintic_weights(fx + dx * step), _quintic_weights(fy + dy * step))


@njit(cache=True, nogil=True, fastmath=FAST)
def _sample_shifted(
    coefficients: Floats32, order: int, x: float, y: float, pitch: int, across: Floats32, values: Floats32
) -> None:
    """Interpolate a subset that is only shifted, its first pixel to (x, y): along the rows, then down the columns."""
    column, row = math.floor(x), math.floor(y)
    fx, fy = np.float32(x - column), np.float32(y - row)
    a0, a1, a2, a3, a4, a5 = _cubic_weights(fx) if order == 3 else _quintic_weights(fx)
    b0, b1, b2, b3, b4, b5 = _cubic_weights(fy) if order == 3 else _quintic_weights(fy)
    i1, i2, i3, i4, i5 = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4), np.uint64(5)
    for line in range(len(across) // pitch):
        c = coefficients[row - 2 + line, column - 2 :]
        out = across[line * pitch :]
        for k in range(np.uint64(pitch)):
            out[k] = a0 * c[k] + a1 * c[k + i1] + a2 * c[k + i2] + a3 * c[k + i3] + a4 * c[k + i4] + a5 * c[k + i5]
    c0, c1, c2, c3 = across, across[pitch:], across[2 * pitch :], across[3 * pitch :]
    c4, c5 = across[4 * pitch :], across[5 * pitch :]
    for k in range(np.uint64(len(c5))):
        values[k] = b0 * c0[k] + b1 * c1[k] + b2 * c2[k] + b3 * c3[k] + b4 * c4[k] + b5 * c5[k]


@njit(cache=True, nogil=True)
def compose_with_inverse(p: Floats, step: Floats, is_rigid: bool) -> None:
    """Replace the motion ``p`` by ``p`` after the inverse of ``step``."""
    if is_rigid:
        # The inverse of (R, t) is (Rᵀ, -Rᵀ t); a rotation stays one exactly.
        a, b = math.cos(step[4]), math.sin(step[4])
        c, d = -b, a
        determinant = 1.0
        a11, a12, a21, a22 = a, c, b, d
    else:
        a11, a12, a21, a22 = 1.0 + step[1], step[2], step[4], 1.0 + step[5]
        determinant = a11 * a22 - a12 * a21
    i11, i12 = a22 / determinant, -a12 / determinant
    i21, i22 = -a21 / determinant, a11 / determinant
    tx = -(i11 * step[0] + i12 * step[3])
    ty = -(i21 * step[0] + i22 * step[3])
    m11, m12, m21, m22 = 1.0 + p[1], p[2], p[4], 1.0 + p[5]
    p[0] += m11 * tx + m12 * ty
    p[3] += m21 * tx + m22 * ty
    p[1] = m11 * i11 + m12 * i21 - 1.0
    p[2] = m11 * i12 + m12 * i22
    p[4] = m21 * i11 + m22 * i21
    p[5] = m21 * i12 + m22 * i22 - 1.0


@njit(cache=True, nogil=True)
def _is_inside(x: float, y: float, half: float, p: Floats, window: tuple[float, float, float, float]) -> bool:
    """Whether the four corners of the moved subset lie in the window."""
    across, down = half * (abs(1.0 + p[1]) + abs(p[2])), half * (abs(p[4]) + abs(1.0 + p[5]))
    # Written so that NaN is outside.
    is_between = window[0] <= x + p[0] - across and x + p[0] + across <= window[1]
    return is_between and window[2] <= y + p[3] - down and y + p[3] + down <= window[3]


@njit(cache=True, nogil=True, fastmath=FAST)
def _accumulate(
    values: Floats32, level: np.float32, packed: Floats32, place: np.uint64, offsets: Floats32, sums: Floats
) -> None:
    """Sum g, g², f g and the steepest-descent images times g, where g are the values less their level."""
    s0 = s1 = s2 = x0 = x1 = x2 = y0 = y1 = y2 = np.float32(0)
    for q in range(np.uint64(offsets.shape[1])):
        at = place + q
        g = (values[q] - level) * packed[3, at]
        ax = packed[1, at] * g
        ay = packed[2, at] * g
        s0 += g
        s1 += g * g
        s2 += packed[0, at] * g
        x0 += ax
        x1 += ax * offsets[0, q]
        x2 += ax * offsets[1, q]
        y0 += ay
        y1 += ay * offsets[0, q]
        y2 += ay * offsets[1, q]
    sums[0], sums[1], sums[2] = s0, s1, s2
    sums[3], sums[4], sums[5] = x0, x1, x2
    sums[6], sums[7], sums[8] = y0, y1, y2


@njit(cache=True, nogil=True)
def _sum_subset(
    coefficients: Floats32,
    order: int,
    corner: tuple[float, float],
    layout: Integers,
    packed: Floats32,
    level: float,
    p: Floats,
    buffers: _Buffers,
    sums: Floats,
) -> None:
    """Interpolate a whole subset of the frame and sum what the normal equations need."""
    half, pitch = layout[2], layout[4]
    offsets, values, others = buffers[:3]
    x, y = layout[0] - corner[0] - half + p[0], layout[1] - corner[1] - half + p[3]
    if p[1] == 0.0 and p[2] == 0.0 and p[4] == 0.0 and p[5] == 0.0:
        rows = others[0, : (2 * half + 6) * pitch]
        _sample_shifted(coefficients, order, x, y, pitch, rows, values)
    else:
        for row in range(2 * half + 1):
            i = float(row - half)
            left, top = x - p[1] * half + p[2] * i, y + row - p[4] * half + p[5] * i
            _sample_row(coefficients, order, left, top, p[1], p[4], 2 * half + 1, values[row * pitch :])
    _accumulate(values, np.float32(level), packed, np.uint64(layout[3]), offsets, sums)


@njit(cache=True, nogil=True)
def _gauss_newton_step(
    sums: Floats, level: Floats, moments: Floats, inverse: Floats, step: Floats, quality: Floats
) -> float:
    """Step, gain, residual and correlation from the sums; fall of the residual, -1 when nothing is alike.

    The sums become the slopes of the criterion. By how much the last step lowers the residual is known without another.
    """
    energy, pixels = level[1], level[2]
    average = sums[0] / pixels
    contrast = sums[1] - average * sums[0]
    # Written so that NaN fails.
    if not (sums[2] > 0.0 and contrast > 0.0):
        return -1.0
    gain = energy / sums[2]
    for a in range(6):
        sums[3 + a] = gain * (sums[3 + a] - average * moments[0, a]) - moments[1, a]
    fall = 0.0
    for a in range(6):
        moved = 0.0
        for b in range(6):
            moved += inverse[a, b] * sums[3 + b]
        step[a] = moved
        fall += moved * sums[3 + a]
    residual = max(gain * gain * contrast - energy - fall, 0.0)
    quality[0] = gain
    quality[1] = residual
    quality[2] = math.sqrt(energy / (energy + residual))
    return fall


@njit(cache=True, nogil=True, fastmath=FAST)
def _leave_residuals(
    values: Floats32,
    packed: Floats32,
    place: np.uint64,
    offsets: Floats32,
    gain: np.float32,
    average: np.float32,
    moved: Floats32,
) -> None:
    """Turn values into residuals after the last step (``moved``), which is not evaluated again."""
    a, b, c, d, e, f = moved
    for q in range(np.uint64(offsets.shape[1])):
        at, j, i = place + q, offsets[0, q], offsets[1, q]
        step = packed[1, at] * (a + b * j + c * i) + packed[2, at] * (d + e * j + f * i)
        values[q] = (gain * (values[q] - average) - packed[0, at] - step) * packed[3, at]


@njit(cache=True, nogil=True, fastmath=FAST)
def _influences(
    values: Floats32, packed: Floats32, place: np.uint64, offsets: Floats32, factors: Floats32, out: Floats32
) -> None:
    """Influence of every residual on one component of the motion; see :func:`_sandwich` for the factors."""
    a, b, c, d, e, f, g, h = factors
    for q in range(np.uint64(offsets.shape[1])):
        at, j, i = place + q, offsets[0, q], offsets[1, q]
        weight = packed[1, at] * (a + b * j + c * i) + packed[2, at] * (d + e * j + f * i)
        out[q] = values[q] * (weight + g * packed[0, at] + h)


@njit(cache=True, nogil=True, fastmath=FAST)
def _sum_lines(values: Floats32, first: int, end: int, columns: Floats32) -> None:
    """Sum lines of a subset column by column."""
    columns[:] = 0.0
    for line in range(first, end):
        own = values[line * len(columns) :]
        for k in range(np.uint64(len(columns))):
            columns[k] += own[k]


@njit(cache=True, nogil=True, fastmath=FAST)
def _sum_blocks(values: Floats32, edges: Integers, columns: Floats32, blocks: Floats32) -> None:
    """Sum values (4, pixel) of a subset over its square blocks, of which ``edges`` are the first lines and columns."""
    count = len(edges) - 1
    for b in range(count):
        for m in range(4):
            _sum_lines(values[m], edges[b], edges[b + 1], columns[m])
        for c in range(count):
            s0 = s1 = s2 = s3 = np.float32(0.0)
            for k in range(edges[c], edges[c + 1]):
                s0, s1, s2, s3 = s0 + columns[0, k], s1 + columns[1, k], s2 + columns[2, k], s3 + columns[3, k]
            at = b * count + c
            blocks[0, at], blocks[1, at], blocks[2, at], blocks[3, at] = s0, s1, s2, s3


@njit(cache=True, nogil=True)
def _add_strips(influences: Floats32, half: int, pitch: int, inverse: Floats, covariance: Floats) -> None:
    """Widen the covariance across long edges, along which the residual is alike from end to end.

    Influences on dx and dy are summed over strips along the edges, one pixel wide; where the motion is at least three
    times as well determined across as along.
    """
    xx, yy, xy = inverse[0, 0], inverse[3, 3], inverse[0, 3]
    middle, apart = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    if middle + apart < 3.0 * (middle - apart):
        return
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    across_x, across_y = math.cos(angle), math.sin(angle)
    strips = np.zeros(4 * half + 4)
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            at = (i + half) * pitch + j + half
            influence = across_x * influences[0, at] + across_y * influences[1, at]
            strips[int(across_x * j + across_y * i + 2 * half + 1.5)] += influence
    squares = strips * strips
    fourth = np.sum(squares * squares)
    # few strips hold an edge: quantiles of Student's t for their number grow so with it
    of_strips = np.sum(squares) + 4.0 / 3.0 * fourth / max(np.sum(squares), 1e-300)
    shown = across_x**2 * covariance[0] + across_y**2 * covariance[1] + 2.0 * across_x * across_y * covariance[2]
    more = max(of_strips - shown, 0.0)
    covariance[0] += more * across_x**2
    covariance[1] += more * across_y**2
    covariance[2] += more * across_x * across_y


@njit(cache=True, nogil=True)
def _sandwich(
    layout: Integers,
    packed: Floats32,
    level: Floats,
    moments: Floats,
    inverse: Floats,
    average: float,
    gain: float,
    step: Floats,
    buffers: _Buffers,
    covariance: Floats,
) -> float:
    """Covariance of (dx, dy, rotation) from the residual itself; share of the blocks that show nothing of the pattern.

    Influence times residual is summed over square blocks, within which the residual may be correlated as it likes;
    the squares of these sums are the covariance. A block shows nothing of the pattern where its residual exceeds
    both the mean square of the pattern and, five times, the median residual of all blocks.
    """
    half, place, pitch = layout[2], np.uint64(layout[3]), layout[4]
    offsets, values, others, edges, columns, blocks, rows = buffers
    # factors of gx, gx j, gx i, gy, gy j, gy i, f, 1 in the influence on dx, dy and rotation
    rows[:] = 0.0
    for a in range(6):
        rows[0, a], rows[1, a], rows[2, a] = inverse[0, a], inverse[3, a], 0.5 * (inverse[4, a] - inverse[2, a])
        along_f, along_1 = moments[1, a] / level[1], moments[0, a] / level[2]
        for m in range(3):
            rows[m, 6] -= rows[m, a] * along_f
            rows[m, 7] -= rows[m, a] * along_1
    moved = step.astype(np.float32)
    _leave_residuals(values, packed, place, offsets, np.float32(gain), np.float32(average), moved)
    for m in range(3):
        _influences(values, packed, place, offsets, rows[m], others[m])
    for q in range(np.uint64(offsets.shape[1])):
        others[3, q] = values[q] * values[q]
    _sum_blocks(others, edges, columns, blocks)
    count = blocks.shape[1]
    xx = yy = xy = turned = 0.0
    for b in range(count):
        x, y, turn = blocks[0, b], blocks[1, b], blocks[2, b]
        xx, yy, xy, turned = xx + x * x, yy + y * y, xy + x * y, turned + turn * turn
    covariance[0], covariance[1], covariance[2], covariance[3] = xx, yy, xy, turned
    _add_strips(others, half, pitch, inverse, covariance)
    pattern = level[1] / count
    if not np.max(blocks[3]) > pattern:
        return 0.0
    nothing = max(pattern, 5.0 * np.median(blocks[3]))
    return np.sum(blocks[3] > nothing) / count


@njit(cache=True, nogil=True)
def _converge(
    image: tuple[Floats32, int, tuple[float, float], tuple[float, float, float, float]],
    layout: Integers,
    is_rigid: bool,
    packed: Floats32,
    level: Floats,
    moments: Floats,
    inverse: Floats,
    tolerance: float,
    capture: float,
    max_iterations: int,
    p: Floats,
    quality: Floats,
    work: tuple[Floats, Floats, Floats],
    buffers: _Buffers,
) -> tuple[int, int, float]:
    """Iterate one subset; evaluations, result code and the last fall of the residual."""
    coefficients, order, corner, window = image
    sums, step, before = work
    half = layout[2]
    start_x, start_y = p[0], p[3]
    last2 = 0.0
    relaxation = 1.0
    before[:] = 0.0
    for iteration in range(max_iterations):
        if not _is_inside(layout[0], layout[1], half, p, window):
            return iteration, LEFT_WINDOW, 0.0
        _sum_subset(coefficients, order, corner, layout, packed, level[0], p, buffers, sums)
        fall = _gauss_newton_step(sums, level, moments, inverse, step, quality)
        if fall < 0.0:
            return iteration + 1, NOT_CONVERGED, 0.0
        size2 = 0.0
        along = 0.0
        for a in range(6):
            weight = half * half / 3.0 if a % 3 else 1.0
            size2 += weight * step[a] * step[a]
            along += weight * step[a] * before[a]
            before[a] = step[a]
        shrink = math.sqrt(size2) * _FIRST_SHRINK
        if last2 > 0.0:
            # Noise in the slopes makes the steps too short by a constant factor, which shows in
            # two steps along the same line.
            relaxation /= 1.0 - min(along / last2, 0.75)
            relaxation = min(max(relaxation, 1.0), _MOST_RELAXATION)
            shrink = math.sqrt(size2 / last2)
        last2 = size2
        for a in range(6):
            step[a] *= relaxation
        compose_with_inverse(p, step, is_rigid)
        # Written so that NaN is beyond.
        if not math.hypot(p[0] - start_x, p[3] - start_y) < capture:
            return iteration + 1, NOT_CONVERGED, 0.0
        # Steps shrink by about a constant factor, so the sum of the next ones can be foreseen.
        noise2 = quality[1] / level[2] * (inverse[0, 0] + inverse[3, 3])
        left = math.sqrt(size2) * shrink / (1.0 - shrink) if shrink < 1.0 else math.inf
        if left < max(tolerance, _NEGLIGIBLE * math.sqrt(noise2)):
            return iteration + 1, SOLVED, fall
    return max_iterations, NOT_CONVERGED, 0.0


@njit(cache=True, nogil=True)
def _buffers(half: int, pitch: int) -> _Buffers:
    """Memory for one subset at a time.

    Offsets from its centre (j and i, pixel), values (pixel) and what is made of them (4, pixel), edges of the blocks,
    sums over their lines (4, column) and over them (4, block), factors of the influences (3, 8).
    """
    width = 2 * half + 1
    offsets = np.empty((2, width * pitch), np.float32)
    for q in range(width * pitch):
        offsets[0, q], offsets[1, q] = q % pitch - half, q // pitch - half
    size = (width + 5) * pitch + LANES
    count = min(8, max(3, width // 4))
    edges = np.empty(count + 1, np.int64)
    for c in range(count + 1):
        edges[c] = -(-c * width // count)
    columns, blocks = np.zeros((4, pitch), np.float32), np.zeros((4, count * count), np.float32)
    values, others = np.zeros(size, np.float32), np.zeros((4, size), np.float32)
    return offsets, values, others, edges, columns, blocks, np.zeros((3, 8), np.float32)


@njit(cache=True, nogil=True)
def solve_subsets(
    image: tuple[Floats32, int, tuple[float, float], tuple[float, float, float, float]],
    subsets: tuple[Integers, NDArray[np.int8], Floats32, Floats, Floats, Floats, Floats, Floats],
    chosen: Integers,
    inflation: Floats,
    strain_seen: float,
    tolerance: float,
    capture: float,
    max_iterations: int,
    motion: Floats,
    quality: Floats,
    covariance: Floats,
    counts: Integers,
) -> None:
    """Iterate every chosen subset to convergence; ``motion`` holds the start and the result.

    ``quality`` (gain, residual, correlation, share of hidden blocks); ``covariance`` (dx dx, dy dy, dx dy, rotation²)
    of :func:`_sandwich`; ``counts`` (evaluations, result code, solved as affine); ``inflation`` and ``strain_seen``:
    see :func:`.solve`.
    """
    layout, shape, packed, level, moments, _, rigid, affine = subsets
    sums, step, before = np.zeros(9), np.zeros(6), np.zeros(6)
    half = -1
    for q in range(len(chosen)):
        n = chosen[q]
        p = motion[q]
        is_rigid = shape[n] != AFFINE
        bread = rigid[n] if is_rigid else affine[n]
        if bread[0, 0] <= 0.0:
            counts[q, 1] = NO_TEXTURE
            continue
        if layout[n, 2] != half:
            half = layout[n, 2]
            buffers = _buffers(half, layout[n, 4])
        if is_rigid:
            turn = math.atan2(p[4] - p[2], 2.0 + p[1] + p[5])
            if turn * turn * half * half < 1.5 * _OFF * _OFF:
                turn = 0.0
            p[1] = p[5] = math.cos(turn) - 1.0
            p[4] = math.sin(turn)
            p[2] = -p[4]
        evaluations, code, fall = _converge(
            image, layout[n], is_rigid, packed, level[n], moments[n], bread, tolerance, capture, max_iterations,
            p, quality[q], (sums, step, before), buffers,
        )  # fmt: skip
        if code == SOLVED and shape[n] == AUTO and affine[n, 0, 0] > 0.0:
            gained = -fall
            for a in range(6):
                for b in range(6):
                    gained += sums[3 + a] * affine[n, a, b] * sums[3 + b]
            if gained > strain_seen * inflation[n] * quality[q, 1] / max(level[n, 2] - 5.0, 1.0):
                bread, is_rigid = affine[n], False
                more, code, fall = _converge(
                    image, layout[n], is_rigid, packed, level[n], moments[n], bread, tolerance, capture,
                    max_iterations, p, quality[q], (sums, step, before), buffers,
                )  # fmt: skip
                evaluations += more
        counts[q, 0], counts[q, 1], counts[q, 2] = evaluations, code, not is_rigid
        if code == SOLVED:
            average = level[n, 0] + sums[0] / level[n, 2]
            quality[q, 3] = _sandwich(
                layout[n], packed, level[n], moments[n], bread, average, quality[q, 0], before, buffers, covariance[q]
            )  # fmt: skip

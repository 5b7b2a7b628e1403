"""The compiled loops that interpolate a row of a moved subset by a B-spline; importing this module imports numba."""

import math

import numpy as np

from labpipe.arrays import Floats32
from labpipe.compilation import compiled, part
from labpipe.imaging.dic._spline import LANES

# Sums over a subset may be reordered and fused; NaN must still compare as NaN.
FAST = {"reassoc", "contract", "nsz", "arcp"}


@part(fastmath=FAST)
def sample_row(
    coefficients: Floats32, order: int, x: float, y: float, step_x: float, step_y: float, width: int, result: Floats32
) -> None:
    """Interpolate a row of pixels whose positions advance by (1 + step_x, step_y).

    The row is cut where the whole part of the position, less the pixel's number, changes: within
    such a run all taps lie side by side in memory and the loop becomes vector instructions.
    """
    done = 0
    dx = np.float32(step_x)
    dy = np.float32(step_y)
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
        if order == 3:
            _sample_cubic(coefficients, row - 1, column - 1, fx, fy, dx, dy, lanes, out)
        else:
            _sample_quintic(coefficients, row - 2, column - 2, fx, fy, dx, dy, lanes, out)
        done += count


@part(fastmath=FAST)
def _cubic_weights(t: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Cubic B-spline at t + 1, t, 1 - t, 2 - t."""
    one = np.float32(1.0)
    sixth = np.float32(1.0 / 6.0)
    s = one - t
    w0 = s * s * s * sixth
    w3 = t * t * t * sixth
    w1 = np.float32(2.0 / 3.0) + t * t * (np.float32(0.5) * t - one)
    return w0, w1, one - w0 - w1 - w3, w3


@compiled(nogil=True, fastmath=FAST)
def _sample_cubic(
    coefficients: Floats32,
    row: int,
    column: int,
    fx: np.float32,
    fy: np.float32,
    dx: np.float32,
    dy: np.float32,
    lanes: np.uint64,
    out: Floats32,
) -> None:
    """Evaluate the cubic spline for a run of pixels."""
    c0 = coefficients[row, column:]
    c1 = coefficients[row + 1, column:]
    c2 = coefficients[row + 2, column:]
    c3 = coefficients[row + 3, column:]
    i1, i2, i3 = np.uint64(1), np.uint64(2), np.uint64(3)
    for k in range(lanes):
        step = np.float32(np.int32(k))
        a0, a1, a2, a3 = _cubic_weights(fx + dx * step)
        b0, b1, b2, b3 = _cubic_weights(fy + dy * step)
        r0 = a0 * c0[k] + a1 * c0[k + i1] + a2 * c0[k + i2] + a3 * c0[k + i3]
        r1 = a0 * c1[k] + a1 * c1[k + i1] + a2 * c1[k + i2] + a3 * c1[k + i3]
        r2 = a0 * c2[k] + a1 * c2[k + i1] + a2 * c2[k + i2] + a3 * c2[k + i3]
        r3 = a0 * c3[k] + a1 * c3[k + i1] + a2 * c3[k + i2] + a3 * c3[k + i3]
        out[k] = b0 * r0 + b1 * r1 + b2 * r2 + b3 * r3


@part(fastmath=FAST)
def _quintic_weights(t: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]:
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


@compiled(nogil=True, fastmath=FAST)
def _sample_quintic(
    coefficients: Floats32,
    row: int,
    column: int,
    fx: np.float32,
    fy: np.float32,
    dx: np.float32,
    dy: np.float32,
    lanes: np.uint64,
    out: Floats32,
) -> None:
    """Evaluate the quintic spline for a run of pixels."""
    c0 = coefficients[row, column:]
    c1 = coefficients[row + 1, column:]
    c2 = coefficients[row + 2, column:]
    c3 = coefficients[row + 3, column:]
    c4 = coefficients[row + 4, column:]
    c5 = coefficients[row + 5, column:]
    i1, i2, i3 = np.uint64(1), np.uint64(2), np.uint64(3)
    i4, i5 = np.uint64(4), np.uint64(5)
    for k in range(lanes):
        step = np.float32(np.int32(k))
        a0, a1, a2, a3, a4, a5 = _quintic_weights(fx + dx * step)
        b0, b1, b2, b3, b4, b5 = _quintic_weights(fy + dy * step)
        r0 = a0 * c0[k] + a1 * c0[k + i1] + a2 * c0[k + i2]
        r0 += a3 * c0[k + i3] + a4 * c0[k + i4] + a5 * c0[k + i5]
        r1 = a0 * c1[k] + a1 * c1[k + i1] + a2 * c1[k + i2]
        r1 += a3 * c1[k + i3] + a4 * c1[k + i4] + a5 * c1[k + i5]
        r2 = a0 * c2[k] + a1 * c2[k + i1] + a2 * c2[k + i2]
        r2 += a3 * c2[k + i3] + a4 * c2[k + i4] + a5 * c2[k + i5]
        r3 = a0 * c3[k] + a1 * c3[k + i1] + a2 * c3[k + i2]
        r3 += a3 * c3[k + i3] + a4 * c3[k + i4] + a5 * c3[k + i5]
        r4 = a0 * c4[k] + a1 * c4[k + i1] + a2 * c4[k + i2]
        r4 += a3 * c4[k + i3] + a4 * c4[k + i4] + a5 * c4[k + i5]
        r5 = a0 * c5[k] + a1 * c5[k + i1] + a2 * c5[k + i2]
        r5 += a3 * c5[k + i3] + a4 * c5[k + i4] + a5 * c5[k + i5]
        out[k] = b0 * r0 + b1 * r1 + b2 * r2 + b3 * r3 + b4 * r4 + b5 * r5

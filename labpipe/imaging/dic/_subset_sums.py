"""The compiled loops that sum what the normal equations of a subset need; importing this module imports numba."""

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import part
from labpipe.imaging.dic._row_sampling import FAST, sample_row


@part(fastmath=FAST)
def _accumulate(
    values: Floats32,
    level: np.float32,
    grey: Floats32,
    gradient_x: Floats32,
    gradient_y: Floats32,
    half: float,
    width: int,
    offset: float,
    sums: Floats,
) -> None:
    """Add a row to the sums of g, g², f g and of the motions' columns times g."""
    s0 = s1 = s2 = x0 = x1 = y0 = y1 = np.float32(0)
    centre = np.float32(half)
    for k in range(np.uint64(width)):
        g = values[k] - level
        j = np.float32(np.int32(k)) - centre
        ax = gradient_x[k] * g
        ay = gradient_y[k] * g
        s0 += g
        s1 += g * g
        s2 += grey[k] * g
        x0 += ax
        x1 += ax * j
        y0 += ay
        y1 += ay * j
    sums[0] += s0
    sums[1] += s1
    sums[2] += s2
    sums[3] += x0
    sums[4] += x1
    sums[5] += offset * x0
    sums[6] += y0
    sums[7] += y1
    sums[8] += offset * y0


@part(fastmath=FAST)
def _accumulate_more(
    values: Floats32,
    level: np.float32,
    grey: Floats32,
    bend: Floats32,
    along: Floats32,
    mixed: Floats32,
    half: float,
    width: int,
    offset: float,
    sums: Floats,
) -> None:
    """Add a row to the sums of the columns of light and blur times g."""
    s0 = s2 = j1 = f1 = b0 = b1 = b2 = np.float32(0)
    centre = np.float32(half)
    for k in range(np.uint64(width)):
        g = values[k] - level
        j = np.float32(np.int32(k)) - centre
        fg = grey[k] * g
        s0 += g
        s2 += fg
        j1 += g * j
        f1 += fg * j
        b0 += bend[k] * g
        b1 += along[k] * g
        b2 += mixed[k] * g
    sums[9] += j1
    sums[10] += offset * s0
    sums[11] += f1
    sums[12] += offset * s2
    sums[13] += b0
    sums[14] += b1
    sums[15] += b2


@part(fastmath=FAST)
def _accumulate_curved(
    values: Floats32, level: np.float32, grey: Floats32, half: float, width: int, offset: float, sums: Floats
) -> None:
    """Add a row to the sums of the columns of light that curves times g."""
    s0 = s1 = s2 = np.float32(0)
    centre = np.float32(half)
    mean = half * (half + 1.0) / 3.0
    for k in range(np.uint64(width)):
        j = np.float32(np.int32(k)) - centre
        g = (grey[k] + level) * (values[k] - level)
        s0 += g
        s1 += g * j
        s2 += g * (j * j - np.float32(mean))
    sums[16] += s2
    sums[17] += offset * s1
    sums[18] += (offset * offset - mean) * s0


@part(fastmath=FAST)
def _cover(values: Floats32, level: np.float32, weight: Floats32, width: int) -> None:
    """Put the mean level where a mask covers the subset: it counts nowhere."""
    for k in range(np.uint64(width)):
        values[k] = level + weight[k] * (values[k] - level)


@part()
def sum_subset(
    coefficients: Floats32,
    order: int,
    corner: tuple[float, float],
    layout: Integers,
    packed: Floats32,
    level: float,
    p: Floats,
    with_all: bool,
    with_curve: bool,
    values: Floats32,
    sums: Floats,
) -> None:
    """Interpolate a whole subset of the frame and sum what the normal equations need."""
    half, place, pitch = layout[2], layout[3], layout[4]
    width = 2 * half + 1
    for k in range(len(sums)):
        sums[k] = 0.0
    for row in range(width):
        i = float(row - half)
        x = layout[0] - corner[0] - half + p[0] - p[1] * half + p[2] * i
        y = layout[1] - corner[1] + i + p[3] - p[4] * half + p[5] * i
        sample_row(coefficients, order, x, y, p[1], p[4], width, values)
        if layout[5]:
            _cover(values, np.float32(level), packed[6, place : place + pitch], width)
        _accumulate(
            values,
            np.float32(level),
            packed[0, place : place + pitch],
            packed[1, place : place + pitch],
            packed[2, place : place + pitch],
            float(half),
            width,
            i,
            sums,
        )
        if with_all:
            _accumulate_more(
                values,
                np.float32(level),
                packed[0, place : place + pitch],
                packed[3, place : place + pitch],
                packed[4, place : place + pitch],
                packed[5, place : place + pitch],
                float(half),
                width,
                i,
                sums,
            )
        if with_curve:
            grey = packed[0, place : place + pitch]
            _accumulate_curved(values, np.float32(level), grey, float(half), width, i, sums)
        place += pitch

"""How far a misfit that pixels share moves the answer, from what each part of a subset asks for by itself.

Noise of a pixel moves the motion by what the pixel weighs, and what is left of all of them says by how much. A
misfit of interpolation, of the shape of a blur, or of edges lies where the slopes are, and pixels next to each
other share it. At the answer, what all parts of a subset ask for is nothing; by how much each differs from that
tells the variance, whatever neighbouring pixels share: a covariance that clusters make robust. Importing this
module imports numba.
"""

import math

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import compiled, part
from labpipe.imaging.dic._film_window import Loaded
from labpipe.imaging.dic._row_sampling import sample_row
from labpipe.imaging.dic._spline import LANES, PADDING
from labpipe.imaging.dic._subset_kernel import BLUR, COLUMNS, CURVE, CURVED, LIGHT, MOTIONS, is_inside, own_contrast
from labpipe.imaging.dic._subsets import Subsets, solved_columns

#: Width (px) of a part, about and at least: a misfit at an edge of any angle is one of so many pixels at most.
_PART, _LEAST_PART = 6.0, 4
#: Parts that a subset has along a side, at least and at most.
_LEAST_PARTS, _MOST_PARTS = 3, 5
#: Directions in which what the parts ask for is nothing in all: that of the motion itself, the others of a shift and a
#: turn with gain and offset; and the share that is left of it at least.
_TAKEN, _OTHERS, _LEAST_LEFT = 1.0, 3.0, 0.2


def misfit_spread(
    subsets: Subsets,
    coefficients: Floats32,
    order: int,
    chosen: Integers,
    motion: Floats,
    models: Integers,
    loaded: Loaded,
) -> Floats:
    """Variances along x and y, and covariance, of motions (result, 3) [px²]; NaN where parts are too few.

    ``coefficients``: of the frame; ``chosen``: integer (result,), subset of each result; ``motion``: (result, 6)
    [px], where it was found; ``models``: integer (result,), what was solved for; ``loaded``: where the
    coefficients lie in the frame.

    References
    ----------
    K.-Y. Liang, S. L. Zeger, Biometrika 73 (1986) 13-22, https://doi.org/10.1093/biomet/73.1.13
    """
    result = np.full((len(chosen), 3), np.nan)
    corner = float(loaded.box[0] - PADDING), float(loaded.box[2] - PADDING)
    width = 2 * int(subsets.half.max(initial=0)) + 1
    values = np.zeros((width, width + 2 * LANES), np.float32)
    for model in np.unique(models).tolist():
        own = np.flatnonzero(models == model)
        found = np.full((len(own), 3), np.nan)
        moments, normal = subsets.products(model)
        solved = normal.shape[1] if model & (LIGHT | BLUR | CURVE) else MOTIONS
        _spread(
            coefficients,
            order,
            corner,
            chosen[own],
            subsets.layout,
            subsets.packed,
            subsets.level,
            moments,
            subsets.model(model).inverse,
            solved,
            np.where(subsets.rigid_in(model), 0.0, 3.0) + float(solved_columns(model)),
            np.ascontiguousarray(motion[own]),
            loaded.window,
            values,
            found,
        )
        result[own] = found
    return result


@compiled(nogil=True, error_model="numpy")
def _spread(
    coefficients: Floats32,
    order: int,
    corner: tuple[float, float],
    chosen: Integers,
    layout: Integers,
    packed: Floats32,
    level: Floats,
    moments: Floats,
    inverse: Floats,
    solved: int,
    more: Floats,
    motion: Floats,
    window: tuple[float, float, float, float],
    values: Floats32,
    result: Floats,
) -> None:
    """Sum the squares of what the parts of each subset ask for."""
    step, column = np.zeros(CURVED), np.zeros(CURVED)
    for q in range(len(chosen)):
        n, p = chosen[q], motion[q]
        half, place, pitch = layout[n, 2], layout[n, 3], layout[n, 4]
        width, pixels, energy = 2 * half + 1, level[n, 2], level[n, 1]
        parts = min(max(round(width / _PART), _LEAST_PARTS), _MOST_PARTS)
        if width < _LEAST_PARTS * _LEAST_PART or inverse[n, 0, 0] <= 0.0:
            continue
        if not is_inside(layout[n, 0], layout[n, 1], half, p, window):
            continue
        _leave(coefficients, order, corner, layout[n], packed, level[n], inverse[n], solved, p, values, column, step)
        weight = inverse[n]
        away_x = away_y = along_x = along_y = left = like = 0.0
        own = own_contrast(step, moments[n], energy, solved)
        for b in range(solved):
            away_x += weight[0, b] * moments[n, 0, b] / pixels
            away_y += weight[3, b] * moments[n, 0, b] / pixels
            along_x += weight[0, b] * moments[n, 1, b] / energy
            along_y += weight[3, b] * moments[n, 1, b] / energy
            left += step[b] * moments[n, 0, b] / pixels
            like += step[b] * moments[n, 1, b] / energy
        xx = yy = xy = of_x = of_y = most_x = most_y = 0.0
        for lower in range(parts):
            for right in range(parts):
                ask_x = ask_y = own_x = own_y = 0.0
                for row in range(lower * width // parts, (lower + 1) * width // parts):
                    for k in range(right * width // parts, (right + 1) * width // parts):
                        at = place + row * pitch + k
                        grey = packed[0, at]
                        _columns(packed, at, level[n, 0], half, float(k - half), float(row - half), column)
                        rest = values[row, k] + left + like * grey
                        by_x, by_y = -away_x - along_x * grey, -away_y - along_y * grey
                        for b in range(solved):
                            rest -= step[b] * column[b]
                            by_x += weight[0, b] * column[b]
                            by_y += weight[3, b] * column[b]
                        ask_x += packed[6, at] * by_x * rest
                        ask_y += packed[6, at] * by_y * rest
                        own_x += packed[6, at] * by_x * by_x
                        own_y += packed[6, at] * by_y * by_y
                xx += ask_x * ask_x
                yy += ask_y * ask_y
                xy += ask_x * ask_y
                of_x += own_x
                of_y += own_y
                most_x += own_x * own_x
                most_y += own_y * own_y
        others = (_OTHERS + more[n]) / float(parts * parts)
        grown_x = 1.0 / (own * own * max(1.0 - _TAKEN * most_x / of_x**2 - others, _LEAST_LEFT))
        grown_y = 1.0 / (own * own * max(1.0 - _TAKEN * most_y / of_y**2 - others, _LEAST_LEFT))
        result[q, 0], result[q, 1], result[q, 2] = grown_x * xx, grown_y * yy, math.sqrt(grown_x * grown_y) * xy


@part(error_model="numpy")
def _leave(
    coefficients: Floats32,
    order: int,
    corner: tuple[float, float],
    layout: Integers,
    packed: Floats32,
    level: Floats,
    inverse: Floats,
    solved: int,
    p: Floats,
    values: Floats32,
    column: Floats,
    step: Floats,
) -> None:
    """Put into ``values`` what is left of the frame, and into ``step`` by how much each column lowers it."""
    half, place, pitch = layout[2], layout[3], layout[4]
    width, mean = 2 * half + 1, np.float32(level[0])
    total = shared = 0.0
    for row in range(width):
        i = float(row - half)
        x = layout[0] - corner[0] - half + p[0] - p[1] * half + p[2] * i
        y = layout[1] - corner[1] + i + p[3] - p[4] * half + p[5] * i
        sample_row(coefficients, order, x, y, p[1], p[4], width, values[row])
        for k in range(width):
            at = place + row * pitch + k
            values[row, k] = packed[6, at] * (values[row, k] - mean)
            total += values[row, k]
            shared += values[row, k] * packed[0, at]
    gain, average = level[1] / shared, total / level[2]
    slopes = np.zeros(CURVED)
    for row in range(width):
        for k in range(width):
            at = place + row * pitch + k
            values[row, k] = gain * (values[row, k] - average) - packed[0, at]
            _columns(packed, at, level[0], half, float(k - half), float(row - half), column)
            for b in range(solved):
                slopes[b] += packed[6, at] * column[b] * values[row, k]
    for a in range(solved):
        step[a] = 0.0
        for b in range(solved):
            step[a] += inverse[a, b] * slopes[b]


@part(error_model="numpy")
def _columns(packed: Floats32, at: int, level: float, half: int, j: float, i: float, column: Floats) -> None:
    """Columns of the least squares at a pixel, see :class:`.Subsets`."""
    grey, slope_x, slope_y = packed[0, at], packed[1, at], packed[2, at]
    column[0], column[1], column[2] = slope_x, slope_x * j, slope_x * i
    column[3], column[4], column[5] = slope_y, slope_y * j, slope_y * i
    column[6], column[7], column[8], column[9] = j, i, grey * j, grey * i
    column[10], column[11], column[12] = packed[3, at], packed[4, at], packed[5, at]
    whole, mean = grey + level, half * (half + 1) / 3.0
    column[COLUMNS], column[COLUMNS + 1] = whole * (j * j - mean), whole * j * i
    column[COLUMNS + 2] = whole * (i * i - mean)

"""The compiled loop over the cells and parts of a ring: what a fit leaves there, and how that pulls.

Importing it imports numba.
"""

import math

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import compiled, part
from labpipe.imaging.fringes._fit_kernel import (
    DX,
    FAST,
    LINES,
    PARAMETERS,
    RESIDUAL,
    USUAL,
    R,
    differentiate,
    differentiate_rich,
    evaluate,
    find_pixels,
)

#: Pixels of a part that are kept before their slopes are multiplied: together they fill vectors.
_KEPT = 64


@part(fastmath=FAST)
def _along(one: Floats, other: Floats, first: int, end: int) -> float:
    """Sum products over a stretch of a row."""
    total = 0.0
    for i in range(first, end):
        total += one[i] * other[i]
    return total


@part(fastmath=FAST)
def _add_kept(part: int, kept: Floats, filled: Integers, normals: Floats) -> None:
    """Add the products of the slopes of the pixels that were kept of a part."""
    for p in range(kept.shape[1]):
        for q in range(p + 1):
            normals[part, p, q] += _along(kept[part, p], kept[part, q], 0, filled[part])
    filled[part] = 0


@part(fastmath=FAST)
def _add_cells(
    count: int,
    dy: float,
    inner: float,
    outer: float,
    limits: Floats,
    cotangents: Floats,
    active: Integers,
    work: Floats,
    slopes: Floats,
    place: Integers,
    kept: Floats,
    filled: Integers,
    cells: tuple[Floats, Floats],
    normals: Floats,
) -> None:
    """Add the residuals of a row to its cells, and the lower half of each part's normal matrix by what was ``kept``.

    The sector and the part of every pixel are left in ``place``; the part is their number where there is none.
    """
    sums, counts = cells
    bins, sectors = sums.shape
    parts, part, half = len(normals), 0, sums.shape[1] // 2
    sector = sectors - 1 if dy >= 0.0 else 0
    for i in range(count):
        # A row passes from sector to sector, above the centre in their order and below it against that.
        if dy < 0.0:
            while sector < half - 1 and work[DX, i] >= dy * cotangents[sector + 1]:
                sector += 1
        else:
            while sector > half and work[DX, i] >= dy * cotangents[sector]:
                sector -= 1
        ring = min(int((work[R, i] - inner) / (outer - inner) * bins), bins - 1)
        sums[ring, sector] += work[RESIDUAL, i]
        counts[ring, sector] += 1.0
        place[0, i], place[1, i] = sector, parts
        if not parts or work[R, i] < limits[0]:
            continue
        # Pixels of a row lie in parts beside each other.
        while part > 0 and work[R, i] < limits[part]:
            part -= 1
        while part < parts - 1 and work[R, i] >= limits[part + 1]:
            part += 1
        place[1, i] = part
        for p in range(len(active)):
            kept[part, p, filled[part]] = slopes[active[p], i]
        filled[part] += 1
        if filled[part] == _KEPT:
            _add_kept(part, kept, filled, normals)


@compiled(nogil=True)
def accumulate_cells(
    image: Floats32,
    first_row: int,
    first_column: int,
    stride: int,
    inner: float,
    outer: float,
    parameters: Floats,
    origin: Floats,
    table: Floats,
    table_start: float,
    active: Integers,
    ceiling: float,
    kind: int,
    bins: int,
    sectors: int,
    limits: Floats,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Sum residuals over cells of the ring, and their products with the slopes over its parts.

    Returns sums and numbers of pixels (bin, sector), products with the slopes (sector, active), and,
    between the distances ``limits``, normal matrices (part, active, active) and products (part, active).
    """
    rows, columns = image.shape
    size = len(active)
    cells = sums, counts = np.zeros((bins, sectors)), np.zeros((bins, sectors))
    scores = np.zeros((sectors, size))
    parts = max(len(limits) - 1, 0)
    normals, pulls = np.zeros((parts, size, size)), np.zeros((parts, size))
    place, cotangents = np.empty((2, columns), np.int64), np.zeros(sectors)
    kept, filled = np.empty((parts, size, _KEPT)), np.zeros(parts, np.int64)
    for sector in range(1, sectors):
        if 2 * sector != sectors:
            cotangents[sector] = 1.0 / math.tan(2.0 * math.pi * (sector / sectors - 0.5))
    work, slopes = np.empty((LINES, columns)), np.empty((PARAMETERS if kind else USUAL, columns))
    for row in range(0, rows, stride):
        dy = row + first_row - parameters[2]
        down = (row + first_row - origin[1]) / origin[2]
        count = find_pixels(image[row], first_column, dy, inner, outer, parameters, ceiling, work)
        offset = parameters[1] - origin[0]
        evaluate(count, offset, down, parameters, origin, table, table_start, work, kind)
        if size:
            differentiate(count, dy, down, parameters, work, slopes)
            if kind:
                differentiate_rich(count, down, parameters, table, table_start, work, slopes, kind)
        residual = work[RESIDUAL]
        _add_cells(
            count, dy, inner, outer, limits, cotangents, active, work, slopes, place, kept, filled, cells, normals
        )
        first = 0 if size else count
        while first < count:
            end = first + 1
            while end < count and place[0, end] == place[0, first] and place[1, end] == place[1, first]:
                end += 1
            for p in range(size):
                pull = _along(slopes[active[p]], residual, first, end)
                scores[place[0, first], p] += pull
                if place[1, first] < parts:
                    pulls[place[1, first], p] += pull
            first = end
    for rest in range(parts):
        _add_kept(rest, kept, filled, normals)
    for p in range(size):
        for q in range(p):
            normals[:, q, p] = normals[:, p, q]
    return sums, counts, scores, normals, pulls

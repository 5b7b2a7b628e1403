"""The compiled loops of the fringe fit: sums over the pixels of a ring.

Importing it imports numba.
"""

import math

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import compiled, part
from labpipe.imaging.fringes._interference import SAMPLES_PER_PIXEL

# Sums over pixels may be reordered and fused.
FAST = {"reassoc", "contract", "nsz", "arcp"}

# Tables of the cosine alone; with blur and harmonics; with light that is uneven as well.
PLAIN, RICH, UNEVEN = 0, 1, 2

# Lines of the work array of a row: geometry, light, and the table at every pixel.
DX, _U, _V, R, _ACROSS, _CURVE, _LIGHT, _TERM, _CORE = 0, 1, 2, 3, 4, 5, 6, 7, 8
_BY_R, _BY_RADIUS, _BY_PHASE, _BY_SMEAR, RESIDUAL, _COLUMN = 9, 10, 11, 12, 13, 14
_SEEN = 15
LINES = 16
USUAL, PARAMETERS = 13, 29


@part(fastmath=FAST)
def find_pixels(
    line: Floats32,
    first_column: int,
    dy: float,
    inner: float,
    outer: float,
    parameters: Floats,
    ceiling: float,
    work: Floats,
) -> int:
    """List the pixels of a row that lie in the ring, with their places and grey levels."""
    columns = len(line)
    centre = parameters[1] - first_column
    stretch, shear = parameters[9], parameters[10]
    size = 1.0 + abs(stretch) + abs(shear)
    reach = (outer * size) ** 2 - dy * dy
    if reach <= 0.0:
        return 0
    reach = math.sqrt(reach)
    hole = math.sqrt(max((inner / size) ** 2 - dy * dy, 0.0))
    column = max(0, math.ceil(centre - reach))
    end = min(columns - 1, math.floor(centre + reach))
    count = 0
    while column <= end:
        dx = column - centre
        if abs(dx) < hole and dx <= 0.0:
            # Over the hole to its far side.
            column = max(column + 1, math.ceil(centre + hole))
            continue
        u = dx * (1.0 + stretch) + dy * shear
        v = dy * (1.0 - stretch) + dx * shear
        r = math.sqrt(u * u + v * v)
        if r >= inner and r <= outer and line[column] < ceiling:
            work[DX, count] = dx
            work[_U, count] = u
            work[_V, count] = v
            work[R, count] = r
            work[RESIDUAL, count] = line[column]
            work[_COLUMN, count] = column
            count += 1
        column += 1
    return count


@part(fastmath=FAST)
def _evaluate_unevenly(
    count: int, offset: float, down: float, parameters: Floats, origin: Floats, work: Floats
) -> None:
    """Model and residual in light that is uneven, from the table at the pixels."""
    for i in range(count):
        x = (work[DX, i] + offset) / origin[2]
        curve = (x * x + down * down - origin[3]) * origin[4]
        power = parameters[5] * x + parameters[6] * down + parameters[7] * curve
        power += parameters[20] * (x * x - down * down) + parameters[21] * x * down
        power += x * x * (parameters[22] * x + parameters[23] * down)
        power += down * down * (parameters[24] * x + parameters[25] * down)
        seen = 1.0 + parameters[26] * x + parameters[27] * down + parameters[28] * curve
        for line in range(_BY_R, _BY_SMEAR + 1):
            work[line, i] *= seen
        work[_SEEN, i] = seen
        work[_TERM, i] *= seen
        work[_ACROSS, i], work[_CURVE, i] = x, curve
        work[_LIGHT, i] = math.exp(power)
        work[_CORE, i] = parameters[3] + parameters[4] * work[_TERM, i]
        work[RESIDUAL, i] -= work[_LIGHT, i] * work[_CORE, i]


@part(fastmath=FAST)
def evaluate(
    count: int,
    offset: float,
    down: float,
    parameters: Floats,
    origin: Floats,
    table: Floats,
    table_start: float,
    work: Floats,
    kind: int,
) -> None:
    """Model and residual of the listed pixels; the table is interpolated linearly."""
    last = table.shape[1] - 2
    for i in range(count):
        at = (work[R, i] - table_start) * SAMPLES_PER_PIXEL
        cell = min(max(int(at), 0), last)
        t = at - cell
        work[_TERM, i] = table[0, cell] + t * (table[0, cell + 1] - table[0, cell])
        work[_BY_R, i] = table[1, cell] + t * (table[1, cell + 1] - table[1, cell])
        work[_BY_RADIUS, i] = table[2, cell] + t * (table[2, cell + 1] - table[2, cell])
        work[_BY_PHASE, i] = table[3, cell] + t * (table[3, cell + 1] - table[3, cell])
        work[_BY_SMEAR, i] = table[4, cell] + t * (table[4, cell + 1] - table[4, cell])
    if kind:
        work[_SEEN, :count] = 1.0
    if kind == UNEVEN:
        _evaluate_unevenly(count, offset, down, parameters, origin, work)
        return
    for i in range(count):
        x = (work[DX, i] + offset) / origin[2]
        curve = (x * x + down * down - origin[3]) * origin[4]
        light = 1.0 + parameters[5] * x + parameters[6] * down + parameters[7] * curve
        core = parameters[3] + parameters[4] * work[_TERM, i]
        work[_ACROSS, i] = x
        work[_CURVE, i] = curve
        work[_LIGHT, i] = light
        work[_CORE, i] = core
        work[RESIDUAL, i] -= light * core


@compiled(nogil=True, fastmath=FAST)
def differentiate(count: int, dy: float, down: float, parameters: Floats, work: Floats, slopes: Floats) -> None:
    """Differentiate the model by every parameter at the listed pixels."""
    radius, modulation = parameters[0], parameters[4]
    stretch, shear = parameters[9], parameters[10]
    for i in range(count):
        dx, u, v, r = work[DX, i], work[_U, i], work[_V, i], work[R, i]
        light, core = work[_LIGHT, i], work[_CORE, i]
        bright = modulation * light
        steep = bright * work[_BY_R, i] / max(r, 1e-9)
        slopes[0, i] = bright * work[_BY_RADIUS, i]
        slopes[1, i] = -steep * (u * (1.0 + stretch) + v * shear)
        slopes[2, i] = -steep * (v * (1.0 - stretch) + u * shear)
        slopes[3, i] = light
        slopes[4, i] = light * work[_TERM, i]
        slopes[5, i] = work[_ACROSS, i] * core
        slopes[6, i] = down * core
        slopes[7, i] = work[_CURVE, i] * core
        slopes[8, i] = bright * work[_BY_PHASE, i]
        slopes[9, i] = steep * (u * dx - v * dy)
        slopes[10, i] = steep * (u * dy + v * dx)
        slopes[11, i] = bright * work[_BY_SMEAR, i]
        # The gap is homogeneous of degree 2 in distance and contact radius.
        slopes[12, i] = 0.5 * bright * (r * work[_BY_R, i] + radius * work[_BY_RADIUS, i])


@part(fastmath=FAST)
def differentiate_rich(
    count: int,
    down: float,
    parameters: Floats,
    table: Floats,
    table_start: float,
    work: Floats,
    slopes: Floats,
    kind: int,
) -> None:
    """Differentiate by blur, harmonics and spread, and by what makes light uneven, which is an exponential then."""
    last = table.shape[1] - 2
    for i in range(count):
        at = (work[R, i] - table_start) * SAMPLES_PER_PIXEL
        cell = min(max(int(at), 0), last)
        t = at - cell
        bright = parameters[4] * work[_LIGHT, i] * work[_SEEN, i]
        for line in range(len(table) - 5):
            low = table[5 + line, cell]
            slopes[13 + line, i] = bright * (low + t * (table[5 + line, cell + 1] - low))
    if kind < UNEVEN:
        return
    for i in range(count):
        x, light = work[_ACROSS, i], work[_LIGHT, i]
        core = work[_CORE, i] * light
        for line in range(5, 8):
            slopes[line, i] *= light
        slopes[20, i] = core * (x * x - down * down)
        slopes[21, i] = core * x * down
        slopes[22, i] = core * x * x * x
        slopes[23, i] = core * x * x * down
        slopes[24, i] = core * x * down * down
        slopes[25, i] = core * down * down * down
        fringes = parameters[4] * light * work[_TERM, i] / work[_SEEN, i]
        slopes[26, i] = fringes * x
        slopes[27, i] = fringes * down
        slopes[28, i] = fringes * work[_CURVE, i]


@part(fastmath=FAST)
def _add(
    count: int, active: Integers, residual: Floats, slopes: Floats, normal: Floats, right: Floats, weighted: Floats
) -> None:
    """Add a row to the normal equations, and to the matrix weighted by squared residuals, of the first parameters."""
    for p in range(len(active)):
        one = slopes[active[p]]
        total = 0.0
        for i in range(count):
            total += one[i] * residual[i]
        right[p] += total
        q = 0
        while q < p - 1:  # three at a time, which read the row of `one` once
            first, second, third = slopes[active[q]], slopes[active[q + 1]], slopes[active[q + 2]]
            with_first, with_second, with_third = 0.0, 0.0, 0.0
            for i in range(count):
                with_first += one[i] * first[i]
                with_second += one[i] * second[i]
                with_third += one[i] * third[i]
            normal[p, q] += with_first
            normal[p, q + 1] += with_second
            normal[p, q + 2] += with_third
            q += 3
        while q <= p:
            other = slopes[active[q]]
            total = 0.0
            for i in range(count):
                total += one[i] * other[i]
            normal[p, q] += total
            q += 1
        if p < len(weighted):
            for q in range(p + 1):
                other = slopes[active[q]]
                total = 0.0
                for i in range(count):
                    total += residual[i] * residual[i] * one[i] * other[i]
                weighted[p, q] += total


@part()
def _add_differences(
    count: int, dy: float, stride: int, work: Floats, above: Floats, here: Floats, totals: Floats
) -> None:
    """Add squared differences of residuals between neighbours along the rings.

    Errors of the model change across the rings, hardly along them; noise changes everywhere.
    Above and below the centre the neighbour stands in the row, beside it in the row above, and
    on the diagonals in the row above as many columns outwards as that row is away.
    """
    here[:] = np.nan
    for i in range(count):
        column = int(work[_COLUMN, i])
        dx, residual = work[DX, i], work[RESIDUAL, i]
        here[column] = residual
        difference = math.nan
        if abs(dy) > 2.0 * abs(dx):
            if i > 0 and work[_COLUMN, i - 1] == column - 1:
                difference = residual - work[RESIDUAL, i - 1]
        else:
            if abs(dx) <= 2.0 * abs(dy):
                column += stride if dx * dy > 0.0 else -stride
            if 0 <= column < len(above):
                difference = residual - above[column]
        if not math.isnan(difference):
            totals[2] += difference * difference
            totals[3] += 1.0
    for column in range(len(here)):  # whole rows at once would compile three seconds longer
        above[column] = here[column]


@compiled(nogil=True)
def accumulate(
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
    told: int,
    kind: int,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Sum the normal equations over the pixels between two distances.

    Returns the normal matrix, its right side, the matrix weighted by squared residuals (of the
    first parameters, as many as are ``told``), and (sum of squares, pixels, and, where any are, sum of
    squared differences of neighbouring residuals along the rings, their number).
    """
    rows, columns = image.shape
    size = len(active)
    normal, weighted = np.zeros((size, size)), np.zeros((told, told))
    right, totals = np.zeros(size), np.zeros(4)
    work, slopes = np.empty((LINES, columns)), np.empty((PARAMETERS if kind else USUAL, columns))
    above, here = np.full(columns, np.nan), np.full(columns, np.nan)
    for row in range(0, rows, stride):
        dy = row + first_row - parameters[2]
        down = (row + first_row - origin[1]) / origin[2]
        count = find_pixels(image[row], first_column, dy, inner, outer, parameters, ceiling, work)
        offset = parameters[1] - origin[0]
        evaluate(count, offset, down, parameters, origin, table, table_start, work, kind)
        differentiate(count, dy, down, parameters, work, slopes)
        if kind:
            differentiate_rich(count, down, parameters, table, table_start, work, slopes, kind)
        residual = work[RESIDUAL]
        _add(count, active, residual, slopes, normal, right, weighted)
        for i in range(count):
            totals[0] += residual[i] * residual[i]
        totals[1] += count
        if told:
            _add_differences(count, dy, stride, work, above, here, totals)
    for p in range(size):
        for q in range(p):
            normal[q, p] = normal[p, q]
            if p < told:
                weighted[q, p] = weighted[p, q]
    return normal, right, weighted, totals

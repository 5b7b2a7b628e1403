"""The compiled loops of the fringe fit: radial tables and sums over the pixels of a ring.

Both stand in one file because compiled code is cached by file. Importing it imports numba.
"""

import math

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import compiled, part
from labpipe.imaging.fringes._interference import SAMPLES_PER_PIXEL

# Sums over pixels may be reordered and fused.
FAST = {"reassoc", "contract", "nsz", "arcp"}


#: Taps of a kernel from which its averages are so smooth that every so many samples tell the others, and how many.
_SMOOTH_TAPS, _THIN = 8 * SAMPLES_PER_PIXEL, 4


@part(fastmath=FAST)
def _seen_by_pixels(raw: Floats, distance: Floats, kernel: Floats) -> Floats:
    """Average the lines of a table over pixels and blur; rich ones get the derivative by the blur."""
    width = len(kernel)
    size = raw.shape[1] - width + 1
    result = np.zeros((len(raw), size))
    thin = _THIN if width >= _SMOOTH_TAPS and size > 4 * _THIN else 1
    for line in range(len(raw)):
        if line == 5:
            continue
        if thin > 1:
            _thinly(raw[line], kernel, thin, result[line])
            continue
        for j in range(width):
            weight = kernel[j]
            for i in range(size):
                result[line, i] += weight * raw[line, i + j]
    if len(raw) > 5:
        # A blur spreads the light as heat does: by its square, half the Laplacian.
        for i in range(size):
            low, high = max(i - 1, 0), min(i + 1, size - 1)
            bend = (result[1, high] - result[1, low]) * SAMPLES_PER_PIXEL / (high - low)
            result[5, i] = 0.5 * (bend + result[1, i] / max(distance[i + width // 2], 1.0))
    return result


@part(fastmath=FAST)
def _thinly(line: Floats, kernel: Floats, thin: int, result: Floats) -> None:
    """Average one line at every so many samples, and lay cubics through them for those between."""
    size = len(result)
    last = (size - 1) // thin - 1
    for place in range(size):
        if place % thin == 0 or place < thin or place > last * thin:
            total = 0.0
            for j in range(len(kernel)):
                total += kernel[j] * line[place + j]
            result[place] = total
    for step in range(1, thin):
        x = step / thin
        before, after = -x * (1.0 - x) * (2.0 - x) / 6.0, -x * (1.0 - x) * (1.0 + x) / 6.0
        here, beside = (1.0 + x) * (1.0 - x) * (2.0 - x) / 2.0, (1.0 + x) * x * (2.0 - x) / 2.0
        for k in range(1, last):
            at = k * thin
            value = here * result[at] + beside * result[at + thin]
            result[at + step] = value + before * result[at - thin] + after * result[at + 2 * thin]


@compiled(nogil=True, fastmath=FAST)
def fill_table(
    distance: Floats,
    contact_radius: float,
    travel: float,
    nodes: Floats,
    weights: Floats,
    phase_scale: float,
    phase: float,
    kernel: Floats,
    second: float,
    third: float,
    is_rich: bool,
    flat: float,
) -> Floats:
    """Compiled twin of the loop in :func:`.radial_table`; rich tables have three lines more."""
    count = len(distance)
    raw = np.zeros((8 if is_rich else 5, count))
    for k in range(len(nodes)):
        node = nodes[k]
        square = max(contact_radius * contact_radius + node * contact_radius * travel, 0.0)
        a = math.sqrt(square)
        divisor = 2.0 * max(a, 1e-6)
        to_radius = (2.0 * contact_radius + node * travel) / divisor
        to_travel = node * contact_radius / divisor
        cosine = math.cos(phase)
        two = 2.0 * cosine * cosine - 1.0
        three = cosine * (2.0 * two - 1.0)
        inside_cosine = weights[k] * (cosine + second * two + third * three)
        inside_sine = -weights[k] * math.sin(phase) * (1.0 + 4.0 * second * cosine + 3.0 * third * (2.0 * two + 1.0))
        inner = min(flat, 0.995 * a)
        inner *= inner
        side = math.sqrt(max(square - inner, 0.0))
        inside_two, inside_three = weights[k] * two, weights[k] * three
        for i in range(count):
            r = distance[i]
            if r <= a:
                raw[0, i] += inside_cosine
                raw[3, i] += inside_sine
                if is_rich:
                    raw[6, i] += inside_two
                    raw[7, i] += inside_three
                continue
            root = math.sqrt(r * r - square)
            angle = math.atan2(root, a)
            if side > 0.0 and flat > 0.0:
                turn = 0.5 * math.pi - math.atan2(side, root)
                gap = ((r * r - inner) * turn + side * root - 2.0 * a * side * angle) / math.pi
                angle *= phase_scale / math.pi
                slope = 2.0 * phase_scale / math.pi * (side * root / r + r * turn)
                # By radius below: -4 a angle; here 2 (2 a² - b²) / s angle.
                angle *= (square - 0.5 * inner) / (a * side)
            else:
                gap = (a * root - (2.0 * square - r * r) * angle) / math.pi
                angle *= phase_scale / math.pi
                slope = 2.0 * (phase_scale / math.pi * a * root / r + r * angle)
            argument = phase_scale * gap + phase
            sine = -weights[k] * math.sin(argument)
            cosine = math.cos(argument)
            term = cosine
            if is_rich:
                two = 2.0 * cosine * cosine - 1.0
                three = cosine * (2.0 * two - 1.0)
                raw[6, i] += weights[k] * two
                raw[7, i] += weights[k] * three
                term += second * two + third * three
                # sin 2φ = 2 sin φ cos φ, sin 3φ = sin φ (2 cos 2φ + 1)
                sine *= 1.0 + 4.0 * second * cosine + 3.0 * third * (2.0 * two + 1.0)
            change = -4.0 * a * angle * sine
            raw[0, i] += weights[k] * term
            raw[1, i] += slope * sine
            raw[2, i] += change * to_radius
            raw[3, i] += sine
            raw[4, i] += change * to_travel
    return _seen_by_pixels(raw, distance, kernel)


# Lines of the work array of a row: geometry, light, and the table at every pixel.
_DX, _U, _V, _R, _ACROSS, _CURVE, _LIGHT, _TERM, _CORE = 0, 1, 2, 3, 4, 5, 6, 7, 8
_BY_R, _BY_RADIUS, _BY_PHASE, _BY_SMEAR, _RESIDUAL, _COLUMN = 9, 10, 11, 12, 13, 14
_LINES = 15
_USUAL, _PARAMETERS = 13, 22


@part(fastmath=FAST)
def _find_pixels(
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
            work[_DX, count] = dx
            work[_U, count] = u
            work[_V, count] = v
            work[_R, count] = r
            work[_RESIDUAL, count] = line[column]
            work[_COLUMN, count] = column
            count += 1
        column += 1
    return count


@part(fastmath=FAST)
def _evaluate(
    count: int,
    offset: float,
    down: float,
    parameters: Floats,
    origin: Floats,
    table: Floats,
    table_start: float,
    work: Floats,
    is_rich: bool,
) -> None:
    """Model and residual of the listed pixels; the table is interpolated linearly."""
    last = table.shape[1] - 2
    for i in range(count):
        at = (work[_R, i] - table_start) * SAMPLES_PER_PIXEL
        cell = min(max(int(at), 0), last)
        t = at - cell
        work[_TERM, i] = table[0, cell] + t * (table[0, cell + 1] - table[0, cell])
        work[_BY_R, i] = table[1, cell] + t * (table[1, cell + 1] - table[1, cell])
        work[_BY_RADIUS, i] = table[2, cell] + t * (table[2, cell + 1] - table[2, cell])
        work[_BY_PHASE, i] = table[3, cell] + t * (table[3, cell + 1] - table[3, cell])
        work[_BY_SMEAR, i] = table[4, cell] + t * (table[4, cell + 1] - table[4, cell])
    for i in range(count):
        x = (work[_DX, i] + offset) / origin[2]
        curve = (x * x + down * down - origin[3]) * origin[4]
        light = 1.0 + parameters[5] * x + parameters[6] * down + parameters[7] * curve
        if is_rich:
            light += parameters[16] * (x * x - down * down) + parameters[17] * x * down
            light += x * x * (parameters[18] * x + parameters[19] * down)
            light += down * down * (parameters[20] * x + parameters[21] * down)
        core = parameters[3] + parameters[4] * work[_TERM, i]
        work[_ACROSS, i] = x
        work[_CURVE, i] = curve
        work[_LIGHT, i] = light
        work[_CORE, i] = core
        work[_RESIDUAL, i] -= light * core


@compiled(nogil=True, fastmath=FAST)
def _differentiate(count: int, dy: float, down: float, parameters: Floats, work: Floats, slopes: Floats) -> None:
    """Differentiate the model by every parameter at the listed pixels."""
    radius, modulation = parameters[0], parameters[4]
    stretch, shear = parameters[9], parameters[10]
    for i in range(count):
        dx, u, v, r = work[_DX, i], work[_U, i], work[_V, i], work[_R, i]
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
def _differentiate_rich(
    count: int, down: float, parameters: Floats, table: Floats, table_start: float, work: Floats, slopes: Floats
) -> None:
    """Differentiate by blur, harmonics and the higher terms of the light."""
    last = table.shape[1] - 2
    for i in range(count):
        at = (work[_R, i] - table_start) * SAMPLES_PER_PIXEL
        cell = min(max(int(at), 0), last)
        t = at - cell
        bright = parameters[4] * work[_LIGHT, i]
        x, core = work[_ACROSS, i], work[_CORE, i]
        slopes[13, i] = bright * (table[5, cell] + t * (table[5, cell + 1] - table[5, cell]))
        slopes[14, i] = bright * (table[6, cell] + t * (table[6, cell + 1] - table[6, cell]))
        slopes[15, i] = bright * (table[7, cell] + t * (table[7, cell + 1] - table[7, cell]))
        slopes[16, i] = core * (x * x - down * down)
        slopes[17, i] = core * x * down
        slopes[18, i] = core * x * x * x
        slopes[19, i] = core * x * x * down
        slopes[20, i] = core * x * down * down
        slopes[21, i] = core * down * down * down


@part(fastmath=FAST)
def _add(
    count: int,
    active: Integers,
    residual: Floats,
    slopes: Floats,
    normal: Floats,
    right: Floats,
    weighted: Floats,
    is_last: bool,
) -> None:
    """Add a row to the normal equations, and to the matrix weighted by squared residuals."""
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
        if is_last:
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
        dx, residual = work[_DX, i], work[_RESIDUAL, i]
        here[column] = residual
        difference = math.nan
        if abs(dy) > 2.0 * abs(dx):
            if i > 0 and work[_COLUMN, i - 1] == column - 1:
                difference = residual - work[_RESIDUAL, i - 1]
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
    is_last: bool,
    is_rich: bool,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Sum the normal equations over the pixels between two distances.

    Returns the normal matrix, its right side, the matrix weighted by squared residuals (when
    ``is_last``), and (sum of squares, pixels, sum of squared differences of neighbouring
    residuals along the rings, their number).
    """
    rows, columns = image.shape
    size = len(active)
    normal, weighted = np.zeros((size, size)), np.zeros((size, size))
    right, totals = np.zeros(size), np.zeros(4)
    work, slopes = np.empty((_LINES, columns)), np.empty((_PARAMETERS if is_rich else _USUAL, columns))
    above, here = np.full(columns, np.nan), np.full(columns, np.nan)
    for row in range(0, rows, stride):
        dy = row + first_row - parameters[2]
        down = (row + first_row - origin[1]) / origin[2]
        count = _find_pixels(image[row], first_column, dy, inner, outer, parameters, ceiling, work)
        offset = parameters[1] - origin[0]
        _evaluate(count, offset, down, parameters, origin, table, table_start, work, is_rich)
        _differentiate(count, dy, down, parameters, work, slopes)
        if is_rich:
            _differentiate_rich(count, down, parameters, table, table_start, work, slopes)
        residual = work[_RESIDUAL]
        _add(count, active, residual, slopes, normal, right, weighted, is_last)
        for i in range(count):
            totals[0] += residual[i] * residual[i]
        totals[1] += count
        if is_last:
            _add_differences(count, dy, stride, work, above, here, totals)
    for p in range(size):
        for q in range(p):
            normal[q, p] = normal[p, q]
            weighted[q, p] = weighted[p, q]
    return normal, right, weighted, totals


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
    is_rich: bool,
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
    sums, counts = np.zeros((bins, sectors)), np.zeros((bins, sectors))
    scores = np.zeros((sectors, size))
    parts = max(len(limits) - 1, 0)
    normals, pulls = np.zeros((parts, size, size)), np.zeros((parts, size))
    work, slopes = np.empty((_LINES, columns)), np.empty((_PARAMETERS if is_rich else _USUAL, columns))
    for row in range(0, rows, stride):
        dy = row + first_row - parameters[2]
        down = (row + first_row - origin[1]) / origin[2]
        count = _find_pixels(image[row], first_column, dy, inner, outer, parameters, ceiling, work)
        offset = parameters[1] - origin[0]
        _evaluate(count, offset, down, parameters, origin, table, table_start, work, is_rich)
        _differentiate(count, dy, down, parameters, work, slopes)
        if is_rich:
            _differentiate_rich(count, down, parameters, table, table_start, work, slopes)
        for i in range(count):
            turn = math.atan2(dy, work[_DX, i]) / (2.0 * math.pi) + 0.5
            sector = min(int(turn * sectors), sectors - 1)
            place = min(int((work[_R, i] - inner) / (outer - inner) * bins), bins - 1)
            sums[place, sector] += work[_RESIDUAL, i]
            counts[place, sector] += 1.0
            for p in range(size):
                scores[sector, p] += slopes[active[p], i] * work[_RESIDUAL, i]
            part = np.searchsorted(limits, work[_R, i], side="right") - 1
            if 0 <= part < parts:
                for p in range(size):
                    slope = slopes[active[p], i]
                    pulls[part, p] += slope * work[_RESIDUAL, i]
                    for q in range(size):
                        normals[part, p, q] += slope * slopes[active[q], i]
    return sums, counts, scores, normals, pulls


@compiled(nogil=True, fastmath=FAST)
def radial_sums(image: Floats32, x: float, y: float, row_step: float, width: float, bins: int) -> tuple[Floats, Floats]:
    """Sum grey levels and count pixels in rings of equal width around a point.

    The rows of the image stand ``row_step`` pixels apart.
    """
    sums, counts = np.zeros(bins), np.zeros(bins)
    rows, columns = image.shape
    reach = bins * width
    for row in range(rows):
        dy = row * row_step - y
        half = reach * reach - dy * dy
        if half <= 0.0:
            continue
        half = math.sqrt(half)
        for column in range(max(0, math.ceil(x - half)), min(columns, math.floor(x + half) + 1)):
            dx = column - x
            place = int(math.sqrt(dx * dx + dy * dy) / width)
            if place < bins:
                sums[place] += image[row, column]
                counts[place] += 1.0
    return sums, counts


@compiled(nogil=True, fastmath=FAST)
def fill_templates(
    radii: Floats,
    first_bins: Integers,
    lengths: Integers,
    width: float,
    travel: float,
    nodes: Floats,
    weights: Floats,
    phase_scale: float,
    phase: float,
    samples: int,
) -> Floats32:
    """Interference term in rings of equal width for many contact radii, one row each."""
    result = np.zeros((len(radii), lengths.max()), np.float32)
    for row in range(len(radii)):
        for k in range(len(nodes)):
            square = max(radii[row] * radii[row] + nodes[k] * radii[row] * travel, 0.0)
            a = math.sqrt(square)
            for j in range(lengths[row]):
                total = 0.0
                for m in range(samples):
                    r = (first_bins[row] + j + (m + 0.5) / samples) * width
                    gap = 0.0
                    if r > a:
                        root = math.sqrt(r * r - square)
                        angle = math.atan2(root, a)
                        gap = (a * root - (2.0 * square - r * r) * angle) / math.pi
                    total += math.cos(phase_scale * gap + phase)
                result[row, j] += weights[k] * total / samples
    return result

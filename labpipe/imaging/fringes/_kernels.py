"""Compiled loops of the fringe fit: radial tables, sums over the pixels of a ring, profiles, templates.

They stand in one file because compiled code is cached by file. Importing it imports numba.
"""

import math

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import njit
from labpipe.imaging.fringes._ring_model import SAMPLES_PER_PIXEL

# Sums over pixels may be reordered and fused.
FAST = {"reassoc", "contract", "nsz", "arcp"}


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def fill_table(
    distance: Floats,
    contact_radius: float,
    motion: tuple[float, float],
    nodes: Floats,
    weights: Floats,
    wave: tuple[float, float, float, float, float],
    kernel: Floats,
) -> Floats:
    """Tabulate the interference term, its derivatives by distance, contact radius and phase, and by the travel.

    ``motion`` is the travel and the bend of a²(t) = a² + a travel t + bend t² for t in -1 .. 1, which are the
    ``nodes``; where that is negative the sphere hovers, as far away as it would have approached at this square;
    ``wave`` is phase scale, phase, flat, spread and beams of :class:`.Optics`.
    """
    travel, bend = motion
    phase_scale, phase, flat, spread, beams = wave
    scale, count = phase_scale / math.pi, len(distance)
    is_plain = spread == 0.0 and beams == 0.0
    raw = np.zeros((5, count))
    for k in range(len(nodes)):
        node, weight = nodes[k], weights[k]
        square = contact_radius * contact_radius + node * contact_radius * travel + node * node * bend
        to_radius, to_travel = 2.0 * contact_radius + node * travel, node * contact_radius
        a = math.sqrt(max(square, 0.0))
        inner = min(flat, 0.995 * a) ** 2
        side = math.sqrt(a * a - inner)
        bow = (square - 0.5 * inner) / (a * side) if inner > 0.0 else 1.0
        for i in range(count):
            r = distance[i]
            lag, slope, change = 0.0, 0.0, 0.0
            if square <= 0.0:  # it does not touch yet
                lag, slope, change = phase_scale * (0.5 * r * r - square), phase_scale * r, -phase_scale
            elif r > a:
                root = math.sqrt(r * r - square)
                angle = math.atan2(root, a)
                turn = math.atan2(root, side) if inner > 0.0 else angle
                lag = scale * ((r * r - inner) * turn + side * root - 2.0 * a * side * angle)
                slope = 2.0 * scale * (side * root / r + r * turn)
                change = -2.0 * bow * scale * angle
            cosine, sine = math.cos(lag + phase), math.sin(lag + phase)
            term, by_phase, by_lag = cosine, -sine, -sine
            if not is_plain:
                fade = math.exp(-0.5 * spread * lag * lag)
                z = complex(fade * cosine, fade * sine)
                share = 1.0 / (1.0 - beams * z)
                turned = z * share * share
                term, by_phase = (z * share).real, -turned.imag
                by_lag = by_phase - spread * lag * turned.real
            by_lag *= weight
            raw[0, i] += weight * term
            raw[1, i] += slope * by_lag
            raw[2, i] += change * by_lag * to_radius
            raw[3, i] += weight * by_phase
            raw[4, i] += change * by_lag * to_travel
    width = len(kernel)
    result = np.zeros((5, count - width + 1))
    for line in range(5):
        for j in range(width):
            weight = kernel[j]
            for i in range(count - width + 1):
                result[line, i] += weight * raw[line, i + j]
    return result


# Parameters whose slopes are formed in closed form; those of the optics follow, from the table.
_SLOPES, _BY_TABLE = 19, 15
# Side (px) of the blocks of pixels that may share their noise.
_BLOCK = 16


@njit(cache=True, fastmath=FAST)
def _find_pixels(
    line: Floats32, centre: float, dy: float, inner: float, outer: float, p: Floats, ceiling: float, found: Integers
) -> int:
    """List the columns of a row that lie in the ring; ``centre`` is that of the ring in the row."""
    stretch, shear = p[9], p[10]
    size = 1.0 + abs(stretch) + abs(shear)
    reach = (outer * size) ** 2 - dy * dy
    if reach <= 0.0:
        return 0
    reach = math.sqrt(reach)
    hole = math.sqrt(max((inner / size) ** 2 - dy * dy, 0.0))
    count = 0
    for column in range(max(0, math.ceil(centre - reach)), min(len(line) - 1, math.floor(centre + reach)) + 1):
        dx = column - centre
        if abs(dx) < hole:
            continue
        u, v = dx * (1.0 + stretch) + dy * shear, dy * (1.0 - stretch) + dx * shear
        square = u * u + v * v
        if square >= inner * inner and square <= outer * outer and line[column] < ceiling:
            found[count] = column
            count += 1
    return count


@njit(cache=True, fastmath=FAST)
def _differentiate(
    line: Floats32, columns: Integers, place: tuple[float, float, float], p: Floats, origin: Floats, table: Floats,
    start: float, residual: Floats, slopes: Floats,
) -> None:  # fmt: skip
    """Residual and slopes by every parameter at the listed pixels of a row; the table is interpolated linearly.

    ``place`` of the row: column and row from the centre of the ring, and row in units of the light.
    """
    centre, dy, down = place
    last, stretch, shear, offset = table.shape[1] - 2, p[9], p[10], p[1] - origin[0]
    for i in range(len(columns)):
        dx = columns[i] - centre
        u, v = dx * (1.0 + stretch) + dy * shear, dy * (1.0 - stretch) + dx * shear
        r = math.sqrt(u * u + v * v)
        at = (r - start) * SAMPLES_PER_PIXEL
        cell = min(max(int(at), 0), last)
        t = at - cell
        term = table[0, cell] + t * (table[0, cell + 1] - table[0, cell])
        by_r = table[1, cell] + t * (table[1, cell + 1] - table[1, cell])
        by_radius = table[2, cell] + t * (table[2, cell + 1] - table[2, cell])
        by_phase = table[3, cell] + t * (table[3, cell + 1] - table[3, cell])
        by_smear = table[4, cell] + t * (table[4, cell + 1] - table[4, cell])
        x = (dx + offset) / origin[2]
        curve = (x * x + down * down - origin[3]) * origin[4]
        saddle, cross = x * x - down * down, x * down
        light = 1.0 + p[5] * x + p[6] * down + p[7] * curve + p[13] * saddle + p[14] * cross
        core, bright = p[3] + p[4] * term, p[4] * light
        residual[i] = line[columns[i]] - light * core
        steep = bright * by_r / max(r, 1e-9)
        slopes[0, i] = bright * by_radius
        slopes[1, i] = -steep * (u * (1.0 + stretch) + v * shear)
        slopes[2, i] = -steep * (v * (1.0 - stretch) + u * shear)
        slopes[3, i] = light
        slopes[4, i] = light * term
        slopes[5, i] = x * core
        slopes[6, i] = down * core
        slopes[7, i] = curve * core
        slopes[8, i] = bright * by_phase
        slopes[9, i] = steep * (u * dx - v * dy)
        slopes[10, i] = steep * (u * dy + v * dx)
        slopes[11, i] = bright * by_smear
        # The gap is homogeneous of degree 2 in distance and contact radius.
        slopes[12, i] = 0.5 * bright * (r * by_r + p[0] * by_radius)
        slopes[13, i] = saddle * core
        slopes[14, i] = cross * core
        for k in range(5, table.shape[0]):
            value = table[k, cell] + t * (table[k, cell + 1] - table[k, cell])
            slopes[_BY_TABLE - 5 + k, i] = bright * value


@njit(cache=True, fastmath=FAST)
def _add(count: int, active: Integers, residual: Floats, slopes: Floats, normal: Floats, right: Floats) -> None:
    """Add a row to the normal equations."""
    for p in range(len(active)):
        one = slopes[active[p]]
        for i in range(count):
            right[p] += one[i] * residual[i]
        for q in range(p + 1):
            other, total = slopes[active[q]], 0.0
            for i in range(count):
                total += one[i] * other[i]
            normal[p, q] += total


@njit(cache=True)
def _add_differences(
    columns: Integers, centre: float, dy: float, stride: int, residual: Floats, above: Floats, totals: Floats
) -> None:
    """Add squared differences of residuals between neighbours along the rings.

    Errors of the model change across the rings, hardly along them; noise changes everywhere. Above and below the
    centre the neighbour lies in the row, to its left and right in the row above, and on the diagonals in the row
    above as many columns outwards as that row is away. ``above`` becomes the residuals of this row.
    """
    here = np.full(len(above), np.nan)
    for i in range(len(columns)):
        column = columns[i]
        dx = column - centre
        here[column] = residual[i]
        if abs(dy) > 2.0 * abs(dx):
            difference = residual[i] - here[column - 1] if column > 0 else math.nan
        else:
            if abs(dx) <= 2.0 * abs(dy):
                column += stride if dx * dy > 0.0 else -stride
            difference = residual[i] - above[column] if 0 <= column < len(above) else math.nan
        if not math.isnan(difference):
            totals[2] += difference * difference
            totals[3] += 1.0
    above[:] = here


@njit(cache=True, nogil=True)
def accumulate(
    image: Floats32,
    corner: tuple[int, int, int],
    limits: tuple[float, float],
    parameters: Floats,
    origin: Floats,
    table: Floats,
    table_start: float,
    active: Integers,
    ceiling: float,
    scored: int,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Sum the normal equations over the pixels between two distances.

    ``corner`` is the first row and column of the image, and every how many rows are used. Returns the normal matrix,
    its right side, the sum over blocks of pixels of the products of their scores (of the first parameters, as many as
    are ``scored``), and (sum of squares, pixels, and, where any are scored, sum of squared differences of
    neighbouring residuals along the rings, their number).
    """
    rows, columns = image.shape
    first_row, first_column, stride = corner
    inner, outer = limits
    size = len(active)
    normal, middle = np.zeros((size, size)), np.zeros((scored, scored))
    right, totals = np.zeros(size), np.zeros(4)
    slopes, residuals, found = np.empty((_SLOPES, columns)), np.empty(columns), np.empty(columns, np.int64)
    above, centre = np.full(columns, np.nan), parameters[1] - first_column
    scores = np.zeros((columns // _BLOCK + 1, scored))
    for number in range((rows + stride - 1) // stride):
        row = number * stride
        dy = row + first_row - parameters[2]
        down = (row + first_row - origin[1]) / origin[2]
        count = _find_pixels(image[row], centre, dy, inner, outer, parameters, ceiling, found)
        seen, residual = found[:count], residuals[:count]
        place = centre, dy, down
        _differentiate(image[row], seen, place, parameters, origin, table, table_start, residual, slopes)
        _add(count, active, residual, slopes, normal, right)
        totals[0] += (residual * residual).sum()
        totals[1] += count
        if scored:
            _add_differences(seen, centre, dy, stride, residual, above, totals)
            for i in range(count):
                for p in range(scored):
                    scores[seen[i] // _BLOCK, p] += residual[i] * slopes[active[p], i]
            if row // _BLOCK != (row + stride) // _BLOCK or row + stride >= rows:
                middle += scores.T @ scores
                scores[:] = 0.0
    for p in range(size):
        for q in range(p):
            normal[q, p] = normal[p, q]
    return normal, right, middle, totals


@njit(cache=True, nogil=True, fastmath=FAST)
def radial_sums(
    image: Floats32, x: float, y: float, row_step: float, width: float, bins: int, stretch: float, shear: float
) -> tuple[Floats, Floats]:
    """Sum grey levels and count pixels in rings of equal width around a point, circles or ellipses.

    The rows of the image are ``row_step`` pixels apart.
    """
    sums, counts = np.zeros(bins), np.zeros(bins)
    rows, columns = image.shape
    reach = bins * width * (1.0 + abs(stretch) + abs(shear))
    for row in range(rows):
        dy = row * row_step - y
        half = reach * reach - dy * dy
        if half <= 0.0:
            continue
        half = math.sqrt(half)
        for column in range(max(0, math.ceil(x - half)), min(columns, math.floor(x + half) + 1)):
            dx = column - x
            u, v = dx * (1.0 + stretch) + dy * shear, dy * (1.0 - stretch) + dx * shear
            place = int(math.sqrt(u * u + v * v) / width)
            if place < bins:
                sums[place] += image[row, column]
                counts[place] += 1.0
    return sums, counts


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_templates(
    windows: tuple[Floats, Integers, Integers, float],
    motion: tuple[float, Floats, Floats],
    blur: float,
    phase_scale: float,
) -> Floats32:
    """Cosine and sine (2, radius, ring) of the phase of the gap in rings of equal width around many contacts.

    ``windows``: radii, first rings, numbers of rings, and their width; ``motion``: travel, nodes and weights.
    """
    (radii, first_bins, lengths, width), (travel, nodes, weights) = windows, motion
    result = np.zeros((2, len(radii), lengths.max()), np.float32)
    for row in range(len(radii)):
        for k in range(len(nodes)):
            square = max(radii[row] * radii[row] + nodes[k] * radii[row] * travel, 0.0)
            a = math.sqrt(square)
            for j in range(2 * lengths[row]):
                r = (first_bins[row] + 0.5 * j + 0.25) * width
                lag, weight = 0.0, 0.5 * weights[k]
                if r > a:
                    root = math.sqrt(r * r - square)
                    angle, scale = math.atan2(root, a), phase_scale / math.pi
                    lag = scale * (a * root - (2.0 * square - r * r) * angle)
                    if blur > 0.0:
                        weight *= math.exp(-2.0 * (blur * scale * (a * root / r + r * angle)) ** 2)
                result[0, row, j // 2] += weight * math.cos(lag)
                result[1, row, j // 2] += weight * math.sin(lag)
    return result


@njit(cache=True, nogil=True, fastmath=FAST)
def compare_templates(
    profile: Floats, counts: Floats, values: Floats32, first_bins: Integers, lengths: Integers, least_seen: float
) -> Floats:
    """Products of a profile y with the cosine c and sine s of each template, a mean and a trend of its own taken off.

    Returns (variant, template, 9) the sums yy, yc, ys, cc, cs, ss, weighted by pixels, and the means of y, c and s; 0
    for templates of which less than ``least_seen`` lies in the frame.
    """
    result = np.zeros((values.shape[0], values.shape[2], 9))
    for row in range(values.shape[2]):
        first, length = first_bins[row], lengths[row]
        weights, grey = counts[first : first + length], profile[first : first + length]
        total = weights.sum()
        if total <= 0.0 or (weights > 0.0).sum() < least_seen * length:
            continue
        step = 1.0 * np.arange(length)
        step -= (weights * step).sum() / total
        square, light = max((weights * step * step).sum(), 1e-6 * total), (weights * grey).sum() / total
        off = grey - light - (weights * step * grey).sum() / square * step
        for variant in range(values.shape[0]):
            cosine, sine = values[variant, 0, row, :length], values[variant, 1, row, :length]
            c, s = (weights * cosine).sum() / total, (weights * sine).sum() / total
            by_c, by_s = (weights * step * cosine).sum(), (weights * step * sine).sum()
            here = result[variant, row]
            here[0] = (weights * off * off).sum()
            here[1], here[2] = (weights * off * cosine).sum(), (weights * off * sine).sum()
            here[3] = (weights * cosine * cosine).sum() - total * c * c - by_c * by_c / square
            here[4] = (weights * cosine * sine).sum() - total * c * s - by_c * by_s / square
            here[5] = (weights * sine * sine).sum() - total * s * s - by_s * by_s / square
            here[6], here[7], here[8] = light, c, s
    return result

"""The compiled loops that make radial tables, of the light that a fit expects and of the light in a frame.

Importing it imports numba.
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


@part(fastmath=FAST)
def _term(
    cosine: float, sine: float, second: float, turned: float, third: float
) -> tuple[float, float, float, float, float]:
    """Light with its harmonics, and its derivatives by the phase and by the parameters of these.

    With z = exp iφ and q = second + i turned: Re w, w = z/(1 - qz), and a third harmonic beside it.
    """
    real = 1.0 - second * cosine + turned * sine
    imaginary = -(second * sine + turned * cosine)
    size = real * real + imaginary * imaginary
    along, across = (cosine * real + sine * imaginary) / size, (sine * real - cosine * imaginary) / size
    square, twice = along * along - across * across, 2.0 * along * across
    three = cosine * (4.0 * cosine * cosine - 3.0)
    steep = across + second * twice + turned * square + 3.0 * third * sine * (4.0 * cosine * cosine - 1.0)
    return along + third * three, -steep, square, -twice, three


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
    turned: float,
    third: float,
    is_rich: bool,
    flat: float,
) -> Floats:
    """Compiled twin of the loop in :func:`.radial_table`; rich tables have four lines more."""
    count = len(distance)
    raw = np.zeros((9 if is_rich else 5, count))
    for k in range(len(nodes)):
        node = nodes[k]
        square = max(contact_radius * contact_radius + node * contact_radius * travel, 0.0)
        a = math.sqrt(square)
        divisor = 2.0 * max(a, 1e-6)
        to_radius = (2.0 * contact_radius + node * travel) / divisor
        to_travel = node * contact_radius / divisor
        inside = _term(math.cos(phase), math.sin(phase), second, turned, third)
        inside_cosine, inside_sine = weights[k] * inside[0], weights[k] * inside[1]
        inner = min(flat, 0.995 * a)
        inner *= inner
        side = math.sqrt(max(square - inner, 0.0))
        for i in range(count):
            r = distance[i]
            if r <= a:
                raw[0, i] += inside_cosine
                raw[3, i] += inside_sine
                if is_rich:
                    for line in range(3):
                        raw[6 + line, i] += weights[k] * inside[2 + line]
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
            term = math.cos(argument)
            if is_rich:
                term, steep, by_second, by_turned, by_third = _term(term, math.sin(argument), second, turned, third)
                sine = weights[k] * steep
                raw[6, i] += weights[k] * by_second
                raw[7, i] += weights[k] * by_turned
                raw[8, i] += weights[k] * by_third
            change = -4.0 * a * angle * sine
            raw[0, i] += weights[k] * term
            raw[1, i] += slope * sine
            raw[2, i] += change * to_radius
            raw[3, i] += sine
            raw[4, i] += change * to_travel
    return _seen_by_pixels(raw, distance, kernel)


@compiled(nogil=True, fastmath=FAST)
def radial_sums(
    image: Floats32, x: float, y: float, row_step: float, width: float, bins: int, stretch: float, shear: float
) -> tuple[Floats, Floats]:
    """Sum grey levels and count pixels in rings of equal width around a point, circles or ellipses.

    The rows of the image stand ``row_step`` pixels apart.
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

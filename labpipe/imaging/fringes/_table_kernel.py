"""The compiled loops that make radial tables, of the light that a fit expects and of the light in a frame.

Importing it imports numba.
"""

import math

import numpy as np

from labpipe.arrays import Floats, Floats32, Integers
from labpipe.compilation import compiled, part
from labpipe.imaging.fringes._interference import BETWEEN_BEAMS, SAMPLES_PER_PIXEL, beyond_third

# Sums over pixels may be reordered and fused.
FAST = {"reassoc", "contract", "nsz", "arcp"}

#: Taps of a kernel from which its averages are so smooth that every so many samples tell the others, and how many.
_SMOOTH_TAPS, _THIN = 8 * SAMPLES_PER_PIXEL, 4
# Lines of the work array of a band of colours: phase of the gap, the term that goes with the contrast, slopes of the
# logarithm of a wave (real, imaginary) by that phase and by the spread, square of the slope of the gap, what turns the
# harmonics with it.
_LAG, _TERM, _BY_LAG, _BY_SPREAD, _SQUARE, _TURNING = 0, 1, 2, 4, 6, 7
_beyond_third = part(fastmath=FAST)(beyond_third)
# Variance of a pixel below which rings count as even.
_TINY = 1e-6


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
    cosine: float, sine: float, second: float, turned: float, third: float, further: Floats
) -> tuple[float, float, float, float, float, float, float]:
    """Light with its harmonics, its derivatives by phase, logarithm of the contrast and the parameters of these.

    With z, exp iφ times a contrast, and q = second + i turned: Re w, w = z/(1 - qz), a third harmonic beside it, and
    ``further`` ones, of which the derivatives by the second come last.
    """
    real = 1.0 - second * cosine + turned * sine
    imaginary = -(second * sine + turned * cosine)
    size = real * real + imaginary * imaginary
    along, across = (cosine * real + sine * imaginary) / size, (sine * real - cosine * imaginary) / size
    square, twice = along * along - across * across, 2.0 * along * across
    wave = complex(cosine, sine)
    high = wave * wave * wave
    three = high.real
    term, steep = along + third * three, across + second * twice + turned * square + 3.0 * third * high.imag
    by_contrast, by_others, by_third = along + second * square - turned * twice + 3.0 * third * three, 0.0, three
    for k in range(len(further)):
        high *= wave
        term += further[k, 0] * high.real
        steep += (k + 4) * further[k, 0] * high.imag
        by_contrast += (k + 4) * further[k, 0] * high.real
        by_others += further[k, 1] * high.real
        by_third += further[k, 2] * high.real
    return term, -steep, by_contrast, square, -twice, by_third, by_others


@part(fastmath=FAST)
def _fade(cosine: Floats, sine: Floats, spread: float, skew: float, band: Floats) -> None:
    """Average waves over a band of colours, and tell how their logarithms change with phase of the gap and spread.

    Wavenumbers are k (1 - x + skew x²), x of normal law and variance ``spread``: a band that is even in wavenumbers
    for 0, in wavelengths for 1.
    """
    for i in range(len(cosine)):
        lag = band[_LAG, i]
        shrunk = 1.0 / complex(1.0, -2.0 * skew * spread * lag)
        turned_by = complex(0.0, skew * spread * lag) * shrunk
        by_lag = 1j + (1j * skew - lag * (1.0 + turned_by)) * spread * shrunk
        by_spread = (1j * skew - 0.5 * lag * (1.0 + 2.0 * turned_by)) * lag * shrunk
        wave = complex(cosine[i], sine[i]) * np.sqrt(shrunk) * np.exp(-0.5 * spread * lag * lag * shrunk)
        cosine[i], sine[i], band[_TERM, i] = wave.real, wave.imag, wave.real
        band[_BY_LAG, i], band[_BY_LAG + 1, i] = by_lag.real, by_lag.imag
        band[_BY_SPREAD, i], band[_BY_SPREAD + 1, i] = by_spread.real, by_spread.imag


@part(fastmath=FAST)
def _follow_band(sine: Floats, weight: float, band: Floats, raw: Floats) -> None:
    """Let sines be the slopes by the phase of the gap, along which waves fade, and add the slope by the spread."""
    for i in range(len(sine)):
        if len(raw) > 9:
            raw[9, i] += weight * (band[_BY_SPREAD, i] * band[_TERM, i] - band[_BY_SPREAD + 1, i] * sine[i])
        sine[i] = band[_BY_LAG + 1, i] * sine[i] - band[_BY_LAG, i] * band[_TERM, i]


@part(fastmath=FAST)
def _leave_focus(
    distance: Floats,
    root: Floats,
    turn: Floats,
    bent: float,
    contact: tuple[float, float, float],
    angle: Floats,
    slope: Floats,
) -> None:
    """Change the slopes of the gap by radius and distance into those of what is seen of it out of focus."""
    a, side, inner = contact
    for i in range(len(distance)):
        if root[i] > 0.0:
            r, lean = distance[i], bent * slope[i] / root[i]
            # the curvature of the gap, times the root
            curve = side + root[i] * (turn[i] - side * root[i] / (r * r)) + side * r * r / (r * r - inner)
            angle[i] -= a * lean / r
            slope[i] -= lean * curve


@part(fastmath=FAST)
def _add_harmonics(
    cosine: Floats,
    sine: Floats,
    harmonics: tuple[float, float, float],
    weight: float,
    bent: float,
    band: Floats,
    raw: Floats,
) -> None:
    """Turn waves into light with harmonics, and add the derivatives by these.

    The next beam leaves a gap at twice the slope: out of focus it is behind by four times as much, ``bent`` times
    the square of the slope more than its share.
    """
    second, turned, third = harmonics
    again, further = complex(1.0, 0.0), np.zeros((0, 3))
    if (second != 0.0 or third != 0.0) and turned == 0.0:
        further = _beyond_third(second, third)
    for i in range(len(cosine)):
        if bent != 0.0:
            again = np.exp(-1j * bent * band[_SQUARE, i])
            wave = complex(cosine[i], sine[i]) * (1.0 - BETWEEN_BEAMS * (second**2 + turned**2) * (again - 1.0))
            cosine[i], sine[i] = wave.real, wave.imag
        ratio = complex(second, turned) * again
        term, by_phase, fading, by_second, by_turned, by_third, by_others = _term(
            cosine[i], sine[i], ratio.real, ratio.imag, third, further
        )
        cosine[i], sine[i], band[_TERM, i] = term, -by_phase, fading
        raw[6, i] += weight * (by_second * again.real + by_turned * again.imag + by_others)
        raw[7, i] += weight * (by_turned * again.real - by_second * again.imag)
        raw[8, i] += weight * by_third
        band[_TURNING, i] = by_second * ratio.imag - by_turned * ratio.real


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
    lines: int,
    flat: float,
    spread: float,
    skew: float,
    focus: float,
) -> Floats:
    """Lines of a :class:`.RadialTable`: rich ones have 9, and more for spread and focus."""
    count = len(distance)
    is_rich, is_spread, is_bent = lines > 5, spread > 0.0 or lines > 9, focus != 0.0 or lines > 10
    raw = np.zeros((lines, count))
    band = np.zeros((8, count))
    root, angle, within = np.empty(count), np.empty(count), np.empty(count)
    cosine, sine, inside = np.empty(count), np.empty(count), (math.cos(phase), math.sin(phase))
    for k in range(len(nodes)):
        node, weight = nodes[k], weights[k]
        square = max(contact_radius * contact_radius + node * contact_radius * travel, 0.0)
        a = math.sqrt(square)
        divisor = 2.0 * max(a, 1e-6)
        # Inside the contact all of these are zero, and the gap with them.
        for i in range(count):
            root[i] = math.sqrt(max(distance[i] * distance[i] - square, 0.0))
            angle[i] = math.atan2(root[i], a) if root[i] > 0.0 else 0.0
        inner = min(flat, 0.995 * a) ** 2
        side, turn, bend = a, angle, 1.0
        if inner > 0.0:
            side, turn = math.sqrt(square - inner), within
            for i in range(count):
                turn[i] = math.atan2(root[i], side) if root[i] > 0.0 else 0.0
            # By radius below: -4 a angle; here 2 (2 a² - b²) / s angle.
            bend = (square - 0.5 * inner) / (a * side)
        scale, bent = phase_scale / math.pi, 4.0 * focus / math.pi
        # apart from what has branches: several samples at a time
        slope = side * root / np.maximum(distance, 1e-12) + distance * turn
        for i in range(count):
            cosine[i], sine[i], band[_LAG, i] = inside[0], inside[1], 0.0
            if root[i] > 0.0:
                beyond = (distance[i] * distance[i] - inner) * turn[i] + side * root[i]
                less = bent * slope[i] ** 2 if is_bent else 0.0
                band[_LAG, i] = scale * (beyond - 2.0 * a * side * angle[i] - less)
                cosine[i], sine[i] = math.cos(band[_LAG, i] + phase), math.sin(band[_LAG, i] + phase)
        if is_bent:
            band[_SQUARE] = slope * slope
            _leave_focus(distance, root, turn, bent, (a, side, inner), angle, slope)
        if is_spread:
            _fade(cosine, sine, spread, skew, band)
        if is_rich:
            _add_harmonics(cosine, sine, (second, turned, third), weight, 2.0 * scale * bent, band, raw)
        to_radius = -4.0 * a * weight * (2.0 * contact_radius + node * travel) / divisor
        to_travel = -4.0 * a * weight * node * contact_radius / divisor
        for i in range(count):
            raw[0, i] += weight * cosine[i]
            raw[3, i] -= weight * sine[i]
        if is_spread:
            _follow_band(sine, weight, band, raw)
        for i in range(count):
            raw[1, i] -= 2.0 * weight * scale * slope[i] * sine[i]
            change = -bend * scale * angle[i] * sine[i]
            raw[2, i] += to_radius * change
            raw[4, i] += to_travel * change
        if lines > 10:
            for i in range(count):
                turning = sine[i] + 2.0 * band[_TURNING, i]
                raw[10, i] += 4.0 / math.pi * weight * scale * band[_SQUARE, i] * turning
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
def compare_templates(
    profile: Floats, counts: Floats, values: Floats32, first_bins: Integers, lengths: Integers, least_seen: float
) -> tuple[Floats, Floats, Floats]:
    """Explain a profile by each template beside light and a trend of its own, weighted by pixels.

    Returns (travel, template) the share of the variance that is explained, the amplitude, and the light; no share for
    templates of which less than ``least_seen`` lies in the frame.
    """
    travels, size, rings = values.shape
    shares, amplitudes, lights = np.zeros((travels, size)), np.zeros((travels, size)), np.zeros((travels, size))
    steps, greys, weights = np.empty(rings), np.empty(rings), np.empty(rings)
    for row in range(size):
        first, length = first_bins[row], lengths[row]
        seen, total, step, grey = 0, 0.0, 0.0, 0.0
        for j in range(length):
            weights[j] = counts[first + j]
            seen += 1 if weights[j] > 0.0 else 0
            total += weights[j]
            step += weights[j] * j
            grey += weights[j] * profile[first + j]
        if total <= 0.0 or seen < least_seen * length:
            continue
        step, grey, least = step / total, grey / total, _TINY * total
        square, slope, variance = 0.0, 0.0, 0.0
        for j in range(length):
            steps[j] = weights[j] * (j - step)
            square += steps[j] * (j - step)
            slope += steps[j] * (profile[first + j] - grey)
        square = max(square, least)
        slope /= square
        for j in range(length):
            off = profile[first + j] - grey - slope * (j - step)
            greys[j] = weights[j] * off
            variance += greys[j] * off
        for travel in range(travels):
            mean, by_grey, by_step, own = 0.0, 0.0, 0.0, 0.0
            for j in range(length):
                value = values[travel, row, j]
                mean += weights[j] * value
                by_grey += greys[j] * value
                by_step += steps[j] * value
                own += weights[j] * value * value
            mean /= total
            own = max(own - total * mean * mean - by_step * by_step / square, least)
            shares[travel, row] = by_grey * by_grey / (own * max(variance, least))
            amplitudes[travel, row] = by_grey / own
            lights[travel, row] = grey - amplitudes[travel, row] * mean
    return shares, amplitudes, lights


@compiled(nogil=True, fastmath=FAST)
def fill_templates(
    radii: Floats, first_bins: Integers, lengths: Integers, width: float, phase_scale: float, phase: float, samples: int
) -> Floats32:
    """Interference term in rings of equal width for many contact radii, one row each."""
    result, inside = np.zeros((len(radii), lengths.max()), np.float32), math.cos(phase)
    for row in range(len(radii)):
        a = radii[row]
        first = first_bins[row] + 0.5 / samples
        for j in range(samples * lengths[row]):
            r = (first + j / samples) * width
            term = inside
            if r > a:
                root = math.sqrt(r * r - a * a)
                beyond = a * root - (a * a - root * root) * math.atan2(root, a)
                term = math.cos(phase_scale / math.pi * beyond + phase)
            result[row, j // samples] += term / samples
    return result


@compiled(nogil=True, fastmath=FAST)
def smear_templates(
    sharp: Floats32, radii: Floats, first_bins: Integers, lengths: Integers, travel: float, inside: float
) -> Floats32:
    """Average templates over a motion whose square changes evenly with time, from the radii that it passes.

    ``sharp`` are those of contacts at rest; nearer to the middle than they reach there is the light ``inside``.
    """
    result = np.zeros(sharp.shape, np.float32)
    for row in range(len(radii)):
        middle, half = radii[row] * radii[row], radii[row] * travel
        begin = 0
        while begin < row and 0.25 * (radii[begin] + radii[begin + 1]) ** 2 <= middle - half:
            begin += 1
        low = middle - half
        for k in range(begin, len(radii)):
            is_last = k + 1 == len(radii)
            high = middle + half if is_last else min(0.25 * (radii[k] + radii[k + 1]) ** 2, middle + half)
            weight, shift = (high - low) / (2.0 * half), first_bins[row] - first_bins[k]
            for j in range(min(-shift, lengths[row])):
                result[row, j] += weight * inside
            for j in range(max(-shift, 0), lengths[row]):
                result[row, j] += weight * sharp[k, j + shift]
            low = high
            if low >= middle + half:
                break
    return result

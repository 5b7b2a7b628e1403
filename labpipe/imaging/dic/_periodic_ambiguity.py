"""Patterns that repeat themselves within a subset: a match one period away is as good as the right one."""

import math

import numpy as np

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.compilation import njit
from labpipe.imaging.dic._kernels import FAST
from labpipe.imaging.dic._solver import OVERHANG, SOLVED, solve
from labpipe.imaging.dic._subsets import Subsets

#: Half width (px) of the least template, and the farthest repetition that is looked for.
_TEMPLATE, _FARTHEST = 7, 32
#: Correlation that separates one peak from the next: the half maximum.
_HALF_MAXIMUM = 0.5
#: Correlation in whole pixels from which a repetition is refined: half a pixel off the peak of the finest pattern.
_WORTH = 0.65


def best_repetition(image: Floats32, coefficients: Floats32, order: int, subsets: Subsets) -> Floats:
    """Greatest correlation of each subset with another place near it in the reference.

    Parameters
    ----------
    image : float32 array (row, column)
        Reference.
    coefficients : float32 array
        Its spline, see :func:`.prefilter`.
    order : 3 or 5
        Order of the spline.
    subsets : Subsets
        Those cut out of it.

    Returns
    -------
    array (point,) [1]
        Over all peaks apart from the subset's own place, within half its width; the ridge along an edge belongs to
        its own place. The middle of the subset is matched in whole pixels, and the best match refined.
    """
    rows, columns = image.shape
    result, start = np.zeros(len(subsets)), np.zeros((len(subsets), 6))
    _search(image, subsets.layout, result, start)
    chosen = np.flatnonzero(result > _WORTH)
    window = (-OVERHANG, columns - 1 + OVERHANG, -OVERHANG, rows - 1 + OVERHANG)
    refined = solve(subsets, coefficients, order, chosen, start[chosen], origin=(0, 0), window=window, capture=1.0)
    result[chosen] = np.where(refined.code == SOLVED, refined.zncc, result[chosen])
    return result


@njit(cache=True, nogil=True, fastmath=FAST)
def _search(image: Floats32, layout: Integers, result: Floats, start: Floats) -> None:
    """Best repetition of every subset in whole pixels: its correlation, and its displacement as a start."""
    rows, columns = image.shape
    for n in range(len(layout)):
        x, y, half = layout[n, 0], layout[n, 1], layout[n, 2]
        inner, reach = min(max(_TEMPLATE, half // 2), half), min(half, _FARTHEST)
        left, right = max(-reach, inner - x), min(reach, columns - 1 - inner - x)
        top, bottom = max(-reach, inner - y), min(reach, rows - 1 - inner - y)
        height, pitch = bottom - top + 2 * inner + 1, right - left + 2 * inner + 1
        grey = np.zeros(height * pitch + 4, np.float32)  # a sum of five products reads past the end
        for i in range(height):
            for j in range(pitch):
                grey[i * pitch + j] = image[y + top - inner + i, x + left - inner + j] - image[y, x]
        scores = np.zeros((bottom - top + 1, right - left + 1))
        _correlate(grey, pitch, inner, -left, -top, scores)
        _clear(scores, -left, -top)
        for i in range(len(scores)):
            for j in range(scores.shape[1]):
                if scores[i, j] > result[n]:
                    result[n], start[n, 0], start[n, 3] = scores[i, j], left + j, top + i


@njit(cache=True, nogil=True, fastmath=FAST)
def _correlate(grey: Floats32, pitch: int, inner: int, x: int, y: int, scores: Floats) -> None:
    """Correlate the square of half width ``inner`` at place (x, y) of the scores with all places in an area.

    The lines of the area, ``pitch`` long, follow each other in ``grey``, so that one long loop shifts all of it. Scores
    below half of the maximum stay 0. Of a large square lines are left out, down to the pixels of the least one.
    """
    size, length = 2 * inner + 1, len(scores) * pitch
    step = max(size * size // (2 * _TEMPLATE + 1) ** 2, 1)
    count = (size + step - 1) // step
    pixels, mean, energy = count * size, 0.0, 0.0
    template = np.zeros((count, size + 4), np.float32)
    for m in range(count):
        for j in range(size):
            template[m, j] = grey[(y + m * step) * pitch + x + j]
            mean, energy = mean + template[m, j] / pixels, energy + template[m, j] * template[m, j]
    energy -= pixels * mean * mean
    products, sums, squares = np.zeros((3, length), np.float32)
    i1, i2, i3, i4 = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
    for m in range(count):
        v = grey[m * step * pitch :]
        for q in range(np.uint64(length)):
            sums[q] += v[q]
            squares[q] += v[q] * v[q]
        for j in range(0, size, 5):
            t0, t1, t2, t3, t4 = template[m, j : j + 5]
            v = grey[m * step * pitch + j :]
            for q in range(np.uint64(length - size + 1)):
                products[q] += t0 * v[q] + t1 * v[q + i1] + t2 * v[q + i2] + t3 * v[q + i3] + t4 * v[q + i4]
    for i in range(len(scores)):
        total = square = 0.0
        for q in range(i * pitch, i * pitch + size - 1):
            total, square = total + sums[q], square + squares[q]
        for k in range(scores.shape[1]):
            q = i * pitch + k
            total, square = total + sums[q + size - 1], square + squares[q + size - 1]
            spread, common = energy * (square - total * total / pixels), products[q] - mean * total
            if common > 0.0 and common * common > _HALF_MAXIMUM**2 * spread > 0.0:
                scores[i, k] = common / math.sqrt(spread)
            total, square = total - sums[q], square - squares[q]


@njit(cache=True, nogil=True)
def _clear(scores: Floats, x: int, y: int) -> None:
    """Set the peak around a place, down to its half maximum, to zero."""
    columns, count = scores.shape[1], 1
    waiting = np.empty(scores.size + 1, np.int64)
    waiting[0] = y * columns + x
    while count:
        count -= 1
        y, x = waiting[count] // columns, waiting[count] % columns
        for i in range(max(y - 1, 0), min(y + 2, len(scores))):
            for j in range(max(x - 1, 0), min(x + 2, columns)):
                if scores[i, j] > 0.0:
                    scores[i, j] = 0.0
                    waiting[count] = i * columns + j
                    count += 1


def is_ambiguous(zncc: Floats, repetition: Floats, min_zncc: float) -> Flags:
    """Tell matches that are hardly better than a repetition of the pattern itself.

    Parameters
    ----------
    zncc : array (point,) [1]
        Correlation of each match.
    repetition : array (point,) [1]
        From :func:`best_repetition`.
    min_zncc : float [1]
        Correlation from which a place counts as a match: a repetition below it misleads nobody.

    Returns
    -------
    bool array (point,)
        The match leaves over half of what the repetition leaves, or more.
    """
    return np.asarray((repetition >= min_zncc) & (1.0 - zncc**2 > 0.5 * (1.0 - repetition**2)))

"""Cut the subsets out of the reference and multiply their columns."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from labpipe.arrays import Flags, Floats, Floats32, Integers
from labpipe.compilation import compiled, part
from labpipe.imaging.dic._row_sampling import FAST
from labpipe.imaging.dic._spline import LANES
from labpipe.imaging.dic._subset_kernel import COLUMNS, MOTIONS
from labpipe.imaging.dic._subsets import Images, Subsets

#: Which of the columns of a row that are multiplied each column is; some times the place of the row.
_APART = np.array([0, 1, 2, 3, 2, 4, 5, 4, 6, 0, 7, 1, 8, 9, 10])


def cut_subsets(
    images: Images,
    centres: Integers,
    half: Integers,
    is_rigid: NDArray[np.bool_],
    *,
    with_all: bool = True,
    counts: Sequence[Flags] | None = None,
) -> Subsets:
    """Cut the subsets out of the reference and prepare their normal equations.

    ``images``: the reference; ``centres``: integer (point, 2) [px], centre pixels (x, y); every subset must lie
    inside the image; ``half``: integer (point,) [px], half widths; ``is_rigid``: bool (point,), motion allowed
    for each subset; ``with_all``: multiply the columns of light and blur too, without which nothing can be solved
    for; ``counts``: list of bool arrays (row, column), optional, which pixels of each subset count, beside what a
    mask of the reference covers.

    Returns Subsets, A subset whose normal matrix is singular has ``inverse`` zero and is answered with
    ``NO_TEXTURE``.
    """
    count = len(half)
    width = 2 * half + 1
    pitch = -(-width // LANES) * LANES
    start = np.concatenate([[0], np.cumsum(width * pitch)])
    layout = np.column_stack([centres, half, start[:-1], pitch, np.zeros(count)]).astype(np.int64)
    packed = np.zeros((7, int(start[-1])), np.float32)
    level = np.zeros((count, 3))
    columns = COLUMNS + 2 if with_all else MOTIONS + 2
    gram = np.zeros((count, columns, columns))
    scratch = np.zeros((COLUMNS + 2, int(pitch.max(initial=LANES))), np.float32)
    stack = np.stack([images.grey, images.slope_x, images.slope_y, *(images.bend if with_all else ())])
    nowhere = np.zeros((0, 0), np.float32)
    for n, own in enumerate(counts or ()):
        packed[6, start[n] : start[n + 1]].reshape(len(own), -1)[:, : len(own)] = own
    inside = nowhere if images.inside is None else images.inside
    _cut(stack, inside, layout, packed, level, gram, scratch, counts is None)
    energy = gram[:, 1, 1]
    level[:, 1] = energy
    ones, greys = gram[:, 0, 2:], gram[:, 1, 2:]
    normal = gram[:, 2:, 2:] - ones[:, :, None] * ones[:, None, :] / np.maximum(level[:, 2, None, None], 1.0)
    normal -= greys[:, :, None] * greys[:, None, :] / np.where(energy > 0, energy, 1.0)[:, None, None]
    ramps = [0, 2 + MOTIONS, 2 + MOTIONS + 1] if with_all else [0, 0, 0]
    moments = np.stack([ones, greys], axis=1)
    return Subsets(layout, is_rigid, packed, level, moments, normal, gram[:, ramps][:, :, ramps].copy())


@compiled(nogil=True, fastmath=FAST)
def _cut(
    stack: Floats32,
    inside: Floats32,
    layout: Integers,
    packed: Floats32,
    level: Floats,
    gram: Floats,
    scratch: Floats32,
    is_whole: bool,
) -> None:
    """Pack the subsets; products of their columns row by row, so that the inner loops are vectors.

    The columns are 1, f, and those of the kernel, see ``COLUMNS``; what is a column times the place of the row
    has its sums.
    """
    for n in range(len(layout)):
        x, y, h, place, pitch, _ = layout[n]
        width = 2 * h + 1
        for i in range(width):
            for k in range(len(stack)):
                source = stack[k, y - h + i, x - h : x + h + 1]
                target = packed[k, place + i * pitch : place + i * pitch + width]
                for c in range(np.uint64(width)):
                    target[c] = source[c]
            weight = packed[6, place + i * pitch : place + i * pitch + width]
            if is_whole:
                for c in range(np.uint64(width)):
                    weight[c] = np.float32(1.0)
            if len(inside):
                counts = inside[y - h + i, x - h : x + h + 1]
                for c in range(np.uint64(width)):
                    weight[c] *= counts[c]
        _multiply(layout[n], packed, level[n], gram[n], scratch)


@part(fastmath=FAST)
def _multiply(layout: Integers, packed: Floats32, level: Floats, gram: Floats, scratch: Floats32) -> None:
    """Take the mean off a subset, cover what its weights cover, and multiply its columns."""
    _, _, h, place, pitch, _ = layout
    width = 2 * h + 1
    total, number = _weigh(layout, packed)
    level[0] = total / max(number, 1.0)
    level[2] = number
    layout[5] = np.int64(number < width * width - 0.5)
    mean = np.float32(level[0])
    centre = np.float32(h)
    lanes = np.uint64(pitch)
    planes, apart = (6, 11) if len(gram) > MOTIONS + 2 else (3, 6)
    products, factor = np.zeros((apart, apart)), np.ones(COLUMNS + 2)
    for i in range(width):
        first = place + i * pitch
        for k in range(planes):
            part, weight = packed[k, first : first + pitch], packed[6, first : first + pitch]
            less = mean if k == 0 else np.float32(0)
            for c in range(lanes):
                part[c] = (part[c] - less) * weight[c]
        grey, weight = packed[0, first : first + pitch], packed[6, first : first + pitch]
        slope_x, slope_y = packed[1, first : first + pitch], packed[2, first : first + pitch]
        for c in range(lanes):
            j = np.float32(np.int32(c)) - centre
            f, w, gx, gy = grey[c], weight[c], slope_x[c], slope_y[c]
            scratch[0, c] = w
            scratch[1, c] = f
            scratch[2, c] = gx
            scratch[3, c] = gx * j
            scratch[4, c] = gy
            scratch[5, c] = gy * j
            scratch[6, c] = w * j
            scratch[7, c] = f * j
        for k in range(3, planes):
            bend, target = packed[k, first : first + pitch], scratch[5 + k]
            for c in range(lanes):
                target[c] = bend[c]
        for a in range(apart):
            one = scratch[a]
            for b in range(a + 1):
                other = scratch[b]
                product = np.float32(0)
                for c in range(lanes):
                    product += one[c] * other[c]
                products[a, b] = products[b, a] = product
        for a in (4, 7, 9, 11):
            factor[a] = float(i - h)
        for a in range(len(gram)):
            for b in range(a + 1):
                gram[a, b] += products[_APART[a], _APART[b]] * factor[a] * factor[b]
    for a in range(len(gram)):
        for b in range(a):
            gram[b, a] = gram[a, b]


@part(fastmath=FAST)
def _weigh(layout: Integers, packed: Floats32) -> tuple[float, float]:
    """Sum the grey levels that count of a subset, and how many count."""
    _, _, h, place, pitch, _ = layout
    width = 2 * h + 1
    total, number = 0.0, 0.0
    for i in range(width):
        first = place + i * pitch
        grey, weight = packed[0, first : first + width], packed[6, first : first + width]
        row = many = np.float32(0)
        for c in range(np.uint64(width)):
            row += grey[c] * weight[c]
            many += weight[c]
        total += float(row)
        number += float(many)
    return total, number


def motion_matrices(
    slope_x: Floats32,
    slope_y: Floats32,
    grey: Floats32,
    subsets: Subsets,
    inside: Floats32 | None,
    counts: Sequence[Flags] | None = None,
) -> Floats:
    """Compute the normal matrices (point, 6, 6) of the motions alone, from other slopes than the solver's.

    ``slope_x``, ``slope_y``, ``grey``: float32 (row, column), slopes, and the grey levels to which contrast is
    fitted; ``subsets``: where; ``inside``: float32 (row, column), optional, see :class:`.Images`; ``counts``:
    list of bool arrays (row, column), optional, see :func:`cut_subsets`.
    """
    none = np.broadcast_to(np.zeros((), np.float32), (3, *grey.shape))
    images = Images(grey, slope_x, slope_y, none, inside)
    centres = np.stack([subsets.x, subsets.y], axis=1)
    return cut_subsets(images, centres, subsets.half, subsets.is_rigid, with_all=False, counts=counts).normal

"""Sums over the pixels of a ring: normal equations, residuals, differences of neighbours."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval

from labpipe.arrays import Floats, Integers
from labpipe.imaging.fringes._interference import (
    HIGHEST,
    Optics,
    RadialTable,
    beyond_third,
    exposure_nodes,
    phase_slope,
    pixel_weights,
    table_distances,
)
from labpipe.imaging.fringes._ring_noise import MOST_BINS, SECTORS
from labpipe.imaging.fringes._ring_parameters import HARMONICS, LIGHT, Parameter
from labpipe.imaging.fringes._ring_pixels import Ring

#: Travel (px) below which the effect of the smear is taken as proportional to its square, so that
#: noise may also make it negative.
_LEAST_TRAVEL = 0.3
#: Pixels of a cell in the mean, at least.
_PIXELS_PER_CELL = 8
#: Least square of a blur (px²), steps of that and of its shape which tell how light changes with them, lines with both.
_LEAST_SIZE, _STEP, _LINES = 0.01, 0.02, 12
_NO_LIMITS = np.empty(0)
#: What is asked of cells where only what is left in them counts.
NONE_FREE = np.empty(0, np.int64)


@dataclass(frozen=True)
class Sums:
    """Sums over the ring: normal equations, residuals, differences of neighbours."""

    normal: Floats
    right: Floats
    weighted: Floats
    squares: float
    pixels: int
    differences: float
    pairs: int


def _tabulated(
    limits: tuple[float, float], parameters: Floats, free: Integers, optics: Optics
) -> tuple[RadialTable, int]:
    """Radial table of a blur whose shape is not free."""
    from labpipe.imaging.fringes._fit_kernel import PLAIN
    from labpipe.imaging.fringes._table_kernel import fill_table

    if optics.halo[0]:
        (sharp, kind), (soft, _) = (_tabulated(limits, parameters, free, seen) for seen in optics.before_sharpening)
        return sharp.sharpened(soft, optics.halo[0]), kind
    (inner, outer), kind = limits, kind_of_table(parameters, free)
    is_rich = kind > PLAIN
    radius, travel = float(parameters[Parameter.RADIUS]), table_travel(parameters)
    blur = math.sqrt(max(optics.blur**2 + float(parameters[Parameter.BLUR]), 0.0))
    middle = 0.5 * (max(radius, 1.0) + outer) if optics.disc else math.inf
    kernel = pixel_weights(blur, optics.disc, middle)
    start, distance = table_distances(inner, outer, blur, len(kernel) // 2)
    spacing = 2.0 * math.pi / max(phase_slope(outer, radius, optics), 1e-12)
    nodes, weights = exposure_nodes(travel, spacing)
    phase = float(parameters[Parameter.PHASE])
    spread, (ratio, share) = optics.spread + float(parameters[Parameter.SPREAD]), optics.colour
    phase_scale = optics.phase_scale * math.exp(parameters[Parameter.SCALE]) / shrinkage(parameters)
    harmonics = tuple(float(parameters[p]) for p in HARMONICS)
    before = (0.0, 0.0, 0.0) if optics.by_camera else harmonics
    lines = 11 if Parameter.FOCUS in free else 10 if Parameter.SPREAD in free or spread < 0.0 else 9 if is_rich else 5
    focus = optics.focus + float(parameters[Parameter.FOCUS])
    rest = phase, kernel, *before, lines, optics.flat, max(spread, 0.0), optics.skew, focus
    values = fill_table(distance, radius, travel, nodes, weights, phase_scale, *rest)
    if share:
        values += share * (fill_table(distance, radius, travel, nodes, weights, ratio * phase_scale, *rest) - values)
    if is_rich:
        values[0] += min(optics.blur**2 + float(parameters[Parameter.BLUR]), 0.0) * values[5]
    if spread < 0.0:
        values[0] += spread * values[9]
    table = by_smear(RadialTable(start, values), parameters)
    if is_rich and optics.by_camera:
        _distort(table.values, float(parameters[Parameter.SECOND]), float(parameters[Parameter.THIRD]))
    return table, kind


def tabulate(
    limits: tuple[float, float], parameters: Floats, free: Integers, optics: Optics
) -> tuple[RadialTable, int]:
    """Radial table between two distances for the present parameters, by compiled loops, and its kind.

    How it changes with size and shape of a blur, where these are free, differences tell: where a disc is wider than
    the fringes these are reversed, and no derivative by distance tells that.
    """
    if Parameter.SHAPE not in free and not (optics.disc and Parameter.BLUR in free):
        return _tabulated(limits, parameters, free, optics)
    sharp = parameters.copy()
    sharp[[Parameter.BLUR, Parameter.SHAPE]] = 0.0
    size, shape = optics.blur**2 + parameters[Parameter.BLUR], optics.disc**2 + parameters[Parameter.SHAPE]
    near, like = max(size, _LEAST_SIZE), min(max(shape, 0.0), 1.0)
    table, kind = _tabulated(limits, sharp, free, _seen(optics, near, like))
    values = np.zeros((_LINES, table.values.shape[1]))
    values[: len(table.values)] = table.values
    step, turn = _STEP * near, _STEP if like < 0.5 else -_STEP
    larger = _tabulated(limits, sharp, NONE_FREE, _seen(optics, near + step, like))[0].values[0]
    values[5] = (larger - values[0]) / step
    values[0] += (size - near) * values[5]
    if Parameter.SHAPE in free:
        flatter = _tabulated(limits, sharp, NONE_FREE, _seen(optics, near, like + turn))[0].values[0]
        values[-1] = (flatter - table.values[0]) / turn
        values[0] += (shape - like) * values[-1]
    return RadialTable(table.start, values), kind


def _seen(optics: Optics, size: float, shape: float) -> Optics:
    """Return optics with a blur of this square (px²) and square of the disc's share."""
    return replace(optics, blur=math.sqrt(size), disc=math.sqrt(shape))


def _distort(values: Floats, second: float, third: float) -> None:
    """Add the harmonics that a camera makes of light that is blurred by then."""
    light, place = values[0].copy(), np.arange(3, HIGHEST)
    sizes = np.zeros((HIGHEST + 1, 3))  # and their slopes by the second and the third, by order
    sizes[1:4] = (1.0, 0.0, 0.0), (second, 1.0, 0.0), (third, 0.0, 1.0)
    sizes[4:] = beyond_third(second, third - second**2)
    sizes[4:, 0] += second**place
    sizes[4:, 1] += place * second ** (place - 1) - 2.0 * second * sizes[4:, 2]
    values[0], values[6], values[8] = chebval(light, sizes)
    steep = chebval(light, chebder(sizes[:, 0]))
    values[1:6] *= steep
    values[9:] *= steep


def shrinkage(parameters: Floats) -> float:
    """Factor by which stretch and shear reduce areas, so that the gap is that of equal area."""
    return 1.0 - float(parameters[Parameter.STRETCH]) ** 2 - float(parameters[Parameter.SHEAR]) ** 2


def kind_of_table(parameters: Floats, free: Integers) -> int:
    """Tell whether blur or harmonics are used, and whether light is uneven."""
    from labpipe.imaging.fringes._fit_kernel import PLAIN, RICH, UNEVEN

    if parameters[LIGHT[0] :].any() or (free >= LIGHT[0]).any():
        return UNEVEN
    return RICH if parameters[Parameter.BLUR :].any() or (free >= Parameter.BLUR).any() else PLAIN


def table_travel(parameters: Floats) -> float:
    """Travel at which a table is made."""
    return math.sqrt(max(float(parameters[Parameter.SMEAR]), _LEAST_TRAVEL**2))


def by_smear(table: RadialTable, parameters: Floats) -> RadialTable:
    """Change the derivative by travel into that by its square, and extrapolate down to it."""
    travel = table_travel(parameters)
    table.values[4] /= 2.0 * travel
    table.values[0] += (parameters[Parameter.SMEAR] - travel**2) * table.values[4]
    return table


@dataclass(frozen=True)
class Cells:
    """Sums over the cells of a ring: see the compiled loop."""

    sums: Floats
    counts: Floats
    scores: Floats
    normals: Floats
    pulls: Floats


def ring_cells(ring: Ring, parameters: Floats, free: Integers, optics: Optics, limits: Floats = _NO_LIMITS) -> Cells:
    """Sum residuals over the cells of a ring, and what parts between limits of distance say, by compiled loops."""
    from labpipe.imaging.fringes._cell_kernel import accumulate_cells

    table, kind = tabulate((ring.inner, ring.outer), parameters, free, optics)
    pixels = math.pi * (ring.outer**2 - ring.inner**2) / ring.stride
    bins = max(4, min(MOST_BINS, int(ring.outer - ring.inner), int(pixels / (SECTORS * _PIXELS_PER_CELL))))
    model = parameters, ring.origin, table.values, table.start, free, ring.ceiling, kind
    return Cells(*accumulate_cells(*ring.region, *model, bins, SECTORS, limits))


def ring_sums(ring: Ring, parameters: Floats, free: Integers, optics: Optics, told: int = 0) -> Sums:
    """Sum over the ring, by compiled loops; covariance and noise of the first parameters where some are ``told``."""
    from labpipe.imaging.fringes._fit_kernel import accumulate

    table, kind = tabulate((ring.inner, ring.outer), parameters, free, optics)
    normal, right, weighted, totals = accumulate(
        *ring.region, parameters, ring.origin, table.values, table.start, free, ring.ceiling, told, kind
    )
    squares, pixels, differences, pairs = totals
    return Sums(normal, right, weighted, squares, int(pixels), differences, int(pairs))
